"""Whole recordings, runs of them, scenes and settings, to be damaged."""

import dataclasses
import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from command_line import cli

Build = Callable[[Path], object]


def _frames(count: int) -> list[Any]:
    from corner_frames import FRAMES

    return FRAMES[:count]


def recorded(folder: Path, frames: int = 6) -> Path:
    from dsmap.sequences import SequenceWriter
    from dsmap.tools.twins.corner import INTRINSICS

    camera = INTRINSICS.scaled(64, 48)
    with SequenceWriter(folder, camera, depth_max=6.0) as writer:
        for i, f in enumerate(_frames(frames)):
            small = [
                np.ascontiguousarray(cv2.resize(a, (64, 48), interpolation=cv2.INTER_NEAREST))
                for a in (f.rgb, f.depth, f.label)
            ]
            writer.write(
                i / 30,
                small[0],
                small[1],
                T_world_camera=f.T_world_camera,
                label=small[2],
                instance=np.full((48, 64), 3),
            )
    return folder


def tum(folder: Path) -> None:
    recorded(folder / "rec")


def mapped(folder: Path) -> None:
    """A recording and a RUN of it."""
    recorded(folder / "rec")
    cli(f"map {folder / 'rec'} --out {folder / 'run'} --segmenter labels --device cpu --no-pictures")


def with_config(folder: Path) -> None:
    from dsmap.files import write_yaml
    from dsmap.fusion.config import MapConfig

    recorded(folder / "rec", 3)
    values = dataclasses.asdict(MapConfig())
    kept = {k: values[k] for k in ("track", "surfels", "labels", "ferns", "relocalise", "graph", "moving")}
    write_yaml(
        folder / "mine.yaml", {**kept, "depth_min": 0.3, "stride": 1, "pictures": False, "camera_up": "top"}
    )


def with_label_map(folder: Path) -> None:
    recorded(folder / "rec", 3)
    (folder / "map.yaml").write_text("".join(f"{i}: {i}\n" for i in range(14)))
    (folder / "map.csv").write_text("id,class\n" + "".join(f"{i},{i}\n" for i in range(14)))
    (folder / "map.json").write_text(
        json.dumps([{"id": 12, "class": "wall", "color": "#101010"}, {"id": 5, "name": "floor"}])
    )


def figures(folder: Path) -> None:
    from importlib import resources

    (folder / "mine.yaml").write_text((resources.files("dsmap.tools") / "figures.yaml").read_text())


def layout(name: str) -> Build:
    def build(folder: Path) -> None:
        recorded(folder / "tum", 4)
        shots = zip(
            sorted((folder / "tum" / "rgb").iterdir()),
            sorted((folder / "tum" / "depth").iterdir()),
            strict=True,
        )
        poses = [f.T_world_camera for f in _frames(4)]
        (folder / "rec").mkdir()
        for i, (colour, depth) in enumerate(shots):
            depth = cv2.imread(str(depth), cv2.IMREAD_UNCHANGED)
            places = {
                "seven": (f"frame-{i:06d}.color.png", f"frame-{i:06d}.depth.png"),
                "redwood": (f"image/{i:05d}.png", f"depth/{i:05d}.png"),
            }
            for place, content in zip(
                places[name], (colour.read_bytes(), cv2.imencode(".png", depth)[1].tobytes()), strict=True
            ):
                (folder / "rec" / place).parent.mkdir(exist_ok=True)
                (folder / "rec" / place).write_bytes(content)
            if name == "seven":
                np.savetxt(folder / "rec" / f"frame-{i:06d}.pose.txt", poses[i])
        if name == "redwood":
            blocks = [
                f"{i} {i} {i + 1}\n" + "\n".join(" ".join(f"{v:.9f}" for v in row) for row in T)
                for i, T in enumerate(poses)
            ]
            (folder / "rec" / "trajectory.log").write_text("\n".join(blocks) + "\n")
        shutil.copy(folder / "tum" / "calibration.yaml", folder / "rec")
        shutil.rmtree(folder / "tum")

    return build


def by_format(name: str) -> Build:
    def build(folder: Path) -> None:
        import format_cases
        import recording_shots

        case = format_cases.CASES[name]
        (folder / "rec").mkdir()
        place = case.write(folder / "rec", recording_shots.shots()[:4])
        (folder / "where.txt").write_text(str(place.relative_to(folder)))

    return build


def packed(kind: str) -> Build:
    def build(folder: Path) -> None:
        recorded(folder / "rec", 3)
        made = shutil.make_archive(str(folder / "packed"), {"tgz": "gztar"}.get(kind, kind), folder, "rec")
        Path(made).rename(folder / f"rec.{kind}")
        shutil.rmtree(folder / "rec")

    return build


def scene(kind: str) -> Build:
    def build(folder: Path) -> None:
        from PIL import Image

        sys.path.insert(0, str(Path(__file__).parents[1] / "sim"))
        import test_importers as toys

        rng = np.random.default_rng(0)
        if kind == "xml":
            (folder / "home.xml").write_text(
                toys.MJCF.format(ball="red_ball").replace(
                    'builtin="checker" width="32" height="32" rgb1="0.8 0.6 0.4" rgb2="0.6 0.4 0.2"',
                    'file="boards.png"',
                )
            )
            Image.fromarray(rng.integers(0, 255, (8, 8, 3), dtype=np.uint8)).save(folder / "boards.png")
        elif kind == "glb":
            toys.boxes(folder / "home.glb")
        elif kind == "ply":
            toys.scan(folder / "home.ply", "label", [2, 1])
        elif kind == "replica":
            toys.scan(folder / "home.ply", "object_id", [11, 12])
            info = {"classes": [{"id": 1, "name": "rug"}, {"id": 2, "name": "sofa"}],
                    "objects": [{"id": 11, "class_id": 1}, {"id": 12, "class_id": 2}]}  # fmt: skip
            (folder / "info_semantic.json").write_text(json.dumps(info))
        elif kind == "obj":
            (folder / "home.obj").write_text(
                "mtllib home.mtl\no floor\nv -4 -4 0\nv 4 -4 0\nv 4 4 0\nv -4 4 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl floor\n"
                "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\no table\nv -0.5 0 0.7\nv 0.5 0 0.7\nv 0 0.5 0.7\nv 0 0 0.9\nusemtl table\nf 5/1 6/2 7/3\nf 5/1 6/2 8/3\n"
                "o wall\nv -4 4 0\nv 4 4 0\nv 4 4 2.5\nv -4 4 2.5\nusemtl floor\nf 9/1 10/2 11/3\nf 9/1 11/3 12/4\n"
            )
            (folder / "home.mtl").write_text(
                "newmtl floor\nKd 1 1 1\nmap_Kd boards.png\nnewmtl table\nKd 0.5 0.2 0.1\n"
            )
            Image.fromarray(rng.integers(0, 255, (8, 8, 3), dtype=np.uint8)).save(folder / "boards.png")
        (folder / "classes.yaml").write_text("red_ball: objects\n'*': furniture\n")

    return build
