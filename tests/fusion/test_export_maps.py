"""Surfaces, points, splats, grids and trees of a map: the library each is for opens it and finds the map there."""

import cv2
import numpy as np
import pytest
import yaml
from synthetic_map import SIZE, TABLE, room_arrays

from dsmap.classes import NUM_CLASSES, PALETTE
from dsmap.errors import InputError
from dsmap.fusion.exports import mesh, points, surface
from dsmap.fusion.exports.occupancy import FREE, OCCUPIED, UNKNOWN, occupancy_grid, write_occupancy
from dsmap.fusion.exports.octomap import Voxels, write_octomap
from dsmap.fusion.exports.splat import PROPERTIES, write_splat


@pytest.fixture(scope="module")
def room() -> dict[str, np.ndarray]:
    """Surfels of a box-shaped room with a table top; the grid of voxels does not lie on its walls."""
    arrays = room_arrays(0.04)
    return arrays | {"position": arrays["position"] + np.float32(0.013)}


@pytest.fixture(scope="module")
def room_surface(room) -> surface.SurfaceMesh:
    return surface.surface_of(room, 0.04)


def test_the_surface_lies_on_the_surfels(room_surface):
    found = room_surface
    at = found.vertices - 0.013
    to_wall = np.minimum(np.abs(at), np.abs(at - SIZE)).min(axis=1)
    on_table = np.abs(at[:, 2] - 0.75)
    assert np.minimum(to_wall, on_table).max() < 0.03, "corners are rounded, nothing else is off"
    assert np.median(np.minimum(to_wall, on_table)) < 1e-4
    a, b, c = (found.vertices[found.faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    area = np.linalg.norm(cross, axis=1).sum() / 2
    whole = 2 * (SIZE[0] * SIZE[1] + SIZE[0] * SIZE[2] + SIZE[1] * SIZE[2]) + 1
    assert area == pytest.approx(whole, rel=0.05)
    assert ((cross * found.normal[found.faces[:, 0]]).sum(axis=1) > 0).mean() > 0.99, (
        "faces look into the room"
    )


def test_the_surface_ends_at_its_rims_alone(room_surface):
    edges, count = np.unique(np.sort(_edges(room_surface.faces), axis=1), axis=0, return_counts=True)
    rim = room_surface.vertices[np.unique(edges[count == 1])] - 0.013
    on_wall = np.sort(np.minimum(np.abs(rim), np.abs(rim - SIZE)), axis=1)
    in_corner = on_wall[:, 1] < 0.12  # two walls meet
    off_table = np.abs(np.abs(rim[:, :2] - [2, 1.5]).max(axis=1) - 0.5) < 0.12
    table = (np.abs(rim[:, 2] - 0.75) < 0.01) & off_table
    assert (in_corner | table).all(), "no hole in a wall, the floor, the ceiling or the table"


def _edges(faces: np.ndarray) -> np.ndarray:
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def test_the_surface_has_colours_and_labels(room, room_surface):
    at = room_surface.vertices - 0.013
    expected = (at / SIZE).clip(0, 1)
    assert np.abs(room_surface.colour / 255 - expected).mean() < 0.02
    table = (np.abs(at[:, 2] - 0.75) < 1e-3) & (np.abs(at[:, :2] - [2, 1.5]).max(axis=1) < 0.4)
    assert table.any() and (room_surface.label[table] == TABLE).all()
    assert set(np.unique(room_surface.label)) == set(np.unique(room["label"]))


def test_both_sides_of_a_thin_board_stay_apart():
    u, v = (axis.ravel() for axis in np.meshgrid(np.arange(0, 0.6, 0.01), np.arange(0, 0.6, 0.01)))
    sides = [(np.stack([u, v, np.full(u.size, z)], axis=1), n) for z, n in ((0.0, -1.0), (0.025, 1.0))]
    position = np.concatenate([p for p, _ in sides]).astype(np.float32) + np.float32(0.003)
    normal = np.concatenate([np.tile([0, 0, n], (len(p), 1)) for p, n in sides]).astype(np.float32)
    board = {
        "position": position, "normal": normal, "colour": np.zeros_like(position),
        "weight": np.ones(len(position), np.float32), "radius": np.full(len(position), 0.008, np.float32),
        "label": np.zeros(len(position), np.uint8),
    }  # fmt: skip
    height = surface.surface_of(board).vertices[:, 2] - 0.003
    assert (np.minimum(np.abs(height), np.abs(height - 0.025)) < 2e-3).all()


def test_a_map_without_a_surface_is_one_sentence(room):
    nothing = {name: values[:0] for name, values in room.items()}
    with pytest.raises(InputError, match="no surfels"):
        surface.surface_of(nothing)


def test_meshes_are_read_by_trimesh(tmp_path, room_surface):
    trimesh = pytest.importorskip("trimesh")
    turned = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]])
    for kind, writer in mesh.MESH_WRITERS.items():
        writer(tmp_path / f"mesh.{kind}", room_surface, turned)
        found = trimesh.load(tmp_path / f"mesh.{kind}", process=False, force="mesh", maintain_order=True)
        assert len(found.vertices) == len(room_surface.vertices) and len(found.faces) == len(
            room_surface.faces
        )
        high = room_surface.vertices[:, 2] + (0.5 if kind != "ply" else 0)  # upright, above its floor
        assert np.allclose(found.vertices[:, 2 if kind == "ply" else 1], high, atol=1e-5)
        assert np.abs(found.visual.vertex_colors[:, :3].astype(int) - room_surface.colour).max() <= 1
    glb = trimesh.load(tmp_path / "mesh.glb", process=False, force="mesh")
    assert np.array_equal(glb.vertex_attributes["_LABEL"].ravel().astype(int), room_surface.label)


def test_the_ply_is_read_by_meshlab_and_open3d(tmp_path, room_surface):
    mesh.write_mesh_ply(tmp_path / "mesh.ply", room_surface, np.eye(4))
    opened = 0
    try:
        import pymeshlab

        meshes = pymeshlab.MeshSet()
        meshes.load_new_mesh(str(tmp_path / "mesh.ply"))
        assert meshes.current_mesh().face_number() == len(room_surface.faces)
        assert meshes.current_mesh().has_vertex_color()
        opened += 1
    except ImportError:
        pass
    try:
        import open3d

        found = open3d.io.read_triangle_mesh(str(tmp_path / "mesh.ply"))
        assert len(found.triangles) == len(room_surface.faces) and found.has_vertex_colors()
        opened += 1
    except ImportError:
        pass
    if not opened:
        pytest.skip("neither pymeshlab nor open3d is installed")


def test_las_and_e57_are_read_by_their_libraries(tmp_path, room):
    laspy, pye57 = pytest.importorskip("laspy"), pytest.importorskip("pye57")
    assert points.write_las(tmp_path / "map.las", room) == len(room["weight"])
    las = laspy.read(tmp_path / "map.las")
    assert np.abs(las.xyz - room["position"]).max() <= 0.6e-4
    assert np.array_equal(np.asarray(las.red) // 257, np.rint(room["colour"][:, 0].clip(0, 1) * 255))
    assert np.array_equal(las["label"], room["label"])
    assert np.array_equal(np.asarray(las.classification), 64 + room["label"])
    points.write_e57(tmp_path / "map.e57", room)
    scan = pye57.E57(str(tmp_path / "map.e57")).read_scan(
        0, colors=True, intensity=True, ignore_missing_fields=True
    )
    assert np.allclose(scan["cartesianZ"], room["position"][:, 2])
    assert np.array_equal(scan["colorGreen"], np.rint(room["colour"][:, 1].clip(0, 1) * 255))


def test_pcd_has_the_header_of_the_point_cloud_library(tmp_path, room):
    points.write_pcd(tmp_path / "map.pcd", room)
    head, _, body = (tmp_path / "map.pcd").read_bytes().partition(b"DATA binary\n")
    fields = dict(line.split(" ", 1) for line in head.decode().splitlines() if not line.startswith("#"))
    assert fields["VERSION"] == "0.7" and int(fields["POINTS"]) == len(room["weight"])
    kinds = [
        f"<{'u' if t == 'U' else 'f'}{s}"
        for t, s in zip(fields["TYPE"].split(), fields["SIZE"].split(), strict=True)
    ]
    table = np.frombuffer(body, dtype=list(zip(fields["FIELDS"].split(), kinds, strict=True)))
    assert np.array_equal(table["y"], room["position"][:, 1])
    packed = table["rgb"].copy().view(np.uint32)
    assert np.array_equal(packed >> 16 & 255, np.rint(room["colour"][:, 0].clip(0, 1) * 255))
    try:
        import open3d
    except ImportError:
        return
    assert len(open3d.io.read_point_cloud(str(tmp_path / "map.pcd")).points) == len(table)


def test_splats_cover_their_surfels(tmp_path, room):
    trimesh = pytest.importorskip("trimesh")
    assert write_splat(tmp_path / "splat.ply", room, 10.0) == len(room["weight"])
    data = trimesh.load(tmp_path / "splat.ply", process=False).metadata["_ply_raw"]["vertex"]["data"]
    assert list(data.dtype.names) == PROPERTIES and len(PROPERTIES) == 62, "what the reference program reads"
    colour = 0.5 + 0.28209479177387814 * np.asarray(data["f_dc_1"]).ravel()
    assert np.allclose(colour, room["colour"][:, 1].clip(0, 1), atol=1e-5)
    w, x, y, z = (np.asarray(data[f"rot_{i}"]).ravel() for i in range(4))
    normal = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    assert np.allclose(normal, room["normal"], atol=1e-5)
    assert np.allclose(np.exp(np.asarray(data["scale_0"])).ravel(), room["radius"] / 2)


def test_a_table_is_in_the_way_and_a_floor_is_not(tmp_path, room):
    grid = occupancy_grid(room, np.eye(4), 0.1)
    write_occupancy(tmp_path / "map.yaml", grid, np.eye(4))
    about = yaml.safe_load((tmp_path / "map.yaml").read_text())
    assert set(about) == {
        "image", "mode", "resolution", "origin", "negate", "occupied_thresh", "free_thresh",
    }  # fmt: skip
    image = cv2.imread(str(tmp_path / about["image"]), cv2.IMREAD_UNCHANGED)
    assert (tmp_path / about["image"]).read_bytes().startswith(b"P5")

    def value(x: float, y: float) -> int:
        """As map_server: row 0 of the image has the largest y; p = (255 - value) / 255."""
        column = int((x - about["origin"][0]) / about["resolution"])
        row = image.shape[0] - 1 - int((y - about["origin"][1]) / about["resolution"])
        p = (255 - int(image[row, column])) / 255
        return OCCUPIED if p > about["occupied_thresh"] else FREE if p < about["free_thresh"] else UNKNOWN

    assert value(0.5, 0.5) == FREE and value(3.5, 2.5) == FREE
    assert value(2.0, 1.5) == OCCUPIED, "the table, although there is floor below it"
    assert value(0.02, 1.0) == OCCUPIED and value(-0.15, 1.0) == UNKNOWN


def _read_tree(data: bytes) -> dict[tuple[int, int, int], bool]:
    """Leaves of a `.bt` as OctoMap's `readBinaryNode` reads them: key to whether it is occupied."""
    stream, leaves = iter(np.frombuffer(data, "<u2").tolist()), {}

    def node(key: tuple[int, ...], level: int) -> None:
        bits = next(stream)
        for child in range(8):
            state = bits >> 2 * child & 3
            below = tuple(2 * k + (child >> axis & 1) for axis, k in enumerate(key))
            if state == 3:
                node(below, level + 1)
            elif state:
                assert level == 15
                leaves[below] = state == 2

    node((0, 0, 0), 0)
    assert next(stream, None) is None
    return leaves


def test_octomap_holds_every_voxel(tmp_path):
    rng = np.random.default_rng(3)
    keys = np.unique(rng.integers(32700, 32830, (400, 3)), axis=0)
    voxels = Voxels(keys[::2], keys[1::2], 0.05)
    write_octomap(tmp_path / "map.bt", voxels)
    head, _, data = (tmp_path / "map.bt").read_bytes().partition(b"data\n")
    assert (
        head.startswith(b"# Octomap OcTree binary file\n")
        and b"\nid OcTree\n" in head
        and b"\nres 0.05\n" in head
    )
    expected = {tuple(k): True for k in keys[::2].tolist()} | {tuple(k): False for k in keys[1::2].tolist()}
    assert _read_tree(data) == expected
    write_octomap(tmp_path / "map.ot", voxels)
    head, _, data = (tmp_path / "map.ot").read_bytes().partition(b"data\n")
    nodes = int(head.split(b"size ")[1].split()[0])
    assert len(data) == 5 * nodes
    table = np.frombuffer(data, [("value", "<f4"), ("children", "u1")])
    assert (table["children"] == 0).sum() == len(keys)
    assert sum(int(c).bit_count() for c in table["children"]) == nodes - 1


def test_octomap_is_read_by_octomap(tmp_path):
    octomap = pytest.importorskip("octomap")
    keys = np.array([[32768, 32768, 32768], [32770, 32769, 32768]])
    write_octomap(tmp_path / "map.bt", Voxels(keys[:1], keys[1:], 0.05))
    tree = octomap.OcTree(str(tmp_path / "map.bt").encode())
    assert tree.isNodeOccupied(tree.search(np.array([0.025, 0.025, 0.025])))
    assert not tree.isNodeOccupied(tree.search(np.array([0.125, 0.075, 0.025])))


def test_class_colours_are_those_of_the_palette(room_surface):
    shown = mesh.in_class_colours(room_surface)
    assert (
        np.array_equal(shown.colour, PALETTE[room_surface.label]) and room_surface.label.max() < NUM_CLASSES
    )
