"""Pictures: the overview looks into the room from outside, and every file shows what its name says."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic_map import CEILING, FLOOR, TABLE, WALL, camera_path, map_of, room_arrays, room_map

from dsmap.classes import PALETTE
from dsmap.errors import InputError
from dsmap.frame import Frame, Intrinsics
from dsmap.fusion.mapper import TrajectoryPoint
from dsmap.fusion.pictures.pictures import (
    Overview,
    StripFrame,
    confidence_colours,
    write_pictures,
    write_views,
)
from dsmap.fusion.pictures.shading import render, shaded_image
from dsmap.fusion.pictures.viewpoint import View, level_axes, overview, up_direction

INTRINSICS = Intrinsics(160, 120, 130.0, 130.0, 79.5, 59.5)


def poses() -> np.ndarray:
    return np.array([row[1] for row in camera_path()])


def points() -> list[TrajectoryPoint]:
    return [TrajectoryPoint(*row) for row in camera_path()]


def test_up_is_found_with_tilted_cameras():
    arrays = room_arrays(0.06)
    tilt = Rotation.from_euler("x", 25, degrees=True).as_matrix()
    tilted = poses()
    tilted[:, :3, :3] = tilted[:, :3, :3] @ tilt
    assert up_direction(arrays["normal"], tilted) @ [0, 0, 1] > np.cos(np.radians(0.5))


def test_level_axes_follow_the_walls():
    turn = Rotation.from_euler("z", 31, degrees=True).as_matrix()
    axes = level_axes(room_arrays(0.06)["normal"] @ turn.T, np.array([0.0, 0.0, 1.0]))
    assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(axes) == pytest.approx(1)
    walls = np.abs(axes @ turn[:, 0])
    assert sorted(walls) == pytest.approx([0, 0, 1], abs=1e-3)


def test_overview_stands_outside_above_and_sees_everything():
    arrays = room_arrays()
    view = overview(arrays, poses(), 320, 240)
    eye = view.T_world_camera[:3, 3]
    assert eye[2] > 2.4, "above the ceiling"
    T = np.linalg.inv(view.T_world_camera)
    points = arrays["position"] @ T[:3, :3].T + T[:3, 3]
    pixels = points @ view.intrinsics.K.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    facing = (arrays["normal"] * (eye - arrays["position"])).sum(axis=1) > 0
    assert (points[:, 2] > 0).all()
    inside = ((pixels >= 0) & (pixels <= [319, 239])).all(axis=1)
    assert inside[facing].mean() > 0.98
    span = np.ptp(pixels[facing], axis=0) / [320, 240]
    assert 0.85 < span.max() <= 1.02, "the map fills the image"


def test_near_walls_and_ceiling_are_cut_away():
    surfels = room_map()
    scene = Overview(surfels, poses(), size=(320, 240))
    seen = scene.rendering.index[scene.rendering.index >= 0]
    labels = set(np.unique(scene.arrays["label"][seen]).tolist())
    assert labels == {FLOOR, TABLE, WALL}, "no ceiling"
    assert CEILING not in labels
    assert len(seen) > 0.25 * scene.rendering.index.size
    away = (
        scene.arrays["normal"][seen] * (scene.view.T_world_camera[:3, 3] - scene.arrays["position"][seen])
    ).sum(1)
    assert (away > 0).all()


def test_render_depth_and_paint():
    surfels = room_map()
    T = camera_path()[0][1]  # at x = 2.5, looks along +x to the wall at x = 4
    rendering = render(surfels, View(INTRINSICS, T))
    assert rendering.depth[60, 80] == pytest.approx(1.5, abs=1e-3)
    assert rendering.facing[60, 80] == pytest.approx(1, abs=0.02)
    image = shaded_image(rendering, PALETTE[surfels.numpy()["label"]], 0.0)
    assert image[60, 80].tolist() == PALETTE[WALL].tolist()
    assert (shaded_image(rendering, PALETTE[surfels.numpy()["label"]], 1.0) <= image).all()


def test_unstable_surfels_are_not_drawn():
    arrays = room_arrays(0.06)
    arrays["weight"][:] = 20
    arrays["weight"][arrays["label"] == TABLE] = 2
    surfels = map_of(arrays)
    index = Overview(surfels, poses(), min_weight=10, size=(160, 120)).rendering.index
    assert TABLE not in arrays["label"][index[index >= 0]]


def test_all_pictures_of_a_run(tmp_path):
    rgb = np.full((120, 160, 3), 128, np.uint8)
    depth = np.ones((120, 160), np.float32)
    rows = camera_path()
    strip = [
        StripFrame(
            Frame(i, rows[i][0], rgb, depth, label=np.full((120, 160), 9, np.uint8) if i else None),
            rows[i][1],
        )
        for i in (0, 10)
    ]
    reference = [None, *(np.linalg.inv(rows[0][1]) @ T for _, T, _ in rows[1:])]
    written = write_pictures(tmp_path, room_map(), points(), INTRINSICS, strip, reference)
    names = ["map_colour", "map_label", "map_segment", "map_confidence", "map_time", "trajectory", "strip"]
    assert [path.name for path in written] == [f"{name}.png" for name in names]
    for path in written:
        image = cv2.imread(str(path))
        assert image.shape[1] == 1280
        assert image.std() > 5, f"{path.name} is empty"
    labels = cv2.imread(str(tmp_path / "pictures/map_label.png"))[..., ::-1]
    assert (labels == PALETTE[TABLE]).all(axis=2).any(), "the legend shows the table's colour"


def test_run_without_labels_or_surfels(tmp_path):
    arrays = room_arrays(0.06)
    arrays["label"][:] = 0
    arrays["segment"][:] = 0
    written = write_views(tmp_path, map_of(arrays), poses())
    assert [path.name for path in written] == ["map_colour.png", "map_confidence.png", "map_time.png"]
    frame = Frame(0, 0.0, np.zeros((120, 160, 3), np.uint8), np.zeros((120, 160), np.float32))
    empty = map_of({name: values[:0] for name, values in arrays.items()})
    written = write_pictures(tmp_path / "e", empty, points()[:1], INTRINSICS, [StripFrame(frame, np.eye(4))])
    assert [path.name for path in written] == ["trajectory.png", "strip.png"]


def test_unwritable_folder_is_an_input_error(tmp_path):
    (tmp_path / "pictures").write_text("a file")
    with pytest.raises(InputError, match="cannot write"):
        write_pictures(tmp_path, room_map(0.1), points(), INTRINSICS, [])


def test_confidence_scale_is_logarithmic():
    colours, low, high = confidence_colours(np.array([1.0, 10.0, 100.0]))
    assert low == 1 and high > 90
    middle, _, _ = confidence_colours(np.array([1.0, high**0.5, high]))
    assert np.abs(middle[0].astype(int) - colours[0]).max() == 0
    assert not np.array_equal(middle[1], middle[2])
