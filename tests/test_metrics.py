"""Scores against values worked out by hand, and ATE against evo."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dsmap.metrics import (
    ConfusionMatrix,
    Reliability,
    align_se3,
    align_similarity,
    ate_rmse,
    class_probabilities,
    relative_pose_error,
)

PROGRAMS = Path(sys.executable).parent


def poses(positions: np.ndarray, rotations: Rotation | None = None) -> np.ndarray:
    """Camera-to-world poses, shape (N, 4, 4)."""
    T = np.tile(np.eye(4), (len(positions), 1, 1))
    T[:, :3, 3] = positions
    if rotations is not None:
        T[:, :3, :3] = rotations.as_matrix()
    return T


def rigid(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return poses(rng.normal(size=(1, 3)), Rotation.random(1, random_state=seed))[0]


def test_alignment_finds_the_rigid_transform():
    points, T = np.random.default_rng(0).normal(size=(20, 3)), rigid(1)
    np.testing.assert_allclose(align_se3(points, points @ T[:3, :3].T + T[:3, 3]), T, atol=1e-12)


def test_alignment_never_mirrors_nor_scales():
    points = np.random.default_rng(0).normal(size=(20, 3))
    T = align_se3(points, points * (-2, 2, 2))
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1)


def test_alignment_with_a_scale_finds_it_and_leaves_the_least_squares_under_noise():
    rng, T = np.random.default_rng(0), rigid(1)
    points = rng.normal(size=(20, 3))
    scale, found = align_similarity(points, 0.2 * points @ T[:3, :3].T + T[:3, 3])
    assert scale == pytest.approx(0.2)
    np.testing.assert_allclose(found, T, atol=1e-12)
    noisy = 0.2 * points @ T[:3, :3].T + T[:3, 3] + 0.02 * rng.normal(size=points.shape)

    def error(scale: float, T: np.ndarray) -> float:
        return float(((scale * points @ T[:3, :3].T + T[:3, 3] - noisy) ** 2).sum())

    scale, found = align_similarity(points, noisy)
    moved = found.copy()
    moved[0, 3] += 0.001
    assert error(scale, found) < min(
        error(1.01 * scale, found), error(0.99 * scale, found), error(scale, moved)
    )


def test_ate_by_hand():
    true = poses(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]))
    moved = rigid(2) @ true
    assert ate_rmse(moved, true) == pytest.approx(0, abs=1e-12)
    # Corners pushed up and down by 0.1 in turns: no rigid motion of the centres helps.
    bent = true.copy()
    bent[:, 2, 3] = (0.1, -0.1, 0.1, -0.1)
    assert ate_rmse(bent, true) == pytest.approx(0.1)
    assert ate_rmse(true + np.array([[0, 0, 0, 3.0]] + [[0] * 4] * 3), true, align=False) == pytest.approx(3)


def test_rpe_by_hand():
    times = np.arange(31) / 10
    true = poses(np.stack([times, 0 * times, 0 * times], axis=1))
    # 2 % too far a second, and 3 degrees of turn a second: both are the error over 1 s.
    estimated = poses(np.stack([1.02 * times, 0 * times, 0 * times], axis=1))
    assert relative_pose_error(times, estimated, true) == (pytest.approx(0.02), pytest.approx(0, abs=1e-6))
    turning = poses(np.zeros((31, 3)), Rotation.from_euler("z", 3 * times[:, None], degrees=True))
    translation, rotation = relative_pose_error(times, turning, poses(np.zeros((31, 3)))) or (None, None)
    assert (translation, rotation) == (pytest.approx(0), pytest.approx(np.deg2rad(3)))
    assert relative_pose_error(times[:5], true[:5], true[:5]) is None, "no second frame 1 s later"


def test_scores_by_hand():
    matrix = ConfusionMatrix()
    #                       bed bed bed bed books books void no-class
    matrix.add(np.array([1, 1, 1, 1, 2, 2, 0, 255]), np.array([1, 1, 1, 2, 2, 0, 1, 3]))
    scores = matrix.scores()
    assert matrix.total == 6
    assert scores["per_class"]["bed"] == {"recall": 0.75, "iou": 0.75, "pixels": 4}
    assert scores["per_class"]["books"] == {"recall": 0.5, "iou": pytest.approx(1 / 3), "pixels": 2}
    assert set(scores["per_class"]) == {"bed", "books"}, "absent classes are not averaged"
    assert scores["class_avg"] == pytest.approx((0.75 + 0.5) / 2)
    assert scores["pixel_acc"] == pytest.approx(4 / 6)
    assert scores["miou"] == pytest.approx((0.75 + 1 / 3) / 2)
    assert ConfusionMatrix().scores() == {"class_avg": None, "pixel_acc": None, "miou": None, "per_class": {}}


def test_ece_and_brier_by_hand():
    p = np.zeros((5, 13))
    p[:4, 0], p[:4, 1] = 0.9, 0.1  # four answers "bed" with 0.9: three are right
    p[4, 3] = 1.0  # and one void pixel that must not count
    reliability = Reliability()
    reliability.add(np.array([1, 1, 1, 2, 0]), p)
    assert reliability.ece() == pytest.approx(abs(3 / 4 - 0.9))
    assert reliability.brier() == pytest.approx((3 * (0.01 + 0.01) + (0.81 + 0.81)) / 4)
    # A second bin: two certain answers, one right. Bins weigh by their count.
    certain = np.eye(13)[[4, 4]]
    reliability.add(np.array([5, 6]), certain)
    assert reliability.ece() == pytest.approx((4 * 0.15 + 2 * 0.5) / 6)
    assert Reliability().ece() is None and Reliability().brier() is None


def test_bins_do_not_mix_over_and_under_confidence():
    reliability = Reliability()
    low, high = np.full(13, 0.5 / 12), np.full(13, 0.1 / 12)
    low[0], high[0] = 0.5, 0.9
    reliability.add(np.array([1, 1]), np.stack([low, low]))  # 0.5 and always right: off by 0.5
    reliability.add(np.array([2, 2]), np.stack([high, high]))  # 0.9 and always wrong: off by 0.9
    assert reliability.ece() == pytest.approx(0.7)


def test_void_is_taken_out_of_probabilities():
    p = np.zeros((2, 14))
    p[0, 0], p[0, 3] = 0.75, 0.25
    p[1, 0] = 1.0
    out = class_probabilities(p)
    assert out[0, 2] == pytest.approx(1) and out[0].sum() == pytest.approx(1)
    np.testing.assert_allclose(out[1], 1 / 13)


def test_ate_and_rpe_agree_with_evo(tmp_path):
    if not (PROGRAMS / "evo_ape").exists():
        pytest.skip("evo is not installed: pip install 'dsmap[bench]'")
    rng = np.random.default_rng(3)
    times = np.arange(60) / 30
    true = poses(np.cumsum(rng.normal(size=(60, 3)) * 0.01, axis=0), Rotation.random(60, random_state=1))
    estimated = rigid(4) @ true
    estimated[:, :3, 3] += rng.normal(size=(60, 3)) * 0.02
    for name, T in (("true", true), ("estimated", estimated)):
        quaternions = Rotation.from_matrix(T[:, :3, :3]).as_quat()
        np.savetxt(tmp_path / f"{name}.txt", np.column_stack([times, T[:, :3, 3], quaternions]), fmt="%.9f")
    assert evo("evo_ape", "-a", folder=tmp_path) == pytest.approx(ate_rmse(estimated, true), abs=2e-6)
    rpe = relative_pose_error(times, estimated, true)
    # evo steps by frames: 30 frames are 1 s here.
    found = evo("evo_rpe", "-d", "30", "-u", "f", "--all_pairs", folder=tmp_path)
    assert rpe is not None and found == pytest.approx(rpe[0], abs=2e-6)


def evo(program: str, *options: str, folder) -> float:
    """RMSE that an evo program prints for the two files in a folder."""
    command = [PROGRAMS / program, "tum", "true.txt", "estimated.txt", *options]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env={"HOME": str(folder)})
    match = re.search(r"rmse\s+([0-9.]+)", done.stdout)
    assert match, done.stdout + done.stderr
    return float(match[1])
