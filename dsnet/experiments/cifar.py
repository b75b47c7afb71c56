"""The paper's experiments on CIFAR-10: how many layers and feature maps (Fig. 6, 7), and against VGG-16 (Fig. 8)."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dsmap.dsnet.checkpoint import record_of
from dsmap.dsnet.config import ClassifierConfig, DeconvNetConfig, DSNetConfig
from dsmap.dsnet.datasets.cifar import CIFAR_CLASSES, ClassifiedImages, folds, load_cifar10
from dsmap.dsnet.experiments.cells import Cell, ExperimentReport, run_cells, write_table
from dsmap.dsnet.experiments.plots import plot_curves
from dsmap.dsnet.training.classify import ClassifyConfig, train_classifier
from dsmap.errors import InputError
from dsmap.files import write_json

FOLDS = 10
"""One of them is held back: 10 % of the images."""
LAYERS = ("L3K16", "L4K16", "L5K16")
MAPS = ("L4K8", "L4K16", "L4K32")
PAPER_BEST = {"L": "L4K16", "K": "L4K16"}


@dataclass(frozen=True)
class CifarSetting:
    """Size of a run on CIFAR-10."""

    train: ClassifyConfig
    stem_stride: int
    """Of DS-Net's first convolution: 2 as in Table 1, or 1, which keeps more of a 32x32 image."""
    dropout: float
    """Of DS-Net; the paper has 0.2."""
    vgg_width: float
    """Channels of VGG-16 relative to the original."""
    folds: int = 1
    """Folds that are held back in turn, of ten."""
    seeds: int = 1
    """Trainings of each cell and fold with other seeds."""
    cells: tuple[str, ...] = ()
    """Only these cells of the table; none: all."""


LK_SETTINGS = {
    "small": CifarSetting(ClassifyConfig(epochs=6), stem_stride=2, dropout=0.0, vgg_width=0.25),
    "full": CifarSetting(ClassifyConfig(epochs=30), stem_stride=1, dropout=0.2, vgg_width=1.0, folds=FOLDS),
}
DECONVNET_SETTINGS = {name: replace(setting, stem_stride=1) for name, setting in LK_SETTINGS.items()}
"""VGG-16 begins with the full size: so does DS-Net beside it."""


def cifar_lk(
    data: Path, out: Path, setting: CifarSetting, report: ExperimentReport = print, **where: Any
) -> dict:
    """Accuracy over epochs for L in {3, 4, 5} (K = 16) and K in {8, 16, 32} (L = 4): Fig. 6 and 7.

    Args:
        data: CIFAR-10 (see `load_cifar10`).
        out: gets results.json, table.csv, table.md, fig6.png, fig7.png and a folder a training run.

    Returns:
        what results.json holds.

    Raises:
        InputError: no CIFAR-10, unknown cells, other settings than those in `out`.
    """
    nets: dict[str, DSNetConfig | DeconvNetConfig] = {
        name: _dsnet(int(name[1]), int(name[3:]), setting.dropout) for name in dict.fromkeys((*LAYERS, *MAPS))
    }
    table = _train_all(nets, data, out, setting, report, where)
    for figure, names, what in (("fig6", LAYERS, "layers L"), ("fig7", MAPS, "feature maps K")):
        _plot(out / f"{figure}.png", table, names, f"CIFAR-10, held-out images: {what} in a dense block")
    orders = {
        key: compare({name: table[name] for name in names if name in table}, PAPER_BEST[key])
        for key, names in (("L", LAYERS), ("K", MAPS))
    }
    return _finish(out, "cifar-lk", setting, table, {"orders": orders})


def cifar_deconvnet(
    data: Path, out: Path, setting: CifarSetting, report: ExperimentReport = print, **where: Any
) -> dict:
    """DS-Net's encoder (L = 4, K = 16) against DeconvNet's, both with global pooling: Fig. 8.

    Arguments, result and errors as `cifar_lk`'s; the plot is fig8.png.
    """
    nets = {
        "DS-Net": _dsnet(4, 16, setting.dropout),
        "DeconvNet": DeconvNetConfig(setting.vgg_width, len(CIFAR_CLASSES)),
    }
    table = _train_all(nets, data, out, setting, report, where)
    _plot(out / "fig8.png", table, tuple(nets), "CIFAR-10, held-out images: encoders")
    return _finish(out, "cifar-deconvnet", setting, table, {"order": compare(table, "DS-Net")})


def compare(table: dict[str, dict], paper_best: str) -> dict:
    """Whether the cell that is the paper's best is the best here, and by how much against the noise.

    The noise of a difference of two means is, where there are two runs a cell, sqrt of the sum of the variances
    of the means, and otherwise that of drawing the held-out images (which is more than what two networks on the
    same images differ by): two standard deviations of it are called significant.
    """
    ranked = sorted(table, key=lambda name: -table[name]["accuracy"])
    result: dict[str, Any] = {"order": ranked, "paper_best": paper_best}
    if paper_best not in table or len(ranked) < 2:
        return result | {"reproduced": None}
    rival = ranked[1] if ranked[0] == paper_best else ranked[0]
    gap = table[paper_best]["accuracy"] - table[rival]["accuracy"]
    noise = 2 * math.hypot(table[paper_best]["error"], table[rival]["error"])
    return result | {
        "reproduced": gap > 0,
        "rival": rival,
        "gap": gap,
        "two_sigma": noise,
        "significant": abs(gap) > noise,
    }


def sentence(order: dict) -> str:
    """`compare`'s result for people."""
    ranked = " > ".join(order["order"])
    if order["reproduced"] is None:
        return f"order here: {ranked}"
    said = "as in the paper" if order["reproduced"] else "NOT as in the paper"
    sure = "more" if order["significant"] else "not more"
    return (
        f"order here: {ranked}; {order['paper_best']} best: {said}; it differs from {order['rival']} by "
        f"{100 * order['gap']:+.2f} points, {sure} than the noise ({100 * order['two_sigma']:.2f}, two sigma)"
    )


def _dsnet(layers: int, growth: int, dropout: float) -> DSNetConfig:
    return DSNetConfig(layers=layers, growth=growth, dropout=dropout, classes=len(CIFAR_CLASSES))


def _train_all(
    nets: dict[str, Any], data: Path, out: Path, setting: CifarSetting, report: ExperimentReport, where: dict
) -> dict[str, dict]:
    """Train every network on every fold with every seed; name to mean and runs."""
    unknown = [name for name in setting.cells if name not in nets]
    if unknown or not 1 <= setting.folds <= FOLDS or setting.seeds < 1:
        raise InputError(
            f"experiment: cells {', '.join(unknown) or 'fine'}, folds {setting.folds}, seeds {setting.seeds}; "
            f"expected cells of {', '.join(nets)}, 1..{FOLDS} folds and a seed"
        )
    images = load_cifar10(data)
    fold = folds(images.labels, FOLDS)
    runs = [
        (name, held, setting.train.seed + seed)
        for held in range(setting.folds)
        for seed in range(setting.seeds)
        for name in nets
        if name in setting.cells or not setting.cells
    ]
    cells = [
        _cell(
            f"{name}_fold{held}_seed{seed}",
            ClassifierConfig(nets[name], setting.stem_stride),
            images,
            fold != held,
            replace(setting.train, seed=seed),
            where,
        )
        for name, held, seed in runs
    ]
    results = run_cells(cells, out, report)
    return {
        name: _mean([results[cell.name] for cell, run in zip(cells, runs, strict=True) if run[0] == name])
        for name in dict.fromkeys(name for name, *_ in runs)
    }


def _cell(
    name: str,
    net: ClassifierConfig,
    images: ClassifiedImages,
    chosen: np.ndarray,
    config: ClassifyConfig,
    where: dict,
) -> Cell:
    def run(folder: Path) -> dict:
        held_back = images.take(np.flatnonzero(~chosen))
        result = train_classifier(
            net,
            images.take(np.flatnonzero(chosen)),
            held_back,
            config,
            folder / "checkpoint.safetensors",
            **where,
        )
        return {**result, "held_back": len(held_back)}

    settings = {
        "encoder": record_of(net.encoder),
        "stem_stride": net.stem_stride,
        **asdict(config),
        "images": int(chosen.sum()),
    }
    return Cell(name, settings, run)


def _mean(runs: Sequence[dict]) -> dict:
    """Mean accuracy of a cell's runs, its standard error, and the runs."""
    values = [run["accuracy"] for run in runs]
    mean = statistics.fmean(values)
    if len(runs) > 1:
        error = statistics.stdev(values) / math.sqrt(len(values))
    else:
        error = math.sqrt(mean * (1 - mean) / runs[0]["held_back"])
    return {"accuracy": mean, "error": error, "parameters": runs[0]["parameters"], "runs": list(runs)}


def _plot(path: Path, table: dict[str, dict], names: Sequence[str], title: str) -> None:
    curves = {
        name: [[(h["epoch"], 100 * h["accuracy"]) for h in run["history"]] for run in table[name]["runs"]]
        for name in names
        if name in table
    }
    if curves:
        plot_curves(path, curves, "epoch", "accuracy [%]", title)


def _finish(out: Path, name: str, setting: CifarSetting, table: dict[str, dict], more: dict) -> dict:
    rows = [
        [
            cell,
            f"{100 * entry['accuracy']:.2f}",
            f"{100 * entry['error']:.2f}",
            len(entry["runs"]),
            entry["parameters"],
            f"{statistics.fmean(run['images_per_s'] for run in entry['runs']):.0f}",
        ]
        for cell, entry in table.items()
    ]
    columns = ("network", "accuracy [%]", "standard error", "runs", "parameters", "images/s a core")
    table_text = write_table(out, columns, rows)
    results = {"experiment": name, "setting": asdict(setting), "cells": table, **more}
    write_json(out / "results.json", results)
    return {**results, "table": table_text}
