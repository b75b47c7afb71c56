"""DS-Net on a pre-trained encoder: EfficientNet-Lite, a light branch for geometry, and a decoder of deconvolutions.

EfficientNet shrinks its features by strides, not by pooling: there are no indices to unpool with, so the decoder
enlarges by deconvolutions and takes what was lost from the encoder's features of the same size.
"""

import torch
from torch import Tensor, nn

from dsmap.dsnet.config import GEOMETRY_CHANNELS, DSNetPConfig
from dsmap.dsnet.networks.dsnet import ConvBN
from dsmap.dsnet.networks.efficientnet_lite import EfficientNetLite

_GEOMETRY_WIDTHS = (16, 48, 64, 96)
"""Channels of the geometry branch at 1/2, 1/4, 1/8 and 1/16 of the size."""
INTO_ENCODER = (1, 2, 3)
"""Levels of the encoder that geometry is added to: 1/4, 1/8 and 1/16."""


def _conv(
    inputs: int, outputs: int, kernel: int, stride: int = 1, groups: int = 1, relu: bool = True
) -> ConvBN:
    conv = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, groups=groups, bias=False)
    return ConvBN(conv, outputs, relu)


class Separable(nn.Sequential):
    """A depthwise convolution and a 1x1 convolution."""

    def __init__(self, inputs: int, outputs: int, kernel: int = 5):
        super().__init__(_conv(inputs, inputs, kernel, groups=inputs, relu=False), _conv(inputs, outputs, 1))


class GeometryBranch(nn.Module):
    """Features of the geometry channels at 1/2, 1/4, 1/8 and 1/16 of the size."""

    def __init__(self) -> None:
        super().__init__()
        inputs, steps = GEOMETRY_CHANNELS, []
        for i, width in enumerate(_GEOMETRY_WIDTHS):
            steps.append(nn.Sequential(_conv(inputs, width, 3, 2), *([Separable(width, width)] if i else [])))
            inputs = width
        self.steps = nn.ModuleList(steps)

    def forward(self, x: Tensor) -> list[Tensor]:
        found = []
        for step in self.steps:
            x = step(x)
            found.append(x)
        return found


class Enlarge(nn.Module):
    """D of this network: a 2x2 deconvolution of stride 2, the skipped features added, one convolution."""

    def __init__(self, inputs: int, skip: int, outputs: int):
        super().__init__()
        self.deconv = nn.ConvTranspose2d(inputs, outputs, 2, 2, bias=False)
        self.skip = nn.Conv2d(skip, outputs, 1, bias=False)
        self.norm = nn.Sequential(nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))
        self.conv = Separable(outputs, outputs)

    def forward(self, x: Tensor, skip: Tensor) -> Tensor:
        x = self.norm(self.deconv(x) + self.skip(skip))
        return x + self.conv(x)


class DSNetP(nn.Module):
    """Class logits at half the input's size.

    Input: float32, shape (N, channels, H, W), H and W multiples of 32, from `to_input`: RGB, then, if the network reads
    it, geometry. Output: float32, shape (N, classes, H / 2, W / 2).
    """

    def __init__(self, config: DSNetPConfig):
        super().__init__()
        self.config = config
        self.encoder = EfficientNetLite(config.encoder)
        channels = list(self.encoder.channels)
        if config.geometry:
            self.geometry = GeometryBranch()
            self.inject = nn.ModuleList(
                nn.Conv2d(_GEOMETRY_WIDTHS[level], channels[level], 1) for level in INTO_ENCODER
            )
            for conv in self.inject:  # begins as the encoder that ImageNet knows
                nn.init.zeros_(conv.weight)  # type: ignore[arg-type]
                nn.init.zeros_(conv.bias)  # type: ignore[arg-type]
            channels = [c + g for c, g in zip(channels, (*_GEOMETRY_WIDTHS, 0), strict=True)]
        w = config.widths
        self.top = _conv(channels[4], w[0], 1)
        self.everywhere = nn.Conv2d(w[0], w[0], 1)
        self.top_conv = Separable(w[0], w[0])
        self.d1 = Enlarge(w[0], channels[3], w[1])
        self.d2 = Enlarge(w[1], channels[2], w[2])
        self.d3 = Enlarge(w[2], channels[1], w[3])
        self.dropout = nn.Dropout2d(config.dropout)
        self.score = nn.ConvTranspose2d(w[3], config.classes, 2, 2)
        self.score_half = nn.Conv2d(channels[0], config.classes, 1, bias=False)

    def encode(self, x: Tensor) -> list[Tensor]:
        """Features at 1/2 .. 1/32 of the size, those of geometry behind those of colour."""
        rgb, geometry = x[:, :3], x[:, 3:]
        seen = self.geometry(geometry) if self.config.geometry else []
        x = self.encoder.stem(rgb)
        found = []
        for level, blocks in enumerate(self.encoder.levels):
            x = blocks(x)
            if seen and level in INTO_ENCODER:
                x = x + self.inject[level - INTO_ENCODER[0]](seen[level])
            found.append(torch.cat([x, seen[level]], dim=1) if level < len(seen) else x)
        return found

    def forward(self, x: Tensor) -> Tensor:
        half, quarter, eighth, sixteenth, x = self.encode(x)
        x = self.top(x)
        x = x + self.everywhere(x.mean(dim=(2, 3), keepdim=True))
        x = x + self.top_conv(x)
        x = self.d1(x, sixteenth)
        x = self.d2(x, eighth)
        x = self.d3(x, quarter)
        return self.score(self.dropout(x)) + self.score_half(half)
