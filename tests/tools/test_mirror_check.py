"""What is said of a recording before it is mapped: is depth mirrored?"""

import numpy as np
import pytest
from sequence_files import CAMERA

from dsmap.sequences import SequenceWriter, open_sequence
from dsmap.tools.support.mirror_check import mirror_warnings

CHANGES = {
    "": lambda image: image,
    "left and right": lambda image: image[:, ::-1],
    "upside down": lambda image: image[::-1],
    "turned by half a turn": lambda image: image[::-1, ::-1],
}


def patches(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Bright patches at other depths before a dark wall of 2 m: colour, and depth [m]."""
    rng = np.random.default_rng(seed)
    rgb, depth = rng.integers(0, 60, (48, 64, 3), dtype=np.uint8), np.full((48, 64), 2.0, np.float32)
    for _ in range(5):
        y, x = rng.integers(0, 40), rng.integers(0, 56)
        rgb[y : y + 7, x : x + 6] = rng.integers(80, 255, 3)
        depth[y : y + 7, x : x + 6] = rng.uniform(0.8, 1.5)
    return rgb, depth


@pytest.mark.parametrize("name", CHANGES)
def test_mirrored_depth_is_said(name, tmp_path):
    with SequenceWriter(tmp_path / "s", CAMERA, 1000.0) as writer:
        for k in range(6):
            rgb, depth = patches(k)
            writer.write(k / 30, rgb, CHANGES[name](depth))
    found = mirror_warnings(open_sequence(tmp_path / "s"))
    assert [f"({name})" in text for text in found] == ([True] if name else [])


def test_depth_without_edges_says_nothing(tmp_path):
    with SequenceWriter(tmp_path / "s", CAMERA, 1000.0) as writer:
        writer.write(0.0, patches(0)[0], np.full((48, 64), 2.0, np.float32))
    assert not mirror_warnings(open_sequence(tmp_path / "s"))
