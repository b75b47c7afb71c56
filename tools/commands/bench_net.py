"""`dsmap bench-net`: how fast the network runs, and which way of running it is the fastest that is still right."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dsmap.errors import InputError


@dataclass
class Args:
    """What to time."""

    weights: Path | None = None
    """Weights of an RGB DS-Net (safetensors); default: those that come with dsmap."""
    size: tuple[int, int] = (448, 448)
    """Width and height of the images [px], multiples of 32."""
    data: Path | None = None
    """Labelled images to compare answers on, PATH or PATH@SPLIT; default: drawn patterns."""
    images: int = 8
    """Number of images compared, evenly spread over the data."""
    rounds: int = 9
    """Rounds in which every contender has its turn."""
    repeats: int = 5
    """Timed calls a turn."""


def main(args: Args) -> None:
    """Print the table of contenders."""
    import torch

    from dsmap.dsnet.checkpoint import load_weights
    from dsmap.dsnet.inference.compare_engines import race

    if min(args.images, args.rounds, args.repeats) < 1 or any(s < 32 or s % 32 for s in args.size):
        raise InputError("expected --images, --rounds and --repeats of at least 1, --size of multiples of 32")
    model, info = load_weights(args.weights or "dsnet", None)
    if info.config.channels != 3:
        raise InputError(f"{args.weights}: a network of RGB-D, expected one of RGB")
    pictures = _patterns(args) if args.data is None else _of_data(args)
    print(
        f"{args.weights or 'shipped weights'}, batch of one at {args.size[0]}x{args.size[1]}, "
        f"{torch.get_num_threads()} threads, {len(pictures)} images compared, {args.rounds} rounds"
    )
    print(table(race(model, info, pictures, rounds=args.rounds, repeats=args.repeats)))


def table(results: list) -> str:
    """Contenders with their milliseconds, their ratio to the first, and their differences from it."""
    width = max(len(result.name) for result in results)
    lines = [f"{'':<{width}}      ms  times  largest difference  where decided  pixels > 0.01"]
    reference = np.array(results[0].milliseconds)
    speed = {r.name: float(np.median(reference / r.milliseconds)) for r in results if not r.error}
    for r in results:
        if r.error:
            lines.append(f"{r.name:<{width}}  not run: {r.error}")
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
    return "\n".join(lines)


def _of_data(args: Args) -> list[np.ndarray]:
    from dsmap.dsnet.datasets.registry import open_set
    from dsmap.sequences.images import resize_colour

    items = open_set(args.data or "").items
    chosen = np.unique(np.linspace(0, len(items) - 1, args.images).astype(int))
    return [np.ascontiguousarray(resize_colour(items[i].read().rgb, *args.size)) for i in chosen]


def _patterns(args: Args) -> list[np.ndarray]:
    """Noise of many scales: something everywhere, flat nowhere."""
    import cv2

    rng = np.random.default_rng(0)
    pictures = []
    for _ in range(args.images):
        total = np.zeros((args.size[1], args.size[0], 3), np.float32)
        for cells in (4, 16, 64, 256):
            noise = rng.normal(size=(cells, cells, 3)).astype(np.float32)
            total += cv2.resize(noise, args.size, interpolation=cv2.INTER_CUBIC) * 60 / cells**0.25
        pictures.append(np.clip(total + 127.5, 0, 255).astype(np.uint8))
    return pictures
