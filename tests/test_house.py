"""Rules of CONTRIBUTING: no name stands for two things, functions and files have an end.

What a module offers under a name, no other module offers under the same one.
"""

import ast
import tomllib
from collections import Counter, defaultdict
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
FOLDERS = ("kernels", "dsnet", "fusion", "sim_scenes", "tools", "src/dsmap")
SAME_ROLE = {
    "Args": "the options of each command",
    "main": "the entry of each command",
    "READER": "the reader of each format",
    "connect": "the first call to each live camera",
}
"""What a command, a format and a camera must offer: the only names that several modules offer."""
TWINS = ("tools/twins/", "kernels/se3.py")
"""What does the same as something else by other means, with its names: kernels in NumPy, `fusion/lie.py` in Warp."""
CALLED_BY_NAME = {
    "main": "the command line's",
    "parse": "the command line's, of commands that read their options themselves",
    "connect": "`dsmap live` of the kind of camera",
    "predict_warp": "programs of their own: docs/guide/onnx.md",
    "construct_mapping": "PyYAML's",
    "emit": "logging's",
    "get_next": "onnxruntime's",
}
"""Names without a caller in the tree, and who calls them."""
MOST_LINES, MOST_LINES_OF_A_FUNCTION = 400, 60


def offered(file: Path) -> set[str]:
    """Public names that a module defines, not those that it imports."""
    names: set[str] = set()
    for node in ast.parse(file.read_text(), str(file)).body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names |= {target.id for target in targets if isinstance(target, ast.Name)}
    return {name for name in names if not name.startswith("_")}


def files() -> list[Path]:
    return [file for folder in FOLDERS for file in sorted((REPOSITORY / folder).rglob("*.py"))]


def modules() -> dict[str, list[str]]:
    """Files that offer each name. A NumPy twin has the name of its kernel: `TWINS` count apart."""
    found = defaultdict(list)
    for file in files():
        where = file.relative_to(REPOSITORY).as_posix()
        if not where.startswith(TWINS):
            for name in offered(file):
                found[name].append(where)
    return found


def test_no_name_stands_for_two_things():
    double = {name: where for name, where in modules().items() if len(where) > 1 and name not in SAME_ROLE}
    assert not double, "rename one, or give it an underscore if only its module uses it"


def test_every_exception_is_one():
    found = modules()
    twins = [offered(file) for file in (REPOSITORY / "tools/twins").glob("*.py")]
    count = {name: len(found[name]) + sum(name in names for names in twins) for name in SAME_ROLE}
    assert [name for name, times in count.items() if times < 2] == []


def test_functions_and_files_have_an_end():
    long = [file.name for file in files() if len(file.read_text().splitlines()) > MOST_LINES]
    for file in files():
        found = [n for n in ast.walk(ast.parse(file.read_text())) if isinstance(n, ast.FunctionDef)]
        lines = {node.name: (node.end_lineno or 0) - node.lineno + 1 for node in found}
        long += [f"{file.name} {name}" for name, count in lines.items() if count > MOST_LINES_OF_A_FUNCTION]
    assert long == []


def defined(tree: ast.Module) -> list[tuple[str, ast.stmt, bool]]:
    """Functions, classes, methods and constants of a module: name, where, and whether it is a method."""
    found: list[tuple[str, ast.stmt, bool]] = []
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.append((node.name, node, False))
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found += [(target.id, node, False) for target in targets if isinstance(target, ast.Name)]
    classes = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    found += [(m.name, m, True) for node in classes for m in node.body if isinstance(m, ast.FunctionDef)]
    return [(name, node, method) for name, node, method in found if not name.startswith("__")]


def names_used(tree: ast.AST) -> Counter[str]:
    """How often a tree reads, calls, imports or spells a name in a string."""
    used: Counter[str] = Counter()
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            used[node.id] += 1
        elif isinstance(node, ast.Attribute):
            used[node.attr] += 1
        elif isinstance(node, ast.ImportFrom):
            used.update(alias.name for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
            used[node.value] += 1
    return used


def test_everything_has_a_caller_other_than_tests():
    """By name: public ones and methods anywhere but in their own body, private ones in their module."""
    trees = {file: ast.parse(file.read_text(), str(file)) for file in files()}
    used = {file: names_used(tree) for file, tree in trees.items()}
    everywhere = sum(used.values(), Counter())
    alone = []
    for file, tree in trees.items():
        if not file.relative_to(REPOSITORY).as_posix().startswith("tools/twins/"):
            for name, node, method in defined(tree):
                uses = everywhere if method or not name.startswith("_") else used[file]
                if name not in CALLED_BY_NAME and uses[name] <= names_used(node)[name]:
                    alone.append(f"{file.relative_to(REPOSITORY)}: {name}")
    assert alone == [], "delete it, or say in CALLED_BY_NAME who calls it"


def test_every_package_is_installed():
    """Not only where the checkout is linked in: `pip install .` copies what pyproject.toml names."""
    setup = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["setuptools"]
    there = {
        ".".join([name, *file.parent.relative_to(REPOSITORY / folder).parts])
        for name, folder in ({"dsmap": "src/dsmap"} | setup["package-dir"]).items()
        for file in (REPOSITORY / folder).rglob("__init__.py")
    }
    assert set(setup["packages"]) == there
