"""A DS-Net as an ONNX graph: pixels in, calibrated probabilities out, loadable without dsmap or torch."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from dsmap.dsnet.checkpoint import WeightsInfo
from dsmap.dsnet.model import MEAN_INVERSE_DEPTH, NEAREST_M, SPREAD_INVERSE_DEPTH, ConvBN, DSNet
from dsmap.errors import InputError
from dsmap.files import atomic_path

OPSET = 17
Unpool = Literal["mask", "blocked", "index"]
_HUGE = 2.0**100
"""Times the difference of any two floats that networks tell apart: more than 4."""


class _Graph:
    """Nodes and constants as they are added; a value is known by its name."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def constant(self, value: Any, dtype: Any = np.float32) -> str:
        name = f"constant{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.array(value, dtype, order="C"), name))
        return name

    def many(self, kind: str, *inputs: str, outputs: int, **attributes: Any) -> list[str]:
        node = f"{kind}{len(self.nodes)}"
        names = [f"{node}.{i}" for i in range(outputs)]
        self.nodes.append(helper.make_node(kind, list(inputs), names, name=node, **attributes))
        return names

    def add(self, kind: str, *inputs: str, **attributes: Any) -> str:
        return self.many(kind, *inputs, outputs=1, **attributes)[0]

    def name(self, value: str, name: str) -> None:
        self.nodes.append(helper.make_node("Identity", [value], [name], name=name))


def build_onnx(
    model: nn.Module,
    info: WeightsInfo,
    size: tuple[int, int] | None = None,
    *,
    batch: int = 1,
    unpool: Unpool = "mask",
) -> onnx.ModelProto:
    """The ONNX graph of a DS-Net, for inference.

    Inputs: `image`, uint8 (N, H, W, 3), RGB; for RGB-D nets `depth` as well, float32 (N, H, W), metres,
    0 = no measurement. Output: `probabilities`, float32 (N, H / 2, W / 2, classes), after the temperature.
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
    if not isinstance(model, DSNet):
        raise InputError(f"ONNX: the network is a {type(model).__name__}, expected a DS-Net")
    width, height = size or info.size
    if min(width, height) < 32 or width % 32 or height % 32:
        raise InputError(f"ONNX: size is {width}x{height}, expected multiples of 32")
    g = _Graph()
    x = _stem(g, _input(g, model.config.channels == 4), model)
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
            y = _convolve(g, _normalise(g, x, layer.bn), _numpy(layer.conv.weight), pad=1)  # type: ignore[arg-type, union-attr]
            x = g.add("Concat", x, y, axis=1)
        x = _convolve(g, _normalise(g, x, encode.bn), _numpy(encode.conv.weight))
    decoders = (model.d1, model.d2, model.d3, model.d4)
    for k, (decode, (source, maxima, indices)) in enumerate(zip(decoders, reversed(pooled), strict=True)):
        if unpool == "index":
            x = g.add("MaxUnpool", x, indices, kernel_shape=[2, 2], strides=[2, 2])
        else:
            rows, columns = height >> (4 - k), width >> (4 - k)
            mark = _first_maxima if unpool == "mask" else _first_maxima_blocked
            x = g.add(
                "Mul", _enlarge(g, x), mark(g, source, maxima, rows, columns, decode.deconv1[0].in_channels)
            )
        x = _deconvolve(g, x, decode.deconv1, pad=1)
        x = _deconvolve(g, x, decode.deconv2, pad=0, scale=1 / info.temperature if k == 3 else 1.0)
    g.name(g.add("Softmax", g.add("Transpose", x, perm=[0, 2, 3, 1]), axis=-1), "probabilities")
    return _model(g, model, info, (width, height), batch)


def export_onnx(
    path: Path, model: nn.Module, info: WeightsInfo, size: tuple[int, int] | None = None, batch: int = 1
) -> None:
    """Write `build_onnx` to a file."""
    graph = build_onnx(model, info, size, batch=batch)
    with atomic_path(path) as temporary:
        temporary.write_bytes(graph.SerializeToString())


def _numpy(tensor: Any) -> np.ndarray:
    return tensor.detach().cpu().double().numpy()


def _affine(norm: nn.Module) -> tuple[np.ndarray | float, np.ndarray | float]:
    """A batch norm as scale and shift of each channel; (1, 0) where it was folded away."""
    if not isinstance(norm, nn.BatchNorm2d):
        return 1.0, 0.0
    scale = _numpy(norm.weight) / np.sqrt(_numpy(norm.running_var) + norm.eps)
    return scale, _numpy(norm.bias) - _numpy(norm.running_mean) * scale


def _input(g: _Graph, with_depth: bool) -> str:
    """`to_input`, in channels first: (image - 127.5) / 64, and inverse depth."""
    x = g.add("Cast", g.add("Transpose", "image", perm=[0, 3, 1, 2]), to=TensorProto.FLOAT)
    x = g.add("Mul", g.add("Sub", x, g.constant(127.5)), g.constant(1 / 64))
    if not with_depth:
        return x
    inverse = g.add("Reciprocal", g.add("Max", "depth", g.constant(NEAREST_M)))
    spread = g.add("Sub", inverse, g.constant(MEAN_INVERSE_DEPTH))
    spread = g.add("Mul", spread, g.constant(1 / SPREAD_INVERSE_DEPTH))
    known = g.add("Where", g.add("Greater", "depth", g.constant(0.0)), spread, g.constant(0.0))
    return g.add("Concat", x, g.add("Unsqueeze", known, g.constant([1], np.int64)), axis=1)


def _stem(g: _Graph, x: str, model: DSNet) -> str:
    for block in model.stem:
        assert isinstance(block, ConvBN)
        scale, shift = _affine(block[1])
        weight = _numpy(block[0].weight) * np.reshape(scale, (-1, 1, 1, 1))
        bias = shift if block[0].bias is None else _numpy(block[0].bias) * scale + shift  # type: ignore[arg-type]
        x = g.add("Relu", _convolve(g, x, weight, bias, pad=1, stride=block[0].stride[0]))  # type: ignore[index, arg-type]
    return x


def _deconvolve(g: _Graph, x: str, block: ConvBN, pad: int, scale: float = 1.0) -> str:
    """A 2x2 transposed convolution of stride 1 is the convolution with the kernel turned round.

    Its padding p becomes 1 - p. `scale` > 0 multiplies the result.
    """
    gain, shift = _affine(block[1])
    weight = _numpy(block[0].weight) * np.reshape(gain, (1, -1, 1, 1)) * scale  # (in, out, 2, 2)
    bias = shift if block[0].bias is None else _numpy(block[0].bias) * gain + shift  # type: ignore[arg-type]
    x = _convolve(g, x, weight[:, :, ::-1, ::-1].transpose(1, 0, 2, 3), np.multiply(bias, scale), pad)
    return g.add("Relu", x) if isinstance(block[2], nn.ReLU) else x


def _convolve(g: _Graph, x: str, weight: np.ndarray, bias: Any = None, pad: int = 0, stride: int = 1) -> str:
    shape = list(weight.shape[2:])
    inputs = [x, g.constant(weight)]
    if bias is not None:
        inputs.append(g.constant(np.broadcast_to(bias, weight.shape[:1])))
    return g.add("Conv", *inputs, kernel_shape=shape, pads=[pad] * 4, strides=[stride] * 2)


def _normalise(g: _Graph, x: str, norm: nn.BatchNorm2d) -> str:
    """BN and ReLU in front of a convolution, which nothing can absorb: later layers see the same features
    through other batch norms."""
    return g.add("Relu", _scale(g, x, *_affine(norm)))


def _scale(g: _Graph, x: str, scale: Any, shift: Any) -> str:
    """scale x + shift of each channel."""
    constants = [g.constant(value) for value in (scale, shift, np.zeros_like(scale), np.ones_like(scale))]
    return g.add("BatchNormalization", x, *constants, epsilon=0.0)


def _max_pool(g: _Graph, x: str) -> str:
    return g.add("MaxPool", x, kernel_shape=[2, 2], strides=[2, 2])


def _enlarge(g: _Graph, x: str) -> str:
    """Every pixel twice along rows and columns."""
    scales = g.constant([1, 1, 2, 2])
    how = {"coordinate_transformation_mode": "asymmetric", "nearest_mode": "floor"}
    return g.add("Resize", x, "", scales, mode="nearest", **how)


def _first_maxima(g: _Graph, x: str, maxima: str, rows: int, columns: int, channels: int) -> str:
    """1 where x is the first (row by row) of the maxima of its 2x2 window, else 0: where unpooling writes.

    Ties are no rarity, ReLU makes windows of zeros: each candidate is weighted by its place in the window.
    """
    equal = g.add("Cast", g.add("Equal", x, _enlarge(g, maxima)), to=TensorProto.FLOAT)
    rank = g.add("Mul", equal, _places(g, rows, columns))
    first = g.add("Equal", rank, _enlarge(g, _max_pool(g, rank)))
    return g.add("Cast", first, to=TensorProto.FLOAT)


def _first_maxima_blocked(g: _Graph, x: str, maxima: str, rows: int, columns: int, channels: int) -> str:
    """The same without comparisons: relu(k (x - maximum) + place) is the place at a maximum, 0 elsewhere.

    Every operation here has a form for blocked layouts in ONNX Runtime, so that nothing is reordered; scaling,
    sum and ReLU become one.
    """
    ones = np.ones(channels)
    places = _convolve(g, _places(g, rows, columns), ones.reshape(-1, 1, 1, 1))  # of every channel, blocked
    below = g.add("Add", x, _enlarge(g, _scale(g, maxima, -ones, 0 * ones)))
    rank = g.add("Relu", g.add("Add", _scale(g, below, _HUGE * ones, 0 * ones), places))
    behind = _enlarge(g, _scale(g, _max_pool(g, rank), -ones, ones))  # 1 - the highest rank
    return g.add("Relu", g.add("Add", _scale(g, rank, ones, 0 * ones), behind))


def _places(g: _Graph, rows: int, columns: int) -> str:
    """4 3 / 2 1 in every window, shape (1, 1, rows, columns)."""
    return g.constant(np.tile([[4, 3], [2, 1]], (1, 1, rows // 2, columns // 2)))


def _model(g: _Graph, model: DSNet, info: WeightsInfo, size: tuple[int, int], batch: int) -> onnx.ModelProto:
    width, height = size
    n: str | int = batch or "N"
    value = helper.make_tensor_value_info
    inputs = [value("image", TensorProto.UINT8, [n, height, width, 3])]
    if model.config.channels == 4:
        inputs.append(value("depth", TensorProto.FLOAT, [n, height, width]))
    shape: Sequence[str | int] = [n, height // 2, width // 2, model.config.classes]
    graph = helper.make_graph(
        g.nodes, "dsnet", inputs, [value("probabilities", TensorProto.FLOAT, shape)], g.constants
    )
    proto = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=9, producer_name="dsmap"
    )
    properties = {
        "class_names": json.dumps(list(info.class_names)),
        "temperature": str(info.temperature),
        "size": f"{width}x{height}",
        "inputs": "image: uint8 (N, H, W, 3) RGB"
        + ("; depth: float32 (N, H, W), metres, 0 = no measurement" if model.config.channels == 4 else ""),
        "outputs": "probabilities: float32 (N, H/2, W/2, classes), calibrated; class 0 is void",
    }
    helper.set_model_props(proto, properties)
    onnx.checker.check_model(proto)
    return proto
