"""`dsmap evaluate`: a run against its reference, or a network alone on labelled images."""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from tqdm import tqdm

from dsmap.classes import CLASS_NAMES
from dsmap.config_file import fill
from dsmap.dsnet.datasets.base import Example
from dsmap.dsnet.datasets.folders import is_rendered
from dsmap.dsnet.datasets.geometry import DepthView
from dsmap.dsnet.datasets.registry import open_set
from dsmap.errors import InputError
from dsmap.files import write_json
from dsmap.fusion.evaluate.run import MAX_FRAMES, evaluate_run, evaluation_size
from dsmap.fusion.evaluate.semantics import evaluate_labels, evaluate_network
from dsmap.fusion.runs.read_run import SavedRun, load_run
from dsmap.fusion.segmenter import Segmenter
from dsmap.ranges import Frames, Scale, Share
from dsmap.sequences import open_sequence
from dsmap.sequences.tum import is_tum
from dsmap.tools.mapping.recording import recording_of
from dsmap.tools.mapping.segmenters import SegmenterSpec, make_segmenter, names_code
from dsmap.tools.support.parse import parse_intrinsics
from dsmap.tools.support.score_tables import labels_table, network_table, run_tables


@dataclass
class Args:
    run: Annotated[Path | None, tyro.conf.Positional] = None
    """RUN folder to score; leave out with --data."""
    reference: Path | None = None
    """The recording with ground truth; default: the recording that was mapped."""
    data: Path | None = None
    """Score a network alone: a labelled recording, or PATH or PATH@SPLIT of a data set as `dsmap train` takes them."""
    labels: Path | None = None
    """With --data: score the label images of this recording of the same frames instead of a network, such as
    `dsmap export RUN --to labels-2d` writes."""
    weights: str | None = None
    """Weights of the network; default: the run's, or those that come with dsmap."""
    prior: Share | None = None
    """Class prior of the network's answers (see `dsmap map`); default: as the run did, or as the weights say."""
    colour_only: bool = False
    """With --data: show the network no geometry, what it makes of photographs without depth."""
    max_frames: Frames = MAX_FRAMES
    """Labelled frames that a run's semantics are scored on, evenly spread; 0: all."""
    segmenter: str | None = None
    """Score this segmenter instead of the run's: dsnet, labels, none or module:factory (see `dsmap map`). A run that
    was labelled by code of your own needs it: what a RUN folder names is not run."""
    engine: Literal["auto", "torch", "onnx"] | None = None
    """What runs the network (see `dsmap map`); default: as the run did, or the fastest that is installed."""
    out: Path | None = None
    """Where to write the scores; default: metrics.json in the RUN folder, nowhere with --data. With --data also a
    folder: metrics.json, reliability.png and overlays.jpg (ten images by rank) go into it."""
    sfm: bool = False
    """Compare with the poses that structure from motion finds in the colour images alone, too (COLMAP, minutes;
    needs `pip install 'dsmap[sfm]'`): a reference for recordings without one, a second opinion on given poses."""
    label_map: str | None = None
    """Which classes the label images of reference or data hold, if not the 13: nyu40, scannet, or a file of ids,
    names or colours (docs/guide/labels.md)."""
    intrinsics: str | None = None
    """fx,fy,cx,cy of the reference's images [px]; before calibration.yaml and known defaults."""
    depth_scale: Scale | None = None
    """Stored depth units per metre of the reference."""


def main(args: Args) -> None:
    """Score, print the tables, write metrics.json."""
    if args.run is not None and args.data is None:
        metrics = score_run(args.run, args)
        print(run_tables(metrics))
        out = args.out or args.run / "metrics.json"
    elif args.labels is not None and args.data is not None and args.run is None:
        metrics, out = score_labels(args.labels, args.data, args), args.out
        print(labels_table(metrics))
    elif args.labels is not None:
        raise InputError("--labels is for --data: the recording with the true labels of these frames")
    elif args.data is not None and args.run is None:
        metrics, watch, with_geometry = score_network(args.data, args)
        print(network_table(metrics))
        out = args.out
        if out is not None and out.suffix != ".json":
            draw_network(out, args, watch, with_geometry)
            out = out / "metrics.json"
    else:
        raise InputError("expected either a RUN folder, or --data with images and labels")
    if out is not None:
        write_json(out, finite(metrics), indent=2)
        print(f"written: {out}")


def score_run(folder: Path, args: Args) -> dict[str, Any]:
    """The metrics of a run (see `dsmap.fusion.evaluate.run.evaluate_run`)."""
    run = load_run(folder)
    reference = recording_of(
        run, args.reference, args.label_map, parse_intrinsics(args.intrinsics), args.depth_scale
    )
    segmenter = segmenter_of(run, args) if reference.has_labels else None
    return evaluate_run(run, reference, segmenter, args.max_frames, args.sfm)


def segmenter_of(run: SavedRun, args: Args) -> Segmenter | None:
    """The segmenter that labelled a run, from its config.yaml; `weights`, `engine` and `prior` replace the run's.

    A network that needs a package which is not here, or a factory that is gone, gives None and a line of
    warning: the map's own labels can still be scored.
    """
    values: dict[str, Any] = run.settings.get("segmenter") or {"kind": "none"}
    try:
        spec = fill(SegmenterSpec(), values, f"{run.path / 'config.yaml'}: segmenter")
        if names_code(spec.kind) and args.segmenter is None:
            print(
                f"warning: the run was labelled by code, {spec.kind}; what a folder names is not run: the network is "
                f"not scored without --segmenter {spec.kind}"
            )
            return None
        if args.segmenter is not None:
            spec = dataclasses.replace(spec, kind=args.segmenter)
        if spec.kind == "dsnet" and spec.weights is args.weights is None and "prior" not in values:
            print(
                "warning: the run was labelled by a network that no longer ships, the one scored is dsnet-p"
            )
        given = {key: getattr(args, key) for key in ("weights", "engine", "prior")}
        spec = dataclasses.replace(spec, **{key: v for key, v in given.items() if v is not None})
        return make_segmenter(spec, code=args.segmenter is not None)
    except (InputError, ModuleNotFoundError, TypeError) as error:
        if args.weights is not None or args.segmenter is not None:
            raise
        print(f"warning: the run's segmenter cannot be built ({error}); the network is not scored")
        return None


def score_labels(labels: Path, data: Path, args: Args) -> dict[str, Any]:
    """Scores of the label images of one recording against those of another (see `evaluate_labels`)."""
    reference = open_sequence(data, label_map=args.label_map)
    tree = evaluate_labels(
        open_sequence(labels), reference.resized(evaluation_size(reference)), args.max_frames
    )
    return tree | {"data": str(data), "answers": str(labels)}


def score_network(data: Path, args: Args) -> tuple[dict[str, Any], Any, bool]:
    """Scores of DS-Net alone on labelled images, the `single_frame` tree of a run's metrics.

    Returns:
        The metrics, the `Watch` that noted the score of every image, and whether the network saw geometry.
    """
    from dsmap.dsnet.inference.predict import load_segmenter
    from dsmap.dsnet.scoring.measure import Watch  # with torch, which scoring a run of geometry does without

    segmenter = load_segmenter(args.weights, engine=args.engine or "auto", prior=args.prior)
    with_geometry = segmenter.wants_geometry and not args.colour_only
    watch = Watch(segmenter.predict)
    examples = labelled_images(data, with_geometry, label_map=args.label_map)
    answers = ((watch(i, example), example.label) for i, example in examples)
    tree, frames = evaluate_network(answers)
    images = [dataclasses.asdict(image) for image in watch.ranked()]
    metrics = {"single_frame": tree, "frames": frames, "data": str(data), "weights": args.weights}
    metrics |= {"prior": segmenter.info.prior, "geometry": with_geometry}
    return metrics | {"images_by_rank": images}, watch, with_geometry


def draw_network(out: Path, args: Args, watch: Any, with_geometry: bool) -> None:
    """Write reliability.png, and overlays.jpg of the best three, the median four and the worst three images."""
    from dsmap.dsnet.scoring.measure import by_rank, enlarge
    from dsmap.dsnet.scoring.pictures import Overlay, draw_overlays, draw_reliability

    assert args.data is not None
    data, ranked = args.data, watch.ranked()
    ranks = {ranked[rank].index: rank for rank in by_rank(len(ranked))}
    overlays = []
    for index, example in labelled_images(data, with_geometry, set(ranks), args.label_map):
        p = watch.predict(example.rgb, example.geometry)
        answer = (enlarge(p, example.label)[..., 1:].argmax(axis=2) + 1).astype(np.uint8)
        overlays.append(Overlay(example.rgb, example.label, answer, ranked[ranks[index]], ranks[index]))
    overlays.sort(key=lambda overlay: overlay.rank)
    draw_reliability(out / "reliability.png", watch.reliability, f"{data.name}, {len(ranked)} images")
    draw_overlays(out / "overlays.jpg", overlays, len(ranked))
    print(f"pictures: {out / 'reliability.png'} {out / 'overlays.jpg'}")


def labelled_images(
    data: Path, with_geometry: bool = False, only: set[int] | None = None, label_map: str | None = None
) -> Iterator[tuple[int, Example]]:
    """Number and content of the labelled frames of a recording, or of any data set of the 13 classes.

    Args:
        with_geometry: what depth tells as well, where there is any.
        only: numbers of the images wanted; None: all.
        label_map: how label images are read (see `open_sequence`).

    Raises:
        InputError: there are none, they are of other classes, or an image does not fit its label.
    """
    if is_tum(data):
        yield from _labelled_frames(data, with_geometry, only, label_map)
        return
    images = open_set(data, label_map)
    if images.class_names != CLASS_NAMES:
        raise InputError(f"{data}: classes are {', '.join(images.class_names)}, expected the 13 of NYUv2")
    for index, item in enumerate(tqdm(images.items, unit="image", disable=only is not None)):
        if only is None or index in only:
            yield index, item.read(with_geometry)


def _labelled_frames(
    data: Path, with_geometry: bool, only: set[int] | None, label_map: str | None
) -> Iterator[tuple[int, Example]]:
    sequence = open_sequence(data, label_map=label_map)
    if not sequence.has_labels:
        why = sequence.recording.labels_unused or "this recording has no labels"
        raise InputError(f"{data}: {why}; expected label.txt, or folders rgb/ and label/")
    for i in tqdm(sequence.labelled(), unit="image", disable=only is not None):
        frame = sequence.frame(i) if only is None or i in only else None
        if frame is None or frame.label is None:
            continue
        geometry = None
        if with_geometry:
            pose = frame.T_world_camera if is_rendered(data) else None
            geometry = DepthView.of_pose(sequence.intrinsics, pose).geometry(frame.depth, frame.label.shape)
        yield i, Example(frame.rgb, frame.label, geometry)


def finite(tree: Any) -> Any:
    """The tree with NaN and infinite numbers as None: JSON has no such numbers."""
    if isinstance(tree, dict):
        return {key: finite(value) for key, value in tree.items()}
    return None if isinstance(tree, float) and not math.isfinite(tree) else tree
