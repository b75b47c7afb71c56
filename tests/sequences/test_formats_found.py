"""How a recording is found: in archives, in folders that hold one, in capital letters, without a library."""

import builtins
import io
import shutil
import sys
import tarfile
import zipfile
from pathlib import Path

import format_exporters as formats
import numpy as np
import pytest
import sequence_files
from format_cases import CASES, written
from recording_shots import COUNT

from dsmap.errors import InputError
from dsmap.sequences import open_sequence


@pytest.mark.parametrize("kind", ["zip", "gztar"])
@pytest.mark.parametrize("name", ["realsense", "record3d", "scannet", "tum"])
def test_archives_of_a_recording(kind: str, name: str, tmp_path: Path):
    folder = tmp_path / "room"
    if name == "tum":
        sequence_files.write_tum(folder)
    else:
        written(CASES[name], folder)
    archive = formats.zipped(folder, kind)
    shutil.rmtree(folder)
    sequence = open_sequence(archive)
    assert sequence.layout == ("tum" if name == "tum" else CASES[name].reader)
    assert len(list(sequence)) == len(sequence) > 0


@pytest.mark.parametrize(
    "name", ["../out.txt", "/tmp/out.txt", "a/../../out.txt", "..\\out.txt", "C:/out.txt"]
)
def test_no_file_of_an_archive_leaves_its_folder(name: str, tmp_path: Path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr(name, "x")
    with tarfile.open(tmp_path / "a.tgz", "w:gz") as archive:
        member = tarfile.TarInfo(name)
        archive.addfile(member, io.BytesIO(b""))
    for file in ("a.zip", "a.tgz"):
        with pytest.raises(InputError, match="expected names inside one folder"):
            open_sequence(tmp_path / file)


def test_links_and_bombs_in_archives_are_refused(tmp_path: Path):
    with tarfile.open(tmp_path / "link.tar", "w") as archive:
        link = tarfile.TarInfo("room/rgb.txt")
        link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
        archive.addfile(link)
    with pytest.raises(InputError, match="a link or a device"):
        open_sequence(tmp_path / "link.tar")
    huge = tarfile.TarInfo("room/huge.bin")
    huge.size = 1 << 60
    (tmp_path / "huge.tar").write_bytes(huge.tobuf(tarfile.GNU_FORMAT) + b"\0" * 1024)
    with pytest.raises(InputError, match="has room for|cannot be unpacked"):
        open_sequence(tmp_path / "huge.tar")
    (tmp_path / "cut.zip").write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(InputError, match="cannot be unpacked"):
        open_sequence(tmp_path / "cut.zip")


@pytest.mark.parametrize(
    ("name", "package"), [("ros1", "rosbags"), ("record3d", "liblzfse"), ("stray-scanner", "av")]
)
def test_a_missing_library_names_the_extra(name: str, package: str, tmp_path: Path, monkeypatch):
    path = written(CASES[name], tmp_path / "recording")
    real = builtins.__import__

    def without(module: str, *args, **kwargs):
        if module.split(".")[0] == package:
            raise ImportError(module)
        return real(module, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    for module in [m for m in sys.modules if m.split(".")[0] == package]:
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=r"dsmap\[recordings\]"):
        open_sequence(path)


@pytest.mark.parametrize(
    "name", ["realsense", "ros2-mcap-file", "scannet-sens", "klg", "record3d", "azure-kinect"]
)
def test_a_folder_that_holds_one_file_of_a_recording_is_that_recording(name: str, tmp_path: Path):
    path = written(CASES[name], tmp_path / "recording")
    (path.parent / "metadata.yaml").unlink(missing_ok=True)  # a ROS 2 bag of several parts has one
    (path.parent / "readme.txt").write_text("scanned by hand\n")
    (path.parent / "._room.bag").write_bytes(b"of a Mac")
    (path.parent / "notes").mkdir()
    alone, within = open_sequence(path), open_sequence(path.parent)
    assert len(within) == len(alone) and within.intrinsics == alone.intrinsics
    said = any(path.name in note and "only recording" in note for note in within.notes)
    assert said or within.layout in ("ros", "realsense"), "a folder of parts of a bag is a bag"
    shutil.copy(path, path.with_name("second" + path.suffix))
    with pytest.raises(InputError, match=r"is a recording"):
        open_sequence(path.parent)


def test_a_folder_that_holds_an_archive_is_that_archive(tmp_path: Path):
    sequence_files.write_tum(tmp_path / "in" / "room")
    (tmp_path / "out").mkdir()
    shutil.make_archive(str(tmp_path / "out" / "room"), "zip", tmp_path / "in")
    assert len(open_sequence(tmp_path / "out")) == len(open_sequence(tmp_path / "in" / "room"))


def test_names_of_a_format_in_capital_letters(tmp_path: Path):
    path = written(CASES["stray-scanner"], tmp_path / "recording")
    expected = open_sequence(path)
    frame = expected.frame(3)
    for child in list(path.iterdir()):
        child.rename(child.with_name(child.name.upper()))
    found = open_sequence(path)
    assert found.layout == "stray-scanner" and len(found) == len(expected)
    assert found.intrinsics == expected.intrinsics and found.has_poses
    np.testing.assert_array_equal(found.frame(3).rgb, frame.rgb)
    np.testing.assert_array_equal(found.frame(3).depth, frame.depth)


@pytest.mark.parametrize(
    "name", ["realsense", "ros2-mcap-file", "scannet-sens", "klg", "record3d", "azure-kinect"]
)
def test_suffixes_in_capital_letters(name: str, tmp_path: Path):
    path = written(CASES[name], tmp_path / "recording")
    loud = path.rename(path.with_suffix(path.suffix.upper()))
    assert len(list(open_sequence(loud))) == COUNT
