"""Signals, locks, and what a killed process leaves."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from dsmap import folders
from dsmap.errors import InputError, WriteError
from dsmap.folders import locked, remove_leftovers, temporary_folder

_PROGRAM = """
import os, signal, time, types
from dsmap.tools import entry
def command():
    os.kill(os.getpid(), signal.{name})
    time.sleep(60)
entry.import_module = lambda name: types.SimpleNamespace(main=command)
entry.main()
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_before_the_work_begins_is_one_line(name):
    heard = (
        f"import signal; signal.signal(signal.{name}, signal.SIG_DFL)\n"  # also where nohup runs the tests
    )
    done = subprocess.run(
        [sys.executable, "-c", heard + _PROGRAM.format(name=name)], capture_output=True, text=True
    )
    assert done.returncode == 128 + getattr(signal, name)
    assert done.stderr in (f"dsmap: stopped by {name}\n", "") and not done.stdout
    assert done.stderr or name == "SIGHUP", "only a terminal that is gone hears nothing"


def test_a_shielded_program_lives_on():
    ignores = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
    quick = _PROGRAM.format(name="SIGHUP").replace("time.sleep(60)", "print('alive')")
    done = subprocess.run([sys.executable, "-c", ignores + quick], capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout == "alive\n"


def test_a_folder_has_one_writer(tmp_path):
    folder = tmp_path / "run"
    with (
        locked(folder, "run"),
        pytest.raises(InputError, match=r"run: another process is writing this run; expected"),
        locked(folder, "run"),
    ):
        pass
    with locked(folder, "run"):
        pass
    (tmp_path / "file").touch()
    with pytest.raises(WriteError, match="cannot be written"), locked(tmp_path / "file", "run"):
        pass


def test_a_killed_writer_leaves_no_lock(tmp_path):
    code = (
        "import sys, time\nfrom pathlib import Path\nfrom dsmap.folders import locked\n"
        f"with locked(Path({str(tmp_path)!r}), 'run'):\n    print('in', flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "in\n"
        with pytest.raises(InputError, match="another process"), locked(tmp_path, "run"):
            pass
        process.kill()
    with locked(tmp_path, "run"):
        pass


def test_only_our_temporary_files_are_removed(tmp_path):
    ours = [".checkpoint.99.tmp.safetensors", ".probe.1.tmp", ".map.123.tmp.ply"]
    theirs = [".tmp.safetensors", "notes.99.tmp.txt", ".checkpoint.tmp.safetensors", "map.ply"]
    for name in ours + theirs:
        (tmp_path / name).touch()
    (tmp_path / ".folder.7.tmp").mkdir()
    remove_leftovers(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {*theirs, ".folder.7.tmp"}
    remove_leftovers(tmp_path / "nowhere")


def test_a_temporary_folder_goes_with_its_process_or_with_the_next_one(tmp_path, monkeypatch):
    monkeypatch.setattr(folders.tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(folders, "_YOUNG_S", -1.0)
    code = (
        "import sys, time\nfrom dsmap import folders\nfolders.tempfile.tempdir = sys.argv[1]\n"
        "print(folders.temporary_folder('unpacked'), flush=True)\ntime.sleep(float(sys.argv[2]))"
    )
    start = [sys.executable, "-c", code, str(tmp_path)]
    subprocess.run([*start, "0"], check=True, capture_output=True)
    assert not list(tmp_path.iterdir()), "gone with its process"
    with subprocess.Popen([*start, "60"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        theirs = Path(process.stdout.readline().strip())
        ours = temporary_folder("unpacked")
        assert theirs.is_dir() and ours.is_dir(), "one in use stays"
        process.kill()
    again = temporary_folder("unpacked")
    assert not theirs.exists() and ours.is_dir() and again.is_dir()
