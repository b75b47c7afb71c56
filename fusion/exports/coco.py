"""COCO panoptic: images, segments, categories."""

from pathlib import Path

import numpy as np

from dsmap.classes import CLASS_NAMES, PALETTE
from dsmap.files import write_json
from dsmap.fusion.exports.images import labelled_frames, write_png
from dsmap.sequences import Sequence

THINGS = {"bed", "books", "chair", "furniture", "objects", "picture", "sofa", "table", "tv", "window"}
"""Classes that are counted; ceiling, floor and wall are stuff."""


def export_coco(sequence: Sequence, out: Path) -> int:
    """Write COCO panoptic: `images/`, `panoptic/*.png` (id = R + 256 G + 65536 B) and `panoptic.json`.

    A segment is an instance of a class; stuff (ceiling, floor, wall) is one segment an image. Void is 0.

    Raises:
        InputError: the recording has no labels.
    """
    images, annotations = [], []
    for i, label, frame in labelled_frames(sequence):
        stem, height, width = f"{i:06d}", *label.shape
        segments, ids = _segments(label, frame.instance)
        write_png(out / f"images/{stem}.png", frame.rgb[..., ::-1])
        # OpenCV writes BGR: the lowest byte goes into R.
        write_png(out / f"panoptic/{stem}.png", np.stack([ids >> 16, ids >> 8, ids], -1).astype(np.uint8))
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
