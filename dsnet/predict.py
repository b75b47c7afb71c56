"""DS-Net as the mapper's segmenter: a frame in, class probabilities out."""

from pathlib import Path

import cv2
import numpy as np
import torch

from dsmap.dsnet.checkpoint import WeightsInfo, load_weights
from dsmap.dsnet.model import DSNet, fold_batch_norms, to_input
from dsmap.frame import Frame

SHIPPED_WEIGHTS = Path(__file__).parent / "weights" / "dsnet.safetensors"


def resize_image(rgb: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The whole image, uint8 (H, W, 3), at `size` (width, height), without aliasing when it shrinks."""
    shrinks = size[0] < rgb.shape[1] or size[1] < rgb.shape[0]
    return cv2.resize(rgb, size, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)


class DSNetSegmenter:
    """A `dsmap.fusion.segmenter.Segmenter` made of a trained DS-Net."""

    def __init__(self, model: DSNet, info: WeightsInfo, device: str = "cpu"):
        self.info = info
        self.device = torch.device(device)
        self.model = fold_batch_norms(model).to(self.device, memory_format=torch.channels_last)

    @torch.inference_mode()
    def predict(self, rgb: np.ndarray) -> np.ndarray:
        """Calibrated probabilities, float32, shape (h, w, 14), of an RGB image, uint8 (H, W, 3).

        (h, w) is half the working size of the weights; rows sum to 1.
        """
        image = resize_image(rgb, self.info.size)
        logits = self.model(to_input(torch.from_numpy(image[None]).to(self.device)))
        probabilities = torch.softmax(logits / self.info.temperature, dim=1)
        return probabilities[0].permute(1, 2, 0).contiguous().cpu().numpy()

    def __call__(self, frame: Frame) -> np.ndarray:
        return self.predict(frame.rgb)


def load_segmenter(weights: Path | str | None = None, device: str = "cpu") -> DSNetSegmenter:
    """The segmenter of a weights file; None: the weights that ship with dsmap (trained on rendered rooms).

    Raises:
        InputError: the file is missing, damaged or not a DS-Net of dsmap.
    """
    model, info = load_weights(SHIPPED_WEIGHTS if weights is None else weights)
    return DSNetSegmenter(model, info, device)
