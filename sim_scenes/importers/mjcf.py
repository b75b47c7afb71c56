"""Reader of MuJoCo models (MJCF) for `importers`: visible geoms as meshes, their materials, the model's lights."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo fills its module at run time.)

import warnings
from collections.abc import Hashable
from pathlib import Path

import mujoco
import numpy as np

from dsmap.errors import InputError, InputWarning
from dsmap.limits import MAX_TEXT_BYTES
from dsmap.reading import check_plain, reason
from dsmap.sim_scenes.geometry.shapes import Shape, box, cushion, lathe
from dsmap.sim_scenes.importers.chunk import Chunk, Foreign
from dsmap.sim_scenes.importers.mjcf_size import check_mjcf_size
from dsmap.sim_scenes.scene import Light, Material

VISIBLE_GROUPS = (0, 1, 2)
"""Geoms of other groups are for collisions only, by MuJoCo's custom."""
_WIDE = 20.0
"""Half size of a plane that has none [m]."""


def read_mjcf(path: Path) -> Foreign:
    """The model at rest (`qpos0`). Names for the class: geom, bodies from the inside out, mesh, material, `group N`."""
    check_plain(path, "an MJCF model", MAX_TEXT_BYTES)
    check_mjcf_size(path)
    # Without a handler of ours MuJoCo writes its warnings to MUJOCO_LOG.TXT in the user's folder.
    mujoco.set_mju_user_warning(lambda text: warnings.warn(InputWarning(f"{path}: {text}"), stacklevel=2))
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        raise InputError(f"{path}: not readable as MJCF ({reason(error)})") from error
    data = mujoco.MjData(model)
    try:
        mujoco.mj_forward(model, data)
    except (mujoco.FatalError, mujoco.UnexpectedError) as error:
        raise InputError(f"{path}: no model at rest ({reason(error)}), expected one") from error
    looks: dict[Hashable, Material] = {}
    chunks = []
    for geom in range(model.ngeom):
        rgba = _rgba(model, geom)
        if model.geom_group[geom] not in VISIBLE_GROUPS or rgba[3] == 0:
            continue
        key = (int(model.geom_matid[geom]), rgba.tobytes())
        if key not in looks:
            looks[key] = _material(model, int(model.geom_matid[geom]), rgba)
        shape = _shape(path, model, geom, looks[key].tile)
        turn = data.geom_xmat[geom].reshape(3, 3)
        placed = shape.turned(turn).moved(data.geom_xpos[geom])
        body = int(model.body_rootid[model.geom_bodyid[geom]])
        chunks.append(
            Chunk(placed, looks[key], _keys(model, geom), ("body", body) if body else ("geom", geom))
        )
    return Foreign(chunks, _lights(model, data), "z", lit=False)


def _name(model: mujoco.MjModel, kind: mujoco.mjtObj, index: int) -> str:
    return mujoco.mj_id2name(model, kind, index) or "" if index >= 0 else ""


def _keys(model: mujoco.MjModel, geom: int) -> list[Hashable]:
    keys: list[Hashable] = [_name(model, mujoco.mjtObj.mjOBJ_GEOM, geom)]
    body = int(model.geom_bodyid[geom])
    while body:
        keys.append(_name(model, mujoco.mjtObj.mjOBJ_BODY, body))
        body = int(model.body_parentid[body])
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        keys.append(_name(model, mujoco.mjtObj.mjOBJ_MESH, int(model.geom_dataid[geom])))
    keys.append(_name(model, mujoco.mjtObj.mjOBJ_MATERIAL, int(model.geom_matid[geom])))
    return [*(k for k in keys if k), f"group {int(model.geom_group[geom])}"]


def _rgba(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """A geom's own colour, or its material's where it keeps MuJoCo's default grey."""
    own, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    return model.mat_rgba[material] if material >= 0 and np.allclose(own, (0.5, 0.5, 0.5, 1)) else own


def _material(model: mujoco.MjModel, index: int, rgba: np.ndarray) -> Material:
    """Texture (of a cube its first face) times colour."""
    texture, tile = np.full((4, 4, 3), 255, np.uint8), 1.0
    specular, shininess, emission = 0.2, 0.3, 0.0
    if index >= 0:
        specular, shininess = float(model.mat_specular[index]), float(model.mat_shininess[index])
        emission = float(model.mat_emission[index])
        image = int(model.mat_texid[index][int(mujoco.mjtTextureRole.mjTEXROLE_RGB)])
        if image >= 0:
            texture = _texture(model, image)
            tile = 1.0 / max(float(model.mat_texrepeat[index].max()), 1e-3)
    return Material((texture * rgba[:3]).astype(np.uint8), tile, specular, shininess, emission=emission)


def _texture(model: mujoco.MjModel, image: int) -> np.ndarray:
    height, width, channels = (int(v[image]) for v in (model.tex_height, model.tex_width, model.tex_nchannel))
    first = int(model.tex_adr[image])
    texels = model.tex_data[first : first + height * width * channels].reshape(height, width, channels)
    if model.tex_type[image] != mujoco.mjtTexture.mjTEXTURE_2D:
        texels = texels[:width]
    return np.repeat(texels[..., :1], 3, 2) if channels < 3 else texels[..., :3]


def _shape(path: Path, model: mujoco.MjModel, geom: int, tile: float) -> Shape:
    """The geom in its own frame; texture coordinates of bodies that are no meshes run in metres."""
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _mesh(model, int(model.geom_dataid[geom]), tile)
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        half = np.where(size[:2] > 0, size[:2], _WIDE)
        corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * [*half, 0]
        return Shape(corners, np.array([[0, 1, 2], [0, 2, 3]]), corners[:, :2] * [1, -1])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return box(2 * size, (0, 0, -size[2]))
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        half = np.repeat(size[0], 3) if kind == mujoco.mjtGeom.mjGEOM_SPHERE else size
        return cushion(2 * half, (0, 0, -half[2]), softness=1.0, rings=24)
    radius, half = float(size[0]), float(size[1])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return lathe([(radius, -half), (radius, half)])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        angle = np.linspace(-np.pi / 2, np.pi / 2, 17)
        rise = np.where(angle < 0, -half, half) + radius * np.sin(angle)
        return lathe(list(zip(radius * np.cos(angle), rise, strict=True)))
    raise InputError(
        f"{path}: found geom {_keys(model, geom)[0]!r} of type {kind.name}, expected meshes and simple bodies"
    )


def _mesh(model: mujoco.MjModel, mesh: int, tile: float) -> Shape:
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    vertices = model.mesh_vert[first : first + count].astype(float)
    faces = slice(int(model.mesh_faceadr[mesh]), int(model.mesh_faceadr[mesh] + model.mesh_facenum[mesh]))
    corner = model.mesh_face[faces]
    start = int(model.mesh_texcoordadr[mesh])
    if start < 0:
        return Shape(vertices, corner.copy(), vertices[:, :2] * [1, -1])
    texel = model.mesh_texcoord[start : start + int(model.mesh_texcoordnum[mesh])][
        model.mesh_facetexcoord[faces]
    ]
    uv = texel.reshape(-1, 2).astype(float) * tile
    return Shape(vertices[corner].reshape(-1, 3), np.arange(corner.size).reshape(-1, 3), uv)


def _lights(model: mujoco.MjModel, data: mujoco.MjData) -> list[Light]:
    """The active lights of the model, and its headlight's share as ambient light is left out."""
    lights = []
    for k in np.flatnonzero(model.light_active):
        kind = mujoco.mjtLightType(int(model.light_type[k]))
        turned = kind in (mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, mujoco.mjtLightType.mjLIGHT_SPOT)
        lights.append(
            Light(
                data.light_xpos[k].copy(), model.light_diffuse[k].astype(float), model.light_specular[k].astype(float),
                data.light_xdir[k].copy() if turned else None, bool(model.light_castshadow[k]), None,
                float(model.light_cutoff[k]) if kind == mujoco.mjtLightType.mjLIGHT_SPOT else None,
            )
        )  # fmt: skip
    return lights
