"""Does depth belong to its colour image, or is one of the two mirrored? Told by the edges that both have."""

import numpy as np

from dsmap.errors import InputError
from dsmap.sequences import Sequence
from dsmap.sequences.edges import Change, colour_at_edges

_SAMPLES = 6
"""Frames that are compared."""
_NO_AGREEMENT, _AGREEMENT = 1.2, 1.3
"""Gradient of colour at edges of depth by that of the whole image."""
_CHANGES: dict[str, Change] = {
    "left and right": lambda image: image[:, ::-1],
    "upside down": lambda image: image[::-1],
    "turned by half a turn": lambda image: image[::-1, ::-1],
}


def mirror_warnings(sequence: Sequence) -> list[str]:
    """What is said where edges of depth lie on edges of colour only once it is mirrored or turned."""
    found = []
    for i in np.unique(np.linspace(0, len(sequence) - 1, _SAMPLES).astype(int)):
        try:
            frame = sequence.frame(int(i))
        except InputError:  # a damaged frame is left out of the map, too
            continue
        if (agreement := colour_at_edges(frame.rgb, frame.depth, list(_CHANGES.values()))) is not None:
            found.append(agreement)
    if not found:
        return []
    as_is, *changed = np.mean(found, axis=0)
    best = int(np.argmax(changed))
    if as_is > _NO_AGREEMENT or changed[best] < _AGREEMENT:
        return []
    return [
        f"edges of depth lie on edges of colour only if one of them is mirrored ({list(_CHANGES)[best]}): depth and "
        "colour do not belong together as they are, and the map will be wrong"
    ]
