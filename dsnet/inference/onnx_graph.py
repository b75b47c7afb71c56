"""What every ONNX graph here is put together from: nodes, constants, inputs, outputs, what it says of itself."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from dsmap.dsnet.checkpoint import WeightsInfo
from dsmap.dsnet.config import GEOMETRY_CHANNELS, NetConfig

OPSET = 17


class Graph:
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


def numpy_of(tensor: Any) -> np.ndarray:
    """A parameter in float64."""
    return tensor.detach().cpu().double().numpy()


def affine(norm: nn.Module) -> tuple[np.ndarray | float, np.ndarray | float]:
    """A batch norm as scale and shift of each channel; (1, 0) where it was folded away."""
    if not isinstance(norm, nn.BatchNorm2d):
        return 1.0, 0.0
    scale = numpy_of(norm.weight) / np.sqrt(numpy_of(norm.running_var) + norm.eps)
    return scale, numpy_of(norm.bias) - numpy_of(norm.running_mean) * scale


def network_input(g: Graph, with_geometry: bool) -> tuple[str, str]:
    """`to_input`, in channels first: (image - 127.5) / 64, and geometry as it is ("" without it)."""
    x = g.add("Cast", g.add("Transpose", "image", perm=[0, 3, 1, 2]), to=TensorProto.FLOAT)
    x = g.add("Mul", g.add("Sub", x, g.constant(127.5)), g.constant(1 / 64))
    return x, g.add("Transpose", "geometry", perm=[0, 3, 1, 2]) if with_geometry else ""


def convolve(
    g: Graph,
    x: str,
    weight: np.ndarray,
    bias: Any = None,
    pad: int | tuple[int, int] = 0,
    stride: int = 1,
    groups: int = 1,
) -> str:
    """A convolution; `pad` of two numbers: pixels before and behind, of rows and of columns."""
    before, behind = pad if isinstance(pad, tuple) else (pad, pad)
    inputs = [x, g.constant(weight)]
    if bias is not None:
        inputs.append(g.constant(np.broadcast_to(bias, weight.shape[:1])))
    sides = {"pads": [before, before, behind, behind], "strides": [stride] * 2, "group": groups}
    return g.add("Conv", *inputs, kernel_shape=list(weight.shape[2:]), **sides)


def answer(g: Graph, logits: str) -> None:
    """The graph's output: the softmax of logits in channels first."""
    g.name(g.add("Softmax", g.add("Transpose", logits, perm=[0, 2, 3, 1]), axis=-1), "probabilities")


def finished_model(
    g: Graph, config: NetConfig, info: WeightsInfo, size: tuple[int, int], batch: int
) -> onnx.ModelProto:
    """The checked model of a graph."""
    width, height = size
    n: str | int = batch or "N"
    value = helper.make_tensor_value_info
    inputs = [value("image", TensorProto.UINT8, [n, height, width, 3])]
    if config.channels > 3:
        inputs.append(value("geometry", TensorProto.FLOAT, [n, height, width, GEOMETRY_CHANNELS]))
    shape: Sequence[str | int] = [n, height // 2, width // 2, config.classes]
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
        + ("; geometry: float32 (N, H, W, 4), see docs" if config.channels > 3 else ""),
        "outputs": "probabilities: float32 (N, H/2, W/2, classes), calibrated; class 0 is void",
    }
    helper.set_model_props(proto, properties)
    onnx.checker.check_model(proto)
    return proto
