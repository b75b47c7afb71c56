"""Training of the encoders on small images: what an epoch sees depends on the seed and its number only."""

import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn
from tqdm import tqdm

from dsmap.dsnet.checkpoint import load_state, load_tensors, record_of, save_tensors
from dsmap.dsnet.config import ClassifierConfig
from dsmap.dsnet.datasets.cifar import ClassifiedImages
from dsmap.dsnet.networks.classifier import Classifier
from dsmap.dsnet.networks.dsnet import to_input
from dsmap.errors import InputError

CLASSIFIER_FORMAT = "dsmap.classifier.training/2"
_GREY = 127
"""Colour that a shift brings in: zero for the network (see `to_input`)."""


@dataclass(frozen=True)
class ClassifyConfig:
    """One training run of a classifier; with the data and the seed it determines the weights."""

    epochs: int = 16
    batch: int = 128
    """Images a step; the images of an epoch that fill no batch are left out."""
    lr: float = 0.2
    """Peak learning rate of SGD with Nesterov's momentum."""
    momentum: float = 0.9
    weight_decay: float = 5e-4
    """Of the convolutions and of the last layer."""
    warmup: float = 0.2
    """Share of the steps in which the rate rises linearly; then half a cosine to zero."""
    shift: int = 4
    """Largest shift of a training image [px], in both directions."""
    flip: float = 0.5
    """Probability of a left-right flip."""
    amp: bool = True
    """Convolutions in bfloat16 (weights and batch norms stay float32)."""
    seed: int = 0
    """Of initial weights, order, augmentation and dropout."""

    def __post_init__(self) -> None:
        if min(self.epochs, self.batch) < 1 or self.lr <= 0 or not 0 <= self.warmup < 1 or self.shift < 0:
            raise InputError(
                f"classifier: expected epochs, batch and lr above 0, 0 <= warmup < 1, found {self}"
            )


def train_classifier(
    net: ClassifierConfig,
    images: ClassifiedImages,
    held_back: ClassifiedImages,
    config: ClassifyConfig,
    checkpoint: Path,
    *,
    device: str = "cpu",
    progress: bool = True,
) -> dict:
    """Train an encoder with global pooling; goes on from `checkpoint` if it is there, rewritten every epoch.

    Args:
        images, held_back: to train on and to measure the accuracy with.

    Returns:
        accuracy (after the last epoch), parameters, images_per_s (trained, by the time of this process's CPU),
        cpu_seconds, seconds, history (one {epoch, loss, accuracy} an epoch; the loss is the training's).

    Raises:
        InputError: fewer images than a batch, or a checkpoint of another run.
    """
    steps = len(images) // config.batch
    if not steps or not len(held_back):
        raise InputError(
            f"classifier: {len(images)} images to train on and {len(held_back)} to measure with, "
            f"expected at least {config.batch} and 1"
        )
    torch.manual_seed(config.seed)
    model = Classifier(net).to(torch.device(device))
    model = model.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimiser = _optimiser(model, config)
    encoder = record_of(net.encoder)
    settings = {"encoder": encoder, "stem_stride": net.stem_stride, **asdict(config)}
    progressed = {
        "history": [],
        "seconds": 0.0,
        "cpu_seconds": 0.0,
        "settings": settings,
        "images": len(images),
    }
    if checkpoint.exists():
        progressed = _load(checkpoint, model, optimiser, progressed)
    history = progressed["history"]
    bar = tqdm(range(len(history), config.epochs), unit="epoch", disable=not progress, leave=False)
    for epoch in bar:
        wall, cpu = time.monotonic(), time.process_time()
        loss = _train_epoch(model, optimiser, images, config, epoch)
        progressed["seconds"] += time.monotonic() - wall
        progressed["cpu_seconds"] += time.process_time() - cpu
        hits = accuracy(model, held_back, config.amp)
        history.append({"epoch": epoch + 1, "loss": loss, "accuracy": hits})
        bar.set_postfix({"loss": f"{loss:.3f}", "accuracy": f"{hits:.3f}"})
        _save(checkpoint, model, optimiser, progressed)
    return _results(model, progressed, images_an_epoch=steps * config.batch)


def _results(model: Classifier, progressed: dict, images_an_epoch: int) -> dict:
    history, cpu_seconds = progressed["history"], progressed["cpu_seconds"]
    return {
        "accuracy": history[-1]["accuracy"],
        "parameters": sum(parameter.numel() for parameter in model.parameters()),
        "images_per_s": len(history) * images_an_epoch / max(cpu_seconds, 1e-9),
        "cpu_seconds": cpu_seconds,
        "seconds": progressed["seconds"],
        "history": history,
    }


def batches(images: ClassifiedImages, config: ClassifyConfig, epoch: int) -> Iterator[tuple[Tensor, Tensor]]:
    """The batches of an epoch: input of the network (N, 3, 32, 32) and classes, int64 (N,)."""
    rng = np.random.default_rng((config.seed, epoch))
    order = rng.permutation(len(images))
    for first in range(0, len(order) - config.batch + 1, config.batch):
        chosen = order[first : first + config.batch]
        changed = shift_and_flip(images.images[chosen], config.shift, config.flip, rng)
        yield to_input(changed), torch.from_numpy(images.labels[chosen].astype(np.int64))


def shift_and_flip(images: np.ndarray, shift: int, flip: float, rng: np.random.Generator) -> np.ndarray:
    """Every image moved by up to `shift` pixels each way, what comes in grey, and mirrored at times.

    Shapes and type as given: uint8 (N, H, W, 3).
    """
    count, height, width = images.shape[:3]
    padded = np.pad(images, ((0, 0), (shift, shift), (shift, shift), (0, 0)), constant_values=_GREY)
    down, right = rng.integers(0, 2 * shift + 1, (2, count))
    rows = down[:, None] + np.arange(height)
    columns = np.arange(width) + np.zeros((count, 1), np.int64)
    mirrored = rng.random(count) < flip
    columns[mirrored] = columns[mirrored, ::-1]
    columns += right[:, None]
    return padded[np.arange(count)[:, None, None], rows[:, :, None], columns[:, None, :]]


def classifier_rate(done: float, config: ClassifyConfig) -> float:
    """The rate when a share of all steps is done, 0 <= done < 1."""
    if done < config.warmup:
        return config.lr * (0.1 + 0.9 * done / config.warmup)
    rest = (done - config.warmup) / (1 - config.warmup)
    return config.lr * 0.5 * float(1 + np.cos(np.pi * rest))


@torch.inference_mode()
def accuracy(model: nn.Module, images: ClassifiedImages, amp: bool = False, batch: int = 500) -> float:
    """Share of images whose class is right."""
    model.eval()
    device = next(model.parameters()).device
    hits = 0
    for first in range(0, len(images), batch):
        part = slice(first, first + batch)
        with torch.autocast(device.type, torch.bfloat16, enabled=amp):
            answers = model(to_input(images.images[part]).to(device)).argmax(dim=1)
        hits += int((answers.cpu().numpy() == images.labels[part]).sum())
    return hits / len(images)


def _train_epoch(
    model: nn.Module,
    optimiser: torch.optim.Optimizer,
    images: ClassifiedImages,
    config: ClassifyConfig,
    epoch: int,
) -> float:
    """The mean loss of an epoch's steps."""
    model.train()
    device = next(model.parameters()).device
    torch.manual_seed(config.seed * 1_000_003 + epoch + 1)  # of dropout
    steps = len(images) // config.batch
    total = 0.0
    for step, (inputs, labels) in enumerate(batches(images, config, epoch)):
        for group in optimiser.param_groups:
            group["lr"] = classifier_rate((epoch * steps + step) / (config.epochs * steps), config)
        with torch.autocast(device.type, torch.bfloat16, enabled=config.amp):
            logits = model(inputs.to(device))
        loss = F.cross_entropy(logits.float(), labels.to(device))
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        total += loss.item()
    return total / steps


def _optimiser(model: nn.Module, config: ClassifyConfig) -> torch.optim.SGD:
    groups = [
        {"params": [p for p in model.parameters() if p.ndim > 1], "weight_decay": config.weight_decay},
        {"params": [p for p in model.parameters() if p.ndim <= 1], "weight_decay": 0.0},
    ]
    return torch.optim.SGD(groups, lr=config.lr, momentum=config.momentum, nesterov=config.momentum > 0)


def _save(path: Path, model: nn.Module, optimiser: torch.optim.Optimizer, progressed: dict) -> None:
    tensors = {f"model.{name}": tensor for name, tensor in model.state_dict().items()}
    for index, moments in optimiser.state_dict()["state"].items():
        if moments.get("momentum_buffer") is not None:
            tensors[f"momentum.{index}"] = moments["momentum_buffer"]
    save_tensors(path, tensors, CLASSIFIER_FORMAT, progressed)


def _load(path: Path, model: nn.Module, optimiser: torch.optim.Optimizer, expected: dict) -> dict:
    """What `_save` wrote; the header."""
    tensors, header = load_tensors(path, CLASSIFIER_FORMAT)
    for key in ("settings", "images"):
        if header.get(key) != expected[key]:
            raise InputError(
                f"{path}: {key} of this run was {header.get(key)}, expected as now {expected[key]}"
            )
    weights = {k.removeprefix("model."): v for k, v in tensors.items() if k.startswith("model.")}
    load_state(model, weights, path)
    moments = {
        int(name.removeprefix("momentum.")): {"momentum_buffer": tensor}
        for name, tensor in tensors.items()
        if name.startswith("momentum.")
    }
    groups = optimiser.state_dict()["param_groups"]
    optimiser.load_state_dict({"state": moments, "param_groups": groups})
    return header
