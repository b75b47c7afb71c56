"""Every kernel against its twin, on any device: `dsmap doctor`."""

from typing import Any

import numpy as np
import warp as wp

from dsmap.fusion.config import TrackConfig
from dsmap.fusion.lie import exp_se3, exp_so3
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.fusion.tracking.tracker import Tracker
from dsmap.kernels import filters, odometry, preprocess
from dsmap.kernels.associate import associate_surfels
from dsmap.kernels.compact import compact
from dsmap.kernels.coverage import MapView, find_uncovered, thin_out
from dsmap.kernels.culling import Blocks
from dsmap.kernels.fuse import fuse_frame
from dsmap.kernels.label import update_labels
from dsmap.kernels.label_smooth import smooth_probabilities
from dsmap.kernels.predict import predict_model
from dsmap.kernels.prune import prune
from dsmap.kernels.registration import Level, register_on_device
from dsmap.kernels.shutter import global_shutter
from dsmap.kernels.types import FrameMaps, ModelMaps, SurfelMap
from dsmap.tools.twins import corner, images, surfels
from dsmap.tools.twins.check import Check, apart
from dsmap.tools.twins.map_checks import MAP_CHECKS
from dsmap.tools.twins.scene import CAMERA, TIME, frame_arrays, frame_maps, pose, softmax_image, surfel_map

_SHAPE = (CAMERA.height, CAMERA.width)
_SURFACE = ("vertex", "normal", "intensity")


def _scene(
    device: Any, seed: int = 1, count: int = 800
) -> tuple[np.ndarray, dict, FrameMaps, SurfelMap, wp.array]:
    """Pose, the frame's arrays and maps, surfels, and the match of both."""
    T, arrays = pose(seed), frame_arrays(seed)
    maps, m = frame_maps(arrays, device), surfel_map(T, count, seed, device=device)
    match = wp.full(_SHAPE, 0, dtype=wp.int32, device=device)
    associate_surfels(m, CAMERA, T, maps, match=match)
    return T, arrays, maps, m, match


def _rows(m: SurfelMap) -> dict[str, np.ndarray]:
    return {name: np.array(values) for name, values in m.numpy().items()}


def _of_surfels(m: SurfelMap, expected: dict[str, np.ndarray]) -> float:
    """Largest difference of maps; infinite where they have not the same number of surfels."""
    found = _rows(m)
    if len(found["weight"]) != len(expected["weight"]):
        return float("inf")
    return max(apart(found[name], expected[name]) for name in found)


def _bilateral(device: Any) -> float:
    depth = frame_arrays()["depth"]
    smooth = preprocess.smooth_depth(depth, wp.get_device(device))
    expected = images.bilateral(
        depth, preprocess.SIGMA_SPACE, preprocess.SIGMA_RANGE, filters.BILATERAL_RADIUS
    )
    return apart(smooth, expected)


def _frame(device: Any, T: np.ndarray | None = None) -> list[FrameMaps]:
    return preprocess.preprocess(
        *corner.room(np.eye(4) if T is None else T), corner.LEVEL_CAMERAS, wp.get_device(device)
    )


def _surface(device: Any) -> float:
    maps = _frame(device)[0]
    expected = images.surface(corner.LEVEL_CAMERAS[0], maps.depth.numpy())
    names = ("vertex", "normal", "radius", "edge")
    return max(apart(getattr(maps, name), e) for name, e in zip(names, expected, strict=True))


def _half_surface(device: Any) -> float:
    finest = _frame(device)[0]
    half = preprocess.half_surface(finest.vertex, finest.normal, finest.intensity)
    expected = images.half_surface(*(a.numpy() for a in (finest.vertex, finest.normal, finest.intensity)))
    return max(apart(got, e) for got, e in zip(half, expected, strict=True))


def _gradient(device: Any) -> float:
    finest = _frame(device)[0]
    expected = images.gradient(finest.intensity.numpy(), finest.vertex.numpy())
    return apart(odometry.gradient(finest.intensity, finest.vertex), expected)


def _of_equations(found: odometry.NormalEquations, rows: list) -> float:
    """Largest difference as a share of the largest entry."""
    A, b, squares, _ = images.normal_equations(rows)
    parts = [(found.A, A), (found.b, b), (np.array([found.squares]), np.array([squares]))]
    return max(float(np.abs(got - e).max() / np.abs(e).max()) for got, e in parts)


def _joint(device: Any) -> float:
    second = _frame(device, exp_se3(np.array([0.02, -0.01, 0.015, 0.01, 0.02, -0.01])))[1]
    first = _frame(device)[0]
    view = ModelView(first.vertex, first.normal, first.intensity, 3, np.eye(4)).level(1)
    gates = Tracker(TrackConfig(), corner.LEVEL_CAMERAS)._gates(1)
    T = exp_se3(np.array([0.01, 0.0, 0.005, 0.0, 0.01, 0.0]))
    found = odometry.joint_normal_equations(corner.LEVEL_CAMERAS[1], gates, second.surface, view)(T)
    arrays = [
        [getattr(s, n).numpy().astype(np.float64) for n in names]
        for s, names in ((second, _SURFACE), (view, (*_SURFACE, "gradient")))
    ]
    rows = images.joint_rows(corner.LEVEL_CAMERAS[1], T, gates, *arrays)
    return max(_of_equations(got, r) for got, r in zip(found, rows, strict=True))


def _registration(device: Any) -> float:
    """One step on the coarsest level: where the camera is then [m, rad]."""
    camera, tracker = corner.LEVEL_CAMERAS[2], Tracker(TrackConfig(), corner.LEVEL_CAMERAS)
    second = _frame(device, exp_se3(np.array([0.02, -0.01, 0.015, 0.01, 0.02, -0.01])))[2]
    first = _frame(device)[0]
    view = ModelView(first.vertex, first.normal, first.intensity, 3, np.eye(4)).level(2)
    gates, config = tracker._gates(2), tracker.config
    found = register_on_device(
        [Level(camera, gates, second.surface, view, iterations=1, converged=0.0)], np.eye(4), w_rgb=config.w_rgb,
        rgb_balance=config.rgb_balance, held=0.0, from_metres=np.eye(6), coloured=True, prior=None, rows=None,
    )  # fmt: skip
    arrays = [
        [getattr(s, n).numpy().astype(np.float64) for n in names]
        for s, names in ((second, _SURFACE), (view, (*_SURFACE, "gradient")))
    ]
    terms = [images.normal_equations(r) for r in images.joint_rows(camera, np.eye(4), gates, *arrays)]
    means = [squares / count for _, _, squares, count in terms]
    w = min(config.w_rgb, config.rgb_balance * means[0] / means[1])
    (A, b, *_), (A_rgb, b_rgb, *_) = terms
    xi = np.linalg.solve(A + w * A_rgb, b + w * b_rgb)
    return float("inf") if found is None else float(np.abs(found[0] - exp_se3(xi)).max())


def _rotation(device: Any) -> float:
    first, second = _frame(device)[2], _frame(device, exp_se3(np.array([0, 0, 0, 0.01, 0.03, -0.01])))[2]
    R, slope = exp_so3(np.array([0.0, 0.01, 0.0])), odometry.gradient(first.intensity)
    found = odometry.rotation_normal_equations(
        corner.LEVEL_CAMERAS[2], second.intensity, first.intensity, slope
    )(R)
    arrays = [a.numpy() for a in (second.intensity, first.intensity, slope)]
    return _of_equations(found, images.rotation_rows(corner.LEVEL_CAMERAS[2], R, *arrays))


def _shutter(device: Any) -> float:
    maps = preprocess.preprocess(*corner.rolled(np.eye(4)), corner.LEVEL_CAMERAS, wp.get_device(device))[0]
    found = global_shutter(corner.LEVEL_CAMERAS[0], maps, corner.TWIST, corner.READOUT)
    names = ("vertex", "normal", "intensity", "depth", "radius", "colour", "edge")
    before = {name: getattr(maps, name).numpy().astype(np.float64) for name in names}
    expected = images.global_shutter(corner.LEVEL_CAMERAS[0], before, corner.TWIST, corner.READOUT)
    return max(apart(getattr(found, name), expected[name]) for name in names)


def _associate(device: Any) -> float:
    T, arrays, _, m, match = _scene(device)
    return apart(match, surfels.associate_surfels(_rows(m), CAMERA, T, arrays))


def _fuse(device: Any) -> float:
    T, arrays, maps, m, match = _scene(device)
    expected = surfels.fuse_frame(_rows(m), CAMERA, T, arrays, match.numpy(), time=TIME)
    fuse_frame(m, CAMERA, T, maps, match, time=TIME)
    return _of_surfels(m, expected)


def _predict(device: Any) -> float:
    T, _, _, m, _ = _scene(device)
    maps = ModelMaps.empty(*_SHAPE, device)
    predict_model(m, CAMERA, T, max_depth=3.0, maps=maps, stable_weight=10.0)
    index = surfels.render_index(_rows(m), CAMERA, T, max_depth=3.0, stable_weight=10.0)
    expected = surfels.predict_model(_rows(m), CAMERA, T, index)
    return max(apart(maps.index, index), *(apart(getattr(maps, name), e) for name, e in expected.items()))


def _coverage(device: Any) -> float:
    T, arrays, maps, m, match = _scene(device)
    seen, is_new = ModelMaps.empty(*_SHAPE, device), wp.full(_SHAPE, 0, dtype=wp.int32, device=device)
    predict_model(m, CAMERA, T, max_depth=3.0, maps=seen, resolution=0.07)
    find_uncovered(CAMERA, T, maps, match, 0.07, MapView(CAMERA, T, seen.vertex, seen.normal), is_new)
    view = (CAMERA, T, seen.vertex.numpy(), seen.normal.numpy())
    new = apart(is_new, surfels.find_uncovered(CAMERA, T, arrays, match.numpy(), 0.07, view))
    expected = surfels.thin_out(_rows(m), CAMERA, arrays["vertex"], match.numpy(), 0.08)
    thin_out(m, CAMERA, maps, match, 0.08)
    return max(new, apart(_rows(m)["weight"], expected))


def _prune(device: Any) -> float:
    T, arrays, maps, m, match = _scene(device)
    options: dict[str, Any] = {"time": TIME, "t_min": 10}
    expected = surfels.prune(_rows(m), CAMERA, T, arrays["depth"], arrays["edge"], match.numpy(), **options)
    prune(m, CAMERA, T, maps, match, **options)
    return apart(_rows(m)["weight"], expected)


def _compact(device: Any) -> float:
    _, _, _, m, _ = _scene(device)
    before = _rows(m)
    expected = {name: values[before["weight"] > 0] for name, values in before.items()}
    compact(m)
    return _of_surfels(m, expected)


def _culling(device: Any) -> float:
    """Surfels in view that lie in blocks which are not walked."""
    T, _, _, m, _ = _scene(device, count=3000)
    walked = Blocks(m, 10.0).visible(CAMERA, T, 3.0).numpy()
    rows = _rows(m)
    position, _ = surfels.into_camera(T, rows)
    seen = [
        i for i, p in enumerate(position) if rows["weight"][i] > 0 and p[2] < 3 and surfels.pixel(CAMERA, p)
    ]
    return float(np.count_nonzero(~np.isin(np.array(seen) // 256, walked)))


def _labels(device: Any) -> float:
    T, arrays, maps, m, _ = _scene(device)
    p, options = softmax_image(0, 30, 40), {"rule": "geometric", "floor": 0.01, "sureness": 2.0}
    expected = surfels.update_labels(_rows(m), CAMERA, T, arrays["depth"], arrays["edge"], p, **options)
    update_labels(m, CAMERA, T, maps, p, **options)
    return _of_surfels(m, expected)


def _smooth(device: Any) -> float:
    arrays, maps, p = frame_arrays(), frame_maps(frame_arrays(), device), softmax_image(0, 24, 32)
    found = smooth_probabilities(p, CAMERA, maps.vertex, maps.normal, radius=0.1).numpy().reshape(24, 32, 14)
    expected = surfels.smooth_probabilities(p, CAMERA, arrays["vertex"], arrays["normal"], 0.1)
    return apart(np.nan_to_num(found), np.nan_to_num(expected))


CHECKS: dict[str, Check] = {
    "bilateral filter": Check(_bilateral, 1e-3),  # OpenCV tabulates the weights
    "vertex, normal, radius, edge": Check(_surface, 1e-4),
    "half surface": Check(_half_surface, 1e-5),
    "gradient": Check(_gradient, 1e-5),
    "joint normal equations": Check(_joint, 0.02),
    "registration": Check(_registration, 1e-4),
    "rotation normal equations": Check(_rotation, 1e-3),
    "rolling shutter": Check(_shutter, 1e-4),
    "association": Check(_associate, 0.0),
    "fusion": Check(_fuse, 3e-5),
    "prediction": Check(_predict, 1e-4),
    "coverage": Check(_coverage, 0.0),
    "clean-up": Check(_prune, 1e-5),
    "compaction": Check(_compact, 0.0),
    "culling": Check(_culling, 0.0),
    "label fusion": Check(_labels, 5e-5),
    "label smoothing": Check(_smooth, 1e-5),
    **MAP_CHECKS,
}
"""By the name that a report gives them."""
