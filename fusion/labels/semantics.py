"""When to segment, and segmenters that need no network: ground-truth labels, optionally corrupted."""

from typing import Literal

import numpy as np

from dsmap.classes import CLASS_NAMES, NUM_CLASSES, VOID
from dsmap.frame import Frame
from dsmap.fusion.config import LabelConfig
from dsmap.fusion.lie import pose_difference

BLOB = 20
"""Size [px] of the blobs of wrong labels, at 640x480; scaled with the image's width."""
LabelNoise = Literal["pixels", "blobs", "confusion"]


class Schedule:
    """Decides which frames are segmented: every n-th, or keyframes."""

    def __init__(self, config: LabelConfig):
        self.config = config
        self.frames = 0
        self.taken = 0
        """How many of the frames so far were due."""
        self.last: np.ndarray | None = None

    def due(self, T_world_camera: np.ndarray) -> bool:
        """Whether this tracked frame is to be segmented. Call once a frame, in order."""
        self.frames += 1
        if self.config.every > 0:
            due = (self.frames - 1) % self.config.every == 0
        else:
            due = self._is_elsewhere(T_world_camera)
        self.taken += due
        return due

    def _is_elsewhere(self, T_world_camera: np.ndarray) -> bool:
        """Whether the camera has moved enough since the last keyframe; it then is one."""
        if self.last is not None:
            distance, angle = pose_difference(self.last, T_world_camera)
            if distance < self.config.keyframe_distance and angle < self.config.keyframe_angle_deg:
                return False
        self.last = T_world_camera.copy()
        return True

    @property
    def mirrored(self) -> bool:
        """Whether the frame that was due last is to be shown mirrored: every second one, beginning with the second."""
        return self.config.mirror and self.taken % 2 == 0


class GroundTruthSegmenter:
    """The frame's own labels as probabilities, optionally corrupted: tests label fusion without a network.

    `noise` is the share of wrong labels: "pixels" draws each pixel alone, "blobs" draws patches of about
    20 px anew in every frame, "confusion" turns chair into sofa. Frames without labels give None. The
    probabilities are honest: the shown class has 1 - noise, the rest share noise equally.
    """

    def __init__(self, noise: float = 0.0, kind: LabelNoise = "pixels", seed: int = 0):
        self.noise, self.kind, self.seed = noise, kind, seed
        classes = NUM_CLASSES - 1
        sure = min(1.0 - noise, 0.98)
        table = np.full((NUM_CLASSES, NUM_CLASSES), (1 - sure) / (classes - 1), dtype=np.float32)
        np.fill_diagonal(table, sure)
        table[:, VOID] = 0.0
        table[VOID] = 0.0
        table[VOID, VOID] = 1.0
        self._table = table

    def __call__(self, frame: Frame) -> np.ndarray | None:
        if frame.label is None:
            return None
        return self._table[self.corrupt(frame.label, frame.index)]

    def corrupt(self, label: np.ndarray, index: int) -> np.ndarray:
        """Corrupted class ids, same shape; the same for the same seed and frame index."""
        if self.noise <= 0:
            return label
        rng = np.random.default_rng((self.seed, index))
        height, width = label.shape
        if self.kind == "confusion":
            chair, sofa = CLASS_NAMES.index("chair"), CLASS_NAMES.index("sofa")
            return np.where((label == chair) & (rng.random(label.shape) < self.noise), sofa, label).astype(
                np.uint8
            )
        cell = 1 if self.kind == "pixels" else max(round(BLOB * width / 640), 1)
        rows, columns = height // cell + 2, width // cell + 2
        hit = rng.random((rows, columns)) < self.noise
        # A wrong label is one of the twelve others: adding 1..12 modulo 13 never gives the true one back.
        shift = rng.integers(1, NUM_CLASSES - 1, (rows, columns))
        shift = np.where(hit, shift, 0).repeat(cell, axis=0).repeat(cell, axis=1)
        y, x = rng.integers(0, cell, 2) if cell > 1 else (0, 0)
        shift = shift[y : y + height, x : x + width]
        wrong = (label.astype(np.int64) - 1 + shift) % (NUM_CLASSES - 1) + 1
        return np.where(label == VOID, VOID, wrong).astype(np.uint8)
