"""What trains in seconds: a tiny net, few steps, images whose colour tells the class."""

import hashlib

import cv2
import numpy as np

from dsmap.classes import PALETTE
from dsmap.dsnet.checkpoint import load_weights
from dsmap.dsnet.config import AugmentConfig, DSNetConfig, TrainConfig

TINY = DSNetConfig(layers=2, growth=4, widths=(8, 8, 8, 8), stem_convs=1, dropout=0.1)
MILD = AugmentConfig(scale=(0.9, 1.2), rotate=0, hue=0, saturation=0, white_balance=0, blur=0, noise=0)
CONFIG = TrainConfig(steps=12, batch=4, size=(64, 64), lr=1e-2, warmup=2, ema=0.5, validate_every=4)


def coloured_rectangles(path, count=8, seed=0):
    """Images whose colour tells the class: floor below, wall above, a box of a third class."""
    rng = np.random.default_rng(seed)
    for name in ("rgb", "label"):
        (path / name).mkdir(parents=True)
    for k in range(count):
        label = np.full((64, 64), 12, np.uint8)
        label[rng.integers(30, 45) :] = 5
        y, x = rng.integers(5, 35, 2)
        label[y : y + 24, x : x + 24] = rng.choice([1, 9])
        rgb = np.clip(PALETTE[label] + rng.normal(0, 5, (64, 64, 3)), 0, 255).astype(np.uint8)
        cv2.imwrite(str(path / "rgb" / f"{k}.png"), rgb[..., ::-1])
        cv2.imwrite(str(path / "label" / f"{k}.png"), label)
    return path


def weights_hash(path):
    """Of the tensors alone: the notes of a weights file hold the seconds it took."""
    model, _ = load_weights(path)
    digest = hashlib.sha256()
    for name, tensor in sorted(model.state_dict().items()):
        digest.update(name.encode() + tensor.numpy().tobytes())
    return digest.hexdigest()
