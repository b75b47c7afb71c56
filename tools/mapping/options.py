"""The options of `dsmap map`, and the same options as the plain values of a configuration file or a checkpoint."""

import dataclasses
import typing
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from dsmap.config_file import field_docs, fill
from dsmap.errors import InputError
from dsmap.fusion.config import MapConfig
from dsmap.ranges import Every, Frames, Scale
from dsmap.tools.mapping.segmenters import SegmenterSpec
from dsmap.tools.mapping.spelling import todays_spelling


@dataclass
class Args:
    """Options of `dsmap map`: what to do, which frames, what labels them, and every parameter of mapping."""

    path: tyro.conf.Positional[Path]
    """The recording: a folder, or a file as cameras leave it (docs/guide/recordings.md)."""
    out: Path
    """RUN folder to write."""
    config: str | None = None
    """Parameters of a data set: a YAML file, or a name: default, tum_fr1, ... (flags come before it)."""
    write_config: Path | None = None
    """Write all parameters, those of --config and of flags included, into this YAML file, and map nothing."""
    overwrite: bool = False
    """Replace the files of an existing RUN."""
    checkpoint_every: Frames = 0
    """Write the checkpoint after every n-th frame, once five are tracked, so that a crash loses no more; 0: only at
    the end."""
    resume: bool = False
    """Go on with RUN where its checkpoint stopped, with its own parameters; the result is the same bit for bit."""
    localize_in: Path | None = None
    """Track in the saved map of this RUN (or checkpoint) without changing it; poses are in its world."""
    extend: bool = False
    """With --localize-in: go on mapping in it; the result is written to --out."""
    realtime: bool = False
    """Play the recording at its own speed, as if its camera were here, and keep up with it: images are made smaller
    unless --size says how large, frames that come too fast are dropped, and latency is told."""
    save_probabilities: bool = False
    """Add the 13 class probabilities to map.ply."""
    refine: Literal["none", "segments", "crf"] = "segments"
    """Let the labels agree with the shape of the map once all frames are mapped, as `dsmap refine --method` does."""
    objects: bool = True
    """Write objects.json and scene_graph.json, the things of the map with boxes."""
    pictures: bool = True
    """Draw the pictures."""
    view: bool = False
    """Serve a page that shows the map growing; its address is printed (see `dsmap live`)."""
    size: str | None = None
    """Resize frames to WIDTHxHEIGHT first, e.g. 320x240."""
    start: Frames = 0
    """Begin at this frame (after association)."""
    stop: Frames | None = None
    """Stop before this frame."""
    stride: Every = 1
    """Take every n-th frame."""
    intrinsics: str | None = None
    """fx,fy,cx,cy of the recording's own images [px]; before calibration.yaml and known defaults."""
    depth_scale: Scale | None = None
    """Stored depth units per metre, e.g. 1000 or 5000."""
    color_topic: str | None = None
    """Topic of the colour images of a bag; without it dsmap looks for one."""
    depth_topic: str | None = None
    """Topic of the depth images of a bag; without it dsmap looks for one."""
    undistort: bool = True
    """Remove lens distortion, where the calibration has one."""
    pose_convention: str | None = None
    """How the recording's poses are written, if not camera-to-world in metres with x right, y down, z forward:
    world-to-camera, opengl or ros (axes), wxyz, millimetres or centimetres; several joined by commas."""
    label_map: str | None = None
    """Which classes the recording's label images hold, if not the 13: nyu40, scannet, or a file of ids, names or
    colours (docs/guide/labels.md)."""
    spec: Annotated[SegmenterSpec, tyro.conf.arg(name="")] = field(default_factory=SegmenterSpec)
    map: Annotated[MapConfig, tyro.conf.arg(name="")] = field(
        default_factory=lambda: MapConfig(device="auto")
    )


PARTS = ("spec", "map")
"""Fields of Args whose own fields are options beside the others, without a prefix."""
_RENAMED = {("spec", "kind"): "segmenter"}
"""(part, field) -> the option that it is."""
OF_A_CALL = (
    *("path", "out", "config", "write_config", "overwrite", "resume"),
    *("localize_in", "extend", "checkpoint_every", "view", "realtime"),
)  # fmt: skip
"""Options that say what to do, not how: a configuration file cannot set them."""


@dataclass(frozen=True)
class Option:
    """One option: a flag of the command line, a parameter of a configuration file."""

    name: str
    """As in a configuration file, groups with a dot: `track.w_rgb`."""
    value: Any
    hint: Any
    """Its type."""
    doc: str
    """What it means, in one paragraph."""

    @property
    def flag(self) -> str:
        return "--" + self.name.replace("_", "-")


def options_of(args: Any, prefix: str = "", part: str = "") -> Iterator[Option]:
    """Every option of an Args (or of a dataclass inside it), in the order in which they are written down."""
    docs, hints = field_docs(type(args)), typing.get_type_hints(type(args))
    for one in dataclasses.fields(args):
        value = getattr(args, one.name)
        if dataclasses.is_dataclass(value):
            inner = prefix if one.name in PARTS else f"{prefix}{one.name}."
            yield from options_of(value, inner, one.name)
        else:
            name = _RENAMED.get((part, one.name), one.name)
            yield Option(prefix + name, value, hints[one.name], docs.get(one.name, ""))


def plain_values(args: Args) -> dict[str, Any]:
    """All options as they stand in a configuration file: groups are dicts, paths are text."""
    values: dict[str, Any] = {}
    for option in options_of(args):
        group, _, name = option.name.rpartition(".")
        into = values.setdefault(group, {}) if group else values
        into[name] = str(option.value) if isinstance(option.value, Path) else option.value
    return values


def with_values(args: Args, values: dict[str, Any], where: str) -> Args:
    """A copy of the options with those of a configuration file or a checkpoint, of earlier versions too.

    Raises:
        InputError: an unknown option, or a value of the wrong type; `where` names the file.
    """
    owner: dict[str, tuple[str, str]] = {}
    for one in dataclasses.fields(args):
        if one.name not in PARTS:
            owner[one.name] = ("", one.name)
            continue
        for inner in dataclasses.fields(getattr(args, one.name)):
            owner[_RENAMED.get((one.name, inner.name), inner.name)] = (one.name, inner.name)
    found: dict[str, dict[str, Any]] = {"": {}, **{part: {} for part in PARTS}}
    for name, value in todays_spelling(values, where).items():
        if name not in owner:
            raise InputError(f"{where}: unknown parameter {name!r}; expected one of {', '.join(owner)}")
        part, own_name = owner[name]
        found[part][own_name] = value
    parts = {part: fill(getattr(args, part), found[part], where) for part in PARTS}
    return dataclasses.replace(fill(args, found[""], where), **parts)
