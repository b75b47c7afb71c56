"""Random changes to a training image: one affine map for image and labels, one colour map, blur, noise."""

import cv2
import numpy as np

from dsmap.classes import VOID
from dsmap.dsnet.config import AugmentConfig
from dsmap.dsnet.datasets.base import Example

_GREY = (127, 127, 127)
"""Colour outside the image: zero for the network (see `to_input`)."""
_TO_GREY = np.full((3, 3), 1 / 3, np.float32)


def augment(
    example: Example, size: tuple[int, int], config: AugmentConfig, rng: np.random.Generator
) -> Example:
    """A random view of a labelled image.

    Args:
        size: (width, height) of the result.

    Returns:
        rgb, uint8 (height, width, 3); its labels at half that size (the network's output), uint8
        (height / 2, width / 2), void outside the given image; depth, float32 (height, width), 0 there. A
        zoom makes things as much nearer as they look larger.
    """
    rgb = example.rgb
    source = (rgb.shape[1], rgb.shape[0])
    A = random_affine(source, size, config, rng)
    image = warp_image(rgb, A, size)
    labels = _warp_nearest(example.label, scaling(0.5, 0.5) @ A, (size[0] // 2, size[1] // 2))
    image = jitter_colour(image, config, rng)
    if rng.random() < config.blur:
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.3, 1.5))
    if rng.random() < config.noise:
        noise = rng.standard_normal(image.shape, dtype=np.float32) * rng.uniform(2, 12)
        image = np.clip(image + noise, 0, 255).astype(np.uint8)
    if example.depth is None:
        return Example(image, labels)
    fit = (size[0] / source[0]) * (size[1] / source[1])
    zoom = np.sqrt(abs(np.linalg.det(A[:2, :2])) / fit)
    return Example(image, labels, _warp_nearest(example.depth, A, size) / np.float32(zoom))


def _warp_nearest(values: np.ndarray, A: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Ids or depth under an affine map, never mixed; 0 (void, no measurement) outside."""
    return cv2.warpAffine(values, A[:2], size, flags=cv2.INTER_NEAREST, borderValue=VOID)


def scaling(sx: float, sy: float) -> np.ndarray:
    """Resizing as a map of integer pixel centres, shape (3, 3): x' = (x + 0.5) s - 0.5."""
    return np.array([[sx, 0, (sx - 1) / 2], [0, sy, (sy - 1) / 2], [0, 0, 1]])


def random_affine(
    source: tuple[int, int], size: tuple[int, int], config: AugmentConfig, rng: np.random.Generator
) -> np.ndarray:
    """Source pixels to result pixels, shape (3, 3): zoom, place or crop, flip, roll.

    Zoom 1 fits the whole image into `size`, as inference does.
    """
    zoom = np.exp(rng.uniform(*np.log(config.scale)))
    aspect = np.exp(rng.uniform(-config.aspect, config.aspect) / 2)
    zx, zy = zoom * aspect, zoom / aspect
    A = scaling(size[0] / source[0] * zx, size[1] / source[1] * zy)
    # Anywhere the window lies inside the image or, zoomed out, the image inside the window.
    place = np.eye(3)
    place[:2, 2] = rng.random(2) * (np.array(size) * (1 - np.array([zx, zy])))
    A = place @ A
    if rng.random() < config.flip:
        A = np.array([[-1, 0, size[0] - 1], [0, 1, 0], [0, 0, 1]]) @ A
    roll = np.eye(3)
    centre = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    roll[:2] = cv2.getRotationMatrix2D(centre, rng.uniform(-config.rotate, config.rotate), 1.0)
    return roll @ A


def warp_image(rgb: np.ndarray, A: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The image under an affine map, bilinear, smoothed first where it shrinks."""
    shrink = 1 / np.sqrt(abs(np.linalg.det(A[:2, :2])))
    if shrink > 1.3:
        rgb = cv2.GaussianBlur(rgb, (0, 0), 0.35 * shrink)
    return cv2.warpAffine(rgb, A[:2], size, flags=cv2.INTER_LINEAR, borderValue=_GREY)


def jitter_colour(rgb: np.ndarray, config: AugmentConfig, rng: np.random.Generator) -> np.ndarray:
    """Hue and saturation as one 3x3 colour matrix, the rest as one table a channel."""
    angle = np.deg2rad(rng.uniform(-config.hue, config.hue))
    turn = cv2.Rodrigues(np.full(3, angle / np.sqrt(3)))[0].astype(np.float32)  # about the grey axis
    saturation = 1 + rng.uniform(-config.saturation, config.saturation)
    matrix = (saturation * np.eye(3, dtype=np.float32) + (1 - saturation) * _TO_GREY) @ turn
    rgb = cv2.transform(rgb, matrix)
    gain = 1 + rng.uniform(-config.white_balance, config.white_balance, 3)
    gain *= 1 + rng.uniform(-config.brightness, config.brightness)
    contrast = 1 + rng.uniform(-config.contrast, config.contrast)
    gamma = np.exp(rng.uniform(-config.gamma, config.gamma))
    mean = rgb.mean() / 255
    levels = (np.arange(256)[:, None] / 255) ** gamma
    table = ((levels - mean**gamma) * contrast + mean**gamma) * gain
    return cv2.LUT(rgb, np.clip(table * 255 + 0.5, 0, 255).astype(np.uint8)[:, None])
