"""A DS-Net as an ONNX graph: pixels in, calibrated probabilities out, loadable without dsmap or torch."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
import onnx
from onnx import TensorProto
from torch import nn

from dsmap.dsnet.checkpoint import WeightsInfo
from dsmap.dsnet.inference.onnx_dsnet_p import logits_of_dsnet_p
from dsmap.dsnet.inference.onnx_graph import (
    Graph,
    affine,
    answer,
    convolve,
    finished_model,
    network_input,
    numpy_of,
)
from dsmap.dsnet.networks.dsnet import ConvBN, DSNet
from dsmap.dsnet.networks.dsnet_p import DSNetP
from dsmap.errors import InputError
from dsmap.files import atomic_path

Unpool = Literal["mask", "blocked", "index"]
_HUGE = 2.0**100
"""Times the difference of any two floats that networks tell apart: more than 4."""


def build_onnx(
    model: nn.Module,
    info: WeightsInfo,
    size: tuple[int, int] | None = None,
    *,
    batch: int = 1,
    unpool: Unpool = "mask",
) -> onnx.ModelProto:
    """The ONNX graph of a DS-Net or dsnet-p, for inference.

    Inputs: `image`, uint8 (N, H, W, 3), RGB; for RGB-D nets `geometry` as well, float32 (N, H, W, 4), of
    `kernels.geometry`. Output: `probabilities`, float32 (N, H / 2, W / 2, classes), after prior and temperature.
    Normalisation and softmax are inside, batch norms behind convolutions are folded. Names of the classes,
    the temperature and the size are metadata.

    Args:
        model: in eval mode, not changed; its batch norms may be folded already.
        size: width and height [px], multiples of 32; None: the weights' working size.
        batch: N; 0 leaves it open, which costs ONNX Runtime a fifth of its speed.
        unpool: `mask` marks the maxima of a pooling by comparison, in any runtime and precision; `blocked`
            does it by sums and products of float32, which ONNX Runtime computes in the blocked layout of its
            convolutions; `index` uses MaxUnpool, which few runtimes have.

    Raises:
        InputError: not a DS-Net, or an impossible size.
    """
    if not isinstance(model, DSNet | DSNetP):
        raise InputError(f"ONNX: the network is a {type(model).__name__}, expected a DS-Net")
    width, height = size or info.size
    if min(width, height) < 32 or width % 32 or height % 32:
        raise InputError(f"ONNX: size is {width}x{height}, expected multiples of 32")
    g = Graph()
    x, geometry = network_input(g, model.config.channels > 3)
    if isinstance(model, DSNetP):
        logits = logits_of_dsnet_p(g, x, geometry, model, (width, height))
    else:
        x = g.add("Concat", x, geometry, axis=1) if geometry else x
        logits = _logits_of_dsnet(g, x, model, (width, height), unpool)
    offset = info.offset()
    if offset.any():
        logits = g.add("Add", logits, g.constant(offset[:, None, None]))
    if info.temperature != 1:
        logits = g.add("Mul", logits, g.constant(1 / info.temperature))
    answer(g, logits)
    return finished_model(g, model.config, info, (width, height), batch)


def _logits_of_dsnet(g: Graph, x: str, model: DSNet, size: tuple[int, int], unpool: Unpool) -> str:
    width, height = size
    x = _stem(g, x, model)
    pooled = []
    for encode in (model.b1, model.b2, model.b3, model.b4):
        source = x
        indices = ""
        if unpool == "index":
            x, indices = g.many("MaxPool", x, outputs=2, kernel_shape=[2, 2], strides=[2, 2])
        else:
            x = _max_pool(g, x)
        pooled.append((source, x, indices))
        for layer in encode.dense:
            y = convolve(g, _normalise(g, x, layer.bn), numpy_of(layer.conv.weight), pad=1)  # type: ignore[arg-type, union-attr]
            x = g.add("Concat", x, y, axis=1)
        x = convolve(g, _normalise(g, x, encode.bn), numpy_of(encode.conv.weight))
    decoders = (model.d1, model.d2, model.d3, model.d4)
    for k, (decode, (source, maxima, indices)) in enumerate(zip(decoders, reversed(pooled), strict=True)):
        if unpool == "index":
            x = g.add("MaxUnpool", x, indices, kernel_shape=[2, 2], strides=[2, 2])
        else:
            rows, columns = height >> (4 - k), width >> (4 - k)
            mark = _first_maxima if unpool == "mask" else _first_maxima_blocked
            channels: Any = decode.deconv1[0].in_channels  # torch's hints take every attribute for a tensor
            x = g.add("Mul", _enlarge(g, x), mark(g, source, maxima, rows, columns, channels))
        x = _deconvolve(g, x, decode.deconv1, pad=1)
        x = _deconvolve(g, x, decode.deconv2, pad=0)
    return x


def export_onnx(
    path: Path, model: nn.Module, info: WeightsInfo, size: tuple[int, int] | None = None, batch: int = 1
) -> None:
    """Write `build_onnx` to a file."""
    graph = build_onnx(model, info, size, batch=batch)
    with atomic_path(path) as temporary:
        temporary.write_bytes(graph.SerializeToString())


def _stem(g: Graph, x: str, model: DSNet) -> str:
    for block in model.stem:
        assert isinstance(block, ConvBN)
        scale, shift = affine(block[1])
        weight = numpy_of(block[0].weight) * np.reshape(scale, (-1, 1, 1, 1))
        bias = shift if block[0].bias is None else numpy_of(block[0].bias) * scale + shift  # type: ignore[arg-type]
        x = g.add("Relu", convolve(g, x, weight, bias, pad=1, stride=block[0].stride[0]))  # type: ignore[index, arg-type]
    return x


def _deconvolve(g: Graph, x: str, block: ConvBN, pad: int) -> str:
    """A 2x2 transposed convolution of stride 1 is the convolution with the kernel turned round.

    Its padding p becomes 1 - p.
    """
    gain, shift = affine(block[1])
    weight = numpy_of(block[0].weight) * np.reshape(gain, (1, -1, 1, 1))  # (in, out, 2, 2)
    bias = shift if block[0].bias is None else numpy_of(block[0].bias) * gain + shift  # type: ignore[arg-type]
    x = convolve(g, x, weight[:, :, ::-1, ::-1].transpose(1, 0, 2, 3), bias, pad)
    return g.add("Relu", x) if isinstance(block[2], nn.ReLU) else x


def _normalise(g: Graph, x: str, norm: nn.BatchNorm2d) -> str:
    """BN and ReLU in front of a convolution, which nothing can absorb: later layers see the same features
    through other batch norms."""
    return g.add("Relu", _scale(g, x, *affine(norm)))


def _scale(g: Graph, x: str, scale: Any, shift: Any) -> str:
    """scale x + shift of each channel."""
    constants = [g.constant(value) for value in (scale, shift, np.zeros_like(scale), np.ones_like(scale))]
    return g.add("BatchNormalization", x, *constants, epsilon=0.0)


def _max_pool(g: Graph, x: str) -> str:
    return g.add("MaxPool", x, kernel_shape=[2, 2], strides=[2, 2])


def _enlarge(g: Graph, x: str) -> str:
    """Every pixel twice along rows and columns."""
    scales = g.constant([1, 1, 2, 2])
    how = {"coordinate_transformation_mode": "asymmetric", "nearest_mode": "floor"}
    return g.add("Resize", x, "", scales, mode="nearest", **how)


def _first_maxima(g: Graph, x: str, maxima: str, rows: int, columns: int, channels: int) -> str:
    """1 where x is the first (row by row) of the maxima of its 2x2 window, else 0: where unpooling writes.

    Ties are no rarity, ReLU makes windows of zeros: each candidate is weighted by its place in the window.
    """
    equal = g.add("Cast", g.add("Equal", x, _enlarge(g, maxima)), to=TensorProto.FLOAT)
    rank = g.add("Mul", equal, _places(g, rows, columns))
    first = g.add("Equal", rank, _enlarge(g, _max_pool(g, rank)))
    return g.add("Cast", first, to=TensorProto.FLOAT)


def _first_maxima_blocked(g: Graph, x: str, maxima: str, rows: int, columns: int, channels: int) -> str:
    """The same without comparisons: relu(k (x - maximum) + place) is the place at a maximum, 0 elsewhere.

    Every operation here has a form for blocked layouts in ONNX Runtime, so that nothing is reordered; scaling,
    sum and ReLU become one.
    """
    ones = np.ones(channels)
    places = convolve(g, _places(g, rows, columns), ones.reshape(-1, 1, 1, 1))  # of every channel, blocked
    below = g.add("Add", x, _enlarge(g, _scale(g, maxima, -ones, 0 * ones)))
    rank = g.add("Relu", g.add("Add", _scale(g, below, _HUGE * ones, 0 * ones), places))
    behind = _enlarge(g, _scale(g, _max_pool(g, rank), -ones, ones))  # 1 - the highest rank
    return g.add("Relu", g.add("Add", _scale(g, rank, ones, 0 * ones), behind))


def _places(g: Graph, rows: int, columns: int) -> str:
    """4 3 / 2 1 in every window, shape (1, 1, rows, columns)."""
    return g.constant(np.tile([[4, 3], [2, 1]], (1, 1, rows // 2, columns // 2)))
