"""Frame-to-model tracking: joint point-to-plane ICP and photometric Gauss-Newton, coarse to fine (Eq. 1-3)."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from dsmap.fusion.config import TrackConfig
from dsmap.fusion.lie import exp_se3, inverse, log_se3, solve, uncertainty
from dsmap.fusion.surfels.model_view import ModelView
from dsmap.fusion.tracking.exposure import exposure_gain
from dsmap.fusion.tracking.image_content import Colours, judged
from dsmap.fusion.tracking.motion_filter import Expected
from dsmap.fusion.tracking.observability import (
    EVERYTHING_HELD,
    HELD,
    Unheld,
    at_rest,
    only_held,
    twist_from_metres,
    unheld,
)
from dsmap.fusion.tracking.prealign import RotationAligner
from dsmap.fusion.tracking.rolling_shutter import RowMotion
from dsmap.kernels.camera import Camera
from dsmap.kernels.odometry import NormalEquations, TrackingGates, joint_normal_equations
from dsmap.kernels.registration import Level, MovingRows, Prior, register_on_device
from dsmap.kernels.runtime import stays_on_device
from dsmap.kernels.types import FrameMaps, Surface

_CONVERGED = 3e-5
"""A step below this (metres and radians alike) ends a level: a sixtieth of a pixel at 1 m."""
_OPEN = 0.1
"""Standard deviation [m] of a pose in directions that nothing holds."""
_UNMATCHED = 0.02
"""Cost of a pixel without a match, where starts are compared: as if it were this far off [m]."""
_VGA_WIDTH, _VGA_PIXELS = 640, 640 * 480
"""Published pixel counts are those of this image size."""


@dataclass
class Health:
    """How well one frame was tracked."""

    tracked: bool
    reason: str
    """Why not, in words; empty when tracked."""
    inlier_fraction: float
    """Pixels with an associated model point, of the frame's pixels with depth."""
    rms_icp: float
    """RMS of inlier point-to-plane residuals [m]."""
    rms_rgb: float
    """RMS of photometric residuals, intensity in [0, 1]."""
    covariance: np.ndarray
    """Of the twist (translation [m], rotation [rad]), shape (6, 6)."""
    information_icp: float
    """Share of the information (trace of the normalised J^T J) that comes from ICP."""
    inliers: float
    """Associated pixels, as if the image had 640x480 and every pixel counted."""
    cofactor: np.ndarray
    """Diagonal of (J^T J)^-1 at that many pixels, shape (6,)."""
    comparable: bool = True
    """Whether the frame's colours can be compared with the model's; where not, depth alone decided."""
    unheld: Unheld = EVERYTHING_HELD
    """Directions, of xi in exp(xi^) T_view_camera, that neither depth nor colours tell anything about."""


def _without_colour(icp: NormalEquations, rgb: NormalEquations) -> tuple[NormalEquations, NormalEquations]:
    return icp, NormalEquations(np.zeros_like(rgb.A), np.zeros_like(rgb.b), 0.0, 0)


class Tracker:
    """Estimates T_view_camera: from the current frame to the last view of the model (T_prev_cur of the paper)."""

    def __init__(self, config: TrackConfig, cameras: Sequence[Camera]):
        self.config = config
        self.cameras = cameras
        width: Any = cameras[0].width  # Warp's int32 is an int here
        self.stride = [max(round(step * width / _VGA_WIDTH), 1) for step in config.stride]
        """Every n-th pixel of this image counts, a level."""
        self.aligner = RotationAligner(cameras[-1])
        self.last_coarse: list[tuple[wp.array, wp.array]] | None = None
        """Small images of the last tracked frame, finest first (see RotationAligner.pyramid)."""
        self.last_depth: np.ndarray | None = None
        """Its depth [m], shape (h, w) of the coarsest level."""
        self.last_is_good = True
        """Whether its colours are good to align the next frame with."""

    def colours(self, coarsest: Surface) -> Colours:
        """What the colours of the next frame are good for, by its coarsest level.

        An image that is the last one bit for bit, while the depth is another, hangs.
        """
        light = coarsest.intensity.numpy()
        frozen = (
            self.last_coarse is not None
            and self.last_depth is not None
            and np.array_equal(light, self.last_coarse[0][0].numpy())
            and not np.array_equal(coarsest.vertex.numpy()[..., 2], self.last_depth)
        )
        return judged(light, frozen)

    def remember(self, coarsest: Surface, colours: Colours = Colours.GOOD) -> None:
        """Keep a tracked frame's coarsest level for the next frame's pre-alignment."""
        self.last_coarse = self.aligner.pyramid(coarsest.intensity)
        self.last_depth = coarsest.vertex.numpy()[..., 2].copy()
        self.last_is_good = colours is Colours.GOOD

    def state(self) -> dict[str, np.ndarray]:
        """What is carried from frame to frame."""
        if self.last_coarse is None or self.last_depth is None:
            return {}
        return {
            "tracker.intensity": self.last_coarse[0][0].numpy(), "tracker.depth": self.last_depth,
            "tracker.good": np.array([self.last_is_good]),
        }  # fmt: skip

    def load_state(self, state: dict[str, np.ndarray], device: wp.Device) -> None:
        """Go on where `state` was taken; an older one has only the intensity."""
        if "tracker.intensity" in state:
            intensity = wp.array(state["tracker.intensity"], dtype=wp.float32, device=device)
            self.last_coarse = self.aligner.pyramid(intensity)
            self.last_depth = state.get("tracker.depth")
            self.last_is_good = bool(state.get("tracker.good", [True])[0])

    def track(
        self,
        frame: Sequence[FrameMaps],
        model: ModelView,
        T_view_start: np.ndarray | None = None,
        prealign: bool = True,
        expected: Expected | None = None,
        rows: RowMotion | None = None,
        colours: Colours = Colours.GOOD,
    ) -> tuple[np.ndarray, Health]:
        """Register a frame to a model view.

        Args:
            T_view_start: where the search starts, shape (4, 4); default: the view's own place.
            prealign: turn that first as the images tell, from the last frame's to this one's.
            expected: T_view_camera as the camera's motion tells: one more measurement, and another place to start.
            rows: how the camera moves while the frame's rows are read; None: they are taken at once.
            colours: what the frame's are good for; where they hold nothing, depth alone decides.

        Returns:
            T_view_camera, shape (4, 4), which takes points of the current camera into the model view's, and
            the verdict. The transform of a lost frame is the best that was found: do not use it.
        """
        T_view_camera = np.eye(4)
        usable = colours is Colours.GOOD
        if prealign and self.config.so3 and self.last_coarse is not None and self.last_is_good and usable:
            current = self.aligner.pyramid(frame[-1].intensity)
            T_view_camera[:3, :3] = self.aligner.rotation(current, self.last_coarse)
        if T_view_start is not None:
            T_view_camera = T_view_start @ T_view_camera
        source = [maps.surface for maps in frame]
        comparable = exposure_gain(source[-1], model.level(-1)) if self.config.exposure else 1.0
        gain = comparable if usable else None
        if expected is not None:
            coarsest = self.normal_equations(len(source) - 1, source[-1], model.level(-1), gain, rows)
            T_view_camera = self._better_start(coarsest, T_view_camera, expected)
        T_view_camera, health = self.register(
            source, model, T_view_camera, gain=gain, expected=expected, rows=rows
        )
        return T_view_camera, replace(
            health, comparable=comparable is not None and colours is not Colours.UNTRUE
        )

    def register(
        self,
        source: Sequence[Surface | None],
        model: ModelView,
        T_target_source: np.ndarray,
        iterations: Sequence[int] | None = None,
        gain: float | None = 1.0,
        expected: Expected | None = None,
        rows: RowMotion | None = None,
    ) -> tuple[np.ndarray, Health]:
        """Register one view to another, coarse to fine, down to the model's finest level.

        Args:
            source: a pyramid level each; levels finer than the model's are not used, and may be None.
            T_target_source: first guess, shape (4, 4).
            iterations: a level, fine to coarse; as configured for tracking if None.
            gain: brings the source's exposure to the model's; None: colour takes no part.
            expected: T_target_source as something else tells; it has no part in the verdict.
            rows: of the source, see `track`.

        Returns:
            T_target_source, which takes points of the source camera into the model's, and the verdict.
        """
        iterations = iterations or self.config.iterations
        icp = rgb = None
        open_, rest, T_start = EVERYTHING_HELD, expected, T_target_source
        depth = _middle_depth(source[-1])
        if stays_on_device(wp.get_device(model.level(-1).vertex.device)):
            found = self._on_device(source, model, T_target_source, iterations, gain, expected, rows, depth)
            if found is not None:
                T, icp, rgb = found
                return T, self._verdict(source[model.finest], model.finest, icp, rgb, open_, diverged=False)
        for level in reversed(range(model.finest, len(self.cameras))):
            surface = source[level]
            assert surface is not None, "a view is coarser than what is registered to it"
            equations = self.normal_equations(level, surface, model.level(level), gain, rows)
            for _ in range(iterations[level]):
                icp, rgb = equations(T_target_source)
                # Eq. 3: E = E_icp + w_rgb E_rgb
                joint = icp + self._w_rgb(icp, rgb) * rgb
                A, b = joint.A, joint.b
                open_ = unheld(A, icp.count, depth, model.level(level))
                if len(open_):
                    A, b = only_held(A, b, open_)
                    rest = expected or Expected(T_start, at_rest(depth))
                else:
                    rest = expected
                if rest is not None:
                    Lambda = self._variance(icp, rgb) * rest.information
                    A, b = A + Lambda, b + Lambda @ log_se3(rest.T @ inverse(T_target_source))
                xi = solve(A, b)
                if xi is None:
                    return T_target_source, self._verdict(
                        source[model.finest], model.finest, icp, rgb, open_, diverged=True
                    )
                T_target_source = exp_se3(xi) @ T_target_source
                if np.abs(xi).max() < _CONVERGED * 2**level:
                    break
        diverged = not np.isfinite(T_target_source).all()
        return T_target_source, self._verdict(source[model.finest], model.finest, icp, rgb, open_, diverged)

    def _on_device(
        self,
        source: Sequence[Surface | None],
        model: ModelView,
        T_target_source: np.ndarray,
        iterations: Sequence[int],
        gain: float | None,
        expected: Expected | None,
        rows: RowMotion | None,
        depth: float,
    ) -> tuple[np.ndarray, NormalEquations, NormalEquations] | None:
        """`register` without a look by the host; None where it has to look."""
        levels = []
        for level in reversed(range(model.finest, len(self.cameras))):
            surface = source[level]
            assert surface is not None, "a view is coarser than what is registered to it"
            gates = self._gates(level, 1.0 if gain is None else gain)
            converged = _CONVERGED * 2**level
            levels.append(
                Level(self.cameras[level], gates, surface, model.level(level), iterations[level], converged)
            )
        if not sum(level.iterations for level in levels):
            return None
        moving = None
        if rows is not None:
            moving = MovingRows(rows.readout_s, rows.T_last, rows.seconds, rows.twist(T_target_source))
        return register_on_device(
            levels, T_target_source, w_rgb=self.config.w_rgb, rgb_balance=self.config.rgb_balance, held=HELD,
            from_metres=twist_from_metres(depth), coloured=gain is not None,
            prior=None if expected is None else Prior(expected.T, expected.information), rows=moving,
        )  # fmt: skip

    def normal_equations(
        self,
        level: int,
        source: Surface,
        model: Surface,
        gain: float | None = 1.0,
        rows: RowMotion | None = None,
    ) -> Callable[[np.ndarray], tuple[NormalEquations, NormalEquations]]:
        """Of Eq. 1 and Eq. 2 on one pyramid level: see `joint_normal_equations`, with the configured gates."""
        camera, gates = self.cameras[level], self._gates(level, 1.0 if gain is None else gain)
        equations = joint_normal_equations(camera, gates, source, model, rows.readout_s if rows else 0.0)

        def at(T: np.ndarray) -> tuple[NormalEquations, NormalEquations]:
            icp, rgb = equations(T, rows.twist(T)) if rows else equations(T)
            return (icp, rgb) if gain is not None else _without_colour(icp, rgb)

        return at

    def _better_start(
        self,
        equations: Callable[[np.ndarray], tuple[NormalEquations, NormalEquations]],
        T_rest: np.ndarray,
        expected: Expected,
    ) -> np.ndarray:
        """Where the coarsest level fits best: the last pose as turned, that moved on, or what is expected.

        In front of a bare wall all fit alike, and registration stays where it starts: then the expectation decides.
        """
        T_moved = T_rest.copy()
        T_moved[:3, 3] = expected.T[:3, 3]
        starts = (T_rest, T_moved, expected.T)
        sums = [equations(T) for T in starts]
        variance = min(self._variance(icp, rgb) for icp, rgb in sums)
        costs = []
        for T, (icp, rgb) in zip(starts, sums, strict=True):
            xi = log_se3(expected.T @ inverse(T))
            # A pixel that matches nothing must not be cheaper than one that matches badly.
            data = icp.squares + self.config.w_rgb * rgb.squares - icp.count * _UNMATCHED**2
            costs.append(data + variance * xi @ expected.information @ xi)
        return starts[int(np.argmin(costs))]

    def _variance(self, icp: NormalEquations, rgb: NormalEquations) -> float:
        """Of one residual: residuals of neighbouring pixels are not independent, so it is the mean of all."""
        return (icp.squares + self._w_rgb(icp, rgb) * rgb.squares) / max(icp.count + rgb.count, 1)

    def _w_rgb(self, icp: NormalEquations, rgb: NormalEquations) -> float:
        """The weight of the photometric term: less where the depth is much better than the colour."""
        ratio = (icp.squares / max(icp.count, 1)) / max(rgb.squares / max(rgb.count, 1), 1e-12)
        return min(self.config.w_rgb, self.config.rgb_balance * ratio)

    def _gates(self, level: int, gain: float = 1.0) -> TrackingGates:
        config, gates = self.config, TrackingGates()
        gates.max_distance = config.max_distance
        gates.min_cosine = float(np.cos(np.deg2rad(config.max_angle_deg)))
        # The published thresholds are unnormalised Sobel sums of 8-bit images; ours divide by 8 and by 255.
        gates.min_gradient = config.min_gradient[level] / (8 * 255)
        gates.max_intensity = config.max_intensity_step
        gates.huber_icp, gates.huber_rgb = config.huber_icp, config.huber_rgb
        gates.gain = gain
        gates.noise_z = config.noise_z
        gates.stride = self.stride[level]
        return gates

    def _verdict(
        self,
        source: Surface | None,
        finest: int,
        icp: NormalEquations | None,
        rgb: NormalEquations | None,
        open_: Unheld,
        diverged: bool,
    ) -> Health:
        if icp is None or rgb is None or source is None:
            infinite = np.full((6, 6), np.inf)
            return Health(False, "no iterations", 0.0, np.inf, np.inf, infinite, 0.0, 0.0, infinite[0])
        config, stride = self.config, self.stride[finest]
        sampled = math.prod(-(-n // stride) for n in source.vertex.shape)
        fraction = icp.count / max(icp.seen, 1)
        rms_icp = float(np.sqrt(icp.squares / max(icp.count, 1)))
        rms_rgb = float(np.sqrt(rgb.squares / max(rgb.count, 1)))
        w_rgb = self._w_rgb(icp, rgb)
        A = icp.A + w_rgb * rgb.A
        covariance = uncertainty(A, self._variance(icp, rgb))
        share = float(np.mean(np.diag(icp.A) / np.maximum(np.diag(A), 1e-12)))
        std = (
            float(np.sqrt(np.abs(np.linalg.eigvalsh(covariance)).max()))
            if np.isfinite(covariance).all()
            else np.inf
        )
        reasons = [
            (diverged, "the normal equations have no solution"),
            (icp.seen == 0, "no depth"),
            (fraction < config.min_inlier_fraction, f"only {fraction:.0%} of the pixels match the model"),
            (rms_icp > config.max_rms, f"point-to-plane RMS {rms_icp * 1e3:.1f} mm"),
            (std > config.max_std, f"pose uncertain by {std * 1e3:.1f} mm or mrad"),
        ]
        reason = next((text for bad, text in reasons if bad), "")
        scale = _VGA_PIXELS / sampled
        cofactor = np.diag(uncertainty(scale * only_held(A, np.zeros(6), open_)[0]))
        covariance = covariance + _OPEN**2 * open_.twists.T @ open_.twists
        return Health(
            not reason, reason, fraction, rms_icp, rms_rgb, covariance, share, scale * icp.count, cofactor,
            unheld=open_,
        )  # fmt: skip


def _middle_depth(surface: Surface | None) -> float:
    """Median depth [m] of a surface, 1 where there is none."""
    assert surface is not None, "every pyramid has its coarsest level"
    z = surface.vertex.numpy()[..., 2]
    return float(np.median(z[z > 0])) if (z > 0).any() else 1.0
