"""The documents: links resolve, commands and Python lines exist, each kind of page keeps its rule."""

import ast
import contextlib
import importlib
import io
import re
import shlex
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import tyro

from dsmap.sequences.calibration import read_calibration
from dsmap.tools.cli import COMMANDS
from dsmap.tools.mapping.presets import load_preset
from dsmap.tools.mapping.spelling import spelled_out

REPOSITORY = Path(__file__).resolve().parents[1]
DOCS = REPOSITORY / "docs"
KEPT = [REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
"""All documents."""
LIVING = [page for page in KEPT if page.parent.name != "log"]
"""Those that are kept up to date; the log is history."""
EXTRAS = {"torch", "h5py", "PIL", "onnx", "onnxruntime", "mujoco", "mujoco_warp", "trimesh", "viser"}
"""Packages that the documents' Python lines may need and that need not be installed."""

FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
SOURCE_PATH = re.compile(r"`((?:fusion|kernels|dsnet|sim_scenes|tools|src|tests)/[\w./]*\.\w+)`")
QUALITY = re.compile(
    r"\bATE\b|mIoU|\bECE\b|\bRMS\b|class average|pixel accuracy|recall|consistency|epipolar|surface error|"
    r"drift|tracked|speed|faster|accuracy|figure",
    re.IGNORECASE,
)
MEASURED = re.compile(r"\d\s*(?:%|mm\b|cm\b|px\b|frames/s|ms\b)")


def name(page: Path) -> str:
    return str(page.relative_to(REPOSITORY))


def pages(which: list[Path]) -> Any:
    return pytest.mark.parametrize("page", which, ids=name)


def code_blocks(text: str) -> list[str]:
    """Fenced blocks, without Python and YAML, and blocks indented by four; continued lines as one."""
    text = text.replace("\\\n", " ")
    fenced = [body for language, body in FENCE.findall(text) if language in ("", "bash", "sh")]
    rest = FENCE.sub("", text)
    return fenced + re.findall(r"(?:^    .*\n?)+", rest, re.MULTILINE)


def command_lines(text: str) -> list[str]:
    """Every `dsmap COMMAND ...` of the code blocks, and of inline code that has arguments."""
    lines = [line.strip() for block in code_blocks(text) for line in block.splitlines()]
    lines += re.findall(r"`(dsmap [^`\n]+)`", FENCE.sub("", text))
    return [line for line in lines if line.startswith("dsmap ") and line.split()[1] in COMMANDS]


def prose(text: str) -> list[str]:
    """The lines of a page that are not in a fenced block."""
    return FENCE.sub("", text).splitlines()


def measurements(text: str) -> list[str]:
    """Lines that state how good or how fast something is: a measure and a number with its unit."""
    return [line for line in prose(text) if QUALITY.search(line) and MEASURED.search(line)]


def anchor(heading: str) -> str:
    """The fragment that a heading is reached by, as GitHub makes it."""
    kept = re.sub(r"[^\w\- ]", "", heading.strip().lower())
    return kept.replace(" ", "-")


@cache
def arguments(command: str) -> Any:
    """The options of a command; skips where an extra is not installed."""
    try:
        return importlib.import_module(COMMANDS[command][0]).Args
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] not in EXTRAS:
            raise
        pytest.skip(f"dsmap {command} needs {error.name}")


def complaint(line: str) -> str:
    """Why a command line does not parse; empty if it does."""
    command, *argv = shlex.split(line, comments=True)[1:]
    if argv in (["--help"], []):
        return ""
    if command == "map" and "--resume" in argv and argv[0].startswith("-"):
        argv = ["RECORDING", *argv]  # a run that goes on knows its recording
    if command == "map" and "--write-config" in argv:
        argv += ["RECORDING", "--out", "RUN"]  # that nothing is mapped of
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            tyro.cli(arguments(command), args=spelled_out(argv) if command == "map" else argv)
    except SystemExit:
        return said.getvalue()
    return ""


@pages(KEPT)
def test_links_lead_to_files_and_headings(page):
    text = FENCE.sub("", page.read_text())
    for target in LINK.findall(text):
        if re.match(r"\w+:", target):
            continue
        path, _, fragment = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{name(page)}: no {target}"
        assert REPOSITORY in file.parents, f"{name(page)}: {target} leads out of the repository"
        if fragment:
            headings = re.findall(r"^#+ (.*)$", FENCE.sub("", file.read_text()), re.MULTILINE)
            assert fragment in map(anchor, headings), f"{name(page)}: no heading {target}"


@pages(LIVING)
def test_command_lines_parse(page):
    for line in command_lines(page.read_text()):
        assert not complaint(line), f"{name(page)}: {line}\n{complaint(line)}"


def test_a_command_line_with_an_option_that_is_not_there_is_found():
    assert complaint("dsmap map PATH --out RUN --no-such-option 3")
    assert not complaint("dsmap map PATH --out RUN --size 320x240   # a remark")


@pages(LIVING)
def test_make_targets_exist(page):
    targets = re.findall(r"^([\w-]+):", (REPOSITORY / "Makefile").read_text(), re.MULTILINE)
    lines = [line.strip() for block in code_blocks(page.read_text()) for line in block.splitlines()]
    for line in lines:
        if line.startswith("make "):
            assert line.split()[1] in targets, f"{name(page)}: {line}"


@pages(LIVING)
def test_python_lines_import_what_exists(page):
    for language, body in FENCE.findall(page.read_text()):
        if language != "python":
            continue
        for node in ast.walk(ast.parse(body)):
            if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith("dsmap"):
                continue
            try:
                module = importlib.import_module(node.module or "")
            except ModuleNotFoundError as error:
                if (error.name or "").split(".")[0] not in EXTRAS:
                    raise
                pytest.skip(f"{node.module} needs {error.name}")
            for alias in node.names:
                assert hasattr(module, alias.name), f"{name(page)}: {node.module} has no {alias.name}"


def test_the_calibration_and_the_parameters_that_the_guide_shows_are_read(tmp_path):
    blocks = [
        body
        for language, body in FENCE.findall((DOCS / "guide/configuration.md").read_text())
        if language == "yaml"
    ]
    calibration, parameters = blocks
    (tmp_path / "calibration.yaml").write_text(calibration)
    stored = read_calibration(tmp_path)
    assert stored is not None and stored.color_camera is not None and stored.intrinsics.fx == 525.0
    (tmp_path / "mine.yaml").write_text(parameters)
    assert load_preset(str(tmp_path / "mine.yaml"))["labels"]["every"] == 0


@pages(LIVING)
def test_paths_of_the_code_exist(page):
    for path in SOURCE_PATH.findall(page.read_text()):
        if "NAME" in path:  # stands for the file that the reader adds
            path = str(Path(path).parent / "__init__.py")
        assert (REPOSITORY / path).is_file(), f"{name(page)}: {path} is not there"


@pages(sorted((DOCS / "method").glob("*.md")))
def test_a_page_of_method_opens_with_its_code(page):
    heading, empty, first, *_ = page.read_text().splitlines()
    assert heading.startswith("# ") and not empty
    assert SOURCE_PATH.search(first), f"{name(page)}: the first line names no file of code"


@pages(sorted((DOCS / "method").glob("*.md")))
def test_a_page_of_method_is_no_history(page):
    found = re.search(r"used to |no longer|(?:earlier|previous|older) version", page.read_text())
    assert not found, f"{name(page)}: {found and found.group()}"


@pages(sorted((DOCS / "guide").glob("*.md")))
def test_a_guide_states_no_measurement(page):
    assert not measurements(page.read_text())


def test_measurements_are_told_from_settings():
    assert measurements("ATE is 0.51 cm.") and measurements("The map has a class average of 72 %.")
    assert not measurements("Depth is stored in units of 0.1 mm, and 4.0 m is the default range.")
    assert not measurements("```\nATE 0.51 cm\n```\n")


@pages(sorted((DOCS / "results").glob("*.md")))
def test_tables_of_results_name_their_command(page):
    """A table has a column of commands, or a command stands between it and its heading."""
    parts = re.split(r"^#+ .*$", page.read_text(), flags=re.MULTILINE)
    for part in parts:
        tables = re.findall(r"(?:^\|.*\n)+", part, re.MULTILINE)
        for table in tables:
            before = part[: part.index(table)]
            named = "command" in table.splitlines()[0] or re.search(r"dsmap \w+|pytest|make \w+", before)
            assert named, f"{name(page)}: no command beside\n{table}"


def test_the_readme_is_short():
    assert len((REPOSITORY / "README.md").read_text().splitlines()) <= 120


def test_nothing_cites_a_place_that_users_do_not_have():
    for page in KEPT:
        found = re.search(r"\.\./shared|/home/\w|/work/|/opt/", page.read_text())
        assert not found, f"{name(page)}: {found and found.group()}"


def test_code_and_figures_cite_pages_that_exist():
    suffixes = {".py", ".yaml"}
    for folder in ("src", "kernels", "fusion", "dsnet", "sim_scenes", "tools"):
        for file in (REPOSITORY / folder).rglob("*"):
            if file.suffix in suffixes:
                for path in re.findall(r"\bdocs/[\w/]+\.md", file.read_text()):
                    assert (REPOSITORY / path).is_file(), f"{name(file)}: {path} is not there"
