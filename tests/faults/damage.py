"""Kinds of damage to files: bytes, lines, values, headers, and what lies where a file is expected.

A kind is a function of a random generator and a file's path, which it changes in place; it raises `NotApplicable` where
the file is none of its kind. The same generator gives the same damage.
"""

import shutil
from pathlib import Path

import numpy as np
from damage_arrays import archive, hdf5, npy, sqlite, tensor_header, tensor_values, tensor_words
from damage_bytes import (
    append,
    delete_run,
    empty,
    flip_bits,
    insert,
    noise,
    number_in_header,
    ones_run,
    random_bytes,
    repeat_run,
    sparse,
    swap_runs,
    truncate,
    truncate_a_little,
    zero_run,
)
from damage_common import Kind, Rng
from damage_images import other_image, png_chunk, png_header
from damage_places import (
    another_file,
    crowd,
    endless,
    fifo,
    folder_instead,
    link_to_itself,
    link_to_nothing,
    link_to_parent,
    missing,
    other_name,
)
from damage_scenes import glb, ply, xml
from damage_text import all_numbers_of_a_column, characters, fields, lines, number
from damage_values import values, yaml_text

BYTES: tuple[Kind, ...] = (
    flip_bits, random_bytes, truncate, truncate_a_little, zero_run, ones_run, insert, delete_run, repeat_run, swap_runs,
    number_in_header, empty, noise, append,
)  # fmt: skip
PLACES: tuple[Kind, ...] = (
    missing, folder_instead, link_to_itself, link_to_nothing, link_to_parent, fifo, endless, another_file, other_name, crowd,
    sparse,
)  # fmt: skip
WORDS: tuple[Kind, ...] = (number, number, all_numbers_of_a_column, lines, fields, characters)
CONTENT: tuple[Kind, ...] = (
    values, values, values, yaml_text, yaml_text, png_header, png_chunk, other_image, npy, tensor_header, tensor_words, tensor_words,
    tensor_values, tensor_values, hdf5, sqlite, archive, ply, ply, glb, glb, xml, xml,
)  # fmt: skip
GROUPS = {"bytes": BYTES, "places": PLACES, "words": WORDS, "content": CONTENT}


def applicable(path: Path) -> list[Kind]:
    """Content and words apply to some files only: those that may, each as often as it should be tried."""
    copy = path.with_name("." + path.name + ".probe" + path.suffix)
    found: list[Kind] = []
    for kind in (*WORDS, *CONTENT):
        for seed in range(3):
            shutil.copy(path, copy)
            try:
                kind(np.random.default_rng(seed), copy)
                found.append(kind)
                break
            except Exception:  # the file is none of the kind's
                continue
            finally:
                copy.unlink(missing_ok=True)
    return found


def damage(rng: Rng, path: Path, special: list[Kind]) -> str:
    """Damage one file; returns the kind's name."""
    for _ in range(20):
        share = rng.random()
        pool = special if special and share < 0.62 else BYTES if share < 0.9 else PLACES
        kind = pool[int(rng.integers(len(pool)))]
        keep = path.read_bytes()
        try:
            kind(rng, path)
            return kind.__name__
        except Exception:  # the file is none of the kind's, or was damaged before
            if path.is_file():
                path.unlink()
            path.write_bytes(keep)
    truncate(rng, path)
    return "truncate"
