"""Distillation (Hinton et al. 2015): a large network's probabilities as targets for a small one, pixel by pixel."""

from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from dsmap.dsnet.checkpoint import WeightsInfo, load_weights
from dsmap.dsnet.networks.dsnet import fold_batch_norms, to_input


class Teacher:
    """A trained network that answers the training images of another one.

    Args:
        weights: a weights file or the name of weights that ship.
        class_names: that the student learns.
        trained: the student's class prior in training, share times loss weight, shape (classes,): the teacher's answers
            are given for this prior, so that they and the labels ask for the same.
    """

    def __init__(self, weights: Path | str, class_names: tuple[str, ...], trained: np.ndarray, device: str):
        model, info = load_weights(weights, class_names)
        self.reads_geometry = info.config.channels > 3
        self._temperature = info.temperature
        folded = fold_batch_norms(model).to(torch.device(device))
        self._model = folded.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's hints lack it
        self._offset = torch.from_numpy(between(info, trained)).to(device)[:, None, None]

    @torch.no_grad()
    def __call__(self, images: Tensor, geometry: Tensor | None) -> Tensor:
        """Probabilities, float32, shape (N, classes, H / 2, W / 2).

        Args:
            images: uint8 (N, H, W, 3).
            geometry: (N, H, W, 4).
        """
        x = to_input(images, geometry if self.reads_geometry else None)
        return torch.softmax((self._model(x) + self._offset) / self._temperature, dim=1)


def between(info: WeightsInfo, trained: np.ndarray) -> np.ndarray:
    """What is added to a network's raw logits so that they are of another class prior, float32, shape (classes,)."""
    found = np.zeros(len(trained), np.float32)
    own = info.trained_prior()
    both = (own > 0) & (trained > 0)
    found[both] = np.log(trained[both] / trained.sum()) - np.log(own[both] / own.sum())
    return found


def soft_loss(logits: Tensor, target: Tensor) -> Tensor:
    """Mean over all pixels of the cross entropy between the student's answer and the teacher's; void pixels count too:
    the teacher knows what nobody labelled."""
    return F.cross_entropy(logits, target)
