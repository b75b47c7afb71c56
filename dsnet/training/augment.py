"""Random changes to a training image: one affine map for image and labels, one colour map, blur, noise."""

import cv2
import numpy as np

from dsmap.classes import VOID
from dsmap.dsnet.config import AugmentConfig
from dsmap.dsnet.datasets.base import Example

_GREY = (127, 127, 127)
"""Colour outside the image: zero for the network (see `to_input`)."""
_NOISE = (0.15, 0.25, 0.15)
"""Largest spread of noise in inverse depth, cosine and height, in units of the channels."""
_FLOOR_ERROR = 0.15
"""Spread of the error of the floor's height, in units of the channel (0.8 m)."""
_FARTHEST = (-1.4, -0.45)
"""Inverse depth at which a far limit may lie, in units of the channel: 10 m to 3 m."""
_TO_GREY = np.full((3, 3), 1 / 3, np.float32)


def augment(
    example: Example, size: tuple[int, int], config: AugmentConfig, rng: np.random.Generator
) -> Example:
    """A random view of a labelled image.

    Args:
        size: (width, height) of the result.

    Returns:
        rgb, uint8 (height, width, 3); its labels at half that size (the network's output), uint8
        (height / 2, width / 2), void outside the given image; geometry, float16 (height, width, 4), 0 there.
        Geometry is metric: a zoom crops it and changes no value.
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
    if example.geometry is None:
        return Example(image, labels)
    seen = _warp_nearest(example.geometry.astype(np.float32), A, size)
    return Example(image, labels, degrade_geometry(seen, config, rng).astype(np.float16))


def degrade_geometry(geometry: np.ndarray, config: AugmentConfig, rng: np.random.Generator) -> np.ndarray:
    """Geometry as a worse camera would give it: none, with holes, with noise, above a floor that is not quite right.

    Args:
        geometry: float32, shape (H, W, 4), changed.
    """
    if rng.random() < config.drop_geometry:
        return np.zeros_like(geometry)
    there = geometry[..., 3]
    if rng.random() < config.geometry_noise:
        small = rng.standard_normal((there.shape[0] // 4, there.shape[1] // 4, 3)).astype(np.float32)
        noise = cv2.resize(small, there.shape[::-1], interpolation=cv2.INTER_LINEAR)
        geometry[..., :3] += noise * (rng.random(3) * _NOISE).astype(np.float32)
        geometry[..., 2] += rng.normal(0, _FLOOR_ERROR)
        geometry *= there[..., None]
    if rng.random() < config.holes:
        geometry *= _hole_mask(geometry, rng)[..., None]
    return geometry


def _hole_mask(geometry: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """0 in holes, 1 elsewhere, float32 (H, W): patches, edges of things, what is further than some distance."""
    height, width = geometry.shape[:2]
    keep = np.ones((height, width), np.float32)
    nearest_kept = geometry[..., 0] > rng.uniform(*_FARTHEST)  # inverse depth falls with distance
    if rng.random() < 0.7:
        keep *= nearest_kept
    cells = rng.integers(3, 24)
    patches = rng.random((cells, cells + cells // 3)).astype(np.float32)
    patches = cv2.resize(patches, (width, height), interpolation=cv2.INTER_CUBIC)
    keep[patches < rng.uniform(-0.2, 0.45)] = 0
    if rng.random() < 0.5:
        edges = np.abs(np.diff(geometry[..., 0], axis=1, append=geometry[:, -1:, 0])) > 0.2
        side = int(rng.integers(3, 9))
        keep[cv2.dilate(edges.astype(np.uint8), np.ones((side, side), np.uint8)) > 0] = 0
    return keep


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
