"""Experiments on NYUv2-13: the single-frame column of Table 4, and accuracy over the amount of rendered data."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dsmap.classes import CLASS_NAMES, NUM_CLASSES
from dsmap.dsnet.config import AugmentConfig, DSNetConfig, NetConfig, TrainConfig
from dsmap.dsnet.data import LabelledImages
from dsmap.dsnet.datasets.base import Example, Item, LabelledSet
from dsmap.dsnet.datasets.registry import open_set
from dsmap.dsnet.experiments.cells import Cell, ExperimentReport, run_cells, write_table
from dsmap.dsnet.experiments.plots import plot_bars, plot_curves
from dsmap.dsnet.experiments.segment import SCORE_COLUMNS, TrainingRun, score_row, training_cell
from dsmap.dsnet.inference.predict import load_segmenter
from dsmap.dsnet.scoring.measure import score
from dsmap.errors import InputError
from dsmap.files import write_json
from dsmap.sequences.images import resize_nearest

_SIZE = (320, 240)
"""Width and height at which Table 4 is scored [px]."""
TABLE4_ORDER = (
    "books", "table", "bed", "ceiling", "chair", "floor", "furniture", "objects", "picture", "sofa", "tv",
    "wall", "window",
)  # fmt: skip
LITERATURE: dict[str, tuple[float, ...]] = {
    "Hermans et al.": (45.4, 27.7, 68.4, 83.4, 41.9, 91.5, 37.1, 8.6, 35.8, 28.5, 38.4, 71.8, 46.1, 48.0),
    "SemanticFusion (RGBD-SF)": (
        58.8,
        34.0,
        61.7,
        43.4,
        58.4,
        92.6,
        63.7,
        59.1,
        66.4,
        47.3,
        33.9,
        86.0,
        60.5,
        58.9,
    ),
    "SemanticFusion, CRF": (
        58.4,
        34.3,
        62.0,
        43.3,
        59.5,
        92.7,
        64.4,
        58.3,
        65.8,
        48.7,
        34.3,
        86.3,
        62.3,
        59.2,
    ),
    "Nakajima, geometric only": (
        6.4,
        56.6,
        83.7,
        32.0,
        52.8,
        83.1,
        73.5,
        40.0,
        4.3,
        75.3,
        53.1,
        75.0,
        50.2,
        52.8,
    ),
    "Nakajima et al.": (15.6, 53.0, 83.7, 24.4, 56.7, 83.3, 76.1, 52.5, 40.8, 77.7, 57.3, 75.3, 64.4, 58.5),
    "the paper": (37.8, 45.2, 64.8, 38.5, 64.2, 91.8, 74.3, 65.5, 68.2, 50.8, 39.1, 85.4, 45.8, 59.3),
}
"""The rows of the paper's Table 4: recall of the classes in `TABLE4_ORDER`, then the class average [%]. All but
those of single frames are of maps, on a few sequences of the test split."""
SINGLE_FRAME_RGBD_CNN = 55.6
"""Class average of SemanticFusion's network on single RGB-D frames [%]."""
FRACTIONS = (0.0, 0.25, 0.5, 1.0)


@dataclass(frozen=True)
class CurveSetting:
    """Size of the experiment `rendered-curve`."""

    pretrain: TrainConfig
    finetune: TrainConfig
    augment: AugmentConfig = AugmentConfig()
    recordings: int | None = None
    """Rendered recordings at most."""
    cells: tuple[str, ...] = ()


_TINY = TrainConfig(steps=600, size=(160, 128), warmup=50, validate_every=600, lr=1.5e-2, precision="bf16")
CURVE_SETTINGS = {
    "small": CurveSetting(_TINY, _TINY),
    "full": CurveSetting(
        TrainConfig(steps=8000, size=(320, 256), validate_every=2000),
        TrainConfig(steps=8000, size=(320, 256), lr=5e-3, validate_every=1000),
    ),
}


def nyuv2_table(
    data: Path,
    weights: Sequence[Path],
    out: Path,
    images: int | None = None,
    report: ExperimentReport = print,
) -> dict:
    """Recall of every class at 320x240 of networks on single frames, beside the rows of the paper's Table 4.

    Args:
        data: NYUv2 or other images of the 13 classes, PATH@SPLIT (see `open_set`).
        weights: files of `dsmap train`; none: the weights that come with dsmap.
        images: at most so many, evenly spread; None: all.
        out: gets results.json, table.csv, table.md and table4.png.

    Raises:
        InputError: missing data or weights, other classes.
    """
    found = open_set(data)
    if found.class_names != CLASS_NAMES:
        raise InputError(f"{data}: classes are {', '.join(found.class_names)}, expected the 13 of NYUv2")
    if images is not None and images < len(found.items):
        spread = np.linspace(0, len(found.items) - 1, images).round().astype(int)
        found = replace(found, items=[found.items[i] for i in spread])
    cells = [
        Cell(
            name,
            {"weights": None if path is None else str(path), "data": str(data), "images": len(found.items)},
            lambda _, path=path: _score(found, path),
        )
        for name, path in zip(_names(weights), list(weights) or [None], strict=True)
    ]
    table = run_cells(cells, out, report)
    columns = ("method", *TABLE4_ORDER, "class average", "pixel accuracy", "mIoU")
    rows: list[Sequence[object]] = [[name, *map(str, row), "-", "-"] for name, row in LITERATURE.items()]
    rows.append(["RGB-D CNN of SemanticFusion, single frames", *"-" * 13, SINGLE_FRAME_RGBD_CNN, "-", "-"])
    rows += [[f"{name}, single frames", *_row(entry)] for name, entry in table.items()]
    text = write_table(out, columns, rows)
    bars = {
        name: {k: 100 * entry["per_class"][k]["recall"] for k in TABLE4_ORDER if k in entry["per_class"]}
        for name, entry in table.items()
    }
    bars["the paper (maps)"] = dict(zip(TABLE4_ORDER, LITERATURE["the paper"][:-1], strict=True))
    plot_bars(out / "table4.png", bars, "recall [%]", "NYUv2-13, single frames")
    results = {"experiment": "nyuv2", "data": str(data), "images": len(found.items), "cells": table}
    write_json(out / "results.json", results)
    return {**results, "table": text}


def rendered_curve(
    nyu: Path,
    rendered: Path,
    out: Path,
    setting: CurveSetting,
    report: ExperimentReport = print,
    **where: Any,
) -> dict:
    """NYUv2-13 validation scores over the share of a rendered set that the network was trained on before.

    Every share is trained on for the same number of steps, and larger shares contain the smaller ones.

    Args:
        nyu: NYUv2 (see `open_set`); its `@train` and `@val` are used.
        rendered: a folder of recordings with labels, such as `dsmap render-scene --count` makes.
        out: gets results.json, table.csv, table.md, rendered_curve.png and a folder a training run.

    Raises:
        InputError: missing data, or other settings than those in `out`.
    """
    recordings = sorted(path for path in rendered.iterdir() if path.is_dir()) if rendered.is_dir() else []
    if len(recordings) < 4:
        raise InputError(f"{rendered}: {len(recordings)} recordings, expected a folder of at least 4")
    order = np.random.default_rng(setting.pretrain.seed).permutation(len(recordings))
    recordings = [recordings[i] for i in order[: setting.recordings]]
    runs, counts = _curve_runs(nyu, recordings, out, setting)
    cells = [training_cell(run, {"recordings": counts[run.name]}, where) for run in runs]
    table = run_cells(cells, out, report)
    text = write_table(
        out,
        (*SCORE_COLUMNS, "rendered recordings"),
        [[*score_row(name, entry), counts[name]] for name, entry in table.items()],
    )
    curves = {
        label: [
            [
                (100.0 * f, 100 * table[n][key])
                for f in FRACTIONS
                if (n := f"nyu_after_{round(100 * f)}") in table
            ]
        ]
        for label, key in (("class average", "class_avg"), ("pixel accuracy", "pixel_acc"), ("mIoU", "miou"))
    }
    title = "NYUv2-13, validation images"
    plot_curves(
        out / "rendered_curve.png", curves, "share of the rendered recordings [%]", "score [%]", title
    )
    results = {
        "experiment": "rendered-curve",
        "setting": asdict(setting),
        "recordings": len(recordings),
        "cells": table,
    }
    write_json(out / "results.json", results)
    return {**results, "table": text}


def _curve_runs(
    nyu: Path, recordings: list[Path], out: Path, setting: CurveSetting
) -> tuple[list[TrainingRun], dict[str, int]]:
    """The trainings of every share, and how many recordings each has seen."""
    train, val = Path(f"{nyu}@train"), Path(f"{nyu}@val")
    net: NetConfig = DSNetConfig(classes=NUM_CLASSES)
    runs, counts = [], {}
    for fraction in FRACTIONS:
        share = recordings[: round(fraction * len(recordings))]
        name, before = f"nyu_after_{round(100 * fraction)}", f"rendered_{round(100 * fraction)}"
        counts[name] = counts[before] = len(share)
        init = out / before / "best.safetensors" if share else None
        if share:
            runs.append(TrainingRun(before, net, share, val, setting.pretrain, setting.augment))
        runs.append(TrainingRun(name, net, [train], val, setting.finetune, setting.augment, init))
    return [run for run in runs if run.name in setting.cells or not setting.cells], counts


@dataclass(frozen=True)
class _At320:
    """An item whose labels are resized to `_SIZE`; the network gets the image as it is."""

    item: Item

    @property
    def name(self) -> str:
        return self.item.name

    def read(self, with_geometry: bool = True) -> Example:
        example = self.item.read(with_geometry)
        return replace(example, label=resize_nearest(example.label, *_SIZE))


def _score(data: LabelledSet, weights: Path | None) -> dict:
    segmenter = load_segmenter(weights)
    small = LabelledSet([_At320(item) for item in data.items], data.class_names, data.has_depth)
    images = LabelledImages(small, with_geometry=segmenter.wants_geometry, progress=False)
    return score(segmenter, images, calibration=True)


def _names(weights: Sequence[Path]) -> list[str]:
    """What the files are called in the table: their stems, or their folders' names for `best.safetensors`."""
    names = [path.parent.resolve().name if path.stem == "best" else path.stem for path in weights]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"weights: {', '.join(twice)} twice, expected files of different names")
    return names or ["shipped"]


def _row(entry: dict) -> list[str]:
    recalls = [entry["per_class"].get(name, {}).get("recall") for name in TABLE4_ORDER]
    values = [*recalls, entry["class_avg"], entry["pixel_acc"], entry["miou"]]
    return ["-" if value is None else f"{100 * value:.1f}" for value in values]
