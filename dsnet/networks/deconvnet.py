"""The deconvolution network of Noh, Hong and Han (ICCV 2015): the paper's baseline, VGG-16 and its mirror."""

import torch.nn.functional as F
from torch import Tensor, nn

from dsmap.dsnet.config import DeconvNetConfig
from dsmap.dsnet.networks.dsnet import ConvBN
from dsmap.errors import InputError

_STAGES = ((64, 64), (128, 128), (256, 256, 256), (512, 512, 512), (512, 512, 512))
"""Output channels of VGG-16's convolutions, by stage."""
_MIRROR = ((512, 512, 512), (512, 512, 256), (256, 256, 128), (128, 64), (64, 64))
"""Output channels of the deconvolutions behind unpooling 5 .. 1."""
_FC = 4096
_FC_SIDE = 7
"""fc6 sees 7x7: one answer for the 224x224 of the original."""


def scaled(channels: int, config: DeconvNetConfig) -> int:
    """Channels at the network's width."""
    return max(1, round(channels * config.width))


def _conv(inputs: int, outputs: int, side: int = 3) -> ConvBN:
    return ConvBN(nn.Conv2d(inputs, outputs, side, padding=side // 2, bias=False), outputs)


class VggEncoder(nn.Module):
    """VGG-16's convolutions with BN; max-pooling after each stage keeps its indices."""

    def __init__(self, config: DeconvNetConfig):
        super().__init__()
        stages, inputs = [], config.channels
        for widths in _STAGES:
            convs = []
            for width in widths:
                convs.append(_conv(inputs, scaled(width, config)))
                inputs = scaled(width, config)
            stages.append(nn.Sequential(*convs))
        self.stages = nn.ModuleList(stages)
        self.pool = nn.MaxPool2d(2, return_indices=True)
        self.out_channels = inputs

    def forward(self, x: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Features at 1/32 of the size, and the indices of pooling 1 .. 5."""
        indices = []
        for stage in self.stages:
            x, kept = self.pool(stage(x))
            indices.append(kept)
        return x, indices


class DeconvNet(nn.Module):
    """Class logits at half the input's size, as the harness wants them: means of 2x2 of the full size.

    Input: float32, shape (N, channels, H, W), multiples of 32 from 224 on.
    Output: float32, shape (N, classes, H / 2, W / 2).
    """

    def __init__(self, config: DeconvNetConfig):
        super().__init__()
        self.config = config
        self.encoder = VggEncoder(config)
        features, fc = self.encoder.out_channels, scaled(_FC, config)
        self.fc6 = ConvBN(nn.Conv2d(features, fc, _FC_SIDE, bias=False), fc)
        self.fc7 = _conv(fc, fc, 1)
        self.fc6_deconv = ConvBN(nn.ConvTranspose2d(fc, features, _FC_SIDE, bias=False), features)
        self.unpool = nn.MaxUnpool2d(2)
        stages, inputs = [], features
        for widths in _MIRROR:
            convs = []
            for width in widths:
                outputs = scaled(width, config)
                convs.append(ConvBN(nn.ConvTranspose2d(inputs, outputs, 3, padding=1, bias=False), outputs))
                inputs = outputs
            stages.append(nn.Sequential(*convs))
        self.stages = nn.ModuleList(stages)
        self.score = nn.Conv2d(inputs, config.classes, 1)

    def forward(self, x: Tensor) -> Tensor:
        if min(x.shape[2:]) < 32 * _FC_SIDE:
            raise InputError(f"DeconvNet: image is {x.shape[3]}x{x.shape[2]}, expected at least 224x224")
        x, indices = self.encoder(x)
        x = self.fc6_deconv(self.fc7(self.fc6(x)))
        for stage, kept in zip(self.stages, reversed(indices), strict=True):
            x = stage(self.unpool(x, kept))
        return F.avg_pool2d(self.score(x), 2)
