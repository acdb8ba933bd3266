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
from jaxnc.viz.style import FOUND, TARGET, TEXT, furnish, named
from jaxnc.viz.synthesis import sketch

if TYPE_CHECKING:
    from jaxnc.synthesis.search.fronts import Front

_HIGH = 3.4  # inches
_PLOT, _DESIGN = 4.3, 2.7  # inches wide
_LINE = 36  # letters above a design
_NOTHING = 1e-7  # of the largest value: what is smaller is met, and no matter of decades
_SPREAD = 30.0  # from the least value to the largest, from where an axis is logarithmic


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
    rows = 1 if len(pairs) == 1 else 2  # the designs beside one plot, below several
    wide = [_PLOT * len(pairs), _DESIGN * len(shown)]
    width = sum(wide) if rows == 1 else max(wide)
    figure = Picture(figsize=(width, rows * _HIGH))
    FigureCanvasAgg(figure)
    for n, (i, j) in enumerate(pairs):
        left, low = _PLOT * n + 0.8, rows - 1 + 0.17
        _pair(front, figure.add_axes((left / width, low / rows, (_PLOT - 1.0) / width, 0.74 / rows)), i, j, shown)
    spatial = front.problem.system.topology.dim == 3
    for n, k in enumerate(shown):
        left = wide[0] + _DESIGN * n if rows == 1 else (n + 0.5) * width / len(shown) - 0.5 * _DESIGN
        place = (left / width, 0.05 / rows, (_DESIGN - 0.15) / width, 0.78 / rows)
        ax = figure.add_axes(place, projection="3d" if spatial else None)
        each = [f"{name} {v:.3g}" for name, v in zip(front.names, front.values[k], strict=True)]
        words = f"{_letter(n)}: {', '.join(each)}"
        sketch(front.problem, front.designs[k], ax, words if len(words) <= _LINE else words.replace(", ", ",\n"))
    if path is not None:
        save(figure, path, 200.0)
    return figure


def _named(front: "Front", k: int) -> str:
    """An objective with its unit, where it is known: of the problem's error, whose root is what a front holds."""
    unit = front.problem.error_unit
    return named(front.names[k], unit.removesuffix("^2") if k == 0 and unit.endswith("^2") else "")


def _letter(n: int) -> str:
    return "abc"[n]


def _pair(front: "Front", ax: Axes, i: int, j: int, shown: list[int]) -> None:
    x, y = front.values[:, i], front.values[:, j]
    if len(front.names) == 2:
        ax.plot(x, y, "-", color=FOUND, lw=1.0, alpha=0.5)
    ax.plot(x, y, "o", ms=4.5, color=FOUND)
    for n, k in enumerate(shown):
        ax.plot(x[k], y[k], "o", ms=7.5, mfc="none", mec=TARGET, mew=1.3)
        ax.annotate(_letter(n), (x[k], y[k]), (7, 6), textcoords="offset points", fontsize=TEXT, color=TARGET)
    furnish(ax)
    ax.set_xlabel(_named(front, i))
    ax.set_ylabel(_named(front, j))
    ax.margins(0.09)
    for name, values in (("x", x), ("y", y)):
        if values.min() > _NOTHING * values.max() and values.max() > _SPREAD * values.min():
            ax.set(**{f"{name}scale": "log"})
        elif np.ptp(values) > 0:
            ax.ticklabel_format(axis="x" if name == "x" else "y", style="sci", scilimits=(-3, 4))
