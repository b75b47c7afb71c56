"""What the program says of itself, and what it leaves in a RUN folder."""

import subprocess
import sys

from dsmap.tools.mapping.output import remove_pictures


def test_version_by_module(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "dsmap", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("dsmap ")


def test_kernels_find_a_place_without_a_home(tmp_path):
    (tmp_path / "file").touch()
    code = (
        "import os; from dsmap.tools.support.kernel_cache import make_kernel_cache_writable as make;"
        "make(); print(os.environ['WARP_CACHE_PATH'])"
    )
    env = {"HOME": str(tmp_path / "file"), "TMPDIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=env)
    assert done.stdout.startswith(str(tmp_path)) and "cannot be written" in done.stderr


def test_pictures_of_an_earlier_run_are_removed_and_nothing_else(tmp_path):
    folder = tmp_path / "pictures"
    folder.mkdir()
    for name in ("map_colour.png", "my notes.txt"):
        (folder / name).touch()
    remove_pictures(tmp_path)
    assert [file.name for file in folder.iterdir()] == ["my notes.txt"]
