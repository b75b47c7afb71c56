"""DS-Net as the mapper's segmenter: a frame in, class probabilities out."""

from pathlib import Path

import numpy as np
import torch

from dsmap.dsnet.checkpoint import WeightsInfo, load_weights
from dsmap.dsnet.model import DSNet, fold_batch_norms, to_input
from dsmap.frame import Frame
from dsmap.sequences.images import resize_colour

SHIPPED_WEIGHTS = Path(__file__).parent / "weights" / "dsnet.safetensors"


class DSNetSegmenter:
    """A `dsmap.fusion.segmenter.Segmenter` made of a trained DS-Net."""

    def __init__(self, model: DSNet, info: WeightsInfo, device: str = "cpu"):
        self.info = info
        self.device = torch.device(device)
        folded = fold_batch_norms(model).to(self.device)
        self.model = folded.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    @torch.inference_mode()
    def logits(self, rgb: np.ndarray) -> np.ndarray:
        """Class logits before the temperature, float32, shape (h, w, 14), of uint8 RGB (H, W, 3)."""
        return self._forward(rgb)[0].permute(1, 2, 0).cpu().numpy()

    @torch.inference_mode()
    def predict(self, rgb: np.ndarray) -> np.ndarray:
        """Calibrated probabilities, float32, shape (h, w, 14), of an RGB image, uint8 (H, W, 3).

        (h, w) is half the working size of the weights; rows sum to 1.
        """
        probabilities = torch.softmax(self._forward(rgb) / self.info.temperature, dim=1)
        return np.ascontiguousarray(probabilities[0].permute(1, 2, 0).cpu().numpy())

    def _forward(self, rgb: np.ndarray) -> torch.Tensor:
        image = torch.from_numpy(resize_colour(rgb, *self.info.size)[None])
        return self.model(to_input(image.to(self.device)))

    def __call__(self, frame: Frame) -> np.ndarray:
        return self.predict(frame.rgb)


def load_segmenter(weights: Path | str | None = None, device: str = "cpu") -> DSNetSegmenter:
    """The segmenter of a weights file; None: the weights that ship with dsmap (trained on rendered rooms).

    Raises:
        InputError: the file is missing, damaged or not a DS-Net of dsmap.
    """
    model, info = load_weights(SHIPPED_WEIGHTS if weights is None else weights)
    return DSNetSegmenter(model, info, device)
