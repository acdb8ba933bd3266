"""Pictures of synthesis: the best designs, how the error fell, Pareto fronts, and Burmester's curves."""

import itertools
import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.synthesis.function import FunctionGeneration
from jaxnc.types import ArrayLike
from jaxnc.viz.drawing import draw
from jaxnc.viz.picture import Picture, Size, finish, inches
from jaxnc.viz.style import BODIES, FOUND, LIGHT, LINES, NUMBERS, TARGET, TEXT, axis_name, crown, furnish, symbol

if TYPE_CHECKING:
    from jaxnc.synthesis.design import Design
    from jaxnc.synthesis.exact.burmester import BurmesterCurves
    from jaxnc.synthesis.problem import Problem
    from jaxnc.synthesis.result import Result, Steps
    from jaxnc.synthesis.search.fronts import Front
    from jaxnc.synthesis.tracing.trace import TraceResult

_CELL = 3.2  # inches wide
_TITLE, _KEY = 0.42, 0.26  # inches: of a heading, of what the marks mean
_LINE, _LETTERS = 0.14, 54  # of the lengths of links: inches high, letters wide
_FRONT_PLOT, _FRONT_DESIGN = 4.3, 2.7  # inches wide
_HEADING = 36  # letters above a design


def gallery(result: "Result", path: str | Path | None = None, most: int = 6) -> Figure:
    """Draw the best designs, each with what it does and what it should do, its scale and the lengths of its links.

    Args:
        result: what was found.
        path: file to write: PNG, SVG, PDF or JPG.
        most: how many designs.

    Raises:
        InputError: there is no design.
    """
    designs = result.designs[:most]
    if not designs:
        raise InputError(f"no design to draw: {result.verdict}")
    spatial = result.problem.system.topology.dim == 3
    table = result.problem if isinstance(result.problem, FunctionGeneration) else None
    words = [lengths(design) for design in designs]
    lines_high = _LINE * max(text.count("\n") + 1 if text else 0 for text in words) + 0.08
    below = 1.75 if table else 0.0  # inches of the plot below a design that generates a function
    drawn = _CELL * tallness(designs)
    tall = _TITLE + drawn + lines_high + below
    key = _KEY if _targets_of(result.problem) is not None else 0.0
    cells = _Cells(len(designs), tall, key)
    figure = cells.figure
    for k, (design, text) in enumerate(zip(designs, words, strict=True)):
        at = cells.place(k, 0.08, lines_high + below, _CELL - 0.16, drawn)
        ax = figure.add_axes(at, projection="3d" if spatial else None)
        if table:
            below_it = cells.place(k, 0.66, lines_high + 0.45, _CELL - 0.8, below - 0.55)
            function(table, design, figure.add_axes(below_it))
        error = "exact" if design.exact else f"error {design.error:.3g}{unit_of(result.problem)}"
        heading = f"{k + 1}: {error}"
        if design.type:
            heading += f", {design.type}"
        draw_design(result.problem, design, ax, heading + (f"\n{design.defects[0]}" if design.defects else ""))
        x, y, *_ = cells.place(k, 0.1, lines_high - 0.03, 0.0, 0.0)
        figure.text(x, y, text, va="top", fontsize=NUMBERS - 1, color=LIGHT["ink"], parse_math=False, gid="lengths")
    if key:  # what the marks of targets mean, below everything
        wanted = Line2D([], [], color=TARGET, ls="", marker="o", ms=4.2, mfc="none", mew=1.1, label="asked for")
        got = Line2D([], [], color=TARGET, ls="", marker=".", ms=3.5, label="reached")
        figure.legend(
            handles=[wanted, got], loc="lower right", ncols=2, frameon=False, fontsize=NUMBERS, borderaxespad=0.1,
            handletextpad=0.3,
        )  # fmt: skip
    return finish(figure, path)


def traces(result: "TraceResult", path: str | Path | None = None, most: int = 6) -> Figure:
    """Draw the linkages that trace a curve best, each over the curve that was asked for.

    Args:
        result: what was found.
        path: file to write: PNG, SVG, PDF or JPG.
        most: how many linkages.

    Raises:
        InputError: there is no linkage.
    """
    designs = result.designs[:most]
    if not designs:
        raise InputError("no linkage to draw: none that was found meets the conditions")
    cells = _Cells(len(designs), _CELL + _TITLE)
    line = np.vstack([result.points, result.points[:1]]) if result.closed else result.points
    for k, design in enumerate(designs):
        ax = cells.figure.add_axes(cells.place(k, 0.02 * _CELL, 0.04 * _CELL, 0.96 * _CELL, 0.96 * _CELL))
        heading = f"{k + 1}: {'meets all points' if design.exact else f'distance {design.distance:.2g}'}, {design.name}"
        motion = design.move(91)
        heading = textwrap.shorten(heading, 2 * _HEADING)
        draw(motion, 12, trace=["P"], ax=ax, title=heading, labels=False, room=line, frame="scale")
        ax.plot(*line.T, color=TARGET, lw=1.1, ls=(0, (1, 1.6)), zorder=0.5)
    return finish(cells.figure, path)


class _Cells:
    """A figure of cells in rows, one for each design, above room for a key, inches."""

    def __init__(self, count: int, tall: float, key: float = 0.0):
        self.wide, self.tall, self.key = abreast(count, 3), tall, key
        self.figure = Picture(figsize=(self.wide * _CELL, math.ceil(count / self.wide) * tall + key))

    def place(self, k: int, left: float, bottom: float, w: float, h: float) -> tuple[float, float, float, float]:
        """Bring inches from the lower left corner of a cell to shares of the figure."""
        row, column = divmod(k, self.wide)
        width, height = self.figure.get_size_inches()
        return (
            (column * _CELL + left) / width,
            (height - (row + 1) * self.tall + bottom) / height,
            w / width,
            h / height,
        )


def abreast(count: int, usual: int) -> int:
    """Choose how many of some pictures stand side by side: about as many as is usual, with few empty places."""
    if count <= usual:
        return count
    return min(range(max(usual - 1, 2), usual + 1), key=lambda n: -count % n + 1.1 * (usual - n))


def unit_of(problem: "Problem") -> str:
    """Write the unit of its error, after a space."""
    unit = problem.error_unit.replace("^2", "²")
    return f" {unit}" if unit else ""


def tallness(designs: "Sequence[Design]") -> float:
    """Choose the height of the drawings of designs in widths, so that the tallest has room."""
    if designs[0].system.topology.dim == 3:
        return 0.85
    sizes = [np.asarray(design.size, dtype=float)[:2] for design in designs]
    ratios = [(h + 0.3 * max(w, h)) / (w + 0.3 * max(w, h)) for w, h in sizes if max(w, h) > 0]
    return float(np.clip(max(ratios, default=0.8), 0.5, 0.95))


def lengths(design: "Design") -> str:
    """Write the lengths of the links of a design, in a few lines."""
    unit = design.system.topology.length_unit
    each = [f"{name} {value:.4g}".replace(" ", "\N{NO-BREAK SPACE}") for name, value in design.lengths.items()]
    text = f"{', '.join(each)}{f' {unit}' if unit else ''}" if each else ""
    lines = textwrap.wrap(text, _LETTERS, max_lines=4, placeholder=" …", break_on_hyphens=False)
    return "\n".join(lines)


def _targets_of(problem: "Problem") -> np.ndarray | None:
    """Find the places that a point should reach, if that is what is asked for."""
    target = getattr(problem, "target", None)
    return None if getattr(problem, "point", None) is None or target is None else np.asarray(target)


def draw_design(problem: "Problem", design: "Design", ax: Axes, title: str) -> None:
    """Draw a design with what it does and what it should do."""
    motion, turn = design.motion, design.turn
    point = getattr(problem, "point", None)
    trace = (point,) if point is not None else ()
    # As it stands at the first target, whatever pose it happens to be drawn in.
    values, first = (np.asarray(m.inputs[problem.driven]) for m in (turn, motion))
    off = values - first[0]
    off = np.abs(np.angle(np.exp(1j * off)) if np.isclose(np.ptp(values), 2 * np.pi) else off)
    target = _targets_of(problem)
    draw(turn, int(np.argmin(off)), trace=trace, ax=ax, labels=False, frame="scale", title="", room=target)
    if point is not None and target is not None:
        size = 4.2 if len(target) <= 12 else 3.2
        ax.plot(*target.T, "o", ms=size, mfc="none", mec=TARGET, mew=1.1, zorder=30, clip_on=False)
        ax.plot(*np.asarray(motion[point]).T, ".", ms=0.6 * size, color=TARGET, zorder=31, clip_on=False)
    ax.set_title(title, loc="left", fontsize=TEXT, color=LIGHT["ink"], parse_math=False)


def function(problem: "FunctionGeneration", design: "Design", ax: Axes) -> None:
    """Draw the output at the targets, and where it should be, against the input."""
    top = problem.system.topology
    turned = top.is_angle(problem.driven)
    units = [("rad" if turned else top.length_unit), problem.unit]
    factors = [180.0 / np.pi if u == "rad" else 1.0 for u in units]
    x, y = problem.values * factors[0], problem.target * factors[1]
    found = y + design.errors.reshape(-1) / np.sqrt(problem.weights) * factors[1]
    dense = len(x) > 40  # more than 40 targets are drawn as a line
    name = problem.output if isinstance(problem.output, str) else "output"
    if name in top.position:  # what it does between the targets too
        turn, motion = design.turn, design.motion
        good = np.asarray(turn.converged)
        off = design.inputs[0] - problem.values[0], float(motion[name][0]) - found[0] / factors[1]
        along, out = np.asarray(turn.inputs[problem.driven]), np.asarray(turn[name])
        ax.plot((along - off[0])[good] * factors[0], (out - off[1])[good] * factors[1], color=FOUND, lw=1.3)
    else:
        ax.plot(x, found, color=FOUND, lw=1.3)
    ax.plot(x, y, "--" if dense else "o", color=TARGET, ms=3.2, mfc="none", mew=0.9, lw=1.0)
    for axis, text, unit in zip((ax.xaxis, ax.yaxis), (symbol(problem.driven), symbol(name)), units, strict=True):
        shown = {"rad": "°", "": ""}.get(unit, f" [{unit}]")
        axis.set_label_text(f"{text}{' [°]' if shown == '°' else shown}")
        axis.set_major_locator(MaxNLocator(4))
        axis.labelpad = 1.0
    furnish(ax)


def convergence(result: "Result", path: str | Path | None = None) -> Figure:
    """Draw the best error, round by round.

    Args:
        result: what was found.
        path: file to write: PNG, SVG, PDF or JPG.
    """
    errors = np.array([h.error for h in result.history])
    good = np.isfinite(errors)
    if not good.any():
        raise InputError(f"no error to draw: {result.verdict}")
    figure = Picture(figsize=(5.2, 3.2), layout="constrained")
    ax = figure.add_subplot()
    least, most = errors[good].min(), errors[good].max()
    rounds = np.arange(1, len(errors) + 1)
    ax.plot(rounds[good], np.maximum(errors[good], 1e-300), ".-", drawstyle="steps-post", color=FOUND, lw=1.6, ms=6)
    ax.set_yscale("log")
    ax.set_xlim(left=0.0)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    if least > 0 and most < 30.0 * least:  # so that the axis has a mark or two
        ax.set_ylim(0.2 * least, 5.0 * most)
    furnish(ax)
    ax.set(xlabel="round of the refinement", ylabel=axis_name("best error", unit_of(result.problem).strip()))
    time = f"{result.history[-1].seconds:.3g} s"
    crown(ax, f"{result.refined} of {result.screened} designs refined in {time}")
    return finish(figure, path)


def steps(history: "Steps", path: str | Path | None = None, unit: str = "") -> Figure:
    """Draw value and gradient of every design, step by step: each one thin, the best so far of all of them thick.

    Args:
        history: of a descent.
        path: file to write: PNG, SVG, PDF or JPG.
        unit: of the value.

    Raises:
        InputError: there is no step with a finite value.
    """
    value, gradient = np.where(history.good, history.value, np.nan), np.where(history.good, history.gradient, np.nan)
    if not np.isfinite(value).any():
        raise InputError("no value to draw: no design was good after any step")
    figure = Picture(figsize=(5.2, 4.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    along = np.arange(1, history.count + 1)
    log = np.nanmin(value) > 0
    for ax, rows, logarithmic in ((above, value, log), (below, gradient, True)):
        rows = np.where(rows > 0, rows, np.nan) if logarithmic else rows
        for lane in rows.T:
            ax.plot(along, lane, color=FOUND, lw=0.6, alpha=0.35)
        filled = np.where(np.isfinite(rows), rows, np.inf)
        least = np.min(filled, axis=1) if history.random else np.minimum.accumulate(np.min(filled, axis=1))
        ax.plot(along, np.where(np.isfinite(least), least, np.nan), color=FOUND, lw=1.8)
        if logarithmic:
            ax.set_yscale("log")
            usual = np.nanpercentile(rows, 99.5)  # one design far above the others at the start does not set the scale
            ax.set_ylim(top=np.nanmin([10.0 * usual, 2.0 * np.nanmax(rows)]))
        furnish(ax)
    shown = unit.replace("^2", "²")
    above.set_ylabel(axis_name("sample of the error" if history.random else "error", shown))
    below.set(xlabel="step", ylabel="projected gradient", xlim=(1, max(history.count, 2)))
    below.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    lanes = value.shape[1]
    made = f"{np.sum(~np.isnan(history.value)):,}".replace(",", "\u202f")  # what it took, whatever else the machine did
    crown(above, f"{lanes} design{'s' if lanes > 1 else ''}, {history.count} steps, {made} gradients")
    return finish(figure, path)


def front(found: "Front", path: str | Path | None = None) -> Figure:
    """Draw a front: its designs by their objectives, and those at the ends and at the bend.

    Args:
        found: what was found.
        path: file to write: PNG, SVG, PDF or JPG.

    Returns:
        The figure; one plot for each pair of objectives.

    Raises:
        InputError: there is no design.
    """
    if not found.designs:
        raise InputError(f"no front to draw: {found.verdict}")
    shown = sorted({0, found.knee, len(found.designs) - 1})
    pairs = list(itertools.combinations(range(len(found.names)), 2))
    rows = 1 if len(pairs) == 1 else 2  # the designs beside one plot, below several
    wide = [_FRONT_PLOT * len(pairs), _FRONT_DESIGN * len(shown)]
    width = sum(wide) if rows == 1 else max(wide)
    figure = Picture(figsize=(width, rows * 3.4))
    for n, (i, j) in enumerate(pairs):
        left, low = _FRONT_PLOT * n + 0.8, rows - 1 + 0.17
        _plot_pair(
            found, figure.add_axes((left / width, low / rows, (_FRONT_PLOT - 1.0) / width, 0.74 / rows)), i, j, shown
        )
    spatial = found.problem.system.topology.dim == 3
    for n, k in enumerate(shown):
        left = wide[0] + _FRONT_DESIGN * n if rows == 1 else (n + 0.5) * width / len(shown) - 0.5 * _FRONT_DESIGN
        place = (left / width, 0.05 / rows, (_FRONT_DESIGN - 0.15) / width, 0.78 / rows)
        ax = figure.add_axes(place, projection="3d" if spatial else None)
        each = [f"{name} {v:.3g}" for name, v in zip(found.names, found.values[k], strict=True)]
        words = f"{chr(97 + n)}: {', '.join(each)}"
        draw_design(
            found.problem, found.designs[k], ax, words if len(words) <= _HEADING else words.replace(", ", ",\n")
        )
    return finish(figure, path)


def _axis_name(front: "Front", k: int) -> str:
    """Write an objective with its unit, where it is known: of the problem's error, whose root is what a front holds."""
    unit = front.problem.error_unit
    return axis_name(front.names[k], unit.removesuffix("^2") if k == 0 and unit.endswith("^2") else "")


def _plot_pair(front: "Front", ax: Axes, i: int, j: int, shown: list[int]) -> None:
    x, y = front.values[:, i], front.values[:, j]
    if len(front.names) == 2:
        ax.plot(x, y, "-", color=FOUND, lw=1.0, alpha=0.5)
    ax.plot(x, y, "o", ms=4.5, color=FOUND)
    for n, k in enumerate(shown):
        ax.plot(x[k], y[k], "o", ms=7.5, mfc="none", mec=TARGET, mew=1.3)
        ax.annotate("abc"[n], (x[k], y[k]), (7, 6), textcoords="offset points", fontsize=TEXT, color=TARGET)
    furnish(ax)
    ax.set(xlabel=_axis_name(front, i), ylabel=_axis_name(front, j))
    ax.margins(0.09)
    for name, values in (("x", x), ("y", y)):
        # An axis is logarithmic if the largest value is 30 times the least; a condition that is met is no decade.
        if values.min() > 1e-7 * values.max() and values.max() > 30.0 * values.min():
            ax.set(**{f"{name}scale": "log"})
        elif np.ptp(values) > 0:
            ax.ticklabel_format(axis="x" if name == "x" else "y", style="sci", scilimits=(-3, 4))


@public
def burmester(
    curves: "BurmesterCurves",
    poses: ArrayLike | None = None,
    path: str | Path | None = None,
    title: str = "Circle points and their centres",
    size: Size = 6.4,
    dpi: float = 200.0,
) -> Figure:
    """Draw the circle-point and centre-point curves of four poses, their poles, and the poses as small frames.

    Args:
        curves: the curves.
        poses: x, y and angle of the body in each pose, ``(4, 3)``, to be drawn too.
        path: file to write as well: PNG, SVG, PDF or JPG.
        title: heading.
        size: width of the figure, inches, with the height that it needs; or width and height.
        dpi: dots per inch of a file.

    Raises:
        OutputError: a file that cannot be written.
    """
    figure = Picture(figsize=inches(size, lambda width: 0.82 * width), layout="constrained")
    ax = figure.add_subplot()
    ax.plot(*curves.circle.T, color=BODIES[0], lw=1.6, label="circle points, first pose", zorder=3)
    ax.plot(*curves.centre.T, color=BODIES[1], lw=1.6, ls=LINES[1], label="centre points", zorder=3)
    poles = curves.poles[np.isfinite(curves.poles).all(axis=1)]
    ax.plot(*poles.T, "o", ms=4.5, mfc="white", mec=LIGHT["ink"], mew=1.0, label="poles", zorder=4)
    frames = np.zeros((0, 3)) if poses is None else np.asarray(poses, float)
    known = frames[:, :2] if len(frames) else poles
    middle = 0.5 * (known.min(axis=0) + known.max(axis=0))
    # half width of the picture, in half widths of the poses and poles
    half = 2.6 * max(float(np.ptp(known, axis=0).max()) / 2.0, 1e-300)
    for k, (x, y, angle) in enumerate(frames):
        for turn, shade in ((0.0, 1.0), (0.5 * np.pi, 0.5)):
            tip = 0.22 * half * np.array([np.cos(angle + turn), np.sin(angle + turn)]) * shade
            ax.annotate(
                "", (x + tip[0], y + tip[1]), (x, y), zorder=5,
                arrowprops={"arrowstyle": "-|>", "color": LIGHT["ink"], "lw": 1.0, "shrinkA": 0, "shrinkB": 0},
            )  # fmt: skip
        ax.annotate(str(k + 1), (x, y), (-8, -9), textcoords="offset points", fontsize=TEXT, color=LIGHT["ink"])
    ax.set_xlim(middle[0] - 1.22 * half, middle[0] + 1.22 * half)
    ax.set_ylim(middle[1] - half, middle[1] + half)
    ax.set_aspect("equal")
    furnish(ax)
    crown(ax, title)
    return finish(figure, path, dpi)
