"""ROS 1 and ROS 2 bags: `.bag`, `.db3`, `.mcap`, or a folder of them; topics are found by their types."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.lens import coefficients
from dsmap.sequences.associate import associate
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.formats.bag import Bag, Stamp, Topic, is_bag
from dsmap.sequences.formats.parts import Stamped, recording_by_stamp, same_size, two_cameras
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.formats.ros_image import depth_units, kind, pixels
from dsmap.sequences.formats.ros_poses import with_pose_topic
from dsmap.sequences.formats.ros_tf import FrameTree
from dsmap.sequences.images import Packed

_IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
_CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
_ALIGNED = ("aligned", "registered", "depth_to_color", "depth_to_rgb")
"""In the name of a depth topic that is seen from the colour camera."""
_TRANSPORTS = ("compressed", "compressedDepth", "ffmpeg", "theora", "zstd")


@dataclass(frozen=True)
class Stream:
    """One topic of images, as its first message shows it."""

    topic: Topic
    kind: str
    """`depth`, `colour` or `grey`."""
    frame_id: str
    units: float
    """Stored units per metre, of depth."""


def _read(path: Path, options: Options) -> Recording:
    bag = Bag(path)
    colour, depth, notes = choose_streams(bag, options)
    frames = FrameTree(bag)
    calibration = _calibration(bag, colour, depth, frames, notes)
    recording = read_streams("ros", bag, colour, depth, calibration, notes)
    frame_id = colour.frame_id if calibration is None or calibration.color_camera is None else depth.frame_id
    recording = frames.with_poses(recording, frame_id)
    if any(entry.T_world_camera is not None for entry in recording.entries):
        return recording
    return with_pose_topic(bag, frames, recording, frame_id.lstrip("/"))


READER = Reader("ros", is_bag, _read)


def choose_streams(bag: Bag, options: Options) -> tuple[Stream, Stream, list[str]]:
    """The colour and the depth topic to read, and notes on the choice.

    Raises:
        InputError: there is no colour or no depth topic, or the one asked for is not there.
    """
    streams: list[Stream] = []
    for topic in bag.of_type(*_IMAGES):
        first = bag.first(topic)
        what = kind(first)
        if what is not None:
            streams.append(Stream(topic, what, first.header.frame_id, depth_units(first)))
    colour = _chosen(bag, streams, "colour", options.color_topic, "--color-topic", _colour_rank)
    depth = _chosen(bag, streams, "depth", options.depth_topic, "--depth-topic", _depth_rank)
    notes = [f"colour from {colour.topic.name}, depth from {depth.topic.name}"]
    others = [s.topic.name for s in streams if s.topic.name not in (colour.topic.name, depth.topic.name)]
    if others and not (options.color_topic and options.depth_topic):
        notes[0] += f"; not read: {', '.join(sorted(others))} (choose by --color-topic and --depth-topic)"
    return colour, depth, notes


def read_streams(
    layout: str, bag: Bag, colour: Stream, depth: Stream, calibration: Calibration | None, notes: list[str]
) -> Recording:
    """Pair the images of two topics by their headers' stamps, or by when they were recorded. Raises InputError."""
    stamps = [bag.stamps(stream.topic) for stream in (colour, depth)]
    if _partners(stamps) < 0.5 * min(map(len, stamps)):  # two clocks: a camera's own and the computer's
        recorded = [[replace(s, time=s.recorded_ns / 1e9) for s in found] for found in stamps]
        if _partners(recorded) > _partners(stamps):
            notes.append(
                "paired by when the images were recorded: their headers' stamps are of different clocks"
            )
            stamps = recorded
    images, depth_images = (
        [Stamped(s.time, _packed(bag, stream.topic, s)) for s in found]
        for stream, found in zip((colour, depth), stamps, strict=True)
    )
    return recording_by_stamp(layout, bag.path, images, depth_images, calibration, notes)


def _partners(stamps: list[list[Stamp]]) -> int:
    if not all(stamps):
        return 0
    first, second = (np.sort([s.time for s in found]) for found in stamps)
    return len(associate(first, second))


def _packed(bag: Bag, topic: Topic, stamp: Stamp) -> Packed:
    return Packed(bag.path, f"{topic.name} at {stamp.time:.6f} s", partial(_pixels, bag, topic, stamp))


def topic_camera(bag: Bag, topic: Topic, notes: list[str]) -> tuple[Intrinsics, str] | None:
    """The camera of an image topic and the name of the CameraInfo topic that says so."""
    infos = bag.of_type(_CAMERA_INFO)
    if not infos:
        return None
    shared = {info.name: _shared_segments(info.name, topic.name) for info in infos}
    best = max(infos, key=lambda info: (shared[info.name], -len(info.name)))
    if len(infos) > 1 and shared[best.name] == 0:
        return None
    message = bag.first(best)
    K = np.array(getattr(message, "K", getattr(message, "k", None)), np.float64)
    D = np.array(getattr(message, "D", getattr(message, "d", ())), np.float64)
    P = np.array(getattr(message, "P", getattr(message, "p", ())), np.float64)
    if K.size != 9 or not (K[0] > 0 and K[4] > 0) or not message.width:
        return None
    distortion = None
    if (
        "rect" in topic.name.split("/")[-1 if not topic.name.endswith(_TRANSPORTS) else -2]
        and P.size == 12
        and P[0] > 0
    ):
        K = P.reshape(3, 4)[:, :3].ravel()  # rectified images are those of the projection matrix
    elif D.any():
        try:
            distortion = coefficients(message.distortion_model or "plumb_bob", D)
        except InputError as error:
            notes.append(f"{best.name}: lens distortion is left in the images: {error}")
    width, height = int(message.width), int(message.height)
    fx, cx, fy, cy = (float(K[i]) for i in (0, 2, 4, 5))
    return Intrinsics(width, height, fx, fy, cx, cy, distortion), best.name


def _pixels(bag: Bag, topic: Topic, stamp: Stamp) -> bytes | np.ndarray:
    return pixels(bag.read(stamp, topic), f"{bag.path}, {topic.name} at {stamp.time:.6f} s")


def _chosen(bag: Bag, streams: list[Stream], what: str, asked: str | None, flag: str, rank) -> Stream:
    found = ", ".join(f"{s.topic.name} ({s.kind})" for s in streams)
    if not found:
        kinds = sorted({t.type for t in bag.topics})
        found = f"no image topic among {len(bag.topics)} topics" + (
            f" of {', '.join(kinds[:5])}" if kinds else ""
        )
    if asked is not None:
        name = "/" + asked.strip("/")
        match = [s for s in streams if s.topic.name == name]
        if not match:
            raise InputError(f"{bag.path}: found no image topic {name} for {flag}, expected one of: {found}")
        return match[0]
    able = [s for s in streams if s.kind == what or (what == "colour" and s.kind == "grey" and rank(s)[0])]
    if not able:
        raise InputError(f"{bag.path}: found no topic of {what} images, expected one; there are: {found}")
    return max(able, key=rank)


def _colour_rank(stream: Stream) -> tuple:
    name = stream.topic.name.lower()
    named = any(word in name for word in ("color", "colour", "rgb"))
    compressed = stream.topic.type.endswith("CompressedImage")
    return named, not compressed, "rect" in name, stream.topic.count, -len(name)


def _depth_rank(stream: Stream) -> tuple:
    name = stream.topic.name.lower()
    odd = any(word in name for word in ("infra", "/ir", "confidence", "disparity"))
    compressed = stream.topic.type.endswith("CompressedImage")
    return (
        not odd,
        any(word in name for word in _ALIGNED),
        "depth" in name,
        not compressed,
        stream.topic.count,
    )


def _shared_segments(info: str, topic: str) -> int:
    a, b = info.split("/")[1:], topic.split("/")[1:]
    count = 0
    while count < min(len(a), len(b)) and a[count] == b[count]:
        count += 1
    return count


def _calibration(
    bag: Bag, colour: Stream, depth: Stream, frames: FrameTree, notes: list[str]
) -> Calibration | None:
    of_colour, of_depth = (topic_camera(bag, stream.topic, notes) for stream in (colour, depth))
    found = of_colour or of_depth
    if found is None:
        return None
    source = " and ".join(dict.fromkeys(name for _, name in filter(None, (of_colour, of_depth))))
    camera = found[0]
    aligned = colour.frame_id == depth.frame_id or any(word in depth.topic.name.lower() for word in _ALIGNED)
    if of_colour is None or of_depth is None or (aligned and same_size(of_colour[0], of_depth[0])):
        return Calibration(camera, depth.units, source)
    T_color_depth = np.eye(4) if aligned else frames.between(colour.frame_id, depth.frame_id)
    if T_color_depth is None:
        T_color_depth = np.eye(4)
        notes.append(
            f"assumed: {depth.frame_id or 'depth'} and {colour.frame_id or 'colour'} at one place, "
            "as the bag holds no transform between them"
        )
    return two_cameras(of_colour[0], of_depth[0], T_color_depth, depth.units, source)
