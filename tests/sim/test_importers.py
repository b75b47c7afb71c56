"""Scenes from users' own files: tiny MJCF, GLB and PLY files made here, rendered and checked."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image as PillowImage

from dsmap.classes import CLASS_NAMES
from dsmap.errors import InputError, InputWarning
from dsmap.sim_scenes.importers.load import load_scene
from dsmap.sim_scenes.importers.mesh import coloured
from dsmap.sim_scenes.render.open_renderer import open_renderer
from dsmap.sim_scenes.render.renderer import default_camera, part_tables
from dsmap.sim_scenes.scene import MAX_LIGHTS, Scene

CAMERA = default_camera(64, 48)
MJCF = """
<mujoco>
  <asset>
    <texture name="boards" type="2d" builtin="checker" width="32" height="32" rgb1="0.8 0.6 0.4" rgb2="0.6 0.4 0.2"/>
    <material name="boards" texture="boards" texrepeat="2 2"/>
  </asset>
  <worldbody>
    <light pos="0 0 3" diffuse="0.8 0.8 0.8"/>
    <geom name="floor_plane" type="plane" size="3 2 0.1" pos="1 0 0.5" material="boards"/>
    <geom name="wall_north" type="box" size="3 0.1 1.2" pos="1 2.1 1.7"/>
    <body name="dining_table" pos="1 0 0.5">
      <geom type="box" size="0.6 0.4 0.02" pos="0 0 0.72" rgba="0.5 0.3 0.1 1"/>
      <geom type="cylinder" size="0.05 0.35" pos="0 0 0.35"/>
      <geom name="collider" type="box" size="0.6 0.4 0.4" pos="0 0 0.4" group="3"/>
    </body>
    <body name="thing_7" pos="1 0 1.4"><geom name="{ball}" type="sphere" size="0.12" rgba="1 0 0 1"/></body>
    <body name="pillow" pos="1.3 0.2 1.3"><geom type="capsule" size="0.05 0.1"/></body>
  </worldbody>
</mujoco>
"""


def look(at: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """T_world_camera of a level-headed camera that looks at a point."""
    z = (at - origin) / np.linalg.norm(at - origin)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = x, np.cross(z, x), z, origin
    return T


def seen(scene: Scene, pose: np.ndarray) -> tuple[np.ndarray, set[str], np.ndarray]:
    """Colour, names of the classes in view, depth."""
    renderer = open_renderer("warp", scene, CAMERA)
    image = renderer(pose)
    renderer.close()
    return image.rgb, {CLASS_NAMES[i] for i in np.unique(part_tables(scene)[0][image.part])}, image.depth


def test_mjcf_geoms_get_classes_by_name_and_the_floor_goes_to_zero(tmp_path: Path) -> None:
    path = tmp_path / "home.xml"
    path.write_text(MJCF.format(ball="red_ball"))
    scene = load_scene(path)
    labels = [CLASS_NAMES[p.label] for p in scene.parts]
    assert sorted(labels) == ["floor", "objects", "objects", "table", "table", "wall"]
    floor = scene.parts[labels.index("floor")].shape
    assert np.allclose(floor.vertices[:, 2], 0) and np.allclose(floor.bounds()[:, 0], [-3, 3])
    table = [p for p in scene.parts if CLASS_NAMES[p.label] == "table"]
    assert table[0].instance == table[1].instance != scene.parts[labels.index("objects")].instance
    assert max(p.shape.bounds()[1, 2] for p in table) == pytest.approx(0.74)
    assert 0 < len(scene.lights) <= MAX_LIGHTS
    colours, classes, depth = seen(scene, look(np.array([0, 0, 0.7]), np.array([0, -1.8, 1.5])))
    assert classes >= {"floor", "wall", "table", "objects"} and 30 < colours.mean() < 220
    assert depth[24, 32] == pytest.approx(np.hypot(1.8, 0.8), abs=0.45)


def test_things_without_a_class_are_listed_and_a_class_map_settles_them(tmp_path: Path) -> None:
    path, classes = tmp_path / "home.xml", tmp_path / "classes.yaml"
    path.write_text(MJCF.format(ball="zorp"))
    with pytest.raises(InputError, match="'zorp'.*class map"):
        load_scene(path)
    classes.write_text("zorp: chair\nfloor*: floor\nwall_north: 12\n'*': void\n")
    assert {CLASS_NAMES[p.label] for p in load_scene(path, classes).parts} == {
        "chair",
        "floor",
        "wall",
        "void",
    }
    classes.write_text("zorp: spaceship\n")
    with pytest.raises(InputError, match="spaceship.*expected one of: void, bed"):
        load_scene(path, classes)


def boxes(path: Path) -> None:
    """A textured floor, a chair of one colour and a table with colours a vertex, y up, as GLB."""
    world = trimesh.Scene()
    checker = (np.indices((8, 8)).sum(0) % 2 * 200 + 30).astype(np.uint8)
    material = trimesh.visual.material.PBRMaterial(
        name="tiles",
        baseColorTexture=PillowImage.fromarray(np.repeat(checker[..., None], 3, 2)),
        roughnessFactor=0.4,
    )
    corners = np.array([[-2, 0, -2], [2, 0, -2], [2, 0, 2], [-2, 0, 2]], float)
    ground = trimesh.Trimesh(corners, [[0, 2, 1], [0, 3, 2]], process=False)
    ground.visual = trimesh.visual.TextureVisuals(
        uv=np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float), material=material
    )
    world.add_geometry(ground, node_name="ground")
    seat = trimesh.creation.box((0.5, 0.9, 0.5))
    seat.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=[200, 40, 40, 255])
    )
    lift = np.eye(4)
    lift[:3, 3] = 0.8, 0.45, 0
    world.add_geometry(seat, node_name="OfficeChair.001", transform=lift)
    top = trimesh.creation.box((0.8, 0.7, 0.6))
    top.visual.vertex_colors = np.array([[20, 200, 20, 255]] * 8, np.uint8)
    lift[:3, 3] = -0.6, 0.35, 0.2
    world.add_geometry(top, node_name="coffee_table", transform=lift)
    path.write_bytes(world.export(file_type="glb"))


def test_materials_beyond_all_measure_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "home.obj").write_text(
        "mtllib home.mtl\no floor\nv 0 0 0\nv 4 0 0\nv 4 4 0\nusemtl floor\nf 1 2 3\n"
    )
    (tmp_path / "home.mtl").write_text("newmtl floor\nKd 1 0 0\n")
    os.truncate(tmp_path / "home.mtl", 3 << 30)
    everything = tmp_path / "classes.yaml"
    everything.write_text("'*': furniture\n")
    with pytest.warns(InputWarning, match="shown plain"):
        assert len(load_scene(tmp_path / "home.obj", class_map=everything).parts) == 1
    (tmp_path / "home.mtl").unlink()
    os.mkfifo(tmp_path / "home.mtl")
    with pytest.warns(InputWarning, match="shown plain"):
        load_scene(tmp_path / "home.obj", class_map=everything)


def test_glb_is_turned_upright_and_keeps_textures_and_colours(tmp_path: Path) -> None:
    boxes(tmp_path / "room.glb")
    scene = load_scene(tmp_path / "room.glb")
    by_class = {CLASS_NAMES[p.label]: p for p in scene.parts}
    assert set(by_class) == {"floor", "chair", "table"}
    assert by_class["chair"].shape.bounds()[1, 2] == pytest.approx(0.9)
    assert by_class["chair"].shape.bounds()[:, 0].mean() == pytest.approx(0.8)
    assert by_class["table"].shape.bounds()[:, 1].mean() == pytest.approx(-0.2)  # y up: z of the file is -y
    colours, classes, _ = seen(scene, look(np.array([0, 0, 0.2]), np.array([0, -2.5, 2.0])))
    assert classes == {"void", "floor", "chair", "table"}
    red, green = (colours[:, half].astype(int) for half in (slice(34, None), slice(0, 30)))
    assert (red[..., 0] - red[..., 1]).max() > 80 and (green[..., 1] - green[..., 0]).max() > 80
    flat = load_scene(tmp_path / "room.glb", up="z")
    assert flat.size[2] > 3  # taken as z up, the floor stands on its edge


def scan(path: Path, labels: str, ids: list[int], extra: str = "") -> None:
    """A floor and a square standing on it with colours; `labels` names the property that holds their ids."""
    v = [(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1), (0, 1, 1), (2, 1, 1), (2, 1, 2), (0, 1, 2)]
    rows = [f"{x} {y} {z} {40 * k % 256} {255 - 30 * k} 90 {ids[k // 4]}" for k, (x, y, z) in enumerate(v)]
    faces = ["3 0 1 2", "3 0 2 3", "3 4 5 6", "3 4 6 7"]
    head = [
        "ply", "format ascii 1.0", *([extra] if extra else []), "element vertex 8",
        *(f"property float {a}" for a in "xyz"), *(f"property uchar {c}" for c in ("red", "green", "blue")),
        f"property ushort {labels}", "element face 4", "property list uchar int vertex_indices", "end_header",
    ]  # fmt: skip
    path.write_text("\n".join([*head, *rows, *faces]) + "\n")


def test_scannet_like_ply_has_nyu40_labels_and_shows_its_colours_as_they_are(tmp_path: Path) -> None:
    scan(tmp_path / "scan.ply", "label", [2, 1])
    scene = load_scene(tmp_path / "scan.ply")
    assert [CLASS_NAMES[p.label] for p in scene.parts] == ["wall", "floor"]  # NYU40 1 and 2
    assert np.allclose(scene.parts[1].shape.vertices[:, 2], 0)
    pose = look(np.array([0.3, 0, 0.6]), np.array([0.2, -2.0, 0.7]))
    colours, classes, _ = seen(scene, pose)
    assert {"wall", "floor"} <= classes
    corners = np.array([(40 * k % 256, 255 - 30 * k, 90) for k in range(4, 8)])
    inside = colours[20:26, 30:36].reshape(-1, 3)
    assert (inside >= corners.min(0) - 3).all() and (inside <= corners.max(0) + 3).all()


def test_replica_object_ids_take_their_class_from_the_file_beside(tmp_path: Path) -> None:
    scan(tmp_path / "mesh.ply", "object_id", [11, 12])
    with pytest.raises(InputError, match="class map"):
        load_scene(tmp_path / "mesh.ply", write(tmp_path / "map.csv", "id,class\n11,floor\n"))
    info = {"classes": [{"id": 1, "name": "rug"}, {"id": 2, "name": "sofa"}],
            "objects": [{"id": 11, "class_id": 1}, {"id": 12, "class_id": 2}]}  # fmt: skip
    write(tmp_path / "info_semantic.json", json.dumps(info))
    assert {CLASS_NAMES[p.label] for p in load_scene(tmp_path / "mesh.ply").parts} == {"floor", "sofa"}


def write(path: Path, text: str) -> Path:
    """A text file."""
    path.write_text(text)
    return path


def test_our_own_meshes_keep_their_13_classes(tmp_path: Path) -> None:
    scan(tmp_path / "mesh.ply", "label", [5, 9], "comment dsmap ground-truth surface")
    assert {CLASS_NAMES[p.label] for p in load_scene(tmp_path / "mesh.ply").parts} == {"floor", "sofa"}


def test_colours_of_corners_run_linearly_over_a_triangle() -> None:
    rng = np.random.default_rng(0)
    vertices, faces = rng.uniform(size=(9, 3)), rng.integers(0, 9, (7, 3))
    colours = rng.integers(60, 120, (7, 3, 3)).astype(np.uint8)  # no clipping in the fourth texel
    shape, material = coloured(vertices, faces, colours)
    weights = rng.dirichlet([1, 1, 1], 7)
    uv = (shape.uv.reshape(7, 3, 2) * weights[..., None]).sum(1) * material.texture.shape[0] - 0.5
    low = np.floor(uv).astype(int)
    fraction = uv - low
    texel = material.texture.astype(float)
    found = np.zeros((7, 3))
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        share = np.abs(1 - dx - fraction[:, 0]) * np.abs(1 - dy - fraction[:, 1])
        found += share[:, None] * texel[low[:, 1] + dy, low[:, 0] + dx]
    assert np.allclose(found, (colours * weights[..., None]).sum(1), atol=1e-6)


@pytest.mark.parametrize(
    ("name", "content", "match"),
    [("scene.fbx", "x", "expected a file of: .glb"), ("scene.glb", "nonsense", "not readable as a GLB"),
     ("scene.xml", "<mujoco><oops/></mujoco>", "not readable as MJCF"),
     ("scene.ply", "ply\nbroken", "not readable as a PLY")],
)  # fmt: skip
def test_foreign_and_broken_files_are_named(tmp_path: Path, name: str, content: str, match: str) -> None:
    with pytest.raises(InputError, match=match):
        load_scene(write(tmp_path / name, content))
    with pytest.raises(InputError, match="no such file"):
        load_scene(tmp_path / "missing.glb")
