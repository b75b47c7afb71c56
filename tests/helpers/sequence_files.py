"""Tiny recordings on disk, in every layout, for the tests of reading and of evaluation."""

from pathlib import Path

import cv2
import numpy as np

from dsmap.frame import Intrinsics
from dsmap.sequences import SequenceWriter

CAMERA = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
RATE = 30.0


def colour(seed: int, camera: Intrinsics = CAMERA) -> np.ndarray:
    """A random image, uint8, shape (H, W, 3)."""
    return np.random.default_rng(seed).integers(0, 255, (camera.height, camera.width, 3), dtype=np.uint8)


def depth(seed: int, camera: Intrinsics = CAMERA) -> np.ndarray:
    """Depth of 1 to 2 m in whole millimetres, with a hole, float32, shape (H, W)."""
    values = np.random.default_rng(seed).integers(1000, 2000, (camera.height, camera.width)) / 1000
    values[:4, :4] = 0
    return values.astype(np.float32)


def pose(i: int) -> np.ndarray:
    """A camera that moves 10 cm a frame along x and turns 0.1 rad a frame about z."""
    c, s = np.cos(0.1 * i), np.sin(0.1 * i)
    return np.array([[c, -s, 0, 0.1 * i], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def write_tum(folder: Path, frames: int = 6, labels: bool = False) -> Path:
    """A TUM-layout recording of random images with poses and calibration.yaml."""
    with SequenceWriter(folder, CAMERA, 1000.0) as writer:
        for i in range(frames):
            label = np.full((48, 64), i % 13 + 1) if labels else None
            instance = np.full((48, 64), 1000 + i) if labels else None
            writer.write(
                i / RATE, colour(i), depth(i), T_world_camera=pose(i), label=label, instance=instance
            )
    return folder


def write_seven_scenes(folder: Path, frames: int = 4) -> Path:
    """A 7-Scenes recording; some depth pixels are 65535 (invalid)."""
    folder.mkdir(parents=True)
    for i in range(frames):
        millimetres = (depth(i) * 1000).astype(np.uint16)
        millimetres[10, 10] = 65535
        stem = folder / f"frame-{i:06d}"
        cv2.imwrite(f"{stem}.color.png", colour(i)[..., ::-1])
        cv2.imwrite(f"{stem}.depth.png", millimetres)
        np.savetxt(f"{stem}.pose.txt", pose(i))
    return folder


def write_redwood(folder: Path, frames: int = 4, first: int = 0, trajectory: bool = True) -> Path:
    """A Redwood recording, files numbered from `first`."""
    for name in ("image", "depth"):
        (folder / name).mkdir(parents=True)
    blocks = []
    for i in range(frames):
        cv2.imwrite(str(folder / "image" / f"{first + i:05d}.png"), colour(i)[..., ::-1])
        cv2.imwrite(str(folder / "depth" / f"{first + i:05d}.png"), (depth(i) * 1000).astype(np.uint16))
        blocks.append(f"{i} {i} {i + 1}\n" + "\n".join(" ".join(f"{v:.9f}" for v in row) for row in pose(i)))
    if trajectory:
        (folder / "trajectory.log").write_text("\n".join(blocks) + "\n")
    return folder
