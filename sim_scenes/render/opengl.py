"""OpenGL renderers of the same scene: MuJoCo's own, and pyrender's with physically based materials.

They rasterise with the camera of the ray tracer, so depth and classes agree with it up to the pixels on
outlines; shading differs. MuJoCo's point lights cast no shadows there; pyrender's lamps do. Contexts belong
to the thread that made them.
"""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo fills its module at run time.)

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sim_scenes.render import egl
from dsmap.sim_scenes.render.mjcf import FAR, build_model
from dsmap.sim_scenes.render.renderer import Image, Renderer
from dsmap.sim_scenes.scene import Light, Material, Scene

_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""Our camera (y down, z forward) to OpenGL's (y up, looking along -z)."""

OPENGL_LIGHTS = 8
"""Lights of OpenGL's fixed pipeline, which MuJoCo draws with."""
TYPICAL = 2.2
"""Distance of surfaces from lamps at which all renderers are equally bright [m]."""
LAMP_CONE = 70.0
"""Half the opening angle of a lamp that casts shadows in pyrender [deg]."""
PYRENDER_NEAR = 0.2
"""Near plane [m]: its 16-bit depth buffer resolves z^2 / (65536 near), 0.7 mm at 3 m."""


def _linear(display: np.ndarray) -> np.ndarray:
    """Light as the ray tracer adds it up (display values) to linear light; 1.5: sums come out as bright."""
    return 1.5 * np.asarray(display, float) ** 2.2


def open_opengl(name: str, scene: Scene, camera: Intrinsics, shadows: bool = True) -> Renderer:
    """`mujoco` or `pyrender`; see `open_renderer.open_renderer`.

    Raises:
        InputError: the camera has a lens distortion, or there is no OpenGL (says which packages bring it).
    """
    if camera.distortion is not None:
        raise InputError(
            f"--renderer {name} draws straight lines only; expected warp for a camera with distortion"
        )
    egl.use_egl()
    make = MujocoRenderer if name == "mujoco" else PyrenderRenderer
    try:
        return make(scene, camera, shadows)
    except (ImportError, RuntimeError, AttributeError, OSError) as error:
        raise egl.no_context(error) from error


class MujocoRenderer:
    """MuJoCo's OpenGL renderer: colour (anti-aliased), depth and geom ids in three passes."""

    def __init__(self, scene: Scene, camera: Intrinsics, shadows: bool) -> None:
        import mujoco

        # MuJoCo chose its context class when it was first imported, perhaps before EGL was asked for.
        from mujoco import egl
        from mujoco.rendering.classic import gl_context

        gl_context.GLContext = egl.GLContext
        if egl.EGL_DISPLAY is not None:  # pyrender, when it was closed, ended the display they share
            egl.EGL.eglInitialize(egl.EGL_DISPLAY, None, None)
        kinds = mujoco.mjtLightType
        self._point, self._spot = int(kinds.mjLIGHT_POINT), int(kinds.mjLIGHT_SPOT)
        self._directional = int(kinds.mjLIGHT_DIRECTIONAL)
        self._model = build_model(scene, camera)
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)
        self._renderer = mujoco.Renderer(self._model, camera.height, camera.width)
        self._scene, self._lens = scene, camera
        self._lit = self._model.light_active.astype(bool)
        self._rest = (self._data.geom_xpos.copy(), self._data.geom_xmat.copy())

    def _frustum(self) -> None:
        """The camera's own principal point and focal lengths in place of MuJoCo's centred square pixels."""
        lens = self._lens
        for view in self._renderer.scene.camera:
            left, right = (np.array([-0.5, lens.width - 0.5]) - lens.cx) / lens.fx * view.frustum_near
            top, bottom = (np.array([-0.5, lens.height - 0.5]) - lens.cy) / lens.fy * -view.frustum_near
            view.frustum_center, view.frustum_width = (left + right) / 2, (right - left) / 2
            view.frustum_bottom, view.frustum_top = bottom, top

    def __call__(self, T_world_camera: np.ndarray, T_world_body: np.ndarray | None = None) -> Image:
        """Render from a pose, shape (4, 4), with `scene.bodies` at theirs, (bodies, 4, 4) or at rest."""
        for geom, T_now_rest in self._scene.moved_by(T_world_body).items():
            turn = T_now_rest[:3, :3]
            self._data.geom_xpos[geom] = turn @ self._rest[0][geom] + T_now_rest[:3, 3]
            self._data.geom_xmat[geom] = (turn @ self._rest[1][geom].reshape(3, 3)).ravel()
        renderer, pose = self._renderer, T_world_camera @ _FLIP
        self._data.cam_xpos[0], self._data.cam_xmat[0] = pose[:3, 3], pose[:3, :3].ravel()
        self._choose_lights(pose[:3, 3])
        renderer.update_scene(self._data, camera="camera")
        self._frustum()
        lamps = np.flatnonzero(self._model.light_active)
        for light, k in zip(renderer.scene.lights[: renderer.scene.nlight], lamps, strict=True):
            light.attenuation = self._model.light_attenuation[k]  # which MuJoCo 4.0 forgets
            if light.type == self._point:
                # MuJoCo 4.0 draws point lights black; OpenGL takes a spot of 180 degrees for one. A shadow
                # map cannot cover that angle.
                light.type, light.cutoff, light.castshadow = self._spot, 180.0, False
        rgb = renderer.render().copy()
        renderer.enable_depth_rendering()
        depth = renderer.render().astype(np.float32)
        renderer.enable_segmentation_rendering()
        part = renderer.render()[..., 0].astype(np.int32)
        renderer.disable_segmentation_rendering()
        return Image(rgb, np.where(part >= 0, depth, 0).astype(np.float32), part)

    def _choose_lights(self, eye: np.ndarray) -> None:
        """Of more lights than OpenGL has, those that are everywhere and the ones nearest to the camera."""
        distance = np.linalg.norm(self._model.light_pos - eye, axis=1)
        distance[self._model.light_type == self._directional] = 0
        distance[~self._lit] = np.inf
        nearest = np.argsort(distance, kind="stable")[:OPENGL_LIGHTS]
        self._model.light_active[:] = self._lit & np.isin(np.arange(len(distance)), nearest)

    def close(self) -> None:
        """Free the context."""
        self._renderer.close()


class PyrenderRenderer:
    """pyrender: physically based shading; colour in one pass, depth and part ids in a second."""

    def __init__(self, scene: Scene, camera: Intrinsics, shadows: bool) -> None:
        import pyrender
        import trimesh

        self._pyrender, self._shape = pyrender, (camera.height, camera.width)
        # Its own way to measure a scene asks NumPy for a name that NumPy 2 has no more.
        extent = float(np.linalg.norm(scene.size))
        world = type("World", (pyrender.Scene,), {"scale": extent})(
            bg_color=np.zeros(4), ambient_light=_linear(scene.ambient)
        )
        looks = {name: self._material(scene.materials[name]) for name in {p.material for p in scene.parts}}
        self._scene, self._codes, self._nodes = scene, {}, []
        for i, part in enumerate(scene.parts):
            shape, tile = part.shape, scene.materials[part.material].tile
            mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
            primitive = pyrender.Primitive(
                positions=shape.vertices.astype(np.float32),
                normals=np.asarray(mesh.vertex_normals, np.float32),
                texcoord_0=(shape.uv / tile * [1, -1] + [0, 1]).astype(np.float32),
                indices=shape.faces.astype(np.uint32),
                material=looks[part.material],
            )
            node = world.add(pyrender.Mesh([primitive]))
            self._nodes.append(node)
            self._codes[node] = np.array([(i + 1) >> 8, (i + 1) & 255, 0], np.uint8)
        for light in scene.lights:
            self._add_light(world, light, shadows)
        draw = pyrender.RenderFlags
        self._flags = draw.SHADOWS_SPOT if shadows else draw.NONE
        # pyrender counts the principal point from the image corner: pixel centres at .5.
        lens = pyrender.IntrinsicsCamera(
            camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5, PYRENDER_NEAR, FAR
        )
        self._camera = world.add(lens)
        self._world = world
        self._renderer = pyrender.OffscreenRenderer(camera.width, camera.height)

    def _material(self, look: Material):
        texture = self._pyrender.Texture(source=look.texture, source_channels="RGB")
        return self._pyrender.MetallicRoughnessMaterial(
            baseColorTexture=texture,
            baseColorFactor=(1.0, 1.0, 1.0, 1.0),
            metallicFactor=0.8 * look.metallic,
            roughnessFactor=float(np.clip(1.0 - 0.8 * look.shininess, 0.3, 1.0)),
            emissiveFactor=np.full(3, look.emission),
            emissiveTexture=texture if look.emission > 0 else None,
        )

    def _add_light(self, world, light: Light, shadows: bool) -> None:
        """Its brightness: as on the ray tracer's surfaces 2.2 m away. Lamps shine downwards where they cast shadows."""
        power = float(light.diffuse.max())
        if power <= 0:
            return
        colour, pose = _linear(light.diffuse / power), np.eye(4)
        if light.reach is not None:
            power /= 1 + (TYPICAL / light.reach) ** 2
        strength = np.pi * float(_linear(np.array(power)))
        if light.direction is not None:
            z = -light.direction
            x = np.cross([0.3, 0.9, 0.1], z)
            pose[:3, 0] = x / np.linalg.norm(x)
            pose[:3, 2], pose[:3, 1] = z, np.cross(z, pose[:3, 0])
        pose[:3, 3] = light.position
        if light.direction is not None and light.cutoff is None:
            source = self._pyrender.DirectionalLight(colour, intensity=strength)
        elif light.cutoff is not None or (shadows and light.shadow):
            outer = np.radians(LAMP_CONE if light.cutoff is None else light.cutoff)
            source = self._pyrender.SpotLight(
                colour, intensity=strength * TYPICAL**2, innerConeAngle=0.6 * outer, outerConeAngle=outer
            )
        else:
            source = self._pyrender.PointLight(colour, intensity=strength * TYPICAL**2)
        world.add(source, pose=pose)

    def _render(self, flags: int) -> tuple[np.ndarray, np.ndarray]:
        image = self._renderer.render(self._world, flags=flags, seg_node_map=self._codes)
        assert image is not None  # only where asked to draw on a screen
        return image

    def __call__(self, T_world_camera: np.ndarray, T_world_body: np.ndarray | None = None) -> Image:
        """Render from a pose, shape (4, 4), with `scene.bodies` at theirs, (bodies, 4, 4) or at rest."""
        for i, T_now_rest in self._scene.moved_by(T_world_body).items():
            self._world.set_pose(self._nodes[i], T_now_rest)
        self._world.set_pose(self._camera, T_world_camera @ _FLIP)
        rgb, _ = self._render(self._flags)
        # The colour pass is multi-sampled, its depth off the pixel's centre; this one is not.
        code, depth = self._render(self._pyrender.RenderFlags.SEG)
        part = code[..., 0].astype(np.int32) * 256 + code[..., 1] - 1
        return Image(np.ascontiguousarray(rgb), np.where(part >= 0, depth, 0).astype(np.float32), part)

    def close(self) -> None:
        """Free the context."""
        self._renderer.delete()
