"""Pictures of a search: the best designs side by side, and how the error fell."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jaxnc.errors import InputError
from jaxnc.synthesis.function import FunctionGeneration
from jaxnc.viz.drawing import draw
from jaxnc.viz.picture import Picture, save

if TYPE_CHECKING:
    from jaxnc.synthesis.problem import Problem
    from jaxnc.synthesis.result import Design, Result
    from jaxnc.synthesis.steps import Steps

TARGET = "#c0392b"
LINE = "#2f6db3"
_CELL = 3.2  # inches wide
_HIGH = 2.7
_TITLE = 0.35
_TABLE_HIGH = 1.5  # of the plot below a design that generates a function
_MANY = 40  # targets that are drawn as a line


def gallery(result: "Result", path: str | Path | None = None, most: int = 6) -> Figure:
    """The best designs, each with what it does and what it should do.

    Args:
        result: what was found.
        path: file to write: PNG, SVG, PDF or JPG.
        most: how many designs.

    Returns:
        The figure.

    Raises:
        InputError: there is no design.
    """
    designs = result.designs[:most]
    if not designs:
        raise InputError(f"no design to draw: {result.verdict}")
    wide = min(3, len(designs))
    high = math.ceil(len(designs) / wide)
    spatial = result.problem.system.topology.dim == 3
    table = result.problem if isinstance(result.problem, FunctionGeneration) else None
    tall = _HIGH + _TITLE + (_TABLE_HIGH if table else 0.0)
    figure = Picture(figsize=(wide * _CELL, high * tall))
    FigureCanvasAgg(figure)
    title, below = _TITLE / tall, _TABLE_HIGH / tall if table else 0.0
    for k, design in enumerate(designs):
        row, column = divmod(k, wide)
        place = ((column + 0.03) / wide, 1.0 - (row + 0.97 - below) / high, 0.94 / wide, (0.97 - title - below) / high)
        ax = figure.add_axes(place, projection="3d" if spatial else None)
        if table:
            under = ((column + 0.22) / wide, 1.0 - (row + 0.89) / high, 0.7 / wide, (below - 0.13) / high)
            function(table, design, figure.add_axes(under))
        words = f"{k + 1}: error {design.error:.3g}"
        if design.type:
            words += f", {design.type}"
        sketch(result.problem, design, ax, words + (f"\n{design.defects[0]}" if design.defects else ""))
    if path is not None:
        save(figure, path, 200.0)
    return figure


def sketch(problem: "Problem", design: "Design", ax: Axes, title: str) -> None:
    """One design with what it does and what it should do."""
    motion, turn = design.motion, design.turn
    point = getattr(problem, "point", None)
    trace = (point,) if point is not None else ()
    # As it stands at the first target, whatever pose it happens to be drawn in.
    values, first = (np.asarray(m.inputs[problem.driven]) for m in (turn, motion))
    off = values - first[0]
    off = np.abs(np.angle(np.exp(1j * off)) if np.isclose(np.ptp(values), 2 * np.pi) else off)
    target = getattr(problem, "target", None) if point is not None else None
    draw(turn, int(np.argmin(off)), trace=trace, ax=ax, labels=False, frame=False, title="", room=target)
    if point is not None and target is not None:
        size = 4.2 if len(target) <= 12 else 3.2
        ax.plot(*np.asarray(target).T, "o", ms=size, mfc="none", mec=TARGET, mew=1.1, zorder=30, clip_on=False)
        ax.plot(*np.asarray(motion[point]).T, ".", ms=0.6 * size, color=TARGET, zorder=31, clip_on=False)
    ax.set_title(title, fontsize=8.5)


def function(problem: "FunctionGeneration", design: "Design", ax: Axes) -> None:
    """The output at the targets, and where it should be, against the input."""
    top = problem.system.topology
    turned = problem.driven in top.scalars and top.angles[top.scalars.index(problem.driven)]
    units = [("rad" if turned else top.length_unit), problem.unit]
    factors = [180.0 / np.pi if u == "rad" else 1.0 for u in units]
    x, y = problem.values * factors[0], problem.target * factors[1]
    found = y + design.errors.reshape(-1) / np.sqrt(problem.weights) * factors[1]
    dense = len(x) > _MANY
    name = problem.output if isinstance(problem.output, str) else "output"
    if name in top.position:  # what it does between the targets too
        turn, motion = design.turn, design.motion
        good = np.asarray(turn.converged)
        off = design.inputs[0] - problem.values[0], float(motion[name][0]) - found[0] / factors[1]
        along, out = np.asarray(turn.inputs[problem.driven]), np.asarray(turn[name])
        ax.plot((along - off[0])[good] * factors[0], (out - off[1])[good] * factors[1], color=LINE, lw=1.3)
    else:
        ax.plot(x, found, color=LINE, lw=1.3)
    ax.plot(x, y, "--" if dense else "o", color=TARGET, ms=3.2, mfc="none", mew=0.9, lw=1.0)
    for axis, text, unit in zip((ax.xaxis, ax.yaxis), (problem.driven, name), units, strict=True):
        shown = {"rad": "°", "": ""}.get(unit, f" [{unit}]")
        axis.set_label_text(f"{text}{' [°]' if shown == '°' else shown}", fontsize=7)
        axis.set_major_locator(MaxNLocator(4))
        axis.set_tick_params(labelsize=6.5, length=2.0, pad=1.5)
    ax.xaxis.labelpad = ax.yaxis.labelpad = 1.0
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)


def convergence(result: "Result", path: str | Path | None = None) -> Figure:
    """The best error, round by round.

    Args:
        result: what was found.
        path: file to write: PNG, SVG, PDF or JPG.

    Returns:
        The figure.
    """
    errors = np.array([h.error for h in result.history])
    good = np.isfinite(errors)
    if not good.any():
        raise InputError(f"no error to draw: {result.verdict}")
    figure = Figure(figsize=(5.2, 3.2), layout="constrained")
    ax = figure.add_subplot()
    least, most = errors[good].min(), errors[good].max()
    rounds = np.arange(1, len(errors) + 1)
    ax.plot(rounds[good], np.maximum(errors[good], 1e-300), ".-", drawstyle="steps-post", color=LINE, lw=1.6, ms=6)
    ax.set_yscale("log")
    ax.set_xlim(left=0.0)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    if least > 0 and most < 30.0 * least:  # so that the axis has a mark or two
        ax.set_ylim(0.2 * least, 5.0 * most)
    unit = result.problem.error_unit.replace("^2", "²")
    unit = f" [{unit}]" if unit else ""
    ax.set_xlabel("round of the refinement")
    ax.set_ylabel(f"best error{unit}")
    time = f"{result.history[-1].seconds:.0f} s"
    ax.set_title(f"{result.refined} of {result.screened} designs refined in {time}", fontsize=9)
    ax.grid(True, which="major", color="#d9d9d9", lw=0.6)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    if path is not None:
        save(figure, path, 200.0)
    return figure


def steps(history: "Steps", path: str | Path | None = None, unit: str = "") -> Figure:
    """Value and gradient of every design, step by step: each one thin, the best so far of all of them thick.

    Args:
        history: of a descent.
        path: file to write: PNG, SVG, PDF or JPG.
        unit: of the value.

    Returns:
        The figure.

    Raises:
        InputError: there is no step with a finite value.
    """
    value, gradient = np.where(history.good, history.value, np.nan), np.where(history.good, history.gradient, np.nan)
    if not np.isfinite(value).any():
        raise InputError("no value to draw: no design was good after any step")
    figure = Figure(figsize=(5.2, 4.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    along = np.arange(1, history.count + 1)
    log = np.nanmin(value) > 0
    for ax, rows, logarithmic in ((above, value, log), (below, gradient, True)):
        rows = np.where(rows > 0, rows, np.nan) if logarithmic else rows
        for lane in rows.T:
            ax.plot(along, lane, color=LINE, lw=0.6, alpha=0.35)
        filled = np.where(np.isfinite(rows), rows, np.inf)
        least = np.min(filled, axis=1) if history.random else np.minimum.accumulate(np.min(filled, axis=1))
        ax.plot(along, np.where(np.isfinite(least), least, np.nan), color=LINE, lw=1.8)
        if logarithmic:
            ax.set_yscale("log")
        ax.grid(True, which="major", color="#d9d9d9", lw=0.6)
        for side in ("top", "right"):
            ax.spines[side].set_visible(False)
    shown = unit.replace("^2", "²")
    above.set_ylabel(f"{'sample of the error' if history.random else 'error'}{f' [{shown}]' if shown else ''}")
    below.set_ylabel("projected gradient")
    below.set_xlabel("step")
    below.set_xlim(1, max(history.count, 2))
    below.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    lanes = value.shape[1]
    above.set_title(
        f"{lanes} design{'s' if lanes > 1 else ''}, {history.count} steps in {history.seconds[-1]:.3g} s, "
        f"the first after {history.seconds[0]:.3g} s",
        fontsize=9,
    )
    if path is not None:
        save(figure, path, 200.0)
    return figure
