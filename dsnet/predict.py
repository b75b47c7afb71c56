"""A trained network as the mapper's segmenter: a frame in, class probabilities out."""

from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from torch import nn

from dsmap.dsnet.checkpoint import WeightsInfo, load_weights
from dsmap.dsnet.config import GEOMETRY_CHANNELS
from dsmap.dsnet.engines import Engine, OnnxEngine, TorchEngine, choose_engine
from dsmap.errors import InputError
from dsmap.frame import Frame
from dsmap.sequences.images import resize_colour, resize_nearest


class DSNetSegmenter:
    """A `dsmap.fusion.segmenter.Segmenter` made of a trained network.

    Args:
        model: its batch norms are folded: it cannot be trained on.
        engine: `torch`, `onnx` (ONNX Runtime, CPU) or `auto`, the fastest that is installed. Training keeps
            to torch, whose temperature may still change; that of other engines is the one of `info` now.

    Raises:
        InputError: an engine that cannot be had here.
    """

    def __init__(self, model: nn.Module, info: WeightsInfo, device: str = "cpu", engine: str = "torch"):
        self.info = info
        self.device = torch.device(device)
        self._model = model
        chosen = choose_engine(engine, model, self.device)
        self.engine: Engine = OnnxEngine(model, info) if chosen == "onnx" else self.torch_engine

    @cached_property
    def torch_engine(self) -> TorchEngine:
        """The network in torch, whatever `engine` is: for logits and for Warp's arrays."""
        return TorchEngine(self._model, self.info, self.device)

    def logits(self, rgb: np.ndarray, geometry: np.ndarray | None = None) -> np.ndarray:
        """Class logits before the temperature, float32, shape (h, w, classes); arguments as in `predict`."""
        image, seen = self._inputs(rgb, geometry)
        small = None if seen is None else torch.from_numpy(seen)
        logits = self.torch_engine.logits(torch.from_numpy(image), small)
        return logits[0].permute(1, 2, 0).cpu().numpy()

    def predict(self, rgb: np.ndarray, geometry: np.ndarray | None = None) -> np.ndarray:
        """Calibrated probabilities, float32, shape (h, w, classes); rows sum to 1.

        (h, w) is half the working size of the weights.

        Args:
            rgb: uint8 (H, W, 3).
            geometry: (H, W, 4) of `kernels.geometry`, any size; read by RGB-D networks only. None: colour alone.
        """
        return self.engine.probabilities(*self._inputs(rgb, geometry))

    def _inputs(self, rgb: np.ndarray, geometry: np.ndarray | None) -> tuple[np.ndarray, np.ndarray | None]:
        """Both at the working size; geometry only if the network reads it, then 0 where there is none."""
        if rgb.dtype != np.uint8 or rgb.ndim != 3 or rgb.shape[2] != 3:
            raise InputError(f"network: found an image of {rgb.dtype} {rgb.shape}, expected uint8 (H, W, 3)")
        image = np.ascontiguousarray(resize_colour(rgb, *self.info.size))
        if self.info.config.channels == 3:
            return image, None
        if geometry is None:
            return image, np.zeros((*image.shape[:2], GEOMETRY_CHANNELS), np.float32)
        return image, np.ascontiguousarray(resize_nearest(geometry, *self.info.size), dtype=np.float32)

    def __call__(self, frame: Frame) -> np.ndarray:
        return self.predict(frame.rgb)


def load_segmenter(
    weights: Path | str | None = None, device: str = "cpu", engine: str = "auto"
) -> DSNetSegmenter:
    """The segmenter of a weights file or of a name of `SHIPPED`; None: dsnet.

    Raises:
        InputError: the file is missing, damaged or not a DS-Net of dsmap, or there is no such engine here.
    """
    model, info = load_weights(weights or "dsnet")
    return DSNetSegmenter(model, info, device, engine)
