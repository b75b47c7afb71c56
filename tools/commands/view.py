"""`dsmap view`: a run in the browser, over SSH as well, or the same views as pictures."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from dsmap.errors import InputError
from dsmap.fusion.exports.ply import read_ply, surfels_of_ply, up_of_ply
from dsmap.fusion.objects.files import NamedBox, read_boxes
from dsmap.ranges import Range
from dsmap.sequences.associate import pose_matrix
from dsmap.sequences.pose_lists import read_poses


@dataclass
class Args:
    run: tyro.conf.Positional[Path]
    """RUN folder that `dsmap map` wrote."""
    png: Path | None = None
    """Write the views as pictures into this folder instead of serving them."""
    port: Annotated[int, Range(1, 65_535)] = 8080
    """Port of the viewer; the next free one is taken if it is in use."""
    host: str = "127.0.0.1"
    """Address to listen on. The default is reached from this machine only (or through SSH); 0.0.0.0 lets
    everybody in the network look who knows the whole address, its secret included."""
    max_points: Annotated[int, Range(1, 1_000_000_000)] = 1_500_000
    """Send at most this many points to the browser; a larger map is thinned out evenly."""
    min_confidence: Annotated[float, Range(0, 1e9)] = 10.0
    """Show surfels of at least this confidence at first (all, if that would leave out most of the map)."""
    boxes: bool = True
    """Draw the boxes and names of the things of objects.json; in the browser there is a switch for each."""


def main(args: Args) -> int:
    """Show a run; returns when interrupted."""
    if not 1 <= args.port <= 65535:
        raise InputError(f"--port is {args.port}; expected 1 to 65535")
    if args.max_points < 1:
        raise InputError(f"--max-points is {args.max_points}; expected at least 1")
    arrays, poses, up = read_run(args.run)
    boxes = read_boxes(args.run) if args.boxes else []
    if args.png is not None:
        return _draw(args, arrays, poses, up, boxes)
    from dsmap.tools.support.viewer import Cloud, MapViewer

    cloud = Cloud(arrays, args.max_points)
    viewer = MapViewer(
        cloud, poses, args.min_confidence, args.host, args.port, args.run.resolve().name, up=up, things=boxes
    )
    port = viewer.server.get_port()
    print(f"{args.run}: {len(arrays['weight']):,} surfels, {len(cloud):,} of them sent to the browser")
    print(f"open {viewer.address}   (Ctrl-C ends)")
    print(f"over SSH, first run on your own machine: ssh -L {port}:localhost:{port} <this host>", flush=True)
    try:
        while True:
            time.sleep(3600)
    except KeyboardInterrupt:
        viewer.server.stop()
    return 0


def read_run(run: Path) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray | None]:
    """The surfels, the poses (M, 4, 4) and, where the map says it, up (3,) of a RUN folder.

    Raises:
        InputError: it is not a RUN folder, or its map has no surfel.
    """
    for name in ("map.ply", "trajectory.txt"):
        if not (run / name).is_file():
            raise InputError(f"{run} has no {name}; expected a RUN folder written by `dsmap map`")
    arrays = surfels_of_ply(read_ply(run / "map.ply"), run / "map.ply")
    if len(arrays["weight"]) == 0:
        raise InputError(f"{run / 'map.ply'} holds no surfels; there is nothing to show")
    _, vectors = read_poses(run / "trajectory.txt", [])
    poses = np.array([pose_matrix(vector) for vector in vectors]).reshape(-1, 4, 4)
    return arrays, poses, up_of_ply(run / "map.ply")


def _draw(
    args: Args, arrays: dict[str, np.ndarray], poses: np.ndarray, up: np.ndarray | None, boxes: list[NamedBox]
) -> int:
    from dsmap.fusion.pictures.pictures import write_views
    from dsmap.kernels.types import SurfelMap

    assert args.png is not None
    surfels = SurfelMap.empty("cpu", len(arrays["weight"]))
    surfels.count = len(arrays["weight"])
    target = surfels.numpy()
    for name, values in arrays.items():
        target[name][:] = values
    for path in write_views(args.png, surfels, poses, args.min_confidence, up, boxes):
        print(path)
    return 0
