"""The import rule: tools -> {fusion, dsnet, sim_scenes} -> dsmap root modules; fusion, dsnet -> kernels.

The siblings fusion, dsnet and sim_scenes never import each other, and nothing imports upwards; inside fusion and
sim_scenes the folders have an order, too. There are no circles, imports inside functions and for types alone included.
"""

import ast
import importlib.util
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
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
ORDER = {
    "fusion": (
        "config lie trajectory segmenter state stage_clock calibration", "surfels", "tracking", "labels objects places",
        "loops locator", "mapper", "pictures", "runs exports", "evaluate",
    ),
    "sim_scenes": (
        "geometry", "scene", "textures", "pieces space", "physics", "rooms", "camera_paths importers render sensors",
        "recording",
    ),
}  # fmt: skip
"""Folders and files of a part, lowest first: each may import its own line and those before."""
ROOT_PACKAGES = {"numpy", "cv2", "yaml", "scipy", "PIL", "dsmap"} | sys.stdlib_module_names
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


def modules() -> dict[str, Path]:
    """Dotted name to file of everything under `dsmap`."""
    found: dict[str, Path] = {}
    for folder in ALLOWED:
        root = REPOSITORY / folder
        for file in root.rglob("*.py"):
            words = file.relative_to(root).with_suffix("").parts
            start = ("dsmap",) if folder == "src/dsmap" else ("dsmap", folder)
            found[".".join((*start, *words)).removesuffix(".__init__")] = file
    return found


def test_there_are_no_circles():
    known = modules()
    graph = {name: sources(file, set(known)) - {name} for name, file in known.items()}
    assert len(graph) > 200
    try:
        list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        raise AssertionError(" -> ".join(error.args[1])) from None


def sources(file: Path, known: set[str]) -> set[str]:
    """The modules that a file imports, or imports names from."""
    return {name if name in known else name.rpartition(".")[0] for name in imported(file)} & known


@pytest.mark.parametrize("part_of_dsmap", ORDER)
def test_folders_import_only_what_lies_below(part_of_dsmap):
    level = {name: i for i, line in enumerate(ORDER[part_of_dsmap]) for name in line.split()}
    for file in sorted((REPOSITORY / part_of_dsmap).rglob("*.py")):
        words = file.relative_to(REPOSITORY / part_of_dsmap).with_suffix("").parts
        if words == ("__init__",):
            continue
        for name in imported(file):
            target = name.split(".")
            if target[:2] == ["dsmap", part_of_dsmap] and len(target) > 2:
                assert level[target[2]] <= level[words[0]], f"{file}: imports {name}, which lies above"


def test_a_step_calls_few_parts():
    """`Mapper.step` is a straight line through at most 7 parts, and the pose is assigned there alone."""
    tree = ast.parse((REPOSITORY / "fusion" / "mapper.py").read_text())
    mapper = next(n for n in tree.body if isinstance(n, ast.ClassDef) and n.name == "Mapper")
    functions = {f.name: f for f in mapper.body if isinstance(f, ast.FunctionDef)}
    local = {"model": "model", "clock": "clock"}
    parts = set()
    for node in ast.walk(functions["step"]):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            owner = node.func.value
            if isinstance(owner, ast.Attribute) and isinstance(owner.value, ast.Name):
                parts.add(owner.attr)
            elif isinstance(owner, ast.Name) and owner.id in local:
                parts.add(local[owner.id])
    assert {"locator", "model", "labeller", "closer"} <= parts and len(parts) <= 7, parts
    for name, function in functions.items():
        sets_pose = any(
            isinstance(n, ast.Attribute) and n.attr == "T_world_camera" and isinstance(n.ctx, ast.Store)
            for n in ast.walk(function)
        )
        assert not sets_pose or name in {"__init__", "step", "_load_map_state"}, name
