"""Reading and writing RGB-D recordings: TUM RGB-D, 7-Scenes and Redwood/Open3D layouts."""

from dsmap.sequences.base import Entry, Recording, Sequence
from dsmap.sequences.calibration import Calibration
from dsmap.sequences.open import open_sequence
from dsmap.sequences.writer import SequenceWriter

__all__ = ["Calibration", "Entry", "Recording", "Sequence", "SequenceWriter", "open_sequence"]
