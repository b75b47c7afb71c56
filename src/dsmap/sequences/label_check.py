"""Whether a recording's label images can be used, before it is mapped with them."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.reading import is_file
from dsmap.sequences.base import Entry, Recording, Sequence
from dsmap.sequences.label_images import HINT, ForeignLabels, LabelMap, fit, listed

_SAMPLES = 40
"""Label images looked into, spread over the recording: a foreign set shows in a few."""


def settle_labels(recording: Recording, label_map: LabelMap, camera: Intrinsics) -> None:
    """Read labels through `label_map`; leave them out, with a note, where they are missing or of another set.

    Args:
        recording: its entries, notes, `label_map` and `labels_unused` are set.
        camera: at the size that frames have.
    """
    recording.label_map = label_map
    labelled = [k for k, entry in enumerate(recording.entries) if entry.label is not None]
    if not labelled:
        return
    missing = {k for k in labelled if _is_missing(recording.entries[k])}
    present = [k for k in labelled if k not in missing]
    if missing:
        recording.notes.append(
            f"{len(missing)} of {len(labelled)} label images are missing; first {_name(recording, min(missing))}"
        )
    reason = _objection(recording, present, camera)
    if reason is not None:
        recording.labels_unused = f"labels are not used: {reason}"
        recording.notes.append(recording.labels_unused)
    dropped = missing if reason is None else set(labelled)
    recording.entries = [
        replace(entry, label=None) if k in dropped else entry for k, entry in enumerate(recording.entries)
    ]


def check_all_labels(sequence: Sequence) -> None:
    """Look into every label image: a foreign id may show late, and the ids before it then mean something else.

    Raises:
        InputError: one is of another label set; names it and its ids.
    """
    for i in sequence.labelled():
        source = sequence.entries[i].label
        assert source is not None  # `labelled` says so
        try:
            sequence.recording.label_map.read(source)
        except ForeignLabels:
            raise
        except InputError:  # a damaged image is left out and said when its frame comes
            continue


def _objection(recording: Recording, present: list[int], camera: Intrinsics) -> str | None:
    """Why labels cannot be used; None where they can, in most of the images that were looked into."""
    if not present:
        return "none of the label images exists"
    unknown: dict[str, None] = {}
    foreign, damaged, resized = None, [], 0
    chosen = np.unique(np.linspace(0, len(present) - 1, min(_SAMPLES, len(present))).astype(int))
    for k in chosen:
        source = recording.entries[present[k]].label
        assert source is not None
        try:
            label = recording.label_map.read(source)
            fit(label, camera.width, camera.height, str(source))
            resized += label.shape != (camera.height, camera.width)
        except ForeignLabels as error:
            foreign = error
            unknown.update(dict.fromkeys(error.unknown))
        except InputError as error:
            damaged.append(str(error))
    if foreign is not None:
        ids = sorted(unknown, key=lambda word: (len(word), word))
        return f"found the {foreign.what} {listed(ids)}, expected {foreign.expected}; {HINT}"
    if len(damaged) > len(chosen) / 2:
        return damaged[0]
    if resized:
        recording.notes.append(
            f"label images are brought to {camera.width}x{camera.height} by their nearest pixel"
        )
    return None


def _is_missing(entry: Entry) -> bool:
    return isinstance(entry.label, Path) and not is_file(entry.label)


def _name(recording: Recording, k: int) -> str:
    return str(recording.entries[k].label)
