"""Damaged inputs of every reader: no traceback, no hang, no memory, nothing silently wrong."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
import runner

FUZZ = Path(__file__).parent / "fuzz.py"


def fuzzed(*arguments: str) -> None:
    """The fuzzer as a process of its own: its cases are forked, which wants no other threads."""
    argv = [sys.executable, str(FUZZ), *arguments]
    found = subprocess.run(argv, capture_output=True, text=True, env=os.environ | {"OMP_NUM_THREADS": "1"})
    assert found.returncode == 0, found.stdout[-6000:] + found.stderr[-3000:]
    assert "traceback 0, crash 0, hang 0, memory 0" in found.stdout, found.stdout[-3000:]


def test_damaged_calibrations_lists_and_label_maps_end_in_a_sentence():
    fuzzed("--cases", "36", "--seed", "11", "--subject", "tum-calibration,tum-lists,label-map,redwood-log")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_ten_thousand_damaged_inputs(seed):
    fuzzed("--cases", "1000", "--seed", str(100 + seed))


def outcome(action, tmp_path, **how) -> runner.Outcome:
    (tmp_path / "out").mkdir(exist_ok=True)
    return runner.call(action, tmp_path / "out", **how)


def test_a_case_is_put_into_the_right_class(tmp_path, monkeypatch):
    def prints(text, code=0, error=""):
        def action():
            print(text)
            print(error, file=sys.stderr)
            return code

        return action

    monkeypatch.setattr(runner, "SECONDS", 0.5)
    # A forked process counts what the tests before it left in ours.
    monkeypatch.setattr(runner, "MEMORY", 1 << 40)
    whole = outcome(prints("a map"), tmp_path)
    assert whole.kind == "fine"
    known = {"base": whole.result, "must_tell": True}
    assert outcome(prints("a map"), tmp_path, **known).kind == "fine"
    assert outcome(prints("another"), tmp_path, **known).kind == "silent"
    assert outcome(prints("another", error="warning: it is damaged"), tmp_path, **known).kind == "said"
    assert outcome(prints("ATE nan"), tmp_path, base=whole.result).kind == "silent"
    assert outcome(prints("", 2, "dsmap: no such file"), tmp_path, **known).kind == "refused"
    assert outcome(prints("", 2), tmp_path, **known).kind == "traceback", "no word about it"
    assert outcome(lambda: 1 // 0, tmp_path, **known).kind == "traceback"
    assert outcome(lambda: os.kill(os.getpid(), signal.SIGKILL), tmp_path, **known).kind == "crash"
    assert outcome(lambda: time.sleep(60), tmp_path, **known).kind == "hang"
    monkeypatch.setattr(runner, "MEMORY", 1 << 20)
    assert outcome(prints("a map"), tmp_path, **known).kind == "memory"
