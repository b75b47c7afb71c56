"""Plots in the manner of the paper's figures."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from dsmap.files import atomic_path

Curve = Sequence[tuple[float, float]]
"""Points (x, y)."""


def plot_curves(
    path: Path, curves: Mapping[str, Sequence[Curve]], xlabel: str, ylabel: str, title: str
) -> None:
    """One line a name: the mean of its curves (equal x), and a band from the lowest to the highest."""
    figure, axes = _figure()
    for name, repeated in curves.items():
        xs = [x for x, _ in repeated[0]]
        columns = list(zip(*[[y for _, y in curve] for curve in repeated], strict=True))
        (line,) = axes.plot(xs, [sum(ys) / len(ys) for ys in columns], marker=".", label=name)
        if len(repeated) > 1:
            low, high = [min(ys) for ys in columns], [max(ys) for ys in columns]
            axes.fill_between(xs, low, high, color=line.get_color(), alpha=0.2, linewidth=0)
    axes.set(xlabel=xlabel, ylabel=ylabel, title=title)
    axes.grid(alpha=0.3)
    axes.legend()
    _save(figure, path)


def plot_bars(path: Path, groups: Mapping[str, Mapping[str, float]], ylabel: str, title: str) -> None:
    """Bars side by side: group (a colour) to name (a place) to height."""
    figure, axes = _figure()
    names = list(dict.fromkeys(name for bars in groups.values() for name in bars))
    width = 0.8 / len(groups)
    for k, (group, bars) in enumerate(groups.items()):
        places = [names.index(name) + (k - (len(groups) - 1) / 2) * width for name in bars]
        axes.bar(places, list(bars.values()), width, label=group)
    axes.set_xticks(range(len(names)), names, rotation=45 if len(names) > 5 else 0, fontsize=8)
    axes.set(ylabel=ylabel, title=title)
    axes.grid(axis="y", alpha=0.3)
    axes.legend(fontsize=8)
    _save(figure, path)


def _figure():
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 4), layout="constrained")  # no pyplot: nothing global, no display
    return figure, figure.subplots()


def _save(figure, path: Path) -> None:
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=100, metadata={"Software": None})
