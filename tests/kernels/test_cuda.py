"""Every kernel module compiles for CUDA. Warp brings the compiler, so this needs no GPU; running does."""

import importlib
import pkgutil

import pytest
import warp as wp

import dsmap.kernels

MODULES = [module.name for module in pkgutil.iter_modules(dsmap.kernels.__path__)]


@pytest.mark.parametrize("name", MODULES)
def test_module_compiles_for_cuda(name, tmp_path):
    module = importlib.import_module(f"dsmap.kernels.{name}")
    if not wp.get_module(module.__name__).kernels:
        pytest.skip("no kernels in it")
    wp.compile_aot_module(module, arch=80, module_dir=str(tmp_path))
    assert list(tmp_path.glob("*.sm80.cubin"))
