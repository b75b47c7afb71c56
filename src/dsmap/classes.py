"""The 13 NYUv2 classes of Couprie et al. plus void (0), with names and colours."""

from pathlib import Path

import numpy as np

from dsmap.files import write_json

VOID = 0
"""Unlabelled: ignored by the loss, never scored, the label of a surfel that was never observed."""

CLASS_NAMES: tuple[str, ...] = (
    "void", "bed", "books", "ceiling", "chair", "floor", "furniture",
    "objects", "picture", "sofa", "table", "tv", "wall", "window",
)  # fmt: skip

NUM_CLASSES = len(CLASS_NAMES)
"""14: void and the 13 classes."""

PALETTE = np.array(
    [
        (40, 40, 40), (214, 39, 40), (140, 86, 75), (199, 199, 219), (255, 127, 14), (152, 118, 84),
        (31, 119, 180), (227, 119, 194), (148, 103, 189), (44, 160, 44), (188, 189, 34), (23, 190, 207),
        (158, 202, 225), (255, 221, 120),
    ],
    dtype=np.uint8,
)  # fmt: skip
"""RGB colour of each class, shape (14, 3)."""


NYU40_NAMES: tuple[str, ...] = (
    "void", "wall", "floor", "cabinet", "bed", "chair", "sofa", "table", "door", "window", "bookshelf",
    "picture", "counter", "blinds", "desk", "shelves", "curtain", "dresser", "pillow", "mirror", "floor mat",
    "clothes", "ceiling", "books", "refrigerator", "television", "paper", "towel", "shower curtain", "box",
    "whiteboard", "person", "night stand", "toilet", "sink", "lamp", "bathtub", "bag", "other structure",
    "other furniture", "other prop",
)  # fmt: skip
"""The 40 classes of Gupta et al. (CVPR 2013), which ScanNet calls `nyu40id`; index = id, 0 = unlabelled."""

NYU40_TO_13 = np.array(
    [0, 12, 5, 6, 1, 4, 9, 10, 12, 13, 6, 8, 6, 13, 10, 6, 13, 6, 7, 7, 5, 7, 3, 2, 6, 11, 7, 7, 7, 7, 7, 7,
     6, 7, 7, 7, 7, 7, 7, 6, 7],
    dtype=np.uint8,
)  # fmt: skip
"""NYU40 id to our class, shape (41,): `class13Mapping.mat` of Handa's nyuv2-meta-data, as used by SemanticFusion."""

CLASS_TO_NYU40 = np.array([0, 4, 23, 22, 5, 2, 39, 40, 11, 6, 7, 25, 1, 9], dtype=np.uint8)
"""Our class to the NYU40 id that stands for it, shape (14,): furniture is `other furniture`, objects `other prop`."""


def colourise(labels: np.ndarray) -> np.ndarray:
    """Class ids, any shape, to RGB uint8, shape (..., 3)."""
    return PALETTE[np.minimum(labels, NUM_CLASSES - 1)]


def as_records() -> list[dict]:
    """The content of `classes.json`: one record of id, name and colour a class."""
    return [
        {"id": i, "name": name, "color": [int(v) for v in PALETTE[i]]} for i, name in enumerate(CLASS_NAMES)
    ]


def write_classes(path: Path | str) -> None:
    """Write `classes.json`: id, name and colour of every class."""
    write_json(path, as_records())
