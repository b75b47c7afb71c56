"""Ways to run one network on the CPU, timed turn by turn and compared with plain torch."""

import copy
import logging
import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any
from unittest import mock

import cv2
import numpy as np
import torch
from torch import nn

from dsmap.dsnet.checkpoint import WeightsInfo
from dsmap.dsnet.inference.engines import onnx_session
from dsmap.dsnet.inference.onnx_export import Unpool, build_onnx
from dsmap.dsnet.networks.dsnet import DSNet, fold_batch_norms, to_input

Sample = tuple[np.ndarray, ...]
"""An image, uint8 (1, H, W, 3), and for RGB-D networks its geometry, float32 (1, H, W, 4)."""
Runner = Callable[[Sample], np.ndarray]
"""A sample to probabilities, float32 (H / 2, W / 2, classes)."""
RIVAL = "dsnet, ONNX Runtime"
"""The paper's network beside another one, as fast as it goes; its answers are not compared."""
REFERENCE = "torch channels_last fp32"
TOLERANCE = 1e-2
"""Largest difference in probability that a contender may show."""
MEMORY_KEPT = ", memory kept"
"""End of a contender's name: glibc may not return freed memory to the system, which spares torch page faults."""
_KEEP = {"GLIBC_TUNABLES": "glibc.malloc.mmap_threshold=1000000000:glibc.malloc.trim_threshold=1000000000"}
_NOISE = 2e-6
"""Relative to pixels of spread 1: what fp32 rounding amounts to after a few layers."""
_DRAWS = 8
_HALO_PX = 3
_BLOCKED = "ONNX Runtime, blocked masks"


@dataclass
class Result:
    """One contender. Differences are the largest over pixels and classes against the reference."""

    name: str
    compared: bool = True
    """Whether its answers are held against the reference's."""
    error: str = ""
    """Why it could not be run; empty if it was."""
    milliseconds: list[float] = field(default_factory=list)
    """Median of each round."""
    difference: float = 0.0
    """Over all pixels."""
    decided: float = 0.0
    """Over the pixels whose answer does not hang on rounding (see `undecided`)."""
    beyond: float = 0.0
    """Share of all pixels that differ by more than TOLERANCE."""
    chance: float = 0.0
    """Share of pixels that were left out of `decided`."""

    @property
    def median(self) -> float:
        return float(np.median(self.milliseconds)) if self.milliseconds else float("nan")

    @property
    def equal(self) -> bool:
        return self.compared and not self.error and self.decided <= TOLERANCE


def race(
    model: nn.Module,
    info: WeightsInfo,
    samples: Sequence[Sample],
    *,
    rounds: int,
    repeats: int,
    names: Sequence[str] | None = None,
    rival: tuple[nn.Module, WeightsInfo] | None = None,
) -> list[Result]:
    """Time every contender on a batch of one: in each round everyone has its turn of `repeats` calls.

    Each lives in a process of its own: neither its threads nor the memory that it leaves to the allocator
    make another one slower or faster. A call takes pixels and gives probabilities, so conversion and softmax
    count. The first result is the reference.

    Args:
        model: in eval mode; not changed.
        samples: of the size to time.
        names: of `contenders`, the reference first; None: all.
        rival: a DS-Net that is timed beside them, as `RIVAL`.
    """
    results = [Result(name) for name in names or contenders(model, info, samples)]
    if rival is not None:
        results.append(Result(RIVAL, compared=False))
    links: dict[str, Connection] = {}
    answers: dict[str, list[np.ndarray]] = {}
    context = multiprocessing.get_context("spawn")
    for result in results:
        ours, theirs = context.Pipe()
        net = (model, info) if result.compared or rival is None else rival
        seen = samples if net[1].config.channels > 3 else [sample[:1] for sample in samples]
        name = result.name if result.compared else _BLOCKED
        arguments = (theirs, name, *net, seen, torch.get_num_threads())
        with mock.patch.dict(os.environ, _KEEP if result.name.endswith(MEMORY_KEPT) else {}):
            context.Process(target=_serve, args=arguments, daemon=True).start()
        theirs.close()  # so that a process that dies is noticed
        try:
            result.error = ours.recv()
            if not result.error:
                answers[result.name] = [ours.recv() for _ in samples]
        except EOFError:
            result.error = "its process died"
        if not result.error:
            links[result.name] = ours
    _compare(model, info, samples, answers, results)
    for _ in range(rounds):
        for result in results:
            if result.name in links:
                links[result.name].send(repeats)
                result.milliseconds.append(links[result.name].recv())
    for link in links.values():
        link.send(0)
    return results


def _serve(
    link: Connection,
    name: str,
    model: nn.Module,
    info: WeightsInfo,
    samples: Sequence[Sample],
    threads: int,
) -> None:
    """A contender's process: its answers first, then milliseconds for every number of calls, until 0."""
    torch.set_num_threads(threads)
    logging.disable(logging.WARNING)  # ONNX Runtime's advice on quantisation
    try:
        run = contenders(model, info, samples)[name]()
        run(samples[0])
    except Exception as error:  # a missing package, compiler or instruction set: the others go on
        link.send(" ".join(str(error).split())[:160] or type(error).__name__)
        return
    link.send("")
    for sample in samples:  # one by one: blocks of many megabytes, once freed, teach glibc to keep memory
        link.send(run(sample))
    while repeats := link.recv():
        link.send(_time(run, samples[0], repeats))


def contenders(
    model: nn.Module, info: WeightsInfo, samples: Sequence[Sample]
) -> dict[str, Callable[[], Runner]]:
    """Name to what builds it; building may fail where a package is missing."""
    height, width = samples[0][0].shape[1:3]
    last = torch.channels_last

    def plain() -> nn.Module:
        return copy.deepcopy(model)

    def folded() -> nn.Module:
        return fold_batch_norms(plain()).to(memory_format=last)  # type: ignore[call-overload]

    def graph(unpool: Unpool) -> bytes:
        return build_onnx(model, info, (width, height), unpool=unpool).SerializeToString()

    found: dict[str, Callable[[], Runner]] = {
        REFERENCE: lambda: _torch(plain().to(memory_format=last), info),  # type: ignore[call-overload]
        "torch contiguous fp32": lambda: _torch(plain(), info, layout=torch.contiguous_format),
        REFERENCE + MEMORY_KEPT: lambda: _torch(plain().to(memory_format=last), info),  # type: ignore[call-overload]
        "torch, BN folded": lambda: _torch(folded(), info),
        "torch, BN folded" + MEMORY_KEPT: lambda: _torch(folded(), info),
        "torch, BN folded, bf16": lambda: _torch(folded().bfloat16(), info, torch.bfloat16),
        "torch.compile, BN folded": lambda: _torch(_compiled(folded()), info),
        "ONNX Runtime, MaxUnpool": lambda: _onnx(graph("index")),
        "ONNX Runtime, masks": lambda: _onnx(graph("mask")),
        _BLOCKED: lambda: _onnx(graph("blocked")),
        "ONNX Runtime, masks, int8": lambda: _onnx(_quantised(graph("mask"), samples)),
        "OpenVINO, masks, fp32": lambda: _openvino(graph("mask"), "f32"),
        "OpenVINO, masks, bf16": lambda: _openvino(graph("mask"), "bf16"),
    }
    if not isinstance(model, DSNet):  # nothing is unpooled: its graph is one and the same
        for name in ("ONNX Runtime, MaxUnpool", "ONNX Runtime, masks"):
            del found[name]
    return found


def undecided(model: nn.Module, info: WeightsInfo, sample: Sample) -> np.ndarray:
    """Where the reference's own answer moves (by a tenth of TOLERANCE) if its input moves by rounding errors.

    Unpooling writes to the place of a window's maximum. In a flat part of a picture (a blown-out lamp, a
    white border) all four are equal up to rounding, so that the place, and the answer there, is chance.

    Returns:
        bool (H / 2, W / 2), with a margin of 3 pixels.
    """
    with torch.inference_mode():
        x = to_input(*sample).contiguous(memory_format=torch.channels_last)
        generator = torch.Generator().manual_seed(0)
        draws = (torch.randn(x.shape, generator=generator) * _NOISE for _ in range(_DRAWS))
        answers = [torch.softmax(model(x + noise) / info.temperature, dim=1)[0] for noise in draws]
        spread = torch.stack(answers).amax(dim=0) - torch.stack(answers).amin(dim=0)
    moved = (spread.amax(dim=0) > TOLERANCE / 10).numpy().astype(np.uint8)
    return cv2.dilate(moved, np.ones((2 * _HALO_PX + 1,) * 2, np.uint8)) > 0


def _compare(
    model: nn.Module,
    info: WeightsInfo,
    samples: Sequence[Sample],
    answers: dict[str, list[np.ndarray]],
    results: list[Result],
) -> None:
    reference = copy.deepcopy(model).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    for k, sample in enumerate(samples):
        chance = undecided(reference, info, sample)
        for result in results:
            if result.error or not result.compared:
                continue
            difference = np.abs(answers[result.name][k] - answers[results[0].name][k]).max(axis=2)
            result.difference = max(result.difference, float(difference.max()))
            result.decided = max(result.decided, float(np.where(chance, 0, difference).max()))
            result.chance += float(chance.mean()) / len(samples)
            result.beyond += float((difference > TOLERANCE).mean()) / len(samples)


def _time(run: Runner, sample: Sample, repeats: int) -> float:
    """Median milliseconds, after two calls that warm the caches."""
    for _ in range(2):
        run(sample)
    seconds = []
    for _ in range(repeats):
        began = time.perf_counter()
        run(sample)
        seconds.append(time.perf_counter() - began)
    return 1e3 * float(np.median(seconds))


def _torch(
    model: nn.Module,
    info: WeightsInfo,
    dtype: torch.dtype = torch.float32,
    layout: torch.memory_format = torch.channels_last,
) -> Runner:
    offset = torch.from_numpy(info.offset())[:, None, None]

    @torch.inference_mode()
    def run(sample: Sample) -> np.ndarray:
        x = to_input(*sample).contiguous(memory_format=layout).to(dtype)
        probabilities = torch.softmax((model(x).float() + offset) / info.temperature, dim=1)
        return probabilities[0].permute(1, 2, 0).contiguous().numpy()

    return run


def _compiled(model: nn.Module) -> Any:
    import torch._inductor.config as inductor

    inductor.freezing = True  # weights become constants of the compiled code
    return torch.compile(model, dynamic=False)


def _onnx(graph: bytes) -> Runner:
    session = onnx_session(graph)
    return lambda sample: session.run(None, _named(sample))[0][0]


def _named(sample: Sample) -> dict[str, np.ndarray]:
    """A sample as the inputs of an ONNX graph."""
    return dict(zip(("image", "geometry"), sample, strict=False))


def _quantised(graph: bytes, samples: Sequence[Sample]) -> bytes:
    """Convolutions in int8, activations in uint8, calibrated on the images."""
    from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static

    class Reader(CalibrationDataReader):
        def __init__(self) -> None:
            self.left = iter(samples)

        def get_next(self) -> Any:
            sample = next(self.left, None)
            return None if sample is None else _named(sample)

    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "float.onnx", Path(folder) / "int8.onnx"
        source.write_bytes(graph)
        quantize_static(
            source, target, Reader(), quant_format=QuantFormat.QDQ, per_channel=True,
            activation_type=QuantType.QUInt8, weight_type=QuantType.QInt8, op_types_to_quantize=["Conv"],
        )  # fmt: skip
        return target.read_bytes()


def _openvino(graph: bytes, precision: str) -> Runner:
    import openvino

    core = openvino.Core()
    options = {
        "INFERENCE_NUM_THREADS": torch.get_num_threads(),
        "PERFORMANCE_HINT": "LATENCY",
        "INFERENCE_PRECISION_HINT": precision,
    }
    request = core.compile_model(core.read_model(graph), "CPU", options).create_infer_request()
    return lambda sample: request.infer(_named(sample))[0][0].copy()
