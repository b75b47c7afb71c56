"""`dsmap experiment`: the paper's experiments, one command each."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from dsmap.errors import InputError
from dsmap.ranges import Range, Seed, Share

Name = Literal["cifar-lk", "cifar-deconvnet", "voc-lk", "voc-nyu", "nyuv2", "rendered-curve"]

CANNOT_SHOW: dict[str, str] = {
    "cifar-lk": "6 epochs, DS-Net's stem at stride 2, no dropout, one fold: shows which network learns faster; "
    "not the accuracy after long training, nor whether the larger ones overfit, as the paper says of L = 5",
    "cifar-deconvnet": "6 epochs, VGG-16 at a quarter of its channels, no dropout: shows the early epochs; not "
    "which encoder is better in the end, nor the original's 15 million parameters",
    "voc-lk": "200 images at 128x128 for 400 steps: shows that every network of the table trains and is scored; "
    "not their order, which lies far below the noise there",
    "voc-nyu": "200 images of VOC for 400 steps and NYUv2 for 800, all at 128x128: shows that the recipe runs; "
    "not what VOC is worth",
    "nyuv2": "50 images, evenly spread: a glimpse; quote the full setting only",
    "rendered-curve": "40 recordings for 500 steps, NYUv2 for 500, at 160x128: shows the direction at most; not "
    "how far rendered data reach in long training",
}
"""What the setting `small` is, and what it cannot show."""


@dataclass
class Args:
    name: Annotated[Name, tyro.conf.Positional]
    """cifar-lk: accuracy over epochs for L in {3, 4, 5} and K in {8, 16, 32} (the paper's Fig. 6, 7).
    cifar-deconvnet: DS-Net's encoder against VGG-16's (Fig. 8).
    voc-lk: mIoU for L x K and of DeconvNet (Table 2).
    voc-nyu: the recipe, VOC 2012 + SBD and then NYUv2-13.
    nyuv2: per-class accuracy of weights on single frames (Table 4).
    rendered-curve: NYUv2-13 accuracy over the amount of rendered data in pre-training."""
    data: tuple[Path, ...]
    """The data set: CIFAR-10 (cifar-*); VOC 2012 [and SBD] (voc-*); NYUv2 (rendered-curve), with @SPLIT (nyuv2)."""
    out: Path
    """Folder of the experiment: results.json, table.csv, table.md, plots. What it holds is not computed again."""
    setting: Literal["small", "full"] = "small"
    """small: at most 10 minutes on 2 cores. It shows that the experiment runs and a first tendency, NOT the paper's
    result; what it cannot show is printed beside its result. full: the paper's sizes, hours to days on a CPU."""
    nyu: Path | None = None
    """NYUv2 (voc-nyu)."""
    rendered: Path | None = None
    """Folder of rendered recordings (rendered-curve)."""
    weights: tuple[Path, ...] = ()
    """Weights files (nyuv2); default: those that come with dsmap."""
    cells: tuple[str, ...] = ()
    """Only these cells of the table, such as L4K16; default: all."""
    epochs: Annotated[int | None, Range(1, 100_000)] = None
    """Epochs of CIFAR-10, instead of the setting's."""
    stem_stride: Literal[1, 2] | None = None
    """Stride of DS-Net's first convolution on CIFAR-10, instead of the setting's."""
    dropout: Share | None = None
    """Dropout of DS-Net on CIFAR-10, instead of the setting's."""
    folds: Annotated[int | None, Range(1, 100)] = None
    """CIFAR-10: folds that are held back in turn; 10: ten-fold cross validation."""
    seeds: Annotated[int | None, Range(1, 1000)] = None
    """CIFAR-10: trainings of every cell and fold."""
    steps: Annotated[int | None, Range(1, 1_000_000_000)] = None
    """Steps of every segmentation training, instead of the setting's."""
    seed: Seed = 0
    """Of initial weights, order, augmentation and dropout."""
    device: str = "cpu"
    """cpu or cuda."""
    workers: Annotated[int, Range(0, 256)] = 1
    """Processes that prepare images for segmentation; 0: the training process itself."""


def main(args: Args) -> None:
    """Run the experiment; print its table and what it cannot show."""
    started = time.monotonic()
    if args.setting == "small":
        print(f"small: {CANNOT_SHOW[args.name]}")
    results = _EXPERIMENTS[args.name](args)
    print(f"\n{results['table']}")
    for line in _findings(results):
        print(line)
    if args.setting == "small":
        print(f"small: {CANNOT_SHOW[args.name]}")
    print(f"{time.monotonic() - started:.0f} s; written: {args.out}/results.json, table.csv, table.md, plots")


def _findings(results: dict) -> list[str]:
    from dsmap.dsnet.experiments.cifar import sentence

    orders = results.get("orders") or ({"encoders": results["order"]} if "order" in results else {})
    return [f"{name}: {sentence(order)}" for name, order in orders.items()]


def _cifar(args: Args) -> dict:
    from dsmap.dsnet.experiments import cifar

    is_lk = args.name == "cifar-lk"
    setting = (cifar.LK_SETTINGS if is_lk else cifar.DECONVNET_SETTINGS)[args.setting]
    chosen = {
        "stem_stride": args.stem_stride,
        "dropout": args.dropout,
        "folds": args.folds,
        "seeds": args.seeds,
    }
    given = {key: value for key, value in chosen.items() if value is not None}
    train = replace(setting.train, seed=args.seed, epochs=args.epochs or setting.train.epochs)
    setting = replace(setting, train=train, cells=args.cells, **given)
    run = cifar.cifar_lk if is_lk else cifar.cifar_deconvnet
    return run(_one(args), args.out, setting, device=args.device)


def _voc(args: Args) -> dict:
    from dsmap.dsnet.experiments import voc

    setting = voc.VOC_SETTINGS[args.setting]
    train, finetune = (_training(config, args) for config in (setting.train, setting.finetune))
    setting = replace(setting, train=train, finetune=finetune, cells=args.cells)
    if args.name == "voc-lk":
        return voc.voc_lk(args.data, args.out, setting, **_where(args))
    if args.nyu is None:
        raise InputError("voc-nyu: no NYUv2, expected --nyu PATH")
    return voc.voc_nyu(args.data, args.nyu, args.out, setting, **_where(args))


def _nyuv2(args: Args) -> dict:
    from dsmap.dsnet.experiments.nyuv2 import nyuv2_table

    return nyuv2_table(_one(args), args.weights, args.out, 50 if args.setting == "small" else None)


def _rendered(args: Args) -> dict:
    from dsmap.dsnet.experiments.nyuv2 import CURVE_SETTINGS, rendered_curve

    if args.rendered is None:
        raise InputError("rendered-curve: no rendered recordings, expected --rendered FOLDER")
    setting = CURVE_SETTINGS[args.setting]
    pretrain, finetune = (_training(config, args) for config in (setting.pretrain, setting.finetune))
    setting = replace(setting, pretrain=pretrain, finetune=finetune, cells=args.cells)
    return rendered_curve(_one(args), args.rendered, args.out, setting, **_where(args))


_EXPERIMENTS: dict[str, Callable[[Args], dict]] = {
    "cifar-lk": _cifar,
    "cifar-deconvnet": _cifar,
    "voc-lk": _voc,
    "voc-nyu": _voc,
    "nyuv2": _nyuv2,
    "rendered-curve": _rendered,
}


def _one(args: Args) -> Path:
    if len(args.data) != 1:
        raise InputError(f"{args.name}: {len(args.data)} data sets, expected one")
    return args.data[0]


def _training(config: Any, args: Args) -> Any:
    """A `TrainConfig` with the seed and, if given, the steps of the command line."""
    if args.steps is None:
        return replace(config, seed=args.seed)
    steps = args.steps
    return replace(config, seed=args.seed, steps=steps, validate_every=min(config.validate_every, steps))


def _where(args: Args) -> dict[str, Any]:
    return {"device": args.device, "workers": args.workers}
