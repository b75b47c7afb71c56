"""What a real camera does to a rendered picture: exposure, white balance, blur, vignetting, noise, tone, JPEG.

The renderer's bytes are taken for display values of gamma 2.2. Effects act where they act in a camera: the
light is scaled, falls off towards the corners and is smeared during the exposure, then the sensor adds
photon and read noise, then the picture is toned, stored and perhaps compressed. Depth and labels stay as
they are; only the lens distortion concerns them too, and that one the renderer applies (exactly, by bending
the rays) to a camera whose `Intrinsics.distortion` is `Effects.distortion`.

Everything follows from (`Effects.seed`, frame): frames may be finished in any order, on any thread.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics

STRENGTHS = ("none", "mild", "strong")
"""Names for the command line: nothing; a good camera in fair light; a cheap one in bad light."""

_GAMMA = 2.2
_MEAN_LIGHT = 0.18
"""Mean linear light that auto-exposure steers to (middle grey)."""
_STEPS = 1024
"""Resolution of the table from linear light to display bytes."""


@dataclass(frozen=True)
class Effects:
    """The settings of one camera during one recording. The defaults do nothing."""

    seed: int = 0
    exposure: float = 1.0
    """Factor on the light."""
    auto_exposure: float = 0.0
    """0..1: how far each frame is brought to middle grey by itself (its light times (0.18 / mean) to this power)."""
    white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Factors on red, green, blue light."""
    gamma: float = 1.0
    """Power on the displayed value: below 1 lifts the shadows."""
    contrast: float = 0.0
    """0..1: blend towards an S-curve of the displayed value."""
    saturation: float = 1.0
    """Distance of colours from their grey."""
    vignetting: float = 0.0
    """Share of the light that is lost in the image's corners; grows with the square of the radius."""
    shot_noise: float = 0.0
    """Standard deviation of photon noise at full light (linear, 0..1); grows with the root of the light."""
    read_noise: float = 0.0
    """Standard deviation of the noise in the dark (linear, 0..1)."""
    shutter: float = 0.0
    """Exposure time as a share of the time between frames: what motion blur is drawn from."""
    jpeg: int = 0
    """JPEG quality 1..100; 0 = not compressed."""
    distortion: tuple[float, float, float, float, float] | None = None
    """Radtan k1, k2, p1, p2, k3 of the lens, for the renderer's camera and calibration.yaml."""

    @classmethod
    def none(cls) -> "Effects":
        """No effect: `apply` returns the image itself."""
        return cls()

    @classmethod
    def sample(cls, level: str, seed: int, *, lens: bool = False) -> "Effects":
        """One camera, drawn by seed.

        Args:
            level: one of `STRENGTHS`.
            seed: any number >= 0; the same seed gives the same camera.
            lens: also draw a lens distortion (barrel, at most 4 % of the radius at the image's corners).

        Raises:
            InputError: unknown level.
        """
        if level not in STRENGTHS:
            raise InputError(f"unknown image effects {level!r}; expected one of: {', '.join(STRENGTHS)}")
        if level == "none":
            return cls(seed=seed)
        rng = np.random.default_rng([seed, 0xCA3])
        strong = level == "strong"
        warm = rng.normal(0, 0.16 if strong else 0.07)
        green = rng.normal(0, 0.04 if strong else 0.015)
        k1 = -rng.uniform(0.01, 0.06)
        noise = rng.uniform(0.3, 1.0)
        return cls(
            seed=seed,
            exposure=float(np.exp2(rng.normal(0, 0.45 if strong else 0.2))),
            auto_exposure=float(rng.uniform(0.3, 0.8)),
            white_balance=(float(np.exp(warm)), float(np.exp(green)), float(np.exp(-warm))),
            gamma=float(np.exp(rng.normal(0, 0.12 if strong else 0.05))),
            contrast=float(rng.uniform(0, 0.5)),
            saturation=float(rng.uniform(0.7, 1.2) if strong else rng.uniform(0.85, 1.15)),
            vignetting=float(rng.uniform(0.1, 0.5) if strong else rng.uniform(0, 0.25)),
            shot_noise=float(noise * (0.05 if strong else 0.02)),
            read_noise=float(noise * (0.012 if strong else 0.004)),
            shutter=float(rng.uniform(0.3, 0.9) if strong else rng.uniform(0.1, 0.5)),
            jpeg=int(rng.integers(55, 92)) if strong and rng.random() < 0.6 else 0,
            distortion=(k1, float(rng.uniform(-0.15, 0.1) * k1), 0.0, 0.0, 0.0) if lens else None,
        )

    @property
    def idle(self) -> bool:
        """Whether `apply` leaves every picture as it is."""
        return replace(self, seed=0, distortion=None) == Effects()


def apply(rgb: np.ndarray, effects: Effects, frame: int, flow: np.ndarray | None = None) -> np.ndarray:
    """The picture that the camera would have stored.

    Args:
        rgb: rendered colours, uint8 (H, W, 3).
        effects: the camera.
        frame: number of the frame; its noise follows from this and `effects.seed`.
        flow: movement of each pixel during the exposure [px], float32 (H, W, 2), of `exposure_flow`.

    Returns:
        uint8 (H, W, 3); the input itself where there is nothing to do.
    """
    if effects.idle:
        return rgb
    light = _TO_LINEAR[rgb]
    if flow is not None and effects.shutter > 0:
        light = _smeared(light, flow)
    gain = effects.exposure * np.asarray(effects.white_balance, np.float32)
    if effects.auto_exposure > 0:
        gain = gain * (_MEAN_LIGHT / max(float(light.mean()), 1e-3)) ** effects.auto_exposure
    light *= gain.astype(np.float32)
    if effects.vignetting > 0:
        light *= _vignette(rgb.shape[0], rgb.shape[1], effects.vignetting)
    if effects.shot_noise > 0 or effects.read_noise > 0:
        _add_noise(light, effects, frame)
    toned = _tone_table(effects)[(np.clip(light, 0, 1) * (_STEPS - 1) + 0.5).astype(np.int32)]
    if effects.saturation != 1.0:
        toned = _saturated(toned, effects.saturation)
    return _compressed(toned, effects.jpeg) if effects.jpeg else toned


def exposure_flow(
    depth: np.ndarray,
    camera: Intrinsics,
    T_world_camera: np.ndarray,
    T_world_neighbour: np.ndarray,
    effects: Effects,
) -> np.ndarray | None:
    """How far each pixel's surface point moves in the image while the shutter is open, by the camera's motion.

    The motion towards the neighbouring frame is taken as constant. Things that move by themselves are smeared
    as if they stood still, and the distortion of the lens is left out of the flow (it changes it by a few
    per cent). Pixels without depth move as at 10 m.

    Args:
        depth: planar depth of this frame [m], (H, W).
        camera: its intrinsics.
        T_world_camera: pose of this frame, (4, 4).
        T_world_neighbour: pose of the frame before or after, (4, 4).
        effects: `shutter` scales the movement.

    Returns:
        float32 (H, W, 2) [px], or None where nothing moves half a pixel.
    """
    if effects.shutter <= 0:
        return None
    T_neighbour_camera = np.linalg.inv(T_world_neighbour) @ T_world_camera
    u, v = np.meshgrid(np.arange(camera.width, dtype=np.float32), np.arange(camera.height, dtype=np.float32))
    z = np.where(depth > 0, depth, 10.0).astype(np.float32)
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], -1)
    # float64 x float32 arrays would double the cost
    R, t = T_neighbour_camera[:3, :3].astype(np.float32), T_neighbour_camera[:3, 3].astype(np.float32)
    moved = (rays @ R.T) * z[..., None] + t
    ahead = np.maximum(moved[..., 2], 0.05)
    flow = np.stack(
        [
            camera.fx * moved[..., 0] / ahead + camera.cx - u,
            camera.fy * moved[..., 1] / ahead + camera.cy - v,
        ],
        -1,
    )
    flow *= effects.shutter
    limit = 0.12 * camera.width  # nearer than the near plane nothing is rendered, but the formula still runs
    np.clip(flow, -limit, limit, out=flow)
    return flow if float(np.abs(flow).max()) >= 0.5 else None


def frame_tremor(effects: Effects, frame: int) -> np.ndarray:
    """The hand's movement between two frames, for pictures that have no neighbour, shape (4, 4).

    Drawn by (seed, frame): rotations of about 0.6 degrees, now and then three times that; 3 mm.
    """
    rng = np.random.default_rng([effects.seed, frame, 0x7E])
    turn = np.radians(0.6) * rng.normal(size=3) * (3.0 if rng.random() < 0.15 else 1.0)
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(turn)[0]
    T[:3, 3] = 0.003 * rng.normal(size=3)
    return T


_TO_LINEAR = ((np.arange(256) / 255.0) ** _GAMMA).astype(np.float32)


def _smeared(light: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """Mean of the picture shifted along each pixel's own flow, centred on the middle of the exposure.

    Gathering: what is sharp stays sharp at its outline even where it passes before something else.
    """
    height, width = light.shape[:2]
    longest = float(np.abs(flow).max())
    samples = int(np.clip(np.ceil(longest), 3, 15))
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    total = np.zeros_like(light)
    for s in np.linspace(-0.5, 0.5, samples, dtype=np.float32):
        total += cv2.remap(
            light,
            u + s * flow[..., 0],
            v + s * flow[..., 1],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
    return total / samples


def _vignette(height: int, width: int, loss: float) -> np.ndarray:
    """Factor on the light, (H, W, 1): 1 in the centre, 1 - loss in the corners."""
    y = (np.arange(height, dtype=np.float32) - (height - 1) / 2)[:, None]
    x = (np.arange(width, dtype=np.float32) - (width - 1) / 2)[None]
    corner = (height / 2) ** 2 + (width / 2) ** 2
    return (1 - loss * (x**2 + y**2) / corner)[..., None]


def _add_noise(light: np.ndarray, effects: Effects, frame: int) -> None:
    """Photon and read noise, in place; slightly smoothed in colour, as demosaicing does."""
    rng = np.random.default_rng([effects.seed, frame, 0x401])
    noise = rng.standard_normal(light.shape, dtype=np.float32)
    noise = 0.75 * noise + 0.6 * cv2.blur(noise, (3, 3))
    spread = np.sqrt(effects.shot_noise**2 * np.clip(light, 0, 1) + effects.read_noise**2)
    light += spread * noise


def _tone_table(effects: Effects) -> np.ndarray:
    """Linear light, in `_STEPS` steps, to display bytes."""
    shown = np.linspace(0, 1, _STEPS) ** (effects.gamma / _GAMMA)
    curve = shown * shown * (3 - 2 * shown)
    return np.rint(255 * (shown + effects.contrast * (curve - shown))).astype(np.uint8)


def _saturated(rgb: np.ndarray, factor: float) -> np.ndarray:
    """Colours moved from their grey by `factor`, uint8."""
    grey = np.array([0.299, 0.587, 0.114])
    matrix = factor * np.eye(3) + (1 - factor) * grey[None]
    return cv2.transform(rgb, matrix.astype(np.float32))


def _compressed(rgb: np.ndarray, quality: int) -> np.ndarray:
    """Through JPEG and back, uint8."""
    _, data = cv2.imencode(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    decoded = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert decoded is not None
    return np.ascontiguousarray(decoded[..., ::-1])
