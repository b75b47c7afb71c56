"""The paper's experiments on PASCAL VOC 2012: the table of L and K (Table 2), and the recipe by way of NYUv2."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from dsmap.classes import NUM_CLASSES
from dsmap.dsnet.config import (
    AugmentConfig,
    DeconvNetConfig,
    DSNetConfig,
    NetConfig,
    TrainConfig,
)
from dsmap.dsnet.datasets.base import VOC_CLASS_NAMES
from dsmap.dsnet.experiments.cells import ExperimentReport, run_cells, write_table
from dsmap.dsnet.experiments.plots import plot_bars
from dsmap.dsnet.experiments.segment import SCORE_COLUMNS, TrainingRun, loadable, score_row, training_cell
from dsmap.dsnet.experiments.voc_view import voc_view
from dsmap.files import write_json

PAPER_TABLE2 = {
    "L3K8": 78.8, "L3K16": 79.5, "L3K32": 78.3, "L4K8": 82.1, "L4K16": 83.2, "L4K32": 81.6,
    "L5K8": 80.7, "L5K16": 81.4, "L5K32": 80.9,
}  # fmt: skip
"""mIoU [%] on VOC 2012's test set, as the paper has it; its encoder was trained before, on what it does not say."""
INIT_LR = 1 / 8
"""Learning rate of pretrained weights relative to that of new ones (section 4.2)."""
_CLASSES = len(VOC_CLASS_NAMES)


@dataclass(frozen=True)
class VocSetting:
    """Size of a run on VOC."""

    train: TrainConfig
    finetune: TrainConfig
    """On NYUv2, by the recipe `voc-nyu`."""
    augment: AugmentConfig = AugmentConfig()
    images: int | None = None
    """Training images at most."""
    val_images: int | None = None
    deconvnet_width: float = 1.0
    cells: tuple[str, ...] = ()
    """Only these cells of the table; none: all."""


_TINY = TrainConfig(steps=400, batch=8, size=(128, 128), warmup=40, validate_every=400)
VOC_SETTINGS = {
    "small": VocSetting(
        _TINY, replace(_TINY, steps=800, validate_every=800), images=200, val_images=40, deconvnet_width=0.125
    ),
    "full": VocSetting(
        TrainConfig(steps=33_000, batch=16, size=(512, 512), warmup=500, validate_every=3300),
        TrainConfig(steps=4000, batch=16, size=(448, 448), validate_every=500),
        AugmentConfig(scale=(0.5, 2.0)),
    ),
}
"""`full`: 50 epochs of VOC + SBD in 512x512 crops, then 90 epochs of NYUv2."""


def voc_lk(
    data: Sequence[Path], out: Path, setting: VocSetting, report: ExperimentReport = print, **where: Any
) -> dict:
    """mIoU for L in {3, 4, 5} and K in {8, 16, 32}, and of DeconvNet: Table 2.

    Args:
        data: VOC 2012, then SBD or nothing (see `voc_view`).
        out: gets results.json, table.csv, table.md, table2.png and a folder a training run.

    Returns:
        what results.json holds.

    Raises:
        InputError: data that are missing, or other settings than those in `out`.
    """
    view = voc_view(data, out / "data", setting.images, setting.val_images, setting.train.seed)
    nets: dict[str, NetConfig] = {
        f"L{layers}K{growth}": DSNetConfig(layers=layers, growth=growth, classes=_CLASSES)
        for layers in (3, 4, 5)
        for growth in (8, 16, 32)
    }
    nets["deconvnet"] = DeconvNetConfig(setting.deconvnet_width, _CLASSES)
    nets = {name: net for name, net in nets.items() if name in setting.cells or not setting.cells}
    skipped = {
        name: reason
        for name, net in nets.items()
        if not isinstance(net, DSNetConfig) and (reason := loadable(net, setting.train.size)) is not None
    }
    for name, reason in skipped.items():
        report(f"{name} left out: {reason}")
    cells = [
        training_cell(
            TrainingRun(name, net, view.train, view.val, setting.train, setting.augment), view.about, where
        )
        for name, net in nets.items()
        if name not in skipped
    ]
    table = run_cells(cells, out, report)
    rows = [[*score_row(name, entry), PAPER_TABLE2.get(name, "-")] for name, entry in table.items()]
    text = write_table(out, (*SCORE_COLUMNS, "the paper's mIoU [%], test set"), rows)
    bars = {
        f"K = {growth}": {
            f"L = {layers}": 100 * table[f"L{layers}K{growth}"]["miou"]
            for layers in (3, 4, 5)
            if f"L{layers}K{growth}" in table
        }
        for growth in (8, 16, 32)
    }
    plot_bars(out / "table2.png", bars, "mIoU [%]", "VOC 2012, validation images")
    results = {
        "experiment": "voc-lk", "setting": asdict(setting), "data": view.about, "cells": table, "skipped": skipped,
        "paper": PAPER_TABLE2,
    }  # fmt: skip
    write_json(out / "results.json", results)
    return {**results, "table": text}


def voc_nyu(
    data: Sequence[Path],
    nyu: Path,
    out: Path,
    setting: VocSetting,
    report: ExperimentReport = print,
    **where: Any,
) -> dict:
    """The paper's recipe: train on VOC 2012 + SBD, then fine-tune on NYUv2-13; and NYUv2-13 alone beside it.

    In fine-tuning, weights of VOC learn at an eighth of the rate of the new last layer.

    Args:
        data: VOC 2012, then SBD or nothing (see `voc_view`).
        nyu: NYUv2 (see `open_set`); its `@train` and `@val` are used.
        out: gets results.json, table.csv, table.md, voc_nyu.png and a folder a training run: the recipe's weights
            are nyu_after_voc/best.safetensors.

    Returns, raises:
        as `voc_lk`.
    """
    view = voc_view(data, out / "data", setting.images, setting.val_images, setting.train.seed)
    train, val = Path(f"{nyu}@train"), Path(f"{nyu}@val")
    voc_net, nyu_net = DSNetConfig(classes=_CLASSES), DSNetConfig(classes=NUM_CLASSES)
    slow = replace(setting.finetune, init_lr=INIT_LR)
    runs = [
        TrainingRun("voc", voc_net, view.train, view.val, setting.train, setting.augment),
        TrainingRun("nyu_after_voc", nyu_net, [train], val, slow, init=out / "voc" / "best.safetensors"),
        TrainingRun("nyu_alone", nyu_net, [train], val, setting.finetune),
    ]
    runs = [run for run in runs if run.name in setting.cells or not setting.cells]
    table = run_cells([training_cell(run, view.about, where) for run in runs], out, report)
    text = write_table(out, SCORE_COLUMNS, [score_row(name, entry) for name, entry in table.items()])
    bars = {
        name: {key: 100 * value["recall"] for key, value in entry["per_class"].items()}
        for name, entry in table.items()
        if name != "voc"
    }
    if bars:
        plot_bars(out / "voc_nyu.png", bars, "recall [%]", "NYUv2-13, validation images")
    results = {"experiment": "voc-nyu", "setting": asdict(setting), "data": view.about, "cells": table}
    write_json(out / "results.json", results)
    return {**results, "table": text}
