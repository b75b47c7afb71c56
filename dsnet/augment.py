"""Random changes to a training image: one affine map for image and labels, one colour map, blur, noise."""

import cv2
import numpy as np

from dsmap.classes import VOID
from dsmap.dsnet.config import AugmentConfig

_GREY = (127, 127, 127)
"""Colour outside the image: zero for the network (see `to_input`)."""
_TO_GREY = np.full((3, 3), 1 / 3, np.float32)


def augment(
    rgb: np.ndarray, label: np.ndarray, size: tuple[int, int], config: AugmentConfig, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """A random view of a labelled image.

    Args:
        rgb: uint8, shape (h, w, 3); label: class ids, uint8, shape (h, w).
        size: (width, height) of the result.

    Returns:
        image, uint8 (height, width, 3), and its labels at half that size (the network's output), uint8
        (height / 2, width / 2); void outside the given image.
    """
    A = random_affine((rgb.shape[1], rgb.shape[0]), size, config, rng)
    image = warp_image(rgb, A, size)
    half = scaling(0.5, 0.5) @ A
    labels = cv2.warpAffine(
        label, half[:2], (size[0] // 2, size[1] // 2), flags=cv2.INTER_NEAREST, borderValue=VOID
    )
    image = jitter_colour(image, config, rng)
    if rng.random() < config.blur:
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.3, 1.5))
    if rng.random() < config.noise:
        noise = rng.standard_normal(image.shape, dtype=np.float32) * rng.uniform(2, 12)
        image = np.clip(image + noise, 0, 255).astype(np.uint8)
    return image, labels


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
