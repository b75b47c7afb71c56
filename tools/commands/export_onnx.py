"""`dsmap export-onnx`: a trained network for programs that are not dsmap."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from dsmap.errors import InputError
from dsmap.ranges import Range


@dataclass
class Args:
    """What to export."""

    weights: Annotated[str, tyro.conf.Positional]
    """Weights of a DS-Net or dsnet-p (safetensors), of any classes, or the name of some that ship."""
    out: Annotated[Path, tyro.conf.Positional]
    """The ONNX file."""
    size: Annotated[tuple[int, int] | None, Range(32, 4096, length=2)] = None
    """Width and height of the images it will take [px], multiples of 32; default: the weights' working size."""
    batch: Annotated[int, Range(0, 4096)] = 1
    """Images at once; 0 leaves it open, which makes ONNX Runtime slower."""


def main(args: Args) -> None:
    """Write the file and say what goes in and out."""
    if args.batch < 0:
        raise InputError(f"--batch is {args.batch}, expected 0 or more")
    from dsmap.dsnet.checkpoint import load_weights
    from dsmap.dsnet.inference.onnx_export import export_onnx

    model, info = load_weights(args.weights, None)
    export_onnx(args.out, model, info, args.size, args.batch)
    width, height = args.size or info.size
    n = args.batch or "N"
    print(f"written: {args.out} ({args.out.stat().st_size / 1e6:.1f} MB)")
    print(f"  image          uint8   ({n}, {height}, {width}, 3)   RGB")
    if info.config.channels > 3:
        print(
            f"  geometry       float32 ({n}, {height}, {width}, 4)   see docs/guide/onnx.md; zeros: colour alone"
        )
    classes = len(info.class_names)
    print(
        f"  probabilities  float32 ({n}, {height // 2}, {width // 2}, {classes})   class 0 is {info.class_names[0]}"
    )
