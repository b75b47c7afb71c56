"""What the segmentation experiments share: one training run as a cell of a table."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from dsmap.dsnet.checkpoint import record_of
from dsmap.dsnet.config import AugmentConfig, NetConfig, TrainConfig
from dsmap.dsnet.experiments.cells import Cell
from dsmap.dsnet.networks.build import build_network
from dsmap.dsnet.training.train import train
from dsmap.errors import InputError
from dsmap.plain import read_json


@dataclass(frozen=True)
class TrainingRun:
    """One training run of a network on labelled images."""

    name: str
    net: NetConfig
    data: Sequence[Path]
    val: Path
    config: TrainConfig
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    init: Path | None = None
    """Weights to start from; of an earlier cell of the same experiment."""


def training_cell(run: TrainingRun, about: dict[str, Any], where: dict[str, Any]) -> Cell:
    """A training run as a cell: its scores at its best validation.

    Args:
        about: what the data are, for the settings that a finished cell is recognised by.
        where: `device`, `workers`, `progress` of `train`.
    """

    def compute(folder: Path) -> dict:
        best = train(
            run.data, run.val, folder, run.net, run.augment, run.config, init=run.init, resume=True, **where
        )
        history = read_json(folder / "history.json", "the history of a training")
        seconds = history[-1]["seconds"]
        scores = ("step", "class_avg", "miou", "pixel_acc", "ece", "temperature", "per_class")
        return {
            **{key: best[key] for key in scores},
            "seconds": seconds,
            "images_per_s": run.config.steps * run.config.batch / max(seconds, 1e-9),
            "history": [{key: h[key] for key in ("step", "loss", "class_avg", "miou")} for h in history],
        }

    settings = {
        "net": record_of(run.net),
        "train": asdict(run.config),
        "augment": asdict(run.augment),
        "init": None if run.init is None else run.init.parent.name,
        **about,
    }
    return Cell(run.name, settings, compute)


def loadable(net: NetConfig, size: tuple[int, int]) -> str | None:
    """None if a network can be built and takes images of this size; otherwise one sentence that says why not."""
    import torch

    try:
        build_network(net).eval()(torch.zeros(1, net.channels, size[1], size[0]))
    except InputError as error:
        return str(error)
    return None


def score_row(name: str, result: dict) -> list[object]:
    """A line of a table: see `SCORE_COLUMNS`."""
    scores = [f"{100 * result[key]:.1f}" for key in ("miou", "class_avg", "pixel_acc")]
    return [name, *scores, f"{result['images_per_s']:.1f}"]


SCORE_COLUMNS = ("network", "mIoU [%]", "class average [%]", "pixel accuracy [%]", "images/s with validation")
