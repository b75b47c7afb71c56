"""Encoders with global pooling: the paper's experiments on CIFAR-10."""

import torch
from torch import Tensor, nn

from dsmap.dsnet.config import ClassifierConfig, DSNetConfig
from dsmap.dsnet.networks.deconvnet import VggEncoder
from dsmap.dsnet.networks.dsnet import Encode, make_stem


class Classifier(nn.Module):
    """Class logits of small images.

    Input: float32, shape (N, 3, H, W), multiples of 32, from `dsmap.dsnet.networks.dsnet.to_input`.
    Output: float32, shape (N, classes).
    """

    def __init__(self, config: ClassifierConfig):
        super().__init__()
        self.config = config
        encoder = config.encoder
        self.features: nn.Module
        if isinstance(encoder, DSNetConfig):
            self.features = _DSNetEncoder(encoder, config.stem_stride)
            channels = encoder.widths[3]
        else:
            self.features = VggEncoder(encoder)
            channels = self.features.out_channels
        self.score = nn.Linear(channels, encoder.classes)

    def forward(self, x: Tensor) -> Tensor:
        x, _ = self.features(x)
        return self.score(torch.mean(x, dim=(2, 3)))


class _DSNetEncoder(nn.Module):
    """Stem and B1..B4 of DS-Net."""

    def __init__(self, config: DSNetConfig, stem_stride: int):
        super().__init__()
        self.stem = make_stem(config, stem_stride)
        widths = (*config.widths, config.widths[3])
        self.blocks = nn.ModuleList(Encode(config, i, widths[i], widths[i + 1]) for i in range(4))

    def forward(self, x: Tensor) -> tuple[Tensor, list[Tensor]]:
        x = self.stem(x)
        indices = []
        for block in self.blocks:
            x, kept = block(x)
            indices.append(kept)
        return x, indices
