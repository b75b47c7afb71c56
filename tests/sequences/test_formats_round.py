"""A ray-cast recording is written in each format and read back: same frames, camera, stamps, poses and map."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sequence_files
from corner_frames import config
from format_cases import CASES, STAMP_TOLERANCE, recorded, written
from recording_shots import write_tum

from dsmap.fusion.mapper import Mapper
from dsmap.sequences import Sequence, open_sequence
from dsmap.sequences.formats.registry import READERS, find_reader


@pytest.mark.parametrize("name", CASES)
def test_the_same_frames_come_back(name: str, tmp_path: Path):
    case = CASES[name]
    sequence = open_sequence(written(case, tmp_path / "recording"))
    expected = recorded(case)
    assert sequence.layout == case.reader
    assert len(sequence) == len(expected)
    assert sequence.depth_scale == case.units
    assert sequence.intrinsics.distortion is None
    camera = [getattr(sequence.intrinsics, key) for key in ("width", "height", "fx", "fy", "cx", "cy")]
    assert camera == pytest.approx(
        [getattr(case.camera, key) for key in ("width", "height", "fx", "fy", "cx", "cy")], abs=1e-5
    )
    assert sequence.has_poses == case.has_poses
    for frame, shot in zip(sequence, expected, strict=True):
        assert np.array_equal(frame.rgb, shot.rgb)
        assert np.array_equal(frame.depth, shot.stored(case.units) * np.float32(1 / case.units))
        assert frame.time == pytest.approx(shot.time, abs=STAMP_TOLERANCE.get(name, 1e-9))
        assert frame.pose_time == pytest.approx(shot.time, abs=STAMP_TOLERANCE.get(name, 1e-9))
        if case.has_poses:
            assert frame.T_world_camera == pytest.approx(shot.T_world_camera, abs=2e-6)
    assert not sequence.skipped


@pytest.mark.parametrize("name", CASES)
def test_the_map_is_that_of_the_tum_layout(name: str, tmp_path: Path):
    case = CASES[name]
    sequence = open_sequence(written(case, tmp_path / "recording"))
    stamped = [replace(s, time=float(t)) for s, t in zip(recorded(case), sequence.times, strict=True)]
    twin = open_sequence(write_tum(tmp_path / "tum", stamped, sequence.intrinsics, case.units))
    assert np.array_equal(trajectory(sequence), trajectory(twin))


def trajectory(sequence: Sequence) -> np.ndarray:
    """T_world_camera of each frame as tracked, shape (N, 4, 4)."""
    mapper = Mapper(config(), sequence.intrinsics)
    return np.stack([mapper.step(frame).T_world_camera for frame in list(sequence)[:6]])


@pytest.mark.parametrize("name", CASES)
def test_one_reader_knows_a_recording_as_its_own(name: str, tmp_path: Path):
    path = written(CASES[name], tmp_path / "recording")
    own = [r.name for r in READERS if r.detect(path)]
    if CASES[name].reader == "tum":  # the plain layout, to which no reader may lay claim
        assert not own
        return
    assert own[0] == CASES[name].reader
    assert own in ([CASES[name].reader], ["realsense", "ros"])  # RealSense's bags are bags


@pytest.mark.parametrize("name", ["tum", "seven", "redwood", "empty", "file"])
def test_no_reader_takes_what_is_not_its_own(name: str, tmp_path: Path):
    write = {
        "tum": lambda p: sequence_files.write_tum(p / "r"),
        "seven": lambda p: sequence_files.write_seven_scenes(p / "r"),
        "redwood": lambda p: sequence_files.write_redwood(p / "r"),
        "empty": lambda p: p,
        "file": lambda p: Path(__file__),
    }
    assert find_reader(write[name](tmp_path)) is None
