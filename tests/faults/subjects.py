"""What is damaged: whole inputs of every reader, and the commands that read them."""

import dataclasses
import io
import json
import pickle
import shutil
import sys
import tarfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

Build = Callable[[Path], object]
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


def _frames(count: int) -> list[Any]:
    from corner_frames import FRAMES

    return FRAMES[:count]


def _recording(folder: Path, frames: int = 6) -> Path:
    from dsmap.sequences import SequenceWriter
    from dsmap.tools.twins.corner import INTRINSICS

    camera = INTRINSICS.scaled(64, 48)
    with SequenceWriter(folder, camera, depth_max=6.0) as writer:
        for i, f in enumerate(_frames(frames)):
            small = [
                np.ascontiguousarray(cv2.resize(a, (64, 48), interpolation=cv2.INTER_NEAREST))
                for a in (f.rgb, f.depth, f.label)
            ]
            writer.write(
                i / 30,
                small[0],
                small[1],
                T_world_camera=f.T_world_camera,
                label=small[2],
                instance=np.full((48, 64), 3),
            )
    return folder


def tum(folder: Path) -> None:
    _recording(folder / "rec")


def mapped(folder: Path) -> None:
    """A recording and a RUN of it."""
    _recording(folder / "rec")
    cli(f"map {folder / 'rec'} --out {folder / 'run'} --segmenter labels --device cpu --no-pictures")


def with_config(folder: Path) -> None:
    from dsmap.files import write_yaml
    from dsmap.fusion.config import MapConfig

    _recording(folder / "rec", 3)
    values = dataclasses.asdict(MapConfig())
    kept = {k: values[k] for k in ("track", "surfels", "labels", "ferns", "relocalise", "graph", "moving")}
    write_yaml(
        folder / "mine.yaml", {**kept, "depth_min": 0.3, "stride": 1, "pictures": False, "camera_up": "top"}
    )


def with_label_map(folder: Path) -> None:
    _recording(folder / "rec", 3)
    (folder / "map.yaml").write_text("".join(f"{i}: {i}\n" for i in range(14)))
    (folder / "map.csv").write_text("id,class\n" + "".join(f"{i},{i}\n" for i in range(14)))
    (folder / "map.json").write_text(
        json.dumps([{"id": 12, "class": "wall", "color": "#101010"}, {"id": 5, "name": "floor"}])
    )


def small(path: Path) -> None:
    import torch

    from dsmap.dsnet.checkpoint import WeightsInfo, save_weights
    from dsmap.dsnet.config import DSNetConfig
    from dsmap.dsnet.networks.build import build_network

    torch.manual_seed(0)
    net = DSNetConfig(layers=2, growth=4, widths=(8, 8, 8, 8), stem_convs=1, dropout=0.1)
    share = (0.0, *[1 / 13] * 13)
    save_weights(
        path,
        build_network(net),
        WeightsInfo(net, size=(64, 64), shares=share, balance=(0.0, *[1.0] * 13), notes={"steps": 3}),
    )


def weights(folder: Path) -> None:
    _recording(folder / "rec", 2)
    small(folder / "net.safetensors")


TRAIN = "--no-log --workers 0 --steps 2 --batch 2 --size 32 32 --validate-every 1 --warmup 1 --net.layers 2 --net.growth 4 --net.widths 8 8 8 8"


def images(folder: Path) -> None:
    from tiny_training import coloured_rectangles

    coloured_rectangles(folder / "set", 3)


def trained(folder: Path) -> None:
    images(folder)
    cli(f"train --out {folder / 'net'} --data {folder / 'set'} --val {folder / 'set'} {TRAIN}")


def recipe(folder: Path) -> None:
    images(folder)
    (folder / "mine.yaml").write_text(
        "about: two stages\nplaces: {set: none}\ndata: ['${set}']\nval: ${set}\nlog: false\nbatch: 2\nsize: [32, 32]\nwarmup: 1\n"
        "validate_every: 1\nnet: {layers: 2, growth: 4, widths: [8, 8, 8, 8]}\naugment: {flip: 0.5}\n"
        "stages:\n- {name: one, steps: 1}\n- {name: two, steps: 1, lr: 0.001}\n"
    )


def figures(folder: Path) -> None:
    from importlib import resources

    (folder / "mine.yaml").write_text((resources.files("dsmap.tools") / "figures.yaml").read_text())


def layout(name: str) -> Build:
    def build(folder: Path) -> None:
        _recording(folder / "tum", 4)
        shots = zip(
            sorted((folder / "tum" / "rgb").iterdir()),
            sorted((folder / "tum" / "depth").iterdir()),
            strict=True,
        )
        poses = [f.T_world_camera for f in _frames(4)]
        (folder / "rec").mkdir()
        for i, (colour, depth) in enumerate(shots):
            depth = cv2.imread(str(depth), cv2.IMREAD_UNCHANGED)
            places = {
                "seven": (f"frame-{i:06d}.color.png", f"frame-{i:06d}.depth.png"),
                "redwood": (f"image/{i:05d}.png", f"depth/{i:05d}.png"),
            }
            for place, content in zip(
                places[name], (colour.read_bytes(), cv2.imencode(".png", depth)[1].tobytes()), strict=True
            ):
                (folder / "rec" / place).parent.mkdir(exist_ok=True)
                (folder / "rec" / place).write_bytes(content)
            if name == "seven":
                np.savetxt(folder / "rec" / f"frame-{i:06d}.pose.txt", poses[i])
        if name == "redwood":
            blocks = [
                f"{i} {i} {i + 1}\n" + "\n".join(" ".join(f"{v:.9f}" for v in row) for row in T)
                for i, T in enumerate(poses)
            ]
            (folder / "rec" / "trajectory.log").write_text("\n".join(blocks) + "\n")
        shutil.copy(folder / "tum" / "calibration.yaml", folder / "rec")
        shutil.rmtree(folder / "tum")

    return build


def by_format(name: str) -> Build:
    def build(folder: Path) -> None:
        import format_cases
        import recording_shots

        case = format_cases.CASES[name]
        (folder / "rec").mkdir()
        place = case.write(folder / "rec", recording_shots.shots()[:4])
        (folder / "where.txt").write_text(str(place.relative_to(folder)))

    return build


def packed(kind: str) -> Build:
    def build(folder: Path) -> None:
        _recording(folder / "rec", 3)
        made = shutil.make_archive(str(folder / "packed"), {"tgz": "gztar"}.get(kind, kind), folder, "rec")
        Path(made).rename(folder / f"rec.{kind}")
        shutil.rmtree(folder / "rec")

    return build


def scene(kind: str) -> Build:
    def build(folder: Path) -> None:
        from PIL import Image

        sys.path.insert(0, str(Path(__file__).parents[1] / "sim"))
        import test_importers as toys

        rng = np.random.default_rng(0)
        if kind == "xml":
            (folder / "home.xml").write_text(
                toys.MJCF.format(ball="red_ball").replace(
                    'builtin="checker" width="32" height="32" rgb1="0.8 0.6 0.4" rgb2="0.6 0.4 0.2"',
                    'file="boards.png"',
                )
            )
            Image.fromarray(rng.integers(0, 255, (8, 8, 3), dtype=np.uint8)).save(folder / "boards.png")
        elif kind == "glb":
            toys.boxes(folder / "home.glb")
        elif kind == "ply":
            toys.scan(folder / "home.ply", "label", [2, 1])
        elif kind == "replica":
            toys.scan(folder / "home.ply", "object_id", [11, 12])
            info = {"classes": [{"id": 1, "name": "rug"}, {"id": 2, "name": "sofa"}],
                    "objects": [{"id": 11, "class_id": 1}, {"id": 12, "class_id": 2}]}  # fmt: skip
            (folder / "info_semantic.json").write_text(json.dumps(info))
        elif kind == "obj":
            (folder / "home.obj").write_text(
                "mtllib home.mtl\no floor\nv -4 -4 0\nv 4 -4 0\nv 4 4 0\nv -4 4 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl floor\n"
                "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\no table\nv -0.5 0 0.7\nv 0.5 0 0.7\nv 0 0.5 0.7\nv 0 0 0.9\nusemtl table\nf 5/1 6/2 7/3\nf 5/1 6/2 8/3\n"
                "o wall\nv -4 4 0\nv 4 4 0\nv 4 4 2.5\nv -4 4 2.5\nusemtl floor\nf 9/1 10/2 11/3\nf 9/1 11/3 12/4\n"
            )
            (folder / "home.mtl").write_text(
                "newmtl floor\nKd 1 1 1\nmap_Kd boards.png\nnewmtl table\nKd 0.5 0.2 0.1\n"
            )
            Image.fromarray(rng.integers(0, 255, (8, 8, 3), dtype=np.uint8)).save(folder / "boards.png")
        (folder / "classes.yaml").write_text("red_ball: objects\n'*': furniture\n")

    return build


def nyuv2(folder: Path) -> None:
    import h5py
    import scipy.io

    labels = np.ones((4, 48, 64), np.uint16)
    labels[:, 20:] = 2
    with h5py.File(folder / "nyu_depth_v2_labeled.mat", "w") as file:
        file["images"] = np.arange(4, dtype=np.uint8)[:, None, None, None] * 10 + np.zeros(
            (4, 3, 64, 48), np.uint8
        )
        file["depths"] = np.full((4, 64, 48), 1.5, np.float32)
        file["labels"] = labels.transpose(0, 2, 1)
    scipy.io.savemat(
        folder / "splits.mat", {"trainNdxs": np.array([[1], [3]]), "testNdxs": np.array([[2], [4]])}
    )
    scipy.io.savemat(
        folder / "classMapping40.mat", {"mapClass": np.array([[5, 1, 22, 25]])}, do_compression=True
    )
    small(folder / "net.safetensors")


def sunrgbd(folder: Path) -> None:
    import h5py
    import scipy.io

    root = folder / "sun"
    places = [f"SUNRGBD/kv1/b3dodata/img_{k}" for k in range(2)]
    meta = np.zeros(2, dtype=[("rgbpath", object), ("rgbname", object)])
    for k, place in enumerate(places):
        (root / place / "image").mkdir(parents=True)
        cv2.imwrite(str(root / place / "image" / f"{k}.jpg"), np.full((48, 64, 3), 60 * k, np.uint8))
        meta[k] = (f"/n/fs/sun3d/data/{place}/image/{k}.jpg", f"{k}.jpg")
    toolbox = root / "SUNRGBDtoolbox"
    for name in ("Metadata", "traintestSUNRGBD"):
        (toolbox / name).mkdir(parents=True)
    scipy.io.savemat(toolbox / "Metadata" / "SUNRGBDMeta.mat", {"SUNRGBDMeta": meta})
    listed = {
        "alltrain": np.array([f"/n/fs/sun3d/data/{p}" for p in places], object),
        "alltest": np.array([f"/n/fs/sun3d/data/{places[1]}"], object),
    }
    scipy.io.savemat(toolbox / "traintestSUNRGBD" / "allsplit.mat", listed)
    with h5py.File(toolbox / "Metadata" / "SUNRGBD2Dseg.mat", "w") as file:
        for k in range(2):
            file[f"#refs#/{k}"] = np.full((64, 48), (1, 37)[k], np.uint8)
        file.create_dataset(
            "SUNRGBD2Dseg/seglabel", data=[[file[f"#refs#/{k}"].ref] for k in range(2)], dtype=h5py.ref_dtype
        )
    small(folder / "net.safetensors")


def scannet(folder: Path) -> None:
    place = folder / "frames" / "scene0000_00"
    for name in ("color", "depth", "label-filt", "intrinsic"):
        (place / name).mkdir(parents=True)
    for k in (2, 10):
        cv2.imwrite(str(place / "color" / f"{k}.jpg"), np.full((48, 64, 3), 60, np.uint8))
        cv2.imwrite(str(place / "depth" / f"{k}.png"), np.full((48, 64), 1500, np.uint16))
        cv2.imwrite(str(place / "label-filt" / f"{k}.png"), np.full((48, 64), 1163, np.uint16))
    (folder / "frames" / "scannetv2-labels.combined.tsv").write_text(
        "id\traw_category\tnyu40id\n2\tchair\t5\n1163\tobject\t40\n"
    )
    np.savetxt(
        place / "intrinsic" / "intrinsic_depth.txt",
        np.diag([57.0, 57.0, 1.0, 1.0]) + 30 * np.eye(4, k=2)[:, :4],
    )
    small(folder / "net.safetensors")


def voc(folder: Path) -> None:
    from experiment_data import write_voc

    write_voc(folder / "voc", 3, official=True)


def sbd(folder: Path) -> None:
    import scipy.io

    for name in ("img", "cls"):
        (folder / "sbd" / name).mkdir(parents=True)
    for k in range(2):
        cv2.imwrite(str(folder / "sbd" / "img" / f"{k}.jpg"), np.full((48, 64, 3), 60, np.uint8))
        scipy.io.savemat(
            folder / "sbd" / "cls" / f"{k}.mat",
            {"GTcls": {"Segmentation": np.full((48, 64), 15, np.uint8), "Boundaries": 0}},
        )
    (folder / "sbd" / "train.txt").write_text("0\n1\n")


def labelled(folder: Path) -> None:
    from experiment_data import write_labelled

    write_labelled(folder / "set", range(1, 4))
    _recording(folder / "rec", 2)
    small(folder / "net.safetensors")


def cifar(kind: str) -> Build:
    def build(folder: Path) -> None:
        from experiment_data import coloured

        data = coloured(20)
        planes = data.images.transpose(0, 3, 1, 2).reshape(20, -1)
        with tarfile.open(folder / "cifar.tar.gz", "w:gz") as archive:
            for name in ("data_batch_1", "test_batch"):
                if kind == "binary":
                    content = np.concatenate([data.labels[:, None], planes], 1).tobytes()
                    name += ".bin"
                else:
                    content = pickle.dumps({b"data": planes, b"labels": data.labels.tolist()}, protocol=2)
                member = tarfile.TarInfo("cifar/" + name)
                member.size = len(content)
                archive.addfile(member, io.BytesIO(content))

    return build


def cifar_batch(folder: Path) -> None:
    """The python version unpacked: its pickles are damaged themselves."""
    cifar("python")(folder)
    with tarfile.open(folder / "cifar.tar.gz") as archive:
        archive.extractall(folder, filter="data")
    (folder / "cifar.tar.gz").unlink()


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
        "validation-split {in}/set --out {out}/split.txt --images 1 --blocks 1",
    ), ("set/**/*", "rec/**/*"), weight=2, sealed=PIXELS),
    *(Subject(f"cifar-{kind}", build, (f"cifar {{in}}/{place}",), weight=1.5) for kind, build, place in (
        ("binary", cifar("binary"), "cifar.tar.gz"), ("python", cifar("python"), "cifar.tar.gz"), ("batch", cifar_batch, "cifar"),
    )),
)  # fmt: skip


def cli(line: str) -> int:
    """A command of dsmap in this process, by its command line; `cifar` is a reader that has no quick command."""
    from dsmap.tools.cli import run

    command, *argv = line.split()
    if command != "cifar":
        return run(command, argv)
    from dsmap.dsnet.datasets.cifar import load_cifar10
    from dsmap.errors import InputError

    try:
        data = load_cifar10(argv[0])
        print(len(data), data.images.shape, np.bincount(data.labels))
        return 0
    except InputError as error:
        print(f"cifar: {error}", file=sys.stderr)
        return 2


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


def expand(call: str, inside: Path, out: Path) -> str:
    """The command line of a call."""
    where = inside / "where.txt"
    place = inside / where.read_text() if where.exists() else inside
    return call.replace("{in}", str(inside)).replace("{out}", str(out)).replace("{where}", str(place))
