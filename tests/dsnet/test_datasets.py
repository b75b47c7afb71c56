"""Every data set's loader on small files made here in the layout of the official ones."""

import pickle

import cv2
import numpy as np
import pytest
import scipy.io
from PIL import Image

from dsmap.classes import NYU40_TO_13
from dsmap.dsnet.datasets.base import VOC_CLASS_NAMES
from dsmap.dsnet.datasets.registry import open_set, open_sets
from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.sequences import SequenceWriter

h5py = pytest.importorskip("h5py")

SIZE = (6, 8)  # rows, columns


def colour(path, value=50, size=SIZE):
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((*size, 3), value, np.uint8))


def ids(path, values):
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), values)


def inverse_depth(example):
    """In the middle of the image [1/m], out of the channel's own units (see `kernels.geometry`)."""
    return float(example.geometry[2, 4, 0]) * 0.25 + 0.45


def refused(spec, message):
    with pytest.raises(InputError, match=message):
        for item in open_set(spec).items:
            item.read()


@pytest.fixture
def nyuv2(tmp_path):
    """Five images; image k is grey 10 k at (k + 1) m, its left half label 1 and its right half label k."""
    folder = tmp_path / "nyu"
    folder.mkdir()
    labels = np.zeros((5, *SIZE), np.uint16)
    for k in range(5):
        labels[k, :, :4], labels[k, :, 4:] = 1, k
    with h5py.File(folder / "nyu_depth_v2_labeled.mat", "w") as file:  # MATLAB's axes are reversed in HDF5
        images = np.arange(5, dtype=np.uint8)[:, None, None, None] * 10 + np.zeros((5, 3, 8, 6), np.uint8)
        images[:, 1] += 1
        file["images"] = images
        depths = np.ones((5, 8, 6), np.float32) * np.arange(1, 6, dtype=np.float32)[:, None, None]
        depths[0, 0, 1] = np.nan
        file["depths"] = depths
        file["labels"] = labels.transpose(0, 2, 1)
    split = {"trainNdxs": np.array([[1], [3], [4]]), "testNdxs": np.array([[2], [5]])}
    scipy.io.savemat(folder / "splits.mat", split)
    # Names 1..4 are NYU40 classes 5 (chair), 1 (wall), 22 (ceiling), 25 (television).
    scipy.io.savemat(folder / "classMapping40.mat", {"mapClass": np.array([[5, 1, 22, 25]])})
    return folder


def test_nyuv2_official_file(nyuv2):
    data = open_set(nyuv2)
    assert len(data.items) == 3 and data.has_depth
    example = data.items[1].read()  # image 3
    assert example.rgb.shape == (*SIZE, 3) and example.rgb[0, 0].tolist() == [20, 21, 20]
    assert example.label.dtype == np.uint8 and example.geometry.dtype == np.float16
    assert (example.label[:, :4] == 4).all() and (example.label[:, 4:] == 12).all()  # chair, wall
    assert inverse_depth(example) == pytest.approx(1 / 3, abs=2e-3)
    assert not data.items[0].read().geometry[1, 0].any()  # not a number: no measurement
    assert example.geometry[3, 4, 3] == 1 and data.items[1].read(with_geometry=False).geometry is None
    assert data.items[0].read().label[0, 7] == 0
    test = open_set(f"{nyuv2 / 'nyu_depth_v2_labeled.mat'}@test")
    assert [int(item.read().rgb[0, 0, 0]) for item in test.items] == [10, 40]
    assert test.items[1].name.endswith("nyu_depth_v2_labeled.mat:5")
    assert pickle.loads(pickle.dumps(test.items[1])).read().label[0, 7] == 11  # as a loader process gets it


def test_nyuv2_with_40_labels_beside_it(nyuv2):
    labels = np.zeros((*SIZE, 5), np.uint8)
    labels[..., 2] = 22
    scipy.io.savemat(nyuv2 / "labels40.mat", {"labels40": labels})
    (nyuv2 / "classMapping40.mat").unlink()
    assert (open_set(nyuv2).items[1].read().label == 3).all()  # ceiling


def test_nyuv2_what_is_missing_is_named(nyuv2):
    refused(f"{nyuv2}@half", "split is 'half'")
    (nyuv2 / "classMapping40.mat").rename(nyuv2 / "away.mat")
    refused(nyuv2, r"classMapping40.mat: not there, expected .*Gupta")
    (nyuv2 / "splits.mat").write_bytes(b"x" * 300)
    refused(nyuv2, r"splits.mat: not a readable MATLAB file")
    (nyuv2 / "splits.mat").unlink()
    refused(nyuv2, r"splits.mat: not there, expected the official")
    scipy.io.savemat(nyuv2 / "splits.mat", {"trainNdxs": np.array([9])})
    refused(nyuv2, r"splits.mat: numbers exceed 1..5")
    other = nyuv2 / "other.mat"
    other.write_bytes((nyuv2 / "nyu_depth_v2_labeled.mat").read_bytes()[:200])
    refused(other, "not a readable HDF5 file")


def test_sunrgbd_flat_folders(tmp_path):
    for k in (1, 2):
        colour(tmp_path / "SUNRGBD-train_images" / f"img-{k:06}.jpg")
        ids(tmp_path / "train13labels" / f"img13labels-{k:06}.png", np.full(SIZE, k, np.uint8))
    assert [int(item.read().label[0, 0]) for item in open_set(tmp_path).items] == [1, 2]
    refused(f"{tmp_path}@test", r"SUNRGBD-test_images: not there.*SUNRGBD-test_images.tgz")
    (tmp_path / "train13labels").rename(tmp_path / "away")
    refused(tmp_path, "train13labels.tgz or sunrgbd_train_test_labels.tar.gz")
    for k in (5051, 5052):  # the training images follow the 5050 test images
        ids(tmp_path / "sunrgbd_train_test_labels" / f"img-{k:06}.png", np.full(SIZE, 22, np.uint8))
    assert (open_set(tmp_path).items[0].read().label == 3).all()
    (tmp_path / "sunrgbd_train_test_labels" / "img-005052.png").unlink()
    refused(tmp_path, r"img-005052.png: not there, expected the label of img-000002.jpg")


def test_sunrgbd_official_tree(tmp_path):
    places = [f"SUNRGBD/kv1/b3dodata/img_{k}" for k in range(3)]
    meta = np.zeros(3, dtype=[("rgbpath", object), ("rgbname", object)])
    for k, place in enumerate(places):
        colour(tmp_path / place / "image" / f"{k}.jpg", 10 * k)
        meta[k] = (f"/n/fs/sun3d/data/{place}/image/{k}.jpg", f"{k}.jpg")
    toolbox = tmp_path / "SUNRGBDtoolbox"
    (toolbox / "Metadata").mkdir(parents=True)
    (toolbox / "traintestSUNRGBD").mkdir()
    scipy.io.savemat(toolbox / "Metadata" / "SUNRGBDMeta.mat", {"SUNRGBDMeta": meta})
    listed = {
        "alltrain": np.array([f"/n/fs/sun3d/data/{places[2]}", f"/n/fs/sun3d/data//{places[0]}"], object),
        "alltest": np.array([f"/n/fs/sun3d/data/{places[1]}"], object),
    }
    scipy.io.savemat(toolbox / "traintestSUNRGBD" / "allsplit.mat", listed)
    labels = toolbox / "Metadata" / "SUNRGBD2Dseg.mat"
    with h5py.File(labels, "w") as file:
        for k in range(3):
            file[f"#refs#/{k}"] = np.full((8, 6), (1, 2, 37)[k], np.uint8)
        references = [[file[f"#refs#/{k}"].ref] for k in range(3)]
        file.create_dataset("SUNRGBD2Dseg/seglabel", data=references, dtype=h5py.ref_dtype)
    train = [item.read() for item in open_set(tmp_path).items]
    assert [int(example.label[0, 0]) for example in train] == [12, 7]  # wall, bag = objects
    assert int(open_set(f"{tmp_path}@test").items[0].read().label[0, 0]) == 5  # floor
    (tmp_path / places[0] / "image" / "0.jpg").unlink()
    refused(tmp_path, r"0.jpg: not there, expected all images of SUNRGBD.zip")
    labels.unlink()
    refused(tmp_path, r"SUNRGBD2Dseg.mat: not there.*SUNRGBDtoolbox.zip")


def test_scannet_in_both_ways(tmp_path):
    raw, ready = tmp_path / "scene0000_00", tmp_path / "scene0001_00"
    for k in (2, 10):
        colour(raw / "color" / f"{k}.jpg", k, (12, 16))
        ids(raw / "depth" / f"{k}.png", np.full((3, 4), 1500, np.uint16))
        ids(raw / "label-filt" / f"{k}.png", np.full(SIZE, 1163, np.uint16))
    colour(ready / "color" / "000000.jpg")
    ids(ready / "depth" / "000000.png", np.full(SIZE, 2000, np.uint16))
    ids(ready / "label" / "000000.png", np.full(SIZE, 39, np.uint8))
    refused(tmp_path, r"scannetv2-labels.combined.tsv: not there")
    table = tmp_path / "scannetv2-labels.combined.tsv"
    table.write_text("id\traw_category\tnyu40id\n2\tchair\t5\n1163\tobject\t40\n")
    data = open_set(tmp_path)
    assert [item.rgb.stem for item in data.items] == ["2", "10", "000000"]
    assert not data.has_depth and data.items[0].read().geometry is None  # of which camera is not said
    for scene in (raw / "intrinsic", ready):
        scene.mkdir(exist_ok=True)
        name = "intrinsic_depth.txt" if scene.name == "intrinsic" else "intrinsics_depth.txt"
        np.savetxt(scene / name, np.diag([577.0, 578.0, 1.0, 1.0]) + 300 * np.eye(4, k=2)[:, :4])
    data = open_set(tmp_path)
    assert data.has_depth
    example = data.items[0].read()
    assert example.rgb.shape == (*SIZE, 3) and (example.label == 7).all()
    assert inverse_depth(example) == pytest.approx(1 / 1.5, abs=2e-3)
    assert example.geometry.shape == (*SIZE, 4)
    assert (data.items[2].read().label == 6).all()
    (tmp_path / "scannetv2_val.txt").write_text("scene0001_00\n")
    assert len(open_set(f"{tmp_path}@val").items) == 1
    refused(f"{tmp_path}@train", r"scannetv2_train.txt: not there")
    table.write_text("id\traw_category\n2\tchair\n")
    refused(tmp_path, "expected columns id and nyu40id")
    table.write_text("id\tnyu40id\n2\t5\n")
    refused(tmp_path, "class id 1163 found, expected 0..2")


def test_voc_masks_are_read_as_indices(tmp_path):
    indices = np.zeros(SIZE, np.uint8)
    indices[0, :3] = 15, 20, 255
    palette = Image.fromarray(indices, mode="P")
    palette.putpalette(list(range(256)) * 3)
    masks = tmp_path / "SegmentationClass"
    masks.mkdir()
    palette.save(masks / "2007_000001.png")
    ids(masks / "2007_000002.png", indices)
    for name in ("2007_000001", "2007_000002"):
        colour(tmp_path / "JPEGImages" / f"{name}.jpg")
    data = open_set(tmp_path)
    assert data.class_names == VOC_CLASS_NAMES
    for item in data.items:
        example = item.read()
        assert example.label[0, :4].tolist() == [16, 21, 0, 1]
        assert VOC_CLASS_NAMES[16] == "person" and VOC_CLASS_NAMES[21] == "tv monitor"
    refused(f"{tmp_path}@train", r"train.txt: not there, expected a list of images")
    lists = tmp_path / "ImageSets" / "Segmentation"
    lists.mkdir(parents=True)
    (lists / "val.txt").write_text("2007_000002\n")
    assert [item.name[-15:] for item in open_set(tmp_path).items] == ["2007_000001.png"]
    assert [item.name[-15:] for item in open_set(f"{tmp_path}@val").items] == ["2007_000002.png"]
    Image.fromarray(np.zeros((*SIZE, 3), np.uint8)).save(masks / "2007_000001.png")
    refused(tmp_path, "mode RGB, expected one channel of ids")


def test_sbd_masks(tmp_path):
    colour(tmp_path / "img" / "a.jpg")
    (tmp_path / "cls").mkdir()
    mask = np.full(SIZE, 15, np.uint8)
    scipy.io.savemat(tmp_path / "cls" / "a.mat", {"GTcls": {"Segmentation": mask, "Boundaries": 0}})
    assert (open_set(tmp_path).items[0].read().label == 16).all()
    refused(f"{tmp_path}@train", r"train.txt: not there.*Semantic Boundaries")
    (tmp_path / "img" / "a.jpg").unlink()
    refused(tmp_path, r"a.jpg: not there, expected the image of cls/a.mat")


def test_rendered_sets_have_depth_and_named_splits(tmp_path):
    for name in ("train", "val"):
        camera = Intrinsics(8, 6, 8.0, 8.0, 3.5, 2.5)
        with SequenceWriter(tmp_path / name / "000", camera, depth_scale=5000.0) as writer:
            depth = np.full(SIZE, 1.5)
            writer.write(0.0, np.zeros((*SIZE, 3), np.uint8), depth, label=np.ones(SIZE, np.uint8))
    data = open_set(f"{tmp_path}@val")
    assert data.has_depth and len(data.items) == 1
    assert inverse_depth(data.items[0].read()) == pytest.approx(1 / 1.5, abs=2e-3)
    refused(f"{tmp_path / 'train'}@test", "no sub-folder 'test'")


def test_numbered_images_are_split_by_the_committed_list(tmp_path, monkeypatch):
    ranges = tmp_path / "list.txt"
    ranges.write_text("# made by hand\n3-4\n9-9\n")
    monkeypatch.setattr("dsmap.dsnet.datasets.splits.validation_numbers.__defaults__", (ranges,))
    for k in (2, 3, 5, 9):
        colour(tmp_path / "set" / "rgb" / f"{k:04}.jpg")
        ids(tmp_path / "set" / "label" / f"{k:04}.png", np.ones(SIZE, np.uint8))
    stems = {s: [i.label.stem for i in open_set(f"{tmp_path / 'set'}@{s}").items] for s in ("train", "val")}
    assert stems == {"train": ["0002", "0005"], "val": ["0003", "0009"]}


def test_sets_of_different_classes_are_not_mixed(tmp_path):
    colour(tmp_path / "voc" / "JPEGImages" / "a.jpg")
    ids(tmp_path / "voc" / "SegmentationClass" / "a.png", np.ones(SIZE, np.uint8))
    colour(tmp_path / "rooms" / "rgb" / "a.jpg")
    ids(tmp_path / "rooms" / "label" / "a.png", np.ones(SIZE, np.uint8))
    assert len(open_sets([tmp_path / "rooms", tmp_path / "rooms"]).items) == 2
    with pytest.raises(InputError, match=r"voc: classes are void, background"):
        open_sets([tmp_path / "rooms", tmp_path / "voc"])


def test_sun37_are_the_first_of_nyu40():
    from dsmap.dsnet.datasets.sunrgbd import SUN37_TO_13

    assert len(SUN37_TO_13) == 38 and (NYU40_TO_13[:38] == SUN37_TO_13).all()
