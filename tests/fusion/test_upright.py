"""Frames turned upright for a network, and back."""

import numpy as np
import pytest

from dsmap.frame import Frame, FrameGeometry
from dsmap.fusion.labels.upright import roll, segment_upright

RNG = np.random.default_rng(3)
FRAME = Frame(
    0, 0.0, RNG.integers(0, 256, (60, 80, 3), np.uint8), RNG.random((60, 80), np.float32) + 1, np.eye(4),
    RNG.integers(1, 14, (60, 80), np.uint8),
)  # fmt: skip


def up_at(degrees: float) -> np.ndarray:
    """Up of a camera, tilted a little, in whose image it lies this far to the right of the top."""
    a = np.deg2rad(degrees)
    return np.array([0.9 * np.sin(a), -0.9 * np.cos(a), -np.sqrt(1 - 0.81)])


class Mirror:
    """Says of every pixel the label that the frame has there."""

    wants_geometry = True

    def __call__(self, frame: Frame, geometry: FrameGeometry | None = None) -> np.ndarray:
        self.frame, self.geometry = frame, geometry
        return np.eye(14, dtype=np.float32)[frame.label]


def geometry(up: np.ndarray) -> FrameGeometry:
    return FrameGeometry(RNG.random((60, 80, 4), np.float32), up, -1.3)


@pytest.mark.parametrize("degrees", [0.0, 14.0, -14.0])
def test_a_level_frame_is_not_touched(degrees):
    given, mirror = geometry(up_at(degrees)), Mirror()
    out = segment_upright(mirror, FRAME, given, given.up)
    assert mirror.frame is FRAME and mirror.geometry is given
    np.testing.assert_array_equal(out, np.eye(14, dtype=np.float32)[FRAME.label])


@pytest.mark.parametrize("degrees, quarters", [(90, 1), (180, 2), (-90, 3), (100, 1), (-168, 2)])
def test_quarter_turns_are_exact(degrees, quarters):
    given, mirror = geometry(up_at(degrees)), Mirror()
    out = segment_upright(mirror, FRAME, given, given.up)
    np.testing.assert_array_equal(out, np.eye(14, dtype=np.float32)[FRAME.label])
    np.testing.assert_array_equal(mirror.frame.rgb, np.rot90(FRAME.rgb, quarters))
    np.testing.assert_array_equal(mirror.geometry.channels, np.rot90(given.channels, quarters))
    assert mirror.geometry.up[1] < -0.85
    R = mirror.frame.T_world_camera[:3, :3]
    np.testing.assert_allclose(R @ mirror.geometry.up, given.up, atol=1e-12)


def test_up_at_the_right_side_comes_to_the_top():
    mirror = Mirror()
    segment_upright(mirror, FRAME, None, np.array([1.0, 0, 0]))
    np.testing.assert_array_equal(mirror.frame.label[0], FRAME.label[:, -1])
    assert mirror.geometry is None


@pytest.mark.parametrize("degrees", [30.0, -40.0, 120.0])
@pytest.mark.parametrize("half", [False, True])
def test_what_remains_is_warped_and_warped_back(degrees, half):
    """Smooth labels come back where they were; what the warp cut off says nothing."""
    y, x = np.mgrid[:120, :160]
    label = (1 + x // 40 + 4 * (y // 60)).astype(np.uint8)
    frame = Frame(0, 0.0, np.zeros((120, 160, 3), np.uint8), np.ones((120, 160), np.float32), None, label)

    def network(frame, geometry=None):
        step = 2 if half else 1  # half the height, and at another aspect
        return np.eye(14, dtype=np.float32)[frame.label[step // 2 :: step, ::1]]

    network.wants_geometry = True
    out = segment_upright(network, frame, None, up_at(degrees))
    label = label[(1 if half else 0) :: 2 if half else 1] if degrees != 120 else label[:, :: 2 if half else 1]
    assert out.shape[:2] == label.shape
    seen = out[..., 1:].sum(axis=-1) > 0.99
    assert 0.6 < seen.mean() < 1
    assert (out.argmax(axis=-1) == label)[seen].mean() > 0.94
    assert (out.sum(axis=-1)[0, 0] == 0) and (out.sum(axis=-1)[-1, -1] == 0)


@pytest.mark.parametrize("up", [(0.0, 0.0, -1.0), (0.2, 0.1, 0.97)])
def test_looking_straight_down_nothing_is_turned(up):
    assert roll(np.array(up)) == (0, 0.0)


def test_no_labels_stay_none():
    def nothing(frame, geometry=None):
        return None

    assert segment_upright(nothing, FRAME, None, up_at(90)) is None
