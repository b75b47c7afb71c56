"""A command whose reader has gone (`dsmap ... | head`) ends quietly."""

import os
import subprocess
import sys

import pytest
from sequence_files import write_tum

from dsmap.tools.cli import COMMANDS, PIPE_CLOSED


def into_a_closed_pipe(*argv: str) -> tuple[int, str]:
    """Exit code, and what is said on stderr."""
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "dsmap.tools.entry", *argv],
            stdout=writer,
            stderr=subprocess.PIPE,
            text=True,
        )
    finally:
        os.close(writer)
    return done.returncode, done.stderr


def test_the_list_of_commands_and_what_a_command_prints(tmp_path):
    assert into_a_closed_pipe() == (PIPE_CLOSED, "")
    assert into_a_closed_pipe("info", str(write_tum(tmp_path / "s"))) == (PIPE_CLOSED, "")


@pytest.mark.parametrize(
    "command", ["map", *(pytest.param(c, marks=pytest.mark.slow) for c in COMMANDS if c != "map")]
)
def test_help(command):
    assert into_a_closed_pipe(command, "--help") == (PIPE_CLOSED, "")
