"""`dsmap train`: train DS-Net or a baseline on images with labels."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from dsmap.dsnet.config import AugmentConfig, NetChoice, TrainConfig


@dataclass
class Args:
    """What to train on, and how."""

    data: tuple[Path, ...]
    """Data sets to train on, PATH or PATH@SPLIT: recordings with labels, `rgb/` + `label/`, folders of these,
    NYUv2 (its .mat file), SUN RGB-D, ScanNet frames, PASCAL VOC, SBD. All of the same classes."""
    val: Path
    """Data set to validate with, PATH or PATH@SPLIT: other rooms than those of `data`."""
    out: Path
    """Folder of the run: best.safetensors, checkpoint.safetensors, history.json."""
    init: Path | None = None
    """Weights to start from (fine-tuning)."""
    resume: bool = False
    """Go on from the checkpoint in `out`, if there is one."""
    device: str = "cpu"
    """cpu or cuda."""
    workers: int = 1
    """Processes that prepare images; 0: the training process itself."""
    train: Annotated[TrainConfig, tyro.conf.arg(name="")] = field(default_factory=TrainConfig)
    net: NetChoice = field(default_factory=NetChoice)
    augment: AugmentConfig = field(default_factory=AugmentConfig)


def main(args: Args) -> None:
    """Train, then print the best validation."""
    from dsmap.dsnet.train import train

    best = train(
        args.data,
        args.val,
        args.out,
        args.net.config(),
        args.augment,
        args.train,
        init=args.init,
        resume=args.resume,
        device=args.device,
        workers=args.workers,
    )
    for name, values in best["per_class"].items():
        print(f"  {name:<10} recall {100 * values['recall']:5.1f}   IoU {100 * values['iou']:5.1f}")
    print(
        f"step {best['step']}: class average {100 * best['class_avg']:.1f}, mIoU {100 * best['miou']:.1f}, "
        f"pixel accuracy {100 * best['pixel_acc']:.1f}, ECE {100 * best['ece']:.1f}, "
        f"temperature {best['temperature']:.2f}"
    )
    print(f"weights: {args.out / 'best.safetensors'}")
