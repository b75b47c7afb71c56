"""What a training step changes, how it begins, and how it is put away for a later day."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from dsmap.dsnet.checkpoint import TRAINING_FORMAT, load_state, load_tensors, load_weights, save_tensors
from dsmap.dsnet.config import AugmentConfig, DSNetConfig, DSNetPConfig, NetConfig, TrainConfig
from dsmap.dsnet.networks.build import build_network
from dsmap.dsnet.networks.dsnet_p import DSNetP
from dsmap.dsnet.networks.efficientnet_lite import EfficientNetLite
from dsmap.dsnet.networks.imagenet import load_imagenet
from dsmap.errors import InputError

_DEFAULTS = {"net": DSNetConfig, "augment": AugmentConfig, "train": TrainConfig}


@dataclass
class State:
    """Everything that a step changes."""

    model: nn.Module
    ema: AveragedModel
    optimiser: torch.optim.AdamW
    step: int = 0
    best: float = -1.0
    """mIoU of the best validation so far."""
    seconds: float = 0.0
    history: list[dict] = field(default_factory=list)
    """One record a validation."""


def new_state(net: NetConfig, config: TrainConfig, init: Path | None, device: str) -> State:
    """Fresh weights (or those of `init`), optimiser and average.

    Raises:
        InputError: `init` is no weights file, or of another network.
    """
    model = build_network(net)
    given = set() if init is None else start_from(model, init)
    if isinstance(model, DSNetP):
        prepare_encoder(model.encoder, net, config, init is None)
    model = model.to(torch.device(device)).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    ema = AveragedModel(model, multi_avg_fn=get_ema_multi_avg_fn(config.ema))
    groups: dict[tuple[float, bool], list[nn.Parameter]] = {}
    for name, parameter in model.named_parameters():
        scale = config.init_lr if name in given else 1.0
        if isinstance(model, DSNetP) and name.startswith("encoder."):
            scale *= config.encoder_lr
        if parameter.requires_grad:
            groups.setdefault((scale, parameter.ndim > 1), []).append(parameter)
    # Vectors (of batch norms) are not decayed. Matrices first: the order of earlier checkpoints.
    options = [
        {"params": groups[key], "scale": key[0], "weight_decay": config.weight_decay if key[1] else 0.0}
        for key in sorted(groups, key=lambda key: (-key[0], not key[1]))
    ]
    return State(model, ema, torch.optim.AdamW(options, lr=config.lr))


def prepare_encoder(encoder: EfficientNetLite, net: NetConfig, config: TrainConfig, fresh: bool) -> None:
    """ImageNet's weights into a new encoder; its first levels are put beyond the reach of the optimiser.

    Raises:
        InputError: the package with the weights is not installed.
    """
    assert isinstance(net, DSNetPConfig)
    if fresh and config.imagenet:
        load_imagenet(encoder, net.encoder)
    if config.freeze:
        encoder.stem.requires_grad_(False)
        for level in encoder.levels[: config.freeze]:
            level.requires_grad_(False)


def start_from(model: nn.Module, path: Path) -> set[str]:
    """Copy the weights of a file into a network that may differ from it in classes and in geometry.

    A last layer of other classes stays as it is; the weights of added geometry channels become 0.

    Returns:
        the names of the parameters that have been copied.

    Raises:
        InputError: the file is no weights file, or its network is another one.
    """
    given, info = load_weights(path, class_names=None)
    wanted: NetConfig = model.config  # type: ignore[assignment]
    found = replace(info.config, classes=wanted.classes, channels=wanted.channels)
    if isinstance(found, DSNetConfig | DSNetPConfig) and isinstance(wanted, type(found)):
        found = replace(found, dropout=wanted.dropout)  # has no weights
    if found != wanted or info.config.channels > wanted.channels:
        raise InputError(f"{path}: network is {info.config}, expected {wanted}")
    source, target = given.state_dict(), model.state_dict()
    copied = set()
    for name, tensor in source.items():
        into = target[name]
        if tensor.shape == into.shape:
            into.copy_(tensor)
        elif tensor.ndim == 4 and tensor.shape[1] == 3 and into.shape[1] > 3 and len(tensor) == len(into):
            into.zero_()[:, :3] = tensor
        else:
            continue
        copied.add(name)
    return copied


def save_checkpoint(path: Path, state: State, run: dict) -> None:
    """Everything that `load_checkpoint` needs to go on."""
    tensors = {f"model.{k}": v for k, v in state.model.state_dict().items()}
    tensors |= {f"ema.{k}": v for k, v in state.ema.state_dict().items()}
    for index, moments in state.optimiser.state_dict()["state"].items():
        tensors |= {f"optimiser.{index}.{k}": v for k, v in moments.items()}
    header = {"step": state.step, "best": state.best, "seconds": state.seconds, "history": state.history}
    save_tensors(path, tensors, TRAINING_FORMAT, {**header, "run": run})


def load_checkpoint(path: Path, state: State, run: dict) -> None:
    """Continue from a checkpoint of the same run.

    Raises:
        InputError: the file is damaged or belongs to another configuration.
    """
    tensors, header = load_tensors(path, TRAINING_FORMAT)
    for part, expected in run.items():
        if part not in header["run"]:  # newer than the file
            continue
        stored = header["run"][part]
        if part in _DEFAULTS and isinstance(stored, dict):  # settings that are newer than the file
            fields = _DEFAULTS[part].__dataclass_fields__
            stored = {k: fields[k].default for k in expected if k in fields} | stored
        if stored != expected:
            found, now = _difference(stored, expected)
            raise InputError(f"{path}: {part} of this run was {found}, expected as now {now}")
    parts: dict[str, dict[str, Tensor]] = {"model": {}, "ema": {}, "optimiser": {}}
    for name, tensor in tensors.items():
        part, _, rest = name.partition(".")
        parts[part][rest] = tensor
    load_state(state.model, parts["model"], path)
    load_state(state.ema, parts["ema"], path)
    moments: dict[int, dict[str, Tensor]] = {}
    for name, tensor in parts["optimiser"].items():
        index, _, key = name.partition(".")
        moments.setdefault(int(index), {})[key] = tensor
    groups = state.optimiser.state_dict()["param_groups"]
    state.optimiser.load_state_dict({"state": moments, "param_groups": groups})
    state.step, state.best, state.seconds = header["step"], header["best"], header["seconds"]
    state.history = header["history"]


def _difference(a: object, b: object) -> tuple[object, object]:
    """What differs between two settings, for an error message."""
    if not (isinstance(a, dict) and isinstance(b, dict)):
        return a, b
    keys = [key for key in a | b if a.get(key) != b.get(key)]
    return {key: a.get(key) for key in keys}, {key: b.get(key) for key in keys}
