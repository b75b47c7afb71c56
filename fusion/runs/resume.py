"""A mapper that goes on where a checkpoint stopped, or that starts a new recording in its map."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from dsmap.errors import InputError
from dsmap.frame import Intrinsics
from dsmap.fusion.config import MapConfig
from dsmap.fusion.mapper import Mapper
from dsmap.fusion.segmenter import Segmenter
from dsmap.fusion.trajectory import Trajectory
from dsmap.kernels.types import SurfelMap
from dsmap.reading import DECODER_ERRORS, reason


def resumed_mapper(
    surfels: SurfelMap,
    meta: dict[str, Any],
    where: str,
    intrinsics: Intrinsics,
    segmenter: Segmenter | None = None,
    config: MapConfig | None = None,
) -> Mapper:
    """The mapper that was saved, as it stopped: it goes on bit for bit.

    Args:
        surfels, meta: of `checkpoint.load_map`, the surfels on the configured device.
        where: the file, for messages.
        config: None: the saved one.

    Raises:
        InputError: the checkpoint lacks a part of the state, or its images have another size.
    """
    mapper = Mapper(config or meta["config"], intrinsics, segmenter, surfels=surfels)
    with _must_fit(where):
        mapper.load_state(_state(meta), _trajectory(meta))
    return mapper


def mapper_in_saved_map(
    surfels: SurfelMap,
    meta: dict[str, Any],
    where: str,
    intrinsics: Intrinsics,
    segmenter: Segmenter | None = None,
    config: MapConfig | None = None,
    frozen: bool = False,
) -> Mapper:
    """A mapper whose first frame has to be found in a saved map by the keyframes; see `Mapper.start_in_saved_map`.

    Args:
        frozen: leave the map as it is; else it grows by what is new.

    Raises:
        InputError: the map has no keyframes, they were taken with a camera of another shape, or the file is damaged.
    """
    mapper = Mapper(config or meta["config"], intrinsics, segmenter, surfels=surfels, frozen=frozen)
    with _must_fit(where):
        mapper.start_in_saved_map(_state(meta), _trajectory(meta), where)
    return mapper


def _state(meta: dict[str, Any]) -> dict[str, Any]:
    return meta["arrays"] | meta["plain"]


def _trajectory(meta: dict[str, Any]) -> Trajectory:
    return Trajectory.of_arrays(meta["times"], meta["poses"], meta["tracked"], meta["depth_times"])


@contextmanager
def _must_fit(where: str) -> Iterator[None]:
    """What goes wrong inside is the fault of the checkpoint."""
    try:
        yield
    except DECODER_ERRORS as error:
        raise InputError(
            f"{where}: does not fit ({reason(error)}); expected a whole dsmap checkpoint"
        ) from error
