"""Poses of a bag that come as messages of their own: odometry, stamped poses, a path."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from dsmap.sequences.associate import poses_at
from dsmap.sequences.base import Recording
from dsmap.sequences.formats.bag import Bag, Topic
from dsmap.sequences.formats.ros_tf import FrameTree

_TYPES = (
    "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nav_msgs/msg/Path",
)  # fmt: skip
_PATH = "nav_msgs/msg/Path"
_APART_S = 0.1
"""A pose is interpolated between messages this close to its stamp [s]."""


def with_pose_topic(bag: Bag, frames: FrameTree, recording: Recording, camera: str) -> Recording:
    """The recording with the poses of the topic that has the most of them, where there is one.

    Odometry names the frame that it moves; where that hangs on the camera, the camera's pose follows. Other messages
    do not: their poses are taken for the camera's, which a note says.

    Args:
        camera: the frame of the images.

    Raises:
        InputError: the bag is damaged.
    """
    topic = max(bag.of_type(*_TYPES), key=_rank, default=None)
    if topic is None:
        return recording
    times, table, child = _poses(bag, topic)
    if not len(times):
        return recording
    T_child_camera = frames.between(child, camera) if child else None
    order = np.argsort(times, kind="stable")
    found = poses_at(np.array([e.pose_time for e in recording.entries]), times[order], table[order], _APART_S)
    missing = sum(T is None for T in found)
    if missing == len(found):
        note = f"poses of {topic.name} are not used: none is within {_APART_S * 1e3:.0f} ms of an image"
        return replace(recording, notes=[*recording.notes, note])
    if T_child_camera is None:
        note = f"assumed: poses of {topic.name} are the camera's, as the bag holds no transform to {camera or 'it'}"
        T_child_camera = np.eye(4)
    else:
        note = f"poses of {camera} from {topic.name}"
    note += f", {missing} frames have none" if missing else ""
    entries = [
        replace(e, T_world_camera=None if T is None else T @ T_child_camera)
        for e, T in zip(recording.entries, found, strict=True)
    ]
    return replace(recording, entries=entries, notes=[*recording.notes, note])


def _rank(topic: Topic) -> tuple[bool, int]:
    return topic.type != _PATH, topic.count


def _poses(bag: Bag, topic: Topic) -> tuple[np.ndarray, np.ndarray, str]:
    """Stamps [s], poses x y z qx qy qz qw, and the name of the frame that they are of, if the messages say so."""
    times: list[float] = []
    rows: list[np.ndarray] = []
    child = ""
    for _, message in bag.messages([topic]):
        child = getattr(message, "child_frame_id", child)
        if topic.type == _PATH:  # each message holds the whole path so far
            times, rows = [], []
        for stamp, pose in _stamped(message):
            t, q = pose.position, pose.orientation
            row = np.array([t.x, t.y, t.z, q.x, q.y, q.z, q.w])
            if np.isfinite(row).all() and 0.9 < np.linalg.norm(row[3:]) < 1.1:
                times.append(stamp.sec + stamp.nanosec * 1e-9)
                rows.append(row)
    return np.array(times), np.array(rows).reshape(-1, 7), child.lstrip("/")


def _stamped(message: Any) -> Iterator[tuple[Any, Any]]:
    """Stamps and poses of a message."""
    for part in getattr(message, "poses", [message]):
        pose = part.pose
        yield part.header.stamp, getattr(pose, "pose", pose)  # with a covariance they lie one deeper
