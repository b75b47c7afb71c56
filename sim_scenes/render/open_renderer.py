"""A renderer by its name: mujoco-warp's ray tracer, or one of the OpenGL renderers."""

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sim_scenes.render.renderer import RENDERERS, Renderer
from dsmap.sim_scenes.render.rolling import RollingRenderer
from dsmap.sim_scenes.render.warp_renderer import WarpRenderer
from dsmap.sim_scenes.scene import Scene


def open_renderer(
    name: str,
    scene: Scene,
    camera: Intrinsics,
    *,
    shadows: bool = True,
    smooth: bool = False,
    rolling: bool = False,
) -> Renderer:
    """A renderer by name (`RENDERERS`).

    Args:
        name: `warp`, `mujoco` or `pyrender`.
        scene: what to render.
        camera: any pinhole camera; `warp` renders lens distortions too.
        shadows: of the lights; the ray tracer needs about half the time without them.
        smooth: colour as the mean of four rays a pixel, about four times the cost (`warp`; the others
            always smooth a little). Depth and labels are those of the pixel's centre in any case.
        rolling: it is called with a pose for every row, shape (H, 4, 4) (`warp` only).

    Raises:
        InputError: unknown name, or its system library is missing (says which package brings it).
    """
    if rolling:
        return RollingRenderer(scene, camera, shadows)
    if name == "warp":
        return WarpRenderer(scene, camera, shadows, smooth)
    if name in RENDERERS:
        from dsmap.sim_scenes.render import opengl

        return opengl.open_opengl(name, scene, camera, shadows)
    raise InputError(f"unknown renderer {name!r}; expected one of: {', '.join(RENDERERS)}")
