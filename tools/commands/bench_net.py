"""`dsmap bench-net`: how fast the network runs, and which way of running it is the fastest that is still right."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from dsmap.dsnet.config import GEOMETRY_CHANNELS
from dsmap.errors import InputError
from dsmap.ranges import Range


@dataclass
class Args:
    """What to time."""

    weights: str = "dsnet-p"
    """Weights of a DS-Net or dsnet-p: a file, or the name of some that ship. Beside others, dsnet is timed, too."""
    size: Annotated[tuple[int, int], Range(32, 4096, length=2)] = (320, 256)
    """Width and height of the images [px], multiples of 32."""
    data: Path | None = None
    """Labelled images to compare answers on, PATH or PATH@SPLIT; default: drawn patterns."""
    images: Annotated[int, Range(1, 1_000_000)] = 8
    """Number of images compared, evenly spread over the data."""
    rounds: Annotated[int, Range(1, 100_000)] = 9
    """Rounds in which every contender has its turn."""
    repeats: Annotated[int, Range(1, 100_000)] = 5
    """Timed calls a turn."""


def main(args: Args) -> None:
    """Print the table of contenders."""
    import torch

    from dsmap.dsnet.checkpoint import load_weights
    from dsmap.dsnet.inference.compare_engines import race

    if min(args.images, args.rounds, args.repeats) < 1 or any(s < 32 or s % 32 for s in args.size):
        raise InputError("expected --images, --rounds and --repeats of at least 1, --size of multiples of 32")
    model, info = load_weights(args.weights, None)
    samples = _patterns(args) if args.data is None else _of_data(args)
    if info.config.channels == 3:
        samples = [sample[:1] for sample in samples]
    rival = load_weights("dsnet") if args.weights != "dsnet" else None
    print(
        f"{args.weights}, batch of one at {args.size[0]}x{args.size[1]}, "
        f"{torch.get_num_threads()} threads, {len(samples)} images compared, {args.rounds} rounds"
    )
    print(net_table(race(model, info, samples, rounds=args.rounds, repeats=args.repeats, rival=rival)))


def net_table(results: list) -> str:
    """Contenders with their milliseconds, their ratio to the first, and their differences from it."""
    width = max(len(result.name) for result in results)
    lines = [f"{'':<{width}}      ms  times  largest difference  where decided  pixels > 0.01"]
    reference = np.array(results[0].milliseconds)
    speed = {r.name: float(np.median(reference / r.milliseconds)) for r in results if not r.error}
    for r in results:
        if r.error:
            lines.append(f"{r.name:<{width}}  not run: {r.error}")
            continue
        if not r.compared:
            lines.append(f"{r.name:<{width}}  {r.median:6.1f}  {speed[r.name]:5.2f}")
            continue
        note = "" if r.equal else "  too far off"
        lines.append(
            f"{r.name:<{width}}  {r.median:6.1f}  {speed[r.name]:5.2f}  {r.difference:18.1e}  {r.decided:13.1e}"
            f"  {r.beyond:13.1e}{note}"
        )
    best = max((r for r in results if r.equal), key=lambda r: speed[r.name])
    lines.append(
        f"fastest within 0.01: {best.name}, {best.median:.1f} ms, {speed[best.name]:.2f} times as fast"
    )
    lines.append(
        f"{results[0].chance:.2%} of the pixels hang on rounding (ties of max-pooling) and decide nothing"
    )
    for r in results:
        if not (r.compared or r.error):
            ratio = float(np.median(np.array(best.milliseconds) / r.milliseconds))
            lines.append(f"{best.name} takes {ratio:.2f} times as long as {r.name}")
    return "\n".join(lines)


def _of_data(args: Args) -> list[tuple[np.ndarray, ...]]:
    from dsmap.dsnet.datasets.registry import open_set
    from dsmap.sequences.images import resize_colour, resize_nearest

    items = open_set(args.data or "").items
    samples = []
    for i in np.unique(np.linspace(0, len(items) - 1, args.images).astype(int)):
        example = items[i].read()
        rgb = np.ascontiguousarray(resize_colour(example.rgb, *args.size))
        geometry = np.zeros((*rgb.shape[:2], GEOMETRY_CHANNELS), np.float32)
        if example.geometry is not None:
            geometry[:] = resize_nearest(example.geometry, *args.size)
        samples.append((rgb[None], geometry[None]))
    return samples


def _patterns(args: Args) -> list[tuple[np.ndarray, ...]]:
    """Noise of many scales: something everywhere, flat nowhere."""
    import cv2

    rng = np.random.default_rng(0)
    samples = []
    for _ in range(args.images):
        total = np.zeros((args.size[1], args.size[0], 3 + GEOMETRY_CHANNELS), np.float32)
        for cells in (4, 16, 64, 256):
            noise = rng.normal(size=(cells, cells, total.shape[2])).astype(np.float32)
            total += cv2.resize(noise, args.size, interpolation=cv2.INTER_CUBIC) * 60 / cells**0.25
        rgb = np.clip(total[..., :3] + 127.5, 0, 255).astype(np.uint8)
        geometry = total[..., 3:] / 60
        geometry[..., 3] = geometry[..., 3] > -0.5
        geometry *= geometry[..., 3:]
        samples.append((rgb[None], np.ascontiguousarray(geometry[None])))
    return samples
