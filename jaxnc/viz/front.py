"""Picture of a Pareto front: its designs by their objectives, and what some of them look like."""

import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jaxnc.errors import InputError
from jaxnc.viz.picture import Picture, save
from jaxnc.viz.synthesis import LINE, TARGET, sketch

if TYPE_CHECKING:
    from jaxnc.synthesis.fronts import Front

_HIGH = 3.4  # inches
_LINE = 38  # letters above a design


def plot(front: "Front", path: str | Path | None = None) -> Figure:
    """Draw a front: its designs by their objectives, and those at the ends and at the bend.

    Args:
        front: what was found.
        path: file to write: PNG, SVG, PDF or JPG.

    Returns:
        The figure; one plot for each pair of objectives.

    Raises:
        InputError: there is no design.
    """
    if not front.designs:
        raise InputError(f"no front to draw: {front.verdict}")
    shown = sorted({0, front.knee, len(front.designs) - 1})
    pairs = list(itertools.combinations(range(len(front.names)), 2))
    wide = [4.3 * len(pairs), 2.6 * len(shown)]
    figure = Picture(figsize=(sum(wide), _HIGH))
    FigureCanvasAgg(figure)
    total = sum(wide)
    for n, (i, j) in enumerate(pairs):
        ax = figure.add_axes(((4.3 * n + 0.75) / total, 0.17, 3.35 / total, 0.74))
        _pair(front, ax, i, j, shown)
    spatial = front.problem.system.topology.dim == 3
    for n, k in enumerate(shown):
        left = (wide[0] + 2.6 * n) / total
        ax = figure.add_axes((left, 0.08, 2.45 / total, 0.8), projection="3d" if spatial else None)
        each = [f"{name} {v:.3g}" for name, v in zip(front.names, front.values[k], strict=True)]
        words = f"{_letter(n)}: {', '.join(each)}"
        sketch(front.problem, front.designs[k], ax, words if len(words) <= _LINE else words.replace(", ", ",\n"))
    if path is not None:
        save(figure, path, 200.0)
    return figure


def _letter(n: int) -> str:
    return "abc"[n]


def _pair(front: "Front", ax: Axes, i: int, j: int, shown: list[int]) -> None:
    x, y = front.values[:, i], front.values[:, j]
    if len(front.names) == 2:
        ax.plot(x, y, "-", color=LINE, lw=1.0, alpha=0.5)
    ax.plot(x, y, "o", ms=4.5, color=LINE)
    for n, k in enumerate(shown):
        ax.plot(x[k], y[k], "o", ms=7.5, mfc="none", mec=TARGET, mew=1.3)
        ax.annotate(_letter(n), (x[k], y[k]), (7, 6), textcoords="offset points", fontsize=9, color=TARGET)
    ax.set_xlabel(front.names[i])
    ax.set_ylabel(front.names[j])
    ax.margins(0.09)
    if len(x) > 1 and np.ptp(x) > 0:
        ax.ticklabel_format(style="sci", scilimits=(-3, 4))
    ax.grid(True, which="major", color="#d9d9d9", lw=0.6)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
