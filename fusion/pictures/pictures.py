"""The pictures of a run: the map from outside in several colourings, the trajectory, a strip of frames."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from dsmap.classes import NUM_CLASSES, PALETTE, VOID, colourise
from dsmap.frame import Frame, Intrinsics
from dsmap.fusion.objects.boxes import EDGES
from dsmap.fusion.objects.files import NamedBox
from dsmap.fusion.pictures import plots
from dsmap.fusion.pictures.shading import BACKGROUND, render, shaded_image
from dsmap.fusion.pictures.viewpoint import View, level_axes, overview, up_direction
from dsmap.kernels.types import SurfelMap
from dsmap.metrics import align_se3, ate_rmse

if TYPE_CHECKING:
    from dsmap.fusion.mapper import TrajectoryPoint

_SIZE = (1280, 960)
"""Width and height of the pictures of a whole map [px]."""
_SUPERSAMPLE = 2
_LEGEND_SHARE = 5e-4
"""Classes with a smaller share of the picture are left out of its legend."""


@dataclass(frozen=True)
class StripFrame:
    """A frame for the strip picture."""

    frame: Frame
    T_world_camera: np.ndarray
    """Estimated pose, shape (4, 4)."""
    predicted: np.ndarray | None = None
    """Class ids that the network alone gave, uint8, shape (h, w)."""


class Overview:
    """One rendering of a whole map from outside, painted in several colourings."""

    def __init__(
        self,
        surfels: SurfelMap,
        poses: np.ndarray,
        min_weight: float = 0.0,
        size: tuple[int, int] = _SIZE,
        up: np.ndarray | None = None,
    ) -> None:
        """Pick the view and render it.

        Args:
            surfels: the map; must hold a surfel of `min_weight`.
            poses: T_world_camera of the frames, shape (M, 4, 4).
            size: width and height of the pictures [px].
            up: in the world's frame, shape (3,); None: by normals and poses.
        """
        self.arrays = surfels.numpy()
        self.size = size
        width, height = size[0] * _SUPERSAMPLE, size[1] * _SUPERSAMPLE
        kept = self.arrays["weight"] >= max(min_weight, 1e-6)
        chosen = {name: self.arrays[name][kept] for name in ("position", "normal", "radius")}
        self.view = overview(chosen, poses, width, height, up=up)
        self.rendering = render(surfels, self.view, min_weight)

    def picture(self, colours: np.ndarray, shading: float, path: np.ndarray | None = None) -> np.ndarray:
        """The overview in the given surfel colours, uint8 (N, 3), with the camera path (M, 3) drawn in."""
        image = shaded_image(self.rendering, colours, shading)
        if path is not None and len(path) > 1:
            self._draw_path(image, path)
        return cv2.resize(image, self.size, interpolation=cv2.INTER_AREA)

    def with_boxes(self, colours: np.ndarray, boxes: Sequence[NamedBox]) -> np.ndarray:
        """The overview in the given surfel colours with boxes in the colours of their classes, and their names."""
        image = shaded_image(self.rendering, colours, 0.35)
        T, K = np.linalg.inv(self.view.T_world_camera), self.view.intrinsics.K
        for one in boxes:
            points = one.box.corners() @ T[:3, :3].T + T[:3, 3]
            if points[:, 2].min() <= 0.01:
                continue
            pixels = points @ K.T
            pixels = np.rint(pixels[:, :2] / pixels[:, 2:]).astype(int)
            colour = PALETTE[one.label].tolist()
            for a, b in EDGES:
                cv2.line(image, pixels[a].tolist(), pixels[b].tolist(), colour, 4, cv2.LINE_AA)
            at = pixels[pixels[:, 1].argmin()] - [0, 8]
            for grey, thick in ((255, 9), (0, 3)):
                cv2.putText(
                    image,
                    one.name,
                    at.tolist(),
                    cv2.FONT_HERSHEY_SIMPLEX,
                    1.0,
                    (grey,) * 3,
                    thick,
                    cv2.LINE_AA,
                )
        return cv2.resize(image, self.size, interpolation=cv2.INTER_AREA)

    def _draw_path(self, image: np.ndarray, path: np.ndarray) -> None:
        T = np.linalg.inv(self.view.T_world_camera)
        points = path @ T[:3, :3].T + T[:3, 3]
        points = points[points[:, 2] > 0.01] @ self.view.intrinsics.K.T
        pixels = np.rint(16 * points[:, :2] / points[:, 2:]).astype(np.int32)
        cv2.polylines(image, [pixels], False, (255, 255, 255), 9, cv2.LINE_AA, shift=4)
        cv2.polylines(image, [pixels], False, (214, 39, 40), 5, cv2.LINE_AA, shift=4)


def confidence_colours(weight: np.ndarray, low: float = 1.0) -> tuple[np.ndarray, float, float]:
    """Surfel confidence as viridis on a log scale from `low`: RGB uint8 (N, 3) and the scale's ends."""
    high = max(10.0 * low, float(np.percentile(weight, 99)) if len(weight) else 0.0)
    scaled = np.log(weight.clip(low, high) / low) / np.log(high / low)
    return plots.through_colour_map("viridis", scaled), low, high


def time_colours(time: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Frame numbers as turbo: RGB uint8 (N, 3) and the scale's ends."""
    low, high = (float(time.min()), float(time.max())) if len(time) else (0.0, 1.0)
    return plots.through_colour_map("turbo", (time - low) / max(high - low, 1.0)), low, max(high, low + 1)


def segment_colours(segment: np.ndarray) -> np.ndarray:
    """Segment numbers as colours that differ between neighbours: RGB uint8 (N, 3); 0 is grey."""
    table = np.random.default_rng(0).integers(40, 256, (1024, 3)).astype(np.uint8)
    table[0] = 90
    return table[np.where(segment > 0, 1 + segment % 1023, 0)]


def shown_weight(weight: np.ndarray, min_weight: float) -> float:
    """`min_weight`, or 0 if it left less than a third of the living surfels (a short recording)."""
    return min_weight if (weight >= min_weight).sum() >= (weight > 0).sum() / 3 else 0.0


def write_views(
    folder: Path,
    surfels: SurfelMap,
    poses: np.ndarray,
    min_weight: float = 0.0,
    up: np.ndarray | None = None,
    boxes: Sequence[NamedBox] = (),
) -> list[Path]:
    """Write `map_colour.png`, `map_label.png`, `map_segment.png`, `map_objects.png`, `map_confidence.png` and
    `map_time.png`.

    Args:
        surfels: the map; nothing is written if it has no surfel.
        poses: T_world_camera of the frames, shape (M, 4, 4).
        min_weight: surfels of a lower confidence are left out, unless that leaves less than a third.
        up: in the world's frame, shape (3,); None: by normals and poses.
        boxes: of the things of the map.

    Returns:
        The files written; those of labels, segments and objects only where there are any.
    """
    weight = surfels.numpy()["weight"]
    if not (weight > 0).any():
        return []
    min_weight = shown_weight(weight, min_weight)
    scene = Overview(surfels, poses, min_weight, up=up)
    arrays, path = scene.arrays, poses[:, :3, 3]
    paths = [folder / "map_colour.png"]
    plots.save_image(paths[0], scene.picture(_rgb(arrays), 0.35, path))
    if arrays["label"].any():
        paths.append(folder / "map_label.png")
        seen = scene.rendering.index[scene.rendering.index >= 0]
        pixels = np.bincount(arrays["label"][seen], minlength=NUM_CLASSES)
        present = np.flatnonzero(pixels > _LEGEND_SHARE * len(seen)).tolist()
        plots.save_with_legend(paths[-1], scene.picture(colourise(arrays["label"]), 0.8), present)
    if arrays["segment"].any():
        paths.append(folder / "map_segment.png")
        plots.save_image(paths[-1], scene.picture(segment_colours(arrays["segment"]), 0.8))
    if boxes:
        paths.append(folder / "map_objects.png")
        plots.save_image(paths[-1], scene.with_boxes(_rgb(arrays), boxes))
    for name, title, (colours, low, high), log in (
        ("confidence", "surfel confidence", confidence_colours(weight, max(1.0, min_weight)), True),
        ("time", "frame of the first observation", time_colours(arrays["t_created"]), False),
    ):
        paths.append(folder / f"map_{name}.png")
        cmap = "viridis" if log else "turbo"
        plots.save_with_bar(paths[-1], scene.picture(colours, 0.8), cmap, low, high, log, title)
    return paths


def write_strip(
    path: Path, surfels: SurfelMap, intrinsics: Intrinsics, strip_frames: Sequence[StripFrame]
) -> None:
    """Write the strip: one row a frame: colour, labels (true, the network's, the map's) and their overlay.

    Without any labelled surfel the map is shown by colour.
    """
    arrays = surfels.numpy()
    labelled = bool(arrays["label"].any())
    with_truth = any(item.frame.label is not None for item in strip_frames)
    with_network = any(item.predicted is not None for item in strip_frames)
    rows: list[list[plots.Tile]] = []
    present: set[int] = set()
    for item in strip_frames:
        index = render(surfels, View(intrinsics, item.T_world_camera)).index
        seen = index >= 0
        ids = np.full(index.shape, VOID, np.uint8)
        ids[seen] = arrays["label"][index[seen]]
        columns: list[tuple[str, np.ndarray | None]] = (
            [("ground truth", item.frame.label)] if with_truth else []
        )
        columns += [("network alone", item.predicted)] if with_network else []
        columns += [("map", ids)] if labelled else []
        present.update(*(np.unique(column).tolist() for _, column in columns if column is not None))
        row: list[plots.Tile] = [("frame", item.frame.rgb)]
        row += [(title, None if column is None else colourise(column)) for title, column in columns]
        if labelled:
            mixed = cv2.addWeighted(item.frame.rgb, 0.45, colourise(ids), 0.55, 0)
            row.append(("map over frame", np.where(ids[..., None] != VOID, mixed, item.frame.rgb)))
        else:
            colours = _rgb(arrays)
            image = np.full((*index.shape, 3), BACKGROUND, np.uint8)
            image[seen] = colours[index[seen]]
            row.append(("map", image))
        rows.append(row)
    plots.save_grid(path, rows, sorted(present - {VOID}))


def write_trajectory_picture(
    path: Path,
    normal: np.ndarray,
    trajectory: Sequence["TrajectoryPoint"],
    reference: Sequence[np.ndarray | None] | None = None,
    up: np.ndarray | None = None,
) -> None:
    """Write the camera path from above and from the side, the reference's path aligned to it (SE(3)).

    Args:
        normal: surfel normals, shape (N, 3); with the cameras they tell which way is up.
        trajectory: at least one point.
        reference: reference pose of each point, T_world_camera or None; or None if there is no reference.
        up: in the world's frame, shape (3,); None: by normals and poses.
    """
    poses = np.array([point.T_world_camera for point in trajectory])
    axes = level_axes(normal, up_direction(normal, poses) if up is None else up)
    centres = poses[:, :3, 3]
    length = float(np.linalg.norm(np.diff(centres, axis=0), axis=1).sum())
    lost = np.array([not point.tracked for point in trajectory])
    title = f"{len(poses)} frames, {int(lost.sum())} lost, path {length:.2f} m"
    pairs = [(T, given) for T, given in zip(poses, reference or [], strict=False) if given is not None]
    if len(pairs) < 3:
        plots.save_trajectory(path, centres @ axes.T, lost, None, title)
        return
    estimated, given = (np.array(side) for side in zip(*pairs, strict=True))
    T_estimate_given = align_se3(given[:, :3, 3], estimated[:, :3, 3])
    aligned = given[:, :3, 3] @ T_estimate_given[:3, :3].T + T_estimate_given[:3, 3]
    title += f", ATE {100 * ate_rmse(estimated, given):.2f} cm"
    plots.save_trajectory(path, centres @ axes.T, lost, aligned @ axes.T, title)


def write_pictures(
    run_dir: Path,
    surfels: SurfelMap,
    trajectory: Sequence["TrajectoryPoint"],
    intrinsics: Intrinsics,
    strip_frames: Sequence[StripFrame],
    reference_trajectory: Sequence[np.ndarray | None] | None = None,
    stable_weight: float = 10.0,
    up: np.ndarray | None = None,
    boxes: Sequence[NamedBox] = (),
) -> list[Path]:
    """Write all pictures of a run into `run_dir/pictures`: the map, the trajectory, the strip.

    Args:
        surfels: the finished map; without surfels only the trajectory and the strip are drawn.
        trajectory: of the mapper; may be empty.
        intrinsics: camera of the strip's frames.
        strip_frames: a few frames over the sequence; may be empty.
        reference_trajectory: reference pose of each point of the trajectory, T_world_camera or None.
        stable_weight: surfels below this confidence are left out of the overviews.
        up: in the world's frame, shape (3,); None: by normals and poses.
        boxes: of the things of the map.

    Returns:
        The files written.

    Raises:
        InputError: the folder cannot be written.
    """
    folder = Path(run_dir) / "pictures"
    poses = np.array([point.T_world_camera for point in trajectory], dtype=np.float64).reshape(-1, 4, 4)
    written = write_views(folder, surfels, poses, stable_weight, up, boxes)
    if len(poses):
        written.append(folder / "trajectory.png")
        write_trajectory_picture(written[-1], surfels.numpy()["normal"], trajectory, reference_trajectory, up)
    if strip_frames:
        written.append(folder / "strip.png")
        write_strip(written[-1], surfels, intrinsics, strip_frames)
    return written


def _rgb(arrays: dict[str, np.ndarray]) -> np.ndarray:
    return np.rint(arrays["colour"].clip(0, 1) * 255).astype(np.uint8)
