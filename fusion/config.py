"""Every parameter of mapping, with the published constants as defaults (sources in docs/method/overview.md)."""

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Annotated, Literal

from dsmap.errors import InputError
from dsmap.ranges import Degrees, Every, Frames, Metres, Range, Seed, Share, Side
from dsmap.sequences import Sequence

_KINECT_REACH = 4.0
"""Metres to which Kinect-like sensors are made to measure."""
_STABLE_WEIGHT, _USUAL_RATE, _LEAST_STABLE = 10.0, 30.0, 2.0
"""A surfel is stable after so many measurements at so many frames a second, and never after fewer than the least."""
_TOGETHER = 0.85
"""Temperature of the geometric mean: a surfel's views count as 1 / 0.85 independent ones."""
_MAX_READOUT_S = 0.1
"""Nobody reads an image for longer than three frames."""


@dataclass
class TrackConfig:
    """Frame-to-model tracking (Eq. 1-3)."""

    iterations: Annotated[tuple[int, ...], Range(0, 1000, length=3)] = (6, 5, 4)
    """Gauss-Newton iterations a pyramid level, fine to coarse; each level stops early when it converges."""
    stride: Annotated[tuple[int, ...], Range(1, 64, length=3)] = (4, 2, 1)
    """Every n-th pixel in both directions counts, a level, in images 640 pixels wide; in smaller ones as many more, as
    far as there are: 19,200 points constrain six numbers amply."""
    w_rgb: Annotated[float, Range(0, 1000)] = 0.1
    """Weight of the photometric term (Eq. 3), at most; metres and intensities in [0, 1]."""
    rgb_balance: Annotated[float, Range(0, 1e6)] = 8.0
    """w_rgb falls to this times (mean squared point-to-plane distance / mean squared intensity difference) where
    that is less: exact depth must not be pulled off by shading and compression."""
    max_distance: Annotated[float, Range(0, 10, above=True)] = 0.10
    """ICP gate: largest distance between associated points [m]."""
    max_angle_deg: Annotated[float, Range(0, 180, above=True)] = 20.0
    """ICP gate: largest angle between associated normals [deg]."""
    min_gradient: Annotated[tuple[float, ...], Range(0, 10_000, length=3)] = (5.0, 3.0, 1.0)
    """Photometric gate a level: smallest unnormalised Sobel sum [8-bit units]."""
    max_intensity_step: Annotated[float, Range(0, 10, above=True)] = 0.3
    """Photometric gate: largest difference of intensities; larger ones are occlusions or highlights."""
    huber_icp: Annotated[float, Range(0, 10)] = 0.01
    """Residual [m] from which ICP weights fall; 0 = plain least squares."""
    huber_rgb: Annotated[float, Range(0, 10)] = 0.05
    """Residual (intensity in [0, 1]) from which photometric weights fall; 0 = plain least squares."""
    noise_z: Annotated[float, Range(0, 1000)] = 0.0
    """Depth-dependent weight 1 / (1 + noise_z z^2)^2 of ICP residuals; 0 = all alike."""
    exposure: bool = True
    """The photometric term allows for another exposure of the frame than of the model: one factor a frame."""
    so3: bool = True
    """Tracking begins with a pre-alignment of the rotation alone on the coarsest level."""
    view_width: Annotated[int, Range(1, 1_000_000)] = 480
    """The model is predicted, and frames are registered to it, on the finest pyramid level of at most this many
    columns: a map of a few millimetres shows no more in larger images. Levels halve: 640 columns become 320."""
    min_inlier_fraction: Share = 0.1
    """A frame is lost if a smaller share of its pixels (of those with depth that fall into the model view) is
    associated."""
    max_rms: Annotated[float, Range(0, 10, above=True)] = 0.03
    """A frame is lost if the RMS of its inliers' point-to-plane residuals is larger [m]."""
    max_std: Annotated[float, Range(0, 1000, above=True)] = 0.02
    """A frame is lost if the standard deviation of its pose is larger in any direction [m, rad]."""
    motion: bool = True
    """The last frames' motion is one more measurement, as certain as it has been steady."""
    min_acceleration: Annotated[float, Range(0, 10_000, above=True)] = 0.5
    """The motion prior expects at least this acceleration [m/s^2] (RMS an axis; more where it has been seen)."""
    min_angular_acceleration: Annotated[float, Range(0, 10_000, above=True)] = 3.0
    """The motion prior expects at least this angular acceleration [rad/s^2] (RMS an axis)."""
    predict_every: Every = 2
    """The model is predicted in every n-th frame, and in between where the camera has left the last predicted view."""
    predict_distance: Metres = 0.02
    """The camera has left the last predicted view when it has moved this far [m]."""
    predict_angle_deg: Degrees = 1.5
    """The camera has left the last predicted view when it has turned this far [deg]."""
    doubt_distance: Metres = 0.03
    """A pose this far [m] from where constant motion leads is compared with the map over the whole image."""
    doubt_angle_deg: Degrees = 3.0
    """A pose turned this far [deg] from where constant motion leads is compared with the map over the whole image."""
    doubt_inlier_fraction: Share = 0.4
    """A pose with a smaller share of matched pixels is compared with the map over the whole image; so is every first
    pose after lost frames."""


@dataclass
class SurfelConfig:
    """The surfel map."""

    resolution: Annotated[float, Range(0, 1)] = 0.0
    """Finest resolution of the map [m]: a surfel stands for the surface this far around it, and no disc is smaller. 0:
    about a surfel a pixel of the nearest view."""
    max_ray_distance: Annotated[float, Range(0, 10, above=True)] = 0.05
    """Association: largest distance along the viewing ray [m]; far away ray_distance_z2 allows more."""
    ray_distance_z2: Annotated[float, Range(0, 10)] = 0.008
    """Association: largest distance along the viewing ray as a multiple of depth squared [1/m], where that is more than
    max_ray_distance: three sigma of a Kinect-like sensor."""
    max_angle: Annotated[float, Range(0, 3.2, above=True)] = 0.5
    """Association: largest angle between normals [rad]."""
    stable_weight: Annotated[float | None, Range(0, 1e6)] = None
    """A surfel is stable from this confidence on, which is about its number of measurements; without it 10, and of a
    recording with less than 30 frames a second as many fewer, but 2: there a surface is seen in fewer frames."""
    unstable_frames: Frames = 20
    """An unstable surfel not seen for this many frames is dropped."""
    clean_every: Every = 3
    """Unstable surfels are dropped and the map is compacted in every n-th frame."""
    active_window: Annotated[int, Range(1, 1_000_000_000)] = 400
    """Surfels updated within this many frames are active; with loops off all are."""


@dataclass
class LabelConfig:
    """Label fusion (Eq. 5-6)."""

    rule: Literal["bayes", "mean", "geometric"] = "geometric"
    """How a surfel's labels of many views are combined. bayes: the paper's product (Eq. 5-6), over-confident by
    nature; geometric: its n-th root, the same labels with honest probabilities; mean: arithmetic mean."""
    every: Annotated[int, Range(0, 1_000_000)] = 0
    """Segment every n-th frame; 0: keyframes only, which make better maps: neighbouring frames repeat a mistake."""
    keyframe_distance: Metres = 0.1
    """A frame becomes a keyframe for labels when it has moved this far [m] from the last one."""
    keyframe_angle_deg: Degrees = 6.0
    """A frame becomes a keyframe for labels when it has turned this far [deg] from the last one."""
    mirror: bool = True
    """Every second frame that is labelled is shown to the segmenter mirrored: its mistakes differ there, and fusion
    averages them out, at no cost."""
    floor: Annotated[float, Range(0, 0.07, above=True)] = 1e-3
    """Smallest probability of a class: one zero must not kill a class for good."""
    smooth: Annotated[float, Range(0, 1)] = 0.1
    """Probabilities are averaged over the surface within this radius [m] before they are fused; 0: as they are."""
    sureness: Annotated[float, Range(0, 100)] = 2.0
    """An observation of entropy H weighs (1 - H / log 13) to this power; 0: all alike, as always with bayes (Eq. 5)."""
    temperature: Annotated[float | None, Range(0, 1000, above=True)] = None
    """The posterior's log is divided by this; over-confident products want more than 1. Without it 0.85 for geometric:
    views that agree are surer together than the mean of them; 1 for the other rules."""

    @property
    def posterior_temperature(self) -> float:
        """What the posterior's log is divided by."""
        if self.temperature is not None:
            return self.temperature
        return _TOGETHER if self.rule == "geometric" else 1.0


@dataclass
class LoopConfig:
    """Loop closure (Eq. 4). Pixel counts and covariances are those of a 640x480 image and are scaled."""

    mode: Literal["on", "local", "global", "off"] = "on"
    """Close loops. local: active view against inactive view; global: by keyframes; on: both; off: none, and no search
    when the camera is lost."""
    view_width: Side = 320
    """The inactive model is predicted on the finest pyramid level of at most this many columns."""
    iterations: Annotated[int, Range(1, 1000)] = 10
    """Gauss-Newton iterations a level of registering the active view to the inactive one."""
    max_mean_square: Annotated[float, Range(0, 1, above=True)] = 5e-5
    """Gate of a loop: largest mean squared point-to-plane distance [m^2]."""
    min_inliers: Annotated[int, Range(0, 1_000_000_000)] = 35000
    """Gate of a loop: least number of matched pixels."""
    max_covariance: Annotated[float, Range(0, 1e6, above=True)] = 4e-4
    """Gate of a loop: largest diagonal entry of (J^T J)^-1 for E_icp + 0.1 E_rgb in metres (1e-5 for 100 E_icp + E_rgb
    would be 1e-3). Measured on a rendered flat: errors of 1 to 7 mm below 4e-4, of 9 to 27 mm from 5e-4 to 1e-3."""
    min_agreement: Share = 0.7
    """Gate of a loop: least share of the pixels seen in both views, after registration, that are one surface."""
    min_ncc: Annotated[float, Range(-1, 1)] = 0.4
    """Gate of a loop: least correlation of the intensities, local mean off: other places have other colours."""
    max_drift: Annotated[float, Range(0, 10)] = 0.05
    """Gate of a loop: it moves the camera by at most this share of the way since, plus 5 cm."""
    negligible: Annotated[float, Range(0, 10)] = 0.04
    """Views that differ by less than this [m RMS] are one: inactive surfels become active, nothing is deformed.
    Tracking (gate 10 cm) pulls that together where it is; a deformation would spread it over the whole way since."""
    pose_graph: bool = False
    """Bend the map as a pose graph of loops and tracking's covariances says, not evenly in time. Not proven yet."""
    min_overlap: Share = 0.25
    """Gate of a loop: least share of the image that both views see; narrower strips register with errors of 2 cm."""
    trust: Frames = 30
    """After a loop, surfels that come into view need only agree with the active view for this many frames."""
    retry: Frames = 3
    """After a registration that was not believed, the next one is tried this many frames later."""
    constraint_grid: Annotated[int, Range(2, 1000)] = 20
    """Columns of the grid of pixels from which constraints are taken."""
    global_every: Every = 5
    """Keyframes are asked in every n-th frame."""


@dataclass
class FernConfig:
    """Keyframe database for global loops and relocalisation (Glocker et al. 2015)."""

    count: Annotated[int, Range(1, 2000)] = 500
    """Ferns: pixels of the small view, each with one test of R, G, B and depth."""
    width: Annotated[int, Range(8, 640)] = 80
    """Columns of the small view [px]; its height follows from the image."""
    seed: Seed = 0
    """Seed of the ferns' pixels and thresholds."""
    novelty: Share = 0.3
    """A view at least this unlike every keyframe (share of ferns that differ) becomes a keyframe."""
    min_overlap: Share = 0.3
    """Two views are comparable if this share of the ferns has data in both."""
    min_similarity: Share = 0.3
    """A candidate is more like the view than this."""
    min_age: Frames = 300
    """A candidate for a loop is at least this many frames old."""
    candidates: Annotated[int, Range(1, 1000)] = 5
    """How many of the most similar keyframes are verified."""


@dataclass
class RelocaliseConfig:
    """When a pose found in the map without a guess is believed."""

    rounds: Annotated[int, Range(1, 100)] = 2
    """Registrations at full size, each against the model predicted anew."""
    small_inlier_fraction: Share = 0.25
    """Small views of frame and keyframe register if this share of the pixels finds a partner."""
    min_inlier_fraction: Share = 0.2
    """Share of the frame's pixels with depth that must match the model."""
    max_rms: Annotated[float, Range(0, 10, above=True)] = 0.015
    """A found pose has at most this RMS of point-to-plane residuals [m]."""
    max_std: Annotated[float, Range(0, 1000, above=True)] = 0.005
    """A found pose has at most this standard deviation in any direction [m, rad]."""
    slack: Annotated[float, Range(0, 10)] = 0.02
    """Depths of frame and model agree if they differ by less than this [m], plus slack_z2 times depth squared."""
    slack_z2: Annotated[float, Range(0, 10)] = 0.01
    """Depths of frame and model agree if they differ by less than slack plus this times depth squared [1/m]."""
    min_overlap: Share = 0.25
    """The model covers at least this share of the frame's depth image."""
    min_same: Share = 0.8
    """The depths agree in at least this share of what the model covers."""
    max_seen_through: Share = 0.1
    """The frame looks through a surface of the model in at most this share of what the model covers."""
    certain_seen_through: Share = 0.02
    """A pose is believed at once if the frame looks through the model in less than this share; from more, `sightings`
    frames have to agree. True poses of rendered rooms have at most 1 %, those of a Kinect up to 7 %; one that sat a
    kitchen cabinet too far had 4 %."""
    sightings: Annotated[int, Range(1, 1000)] = 3
    """A pose that is not certain is believed once this many frames in a row have found the same place."""
    min_ncc: Annotated[float, Range(-1, 1)] = 0.55
    """The intensities of frame and model correlate by at least this, local mean taken off."""
    min_texture: Annotated[float, Range(-1, 1)] = 0.55
    """The intensities correlate by at least this with contrast made alike everywhere: the grain of a door, not only its
    frame, has to fit."""
    max_rival: Annotated[float, Range(0, 2)] = 0.01
    """Another shift of the image may raise the correlation of textures by at most this: if it raises it more, the true
    place is a repetition further."""


@dataclass
class GraphConfig:
    """The deformation graph: E = w_rot E_rot + w_reg E_reg + w_con (E_con + E_pin)."""

    spacing: Annotated[int, Range(1, 1_000_000_000)] = 5000
    """One node per this many surfels, at 640x480; scaled with the number of pixels."""
    min_nodes: Annotated[int, Range(4, 100_000)] = 32
    """A small map has at least this many nodes."""
    max_nodes: Annotated[int, Range(4, 100_000)] = 3000
    """A large map has at most this many nodes: the time of a fit grows with them."""
    window: Annotated[int, Range(4, 1000)] = 20
    """Nodes that may move a point: those nearest to its time, and half as many as this before and after them."""
    w_rot: Annotated[float, Range(0, 1e9)] = 1.0
    """Weight of E_rot, by which nodes move rigidly."""
    w_reg: Annotated[float, Range(0, 1e9)] = 10.0
    """Weight of E_reg, by which neighbouring nodes agree."""
    w_con: Annotated[float, Range(0, 1e9, above=True)] = 100.0
    """Weight of constraints and pins."""
    iterations: Annotated[int, Range(1, 1000)] = 20
    """A fit of the graph takes at most this many Gauss-Newton iterations."""
    max_constraint: Annotated[float, Range(0, 100, above=True)] = 0.02
    """A fit is refused if constraints or pins are off by more than this [m, RMS]."""
    max_strain: Annotated[float, Range(0, 1000, above=True)] = 0.05
    """A fit is refused if it strains the map by more than this (RMS of E_rot)."""


@dataclass
class MovingConfig:
    """People and objects that move."""

    mode: Literal["mask", "off"] = "mask"
    """What happens to moving things. mask: points in what was free space lately are neither fused nor labelled; off:
    everything is fused."""
    memory: Annotated[int, Range(1, 10_000)] = 60
    """What has stood still for this many frames is static."""
    width: Side = 160
    """Moving things are looked for on the finest pyramid level of at most this many columns."""
    min_share: Share = 0.002
    """A moving thing that fills less than this share of the image counts as noise."""


@dataclass
class SegmentConfig:
    """Geometric segments of the finished map, and the things that are made of them."""

    cell: Annotated[float, Range(0.001, 10)] = 0.02
    """Surfels are grouped into cells of this side [m]."""
    scale: Annotated[float, Range(0, 1e6)] = 3.0
    """How reluctantly segments part: larger makes larger segments."""
    min_area: Annotated[float, Range(0, 1000)] = 0.004
    """Segments smaller than this [m^2] join the neighbour that they are least parted from."""
    small_cost: Annotated[float, Range(0, 1e6)] = 0.5
    """Small segments stay apart where the crease between them costs more than this (1: a right angle)."""
    colour: Annotated[float, Range(0, 1e6)] = 2.0
    """Cost of a step in colour, RGB in [0, 1], against that of a concave right angle (1)."""
    label: Annotated[float, Range(0, 1e6)] = 1.0
    """Cost of neighbours that have no class in common."""
    weight: Share = 0.8
    """Share of its segment in a surfel's log probabilities; 0: nothing changes, 1: a segment has one class."""
    sharpness: Annotated[float, Range(0, 100, above=True)] = 1.3
    """Power of the pooled probabilities: what most of a segment says is right more often than its share."""
    least_thing: Annotated[float, Range(0, 1e6)] = 0.008
    """Surface of the smallest thing [m^2]; smaller pieces of one class belong to nothing."""
    least_plane: Annotated[float, Range(0, 1e6)] = 0.15
    """Surface of the smallest piece of wall, floor, ceiling or window [m^2]."""


@dataclass
class CrfConfig:
    """The fully connected CRF over a finished map, with SemanticFusion's weights (McCormac et al. 2017)."""

    cell: Annotated[float, Range(0.001, 10)] = 0.02
    """Surfels are grouped into cells of this side [m]."""
    iterations: Annotated[int, Range(0, 1000)] = 10
    """Mean field steps."""
    position: Annotated[float, Range(0.001, 10)] = 0.05
    """Standard deviation of both kernels in space [m]."""
    colour: Annotated[float, Range(0, 1e6, above=True)] = 20.0
    """Standard deviation of the colour kernel, RGB in 0..255."""
    normal: Annotated[float, Range(0, 1e6, above=True)] = 0.1
    """Standard deviation of the normal kernel [rad]."""
    weight_colour: Annotated[float, Range(0, 1e6)] = 10.0
    """Weight of the kernel of position and colour."""
    weight_normal: Annotated[float, Range(0, 1e6)] = 3.0
    """Weight of the kernel of position and normal."""
    temperature: Annotated[float, Range(0, 1000, above=True)] = 3.0
    """The refined log probabilities are divided by this."""


@dataclass
class MapConfig:
    """All of a run's parameters; those that are None come from the recording's calibration."""

    device: str = "cpu"
    """Where kernels and network run: cpu, cuda, cuda:N or auto (cuda where there is one)."""
    depth_min: Annotated[float, Range(0, 1000)] = 0.3
    """Ignore nearer depth [m], in tracking, fusion and labels alike."""
    depth_max: Annotated[float | None, Range(0, 1000, above=True)] = None
    """Ignore farther depth [m], in tracking, fusion and labels alike; without it the calibration's depth_max, else 4,
    what Kinect-like sensors are made for."""
    poses: Literal["track", "given"] = "track"
    """track: estimate the camera's motion; given: take the recording's poses."""
    readout_s: Annotated[float | None, Range(-_MAX_READOUT_S, _MAX_READOUT_S)] = None
    """Rolling shutter: time from an image's first row to its last [s]; 0: all rows at once, negative: from below;
    without it the calibration's, else 0."""
    camera_up: Literal["auto", "top", "right", "bottom", "left"] = "auto"
    """The side of the image that is up, roughly: networks are shown upright images, and up begins there. auto: the
    top, or the bottom once the map shows that the camera hangs upside down. A phone held upright is filmed with right
    or left."""
    track: TrackConfig = field(default_factory=TrackConfig)
    surfels: SurfelConfig = field(default_factory=SurfelConfig)
    labels: LabelConfig = field(default_factory=LabelConfig)
    moving: MovingConfig = field(default_factory=MovingConfig)
    loops: LoopConfig = field(default_factory=LoopConfig)
    ferns: FernConfig = field(default_factory=FernConfig)
    relocalise: RelocaliseConfig = field(default_factory=RelocaliseConfig)
    graph: GraphConfig = field(default_factory=GraphConfig)

    @property
    def depth_range(self) -> tuple[float, float]:
        """Nearest and farthest depth that counts [m]."""
        return self.depth_min, _KINECT_REACH if self.depth_max is None else self.depth_max

    @property
    def stable_weight(self) -> float:
        """Confidence from which a surfel is stable."""
        return _STABLE_WEIGHT if self.surfels.stable_weight is None else self.surfels.stable_weight

    @property
    def shutter_s(self) -> float:
        """Time from an image's first row to its last [s]; 0: all rows at once."""
        return self.readout_s or 0.0

    def resolved_for(self, sequence: Sequence) -> "MapConfig":
        """A copy in which numbers stand for what was left to the recording's calibration.

        Raises:
            InputError: the range of depth is empty, or the readout takes longer than any camera's.
        """
        far = sequence.depth_max if self.depth_max is None else self.depth_max
        readout = sequence.readout_s if self.readout_s is None else self.readout_s
        resolved = dataclasses.replace(self, depth_max=far, readout_s=readout)
        near, far = resolved.depth_range
        if not 0 <= near < far < math.inf:
            raise InputError(f"depth range is {near}..{far} m; expected 0 <= --depth-min < --depth-max")
        if not abs(readout) <= _MAX_READOUT_S:
            raise InputError(
                f"readout_s is {readout}; expected seconds from an image's first row to its last, e.g. 0.026"
            )
        if self.surfels.stable_weight is None:
            weight = _STABLE_WEIGHT * min((sequence.frame_rate or _USUAL_RATE) / _USUAL_RATE, 1.0)
            stable = max(float(round(weight)), _LEAST_STABLE)  # rounded: 29.97 frames a second are 30
            resolved.surfels = dataclasses.replace(self.surfels, stable_weight=stable)
        return dataclasses.replace(resolved, depth_max=far)
