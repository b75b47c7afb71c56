"""Label sets of others, as tables to the 13 classes."""

import csv
from pathlib import Path

import numpy as np

from dsmap.classes import NYU40_TO_13
from dsmap.errors import InputError

SCANNET_LABEL_MAP = "scannetv2-labels.combined.tsv"


def classes_of(ids: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Classes of ids by a table, uint8, shape of ids; what the table does not hold is void."""
    return table[np.where(ids < len(table), ids, 0)]


def scannet_table(path: Path) -> np.ndarray:
    """Class of each raw id of ScanNet, uint8, shape (largest id + 1,); ids that are not listed are void.

    Raises:
        InputError: the label map is missing or is none.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = [(int(row["id"]), int(row["nyu40id"])) for row in csv.DictReader(file, delimiter="\t")]
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: no label map ({error!r}), expected columns id and nyu40id") from error
    if not rows or min(min(row) for row in rows) < 0 or max(nyu for _, nyu in rows) > 40:
        raise InputError(f"{path}: expected ids from 0 and nyu40id within 0..40")
    table = np.zeros(max(i for i, _ in rows) + 1, np.uint8)
    for raw, nyu in rows:
        table[raw] = NYU40_TO_13[nyu]
    return table
