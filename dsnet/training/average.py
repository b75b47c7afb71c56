"""The weights of several trainings averaged into one network (model soup, Wortsman et al. 2022).

Fine-tunings of one network end in the same valley of the loss, and between them lies a better place than either end:
the average answers nearly as their ensemble does and costs no more than one.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from dsmap.dsnet.checkpoint import load_weights, save_weights
from dsmap.dsnet.config import AugmentConfig, TrainConfig
from dsmap.dsnet.data import LabelledImages
from dsmap.dsnet.datasets.registry import open_set
from dsmap.dsnet.training.sample_stream import AugmentedStream
from dsmap.dsnet.training.train import earlier_stages, read_data
from dsmap.dsnet.training.validate import finish, measure_batch_norms
from dsmap.errors import InputError
from dsmap.folders import locked, remove_leftovers

_BN_IMAGES = 704
"""Whole training images that the batch norms of the average are measured on."""
_WHOLE = AugmentConfig(
    scale=(1.0, 1.0),
    aspect=0,
    rotate=0,
    brightness=0,
    contrast=0,
    gamma=0,
    white_balance=0,
    saturation=0,
    hue=0,
    blur=0,
    noise=0,
    holes=0,
    geometry_noise=0,
)
"""Images as inference sees them, some turned round, some without geometry."""


def average(
    files: Sequence[Path],
    data: Sequence[Path],
    val: Path,
    out: Path,
    config: TrainConfig,
    *,
    calibrate: Sequence[Path] = (),
    device: str = "cpu",
    progress: bool = True,
    notes: dict | None = None,
    label_map: str | None = None,
) -> dict:
    """Average weights, measure batch norms anew, calibrate; `out` gets `best.safetensors` and `model-card.md`.

    Args:
        files: weights of one network, each trained from the same beginning; the last says what they are made of.
        data, val, calibrate, label_map: as in `train`.
        config: of the last training: shares, working size, batch and seed.
        notes: what else the header shall say.

    Returns:
        the record of the validation, as `train` does.

    Raises:
        InputError: files that are missing, damaged, or of networks that differ; `out` is in use.
    """
    with locked(out, "averaging"):
        remove_leftovers(out)
        model, info = load_weights(files[-1], class_names=None)
        model.load_state_dict(mean_of(files))
        images, held_back = read_data(data, val, info.config.channels > 3, progress, label_map)
        size = config.working_size or config.size
        whole = replace(config, size=size, steps=max(1, _BN_IMAGES // config.batch))
        stream = AugmentedStream(images, _WHOLE, whole, info.config.channels > 3)
        measure_batch_norms(model.to(torch.device(device)), stream, _BN_IMAGES)
        stages = earlier_stages(files[-1])
        info.notes = {
            "validation": {"step": sum(stage["train"]["steps"] for stage in stages if "train" in stage)}
        }
        save_weights(out / "best.safetensors", model.eval(), info)
        more = [
            LabelledImages(
                open_set(path, label_map), with_geometry=info.config.channels > 3, progress=progress
            )
            for path in calibrate
        ]
        about = {
            "images": len(images),
            "data": [*map(str, data)],
            "val": str(val),
            "stages": stages,
            **(notes or {}),
        }
        return finish(out, held_back, about, device, more)


def mean_of(files: Sequence[Path]) -> dict[str, Tensor]:
    """Mean of each tensor over weights files, in the numbers' own precision.

    Raises:
        InputError: networks that differ.
    """
    first, info = load_weights(files[0], class_names=None)
    total = {name: tensor.double() for name, tensor in first.state_dict().items()}
    for path in files[1:]:
        model, other = load_weights(path, class_names=None)
        if other.config != info.config or other.class_names != info.class_names:
            raise InputError(f"{path}: found a {other.config}, expected that of {files[0]}: {info.config}")
        for name, tensor in model.state_dict().items():
            total[name] += tensor.double()
    return {name: (total[name] / len(files)).to(tensor.dtype) for name, tensor in first.state_dict().items()}
