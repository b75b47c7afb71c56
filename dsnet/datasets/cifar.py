"""CIFAR-10: the official archives (binary and python version), or images in one folder a class."""

import pickletools
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from dsmap.errors import InputError
from dsmap.reading import DECODER_ERRORS

CIFAR_CLASSES = ("airplane", "automobile", "bird", "cat", "deer", "dog", "frog", "horse", "ship", "truck")
_DOWNLOAD = "cifar-10-binary.tar.gz or cifar-10-python.tar.gz of the CIFAR-10 page, or train/<class>/*.jpg"
_RECORD = 1 + 3072
"""Bytes of an image in the binary version: its label, then the red, green and blue planes."""
_IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png")
_MOST_BYTES = 1 << 26
"""Of one file of an archive: twice an official batch."""
_NUMBERS = ("BININT", "BININT1", "BININT2", "INT", "LONG1")
_OF_A_LIST = (
    "EMPTY_LIST", "MARK", "APPEND", "APPENDS", "PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE", "FRAME",
    "GET", "BINGET", "LONG_BINGET", "TUPLE", "TUPLE2", "REDUCE", "LIST",
)  # fmt: skip
"""What stands in a pickle between a key, its list, and the list's numbers; some write a key as encoded latin1."""


@dataclass(frozen=True)
class ClassifiedImages:
    """Small images with one class each."""

    images: np.ndarray
    """RGB, uint8, shape (N, 32, 32, 3)."""
    labels: np.ndarray
    """0..9 in the order of `CIFAR_CLASSES`, uint8, shape (N,)."""

    def __len__(self) -> int:
        return len(self.labels)

    def take(self, chosen: np.ndarray) -> "ClassifiedImages":
        """Some of them, by position."""
        return ClassifiedImages(self.images[chosen], self.labels[chosen])


def load_cifar10(path: Path | str, split: str = "train") -> ClassifiedImages:
    """CIFAR-10 from an archive (.tar, .tar.gz, .tar.xz) or a folder of the same content.

    Args:
        split: `train` or `test`.

    Raises:
        InputError: nothing there, nothing of CIFAR-10 in it, or damaged files.
    """
    path = Path(path)
    if split not in ("train", "test"):
        raise InputError(f"{path}: split is {split!r}, expected train or test")
    parts, pictures = [], []
    for name, content in _files(path):
        words = name.split("/")
        stem = words[-1].removesuffix(".bin")
        if stem.startswith("data_batch_" if split == "train" else "test_batch"):
            part = _binary(content, name) if name.endswith(".bin") else _python(content, name)
            parts.append((stem, part))
        elif len(words) > 2 and words[-3] == split and words[-2] in CIFAR_CLASSES:
            pictures.append((name, _picture(content, name), CIFAR_CLASSES.index(words[-2])))
    if pictures:
        pictures.sort(key=lambda picture: picture[0])
        images = np.stack([image for _, image, _ in pictures])
        return ClassifiedImages(images, np.array([label for *_, label in pictures], np.uint8))
    if not parts:
        raise InputError(f"{path}: no image of CIFAR-10's {split} set in it, expected {_DOWNLOAD}")
    parts.sort(key=lambda part: part[0])
    return ClassifiedImages(
        np.concatenate([part.images for _, part in parts]), np.concatenate([part.labels for _, part in parts])
    )


def folds(labels: np.ndarray, count: int, seed: int = 0) -> np.ndarray:
    """The fold of each image, 0 .. count - 1, shape (N,): random, every class spread evenly."""
    rng = np.random.default_rng(seed)
    fold = np.zeros(len(labels), np.int64)
    for label in np.unique(labels):
        members = rng.permutation(np.flatnonzero(labels == label))
        fold[members] = np.arange(len(members)) % count
    return fold


def _files(path: Path) -> Iterator[tuple[str, bytes]]:
    """Name with folders, and content, of every file that may be of interest."""
    if path.is_dir():
        for file in sorted(path.rglob("*")):
            name = file.relative_to(path.parent).as_posix()
            if file.is_file() and _is_of_interest(name):
                if file.stat().st_size > _MOST_BYTES:
                    raise _too_large(name)
                yield name, file.read_bytes()
        return
    if not path.is_file():
        raise InputError(f"{path}: not there, expected {_DOWNLOAD}")
    try:
        with tarfile.open(path) as archive:
            for member in archive:
                stream = archive.extractfile(member) if _is_of_interest(member.name) else None
                if stream is None:
                    continue
                content = stream.read(_MOST_BYTES + 1)
                if len(content) > _MOST_BYTES:
                    raise _too_large(member.name)
                yield member.name, content
    except (*DECODER_ERRORS, tarfile.TarError) as error:
        raise InputError(f"{path}: damaged archive ({error}), expected {_DOWNLOAD}") from error


def _too_large(name: str) -> InputError:
    return InputError(f"{name}: more than {_MOST_BYTES >> 20} MiB, expected a batch or an image of CIFAR-10")


def _is_of_interest(name: str) -> bool:
    return "_batch" in name.rpartition("/")[2] or name.endswith(_IMAGE_SUFFIXES)


def _binary(data: bytes, name: str) -> ClassifiedImages:
    if not data or len(data) % _RECORD:
        raise InputError(
            f"{name}: {len(data)} bytes, expected a multiple of {_RECORD} as in CIFAR-10's .bin files"
        )
    records = np.frombuffer(data, np.uint8).reshape(-1, _RECORD)
    return _checked(records[:, 1:], records[:, 0], name)


def _python(data: bytes, name: str) -> ClassifiedImages:
    """A batch of the python version. Its pickle is read for two fields as text is; nothing in it is carried out.

    It holds one byte string of whole images, and after the key `labels` a list of as many small numbers.
    """
    pixels, labels = b"", [-1]
    collecting = ended = False
    try:
        for code, value, _ in pickletools.genops(data):
            if isinstance(value, str | bytes):
                text = value.encode("latin-1") if isinstance(value, str) else value
                pixels = max(pixels, text, key=len)
                if text == b"labels":
                    collecting, labels = True, []
                elif text != b"latin1":
                    collecting = False
            elif collecting and code.name in _NUMBERS:
                labels.append(int(value))  # type: ignore[arg-type]  # the opcode of a number has one
            elif code.name not in _OF_A_LIST:
                collecting = False
            ended = code.name == "STOP"
    except (ValueError, OverflowError, UnicodeEncodeError, IndexError) as error:
        raise InputError(f"{name}: no batch of CIFAR-10's python version ({error})") from error
    if not ended or not labels or len(pixels) != len(labels) * (_RECORD - 1):
        raise InputError(
            f"{name}: found {len(pixels)} bytes of pixels and {len(labels)} labels, expected 3072 bytes a label as in "
            "a batch of CIFAR-10's python version"
        )
    return _checked(np.frombuffer(pixels, np.uint8).reshape(len(labels), -1), np.array(labels), name)


def _checked(planes: np.ndarray, labels: np.ndarray, name: str) -> ClassifiedImages:
    if labels.min() < 0 or labels.max() >= len(CIFAR_CLASSES):
        raise InputError(f"{name}: class {labels.max()} found, expected 0..{len(CIFAR_CLASSES) - 1}")
    images = np.ascontiguousarray(planes.reshape(-1, 3, 32, 32).transpose(0, 2, 3, 1))
    return ClassifiedImages(images, labels.astype(np.uint8))


def _picture(data: bytes, name: str) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None or image.shape != (32, 32, 3):
        found = "nothing that decodes" if image is None else f"{image.shape[1]}x{image.shape[0]}"
        raise InputError(f"{name}: {found}, expected an image of 32x32")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
