"""Recordings of the RealSense SDK and Viewer: a ROS 1 bag with topics of its own (record-and-playback.md)."""

import re
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.sequences.associate import pose_matrix
from dsmap.sequences.base import Recording
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.formats.bag import Bag, Topic, bag_files, is_bag
from dsmap.sequences.formats.parts import same_size, two_cameras
from dsmap.sequences.formats.protocol import Options, Reader
from dsmap.sequences.formats.ros import Stream, choose_streams, read_streams, topic_camera

_UNITS = re.compile(r"/device_\d+/sensor_\d+/(?:option|property)/Depth[ _]Units(?:/value)?")
_DEFAULT_UNITS_M = 0.001


def is_realsense(path: Path) -> bool:
    """Whether a path is a `.bag` (or its folder) whose first megabytes name a topic of the RealSense SDK."""
    if not is_bag(path):
        return False
    path = bag_files(path)[0] if path.is_dir() and bag_files(path) else path
    if path.suffix.lower() != ".bag":
        return False
    with path.open("rb") as file:
        return b"/device_0/sensor_" in file.read(1 << 22) or _named_at_end(path)


def _named_at_end(path: Path) -> bool:
    """Compressed chunks hide the topics; the index at the end names them again."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - (1 << 20)))
        return b"/device_0/sensor_" in file.read()


def _read(path: Path, options: Options) -> Recording:
    bag = Bag(path)
    colour, depth, notes = choose_streams(bag, options)
    units_m = _depth_units(bag)
    if units_m is None:
        units_m = _DEFAULT_UNITS_M
        notes.append("assumed: depth in millimetres, as the bag does not tell its depth units")
    scale = round(1.0 / units_m, 3)  # units are stored as a 32-bit float
    recording = read_streams(
        "realsense", bag, colour, depth, _calibration(bag, colour, depth, scale, notes), notes
    )
    return recording


READER = Reader("realsense", is_realsense, _read)


def _calibration(bag: Bag, colour: Stream, depth: Stream, scale: float, notes: list[str]) -> Calibration:
    of_colour, of_depth = (topic_camera(bag, stream.topic, notes) for stream in (colour, depth))
    if of_colour is None or of_depth is None:
        raise InputError(
            f"{bag.path}: found no camera_info beside the images, expected one for colour and depth"
        )
    colour_camera, depth_camera = of_colour[0], of_depth[0]
    T_color, T_depth = _extrinsics(bag, colour.topic), _extrinsics(bag, depth.topic)
    if T_color is None or T_depth is None:
        T_color_depth = np.eye(4)
        if colour_camera != depth_camera:
            notes.append(
                "assumed: depth and colour camera at one place, as the bag holds no transform between them"
            )
    else:
        T_color_depth = T_color @ np.linalg.inv(T_depth)
    if same_size(colour_camera, depth_camera) and np.allclose(colour_camera.K, depth_camera.K):
        depth_camera = colour_camera
    return two_cameras(colour_camera, depth_camera, T_color_depth, scale, "the bag's camera_info")


def _extrinsics(bag: Bag, images: Topic) -> np.ndarray | None:
    """Takes points of the device's reference into the stream of an image topic, shape (4, 4)."""
    stream = images.name.removesuffix("/image/data")
    for topic in bag.of_type("geometry_msgs/msg/Transform"):
        if topic.name.startswith(f"{stream}/tf/"):
            message = bag.first(topic)
            t, q = message.translation, message.rotation
            pose = np.array([t.x, t.y, t.z, q.x, q.y, q.z, q.w])
            if np.isfinite(pose).all() and np.linalg.norm(pose[3:]) > 0.5:
                return pose_matrix(pose)
    return None


def _depth_units(bag: Bag) -> float | None:
    """Metres per stored unit."""
    for topic in bag.of_type("std_msgs/msg/Float32"):
        if _UNITS.fullmatch(topic.name):
            value = float(bag.first(topic).data)
            if 0 < value < 1:
                return value
    return None
