"""`dsmap evaluate`: a run against its reference, or a network alone on labelled images."""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from tqdm import tqdm

from dsmap.errors import InputError
from dsmap.files import atomic_path
from dsmap.frame import Frame
from dsmap.fusion.evaluate import MAX_FRAMES, evaluate_run
from dsmap.fusion.evaluate_semantics import evaluate_network
from dsmap.fusion.run_reader import Run, load_run
from dsmap.fusion.segmenter import Segmenter
from dsmap.sequences import open_sequence
from dsmap.sequences.images import read_colour, read_ids
from dsmap.tools.parse import parse_intrinsics
from dsmap.tools.score_tables import network_table, run_tables
from dsmap.tools.segmenters import SegmenterSpec, make_segmenter

_IMAGES = (".jpg", ".jpeg", ".png")


@dataclass
class Args:
    run: Annotated[Path | None, tyro.conf.Positional] = None
    """RUN folder to score; leave out with --data."""
    reference: Path | None = None
    """The recording with ground truth; default: the recording that was mapped."""
    data: Path | None = None
    """Score a network alone: a folder of rgb/ and label/ images with the same names, or a labelled recording."""
    weights: str | None = None
    """Weights of the network; default: the run's, or those that come with dsmap."""
    max_frames: int = MAX_FRAMES
    """Labelled frames that a run's semantics are scored on, evenly spread; 0: all."""
    out: Path | None = None
    """Where to write the scores; default: metrics.json in the RUN folder, nowhere with --data."""
    intrinsics: str | None = None
    """fx,fy,cx,cy of the reference's images [px]; before calibration.yaml and known defaults."""
    depth_scale: float | None = None
    """Stored depth units per metre of the reference."""


def main(args: Args) -> None:
    """Score, print the tables, write metrics.json."""
    if args.run is not None and args.data is None:
        metrics = score_run(args.run, args)
        print(run_tables(metrics))
        out = args.out or args.run / "metrics.json"
    elif args.data is not None and args.run is None:
        metrics = score_network(args.data, args.weights)
        print(network_table(metrics))
        out = args.out
    else:
        raise InputError("expected either a RUN folder, or --data with images and labels")
    if out is not None:
        with atomic_path(out) as path:
            path.write_text(json.dumps(finite(metrics), indent=2, allow_nan=False) + "\n")
        print(f"written: {out}")


def score_run(folder: Path, args: Args) -> dict[str, Any]:
    """The metrics of a run (see `dsmap.fusion.evaluate.evaluate_run`)."""
    run = load_run(folder)
    settings = run.settings.get("sequence", {})
    path = args.reference or settings.get("path")
    if path is None:
        raise InputError(f"{folder}: its config.yaml names no recording; expected --reference")
    reference = open_sequence(
        path,
        intrinsics=parse_intrinsics(args.intrinsics),
        depth_scale=args.depth_scale,
        undistort=bool(settings.get("undistort", False)),
    )
    segmenter = segmenter_of(run, args.weights) if reference.has_labels else None
    return evaluate_run(run, reference, segmenter, args.max_frames)


def segmenter_of(run: Run, weights: str | None) -> Segmenter | None:
    """The segmenter that labelled a run, from its config.yaml; `weights` replace the run's.

    A network that needs a package which is not here, or a factory that is gone, gives None and a line of
    warning: the map's own labels can still be scored.
    """
    values: dict[str, Any] = run.settings.get("segmenter") or {"kind": "none"}
    try:
        spec = SegmenterSpec(**values)
        if weights is not None:
            spec.weights = weights
        return make_segmenter(spec)
    except (InputError, ModuleNotFoundError, TypeError) as error:
        if weights is not None:
            raise
        print(f"warning: the run's segmenter cannot be built ({error}); the network is not scored")
        return None


def score_network(data: Path, weights: str | None) -> dict[str, Any]:
    """Scores of DS-Net alone on labelled images, the `single_frame` tree of a run's metrics."""
    segmenter = make_segmenter(SegmenterSpec("dsnet", weights))
    if segmenter is None:
        raise InputError("no network to score")
    tree, frames = evaluate_network(segmenter, labelled_frames(data))
    return {"single_frame": tree, "frames": frames, "data": str(data), "weights": weights}


def labelled_frames(data: Path) -> Iterator[tuple[Frame, np.ndarray]]:
    """Frames with labels: of an rgb/ + label/ folder (same stems), or of a recording.

    Raises:
        InputError: there are none, or an image does not fit its label.
    """
    if (data / "label").is_dir() and not (data / "rgb.txt").exists():
        yield from _image_folder(data)
        return
    sequence = open_sequence(data)
    if not sequence.has_labels:
        raise InputError(
            f"{data}: this recording has no labels; expected label.txt, or folders rgb/ and label/"
        )
    for i in tqdm(sequence.labelled(), unit="image"):
        frame = sequence.frame(i)
        if frame.label is not None:
            yield frame, frame.label


def _image_folder(data: Path) -> Iterator[tuple[Frame, np.ndarray]]:
    files = sorted((data / "rgb").glob("*")) if (data / "rgb").is_dir() else []
    images = {path.stem: path for path in files if path.suffix.lower() in _IMAGES}
    labels = {path.stem: path for path in sorted((data / "label").glob("*.png"))}
    stems = sorted(images.keys() & labels.keys())
    if not stems:
        raise InputError(
            f"{data}: found {len(images)} images in rgb/ and {len(labels)} in label/ without a common name, "
            "expected rgb/NAME.jpg (or .png) beside label/NAME.png"
        )
    for index, stem in enumerate(tqdm(stems, unit="image")):
        rgb, label = read_colour(images[stem]), read_ids(labels[stem])
        if rgb.shape[:2] != label.shape:
            raise InputError(
                f"{labels[stem]}: found {label.shape[1]}x{label.shape[0]}, expected {rgb.shape[1]}x{rgb.shape[0]} "
                "as its image has"
            )
        depth = np.zeros(label.shape, dtype=np.float32)
        yield Frame(index, float(index), rgb, depth), label


def finite(tree: Any) -> Any:
    """The tree with NaN and infinite numbers as None: JSON has no such numbers."""
    if isinstance(tree, dict):
        return {key: finite(value) for key, value in tree.items()}
    return None if isinstance(tree, float) and not math.isfinite(tree) else tree
