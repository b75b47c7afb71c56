"""The map's labels rendered into every frame: a labelled recording in the TUM layout."""

from pathlib import Path

from dsmap.fusion.exports.images import need_labels, posed_frames
from dsmap.sequences import Sequence, SequenceWriter


def export_labels_2d(sequence: Sequence, out: Path) -> int:
    """Write colour, depth, poses and `label/` of the frames that have a pose; returns their number.

    `dsmap train`, `dsmap convert` and `dsmap evaluate --data` read it.

    Raises:
        InputError: there are no labels, or no poses.
    """
    need_labels(sequence)
    with SequenceWriter(out, sequence.intrinsics, depth_max=sequence.depth_max) as writer:
        for _, pose, frame in posed_frames(sequence):
            writer.write(frame.time, frame.rgb, frame.depth, T_world_camera=pose, label=frame.label)
        return writer.count
