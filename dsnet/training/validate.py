"""Validation of a training: averaged weights with fresh statistics, scored, kept if they are the best, calibrated."""

import copy
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import update_bn

from dsmap.dsnet.checkpoint import WeightsInfo, load_weights, save_weights
from dsmap.dsnet.config import NetConfig
from dsmap.dsnet.data import LabelledImages, drawn_shares
from dsmap.dsnet.inference.predict import DSNetSegmenter
from dsmap.dsnet.networks.dsnet import to_input
from dsmap.dsnet.scoring.measure import fit_temperature, score
from dsmap.dsnet.training.log import Log
from dsmap.dsnet.training.model_card import model_card
from dsmap.dsnet.training.sample_stream import AugmentedStream
from dsmap.dsnet.training.state import State
from dsmap.files import atomic_path, write_json, written_or_warned

_BN_IMAGES = 256
"""Training images that the batch norms of averaged weights are measured on."""

_GOES_ON = "training goes on"


def averaged_model(state: State, stream: AugmentedStream) -> nn.Module:
    """The averaged weights, in eval mode, with batch norms measured anew for them.

    An average of the statistics of past steps fits no weights: while the rate is high, it costs half the
    class average. The first samples of the stream serve at every validation.
    """
    model = copy.deepcopy(state.ema.module)
    measure_batch_norms(model, stream, _BN_IMAGES)
    return model.eval()


def measure_batch_norms(model: nn.Module, stream: AugmentedStream, count: int) -> None:
    """Mean and variance of every batch norm over the first `count` samples of a stream."""
    device = next(model.parameters()).device
    count = min(count, len(stream))
    batches = [range(k, min(k + stream.config.batch, count)) for k in range(0, count, stream.config.batch)]
    torch.manual_seed(stream.config.seed)  # of dropout
    with torch.no_grad():
        samples = (zip(*[stream[k] for k in batch], strict=True) for batch in batches)
        stacked = ([np.stack(part) for part in sample] for sample in samples)
        reads_geometry = model.config.channels > 3  # type: ignore[union-attr]
        update_bn((to_input(rgb, *more[:reads_geometry]).to(device) for rgb, _, *more in stacked), model)


def weights_info(net: NetConfig, stream: AugmentedStream, weights: Tensor) -> WeightsInfo:
    """What the weights of this training will say of themselves: size, classes and their prior."""
    config, images = stream.config, stream.images
    shares = drawn_shares(images, config.shares)
    return WeightsInfo(
        net,
        config.working_size or config.size,
        class_names=images.class_names,
        prior=config.prior,
        shares=tuple(map(float, shares)),
        balance=tuple(map(float, weights.cpu())),
    )


def validate(
    state: State,
    model: nn.Module,
    info: WeightsInfo,
    data: LabelledImages,
    out: Path,
    loss: float,
    events: Log,
) -> None:
    """Score the averaged weights, keep them if they are the best so far, and note the figures."""
    segmenter = DSNetSegmenter(copy.deepcopy(model), info, str(next(model.parameters()).device))
    scores = score(segmenter, data)
    record = {"step": state.step, "loss": loss, "seconds": round(state.seconds, 1), **scores}
    state.history.append(record)
    events.validation(record, segmenter, data)
    if scores["miou"] > state.best:
        info.notes = {"validation": record}
        what = f"weights of step {state.step}"
        if written_or_warned(what, _GOES_ON, save_weights, out / "best.safetensors", model, info):
            state.best = scores["miou"]
    written_or_warned("history.json", _GOES_ON, write_json, out / "history.json", state.history)


def finish(
    out: Path, data: LabelledImages, run: dict, device: str, calibrate: Sequence[LabelledImages] = ()
) -> dict:
    """Calibrate the best weights and write them back with what they are made of.

    Args:
        calibrate: more sets that the temperature shall fit (see `fit_temperature`).
    """
    path = out / "best.safetensors"
    model, info = load_weights(path, data.class_names)
    info.temperature = 1.0
    segmenter = DSNetSegmenter(copy.deepcopy(model), info, device)  # folded: a copy
    info.temperature = fit_temperature(segmenter, data, *calibrate)
    scores = score(segmenter, data, calibration=True)
    info.notes = {
        **run,
        "validation": {**info.notes["validation"], **scores},
        "priors": prior_ends(segmenter, data, scores),
    }
    save_weights(path, model, info)
    with atomic_path(out / "model-card.md") as temporary:
        temporary.write_text(model_card(info, out.name))
    return {**info.notes["validation"], "temperature": info.temperature}


def prior_ends(segmenter: DSNetSegmenter, data: LabelledImages, at_default: dict) -> dict[str, dict]:
    """Scores at both ends of the class prior and at the default, by prior; {} where shares are not known.

    Args:
        at_default: the scores at the default, which are there already.
    """
    info, default = segmenter.info, segmenter.info.prior
    found = {}
    for prior in (0.0, default, 1.0) if info.shares else ():
        info.prior = prior
        scores = at_default if prior == default else score(segmenter, data, calibration=True)
        found[f"{prior:g}"] = {name: scores[name] for name in ("class_avg", "pixel_acc", "miou", "ece")}
    info.prior = default
    return found
