"""Label images with NYU40 ids."""

from pathlib import Path

from dsmap.classes import CLASS_TO_NYU40, NYU40_NAMES
from dsmap.files import atomic_path, write_json
from dsmap.fusion.exports.images import labelled_frames, write_png
from dsmap.sequences import Sequence


def export_nyu40(sequence: Sequence, out: Path) -> int:
    """Write `label40/*.png` (8-bit NYU40 ids) and `label40.txt`; returns the number of images.

    Of the NYU40 classes that share one of our 13, the plainest is written (objects: otherprop).

    Raises:
        InputError: the recording has no labels.
    """
    lines = []
    for i, label, _ in labelled_frames(sequence):
        time = sequence.entries[i].time
        name = f"label40/{time:.6f}.png"
        write_png(out / name, CLASS_TO_NYU40[label])
        lines.append(f"{time:.6f} {name}")
    with atomic_path(out / "label40.txt") as file:
        file.write_text("# NYU40 class ids\n# timestamp filename\n" + "\n".join(lines) + "\n")
    write_json(out / "classes40.json", [{"id": i, "name": n} for i, n in enumerate(NYU40_NAMES)])
    return len(lines)
