"""Training of DS-Net in one loop: what a step sees depends on the seed and the step only.

So a run that was killed and resumed ends with the same weights as one that was not (on one machine and
thread count), and a checkpoint needs no state of random generators.
"""

import copy
import json
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import cast

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn, update_bn
from torch.utils.data import DataLoader, Dataset
from tqdm import tqdm

from dsmap.dsnet.augment import augment
from dsmap.dsnet.checkpoint import (
    TRAINING_FORMAT,
    WeightsInfo,
    load_state,
    load_tensors,
    load_weights,
    save_tensors,
    save_weights,
)
from dsmap.dsnet.config import AugmentConfig, DSNetConfig, TrainConfig
from dsmap.dsnet.data import LabelledImages, class_weights, find_pairs
from dsmap.dsnet.measure import fit_temperature, score
from dsmap.dsnet.model import DSNet, to_input
from dsmap.dsnet.predict import DSNetSegmenter
from dsmap.errors import InputError
from dsmap.files import atomic_path

BN_IMAGES = 256
"""Training images that the batch norms of averaged weights are measured on."""


class AugmentedStream(Dataset):
    """Sample k of the whole training, k = 0 .. steps * batch - 1: the data shuffled anew every epoch."""

    def __init__(self, images: LabelledImages, augmentation: AugmentConfig, config: TrainConfig):
        self.images, self.augmentation, self.config = images, augmentation, config

    def __len__(self) -> int:
        return self.config.steps * self.config.batch

    def __getitem__(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        epoch, position = divmod(k, len(self.images))
        order = np.random.default_rng((self.config.seed, 0, epoch)).permutation(len(self.images))
        rgb, label = self.images[int(order[position])]
        rng = np.random.default_rng((self.config.seed, 1, k))
        return augment(rgb, label, self.config.size, self.augmentation, rng)


@dataclass
class State:
    """Everything that a step changes."""

    model: DSNet
    ema: AveragedModel
    optimiser: torch.optim.AdamW
    step: int = 0
    best: float = -1.0
    """Class average of the best validation so far."""
    seconds: float = 0.0
    history: list[dict] = field(default_factory=list)
    """One record a validation."""


def train(
    data: Sequence[Path],
    val: Path,
    out: Path,
    net: DSNetConfig,
    augmentation: AugmentConfig,
    config: TrainConfig,
    *,
    init: Path | None = None,
    resume: bool = False,
    device: str = "cpu",
    workers: int = 1,
    progress: bool = True,
) -> dict:
    """Train a DS-Net; `out` gets `best.safetensors` (calibrated), `checkpoint.safetensors`, `history.json`.

    Args:
        data, val: folders of labelled images (see `find_pairs`) to train on and to validate with.
        init: weights to start from (fine-tuning); their network must be `net`.
        resume: go on from the checkpoint in `out`; it must be of the same configuration and data.
        workers: processes that prepare images; 0: this one.

    Returns:
        the record of the best validation: step, class_avg, miou, pixel_acc, temperature, ...

    Raises:
        InputError: data, weights or checkpoint are missing, damaged or do not fit; `out` is in use.
    """
    images = LabelledImages([p for path in data for p in find_pairs(path)], progress=progress)
    held_back = LabelledImages(find_pairs(val), progress=progress)
    run = {
        "net": asdict(net),
        "augment": asdict(augmentation),
        "train": asdict(config),
        "images": len(images),
    }
    run = json.loads(json.dumps(run))  # tuples become lists, as they come back from a file
    torch.manual_seed(config.seed)
    state = new_state(net, config, init, device)
    checkpoint = out / "checkpoint.safetensors"
    if checkpoint.exists():
        if not resume:
            raise InputError(f"{out}: holds a training run already, expected a new folder or --resume")
        load_checkpoint(checkpoint, state, run)

    stream = AugmentedStream(images, augmentation, config)
    loader = DataLoader(
        stream,
        batch_size=config.batch,
        sampler=range(state.step * config.batch, config.steps * config.batch),
        num_workers=workers,
    )
    weights = torch.from_numpy(class_weights(images, config.balance)).to(device)
    started = time.monotonic() - state.seconds
    losses: list[float] = []
    bar = tqdm(loader, initial=state.step, total=config.steps, unit="step", disable=not progress)
    for batch in bar:
        losses.append(train_step(state, batch, weights, config, device))
        bar.set_postfix({"loss": f"{losses[-1]:.3f}", "best class_avg": f"{max(state.best, 0):.3f}"})
        if state.step % config.validate_every == 0 or state.step == config.steps:
            state.seconds = time.monotonic() - started
            model = averaged_model(state, stream)
            validate(state, model, held_back, out, config, float(np.mean(losses)))
            save_checkpoint(checkpoint, state, run)
            losses.clear()
    return finish(out, held_back, run)


def new_state(net: DSNetConfig, config: TrainConfig, init: Path | None, device: str) -> State:
    """Fresh weights (or those of `init`), optimiser and average."""
    model = DSNet(net)
    if init is not None:
        given, info = load_weights(init)
        if info.config != net:
            raise InputError(f"{init}: network is {info.config}, expected {net}")
        model.load_state_dict(given.state_dict())
    model = model.to(torch.device(device)).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    ema = AveragedModel(model, multi_avg_fn=get_ema_multi_avg_fn(config.ema))
    matrices = [p for p in model.parameters() if p.ndim > 1]
    vectors = [p for p in model.parameters() if p.ndim <= 1]
    groups = [{"params": matrices}, {"params": vectors, "weight_decay": 0.0}]
    return State(model, ema, torch.optim.AdamW(groups, lr=config.lr, weight_decay=config.weight_decay))


def learning_rate(step: int, config: TrainConfig) -> float:
    """Linear warm-up, then half a cosine to zero at the last step."""
    if step < config.warmup:
        return config.lr * (step + 1) / config.warmup
    done = (step - config.warmup) / max(config.steps - config.warmup, 1)
    return config.lr * 0.5 * (1 + math.cos(math.pi * done))


def train_step(state: State, batch: list[Tensor], weights: Tensor, config: TrainConfig, device: str) -> float:
    """One optimiser step on images, uint8 (N, H, W, 3), and labels, uint8 (N, H / 2, W / 2); the loss."""
    torch.manual_seed(config.seed * 1_000_003 + state.step)  # of dropout
    for group in state.optimiser.param_groups:
        group["lr"] = learning_rate(state.step, config)
    images, labels = (tensor.to(device) for tensor in batch)
    labels = labels.long()
    state.model.train()
    logits = state.model(to_input(images))
    # Class-weighted mean; void weighs 0. The clamp keeps a batch without any label finite.
    loss = F.cross_entropy(logits, labels, weight=weights, reduction="sum")
    loss = loss / weights[labels].sum().clamp(min=1.0)
    state.optimiser.zero_grad(set_to_none=True)
    loss.backward()
    state.optimiser.step()
    state.ema.update_parameters(state.model)
    state.step += 1
    return loss.item()


def averaged_model(state: State, stream: AugmentedStream) -> DSNet:
    """The averaged weights, in eval mode, with batch norms measured anew for them.

    An average of the statistics of past steps fits no weights: while the rate is high, it costs half the
    class average. The first samples of the stream serve at every validation.
    """
    model = cast(DSNet, copy.deepcopy(state.ema.module))
    device = next(model.parameters()).device
    count = min(BN_IMAGES, len(stream))
    batches = [range(k, min(k + stream.config.batch, count)) for k in range(0, count, stream.config.batch)]
    torch.manual_seed(stream.config.seed)  # of dropout
    with torch.no_grad():
        update_bn((to_input(np.stack([stream[k][0] for k in batch])).to(device) for batch in batches), model)
    return model.eval()


def validate(
    state: State, model: DSNet, data: LabelledImages, out: Path, config: TrainConfig, loss: float
) -> None:
    """Score the averaged weights, keep them if they are the best so far, and note the figures."""
    info = WeightsInfo(model.config, size=config.size)
    scores = score(DSNetSegmenter(copy.deepcopy(model), info, str(next(model.parameters()).device)), data)
    record = {"step": state.step, "loss": loss, "seconds": round(state.seconds, 1), **scores}
    state.history.append(record)
    if scores["class_avg"] > state.best:
        state.best = scores["class_avg"]
        info.notes = {"validation": record}
        save_weights(out / "best.safetensors", model, info)
    with atomic_path(out / "history.json") as temporary:
        temporary.write_text(json.dumps(state.history, indent=1))


def finish(out: Path, data: LabelledImages, run: dict) -> dict:
    """Calibrate the best weights and write them back with what they are made of."""
    path = out / "best.safetensors"
    model, info = load_weights(path)
    info.temperature = 1.0
    segmenter = DSNetSegmenter(copy.deepcopy(model), info)  # folded: a copy
    info.temperature = fit_temperature(segmenter, data)
    scores = score(segmenter, data, calibration=True)
    info.notes = {**run, "validation": {**info.notes["validation"], **scores}}
    save_weights(path, model, info)
    return {**info.notes["validation"], "temperature": info.temperature}


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
        if header["run"][part] != expected:
            found, now = _difference(header["run"][part], expected)
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
