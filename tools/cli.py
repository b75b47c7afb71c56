"""The command line: `dsmap <command> [options]`. One module a command, imported only when it is called."""

import contextlib
import importlib
import os
import sys
import warnings
from typing import Any

import tyro

import dsmap
from dsmap.errors import InputError, InputWarning
from dsmap.ranges import as_flag, check_ranges
from dsmap.tools.support.kernel_cache import make_kernel_cache_writable

COMMANDS: dict[str, tuple[str, str]] = {
    "map": ("dsmap.tools.commands.map", "Map an RGB-D recording: trajectory, surfels, labels, pictures."),
    "live": (
        "dsmap.tools.commands.live",
        "Map a camera while it films, or a recording at its own speed, and watch.",
    ),
    "info": ("dsmap.tools.commands.info", "Say what dsmap understands of a recording, without mapping it."),
    "calibrate": (
        "dsmap.tools.commands.calibrate",
        "Find a recording's camera, its times and the place of its depth camera from the recording itself.",
    ),
    "evaluate": (
        "dsmap.tools.commands.evaluate",
        "Score a run against a reference, or a network on labelled images.",
    ),
    "view": ("dsmap.tools.commands.view", "Show a run in the browser, or render it to pictures."),
    "refine": (
        "dsmap.tools.commands.refine",
        "Let the labels of a run agree with the shape of its map; find its things.",
    ),
    "doctor": ("dsmap.tools.commands.doctor", "Does dsmap compute on this machine what it should?"),
    "bench": (
        "dsmap.tools.commands.bench",
        "Time every stage, and a peer on the same frames in the same run.",
    ),
    "bench-scale": (
        "dsmap.tools.commands.bench_scale",
        "Time frames in maps of 0.1 to 10 million surfels with the same view.",
    ),
    "bench-robustness": (
        "dsmap.tools.commands.bench_robustness",
        "Try to lose the camera in rendered rooms: fast turns, a covered lens, leaps.",
    ),
    "kernel-resources": (
        "dsmap.tools.commands.kernel_resources",
        "Registers, spills and shared memory of every kernel as compiled for CUDA.",
    ),
    "reproduce": (
        "dsmap.tools.commands.reproduce",
        "Make the figures of README and docs again; stated against measured.",
    ),
    "render-scene": (
        "dsmap.tools.commands.render_scene",
        "Render a labelled RGB-D sequence of a synthetic room.",
    ),
    "bench-render": ("dsmap.tools.commands.bench_render", "Frames a second of every renderer."),
    "contact-sheet": (
        "dsmap.tools.commands.contact_sheet",
        "Render one view of each of many scenes into one picture.",
    ),
    "convert": (
        "dsmap.tools.commands.convert",
        "Write a recording for other programs: labels, poses, images.",
    ),
    "export": (
        "dsmap.tools.commands.export",
        "Write a run for other programs: mesh, points, floor plan, poses, images, labels.",
    ),
    "train": ("dsmap.tools.commands.train", "Train DS-Net on sequences or on images with labels."),
    "model-card": (
        "dsmap.tools.commands.model_card",
        "Write what weights are made of, and how they validated, as a page.",
    ),
    "experiment": (
        "dsmap.tools.commands.experiment",
        "The paper's experiments: CIFAR-10, VOC 2012, NYUv2, rendered data.",
    ),
    "validation-split": (
        "dsmap.tools.commands.validation_split",
        "Cut a validation set out of numbered images, where no view is shared.",
    ),
    "bench-net": (
        "dsmap.tools.commands.bench_net",
        "Time the network in torch, ONNX Runtime and OpenVINO; are they equal?",
    ),
    "export-onnx": (
        "dsmap.tools.commands.export_onnx",
        "Write trained weights as an ONNX file for other programs.",
    ),
    "cut": (
        "dsmap.tools.commands.cut",
        "Copy a stretch of a recording into a new sequence in the TUM layout.",
    ),
}
"""Command name to (module, one line of help). Each module has `Args` (a dataclass) and `main(args)`, and may have
`parse(argv)`, which makes the Args where more than flags has a say."""

PIPE_CLOSED = 141
"""Exit code where the reader of a pipe has gone, as shells expect: 128 + SIGPIPE."""

_PACKAGE_EXTRA = {
    "torch": "dsnet", "h5py": "dsnet", "PIL": "dsnet", "onnx": "dsnet", "onnxruntime": "dsnet",
    "mujoco": "sim", "mujoco_warp": "sim", "trimesh": "sim", "pyrender": "sim", "ray": "ray", "viser": "view",
    "open3d": "bench", "evo": "bench", "pycolmap": "sfm",
    "laspy": "export", "pye57": "export", "rerun": "export",
}  # fmt: skip


USE = (
    "map",
    "live",
    "info",
    "calibrate",
    "evaluate",
    "view",
    "render-scene",
    "train",
    "refine",
    "export",
    "convert",
    "cut",
)
"""Commands that the help lists first; all others serve to develop dsmap."""


def usage() -> str:
    """The help text of `dsmap` alone."""
    width = max(map(len, COMMANDS))
    groups = {"use": USE, "develop": [name for name in COMMANDS if name not in USE]}
    lines = ["usage: dsmap <command> [options]"]
    for title, names in groups.items():
        lines += ["", f"{title}:", *(f"  {name:<{width}}  {COMMANDS[name][1]}" for name in names)]
    return "\n".join([*lines, "", "`dsmap <command> --help` lists options."])


def run(command: str, argv: list[str]) -> int:
    """Parse `argv` for one command and run it; returns the exit code."""
    try:
        module = importlib.import_module(COMMANDS[command][0])
        if hasattr(module, "parse"):
            args = module.parse(argv)
        else:
            args = tyro.cli(module.Args, args=argv, prog=f"dsmap {command}", description=COMMANDS[command][1])
        check_ranges(args, as_flag)
        return int(module.main(args) or 0)
    except InputError as error:
        print(f"dsmap {command}: {error}", file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        extra = _PACKAGE_EXTRA.get((error.name or "").split(".")[0])
        if extra is None:
            raise
        print(
            f"dsmap {command}: needs {error.name}; install it with: pip install 'dsmap[{extra}]'",
            file=sys.stderr,
        )
        return 2


def print_input_warnings() -> None:
    """From now on an InputWarning is one line on stderr, without the place in our code that found it."""
    usual = warnings.showwarning

    def show(message: Any, category: Any, *where: Any, **more: Any) -> None:
        if issubclass(category, InputWarning):
            with contextlib.suppress(OSError):  # a terminal that is gone must not end what it warns of
                print(f"warning: {message}", file=sys.stderr)
        else:
            usual(message, category, *where, **more)

    warnings.showwarning = show


def main() -> None:
    """Entry point of the `dsmap` program; ends quietly where nobody reads its output any more (`dsmap ... | head`)."""
    try:
        try:
            _main()
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        # What is still buffered would be written, and fail once more, when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(PIPE_CLOSED)


def _main() -> None:
    print_input_warnings()
    argv = sys.argv[1:]
    if not argv or argv[0] in ("-h", "--help"):
        print(usage())
        sys.exit(0 if argv else 2)
    if argv[0] in ("--version", "-V"):
        print(f"dsmap {dsmap.__version__}")
        sys.exit(0)
    if argv[0] not in COMMANDS:
        print(f"dsmap: unknown command {argv[0]!r}; expected one of: {', '.join(COMMANDS)}", file=sys.stderr)
        sys.exit(2)
    make_kernel_cache_writable()
    sys.exit(run(argv[0], argv[1:]))


if __name__ == "__main__":
    importlib.import_module("dsmap.tools.entry").main()  # by name: it answers signals as soon as it is loaded
