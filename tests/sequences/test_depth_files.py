"""Depth in every kind of file, colour in every kind, and depth at another size."""

import io
from pathlib import Path

import cv2
import numpy as np
import pytest
from sequence_files import colour, depth, write_redwood, write_seven_scenes, write_tum

from dsmap.errors import InputError
from dsmap.sequences import open_sequence
from dsmap.sequences.images import resize_depth, resize_nearest

MILLIMETRES = np.rint(depth(0) * 1000).astype(np.uint16)


def saved(array: np.ndarray, **named: np.ndarray) -> bytes:
    file = io.BytesIO()
    if named:
        np.savez(file, **named)  # type: ignore[arg-type]
    else:
        np.save(file, array)
    return file.getvalue()


def exr(path: Path, channels: dict[str, np.ndarray]) -> None:
    library = pytest.importorskip("OpenEXR")
    header = {"compression": library.ZIP_COMPRESSION, "type": library.scanlineimage}
    library.File(header, channels).write(str(path))


def in_folder(tmp_path: Path, suffix: str) -> list[Path]:
    """A Redwood recording whose depth files have another suffix, empty still."""
    folder = write_redwood(tmp_path / "s")
    files = sorted((folder / "depth").iterdir())
    return [file.rename(file.with_suffix(suffix)) for file in files]


def as_tiff(array: np.ndarray) -> bytes:
    return cv2.imencode(".tiff", array)[1].tobytes()


FILES = {
    "int32.tiff": as_tiff(MILLIMETRES.astype(np.int32)),
    "float32.tiff": as_tiff(depth(0)),
    "float64.tiff": as_tiff(depth(0).astype(np.float64)),
    "three.tiff": as_tiff(np.dstack([depth(0)] * 3)),
    "millimetres.tiff": as_tiff(MILLIMETRES.astype(np.float32)),
    "uint16.npy": saved(MILLIMETRES),
    "int64.npy": saved(MILLIMETRES.astype(np.int64)),
    "float16.npy": saved(depth(0).astype(np.float16)),
    "float64.npy": saved(depth(0).astype(np.float64)[..., None]),
    "float32.npz": saved(depth(0), conf=np.ones((48, 64), np.uint8), depth=depth(0)),
    "uint16.pgm": cv2.imencode(".pgm", MILLIMETRES)[1].tobytes(),
}


@pytest.mark.parametrize("name", FILES)
def test_depth_in_every_kind_of_file(name: str, tmp_path: Path):
    for file in in_folder(tmp_path, Path(name).suffix):
        file.write_bytes(FILES[name])
    sequence = open_sequence(tmp_path / "s")
    assert sequence.frame(1).depth == pytest.approx(depth(0), abs=1e-3 if name == "float16.npy" else 1e-6)
    floats = name.startswith(("float", "three"))
    assert any("in metres" in note for note in sequence.notes) == floats


@pytest.mark.parametrize("channel", ["Z", "Y", "R", "RGB"])
def test_depth_in_exr(channel: str, tmp_path: Path):
    for file in in_folder(tmp_path, ".exr"):
        exr(file, {channel: np.dstack([depth(0)] * 3) if channel == "RGB" else depth(0)})
    sequence = open_sequence(tmp_path / "s")
    assert np.array_equal(sequence.frame(2).depth, depth(0))
    file.write_bytes(file.read_bytes()[:200])
    with pytest.raises(InputError, match="EXR image that does not decode"):
        sequence.frame(3)


def test_a_scale_that_is_stated_goes_before_what_floats_look_like(tmp_path: Path):
    for file in in_folder(tmp_path, ".tiff"):
        file.write_bytes(as_tiff(depth(0) * 10))
    assert open_sequence(tmp_path / "s", depth_scale=10).frame(0).depth == pytest.approx(depth(0), abs=1e-6)


@pytest.mark.parametrize(
    "data", [saved(np.zeros(5)), saved(np.array(["a"])), b"\x93NUMPY broken", b"PK\x03\x04 broken"]
)
def test_arrays_that_are_no_depth(data: bytes, tmp_path: Path):
    for k, file in enumerate(in_folder(tmp_path, ".npy")):
        file.write_bytes(data if k == 1 else FILES["uint16.npy"])
    sequence = open_sequence(tmp_path / "s")
    assert len(list(sequence)) == 3 and [i for i, _ in sequence.skipped] == [1]


@pytest.mark.parametrize("shape", [(48, 64), (48, 64, 3)])
def test_drawings_of_depth_are_refused_once(shape: tuple[int, ...], tmp_path: Path):
    folder = write_tum(tmp_path / "s")
    for file in (folder / "depth").iterdir():
        cv2.imwrite(str(file), np.full(shape, 100, np.uint8))
    with pytest.raises(InputError, match="uint8 here and in the other depth images"):
        open_sequence(folder)


@pytest.mark.parametrize("suffix", [".bmp", ".ppm", ".webp", ".tiff", ".JPG"])
@pytest.mark.parametrize("layout", ["tum", "7-scenes", "redwood"])
def test_colour_in_every_kind_of_file(suffix: str, layout: str, tmp_path: Path):
    folder = {"tum": write_tum, "7-scenes": write_seven_scenes, "redwood": write_redwood}[layout](
        tmp_path / "s"
    )
    files = [f for f in folder.rglob("*.png") if "depth" not in str(f.relative_to(folder))]
    for file in files:
        image = cv2.imread(str(file))
        file.unlink()
        options = [cv2.IMWRITE_WEBP_QUALITY, 101] if suffix == ".webp" else []
        file.with_suffix(suffix).write_bytes(cv2.imencode(suffix.lower(), image, options)[1].tobytes())
    if layout == "tum":
        (folder / "rgb.txt").write_text((folder / "rgb.txt").read_text().replace(".png", suffix))
    sequence = open_sequence(folder)
    assert len(list(sequence)) == len(files)
    if suffix != ".JPG" and layout != "7-scenes":  # its colour is brought to the depth camera
        assert np.array_equal(sequence.frame(1).rgb, colour(1))


@pytest.mark.parametrize("size", [(24, 18), (16, 12), (21, 16), (48, 36), (13, 9)])
def test_a_smaller_size_takes_the_valid_depth_in_the_cell(size: tuple[int, int]):
    rng = np.random.default_rng(3)
    full = rng.integers(1, 4000, (36, 48)).astype(np.float32)
    sparse = np.where(rng.random(full.shape) < 0.11, full, 0).astype(np.float32)
    assert np.array_equal(resize_depth(full, *size), resize_nearest(full, *size))
    found, under_centre = resize_depth(sparse, *size), resize_nearest(sparse, *size)
    row_of, column_of = ((2 * np.arange(n) + 1) * m // (2 * n) for n, m in ((36, size[1]), (48, size[0])))
    for y in range(size[1]):
        for x in range(size[0]):
            cell = sparse[np.ix_(row_of == y, column_of == x)]
            if under_centre[y, x]:
                assert found[y, x] == under_centre[y, x]
            else:
                assert found[y, x] in cell[cell > 0] if cell.any() else found[y, x] == 0


def test_turned_depth_in_plain_folders_is_turned_back_and_said(tmp_path: Path):
    plain, folder = write_redwood(tmp_path / "plain"), write_redwood(tmp_path / "s")
    for file in (plain / "depth").iterdir():
        stored = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        stored[5, 5] = 9001  # beyond 8 m, where bits come in from above
        cv2.imwrite(str(file), stored)
        cv2.imwrite(str(folder / "depth" / file.name), (stored << 3) | (stored >> 13))
    sequence = open_sequence(folder)
    assert any("turned by three bits" in note for note in sequence.notes)
    expected = open_sequence(plain).frame(1).depth
    assert expected[5, 5] == pytest.approx(9.001) and np.array_equal(sequence.frame(1).depth, expected)
    assert open_sequence(folder, depth_scale=8000).frame(1).depth[8, 8] == pytest.approx(expected[8, 8])
