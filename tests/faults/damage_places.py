"""What lies where a file is expected."""

import os
from pathlib import Path

from damage_common import NotApplicable, Rng, write


def missing(rng: Rng, path: Path) -> None:
    path.unlink()


def folder_instead(rng: Rng, path: Path) -> None:
    path.unlink()
    path.mkdir()


def link_to_itself(rng: Rng, path: Path) -> None:
    path.unlink()
    path.symlink_to(path.name)


def link_to_nothing(rng: Rng, path: Path) -> None:
    path.unlink()
    path.symlink_to("nowhere")


def link_to_parent(rng: Rng, path: Path) -> None:
    path.unlink()
    path.symlink_to("..")


def fifo(rng: Rng, path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def endless(rng: Rng, path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def another_file(rng: Rng, path: Path) -> None:
    """The content of another file of the same folders."""
    others = sorted(p for p in _root(path).rglob("*") if p.is_file() and not p.is_symlink() and p != path)
    if not others:
        raise NotApplicable
    write(path, others[int(rng.integers(len(others)))].read_bytes())


def other_name(rng: Rng, path: Path) -> None:
    name = str(
        rng.choice(
            ["☃" + path.suffix, path.name.upper() + "x", " " + path.name, "a\nb" + path.suffix, "x" * 200]
        )
    )
    if (path.parent / name).exists():
        raise NotApplicable
    path.rename(path.parent / name)


def crowd(rng: Rng, path: Path) -> None:
    """A folder and a loop of links beside the file, named like it."""
    beside = path.with_name("0" + path.name)
    if beside.exists():
        raise NotApplicable
    if rng.random() < 0.5:
        beside.mkdir()
    else:
        beside.symlink_to(beside.name)


def _root(path: Path) -> Path:
    return path.parents[1] if path.parent.name in ("rgb", "depth", "label", "image", "color") else path.parent
