"""A trained network as the mapper's segmenter: a frame in, class probabilities out."""

from pathlib import Path

import numpy as np
import torch
from torch import nn

from dsmap.dsnet.checkpoint import WeightsInfo, load_weights
from dsmap.dsnet.model import fold_batch_norms, to_input
from dsmap.errors import InputError
from dsmap.frame import Frame
from dsmap.sequences.images import resize_colour, resize_nearest

SHIPPED_WEIGHTS = Path(__file__).parent / "weights" / "dsnet.safetensors"


class DSNetSegmenter:
    """A `dsmap.fusion.segmenter.Segmenter` made of a trained network."""

    def __init__(self, model: nn.Module, info: WeightsInfo, device: str = "cpu"):
        self.info = info
        self.device = torch.device(device)
        folded = fold_batch_norms(model).to(self.device)
        self.model = folded.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    @torch.inference_mode()
    def logits(self, rgb: np.ndarray, depth: np.ndarray | None = None) -> np.ndarray:
        """Class logits before the temperature, float32, shape (h, w, classes); arguments as in `predict`."""
        return self._forward(rgb, depth)[0].permute(1, 2, 0).cpu().numpy()

    @torch.inference_mode()
    def predict(self, rgb: np.ndarray, depth: np.ndarray | None = None) -> np.ndarray:
        """Calibrated probabilities, float32, shape (h, w, classes); rows sum to 1.

        (h, w) is half the working size of the weights.

        Args:
            rgb: uint8 (H, W, 3).
            depth: metres (H, W), 0 = no measurement; read by RGB-D networks only, which must have it.
        """
        probabilities = torch.softmax(self._forward(rgb, depth) / self.info.temperature, dim=1)
        return np.ascontiguousarray(probabilities[0].permute(1, 2, 0).cpu().numpy())

    def _forward(self, rgb: np.ndarray, depth: np.ndarray | None) -> torch.Tensor:
        image = torch.from_numpy(resize_colour(rgb, *self.info.size)[None]).to(self.device)
        if self.info.config.channels == 3:
            return self.model(to_input(image))
        if depth is None:
            raise InputError("network: these weights are of an RGB-D network, expected images with depth")
        small = torch.from_numpy(resize_nearest(depth, *self.info.size)[None]).to(self.device)
        return self.model(to_input(image, small))

    def __call__(self, frame: Frame) -> np.ndarray:
        return self.predict(frame.rgb, frame.depth)


def load_segmenter(weights: Path | str | None = None, device: str = "cpu") -> DSNetSegmenter:
    """The segmenter of a weights file; None: the weights that ship with dsmap (trained on rendered rooms).

    Raises:
        InputError: the file is missing, damaged or not a DS-Net of dsmap.
    """
    model, info = load_weights(SHIPPED_WEIGHTS if weights is None else weights)
    return DSNetSegmenter(model, info, device)
