"""The card of a rendered data set: what is in it, for people (CARD.md) and for programs (dataset.json)."""

import json
from collections.abc import Iterable
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

import numpy as np

from dsmap.classes import CLASS_NAMES, NUM_CLASSES
from dsmap.files import atomic_path, write_json
from dsmap.sim_scenes.recording.dataset import SUMMARY, Task
from dsmap.sim_scenes.recording.options import RenderOptions

NYUV2_SHARES = (17.53, 3.53, 0.54, 1.45, 3.40, 9.85, 14.63, 12.80, 2.00, 2.36, 2.97, 0.55, 23.61, 4.77)
"""Pixels a class [%], void first, of 792 labelled training images of NYU Depth v2 in the 13-class mapping."""


def shares(pixels: np.ndarray) -> np.ndarray:
    """Share of each of the 13 classes in the labelled pixels, shape (13,), from counts of shape (14,)."""
    labelled = np.asarray(pixels, float)[1:]
    return labelled / max(labelled.sum(), 1.0)


def write_card(out: Path, tasks: Iterable[Task], command: str) -> np.ndarray:
    """Write `dataset.json` and `CARD.md` for the scenes that are there; returns pixels a class, shape (14,)."""
    scenes = []
    for task in tasks:
        summary = task.folder / SUMMARY
        if summary.is_file():
            counted = json.loads(summary.read_text())
            scenes.append(
                {
                    "folder": task.folder.name,
                    "scene": task.options.scene,
                    "seed": task.options.seed,
                    **counted,
                }
            )
    pixels = np.array([scene["pixels"] for scene in scenes] or [[0] * NUM_CLASSES]).sum(0)
    write_json(out / "dataset.json", {"dsmap": version("dsmap"), "command": command, "scenes": scenes})
    with atomic_path(out / "CARD.md") as file:
        file.write_text(_text(scenes, pixels, command, next(iter(tasks)).options), encoding="utf-8")
    return pixels


def _options(options: RenderOptions) -> str:
    """What all scenes have in common and the defaults do not."""
    plain, own = asdict(RenderOptions()), asdict(options)
    said = [f"{k} {v}" for k, v in own.items() if v != plain[k] and k not in ("scene", "seed", "jobs")]
    return ", ".join(said) or "none"


def _text(scenes: list[dict], pixels: np.ndarray, command: str, options: RenderOptions) -> str:
    kinds = sorted({scene["scene"] for scene in scenes})
    seeds = [scene["seed"] for scene in scenes]
    frames = sum(scene["frames"] for scene in scenes)
    ours, theirs = shares(pixels), shares(np.array(NYUV2_SHARES))
    lines = [
        "# Rendered indoor RGB-D with labels",
        "",
        f"Made by dsmap {version('dsmap')}: `{command}`",
        "",
        f"- {frames} labelled frames of {len(scenes)} scenes, seeds {min(seeds)} to {max(seeds)}"
        if scenes
        else "- no scene is finished yet",
        *(f"- {kind}: {sum(s['scene'] == kind for s in scenes)} scenes" for kind in kinds),
        f"- options that are not the defaults: {_options(options)}",
        "- every folder is a sequence in the TUM RGB-D layout with label/, instance/, poses and mesh.ply;"
        " depth is planar z, classes are NYUv2-13",
        "- no licence terms of others: all shapes and textures are generated",
        "",
        "| class | share of labelled pixels | NYUv2-13 training images | ratio |",
        "|---|---|---|---|",
    ]
    for name, a, b in zip(CLASS_NAMES[1:], ours, theirs, strict=True):
        lines.append(f"| {name} | {a:.1%} | {b:.1%} | {a / b:.2f} |")
    return "\n".join(lines) + "\n"
