"""`dsmap kernel-resources`: what it makes of ptxas' words. Running it needs the CUDA toolkit."""

import shutil

import pytest

from dsmap.errors import InputError
from dsmap.tools.commands import kernel_resources
from dsmap.tools.commands.kernel_resources import Args, Resources, parsed

TOLD = """ptxas info    : 151 bytes gmem, 5720 bytes cmem[3], 312 bytes cmem[4]
ptxas info    : Compiling entry function '_gradient_b67a46d1_cuda_kernel_forward' for 'sm_80'
ptxas info    : Function properties for _gradient_b67a46d1_cuda_kernel_forward
    0 bytes stack frame, 0 bytes spill stores, 0 bytes spill loads
ptxas info    : Used 48 registers, used 0 barriers, 1024 bytes smem, 576 bytes cmem[0], 8 bytes cmem[2]
ptxas info    : Compiling entry function '_joint_02cf9f04_cuda_kernel_forward' for 'sm_80'
ptxas info    : Function properties for _joint_02cf9f04_cuda_kernel_forward
    64 bytes stack frame, 16 bytes spill stores, 24 bytes spill loads
ptxas info    : Used 128 registers, used 0 barriers, 1064 bytes cmem[0]
"""


def test_every_kernel_gets_a_row():
    first, second = parsed(TOLD, "odometry", 80)
    assert first == Resources("odometry", "_gradient", 80, registers=48, spills=0, stack=0, shared=1024)
    assert second == Resources("odometry", "_joint", 80, registers=128, spills=16, stack=64, shared=0)
    assert (first.occupancy, second.occupancy) == (0.625, 0.25)


def test_a_spilling_kernel_is_an_exit_code(monkeypatch, capsys):
    monkeypatch.setattr(kernel_resources, "compiled", lambda name, arch: parsed(TOLD, name, arch))
    monkeypatch.setattr(shutil, "which", lambda name: "/usr/bin/ptxas")
    assert kernel_resources.main(Args(arch=(80,), module="odometry")) == 1
    assert "spill: odometry._joint" in capsys.readouterr().out


def test_bad_input(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: "/usr/bin/ptxas")
    with pytest.raises(InputError, match="expected one of associate"):
        kernel_resources.main(Args(module="nothing"))
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(InputError, match="ptxas is not on the path"):
        kernel_resources.main(Args())
