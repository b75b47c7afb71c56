"""Lists and names of images in the arrangements of people's programs: each line its stamp and its file."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from sequence_files import pose, write_redwood

from dsmap.errors import InputError
from dsmap.sequences import open_sequence
from dsmap.sequences.associate import pose_vector
from dsmap.sequences.lists import read_associations, read_image_list
from dsmap.sequences.names import mixed_images, pair_by_name
from dsmap.sequences.redwood import is_redwood, read_redwood
from dsmap.sequences.tum import listed_poses

COUNT = 6
BEGIN = 1560000083.75
STAMPS = [BEGIN + k / 30 for k in range(COUNT)]


def images(
    folder: Path, name: Callable[[int], str] = lambda k: f"{STAMPS[k]:.6f}.png", of: str = "rgb"
) -> list[Path]:
    """Empty files: what a list names needs only be there."""
    (folder / of).mkdir(parents=True, exist_ok=True)
    files = [folder / of / name(k) for k in range(COUNT)]
    for file in files:
        file.touch()
    return files


ARRANGED: dict[str, Callable[[str, str, int], str]] = {
    "file first": lambda t, f, k: f"{f} {t}",
    "file first, csv": lambda t, f, k: f"{f},{t}",
    "number of the line first": lambda t, f, k: f"{k} {t} {f}",
    "number of the line first, csv": lambda t, f, k: f"{k},{t},{f}",
    "more columns": lambda t, f, k: f"{t} {f} 640 480",
    "decimal comma": lambda t, f, k: f"{t.replace('.', ',')} {f}",
    "decimal comma, semicolon": lambda t, f, k: f"{t.replace('.', ',')};{f}",
    "thousands": lambda t, f, k: f"{float(t):,.6f} {f}",
    "savetxt": lambda t, f, k: f"{float(t):.18e} {f}",
    "tabs": lambda t, f, k: f"{t}\t\t{f}   ",
    "absolute": lambda t, f, k: f"{t} /home/me/room 2/{f}",
    "decimal comma, absolute": lambda t, f, k: f"{t.replace('.', ',')} /home/me/room/{f}",
    "windows": lambda t, f, k: f"{t} C:\\Users\\me\\{f}".replace("/", "\\"),
    "dot": lambda t, f, k: f"{t} ./{f}",
    "no folder": lambda t, f, k: f"{t} {f.split('/')[1]}",
    "no suffix": lambda t, f, k: f"{t} {f.removesuffix('.png')}",
    "upper case": lambda t, f, k: f"{t} {f.upper()}",
    "microseconds": lambda t, f, k: f"{round(float(t) * 1e6)} {f}",
    "from the start, ms": lambda t, f, k: f"{(float(t) - BEGIN) * 1e3:.1f} {f}",
    "from the start, ns": lambda t, f, k: f"{round((float(t) - BEGIN) * 1e9)} {f}",
}


@pytest.mark.parametrize("name", ARRANGED)
def test_arrangements_of_a_list(name: str, tmp_path: Path):
    files = images(tmp_path)
    lines = [
        ARRANGED[name](f"{t:.6f}", f"rgb/{f.name}", k)
        for k, (t, f) in enumerate(zip(STAMPS, files, strict=True))
    ]
    (tmp_path / "rgb.txt").write_text("\n".join(lines))
    found = read_image_list(tmp_path / "rgb.txt", [])
    assert found.files == files
    assert found.times - found.times[0] == pytest.approx(np.arange(COUNT) / 30, abs=1e-4)


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("6\n", "", "heading"),
        ("my run\ntimestamp filename\n", "", "heading"),
        ("", "1560000084.0\n", "last line"),
        ("\r\n\r\n", "\r\n\r\n \r\n\t\r\n", ""),
    ],
)
def test_lines_that_say_something_else(before: str, after: str, said: str, tmp_path: Path):
    files = images(tmp_path)
    lines = [f"{t:.6f} rgb/{f.name}" for t, f in zip(STAMPS, files, strict=True)]
    (tmp_path / "rgb.txt").write_text(before + "\n".join(lines) + "\n" + after)
    notes: list[str] = []
    assert read_image_list(tmp_path / "rgb.txt", notes).files == files
    assert any(said in note for note in notes) if said else not notes


PAIRED: dict[str, Callable[[str, str, str], str]] = {
    "usual": lambda t, c, d: f"{t} {c} {t} {d}",
    "depth first": lambda t, c, d: f"{t} {d} {t} {c}",
    "csv": lambda t, c, d: f"{t},{c},{t},{d}",
    "with a pose": lambda t, c, d: f"{t} {c} {t} {d} {t} 0 0 0 0 0 0 1",
    "one stamp": lambda t, c, d: f"{t} {c} {d}",
    "no stamp": lambda t, c, d: f"{c} {d}",
    "no stamp, depth first": lambda t, c, d: f"{d} {c}",
    "files first": lambda t, c, d: f"{c} {t} {d} {t}",
}


@pytest.mark.parametrize("name", PAIRED)
def test_arrangements_of_associations(name: str, tmp_path: Path):
    colour, depth = images(tmp_path), images(tmp_path, of="depth")
    lines = [
        PAIRED[name](f"{t:.6f}", f"rgb/{c.name}", f"depth/{d.name}")
        for t, c, d in zip(STAMPS, colour, depth, strict=True)
    ]
    (tmp_path / "associations.txt").write_text("\n".join(lines))
    rgb, found = read_associations(tmp_path / "associations.txt", [])
    assert (rgb.files, found.files) == (colour, depth)
    assert np.diff(rgb.times) == pytest.approx(np.full(COUNT - 1, 1 / 30), abs=1e-4)
    assert np.array_equal(rgb.times, found.times)


WHOLE_SECONDS: dict[str, Callable[[float], str]] = {
    "padded": lambda t: f"{int(t)}_{round(t % 1 * 1e9):09d}",
    "unpadded": lambda t: f"{int(t)}-{round(t % 1 * 1e9)}",
    "microseconds": lambda t: f"{int(t)}_{round(t % 1 * 1e6):06d}",
}


@pytest.mark.parametrize("name", WHOLE_SECONDS)
def test_seconds_and_nanoseconds_in_a_name_are_one_stamp(name: str, tmp_path: Path):
    times = [1560000083.9 + k / 30 for k in range(COUNT)]  # over the end of a second
    colour = [tmp_path / f"color/{WHOLE_SECONDS[name](t)}.png" for t in times]
    depth = [tmp_path / f"depth/{WHOLE_SECONDS[name](t + 0.004)}.png" for t in times]
    pairs = pair_by_name(tmp_path, sorted(colour), sorted(depth))
    assert (pairs.colour, pairs.depth) == (colour, depth)
    assert pairs.times == pytest.approx(times, abs=1e-5)


@pytest.mark.parametrize(
    ("colour", "depth"),
    [
        (lambda k: f"frame_{k:06d}_{STAMPS[k]:.6f}", lambda k: f"frame_{k:06d}_{STAMPS[k] + 0.004:.6f}"),
        (lambda k: f"image ({k + 1})", lambda k: f"depth ({k + 1})"),
        (lambda k: f"{k + 1}", lambda k: f"{k + 1}_depth"),
        (lambda k: f"2021-05-06_14-03-{k // 2:02d}-{k % 2 * 500:03d}", None),
        (lambda k: "abcdef"[k], None),
        (lambda k: ["3f2a91", "9cd1e2", "aa01bb"][k % 3] + f"{k:x}f", None),
        (lambda k: f"{round(STAMPS[k] * 1e9)}", lambda k: f"{STAMPS[k]:.6f}"),
    ],
)
def test_names_are_paired_one_by_one(colour, depth, tmp_path: Path):
    rgb = [tmp_path / f"color/{colour(k)}.jpg" for k in range(COUNT)]
    d = [tmp_path / f"depth/{(depth or colour)(k)}.png" for k in range(COUNT)]
    pairs = pair_by_name(tmp_path, sorted(rgb), sorted(d))
    assert dict(zip(pairs.colour, pairs.depth, strict=True)) == dict(zip(rgb, d, strict=True))
    assert (np.diff(pairs.times) > 0).all()


@pytest.mark.parametrize(
    ("colour", "depth", "is_one"),
    [
        ("RGB", "DEPTH", True), ("rgb_png", "depth_png", True), ("color_frames", "depth_frames", True),
        ("camera_color_image_raw", "camera_aligned_depth_to_color_image_raw", True),
        ("rgb", "depth_vis", False), ("label", "depth", False), ("depth_image", "depth_color", False),
    ],
)  # fmt: skip
def test_folders_by_their_names(colour: str, depth: str, is_one: bool, tmp_path: Path):
    images(tmp_path, of=colour)
    images(tmp_path, of=depth)
    assert is_redwood(tmp_path) == is_one


def test_depth_that_is_aligned_goes_before_raw_depth(tmp_path: Path):
    """As OpenLORIS has both, each with a list."""
    rgb, raw, aligned = (images(tmp_path, of=name) for name in ("color", "depth", "aligned_depth"))
    for name, files in (("color", rgb), ("depth", raw), ("aligned_depth", aligned)):
        lines = (f"{t:.6f} {name}/{f.name}\n" for t, f in zip(STAMPS, files, strict=True))
        (tmp_path / f"{name}.txt").write_text("".join(lines))
    assert [entry.depth for entry in read_redwood(tmp_path).entries] == aligned
    (tmp_path / "aligned_depth.txt").unlink()
    (tmp_path / "depth.txt").unlink()
    assert [entry.depth for entry in read_redwood(tmp_path).entries] == aligned


def test_one_folder_of_both_kinds_of_images(tmp_path: Path):
    folder = write_redwood(tmp_path / "s", COUNT, trajectory=False)
    for name, new in (("image", "cam1_color"), ("depth", "cam1_depth")):
        for file in (folder / name).iterdir():
            file.rename(folder / f"{new}_{file.name}")
    (folder / ".DS_Store").touch()
    assert [len(found) for found in mixed_images(folder)] == [COUNT, COUNT]
    plain = open_sequence(
        write_redwood(tmp_path / "plain", COUNT, trajectory=False), intrinsics=(60, 60, 31, 23)
    )
    mixed = open_sequence(folder, intrinsics=(60, 60, 31, 23), depth_scale=1000)
    for a, b in zip(mixed, plain, strict=True):
        assert np.array_equal(a.rgb, b.rgb) and np.array_equal(a.depth, b.depth)


def test_what_the_system_leaves_in_folders_is_no_image(tmp_path: Path):
    folder = write_redwood(tmp_path / "s", COUNT)
    for name in (".DS_Store", "Thumbs.db", "desktop.ini", "._00001.png", ".hidden.png", "readme.txt"):
        for part in ("image", "depth", "."):
            (folder / part / name).write_bytes(b"\0\1")
    sequence = open_sequence(folder)
    assert len(list(sequence)) == COUNT and len(sequence.notes) == 1  # the camera that is assumed


def test_links_are_followed_and_a_broken_one_is_a_frame_that_is_skipped(tmp_path: Path):
    real, folder = write_redwood(tmp_path / "real", COUNT), tmp_path / "s"
    folder.mkdir()
    (folder / "image").symlink_to(real / "image")
    (folder / "depth").mkdir()
    for file in (real / "depth").iterdir():
        (folder / "depth" / file.name).symlink_to(file)
    (real / "depth" / "00003.png").unlink()
    sequence = open_sequence(folder)
    assert [frame.index for frame in sequence] == [0, 1, 2, 4, 5] and len(sequence.skipped) == 1


def numbers(values: np.ndarray) -> str:
    return " ".join(f"{v:.9f}" for v in values.ravel())


MATRICES: dict[str, Callable[[float, np.ndarray], str]] = {
    "3x4 without stamps": lambda t, T: numbers(T[:3]),
    "4x4 without stamps": lambda t, T: numbers(T),
    "stamp and 3x4": lambda t, T: f"{t:.6f} {numbers(T[:3])}",
    "stamp and 4x4": lambda t, T: f"{t:.6f} {numbers(T)}",
    "more columns": lambda t, T: f"{t:.6f} {numbers(pose_vector(T))} 7 good",
}


@pytest.mark.parametrize("name", MATRICES)
def test_poses_as_matrices(name: str, tmp_path: Path):
    lines = [MATRICES[name](t, pose(k)) for k, t in enumerate(STAMPS)]
    (tmp_path / "groundtruth.txt").write_text("\n".join(lines))
    for k, T in enumerate(listed_poses(tmp_path / "groundtruth.txt", np.array(STAMPS), [])):
        assert pytest.approx(pose(k), abs=1e-5) == T


def test_poses_without_stamps_of_another_number_of_frames_are_not_used(tmp_path: Path):
    (tmp_path / "groundtruth.txt").write_text("\n".join(numbers(pose(k)[:3]) for k in range(4)))
    notes: list[str] = []
    assert listed_poses(tmp_path / "groundtruth.txt", np.array(STAMPS), notes) == [None] * COUNT
    assert "holds 4 without stamps for 6 frames" in notes[0]


def test_the_recording_inside_a_folder_is_named(tmp_path: Path):
    write_redwood(tmp_path / "outer" / "inner")
    with pytest.raises(InputError, match="inner is a recording"):
        open_sequence(tmp_path / "outer")
