"""`dsmap model-card`: write what a weights file says about itself as a page."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from dsmap.files import atomic_path


@dataclass
class Args:
    """Which weights, and where to."""

    weights: Annotated[Path, tyro.conf.Positional]
    """Weights file (.safetensors)."""
    out: Annotated[Path, tyro.conf.Positional]
    """Markdown file to write."""
    licence_note: str | None = None
    """What the card says of the terms of data and weights."""


def main(args: Args) -> None:
    """Write the card."""
    from dsmap.dsnet.checkpoint import load_weights
    from dsmap.dsnet.training.model_card import model_card

    _, info = load_weights(args.weights, class_names=None)
    with atomic_path(args.out) as temporary:
        temporary.write_text(model_card(info, args.weights.stem, args.licence_note))
    print(f"model card: {args.out}")
