"""What to render: the options of a recording, checked, and what follows from them before any frame is rendered."""

from dataclasses import dataclass, replace

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sim_scenes.camera_paths.paths import camera_path
from dsmap.sim_scenes.camera_paths.row_poses import RowPoses
from dsmap.sim_scenes.camera_paths.trials import covered_frames
from dsmap.sim_scenes.physics.kinds import MOVING, set_in_motion
from dsmap.sim_scenes.render.renderer import RENDERERS, Image, Renderer
from dsmap.sim_scenes.scene import Scene
from dsmap.sim_scenes.sensors.colour_camera import STRENGTHS, Effects
from dsmap.sim_scenes.sensors.registry import NOISES, SENSORS


@dataclass(frozen=True)
class RenderOptions:
    """What to render. Everything but `renderer` and `jobs` follows from these values to the byte."""

    scene: str = "living_room"
    """Kind of room (`rooms.SCENES`), or a scene file (`importers.FORMATS`)."""
    seed: int = 1
    frames: int = 300
    """0 = as many as the round trip takes (path `loop` only)."""
    width: int = 640
    height: int = 480
    fps: float = 30.0
    noise: str = "none"
    """`none`, or the depth sensor to imitate: `kinect` (v1), `d435` (RealSense), `azure` (Azure Kinect)."""
    path: str = "walk"
    """`walk` = a hand-held video; `views` = unrelated viewpoints, for training; more in `trajectories.PATHS`."""
    intrinsics: tuple[float, float, float, float] | None = None
    """fx, fy, cx, cy [px] of the images as rendered, integer pixel centres; None = those of the sensor."""
    effects: str = "none"
    """What the colour camera does to its pictures: `none`, `mild`, `strong` (`image_effects`)."""
    distortion: bool = False
    """Give the lens a distortion drawn by the seed (`calibration.yaml` has it; renderer `warp` only)."""
    class_map: str | None = None
    """For a scene file: YAML or CSV of its names or ids and their classes (`class_map`); None = built-in names."""
    up: str | None = None
    """For a scene file: `y` or `z`; None = what its format says."""
    moving: str = "none"
    """Something that moves while the scene is filmed: `none`, `chair`, `door`, `ball`, `person` (`moving`)."""
    readout_s: float = 0.0
    """Rolling shutter of the colour camera: time from an image's first row to its last [s] (renderer `warp` only)."""
    depth_readout_s: float | None = None
    """Likewise of the depth camera; None = as the colour camera's."""
    depth_offset_s: float = 0.0
    """The depth image is taken so much later than the colour image [s]; poses are those of the depth image."""
    renderer: str = "warp"
    jobs: int = 1
    """Frames rendered side by side (threads); the result does not depend on it."""

    def check(self) -> None:
        """Raises InputError for values out of range."""
        least_frames = 0 if self.path == "loop" else 1
        for name, value, least in (
            ("frames", self.frames, least_frames),
            ("width", self.width, 16),
            ("height", self.height, 16),
        ):
            if value < least:
                raise InputError(f"{name} is {value}; expected at least {least}")
        if not self.fps > 0:
            raise InputError(f"fps is {self.fps}; expected a positive number")
        if self.seed < 0:
            raise InputError(f"seed is {self.seed}; expected 0 or more")
        for name, value, known in (
            ("noise", self.noise, NOISES),
            ("renderer", self.renderer, RENDERERS),
            ("moving thing", self.moving, MOVING),
            ("image effects", self.effects, STRENGTHS),
        ):
            if value not in known:
                raise InputError(f"unknown {name} {value!r}; expected one of: {', '.join(known)}")
        if self.intrinsics is not None and not min(self.intrinsics[:2]) > 0:
            raise InputError(
                f"intrinsics are {self.intrinsics}; expected fx, fy, cx, cy with positive fx and fy"
            )
        if self.rolls and self.renderer != "warp":
            raise InputError(
                f"a readout or time offset with renderer {self.renderer!r}; expected warp, the others have none"
            )
        if self.distortion and self.renderer != "warp":
            raise InputError(
                f"distortion with renderer {self.renderer!r}; expected warp, the others have none"
            )

    @property
    def rows_s(self) -> float:
        """Readout of the depth camera [s]."""
        return self.readout_s if self.depth_readout_s is None else self.depth_readout_s

    @property
    def rolls(self) -> bool:
        """Whether every row has a pose of its own."""
        return bool(self.readout_s or self.depth_readout_s or self.depth_offset_s)


@dataclass(frozen=True)
class Take:
    """A recording before it is rendered: the camera and what happens in every frame."""

    scene: Scene
    """What is filmed: the scene that was given, with the bodies of `motion` in it."""
    camera: Intrinsics
    effects: Effects
    poses: np.ndarray
    """T_world_camera of every frame, shape (frames, 4, 4)."""
    covered: np.ndarray
    """Frames in which something covers the lens, bool (frames,)."""
    T_world_body: np.ndarray | None = None
    """Poses of `scene.bodies` in every frame, shape (frames, bodies, 4, 4); None where nothing moves."""
    rows: tuple[RowPoses, float, float, float] | None = None
    """With a rolling shutter: the path, readout of colour and of depth [s], time of the depth after the colour [s]."""

    def shot(self, renderer: Renderer, frame: int) -> Image:
        """A frame's image; with a rolling shutter colour and depth are each read in their own time."""
        bodies = None if self.T_world_body is None else self.T_world_body[frame]
        if self.rows is None:
            return renderer(self.poses[frame], bodies)
        path, colour_s, depth_s, offset_s = self.rows
        depth = renderer(path.rows(frame, self.camera.height, depth_s, offset_s), bodies)
        if colour_s == depth_s and offset_s == 0:
            return depth
        colour = renderer(path.rows(frame, self.camera.height, colour_s), bodies)
        return replace(depth, rgb=colour.rgb)

    def true_pose(self, frame: int) -> np.ndarray:
        """T_world_camera of a frame, (4, 4): when the middle row of its depth was read."""
        if self.rows is None or not self.rows[3]:
            return self.poses[frame]
        path, _, _, offset_s = self.rows
        return path.rows(frame, 3, 0.0, offset_s)[1]


def camera_of_options(options: RenderOptions) -> Intrinsics:
    """The camera of the options: their intrinsics, else those of the sensor they imitate."""
    if options.intrinsics is None:
        camera = SENSORS[options.noise].camera(options.width, options.height)
    else:
        camera = Intrinsics(options.width, options.height, *options.intrinsics)
    if not options.distortion:
        return camera
    lens = Effects.sample("mild", options.seed, lens=True).distortion
    return Intrinsics(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, lens)


def plan_take(scene: Scene, options: RenderOptions) -> Take:
    """All that the options say about a recording of a scene.

    Raises:
        InputError: bad options, or a scene without space for the path.
    """
    options.check()
    motion = None
    if options.moving != "none":
        motion = set_in_motion(scene, options.moving, options.frames / options.fps, options.seed)
        scene = motion.scene
    poses = camera_path(scene, options.path, options.frames, options.fps, options.seed, motion)
    times = np.arange(len(poses)) / options.fps
    rows = None
    if options.rolls:
        path = RowPoses(poses, options.fps, options.path)
        rows = (path, options.readout_s, options.rows_s, options.depth_offset_s)
    return Take(
        scene,
        camera_of_options(options),
        Effects.sample(options.effects, options.seed),
        poses,
        covered_frames(options.path, len(poses), options.fps, options.seed),
        motion.at(times) if motion else None,
        rows,
    )
