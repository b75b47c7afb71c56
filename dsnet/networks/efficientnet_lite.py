"""The convolutions of EfficientNet-Lite (Tan and Le 2019; Google 2020), the encoder of `dsnet-p`.

Inverted residuals without squeeze-and-excitation. Their batch norms stay as ImageNet left them: a batch of eight
photographs says less of the world than a million.
"""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

_STAGES = (
    # repeats, kernel, stride, expansion, output channels
    (1, 3, 1, 1, 16),
    (2, 3, 2, 6, 24),
    (2, 5, 2, 6, 40),
    (3, 3, 2, 6, 80),
    (3, 5, 1, 6, 112),
    (4, 5, 2, 6, 192),
    (1, 3, 1, 6, 320),
)
_SCALES = {"lite0": (1.0, 1.0), "lite1": (1.0, 1.1), "lite2": (1.1, 1.2)}
"""Factors of width and depth."""
STEM = 32
_EPSILON = 1e-3
"""Of the batch norms, as the weights were trained."""


def _width(channels: int, factor: float) -> int:
    """A multiple of 8 near channels * factor, at most a tenth below it."""
    scaled = channels * factor
    rounded = max(8, int(scaled + 4) // 8 * 8)
    return rounded + 8 if rounded < 0.9 * scaled else rounded


class FrozenConv(nn.Module):
    """A convolution without bias and a batch norm whose statistics stay as they are, computed as one convolution.

    Padding is TensorFlow's "same": at stride 2 one pixel more below and right than above and left. Input
    (N, inputs, H, W), output (N, outputs, H / stride, W / stride).
    """

    mean: Tensor
    var: Tensor

    def __init__(
        self, inputs: int, outputs: int, kernel: int, stride: int = 1, groups: int = 1, relu: bool = True
    ):
        super().__init__()
        self.kernel, self.stride, self.groups, self.relu = kernel, stride, groups, relu
        self.weight = nn.Parameter(torch.empty(outputs, inputs // groups, kernel, kernel))
        nn.init.kaiming_normal_(self.weight, mode="fan_out")
        self.register_parameter("bias", None)  # see `fold`
        self.scale = nn.Parameter(torch.ones(outputs))
        self.shift = nn.Parameter(torch.zeros(outputs))
        self.register_buffer("mean", torch.zeros(outputs))
        self.register_buffer("var", torch.ones(outputs))

    def fold(self) -> None:
        """Keep the one convolution's weight and bias from now on (inference only)."""
        weight, bias = self.folded()
        self.weight, self.bias = nn.Parameter(weight.detach()), nn.Parameter(bias.detach())

    def folded(self) -> tuple[Tensor, Tensor]:
        """Weight and bias of the one convolution."""
        if self.bias is not None:
            return self.weight, self.bias
        gain = self.scale * torch.rsqrt(self.var + _EPSILON)
        return self.weight * gain[:, None, None, None], self.shift - self.mean * gain

    @property
    def pads(self) -> tuple[int, int]:
        """Pixels before and behind, of rows and of columns, for sides that the stride divides."""
        total = self.kernel - self.stride
        return total // 2, total - total // 2

    def forward(self, x: Tensor) -> Tensor:
        weight, bias = self.folded()
        before, behind = self.pads
        if before != behind:
            x = F.pad(x, (before, behind, before, behind))
        x = F.conv2d(x, weight, bias, self.stride, before if before == behind else 0, 1, self.groups)
        return F.relu6(x, inplace=True) if self.relu else x


class InvertedResidual(nn.Module):
    """1x1 expansion, depthwise convolution, 1x1 projection; the input is added where the shape is the same."""

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int, expansion: int):
        super().__init__()
        wide = inputs * expansion
        self.expand = FrozenConv(inputs, wide, 1) if expansion > 1 else nn.Identity()
        self.depthwise = FrozenConv(wide, wide, kernel, stride, groups=wide)
        self.project = FrozenConv(wide, outputs, 1, relu=False)
        self.residual = stride == 1 and inputs == outputs

    def forward(self, x: Tensor) -> Tensor:
        y = self.project(self.depthwise(self.expand(x)))
        return x + y if self.residual else y


class EfficientNetLite(nn.Module):
    """Features at 1/2, 1/4, 1/8, 1/16 and 1/32 of the size, for RGB scaled as ImageNet's weights want it.

    Args:
        name: lite0, lite1 or lite2.
    """

    def __init__(self, name: str):
        super().__init__()
        width, depth = _SCALES[name]
        self.stem = FrozenConv(3, STEM, 3, 2)
        inputs = STEM
        levels: list[list[nn.Module]] = [[]]
        self.channels: list[int] = []
        """Of the five features."""
        for i, (repeats, kernel, stride, expansion, outputs) in enumerate(_STAGES):
            outputs = _width(outputs, width)
            if 0 < i < len(_STAGES) - 1:  # Lite scales neither the first stage's depth nor the last one's
                repeats = math.ceil(depth * repeats)
            if stride == 2:
                self.channels.append(inputs)
                levels.append([])
            for k in range(repeats):
                levels[-1].append(
                    InvertedResidual(inputs, outputs, kernel, stride if k == 0 else 1, expansion)
                )
                inputs = outputs
        self.channels.append(inputs)
        self.levels = nn.ModuleList([nn.Sequential(*blocks) for blocks in levels])

    @property
    def blocks(self) -> list[InvertedResidual]:
        """All blocks in their order."""
        return [block for level in self.levels for block in level]  # type: ignore[union-attr]
