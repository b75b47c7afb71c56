"""A scene as a MuJoCo model: one mesh geom a part, one camera, a fixed number of lights."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo fills its module at run time.)

import mujoco
import numpy as np

from dsmap.frame import Intrinsics
from dsmap.reading import reading
from dsmap.sim_scenes.geometry.shapes import Shape
from dsmap.sim_scenes.scene import MAX_LIGHTS, Light, Scene

SPOT_EXPONENT = 25.0
"""Spot lights fade towards their rim as the cosine to this power."""
NEAR, FAR = 0.02, 50.0
"""Clipping distances [m]."""


def build_spec(scene: Scene, camera: Intrinsics) -> mujoco.MjSpec:
    """The scene as an editable MuJoCo specification; geom number i is `scene.parts[i]`."""
    spec = mujoco.MjSpec()
    spec.modelname = f"{scene.name}_{scene.seed}"
    spec.stat.extent, spec.visual.map.znear, spec.visual.map.zfar = 1.0, NEAR, FAR
    spec.visual.map.shadowclip, spec.visual.map.shadowscale = 6.0, 0.9
    spec.visual.quality.shadowsize = 4096
    spec.visual.global_.offwidth, spec.visual.global_.offheight = camera.width, camera.height
    headlight = spec.visual.headlight
    # The headlight's colours are compiled into the ray tracer: it stays dark, the first light brings the ambient.
    headlight.active, headlight.ambient = 0, np.zeros(3)
    headlight.diffuse, headlight.specular = np.zeros(3), np.zeros(3)
    _add_materials(spec, scene)
    for i, part in enumerate(scene.parts):
        _add_mesh(spec, f"part{i}", part.shape, scene.materials[part.material].tile)
        spec.worldbody.add_geom(
            name=f"part{i}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"part{i}", material=part.material,
            contype=0, conaffinity=0, rgba=(0.5, 0.5, 0.5, 1.0),
        )  # fmt: skip
    _add_lights(spec, scene)
    fovy = 2 * np.degrees(np.arctan(camera.height / (2 * camera.fy)))
    spec.worldbody.add_camera(name="camera", fovy=fovy, resolution=(camera.width, camera.height))
    return spec


def build_model(scene: Scene, camera: Intrinsics) -> mujoco.MjModel:
    """The compiled model, each mesh stored axis-aligned about the middle of its own box.

    MuJoCo turns meshes into their principal axes of inertia, which inflates the boxes the ray tracer
    prunes by (1.5-fold in volume) and costs precision; static scenery has no use for that.
    """
    with reading(
        f"scene {scene.name}", "meshes that MuJoCo takes (four vertices or more)", mujoco.FatalError
    ):
        model = build_spec(scene, camera).compile()
    turn = np.empty(9)
    for i, part in enumerate(scene.parts):
        mesh = model.geom_dataid[i]
        centre = part.shape.bounds().mean(0)
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        model.mesh_vert[first : first + count] = part.shape.vertices - centre
        first, count = model.mesh_normaladr[mesh], model.mesh_normalnum[mesh]
        mujoco.mju_quat2Mat(turn, model.geom_quat[i])
        model.mesh_normal[first : first + count] = (
            model.mesh_normal[first : first + count] @ turn.reshape(3, 3).T
        )
        model.geom_pos[i], model.geom_quat[i] = centre, (1, 0, 0, 0)
    return model


def _add_materials(spec: mujoco.MjSpec, scene: Scene) -> None:
    for name in sorted({part.material for part in scene.parts}):
        look = scene.materials[name]
        height, width = look.texture.shape[:2]
        texture = spec.add_texture(
            name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=width, height=height, nchannel=3
        )
        texture.data = np.ascontiguousarray(look.texture).tobytes()
        material = spec.add_material(
            name=name,
            specular=look.specular,
            shininess=look.shininess,
            emission=look.emission,
            rgba=(1, 1, 1, 1),
        )
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name


def _add_mesh(spec: mujoco.MjSpec, name: str, shape: Shape, tile: float) -> None:
    spec.add_mesh(
        name=name,
        uservert=shape.vertices.astype(np.float32).ravel(),
        userface=shape.faces.astype(np.int32).ravel(),
        usertexcoord=(shape.uv / tile).astype(np.float32).ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )


def _add_lights(spec: mujoco.MjSpec, scene: Scene) -> None:
    """The ambient light, the scene's lights, made up to `MAX_LIGHTS` by dark ones, and one more.

    That last one is a dark spot light with falloff: the ray tracer leaves code out where no light is of that
    kind, and would be compiled anew for scenes without. The first has no falloff, as ambient light must
    not: OpenGL takes the ambient part of a lamp for something that fades with its distance.
    """
    kinds, dark = mujoco.mjtLightType, np.zeros(3)
    spec.worldbody.add_light(
        name="everywhere", type=kinds.mjLIGHT_DIRECTIONAL, ambient=scene.ambient, diffuse=dark, specular=dark,
        castshadow=False,
    )  # fmt: skip
    for k in range(MAX_LIGHTS):
        light = scene.lights[k] if k < len(scene.lights) else DARK
        kind = kinds.mjLIGHT_POINT
        if light.direction is not None:
            kind = kinds.mjLIGHT_DIRECTIONAL if light.cutoff is None else kinds.mjLIGHT_SPOT
        spec.worldbody.add_light(
            name=f"light{k}",
            type=kind,
            pos=light.position,
            dir=(0, 0, -1) if light.direction is None else light.direction,
            diffuse=light.diffuse,
            specular=light.specular,
            ambient=dark,
            active=light is not DARK,
            castshadow=light.shadow,
            attenuation=(1, 0, 0 if light.reach is None else 1 / light.reach**2),
            cutoff=45 if light.cutoff is None else light.cutoff,
            exponent=0 if light.cutoff is None else SPOT_EXPONENT,
        )
    spec.worldbody.add_light(
        name="dark", type=kinds.mjLIGHT_SPOT, diffuse=dark, specular=dark, attenuation=(1, 0, 1), active=0
    )


DARK = Light(np.zeros(3), np.zeros(3), np.zeros(3), shadow=False)
"""In place of a light that a scene does not have."""
