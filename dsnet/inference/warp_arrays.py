"""Frames that are Warp arrays already: labelled where they lie, nothing copied in or out."""

import contextlib
from functools import lru_cache
from typing import Any

import torch
import torch.nn.functional as F
import warp as wp

from dsmap.dsnet.config import GEOMETRY_CHANNELS
from dsmap.dsnet.inference.predict import DSNetSegmenter, fitting_size


def predict_warp(segmenter: DSNetSegmenter, rgb: wp.array, geometry: wp.array | None = None) -> wp.array:
    """`DSNetSegmenter.predict` by torch on Warp's arrays, in Warp's stream: no synchronisation on CUDA.

    Args:
        segmenter: on the arrays' device.
        rgb: uint8 (H, W, 3).
        geometry: float32 (H, W, 4) of `kernels.geometry`, read by RGB-D networks only. None: colour alone.

    Returns:
        float32 (h, w, classes); the memory is torch's, and the array keeps it alive.
    """
    width, height = fitting_size(segmenter.info.size, rgb.shape[1], rgb.shape[0])
    with _on_stream_of(rgb):
        image = wp.to_torch(rgb)
        if image.shape[:2] != (height, width):
            image = _resize(image, height, width)
        seen = _geometry(geometry, height, width, image.device) if segmenter.wants_geometry else None
        return wp.from_torch(segmenter.torch_engine.softmax(image, seen))


def _geometry(given: wp.array | None, height: int, width: int, device: torch.device) -> torch.Tensor:
    """At the network's size by the nearest pixel; 0 where there is none."""
    if given is None:
        return torch.zeros((height, width, GEOMETRY_CHANNELS), device=device)
    seen = wp.to_torch(given)
    if seen.shape[:2] == (height, width):
        return seen
    planes = seen.permute(2, 0, 1)[None]
    return F.interpolate(planes, size=(height, width), mode="nearest-exact")[0].permute(1, 2, 0)


def _resize(image: torch.Tensor, height: int, width: int) -> torch.Tensor:
    """`resize_colour` on any device, up to rounding; uint8 (H, W, 3) to uint8 (height, width, 3)."""
    x = image.permute(2, 0, 1).float()
    if height <= image.shape[0] and width <= image.shape[1]:
        rows, columns = _shares(image.shape[0], height), _shares(image.shape[1], width)
        x = rows.to(x.device) @ x @ columns.to(x.device).T
    else:
        x = F.interpolate(x[None], size=(height, width), mode="bilinear", align_corners=False)[0]
    return x.permute(1, 2, 0).round().clamp(0, 255).to(torch.uint8)


@lru_cache(maxsize=8)
def _shares(source: int, size: int) -> torch.Tensor:
    """How much of each new pixel each old one covers, shape (size, source), rows sum to 1."""
    scale = source / size
    start = torch.arange(size, dtype=torch.float64)[:, None] * scale
    pixel = torch.arange(source, dtype=torch.float64)[None]
    covered = torch.minimum(pixel + 1, start + scale) - torch.maximum(pixel, start)
    return (covered.clamp(min=0) / scale).float()


def _on_stream_of(array: wp.array) -> Any:
    if not wp.get_device(array.device).is_cuda:  # type: ignore[arg-type]  # an array has a device
        return contextlib.nullcontext()
    return torch.cuda.stream(wp.stream_to_torch(wp.get_stream(array.device)))
