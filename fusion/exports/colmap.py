"""COLMAP's text model: cameras.txt, images.txt, points3D.txt, and the images without distortion."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dsmap.files import atomic_path
from dsmap.frame import Intrinsics
from dsmap.fusion.exports.images import posed_frames, write_png
from dsmap.fusion.exports.run_frames import RunFrames
from dsmap.lens import model_of
from dsmap.sequences import Sequence

POINTS = 50_000
"""Surfels that become points: about as many as structure from motion finds."""


def export_colmap(sequence: Sequence, out: Path, surfels: dict[str, np.ndarray] | None = None) -> int:
    """Write `images/` and `sparse/0/` with cameras.txt, images.txt and points3D.txt; returns the number of images.

    Poses are world-to-camera; COLMAP's pixel centres lie at .5, ours at integers. A camera is PINHOLE, or with
    distortion (a recording opened without `undistort`) FULL_OPENCV or OPENCV_FISHEYE.

    Args:
        sequence: frames without a pose are left out. Of a `RunFrames`, a point's track are the images that see it.
        surfels: the run's arrays by the names of `SurfelMap`; None writes no points.

    Raises:
        InputError: the recording has no poses.
    """
    chosen = _sample(surfels)
    number = np.full(0 if surfels is None else len(surfels["weight"]), -1)
    number[chosen] = np.arange(len(chosen))
    images: list[str] = []
    tracks: list[list[str]] = [[] for _ in chosen]
    for i, pose, frame in posed_frames(sequence):
        name = f"{i:06d}.png"
        write_png(out / "images" / name, frame.rgb[..., ::-1])
        seen = np.zeros(0, int)
        if surfels is not None and isinstance(sequence, RunFrames):
            index = sequence.index(i)
            points = number[np.unique(index[index >= 0])]
            seen = points[points >= 0]
        T = np.linalg.inv(pose)
        quaternion = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)
        numbers = " ".join(f"{v:.9g}" for v in (*quaternion, *T[:3, 3]))
        pixels = _project(T, sequence.intrinsics, surfels, chosen[seen])
        for at, point in enumerate(seen):
            tracks[point].append(f"{i + 1} {at}")
        images.append(f"{i + 1} {numbers} 1 {name}")
        images.append(" ".join(f"{x:.3f} {y:.3f} {p + 1}" for (x, y), p in zip(pixels, seen, strict=True)))
    model = out / "sparse" / "0"
    _write(model / "cameras.txt", ["# CAMERA_ID MODEL WIDTH HEIGHT PARAMS", _camera(sequence.intrinsics)])
    _write(
        model / "points3D.txt", ["# POINT3D_ID X Y Z R G B ERROR TRACK", *_points(surfels, chosen, tracks)]
    )
    _write(model / "images.txt", ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME", "# POINTS2D", *images])
    return len(images) // 2


def _sample(surfels: dict[str, np.ndarray] | None) -> np.ndarray:
    """Rows of the surfels that become points: the most certain ones are likelier."""
    if surfels is None:
        return np.zeros(0, int)
    weight = surfels["weight"].astype(np.float64)
    alive = int((weight > 0).sum())
    if alive <= POINTS:
        return np.flatnonzero(weight > 0)
    rng = np.random.default_rng(0)
    return np.sort(rng.choice(len(weight), POINTS, replace=False, p=weight / weight.sum()))


def _camera(k: Intrinsics) -> str:
    values = [k.fx, k.fy, k.cx + 0.5, k.cy + 0.5]
    model, more = "PINHOLE", ()
    if k.distortion is not None:
        lens = model_of(k.distortion)
        model = "OPENCV_FISHEYE" if lens == "fisheye" else "FULL_OPENCV"
        more = (*k.distortion, 0.0, 0.0, 0.0) if lens == "radtan" else k.distortion
    values += more
    return f"1 {model} {k.width} {k.height} " + " ".join(f"{v:.9g}" for v in values)


def _project(
    T_camera_world: np.ndarray, k: Intrinsics, surfels: dict[str, np.ndarray] | None, rows: np.ndarray
) -> np.ndarray:
    """Where surfels lie in an image with pixel centres at .5 [px], shape (N, 2)."""
    if surfels is None:
        return np.zeros((0, 2))
    points = surfels["position"][rows] @ T_camera_world[:3, :3].T + T_camera_world[:3, 3]
    pixels = points @ k.K.T
    return pixels[:, :2] / pixels[:, 2:] + 0.5


def _points(surfels: dict[str, np.ndarray] | None, chosen: np.ndarray, tracks: list[list[str]]) -> list[str]:
    if surfels is None:
        return []
    rgb = np.rint(surfels["colour"][chosen].clip(0, 1) * 255).astype(int)
    lines = []
    for n, (xyz, colour, track) in enumerate(zip(surfels["position"][chosen], rgb, tracks, strict=True)):
        place = " ".join(f"{v:.6f}" for v in xyz)
        lines.append(f"{n + 1} {place} {colour[0]} {colour[1]} {colour[2]} 0 {' '.join(track)}".rstrip())
    return lines


def _write(path: Path, lines: list[str]) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
