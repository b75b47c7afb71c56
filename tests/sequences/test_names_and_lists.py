"""Images named and listed as people's programs do it: pairs, stamps, poses, and what is said of the rest."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from sequence_files import pose, write_redwood, write_tum

from dsmap.errors import InputError
from dsmap.sequences import open_sequence
from dsmap.sequences.associate import pose_vector
from dsmap.sequences.stamps import unit_of

COUNT = 6
START = 1560000083.949189
CALIBRATION = "{width: 64, height: 48, fx: 60, fy: 60, cx: 31.5, cy: 23.5, depth_scale: 1000}"


def renamed(
    folder: Path, colour: Callable[[int], str], depth: Callable[[int], str], name: str = "image"
) -> Path:
    """A recording of numbered folders whose images have other names."""
    write_redwood(folder, frames=COUNT, trajectory=False)
    for part, new in (("image", colour), ("depth", depth)):
        for k, file in enumerate(sorted((folder / part).iterdir())):
            file.rename(file.with_name(new(k) + file.suffix))
    if name != "image":
        (folder / "image").rename(folder / name)
    (folder / "calibration.yaml").write_text(CALIBRATION)
    return folder


def seconds(k: int, late: float = 0.0) -> str:
    return f"{START + k / 30 + late:.6f}"


NAMES: dict[str, tuple[Callable[[int], str], Callable[[int], str]]] = {
    "stamps": (seconds, lambda k: seconds(k, 0.004)),
    "camera's name": (lambda k: f"d435_color_{k:06d}", lambda k: f"d435_depth_{k:06d}"),
    "rs-convert": (
        lambda k: f"room2_Color_{1554370821372.4165 + k * 33.37:.10f}",
        lambda k: f"room2_Depth_{1554370821372.4165 + k * 33.37:.10f}",
    ),
    "date": (lambda k: f"2021-05-06_{k:06d}", lambda k: f"2021-05-06_{k:06d}"),
    "unpadded": (lambda k: f"frame{k + 7}", lambda k: f"frame{k + 7}"),
    "nanoseconds": (lambda k: str(int(1.56e18) + k * 33333333), lambda k: str(int(1.56e18) + k * 33333333)),
}  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("folder", ["image", "color", "rgb"])
def test_names_of_other_programs(name: str, folder: str, tmp_path: Path):
    write_redwood(tmp_path / "plain", frames=COUNT, trajectory=False)
    (tmp_path / "plain" / "calibration.yaml").write_text(CALIBRATION)
    plain, sequence = (
        open_sequence(tmp_path / "plain"),
        open_sequence(renamed(tmp_path / "s", *NAMES[name], folder)),
    )
    assert len(sequence) == COUNT
    steps = np.diff(sequence.times)
    assert steps == pytest.approx(np.full(COUNT - 1, 1 / 30), abs=1e-4)
    for a, b in zip(sequence, plain, strict=True):
        assert np.array_equal(a.rgb, b.rgb) and np.array_equal(a.depth, b.depth)


def test_second_files_of_a_number_are_named(tmp_path: Path):
    folder = renamed(tmp_path / "s", lambda k: f"{k:05d}", lambda k: f"{k:05d}")
    for file in sorted((folder / "depth").iterdir()):
        shutil.copy(file, file.with_name(f"{file.stem}_vis.png"))
    shutil.copy(folder / "image" / "00002.png", folder / "image" / "2.png")
    sequence = open_sequence(folder)
    assert len(sequence) == COUNT
    assert any("_vis.png" in note for note in sequence.notes)
    assert any("second ones of their number" in note for note in sequence.notes)


def test_images_of_no_common_name_are_refused(tmp_path: Path):
    folder = renamed(tmp_path / "s", lambda k: f"{k:05d}", lambda k: f"{k + 500:05d}")
    with pytest.raises(InputError, match="no common number"):
        open_sequence(folder)


@pytest.mark.parametrize("file", ["associations.txt", "color.txt"])
def test_other_lists(file: str, tmp_path: Path):
    folder = renamed(tmp_path / "s", seconds, lambda k: seconds(k, 0.004), "color")
    rgb = [f"{seconds(k)} color/{seconds(k)}.png" for k in range(COUNT)]
    depth = [f"{seconds(k, 0.004)} depth/{seconds(k, 0.004)}.png" for k in range(COUNT)]
    if file == "associations.txt":
        (folder / file).write_text(
            "".join(f"{d} {c}\n" for c, d in zip(rgb, depth, strict=True))
        )  # depth first
    else:
        (folder / file).write_text("\n".join(rgb))
        (folder / "depth.txt").write_text("\n".join(depth))
    (folder / "groundtruth.txt").write_text(
        "\n".join(f"{seconds(k)} " + " ".join(f"{v:.9f}" for v in pose_vector(pose(k))) for k in range(COUNT))
    )
    sequence = open_sequence(folder)
    assert len(sequence) == COUNT and sequence.frame(0).rgb.shape == (48, 64, 3)
    assert sequence.entries[0].pose_time == pytest.approx(START + 0.004)
    assert sequence.has_poses


ENCODINGS: dict[str, Callable[[str], bytes]] = {
    "mark": lambda text: b"\xef\xbb\xbf" + text.encode(),
    "utf-16": lambda text: text.encode("utf-16"),
    "latin-1": lambda text: ("# caf\xe9\n" + text).encode("latin-1"),
    "backslashes": lambda text: text.replace("/", "\\").encode(),
    "windows lines": lambda text: text.replace("\n", "\r\n").encode(),
    "semicolons": lambda text: text.replace(" ", ";").encode(),
    "heading": lambda text: ("timestamp,filename\n" + text).encode(),
    "quotes": lambda text: "".join('{} "{}"\n'.format(*line.split()) for line in text.splitlines()).encode(),
}  # fmt: skip


@pytest.mark.parametrize("name", ENCODINGS)
def test_text_files_of_other_programs(name: str, tmp_path: Path):
    folder = write_tum(tmp_path / "s")
    for file in ("rgb.txt", "depth.txt"):
        text = "".join(
            line + "\n" for line in (folder / file).read_text().splitlines() if not line.startswith("#")
        )
        (folder / file).write_bytes(ENCODINGS[name](text))
    assert len(list(open_sequence(folder))) == 6


def test_names_with_spaces(tmp_path: Path):
    folder = write_tum(tmp_path / "s")
    (folder / "rgb").rename(folder / "my images")
    (folder / "rgb.txt").write_text((folder / "rgb.txt").read_text().replace(" rgb/", " my images/"))
    assert len(list(open_sequence(folder))) == 6


def test_a_pose_that_is_none_is_left_out_and_said(tmp_path: Path):
    folder = write_tum(tmp_path / "s")
    lines = (folder / "groundtruth.txt").read_text().splitlines()
    lines[3] = lines[3].split()[0] + " nan nan nan nan nan nan nan"
    (folder / "groundtruth.txt").write_text("timestamp tx ty tz qx qy qz qw\n" + "\n".join(lines))
    sequence = open_sequence(folder)
    assert sum(e.T_world_camera is not None for e in sequence.entries) == 5
    assert any("hold no pose" in note for note in sequence.notes)


def test_a_heading_that_puts_qw_first_is_followed(tmp_path: Path):
    folder = write_tum(tmp_path / "s")
    expected = [e.T_world_camera for e in open_sequence(folder).entries]
    rows = [line.split() for line in (folder / "groundtruth.txt").read_text().splitlines() if line[0] != "#"]
    swapped = [" ".join([*r[:4], r[7], *r[4:7]]) for r in rows]
    (folder / "groundtruth.txt").write_text("# timestamp tx ty tz qw qx qy qz\n" + "\n".join(swapped))
    for e, T in zip(open_sequence(folder).entries, expected, strict=True):
        assert e.T_world_camera == pytest.approx(T)


@pytest.mark.parametrize(
    ("words", "unit"),
    [
        (["0", "1", "2"], "frame numbers"), (["10", "20", "30", "40"], "frame numbers"),
        (["0.000000", "0.033333"], "seconds"), (["1305031102.175304", "1305031102.21"], "seconds"),
        (["1305031102175", "1305031102208"], "milliseconds"), (["0", "33", "66"], "milliseconds"),
        (["1305031102175304", "1305031102208637"], "microseconds"),
        (["1305031102175304000", "1305031102208637000"], "nanoseconds"),
    ],
)  # fmt: skip
def test_the_unit_of_stamps(words: list[str], unit: str):
    assert unit_of(words).name == unit
