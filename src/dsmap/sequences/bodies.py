"""Poses of things that move during a recording: `bodies.txt`, one line a frame and body."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dsmap.errors import InputError
from dsmap.files import atomic_path
from dsmap.sequences.associate import pose_matrix, pose_vector
from dsmap.sequences.text import read_lines

BODIES_FILE = "bodies.txt"
_HEADER = (
    "# body-to-world poses of what moves; a body's frame lies still in it, its parts have this instance id\n"
    "# timestamp body instance tx ty tz qx qy qz qw\n"
)


def write_bodies(
    folder: Path | str,
    times: np.ndarray,
    names: Sequence[str],
    instances: Sequence[int],
    T_world_body: np.ndarray,
) -> None:
    """Write `bodies.txt` of a sequence.

    Args:
        times: stamps of the colour images [s], (N,).
        names, instances: of the bodies; several bodies may be parts of one instance.
        T_world_body: shape (N, bodies, 4, 4).
    """
    with atomic_path(Path(folder) / BODIES_FILE) as path, open(path, "w") as file:
        file.write(_HEADER)
        for time, poses in zip(times, T_world_body, strict=True):
            for name, instance, pose in zip(names, instances, poses, strict=True):
                numbers = " ".join(f"{v:.9f}" for v in pose_vector(pose))
                file.write(f"{time:.6f} {name} {instance} {numbers}\n")


def read_bodies(folder: Path | str) -> dict[str, tuple[int, np.ndarray, np.ndarray]]:
    """By body: instance id, stamps [s] (N,), poses T_world_body (N, 4, 4). Empty where nothing moves.

    Raises:
        InputError: a line is not of the form above.
    """
    path = Path(folder) / BODIES_FILE
    if not path.exists():
        return {}
    found: dict[str, tuple[int, list[float], list[np.ndarray]]] = {}
    for line in read_lines(path):
        try:
            time, name, instance, *numbers = line.text.split()
            if len(numbers) != 7:
                raise ValueError(f"{len(numbers)} numbers")
            _, times, poses = found.setdefault(name, (int(instance), [], []))
            poses.append(pose_matrix(np.array(numbers, float)))
            times.append(float(time))
        except ValueError as error:
            raise InputError(
                f"{path}:{line.number}: found {line.text!r} ({error}); "
                "expected 'time body instance x y z qx qy qz qw'"
            ) from error
    return {name: (i, np.array(times), np.array(poses)) for name, (i, times, poses) in found.items()}
