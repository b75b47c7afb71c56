"""nerfstudio's `transforms.json` with images, depth and, of a run, points to begin with."""

from pathlib import Path
from typing import Any

import numpy as np

from dsmap.errors import InputError
from dsmap.files import write_json
from dsmap.frame import Intrinsics
from dsmap.fusion.exports.images import posed_frames, write_png
from dsmap.fusion.exports.ply import write_ply
from dsmap.lens import MODELS, model_of
from dsmap.sequences import Sequence


def export_nerfstudio(sequence: Sequence, out: Path, surfels: dict[str, np.ndarray] | None = None) -> int:
    """Write `transforms.json` with `images/` and `depth/` (16-bit millimetres), as nerfstudio reads them.

    Camera axes turn to OpenGL's (y up, z backwards); pixel centres move by half a pixel.

    Args:
        sequence: frames without a pose are left out.
        surfels: arrays by the names of `SurfelMap`, in the world of the poses, for `points.ply`.

    Returns:
        The number of images.

    Raises:
        InputError: the recording has no poses.
    """
    k, frames = sequence.intrinsics, []
    for i, pose, frame in posed_frames(sequence):
        stem = f"{i:06d}.png"
        write_png(out / "images" / stem, frame.rgb[..., ::-1])
        write_png(out / "depth" / stem, np.clip(np.rint(frame.depth * 1e3), 0, 65535).astype(np.uint16))
        matrix = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
        frames.append(
            {
                "file_path": f"images/{stem}",
                "depth_file_path": f"depth/{stem}",
                "transform_matrix": matrix.tolist(),
            }
        )
    camera = _camera(k)
    if surfels is not None:
        write_ply(out / "points.ply", surfels)
        camera["ply_file_path"] = "points.ply"
    write_json(out / "transforms.json", camera | {"frames": frames})
    return len(frames)


def _camera(k: Intrinsics) -> dict[str, Any]:
    """nerfstudio's words for a camera; its pixel centres lie at .5, ours at integers."""
    lens = model_of(k.distortion)
    if lens == "rational":
        raise InputError(
            "nerfstudio knows no rational lens distortion, expected it to be taken out (--undistort)"
        )
    values = {
        "camera_model": "OPENCV_FISHEYE" if lens == "fisheye" else "OPENCV",
        "w": k.width,
        "h": k.height,
    }
    values |= {"fl_x": k.fx, "fl_y": k.fy, "cx": k.cx + 0.5, "cy": k.cy + 0.5}
    if k.distortion is not None:
        values |= dict(zip(MODELS[lens], map(float, k.distortion), strict=True))
    return values
