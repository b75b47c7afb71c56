"""DS-Net, layer by layer as in Table 1 of the paper (sizes in the comments are for 448x448 input)."""

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from dsmap.dsnet.config import DSNetConfig
from dsmap.dsnet.networks.efficientnet_lite import FrozenConv


def to_input(images: Tensor | np.ndarray, geometry: Tensor | np.ndarray | None = None) -> Tensor:
    """Images as a network takes them: float32 (N, 3 or 7, H, W), channels_last.

    Args:
        images: uint8 (N, H, W, 3).
        geometry: (N, H, W, 4) of `kernels.geometry`, which are scaled already.
    """
    batch = torch.as_tensor(images).permute(0, 3, 1, 2).float()
    batch = batch.sub_(127.5).div_(64.0)
    if geometry is None:
        return batch
    more = torch.as_tensor(geometry).permute(0, 3, 1, 2).float()
    return torch.cat([batch, more], dim=1).contiguous(memory_format=torch.channels_last)


class ConvBN(nn.Sequential):
    """A (transposed) convolution without bias, then BN and, unless it is the last of the net, ReLU."""

    def __init__(self, conv: nn.Module, channels: int, relu: bool = True):
        super().__init__(conv, nn.BatchNorm2d(channels), nn.ReLU(inplace=True) if relu else nn.Identity())


class DenseLayer(nn.Module):
    """BN-ReLU-3x3 convolution; its K feature maps are appended to what came in."""

    def __init__(self, channels: int, growth: int):
        super().__init__()
        self.bn = nn.BatchNorm2d(channels)
        self.conv = nn.Conv2d(channels, growth, 3, padding=1, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        return torch.cat([x, self.conv(self.bn(x).relu_())], dim=1)


class Encode(nn.Module):
    """B of Fig. 4: 2x2 max-pool, dense block of L layers, BN-ReLU-1x1 convolution, dropout."""

    def __init__(self, config: DSNetConfig, block: int, channels: int, out: int):
        super().__init__()
        layers, growth = config.blocks[block]
        grown = channels + layers * growth
        self.pool = nn.MaxPool2d(2, return_indices=True)
        self.dense = nn.Sequential(*[DenseLayer(channels + i * growth, growth) for i in range(layers)])
        self.bn = nn.BatchNorm2d(grown)
        self.conv = nn.Conv2d(grown, out, 1, bias=False)
        self.dropout = nn.Dropout(config.dropout)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:
        x, indices = self.pool(x)
        x = self.dense(x)
        return self.dropout(self.conv(self.bn(x).relu_())), indices


class Decode(nn.Module):
    """D of Fig. 4: 2x2 unpooling with the indices of its B, then two 2x2 deconvolutions of stride 1.

    Padding 0 makes the first one pixel larger than its input, padding 1 takes it back: 28 -> 29 -> 28.
    """

    def __init__(self, channels: int, out: int, final_relu: bool = True):
        super().__init__()
        self.unpool = nn.MaxUnpool2d(2)
        self.deconv1 = ConvBN(nn.ConvTranspose2d(channels, channels, 2, padding=0, bias=False), channels)
        self.deconv2 = ConvBN(nn.ConvTranspose2d(channels, out, 2, padding=1, bias=False), out, final_relu)

    def forward(self, x: Tensor, indices: Tensor) -> Tensor:
        return self.deconv2(self.deconv1(self.unpool(x, indices)))


def make_stem(config: DSNetConfig, stride: int = 2) -> nn.Sequential:
    """The convolutions before B1."""
    width = config.widths[0]
    stem = [ConvBN(nn.Conv2d(config.channels, width, 3, stride=stride, padding=1, bias=False), width)]
    for _ in range(config.stem_convs - 1):
        stem.append(ConvBN(nn.Conv2d(width, width, 3, padding=1, bias=False), width))
    return nn.Sequential(*stem)


class DSNet(nn.Module):
    """Class logits at half the input's size.

    Input: float32, shape (N, channels, H, W), H and W multiples of 32, from `to_input`.
    Output: float32, shape (N, classes, H / 2, W / 2).
    """

    def __init__(self, config: DSNetConfig | None = None):
        super().__init__()
        self.config = config = config or DSNetConfig()
        w1, w2, w3, w4 = config.widths
        self.stem = make_stem(config)  #        224 x 224 x 16
        self.b1 = Encode(config, 0, w1, w2)  #     112 x 112 x (16 -> 80 -> 16)
        self.b2 = Encode(config, 1, w2, w3)  #      56 x 56
        self.b3 = Encode(config, 2, w3, w4)  #      28 x 28
        self.b4 = Encode(config, 3, w4, w4)  #      14 x 14
        self.d1 = Decode(w4, w3)  #              28 x 28 x 16
        self.d2 = Decode(w3, w2)  #              56 x 56
        self.d3 = Decode(w2, w1)  #             112 x 112
        self.d4 = Decode(w1, config.classes, final_relu=config.final_relu)  # 224 x 224 x 14

    def forward(self, x: Tensor) -> Tensor:
        x = self.stem(x)
        x, indices1 = self.b1(x)
        x, indices2 = self.b2(x)
        x, indices3 = self.b3(x)
        x, indices4 = self.b4(x)
        x = self.d1(x, indices4)
        x = self.d2(x, indices3)
        x = self.d3(x, indices2)
        return self.d4(x, indices1)


def fold_batch_norms(model: nn.Module) -> nn.Module:
    """Fold every BN that follows a convolution into it (inference only; changes `model` and returns it)."""
    model.eval()
    for block in [m for m in model.modules() if isinstance(m, ConvBN)]:
        transposed = isinstance(block[0], nn.ConvTranspose2d)
        block[0] = fuse_conv_bn_eval(block[0], block[1], transpose=transposed)  # type: ignore[arg-type]
        block[1] = nn.Identity()
    for conv in [m for m in model.modules() if isinstance(m, FrozenConv)]:
        conv.fold()
    return model
