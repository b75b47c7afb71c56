"""Lens distortion by OpenCV's models: names, points and images."""

import cv2
import numpy as np
import pytest

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.lens import MODELS, coefficients, model_named, model_of, undistort_maps, undistort_points
from dsmap.sequences import SequenceWriter, open_sequence

LENSES = {
    "radtan": (-0.28, 0.07, 0.001, -0.002, 0.0),
    "rational": (0.4, -2.5, 0.0004, -0.0003, 1.4, 0.3, -2.3, 1.3),
    "fisheye": (0.04, -0.01, 0.006, -0.002),
}


def camera(model: str) -> Intrinsics:
    return Intrinsics(160, 120, 100.0, 101.0, 79.0, 60.5, LENSES[model])


def projected(points: np.ndarray, k: Intrinsics) -> np.ndarray:
    D, zero, at = np.array(k.distortion), np.zeros(3), points.reshape(-1, 1, 3)
    project = cv2.fisheye.projectPoints if model_of(k.distortion) == "fisheye" else None
    found = project(at, zero, zero, k.K, D)[0] if project else cv2.projectPoints(at, zero, zero, k.K, D)[0]
    return found[:, 0]


@pytest.mark.parametrize("model", LENSES)
def test_points_are_undone_and_images_straightened(model):
    k, rng = camera(model), np.random.default_rng(0)
    assert model_of(k.distortion) == model
    plane = rng.uniform(-0.6, 0.6, (40, 2))
    points = np.column_stack([plane, np.ones(40)])
    np.testing.assert_allclose(undistort_points(projected(points, k), k), plane, atol=1e-6)
    x, y = undistort_maps(k)
    ray = np.array([(30 - k.cx) / k.fx, (90 - k.cy) / k.fy, 1.0])
    np.testing.assert_allclose([x[90, 30], y[90, 30]], projected(ray, k)[0], atol=1e-3)


@pytest.mark.parametrize("model", LENSES)
def test_a_recording_keeps_its_lens(model, tmp_path):
    k = camera(model)
    with SequenceWriter(tmp_path / "s", k) as writer:
        for i in range(2):
            writer.write(i / 30, np.full((120, 160, 3), 90, np.uint8), np.ones((120, 160), np.float32))
    sequence = open_sequence(tmp_path / "s", undistort=True)
    assert open_sequence(tmp_path / "s").intrinsics == k and sequence.intrinsics.distortion is None
    assert sequence.frame(0).depth.any()


def test_names_of_other_programs():
    known = {"plumb_bob": "radtan", "Kannala-Brandt4": "fisheye", "rational_polynomial": "rational"}
    for name, model in known.items():
        assert model_named(name) == model
        found = coefficients(name, np.arange(1, 5) / 10)
        assert found is not None and len(found) == len(MODELS[model])
    assert model_named("pinhole") is None and coefficients("plumb_bob", (0, 0, 0, 0, 0)) is None
    assert model_of(coefficients("plumb_bob", LENSES["rational"])) == "rational", "ROS writes eight so, too"
    with pytest.raises(InputError, match="unknown distortion model 'thin_prism'"):
        coefficients("thin_prism", (0.1,))
    with pytest.raises(InputError, match="at most 4"):
        coefficients("fisheye", LENSES["rational"])
