"""A trained network as the mapper's segmenter: a frame in, class probabilities out."""

from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from torch import nn

from dsmap.dsnet.checkpoint import DEFAULT, WeightsInfo, load_weights
from dsmap.dsnet.config import GEOMETRY_CHANNELS
from dsmap.dsnet.inference.engines import Engine, OnnxEngine, TorchEngine, choose_engine
from dsmap.errors import InputError
from dsmap.frame import Frame, FrameGeometry
from dsmap.sequences.images import resize_colour, resize_nearest

_STRETCH = 0.1
"""Largest log ratio of two aspect ratios that count as the same."""


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

        (h, w) is half the size of `fitting_size`.

        Args:
            rgb: uint8 (H, W, 3).
            geometry: (H, W, 4) of `kernels.geometry`, any size; read by RGB-D networks only. None: colour alone.
        """
        return self.engine.probabilities(*self._inputs(rgb, geometry))

    def _inputs(self, rgb: np.ndarray, geometry: np.ndarray | None) -> tuple[np.ndarray, np.ndarray | None]:
        """Both at the working size; geometry only if the network reads it, then 0 where there is none."""
        if rgb.dtype != np.uint8 or rgb.ndim != 3 or rgb.shape[2] != 3:
            raise InputError(f"network: found an image of {rgb.dtype} {rgb.shape}, expected uint8 (H, W, 3)")
        size = fitting_size(self.info.size, rgb.shape[1], rgb.shape[0])
        image = np.ascontiguousarray(resize_colour(rgb, *size))
        if self.info.config.channels == 3:
            return image, None
        if geometry is None:
            return image, np.zeros((*image.shape[:2], GEOMETRY_CHANNELS), np.float32)
        return image, np.ascontiguousarray(resize_nearest(geometry, *size), dtype=np.float32)

    @property
    def wants_geometry(self) -> bool:
        """Whether the network reads geometry (see `dsmap.fusion.segmenter.GeometrySegmenter`)."""
        return self.info.config.channels > 3

    def __call__(self, frame: Frame, geometry: FrameGeometry | None = None) -> np.ndarray:
        return self.predict(frame.rgb, None if geometry is None else geometry.channels)


def fitting_size(size: tuple[int, int], width: int, height: int) -> tuple[int, int]:
    """The size at which a network sees an image: the working size, or one of its area and the image's shape.

    An image whose aspect ratio is nearly that of the working size is stretched a little; one on its side, or of
    another camera (16:9), gets multiples of 32 of its own.
    """
    wanted = width / height

    def stretch(candidate: tuple[int, int]) -> float:
        return abs(np.log(candidate[0] / candidate[1] / wanted))

    if stretch(size) <= _STRETCH:
        return size
    area = size[0] * size[1]
    sides = range(32, area // 32 + 1, 32)
    found = [
        (w, h) for w in sides for h in (round(w / wanted / 32) * 32,) if h and 0.75 * area < w * h <= area
    ]
    return min(found, key=lambda c: (stretch(c) > _STRETCH, -c[0] * c[1], stretch(c)), default=size)


def load_segmenter(
    weights: Path | str | None = None, device: str = "cpu", engine: str = "auto", prior: float | None = None
) -> DSNetSegmenter:
    """The segmenter of a weights file or of a name of `SHIPPED`; None: dsnet-p.

    Args:
        prior: class prior of the probabilities, 0 as frequent as in the training data to 1 all alike; None: as
            the weights say.

    Raises:
        InputError: the file is missing, damaged or not a DS-Net of dsmap, or there is no such engine here.
    """
    model, info = load_weights(weights or DEFAULT)
    if prior is not None:
        if not 0 <= prior <= 1:
            raise InputError(f"prior is {prior:g}, expected 0 (as in the data) to 1 (all classes alike)")
        info.prior = prior
    return DSNetSegmenter(model, info, device, engine)
