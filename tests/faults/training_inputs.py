"""Whole weights, trainings and data sets, to be damaged."""

import io
import pickle
import tarfile
from pathlib import Path

import cv2
import numpy as np
from command_line import cli
from recordings import Build, recorded


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
    recorded(folder / "rec", 2)
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
    recorded(folder / "rec", 2)
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
