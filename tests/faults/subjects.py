"""What is damaged: inputs of every reader, and the commands that read them."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from recordings import (
    Build,
    by_format,
    figures,
    layout,
    mapped,
    packed,
    scene,
    tum,
    with_config,
    with_label_map,
)
from training_inputs import (
    TRAIN,
    cifar,
    cifar_batch,
    labelled,
    nyuv2,
    recipe,
    sbd,
    scannet,
    sunrgbd,
    trained,
    voc,
    weights,
)

PIXELS = ("*.png",)
"""Files with checksums: whatever is changed in them has to be noticed."""


@dataclass(frozen=True)
class Subject:
    """An input and the commands that read it."""

    name: str
    build: Build
    """Writes the whole input into a folder."""
    calls: tuple[str, ...]
    """Command lines; `{in}` is the folder, `{out}` a place for results. One of them is called in a case."""
    files: tuple[str, ...] = ("**/*",)
    """Which files of the folder are damaged."""
    weight: float = 1.0
    sealed: tuple[str, ...] = ()
    """Names of the files that carry a checksum: another result without a word about it is a fault."""


FORMATS = (
    "ros1", "ros1-compressed", "ros2-db3", "ros2-mcap", "realsense", "scannet-sens", "scannet", "replica", "icl-nuim", "sun3d",
    "bundlefusion", "transforms.json", "record3d", "stray-scanner", "arkitscenes", "rtabmap", "klg", "azure-kinect",
)  # fmt: skip
MAP = "--segmenter none --device cpu --no-pictures"
RENDER = "--frames 1 --size 32x24 --path views"

SUBJECTS: tuple[Subject, ...] = (
    Subject("tum", tum, (
        "info {in}/rec", f"map {{in}}/rec --out {{out}}/run {MAP}", f"map {{in}}/rec --out {{out}}/run {MAP} --poses given",
        f"map {{in}}/rec --out {{out}}/run {MAP} --segmenter labels", "cut {in}/rec {out}/cut", "convert {in}/rec {out}/new --to nyu40",
        "convert {in}/rec {out}/new --to coco", "convert {in}/rec {out}/new --to nerfstudio",
    ), weight=8, sealed=PIXELS),
    Subject("tum-calibration", tum, ("info {in}/rec", f"map {{in}}/rec --out {{out}}/run {MAP}"), ("rec/calibration.yaml",), weight=5),
    Subject("tum-lists", tum, ("info {in}/rec", f"map {{in}}/rec --out {{out}}/run {MAP} --poses given"), ("rec/*.txt",), weight=4),
    Subject("seven-scenes", layout("seven"), ("info {in}/rec", f"map {{in}}/rec --out {{out}}/run {MAP}"), weight=2, sealed=PIXELS),
    Subject("redwood", layout("redwood"), ("info {in}/rec", f"map {{in}}/rec --out {{out}}/run {MAP} --poses given"), weight=2, sealed=PIXELS),
    Subject("redwood-log", layout("redwood"), ("info {in}/rec", f"map {{in}}/rec --out {{out}}/run {MAP} --poses given"), ("rec/trajectory.log",), weight=1.5),
    Subject("config", with_config, (f"map {{in}}/rec --out {{out}}/run --config {{in}}/mine.yaml {MAP}",), ("mine.yaml",), weight=7),
    Subject("label-map", with_label_map, tuple(
        f"map {{in}}/rec --out {{out}}/run {MAP} --segmenter labels --label-map {{in}}/map.{s}" for s in ("yaml", "csv", "json")
    ), ("map.*",), weight=3),
    Subject("run-checkpoint", mapped, (
        "map {in}/rec --out {in}/run --resume --no-pictures", f"map {{in}}/rec --out {{out}}/run {MAP} --localize-in {{in}}/run",
        f"map {{in}}/rec --out {{out}}/run {MAP} --localize-in {{in}}/run --extend", "evaluate {in}/run --reference {in}/rec",
    ), ("run/checkpoint.safetensors",), weight=12, sealed=("checkpoint.safetensors",)),
    Subject("run-folder", mapped, (
        "evaluate {in}/run --reference {in}/rec", "view {in}/run --png {out}/png", "evaluate {in}/run",
        "map {in}/rec --out {in}/run --resume --no-pictures",
    ), ("run/*.*",), weight=5, sealed=("checkpoint.safetensors",)),
    Subject("run-map", mapped, ("view {in}/run --png {out}/png",), ("run/map.ply", "run/trajectory.txt"), weight=3),
    Subject("weights", weights, (
        "map {in}/rec --out {out}/run --device cpu --no-pictures --engine torch --weights {in}/net.safetensors", "model-card {in}/net.safetensors {out}/card.md",
        "export-onnx {in}/net.safetensors {out}/net.onnx", "evaluate --data {in}/rec --engine torch --weights {in}/net.safetensors --out {out}/m.json",
    ), ("net.safetensors",), weight=9, sealed=("net.safetensors",)),
    Subject("training", trained, (
        f"train --out {{in}}/net --data {{in}}/set --val {{in}}/set {TRAIN} --resume",
        f"train --out {{out}}/net --data {{in}}/set --val {{in}}/set {TRAIN} --init {{in}}/net/best.safetensors",
        f"train --out {{out}}/net --data {{in}}/set --val {{in}}/set {TRAIN} --teacher {{in}}/net/best.safetensors",
    ), ("net/*.*",), weight=4, sealed=("*.safetensors",)),
    Subject("recipe", recipe, ("train --recipe {in}/mine.yaml --out {out}/net --workers 0 --places set={in}/set",), ("mine.yaml",), weight=4),
    Subject("figures", figures, ("reproduce --figures {in}/mine.yaml --list",), ("mine.yaml",), weight=1.5),
    *(Subject(f"format-{name}", by_format(name), ("info {where}", f"map {{where}} --out {{out}}/run {MAP}", "info {where}"), weight=1.6, sealed=PIXELS) for name in FORMATS),
    *(Subject(f"archive-{kind}", packed(kind), ("info {in}/rec." + kind,), weight=1) for kind in ("zip", "tgz")),
    *(Subject(f"scene-{kind}", scene(kind), (
        f"render-scene {{out}}/seq --scene {{in}}/home.{ {'replica': 'ply'}.get(kind, kind) } --class-map {{in}}/classes.yaml {RENDER}",
        f"render-scene {{out}}/seq --scene {{in}}/home.{ {'replica': 'ply'}.get(kind, kind) } {RENDER}",
    ), weight=2.5, sealed=PIXELS) for kind in ("xml", "glb", "ply", "replica", "obj")),
    Subject("nyuv2", nyuv2, ("evaluate --data {in}@trainval --engine torch --weights {in}/net.safetensors --out {out}/m.json",), ("*.mat",), weight=3),
    Subject("sunrgbd", sunrgbd, ("evaluate --data {in}/sun --engine torch --weights {in}/net.safetensors --out {out}/m.json",), ("sun/**/*",), weight=2),
    Subject("scannet-frames", scannet, ("evaluate --data {in}/frames --engine torch --weights {in}/net.safetensors --out {out}/m.json",), ("frames/**/*",), weight=2, sealed=PIXELS),
    Subject("voc", voc, (f"train --out {{out}}/net --data {{in}}/voc --val {{in}}/voc@val {TRAIN}",), weight=1, sealed=PIXELS),
    Subject("sbd", sbd, (f"train --out {{out}}/net --data {{in}}/sbd@train --val {{in}}/sbd {TRAIN}",), weight=1.5),
    Subject("folders", labelled, (
        "evaluate --data {in}/set --engine torch --weights {in}/net.safetensors --out {out}/m.json", f"train --out {{out}}/net --data {{in}}/set --val {{in}}/rec {TRAIN}",
        "validation-split {in}/set --out {out}/split.txt --images 2 --blocks 1",
    ), ("set/**/*", "rec/**/*"), weight=2, sealed=PIXELS),
    *(Subject(f"cifar-{kind}", build, (f"cifar {{in}}/{place}",), weight=1.5) for kind, build, place in (
        ("binary", cifar("binary"), "cifar.tar.gz"), ("python", cifar("python"), "cifar.tar.gz"), ("batch", cifar_batch, "cifar"),
    )),
)  # fmt: skip


@dataclass
class Prepared:
    """A subject on disk."""

    subject: Subject
    files: list[Path] = field(default_factory=list)
    """Relative to the folder."""
    special: dict[Path, list[Any]] = field(default_factory=dict)
    """What beside bytes can be damaged in each file."""


def prepare(subject: Subject, folder: Path) -> Prepared:
    """Write a subject's input, and find out which kinds of damage fit which file."""
    import damage

    if not folder.exists():
        folder.mkdir(parents=True)
        subject.build(folder)
    found = sorted(
        {
            p
            for pattern in subject.files
            for p in folder.glob(pattern)
            if p.is_file() and p.name != "where.txt"
        }
    )
    by_kind: dict[tuple[str, bytes], list[Any]] = {}  # files that begin and end alike can be damaged alike
    special = {}
    for path in found:
        alike = path.suffix, path.read_bytes()[:4]
        if alike not in by_kind:
            by_kind[alike] = damage.applicable(path)
        special[path.relative_to(folder)] = by_kind[alike]
    return Prepared(subject, list(special), special)
