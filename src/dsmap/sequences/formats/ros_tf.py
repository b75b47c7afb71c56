"""Coordinate frames of a bag: where one camera sits on another, and where the camera was."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dsmap.sequences.associate import pose_matrix, poses_at
from dsmap.sequences.base import Recording
from dsmap.sequences.formats.bag import Bag

_TF = "tf2_msgs/msg/TFMessage"
_TF_OLD = "tf/msg/tfMessage"
_WORLDS = ("map", "world", "odom")
"""Frames that stand still, the best first."""
_APART_S = 0.1
"""A pose is interpolated between transforms this close to its stamp [s]."""


@dataclass
class _Link:
    """Where a frame is in its parent: poses x y z qx qy qz qw over time."""

    parent: str
    is_static: bool
    times: list[float] = field(default_factory=list)
    poses: list[np.ndarray] = field(default_factory=list)

    @property
    def is_constant(self) -> bool:
        """Whether it never moves: older programs repeat such links on /tf."""
        return self.is_static or float(np.ptp(np.array(self.poses), axis=0).max()) < 1e-6


class FrameTree:
    """The tree of frames of /tf and /tf_static."""

    def __init__(self, bag: Bag):
        """Read the transforms. Raises InputError: the bag is damaged."""
        self._links: dict[str, _Link] = {}
        topics = [t for t in bag.of_type(_TF, _TF_OLD) if t.name.endswith(("/tf", "/tf_static"))]
        for topic, message in bag.messages(topics):
            for transform in message.transforms:
                self._add(transform, topic.name.endswith("static"))

    def between(self, to: str, of: str) -> np.ndarray | None:
        """Takes points of frame `of` into frame `to`, shape (4, 4), where both hang on one body; else None."""
        chain_to, chain_of = self._fixed_chain(to), self._fixed_chain(of)
        common = next((frame for frame in chain_of if frame in chain_to), None)
        if common is None:
            return None
        return np.linalg.inv(chain_to[common]) @ chain_of[common]

    def with_poses(self, recording: Recording, frame: str) -> Recording:
        """The recording with the poses of a frame in the world, where the tree has them."""
        frame = frame.lstrip("/")
        chain = self._chain(frame)
        world = next((w for w in _WORLDS if w in chain), chain[-1])
        links = [self._links[name] for name in chain[: chain.index(world)]]
        if all(link.is_constant for link in links):
            return recording
        times = np.array([entry.pose_time for entry in recording.entries])
        poses: list[np.ndarray | None] = [np.eye(4)] * len(times)
        for link in links:
            steps = _at(link, times)
            poses = [
                s @ T if s is not None and T is not None else None for s, T in zip(steps, poses, strict=True)
            ]
        missing = sum(T is None for T in poses)
        if missing == len(poses):
            return recording
        note = f"poses of {frame} in {world} from /tf" + (f", {missing} frames have none" if missing else "")
        entries = [replace(e, T_world_camera=T) for e, T in zip(recording.entries, poses, strict=True)]
        return replace(recording, entries=entries, notes=[*recording.notes, note])

    def _add(self, stamped: Any, is_static: bool) -> None:
        header, t, q = stamped.header, stamped.transform.translation, stamped.transform.rotation
        child, parent = stamped.child_frame_id.lstrip("/"), header.frame_id.lstrip("/")
        pose = np.array([t.x, t.y, t.z, q.x, q.y, q.z, q.w])
        if child == parent or not np.isfinite(pose).all() or not 0.9 < np.linalg.norm(pose[3:]) < 1.1:
            return
        link = self._links.setdefault(child, _Link(parent, is_static))
        seconds = getattr(header.stamp, "sec", 0) + header.stamp.nanosec * 1e-9
        if link.parent == parent and (not link.times or not link.is_static):
            link.times.append(seconds)
            link.poses.append(pose)

    def _chain(self, frame: str) -> list[str]:
        """The frame and its ancestors."""
        chain = [frame]
        while (link := self._links.get(chain[-1])) is not None and link.parent not in chain:
            chain.append(link.parent)
        return chain

    def _fixed_chain(self, frame: str) -> dict[str, np.ndarray]:
        """T_ancestor_frame of the frame and its ancestors up to the first link that moves."""
        chain, T = {frame.lstrip("/"): np.eye(4)}, np.eye(4)
        for name in self._chain(frame.lstrip("/"))[:-1]:
            link = self._links[name]
            if not link.is_constant:
                break
            T = pose_matrix(link.poses[0]) @ T
            chain[link.parent] = T
        return chain


def _at(link: _Link, times: np.ndarray) -> list[np.ndarray | None]:
    """T_parent_frame at some times."""
    if link.is_constant:
        return [pose_matrix(link.poses[0])] * len(times)
    order = np.argsort(link.times, kind="stable")
    return poses_at(times, np.array(link.times)[order], np.array(link.poses)[order], _APART_S)
