"""`dsmap contact-sheet`: what the scene generator makes, at a glance."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tqdm import tqdm

from dsmap.cores import usable_cores
from dsmap.ranges import Range, Seed
from dsmap.tools.support.parse import parse_size


@dataclass
class Args:
    """Options of `dsmap contact-sheet`."""

    out: tyro.conf.Positional[Path]
    """The picture (.png or .jpg)."""
    scene: str = "mix"
    """Kind of room, or `mix`: the kinds of a training set."""
    columns: Annotated[int, Range(1, 100)] = 5
    """Scenes side by side."""
    rows: Annotated[int, Range(1, 100)] = 6
    """Scenes one below the other."""
    seed: Seed = 1
    """Seed of the first scene; the others follow."""
    size: str = "240x180"
    """Size of one view, WIDTHxHEIGHT."""
    jobs: Annotated[int, Range(0, 1024)] = 0
    """Processes; 0 = one for every core."""


def main(args: Args) -> None:
    """Render the sheet and say where it is."""
    import dsmap.kernels.runtime  # noqa: F401  (Warp's settings come before its first use)
    from dsmap.sim_scenes.recording.contact_sheet import contact_sheet
    from dsmap.sim_scenes.recording.record import RenderOptions

    width, height = parse_size(args.size) or (240, 180)
    base = RenderOptions(scene=args.scene, seed=args.seed, width=width, height=height)
    with tqdm(total=args.columns * args.rows, unit="scene", disable=None) as bar:
        contact_sheet(
            args.out,
            base,
            columns=args.columns,
            rows=args.rows,
            jobs=args.jobs or usable_cores(),
            done=bar.update,
        )
    print(f"{args.out}: {args.columns * args.rows} scenes, seeds from {args.seed}")
