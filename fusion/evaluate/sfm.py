"""A judge of poses that knows colour alone, over the whole recording: structure from motion (COLMAP).

Given poses of real recordings are often another program's: made from the same depth, with its errors. COLMAP sees no
depth and no given pose, so whether it agrees with one or the other says which to believe, and a recording without
any ground truth gets a reference. It is no truth itself: it takes the colour camera as calibrated, and shutters that
read line by line as instant.
"""

import tempfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.fusion.pictures.plots import save_image
from dsmap.fusion.runs.read_run import evenly_spread
from dsmap.metrics import ate_rmse
from dsmap.sequences import Sequence
from dsmap.sequences.images import Undistorter, read_colour

_FRAMES = 120
"""Images looked at, at most, evenly spread: each is matched with every other."""
_FEATURES = 3000
"""SIFT features of an image, at most."""
_CONTRAST = 0.004
"""Fainter ones than usual: indoor walls have few."""
_MIN_REGISTERED = 0.5
"""A model with fewer of the images says nothing about the whole motion."""
_MIN_SHARED = 0.1
"""Successive images that share fewer points are two parts of the model, joined where a pattern repeats: a rendered
bedroom was folded over by 90 degrees so, each half of it perfect. Elsewhere neighbours share 57 % and more."""


@dataclass(frozen=True)
class Structure:
    """What structure from motion found."""

    T_model_color: dict[int, np.ndarray]
    """Poses of the colour camera by frame, shape (4, 4), in a frame and a unit of length of their own."""
    reprojection_px: float
    """Mean distance of the points from where the images show them [px]."""
    shared: dict[tuple[int, int], float]
    """Share of the points of an image, or of the next one if that has fewer, which both see; by their frames."""


def structure_from_motion(reference: Sequence, frames: list[int]) -> Structure | None:
    """COLMAP's largest model of the colour images of some frames, or None if it finds none.

    Args:
        reference: the recording; its calibration is kept, lens distortion is taken out.
        frames: which; damaged images are left out.

    Raises:
        ModuleNotFoundError: without pycolmap.
    """
    with tempfile.TemporaryDirectory(prefix="dsmap-sfm-") as folder:
        images = Path(folder) / "images"
        images.mkdir()
        _write_images(reference, frames, images)
        models = _colmap(images, reference.calibration.stored_colour)
    if not models:
        return None
    model = max(models, key=lambda m: m.num_reg_images())
    poses, points = {}, {}
    for image in model.images.values():
        if image.has_pose:
            frame = int(Path(image.name).stem)
            T_color_model = np.vstack([image.cam_from_world().matrix(), (0, 0, 0, 1)])
            poses[frame] = np.linalg.inv(T_color_model)
            points[frame] = {point.point3D_id for point in image.points2D if point.has_point3D()}
    shared = {
        (a, b): len(points[a] & points[b]) / max(1, min(len(points[a]), len(points[b])))
        for a, b in pairwise(sorted(points))
    }
    return Structure(poses, float(model.compute_mean_reprojection_error()), shared)


def sfm_table(
    reference: Sequence, poses: dict[int, np.ndarray], given: dict[int, np.ndarray]
) -> dict[str, Any]:
    """How far estimated and given poses are from those of structure from motion.

    Args:
        poses, given: T_world_camera by frame of the reference; `given` may be empty.

    Returns:
        `estimated_rmse_m`, `given_rmse_m`: RMS distance of the colour camera's centres after the best similarity
        transform; `frames`, `registered`, `reprojection_px`. None where nothing can be said, with a `reason`.
    """
    known = sorted(poses)
    frames = [known[k] for k in evenly_spread(len(known), _FRAMES)]
    structure = structure_from_motion(reference, frames)
    table: dict[str, Any] = {
        "estimated_rmse_m": None,
        "given_rmse_m": None,
        "frames": len(frames),
        "registered": len(structure.T_model_color) if structure else 0,
        "reprojection_px": structure.reprojection_px if structure else None,
    }
    if structure is None:
        return table | {"reason": "COLMAP found no model"}
    if reason := _unusable(structure, len(frames)):
        return table | {"reason": reason}
    T_frame_color = np.linalg.inv(reference.calibration.T_color_frame)
    for name, trajectory in (("estimated_rmse_m", poses), ("given_rmse_m", given)):
        both = sorted(structure.T_model_color.keys() & trajectory.keys())
        if len(both) >= 3:
            theirs = np.array([structure.T_model_color[i] for i in both])
            ours = np.array([trajectory[i] for i in both]) @ T_frame_color
            table[name] = ate_rmse(theirs, ours, scale=True)
    return table


def _unusable(structure: Structure, frames: int) -> str:
    """Why a model says nothing about the motion, in a sentence; empty if it does."""
    registered = len(structure.T_model_color)
    if registered < max(3, _MIN_REGISTERED * frames):
        return f"COLMAP found the poses of {registered} of {frames} images"
    torn = [pair for pair, share in structure.shared.items() if share < _MIN_SHARED]
    if torn:
        return (
            f"COLMAP's model is torn between frames {torn[0][0]} and {torn[0][1]}, which share hardly a point"
        )
    return ""


def _write_images(reference: Sequence, frames: list[int], folder: Path) -> None:
    """Colour images without lens distortion, named by the frame."""
    camera = reference.calibration.stored_colour
    undistorter = Undistorter(camera) if camera.distortion else None
    for i in frames:
        try:
            rgb = read_colour(reference.entries[i].rgb)
        except InputError:
            continue  # a damaged frame says nothing about the motion
        save_image(folder / f"{i:06d}.png", undistorter.colour(rgb) if undistorter else rgb)


def _colmap(images: Path, camera: Intrinsics) -> list[Any]:
    """The models (pycolmap.Reconstruction) of a folder of images that one camera without distortion took."""
    import pycolmap

    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
    database, where = images.parent / "database.db", pycolmap.Device.cpu
    # The centre of COLMAP's first pixel is (0.5, 0.5).
    pinhole = f"{camera.fx},{camera.fy},{camera.cx + 0.5},{camera.cy + 0.5}"
    reader = pycolmap.ImageReaderOptions(camera_model="PINHOLE", camera_params=pinhole)
    features = pycolmap.FeatureExtractionOptions(use_gpu=False)
    features.sift.max_num_features, features.sift.peak_threshold = _FEATURES, _CONTRAST
    pycolmap.extract_features(
        database, images, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader,
        extraction_options=features, device=where,
    )  # fmt: skip
    matching = pycolmap.FeatureMatchingOptions(use_gpu=False)
    pycolmap.match_exhaustive(database, matching_options=matching, device=where)
    mapping = pycolmap.IncrementalPipelineOptions(
        ba_refine_focal_length=False, ba_refine_extra_params=False, random_seed=0
    )
    return list(pycolmap.incremental_mapping(database, images, images.parent, options=mapping).values())
