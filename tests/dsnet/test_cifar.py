"""CIFAR-10 in all its forms, unpickled without trust, and its folds."""

import io
import os
import pickle
import tarfile

import cv2
import numpy as np
import pytest

from dsmap.dsnet.datasets.cifar import CIFAR_CLASSES, folds, load_cifar10
from dsmap.errors import InputError

RNG = np.random.default_rng(0)
IMAGES = RNG.integers(0, 256, (6, 32, 32, 3), dtype=np.uint8)
LABELS = np.array([3, 0, 9, 9, 1, 5], np.uint8)


def planes(images):
    return images.transpose(0, 3, 1, 2).reshape(len(images), -1)


def binary(images, labels) -> bytes:
    return np.hstack([labels[:, None], planes(images)]).astype(np.uint8).tobytes()


def python2_pickle(images, labels) -> bytes:
    """As Python 2 wrote it: byte strings as keys, numpy's old module name, protocol 2."""
    batch = {b"batch_label": b"1 of 5", b"data": planes(images), b"labels": [int(v) for v in labels]}
    return pickle.dumps(batch, protocol=2).replace(b"numpy._core.multiarray", b"numpy.core.multiarray")


def archive(path, files, mode):
    with tarfile.open(path, mode) as tar:
        for name, data in files.items():
            member = tarfile.TarInfo(name)
            member.size = len(data)
            tar.addfile(member, io.BytesIO(data))
    return path


@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize("form", ["binary", "python"])
def test_official_versions(tmp_path, form, packed):
    make, suffix = (binary, ".bin") if form == "binary" else (python2_pickle, "")
    files = {
        f"cifar-10/data_batch_2{suffix}": make(IMAGES[3:], LABELS[3:]),
        f"cifar-10/data_batch_1{suffix}": make(IMAGES[:3], LABELS[:3]),
        f"cifar-10/test_batch{suffix}": make(IMAGES[:2], LABELS[:2]),
        "cifar-10/batches.meta": b"names",
    }
    path = tmp_path / "cifar.tar.gz"
    if packed:
        archive(path, files, "w:gz")
    else:
        path = tmp_path / "cifar-10"
        path.mkdir()
        for name, data in files.items():
            (tmp_path / name).write_bytes(data)
    train = load_cifar10(path)
    np.testing.assert_array_equal(train.images, IMAGES)
    np.testing.assert_array_equal(train.labels, LABELS)
    assert len(load_cifar10(path, "test")) == 2


@pytest.mark.parametrize("packed", [True, False])
def test_folders_of_pictures(tmp_path, packed):
    files = {}
    for image, label in zip(IMAGES, LABELS, strict=True):
        name = CIFAR_CLASSES[label]
        files[f"train/{name}/{len(files):04}.png"] = cv2.imencode(".png", image[..., ::-1])[1].tobytes()
    path = tmp_path / "cifar"
    if packed:
        path = archive(tmp_path / "cifar.tar.xz", files, "w:xz")
    for name, data in files.items() if not packed else ():
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(data)
    data = load_cifar10(path)
    order = sorted(range(6), key=lambda k: (CIFAR_CLASSES[LABELS[k]], k))
    np.testing.assert_array_equal(data.labels, LABELS[order])
    np.testing.assert_array_equal(data.images, IMAGES[order])
    with pytest.raises(InputError, match="no image of CIFAR-10's test set in it, expected cifar-10-binary"):
        load_cifar10(path, "test")


class _Harm:
    def __reduce__(self):
        return os.mkdir, ("harm",)


def test_a_pickle_cannot_run_code(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data_batch_1").write_bytes(pickle.dumps({b"data": _Harm(), b"labels": []}))
    with pytest.raises(InputError, match="found 6 bytes of pixels and 0 labels, expected 3072 bytes a label"):
        load_cifar10(tmp_path)
    assert not (tmp_path / "harm").exists()


@pytest.mark.parametrize("protocol", [0, 1, 2, 4, 5])
def test_every_way_to_write_a_batch_is_read(tmp_path, protocol):
    batch = {
        b"labels": [int(v) for v in LABELS],
        b"data": planes(IMAGES).tobytes(),
        b"filenames": [b"a.png"] * 6,
    }
    (tmp_path / "data_batch_1").write_bytes(pickle.dumps(batch, protocol=protocol))
    np.testing.assert_array_equal(load_cifar10(tmp_path).images, IMAGES)


def test_a_forged_batch_is_a_sentence(tmp_path):
    """Bytes that crash an unpickler which builds arrays: a dtype of its own making, lengths that lie."""
    whole = python2_pickle(IMAGES, LABELS)
    for forged in (
        whole.replace(b"u1", b"O8"), whole[:-1], whole[: len(whole) // 2], b"", b".",
        whole.replace(b"labels", b"labelz"),
        b"\x80\x02T\xff\xff\xff\x7fx.", b"\x80\x05\x8e" + b"\xff" * 8 + b"x.", whole.replace(b"K\x03", b"K\x63"),
    ):  # fmt: skip
        (tmp_path / "data_batch_1").write_bytes(forged)
        if forged == whole.replace(b"u1", b"O8"):
            np.testing.assert_array_equal(load_cifar10(tmp_path).images, IMAGES)  # the dtype is not asked
        else:
            with pytest.raises(InputError, match="data_batch_1: "):
                load_cifar10(tmp_path)


def test_damage_is_named(tmp_path):
    with pytest.raises(InputError, match=r"gone.tar: not there, expected cifar-10-binary.tar.gz"):
        load_cifar10(tmp_path / "gone.tar")
    (tmp_path / "data_batch_1.bin").write_bytes(b"x" * 3000)
    with pytest.raises(InputError, match=r"data_batch_1.bin: 3000 bytes, expected a multiple of 3073"):
        load_cifar10(tmp_path)
    (tmp_path / "data_batch_1.bin").write_bytes(binary(IMAGES[:1], np.array([40], np.uint8)))
    with pytest.raises(InputError, match="class 40 found, expected 0..9"):
        load_cifar10(tmp_path)
    whole = archive(
        tmp_path / "a.tar.gz", {"c/data_batch_1.bin": binary(IMAGES, LABELS)}, "w:gz"
    ).read_bytes()
    ones = whole[:40] + b"\xff" * 200 + whole[240:]
    (tmp_path / "ones.tar.gz").write_bytes(ones)
    with pytest.raises(InputError, match=r"ones.tar.gz: damaged archive"):
        load_cifar10(tmp_path / "ones.tar.gz")
    (tmp_path / "cut.tar.gz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"cut.tar.gz: damaged archive"):
        load_cifar10(tmp_path / "cut.tar.gz")


def test_folds_are_even_and_by_seed():
    labels = np.repeat(np.arange(3), (20, 31, 9))
    fold = folds(labels, 10, seed=1)
    for label in range(3):
        counts = np.bincount(fold[labels == label], minlength=10)
        assert counts.max() - counts.min() <= 1
    np.testing.assert_array_equal(fold, folds(labels, 10, seed=1))
    assert (fold != folds(labels, 10, seed=2)).any()
