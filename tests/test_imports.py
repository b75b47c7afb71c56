"""The import rule: tools -> {fusion, dsnet, sim_scenes} -> dsmap root modules; fusion, dsnet -> kernels.

The siblings fusion, dsnet and sim_scenes never import each other, and nothing imports upwards.
"""

import ast
import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
ALLOWED = {
    "src/dsmap": {"root"},
    "kernels": {"root", "kernels"},
    "dsnet": {"root", "dsnet", "kernels"},
    "sim_scenes": {"root", "sim_scenes"},
    "fusion": {"root", "fusion", "kernels"},
    "tools": {"root", "fusion", "dsnet", "sim_scenes", "kernels", "tools"},
}
"""Folder to the parts of dsmap that it may import."""
ROOT_PACKAGES = {"numpy", "cv2", "yaml", "scipy", "dsmap"} | sys.stdlib_module_names
HEAVY = ("torch", "OpenGL", "mujoco", "mujoco_warp", "open3d", "viser", "pyrender")


def imported(file: Path) -> set[str]:
    """Dotted names of everything a file imports, inside functions too."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(), str(file))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            # `from dsmap import fusion` and `from dsmap.fusion import x` are the same to the rule.
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def part(name: str) -> str | None:
    """Which part of dsmap a dotted name belongs to; None for other packages."""
    words = name.split(".")
    if words[0] != "dsmap":
        return None
    return words[1] if len(words) > 1 and words[1] in ALLOWED else "root"


@pytest.mark.parametrize("folder", ALLOWED)
def test_folders_import_only_what_they_may(folder):
    files = sorted((REPOSITORY / folder).rglob("*.py"))
    assert files
    for file in files:
        for name in imported(file):
            owner = part(name)
            assert owner is None or owner in ALLOWED[folder], f"{file}: imports {name}"
            if folder == "src/dsmap":
                assert name.split(".")[0] in ROOT_PACKAGES, f"{file}: imports {name}"


@pytest.mark.parametrize("module", ["dsmap.fusion.mapper", "dsmap.fusion.evaluate.run", "dsmap.sequences"])
def test_the_core_loads_neither_torch_nor_a_renderer(module):
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"{module} is not there")
    code = f"import sys, {module}; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip().endswith("[]"), done.stdout
