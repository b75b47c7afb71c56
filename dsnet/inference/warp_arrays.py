"""Frames that are Warp arrays already: labelled where they lie, nothing copied in or out."""

import contextlib
from functools import lru_cache
from typing import Any

import torch
import torch.nn.functional as F
import warp as wp

from dsmap.dsnet.inference.predict import DSNetSegmenter


def predict_warp(segmenter: DSNetSegmenter, rgb: wp.array, depth: wp.array | None = None) -> wp.array:
    """`DSNetSegmenter.predict` by torch on Warp's arrays, in Warp's stream: no synchronisation on CUDA.

    Args:
        segmenter: on the arrays' device.
        rgb: uint8 (H, W, 3).
        depth: metres, float32 (H, W), 0 = no measurement; for RGB-D networks.

    Returns:
        float32 (h, w, classes); the memory is torch's, and the array keeps it alive.
    """
    width, height = segmenter.info.size
    with _on_stream_of(rgb):
        image = wp.to_torch(rgb)
        if image.shape[:2] != (height, width):
            image = _resize(image, height, width)
        metres = None if depth is None else wp.to_torch(depth)
        if metres is not None and metres.shape != (height, width):
            metres = F.interpolate(metres[None, None], size=(height, width), mode="nearest-exact")[0, 0]
        return wp.from_torch(segmenter.torch_engine.softmax(image, metres))


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
    if not array.device.is_cuda:
        return contextlib.nullcontext()
    return torch.cuda.stream(wp.stream_to_torch(wp.get_stream(array.device)))
