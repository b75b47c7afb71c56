"""Recordings in the formats of others: NYU40 label images, COCO panoptic, nerfstudio."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from dsmap.classes import CLASS_NAMES, CLASS_TO_NYU40, NYU40_NAMES, PALETTE
from dsmap.errors import InputError
from dsmap.files import atomic_path, write_json
from dsmap.sequences.base import Sequence

THINGS = {"bed", "books", "chair", "furniture", "objects", "picture", "sofa", "table", "tv", "window"}
"""Classes that are counted; ceiling, floor and wall are stuff."""


def export_nyu40(sequence: Sequence, out: Path) -> int:
    """Write `label40/*.png` (8-bit NYU40 ids) and `label40.txt`; returns the number of images.

    Of the NYU40 classes that share one of our 13, the plainest is written (objects: otherprop).

    Raises:
        InputError: the recording has no labels.
    """
    _need_labels(sequence)
    lines = []
    for i, entry in enumerate(sequence.entries):
        label = sequence.frame(i).label
        if label is not None:
            name = f"label40/{entry.time:.6f}.png"
            _write_png(out / name, CLASS_TO_NYU40[label])
            lines.append(f"{entry.time:.6f} {name}")
    with atomic_path(out / "label40.txt") as file:
        file.write_text("# NYU40 class ids\n# timestamp filename\n" + "\n".join(lines) + "\n")
    write_json(out / "classes40.json", [{"id": i, "name": n} for i, n in enumerate(NYU40_NAMES)])
    return len(lines)


def export_coco(sequence: Sequence, out: Path) -> int:
    """Write COCO panoptic: `images/`, `panoptic/*.png` (id = R + 256 G + 65536 B) and `panoptic.json`.

    A segment is an instance of a class; stuff (ceiling, floor, wall) is one segment an image. Void is 0.

    Raises:
        InputError: the recording has no labels.
    """
    _need_labels(sequence)
    images, annotations = [], []
    for i in range(len(sequence)):
        frame = sequence.frame(i)
        if frame.label is None:
            continue
        stem, height, width = f"{i:06d}", *frame.label.shape
        segments, ids = _segments(frame.label, frame.instance)
        _write_png(out / f"images/{stem}.png", frame.rgb[..., ::-1])
        # OpenCV writes BGR: the lowest byte goes into R.
        _write_png(out / f"panoptic/{stem}.png", np.stack([ids >> 16, ids >> 8, ids], -1).astype(np.uint8))
        images.append({"id": i, "file_name": f"{stem}.png", "width": width, "height": height})
        annotations.append({"image_id": i, "file_name": f"{stem}.png", "segments_info": segments})
    categories = [
        {"id": k, "name": name, "isthing": int(name in THINGS), "color": PALETTE[k].tolist()}
        for k, name in enumerate(CLASS_NAMES)
        if k
    ]
    content = {"info": {"description": f"{sequence.path.name}, written by dsmap"}, "images": images}
    content |= {"annotations": annotations, "categories": categories}
    write_json(out / "panoptic.json", content, indent=None)
    return len(images)


def export_nerfstudio(sequence: Sequence, out: Path) -> int:
    """Write `transforms.json` with `images/` and `depth/` (16-bit millimetres), as nerfstudio reads them.

    Camera axes turn to OpenGL's (y up, z backwards); pixel centres move by half a pixel.

    Raises:
        InputError: the recording has no poses.
    """
    if not sequence.has_poses:
        raise InputError(f"{sequence.path}: found no poses (groundtruth.txt), expected some for nerfstudio")
    k, frames = sequence.intrinsics, []
    for i in range(len(sequence)):
        pose = sequence.T_world_camera(i)
        if pose is None:
            continue
        frame, stem = sequence.frame(i), f"{i:06d}.png"
        _write_png(out / "images" / stem, frame.rgb[..., ::-1])
        _write_png(out / "depth" / stem, np.clip(np.rint(frame.depth * 1e3), 0, 65535).astype(np.uint16))
        matrix = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
        frames.append(
            {
                "file_path": f"images/{stem}",
                "depth_file_path": f"depth/{stem}",
                "transform_matrix": matrix.tolist(),
            }
        )
    camera = {"camera_model": "OPENCV", "w": k.width, "h": k.height, "fl_x": k.fx, "fl_y": k.fy}
    # nerfstudio's pixel centres lie at .5, ours at integers.
    write_json(out / "transforms.json", camera | {"cx": k.cx + 0.5, "cy": k.cy + 0.5, "frames": frames})
    return len(frames)


EXPORTERS: dict[str, Callable[[Sequence, Path], int]] = {
    "nyu40": export_nyu40,
    "coco": export_coco,
    "nerfstudio": export_nerfstudio,
}
"""Format to the function that writes it and returns the number of images."""


def _segments(label: np.ndarray, instance: np.ndarray | None) -> tuple[list[dict], np.ndarray]:
    """COCO's segment records of an image and the id of each pixel, int64 (H, W); 0 is void."""
    key = label.astype(np.int64)
    if instance is not None:
        counted = np.isin(label, [k for k, name in enumerate(CLASS_NAMES) if name in THINGS])
        key = key + 256 * np.where(counted, instance, 0)
    key[label == 0] = 0
    values, inverse, areas = np.unique(key, return_inverse=True, return_counts=True)
    ids = np.where(values > 0, np.cumsum(values > 0), 0)[inverse].reshape(label.shape)
    segments = []
    for number, (value, area) in enumerate(
        ((v, a) for v, a in zip(values, areas, strict=True) if v > 0), start=1
    ):
        rows, columns = np.nonzero(ids == number)
        x, y = int(columns.min()), int(rows.min())
        box = [x, y, int(columns.max()) - x + 1, int(rows.max()) - y + 1]
        segments.append(
            {"id": number, "category_id": int(value % 256), "area": int(area), "bbox": box, "iscrowd": 0}
        )
    return segments, ids


def _need_labels(sequence: Sequence) -> None:
    if not sequence.has_labels:
        why = sequence.recording.labels_unused or "found no label images, expected some (label.txt)"
        raise InputError(f"{sequence.path}: {why}")


def _write_png(path: Path, image: np.ndarray) -> None:
    with atomic_path(path) as file:
        _, data = cv2.imencode(".png", np.ascontiguousarray(image))
        file.write_bytes(data.tobytes())
