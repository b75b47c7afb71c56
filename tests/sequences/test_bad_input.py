"""Bad recordings: each a clear error, or a frame that is skipped and counted."""

import struct
import zlib

import cv2
import numpy as np
import pytest
from sequence_files import CAMERA, colour, depth, write_redwood, write_seven_scenes, write_tum

from dsmap.errors import InputError
from dsmap.sequences import SequenceWriter, open_sequence
from dsmap.sequences.images import clean_depth
from dsmap.sequences.mesh import read_mesh


def depth_file(folder, number):
    return sorted((folder / "depth").iterdir())[number]


def rgb_file(folder, number):
    return sorted((folder / "rgb").iterdir())[number]


def skips_frame_two(folder, *words):
    """Frame 2 raises with all words in its message; iterating leaves it out and says so."""
    sequence = open_sequence(folder)
    with pytest.raises(InputError) as error:
        sequence.frame(2)
    for word in words:
        assert word in str(error.value)
    assert [frame.index for frame in sequence] == [0, 1, 3, 4, 5]
    assert [index for index, _ in sequence.skipped] == [2]
    assert sequence.skipped[0][1] == str(error.value)


def test_truncated_png(tmp_path):
    file = depth_file(write_tum(tmp_path / "s"), 2)
    file.write_bytes(file.read_bytes()[:-100])
    skips_frame_two(tmp_path / "s", file.name, "whole image")


def test_truncated_jpeg(tmp_path):
    folder = write_tum(tmp_path / "s")
    file = rgb_file(folder, 2)
    _, data = cv2.imencode(".jpg", colour(2))
    file.write_bytes(data.tobytes()[:-50])
    skips_frame_two(folder, file.name, "whole image")


def test_garbage_and_empty_images(tmp_path):
    folder = write_tum(tmp_path / "s")
    rgb_file(folder, 2).write_bytes(b"not an image at all")
    skips_frame_two(folder, rgb_file(folder, 2).name, "decode")
    rgb_file(folder, 2).write_bytes(b"")
    skips_frame_two(folder, rgb_file(folder, 2).name, "0 bytes")


def test_animated_png(tmp_path):
    """OpenCV shows something else than the image where a part promises frames that are not there."""
    file = rgb_file(write_tum(tmp_path / "s"), 2)
    data, body = file.read_bytes(), b"acTL" + struct.pack(">II", 2**31 - 1, 0)
    file.write_bytes(
        data[:33] + struct.pack(">I", 8) + body + struct.pack(">I", zlib.crc32(body)) + data[33:]
    )
    skips_frame_two(tmp_path / "s", file.name, "animated")


def test_missing_image(tmp_path):
    folder = write_tum(tmp_path / "s")
    file = rgb_file(folder, 2)
    file.unlink()
    skips_frame_two(folder, file.name, "cannot be read")


def test_depth_of_the_wrong_size(tmp_path):
    folder = write_tum(tmp_path / "s")
    file = depth_file(folder, 2)
    cv2.imwrite(str(file), np.full((24, 32), 1000, np.uint16))
    skips_frame_two(folder, file.name, "32x24", "64x48")


def test_all_zero_depth(tmp_path):
    folder = write_tum(tmp_path / "s")
    file = depth_file(folder, 2)
    cv2.imwrite(str(file), np.zeros((48, 64), np.uint16))
    skips_frame_two(folder, file.name, "no valid depth")


def test_eight_bit_depth(tmp_path):
    folder = write_tum(tmp_path / "s")
    cv2.imwrite(str(depth_file(folder, 2)), np.full((48, 64), 100, np.uint8))
    skips_frame_two(folder, "uint8", "16-bit")


def test_colour_where_labels_should_be(tmp_path):
    folder = write_tum(tmp_path / "s", labels=True)
    cv2.imwrite(str(sorted((folder / "label").iterdir())[2]), colour(2))
    sequence = open_sequence(folder)
    assert len(list(sequence)) == 6 and not sequence.has_labels
    assert any("found the colours" in note for note in sequence.notes)


def test_nan_infinite_and_negative_depth_is_no_measurement():
    np.testing.assert_array_equal(
        clean_depth(np.array([np.nan, np.inf, -np.inf, -1, 2.5])), [0, 0, 0, 0, 2.5]
    )
    assert not clean_depth(np.full((4, 4), np.nan)).any()


def test_empty_folder_and_no_folder(tmp_path):
    with pytest.raises(InputError, match=r"rgb\.txt.*frame-\*.*found an empty folder"):
        open_sequence(tmp_path)
    with pytest.raises(InputError, match="found nothing"):
        open_sequence(tmp_path / "nowhere")
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="found a file"):
        open_sequence(tmp_path / "file")


def test_a_folder_of_something_else_names_what_it_holds(tmp_path):
    (tmp_path / "seq-01").mkdir()
    with pytest.raises(InputError, match="found seq-01/"):
        open_sequence(tmp_path)


def test_missing_calibration_says_what_to_write_or_give(tmp_path):
    folder = write_tum(tmp_path / "mine")
    (folder / "calibration.yaml").unlink()
    with pytest.raises(InputError, match=r"calibration\.yaml.*--intrinsics.*--depth-scale"):
        open_sequence(folder)
    with pytest.raises(InputError, match=r"depth_scale\) or give --depth-scale"):
        open_sequence(folder, intrinsics=(60, 60, 31.5, 23.5))
    sequence = open_sequence(folder, intrinsics=(60, 60, 31.5, 23.5), depth_scale=1000)
    assert sequence.intrinsics == CAMERA


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("width: 64\nheight: 48\nfx: -3\nfy: 60\ncx: 1\ncy: 1\ndepth_scale: 5", "found -3 for fx"),
        ("width: 64\nheight: 48\nfx: 60\nfy: 60\ncx: 1\ncy: 1", "found nothing for depth_scale"),
        ("width: 64\nheight: 48\nfx: 60\nfy: sixty\ncx: 1\ncy: 1\ndepth_scale: 5", "'sixty' for fy"),
        ("width: 32\nheight: 24\nfx: 60\nfy: 60\ncx: 1\ncy: 1\ndepth_scale: 5", "32x24"),
        (
            "width: 64\nheight: 48\nfx: 6\nfy: 6\ncx: 1\ncy: 1\ndepth_scale: 5\npixel_center: odd",
            "integer or half",
        ),
        (
            "width: 64\nheight: 48\nfx: 6\nfy: 6\ncx: 1\ncy: 1\ndepth_scale: 5\ndistortion: {model: fish}",
            "radtan",
        ),
        ("- 1\n- 2", "list"),
        ("a: [", "YAML"),
    ],
)
def test_damaged_calibration(tmp_path, text, words):
    folder = write_tum(tmp_path / "s")
    (folder / "calibration.yaml").write_text(text)
    with pytest.raises(InputError, match="calibration.yaml") as error:
        open_sequence(folder)
    assert words in str(error.value)


def test_flags_out_of_range(tmp_path):
    folder = write_tum(tmp_path / "s")
    with pytest.raises(InputError, match="--intrinsics"):
        open_sequence(folder, intrinsics=(0, 60, 31, 23))
    with pytest.raises(InputError, match="--depth-scale"):
        open_sequence(folder, depth_scale=float("nan"))
    with pytest.raises(InputError, match="no frame"):
        open_sequence(folder, start=6)
    with pytest.raises(InputError, match="stride"):
        open_sequence(folder, stride=0)


def test_malformed_lists(tmp_path):
    folder = write_tum(tmp_path / "s")
    good = (folder / "rgb.txt").read_text()
    (folder / "rgb.txt").write_text(good + "nonsense\n6.0 rgb/0.000000.png\n")
    with pytest.raises(InputError, match=r"rgb\.txt:9: found 'nonsense'"):
        open_sequence(folder)
    (folder / "rgb.txt").write_text(good + "0.2")  # a recorder was stopped
    assert any("last line, '0.2'" in note for note in open_sequence(folder).notes)
    (folder / "rgb.txt").write_text("100.0 rgb/0.000000.png\n")
    with pytest.raises(InputError, match="no two within 20 ms"):
        open_sequence(folder)
    (folder / "rgb.txt").write_text(good)
    (folder / "groundtruth.txt").write_text("0.0 0 0 0 0 0 0 nan\n")
    sequence = open_sequence(folder)  # poses are optional: bad ones are left out
    assert not sequence.has_poses
    assert any("poses are not used" in note and "unit quaternion" in note for note in sequence.notes)


def test_other_layouts_without_pairs_or_with_a_broken_trajectory(tmp_path):
    folder = write_seven_scenes(tmp_path / "a")
    for file in folder.glob("*.color.png"):
        file.unlink()
    with pytest.raises(InputError, match="0 colour images"):
        open_sequence(folder)
    folder = write_redwood(tmp_path / "b")
    (folder / "trajectory.log").write_text("0 0 1\n1 0 0 0\n")
    with pytest.raises(InputError, match="trajectory.log"):
        open_sequence(folder)


def test_lost_poses_of_seven_scenes_are_none(tmp_path):
    folder = write_seven_scenes(tmp_path / "s")
    np.savetxt(folder / "frame-000001.pose.txt", np.full((4, 4), np.nan))
    sequence = open_sequence(folder)
    assert sequence.T_world_camera(1) is None and sequence.T_world_camera(2) is not None
    assert any("pose" in note for note in sequence.notes)


def test_the_writer_refuses_what_is_there_and_what_does_not_fit(tmp_path):
    folder = write_tum(tmp_path / "s")
    with pytest.raises(InputError, match="already"):
        SequenceWriter(folder, CAMERA)
    with SequenceWriter(folder, CAMERA, overwrite=True) as writer:
        with pytest.raises(InputError, match="32x24"):
            writer.write(0.0, np.zeros((24, 32, 3), np.uint8), depth(0))
        writer.write(0.0, colour(0), depth(0))
    assert len(open_sequence(folder)) == 1
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot write"):
        SequenceWriter(tmp_path / "file" / "s", CAMERA)


def test_foreign_meshes(tmp_path):
    for content in (b"", b"ply\nformat ascii 1.0\nelement vertex x\nend_header\n", b"\x00\xff" * 40):
        (tmp_path / "mesh.ply").write_bytes(content)
        with pytest.raises(InputError, match="mesh.ply"):
            read_mesh(tmp_path / "mesh.ply")
    with pytest.raises(InputError, match="cannot be read"):
        read_mesh(tmp_path / "none.ply")
