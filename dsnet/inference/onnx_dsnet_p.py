"""dsnet-p as ONNX nodes; every line is one of `DSNetP.forward`."""

import numpy as np
from torch import nn

from dsmap.dsnet.inference.onnx_graph import Graph, affine, convolve, numpy_of
from dsmap.dsnet.networks.dsnet import ConvBN
from dsmap.dsnet.networks.dsnet_p import INTO_ENCODER, DSNetP, Enlarge, Separable
from dsmap.dsnet.networks.efficientnet_lite import FrozenConv, InvertedResidual


def logits_of_dsnet_p(g: Graph, x: str, geometry: str, model: DSNetP, size: tuple[int, int]) -> str:
    """Logits of RGB (N, 3, H, W) and geometry (N, 4, H, W; "" without it), both named values of the graph."""
    half, quarter, eighth, sixteenth, x = _encode(g, x, geometry, model)
    x = _conv_bn(g, x, model.top)
    whole = g.add("ReduceMean", x, axes=[2, 3], keepdims=1)
    x = g.add("Add", x, _plain(g, whole, model.everywhere))
    x = g.add("Add", x, _separable(g, x, model.top_conv))
    for enlarge, skip in ((model.d1, sixteenth), (model.d2, eighth), (model.d3, quarter)):
        x = _enlarge(g, x, skip, enlarge)
    return g.add("Add", _deconvolve(g, x, model.score), _plain(g, half, model.score_half))


def _encode(g: Graph, x: str, geometry: str, model: DSNetP) -> list[str]:
    seen = []
    if geometry:
        for step in model.geometry.steps:
            geometry = _conv_bn(g, geometry, step[0])  # type: ignore[index]
            for more in list(step)[1:]:  # type: ignore[call-overload]
                geometry = _separable(g, geometry, more)
            seen.append(geometry)
    x = _frozen(g, x, model.encoder.stem)
    found = []
    for level, blocks in enumerate(model.encoder.levels):
        for block in blocks:  # type: ignore[union-attr]
            x = _inverted(g, x, block)
        if seen and level in INTO_ENCODER:
            x = g.add("Add", x, _plain(g, seen[level], model.inject[level - INTO_ENCODER[0]]))
        found.append(g.add("Concat", x, seen[level], axis=1) if level < len(seen) else x)
    return found


def _frozen(g: Graph, x: str, conv: FrozenConv) -> str:
    weight, bias = (numpy_of(part) for part in conv.folded())
    x = convolve(g, x, weight, bias, conv.pads, conv.stride, conv.groups)
    return g.add("Clip", x, g.constant(0.0), g.constant(6.0)) if conv.relu else x


def _inverted(g: Graph, x: str, block: InvertedResidual) -> str:
    y = _frozen(g, x, block.expand) if isinstance(block.expand, FrozenConv) else x
    y = _frozen(g, _frozen(g, y, block.depthwise), block.project)
    return g.add("Add", x, y) if block.residual else y


def _conv_bn(g: Graph, x: str, block: ConvBN) -> str:
    conv, norm, last = block
    assert isinstance(conv, nn.Conv2d)
    scale, shift = affine(norm)
    weight = numpy_of(conv.weight) * np.reshape(scale, (-1, 1, 1, 1))
    bias = shift if conv.bias is None else numpy_of(conv.bias) * scale + shift
    pad, stride = int(conv.padding[0]), int(conv.stride[0])
    x = convolve(g, x, weight, bias, pad, stride, conv.groups)
    return g.add("Relu", x) if isinstance(last, nn.ReLU) else x


def _separable(g: Graph, x: str, pair: Separable) -> str:
    return _conv_bn(g, _conv_bn(g, x, pair[0]), pair[1])  # type: ignore[arg-type]


def _plain(
    g: Graph, x: str, conv: nn.Module, scale: np.ndarray | float = 1.0, shift: np.ndarray | None = None
) -> str:
    """A 1x1 convolution, its result scaled and shifted channel by channel."""
    assert isinstance(conv, nn.Conv2d)
    weight = numpy_of(conv.weight) * np.reshape(scale, (-1, 1, 1, 1))
    bias = 0.0 if conv.bias is None else numpy_of(conv.bias) * scale
    return convolve(g, x, weight, bias if shift is None else bias + shift)


def _deconvolve(g: Graph, x: str, deconv: nn.ConvTranspose2d, scale: np.ndarray | float = 1.0) -> str:
    """A 2x2 deconvolution of stride 2: no two of its outputs overlap, so it is a 1x1 convolution whose channels are
    then laid out as pixels, which runtimes do faster."""
    weight = numpy_of(deconv.weight) * np.reshape(scale, (1, -1, 1, 1))  # (in, out, 2, 2)
    inputs, outputs = weight.shape[:2]
    flat = weight.transpose(2, 3, 1, 0).reshape(4 * outputs, inputs, 1, 1)  # row, column, channel: DCR order
    bias = None if deconv.bias is None else np.tile(numpy_of(deconv.bias) * scale, 4)
    return g.add("DepthToSpace", convolve(g, x, flat, bias), blocksize=2, mode="DCR")


def _enlarge(g: Graph, x: str, skip: str, enlarge: Enlarge) -> str:
    """The batch norm behind the sum goes into both of its terms."""
    scale, shift = affine(enlarge.norm[0])
    low = _deconvolve(g, x, enlarge.deconv, scale)
    x = g.add("Relu", g.add("Add", low, _plain(g, skip, enlarge.skip, scale, np.asarray(shift))))
    return g.add("Add", x, _separable(g, x, enlarge.conv))
