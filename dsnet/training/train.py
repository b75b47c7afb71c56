"""Training in one loop: what a step sees depends on the seed and the step only.

So a run that was killed and resumed ends with the same weights as one that was not (on one machine and
thread count), and a checkpoint needs no state of random generators.
"""

import contextlib
import math
import os
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.utils.data import DataLoader
from tqdm import tqdm

from dsmap.dsnet.checkpoint import load_weights, record_of
from dsmap.dsnet.config import AugmentConfig, NetConfig, TrainConfig
from dsmap.dsnet.data import LabelledImages, class_weights, drawn_shares
from dsmap.dsnet.datasets.registry import open_set, open_sets
from dsmap.dsnet.networks.dsnet import to_input
from dsmap.dsnet.training.distil import Teacher, soft_loss
from dsmap.dsnet.training.log import Log
from dsmap.dsnet.training.memory import keep_memory
from dsmap.dsnet.training.processes import Ranks, joined
from dsmap.dsnet.training.sample_stream import AugmentedStream
from dsmap.dsnet.training.state import State, load_checkpoint, new_state, save_checkpoint
from dsmap.dsnet.training.validate import averaged_model, finish, validate, weights_info
from dsmap.errors import InputError
from dsmap.files import as_read_back, written_or_warned
from dsmap.folders import locked, remove_leftovers


def train(
    data: Sequence[Path],
    val: Path,
    out: Path,
    net: NetConfig,
    augmentation: AugmentConfig,
    config: TrainConfig,
    *,
    init: Path | None = None,
    teacher: Path | str | None = None,
    resume: bool = False,
    device: str = "cpu",
    workers: int = 1,
    progress: bool = True,
    log: bool = False,
    notes: dict | None = None,
    label_map: str | None = None,
    calibrate: Sequence[Path] = (),
) -> dict:
    """Train a network; `out` gets `best.safetensors` (calibrated), `model-card.md`, `checkpoint.safetensors`,
    `history.json`. Under torchrun, every process takes its share of each batch (see `ranks`).

    Args:
        data, val: data sets (see `open_set`) to train on and to validate with, of the same classes.
        net: the network; its classes become those of the data.
        init: weights to start from (fine-tuning), of the same network but for classes and depth.
        teacher: weights whose answers are learnt beside the labels (see `distil`).
        resume: go on from the checkpoint in `out`; it must be of the same configuration and data.
        workers: processes that prepare images; 0: this one.
        log: write TensorBoard events to `out`/log, if the library is there.
        notes: what else the weights' header shall say (command, licence).
        label_map: how the label images of both are read (see `open_set`).
        calibrate: more labelled data sets that the temperature shall fit beside `val`.

    Returns:
        the record of the best validation: step, class_avg, miou, pixel_acc, temperature, ...

    Raises:
        InputError: data, weights or checkpoint are missing, damaged or do not fit; `out` is in use.
    """
    keep_memory()
    with joined(device) as ranks, contextlib.ExitStack() as held:
        if ranks.first:
            held.enter_context(locked(out, "training"))
            remove_leftovers(out)
        with_geometry = net.channels > 3 or teacher is not None
        images, held_back = read_data(data, val, with_geometry, progress and ranks.first, label_map)
        net = replace(net, classes=len(images.class_names))
        run = run_record(net, augmentation, config, images, teacher)
        state = begin_training(out, net, config, run, init, resume, ranks)
        stream = AugmentedStream(images, augmentation, config, with_geometry)
        weights = class_weights(images, config.balance, config.shares, config.balance_power)
        master = _teacher(teacher, images, drawn_shares(images, config.shares) * weights, ranks)
        loop(state, stream, held_back, weights, TrainingJob(out, run, ranks, workers, progress, log, master))
        if not ranks.first:
            return ranks.of_first(None)
        about = {"data": [str(path) for path in data], "val": str(val), "stages": earlier_stages(init)}
        about |= pace(state, config, ranks)
        more = [_labelled(path, label_map, with_geometry, progress) for path in calibrate]
        return ranks.of_first(finish(out, held_back, {**run, **about, **(notes or {})}, ranks.device, more))


@dataclass(frozen=True)
class TrainingJob:
    """Where a training goes on, and with how much ado: what does not change its result."""

    out: Path
    record: dict
    """Of `run_record`, kept in the checkpoint."""
    ranks: Ranks
    workers: int
    progress: bool
    log: bool
    teacher: Teacher | None = None


def _labelled(path: Path, label_map: str | None, with_geometry: bool, progress: bool) -> LabelledImages:
    return LabelledImages(open_set(path, label_map), with_geometry=with_geometry, progress=progress)


def _teacher(
    weights: Path | str | None, images: LabelledImages, trained: np.ndarray, ranks: Ranks
) -> Teacher | None:
    """The network whose answers are learnt, if any; `trained` is what each class weighs in training."""
    return None if weights is None else Teacher(weights, images.class_names, trained, ranks.device)


def run_record(
    net: NetConfig,
    augmentation: AugmentConfig,
    config: TrainConfig,
    images: LabelledImages,
    teacher: Path | str | None = None,
) -> dict:
    """What must be the same for a run to go on, in its JSON form."""
    run = {
        "net": record_of(net),
        "augment": asdict(augmentation),
        "train": asdict(config),
        "images": len(images),
    }
    if teacher is not None:
        run["teacher"] = str(teacher)
    return as_read_back(run)


def begin_training(
    out: Path, net: NetConfig, config: TrainConfig, run: dict, init: Path | None, resume: bool, ranks: Ranks
) -> State:
    """A new state, or that of the checkpoint in `out`."""
    torch.manual_seed(config.seed)
    checkpoint = out / "checkpoint.safetensors"
    begun = checkpoint.exists()  # it holds the encoder as well: ImageNet's weights are not asked for again
    state = new_state(net, replace(config, imagenet=config.imagenet and not begun), init, ranks.device)
    if begun:
        if not resume:
            raise InputError(f"{out}: holds a training run already, expected a new folder or --resume")
        load_checkpoint(checkpoint, state, run)
    state.model = ranks.synchronised(state.model)
    return state


def loop(
    state: State, stream: AugmentedStream, held_back: LabelledImages, balance: np.ndarray, job: TrainingJob
) -> None:
    """All steps that are left, with validations and checkpoints by rank 0.

    Args:
        balance: weight of each class in the loss, shape (classes,).
    """
    config, ranks = stream.config, job.ranks
    loader = DataLoader(
        stream,
        batch_size=config.batch // ranks.world,
        sampler=ranks.samples(state.step, config.steps, config.batch),
        num_workers=job.workers,
        worker_init_fn=_in_a_worker,
    )
    weights = torch.from_numpy(balance).to(ranks.device)
    parallel = ranks.parallel(state.model)
    events = Log(job.out / "log", state.step, job.log and ranks.first)
    started = time.monotonic() - state.seconds
    losses: list[float] = []
    shown = job.progress and ranks.first
    bar = tqdm(loader, initial=state.step, total=config.steps, unit="step", disable=not shown)
    for batch in bar:
        losses.append(train_step(state, batch, weights, config, ranks, parallel, job.teacher))
        events.step(state.step, losses[-1], learning_rate(state.step - 1, config))
        bar.set_postfix({"loss": f"{losses[-1]:.3f}", "best mIoU": f"{max(state.best, 0):.3f}"})
        if state.step % config.validate_every == 0 or state.step == config.steps:
            state.seconds = time.monotonic() - started
            if ranks.first:
                model, loss = averaged_model(state, stream), float(np.mean(losses))
                info = weights_info(model.config, stream, weights)  # type: ignore[arg-type]
                validate(state, model, info, held_back, job.out, loss, events)
                what, path = f"checkpoint after step {state.step}", job.out / "checkpoint.safetensors"
                written_or_warned(what, "training goes on", save_checkpoint, path, state, job.record)
            losses.clear()
    events.close()


def _in_a_worker(_: int) -> None:
    """A forked process has none of the threads that kernels were cut for."""
    os.environ["DSMAP_THREADS"] = "1"
    torch.set_num_threads(1)


def earlier_stages(init: Path | None) -> list[dict]:
    """What the weights that training starts from were made of, stage by stage."""
    if init is None:
        return []
    _, info = load_weights(init, class_names=None)
    return [*info.notes.get("stages", []), {k: v for k, v in info.notes.items() if k != "stages"}]


def read_data(
    data: Sequence[Path], val: Path, with_geometry: bool, progress: bool, label_map: str | None = None
) -> tuple[LabelledImages, LabelledImages]:
    """The images to train on and to validate with, all of them read once.

    Raises:
        InputError: damaged or missing data, other classes in one than in the other.
    """
    parts = open_sets(data, label_map), open_set(val, label_map)
    if parts[0].class_names != parts[1].class_names:
        raise InputError(f"{val}: its classes are not those of {data[0]}, expected the same classes")
    images, held_back = (
        LabelledImages(part, with_geometry=with_geometry, progress=progress) for part in parts
    )
    return images, held_back


def pace(state: State, config: TrainConfig, ranks: Ranks) -> dict:
    """How long the training took, and on what."""
    return {
        "seconds": round(state.seconds, 1),
        "device": str(ranks.device),
        "processes": ranks.world,
        "images_per_second": round(state.step * config.batch / max(state.seconds, 1e-9), 2),
    }


def learning_rate(step: int, config: TrainConfig) -> float:
    """Linear warm-up, then half a cosine to zero at the last step."""
    if step < config.warmup:
        return config.lr * (step + 1) / config.warmup
    done = (step - config.warmup) / max(config.steps - config.warmup, 1)
    return config.lr * 0.5 * (1 + math.cos(math.pi * done))


def train_step(
    state: State,
    batch: list[Tensor],
    weights: Tensor,
    config: TrainConfig,
    ranks: Ranks,
    parallel: nn.Module | None = None,
    teacher: Teacher | None = None,
) -> float:
    """One optimiser step on a batch of the stream, or on this rank's share of it; the loss of the whole batch.

    Args:
        batch: images, uint8 (N, H, W, 3), labels, uint8 (N, H / 2, W / 2) [, geometry (N, H, W, 4)].
        weights: of the classes in the loss, shape (classes,).
        parallel: the model that averages gradients over the ranks; None: there is one rank.
        teacher: whose probabilities take `config.distil` of the loss.
    """
    torch.manual_seed(config.seed * 1_000_003 + state.step + 7919 * ranks.rank)  # of dropout
    for group in state.optimiser.param_groups:
        group["lr"] = learning_rate(state.step, config) * group["scale"]
    images, labels, *geometry = (tensor.to(ranks.device) for tensor in batch)
    labels = labels.long()
    state.model.train()
    with torch.autocast(torch.device(ranks.device).type, torch.bfloat16, enabled=config.precision == "bf16"):
        reads_geometry = state.model.config.channels > 3  # type: ignore[union-attr]
        logits = (parallel or state.model)(to_input(images, *geometry[:reads_geometry])).float()
    # Class-weighted mean over all ranks; void weighs 0. The clamp keeps a batch without any label finite.
    total = weighted_cross_entropy(logits, labels, weights, config.smoothing)
    loss = total / ranks.total(weights[labels].sum()).clamp(min=1.0)
    if teacher is not None:
        soft = soft_loss(logits, teacher(images, *geometry))
        loss = (1 - config.distil) * loss + config.distil * soft / ranks.world
    state.optimiser.zero_grad(set_to_none=True)
    (loss * ranks.world).backward()  # gradients are averaged over the ranks
    state.optimiser.step()
    state.ema.update_parameters(state.model)
    state.step += 1
    return ranks.total(loss).item()


def weighted_cross_entropy(logits: Tensor, labels: Tensor, weights: Tensor, smoothing: float) -> Tensor:
    """Sum over all pixels; `smoothing` is spread over the classes that have a weight, in each pixel with its weight."""
    total = F.cross_entropy(logits, labels, weight=weights, reduction="sum")
    if not smoothing:
        return total
    seen = weights > 0
    spread = -F.log_softmax(logits, dim=1)[:, seen].mean(dim=1)
    return (1 - smoothing) * total + smoothing * (weights[labels] * spread).sum()
