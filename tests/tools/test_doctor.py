"""`dsmap doctor`: what it reports, and that it finds what is wrong."""

import importlib
import json
from pathlib import Path

import pytest
import warp as wp

import dsmap.kernels
from dsmap.errors import InputError
from dsmap.kernels import launch
from dsmap.tools.commands import doctor
from dsmap.tools.twins.checks import CHECKS, Check


@pytest.fixture
def few(monkeypatch):
    """Two kernels: the rest is tested with the kernels."""
    monkeypatch.setattr(doctor, "CHECKS", {name: CHECKS[name] for name in ("fusion", "clean-up")})


def test_a_healthy_machine_gets_a_report_and_exit_code_0(few, tmp_path, capsys):
    out = tmp_path / "report.json"
    assert doctor.main(doctor.Args(device="cpu", frames=10, out=out)) == 0
    report = json.loads(out.read_text())
    assert set(report["kernels"]) == {"fusion", "clean-up"} and max(report["kernels"].values()) < 1e-4
    assert report["trajectory"]["largest_difference_m"] == 0.0, "a second run on the CPU is the same"
    assert report["trajectory"]["tracked"] == 10 and report["trajectory"]["largest_error_m"] < 0.02
    assert report["map"]["surfels"] > 1000 and report["failed"] == []
    assert report["stages_ms"]["cpu"]["track"] > 0 and report["versions"]["warp-lang"]
    assert "all is as it should be" in capsys.readouterr().out


def test_what_is_wrong_is_named_and_does_not_stop_the_rest(few, tmp_path, capsys, monkeypatch):
    def broken(device: str) -> float:
        raise RuntimeError("no such instruction\nand more")

    wrong = {"broken": Check(broken, 1.0), "off": Check(lambda device: 2.0, 1.0)}
    monkeypatch.setattr(doctor, "CHECKS", wrong | doctor.CHECKS)
    monkeypatch.setattr(
        doctor, "examine_mapping", lambda device, frames, failed: failed.append("trajectory") or {}
    )
    out = tmp_path / "report.json"
    assert doctor.main(doctor.Args(device="cpu", out=out)) == 1
    report = json.loads(out.read_text())
    assert report["failed"] == ["kernel broken", "kernel off", "trajectory"]
    assert report["kernels"]["broken"] is None and report["kernels"]["fusion"] < 1e-4
    told = capsys.readouterr().out
    assert (
        "RuntimeError: no such instruction" in told
        and "failed: kernel broken, kernel off, trajectory" in told
    )


def test_nan_is_a_failure(monkeypatch):
    monkeypatch.setattr(doctor, "CHECKS", {"lost": Check(lambda device: float("nan"), 1.0)})
    failed: list[str] = []
    doctor.examine_kernels("cpu", failed)
    assert failed == ["kernel lost"]


def test_cuda_that_is_not_there_is_said():
    if wp.is_cuda_available():
        pytest.skip("there is CUDA here")
    with pytest.raises(InputError, match="no CUDA"):
        doctor.main(doctor.Args(device="cuda"))


@pytest.fixture(scope="module")
def outcomes():
    """Difference of every kernel from its twin, and the kernels that were launched for all of them."""
    launched, init, run = set(), launch.Recorded.__init__, wp.launch

    def recorded(self, kernel, *args, **kwargs):
        launched.add((kernel.module.name, kernel.key))
        init(self, kernel, *args, **kwargs)

    def one(kernel, *args, **kwargs):
        launched.add((kernel.module.name, kernel.key))
        return run(kernel, *args, **kwargs)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(launch.Recorded, "__init__", recorded)
        patch.setattr(wp, "launch", one)
        return {name: check.run("cpu") for name, check in CHECKS.items()}, launched


@pytest.mark.parametrize("name", CHECKS)
def test_every_kernel_equals_its_twin(name, outcomes):
    assert outcomes[0][name] <= CHECKS[name].limit


def test_no_kernel_is_without_a_check(outcomes):
    folder = Path(dsmap.kernels.__path__[0])
    modules = [importlib.import_module(f"dsmap.kernels.{path.stem}") for path in folder.glob("*.py")]
    kernels = {
        (kernel.module.name, kernel.key)
        for module in modules
        for kernel in vars(module).values()
        if isinstance(kernel, wp.Kernel)
    }
    assert len(kernels) > 40 and kernels <= outcomes[1]
