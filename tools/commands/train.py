"""`dsmap train`: train DS-Net or a baseline on images with labels, in one stage or by a recipe."""

import shlex
import shutil
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated

import tyro

from dsmap.dsnet.config import AugmentConfig, NetChoice, TrainConfig
from dsmap.errors import InputError
from dsmap.files import atomic_path
from dsmap.ranges import Range
from dsmap.tools.support.recipes import load_recipe, parse_stage, words


@dataclass
class Args:
    """What to train on, and how."""

    out: Path
    """Folder of the run: best.safetensors, model-card.md, checkpoint.safetensors, history.json, log."""
    data: tuple[Path, ...] = ()
    """Data sets to train on, PATH or PATH@SPLIT: recordings with labels, `rgb/` + `label/`, folders of these,
    NYUv2 (its .mat file), SUN RGB-D, ScanNet frames, PASCAL VOC, SBD. All of the same classes."""
    val: Path | None = None
    """Data set to validate with, PATH or PATH@SPLIT: other rooms than those of `data`."""
    calibrate: tuple[Path, ...] = ()
    """More labelled data sets that the temperature shall fit as well as `val`: the largest calibration error counts."""
    label_map: str | None = None
    """Which classes the label images of `data` and `val` hold, if not the 13: nyu40, scannet, or a file of ids, names
    or colours (docs/guide/labels.md)."""
    recipe: str | None = None
    """Several stages instead of one: a YAML file or the name of a recipe that comes with dsmap."""
    places: tuple[str, ...] = ()
    """Of a recipe: where its data lies, NAME=PATH."""
    init: Path | None = None
    """Weights to start from (fine-tuning)."""
    teacher: str | None = None
    """Weights whose probabilities are learnt beside the labels (distillation): a file or the name of some that ship.
    Then recordings without labels serve, too, as --data PATH@unlabelled."""
    resume: bool = False
    """Go on from the checkpoint in `out`, if there is one."""
    device: str = "cpu"
    """cpu or cuda."""
    workers: Annotated[int, Range(0, 256)] = 1
    """Processes that prepare images; 0: the training process itself."""
    log: bool = True
    """Write a TensorBoard log."""
    licence_note: str | None = None
    """What the model card says of the terms of data and weights."""
    train: Annotated[TrainConfig, tyro.conf.arg(name="")] = field(default_factory=TrainConfig)
    net: NetChoice = field(default_factory=NetChoice)
    augment: AugmentConfig = field(default_factory=AugmentConfig)


def main(args: Args) -> None:
    """Train, then print the best validation."""
    from dsmap.dsnet.training.processes import joined

    with joined(args.device) as ranks:
        best = run_recipe(args, ranks.first) if args.recipe else run_stage(args)
    if not ranks.first:
        return
    for name, values in best["per_class"].items():
        print(f"  {name:<10} recall {100 * values['recall']:5.1f}   IoU {100 * values['iou']:5.1f}")
    print(
        f"step {best['step']}: class average {100 * best['class_avg']:.1f}, mIoU {100 * best['miou']:.1f}, "
        f"pixel accuracy {100 * best['pixel_acc']:.1f}, ECE {100 * best['ece']:.1f}, "
        f"temperature {best['temperature']:.2f}"
    )
    print(f"weights: {args.out / 'best.safetensors'}")


def run_stage(args: Args) -> dict:
    """Train one stage; the record of its best validation."""
    from dsmap.dsnet.training.train import train

    if not args.data or args.val is None:
        raise InputError("found no --data or no --val, expected both (or --recipe)")
    notes = {"command": command_of(args)}
    if args.licence_note:
        notes["licence"] = args.licence_note
    return train(
        args.data,
        args.val,
        args.out,
        args.net.config(),
        args.augment,
        args.train,
        init=args.init,
        teacher=args.teacher,
        resume=args.resume,
        device=args.device,
        workers=args.workers,
        log=args.log,
        notes=notes,
        label_map=args.label_map,
        calibrate=args.calibrate,
    )


def run_recipe(args: Args, first: bool) -> dict:
    """Train all stages, each from the weights of the one before; the last one's weights, or the average that the recipe
    asks for, lie in `out` itself."""
    if args.data or args.val:
        raise InputError("found --data or --val beside --recipe, expected them in the recipe (see --places)")
    recipe = load_recipe(args.recipe or "", args.places)
    stages = [
        parse_stage(stage, Args, args.out / stage.name) for stage in recipe.stages
    ]  # all of them first: the last one's mistake shows before the first one trains
    weights, best = args.init, None
    for stage in stages:
        stage = replace(
            stage,
            init=stage.init or weights,
            resume=args.resume,
            device=args.device,
            workers=args.workers,
            log=args.log,
            licence_note=args.licence_note or stage.licence_note,
        )
        best = finished_stage(stage) if args.resume else None
        if best is None:
            best = run_stage(stage)
        weights = stage.out / "best.safetensors"
    if recipe.average > 1 and first:
        best = average_stages(stages[-recipe.average :], replace(args, out=args.out / "average"))
        weights = args.out / "average" / "best.safetensors"
    if first:
        assert weights is not None  # of the last stage
        for name in ("best.safetensors", "model-card.md"):
            with atomic_path(args.out / name) as temporary:
                shutil.copyfile(weights.parent / name, temporary)
    assert best is not None
    return best


def average_stages(stages: list[Args], args: Args) -> dict:
    """Average the weights of trained stages into `args.out`; the record of the validation."""
    from dsmap.dsnet.training.average import average

    last = stages[-1]
    notes = {"command": f"mean of the weights of stages {', '.join(stage.out.name for stage in stages)}"}
    if licence := args.licence_note or last.licence_note:
        notes["licence"] = licence
    assert last.val is not None
    return average(
        [stage.out / "best.safetensors" for stage in stages],
        last.data,
        last.val,
        args.out,
        last.train,
        calibrate=last.calibrate,
        device=args.device,
        notes=notes,
        label_map=last.label_map,
    )


def finished_stage(stage: Args) -> dict | None:
    """The record of a stage that has been trained to its end with these options, else None."""
    from dsmap.dsnet.checkpoint import load_weights

    path = stage.out / "best.safetensors"
    if not path.exists() or not (stage.out / "model-card.md").exists():
        return None
    _, info = load_weights(path, class_names=None)
    if info.notes.get("command") != command_of(stage):
        return None  # `train` says what differs
    return {**info.notes["validation"], "temperature": info.temperature}


def command_of(args: Args) -> str:
    """The command that trains this stage: every option that is not at its default."""
    given = changed(asdict(args), asdict(Args(args.out)))
    for key in ("resume", "device", "workers", "log", "recipe", "places", "licence_note"):
        given.pop(key, None)
    given = {**given.pop("train", {}), **given}
    return shlex.join(["dsmap", "train", "--out", str(args.out), *words(given)])


def changed(values: dict, defaults: dict) -> dict:
    """What differs from the defaults, tuples as lists, without empty parts."""
    found = {}
    for key, value in values.items():
        if isinstance(value, dict):
            if inner := changed(value, defaults[key]):
                found[key] = inner
        elif value != defaults[key]:
            found[key] = list(value) if isinstance(value, tuple) else value
    return found
