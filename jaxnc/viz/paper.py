"""A motion on one sheet of paper: drawing with its curves, tables and plots."""

import itertools
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxnc.calls import public
from jaxnc.errors import InputError, counted
from jaxnc.kinematics.motion import Motion
from jaxnc.viz.drawing import draw, make_view
from jaxnc.viz.picture import Picture, finish
from jaxnc.viz.plots import draw_curves, draw_paths, group_quantities
from jaxnc.viz.poses import Poses, poses
from jaxnc.viz.quantities import Quantity, abscissa
from jaxnc.viz.style import LIGHT, NUMBERS, TEXT, axis_name, crown, furnish, short, symbol, wrap

PAPER = {"a4": (8.27, 11.69), "letter": (8.5, 11.0)}
"""Width and height, inches."""

_MARGIN = 0.75  # inches, as all that follows
_GAP = 0.32
_ROW = 0.172  # of a table
_HEAD = 0.62  # title and the line under it
_PANEL = (1.45, 2.0, 2.9)  # height of a plot: least, wanted, most
_UNDER = 0.42  # a plot's numbers and name of its axis
_BESIDE = 0.66  # and those at its left
_DRAWING = (2.2, 5.2)  # height of a drawing: least and most


@public
def motion_sheet(
    motion: Motion,
    path: str | Path | None = None,
    plots: str | Iterable[str | Sequence[str]] | None = None,
    trace: str | Iterable[str] | None = None,
    pose: int | None = None,
    paper: str | float = "a4",
    against: str | None = None,
    title: str | None = None,
    dpi: float = 200.0,
    **options: object,
) -> Figure:
    """Put a motion on one sheet for a paper or a report: drawing, paths, dimensions, extremes and plots.

    Args:
        motion: a sequence of poses.
        path: file to write: PDF or SVG (lines stay lines), PNG or JPG.
        plots: quantities as of `jaxnc.viz.plot`, which share axes as there. If none are given: what is not driven, and
            position, velocity and acceleration of the first point that is traced, as far as they are known.
        trace: points whose path is drawn; if not given the markers, or else the last moving point.
        pose: the pose that is drawn; one third of the way if not given.
        paper: ``"a4"`` or ``"letter"`` (upright, filled), or the width of a figure in inches, as high as it needs.
        against: what plots are drawn over, as of `jaxnc.viz.plot`.
        title: heading; the mechanism's name if not given.
        dpi: dots per inch of a file.
        **options: further options of `jaxnc.viz.draw`, such as ``show="centres"`` or ``velocities="P"``.

    Raises:
        InputError: a single pose, unknown names, no such paper.
        OutputError: a file that cannot be written.
    """
    data = poses(motion)
    if data.single or data.count < 2:
        raise InputError(f"{data.topology.name!r}: one pose makes no sheet; give a sweep, or use draw()")
    if not data.good.any():
        raise InputError(
            f"{data.topology.name!r}: no pose of this motion is right: {data.sentence(0)} draw() shows one"
        )
    points = _default_traces(data) if trace is None else tuple(data.names[k] for k in data.columns(trace, "trace"))
    names = _default_quantities(data, points) if plots is None else (plots,) if isinstance(plots, str) else tuple(plots)
    if not names:
        raise InputError("a sheet needs at least one quantity to plot, plots=[…]; use draw() for the drawing alone")
    x, panels = abscissa(data, against), group_quantities(data, names)
    size = _size(paper)
    wide = size[0] - 2 * _MARGIN if isinstance(paper, str) else size[0] - 0.3
    tables = [_dimension_table(data), _extreme_table(x, panels)]
    high = size[1] - 2 * _MARGIN if size[1] else None
    noted = bool(options.get("show")) and data.dim == 2
    notes = 0.55 if noted else 0.0  # inches of texts under the drawing
    plan = _SheetPlan(data, points, wide, high, len(panels), tables, options.get("view"), notes)
    height = size[1] or plan.height + 0.3
    figure = Picture(figsize=(size[0], height))
    left, top = (size[0] - wide) / 2, height - (_MARGIN if size[1] else 0.15)

    def box(part: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        """Bring left, top, width and height, inches from the upper left corner, to shares of the figure."""
        a, b, w, h = part
        return (left + a) / size[0], (top - b - h) / height, w / size[0], h / height

    _write_heading(figure, data, box((0.0, 0.0, wide, _HEAD)), title)
    ax = figure.add_axes(box(plan.drawing), projection="3d" if data.dim == 3 else None)
    k = int(data.extent_poses[len(data.extent_poses) // 3]) if pose is None else pose
    draw(motion, pose=k, ax=ax, trace=points, **{"frame": "scale", "title": "", **options})
    for part, table in zip(plan.tables, tables, strict=True):
        _write(figure, table, box(part), _ROW / height)
    for part, group in zip(plan.panels, panels, strict=True):
        _panel(figure.add_axes(box(part)), data, x, group)
    return finish(figure, path, dpi)


def _size(paper: str | float) -> tuple[float, float]:
    """Read width and height, inches; no height where it follows."""
    if isinstance(paper, str):
        if paper.lower() not in PAPER:
            raise InputError(f"paper={paper!r}: give {' or '.join(map(repr, PAPER))}, or a width in inches")
        return PAPER[paper.lower()]
    if not (np.isfinite(paper) and 3.0 <= paper <= 40.0):
        raise InputError(f"paper={paper!r}: the width of a figure is 3 to 40 inches")
    return float(paper), 0.0


class _SheetPlan:
    """Places of the parts: left, top, width and height of each, inches from the upper left corner.

    It is as high as it needs, if that is not given; `notes` is what texts under the drawing take.
    """

    def __init__(
        self, data: Poses, points, wide: float, high: float | None, count: int, tables: list, view: Any, notes: float
    ):
        span = np.array([1.0, 0.85])
        if data.dim == 2:
            seen = make_view(data, data.extent_poses.tolist(), points, False, view)
            span = np.maximum(seen.upper - seen.lower, 1e-9 * seen.size)
        rows = [_ROW * (len(table) + 0.6) for table in tables]
        tall = span[1] / span[0]
        beside = tall > 0.62 and wide > 5.0
        share = 0.62 * wide if beside else wide  # share of a drawing's width, the tables beside it
        room = high - _HEAD if high else math.inf
        least = max(_DRAWING[0], rows[0] + 0.1) if beside else _DRAWING[0]
        drawing = float(np.clip(share * tall + 0.55, least, _DRAWING[1]))
        narrow = not beside and wide < 5.0  # one table under the other
        below = (rows[1] if beside else sum(rows) + _GAP if narrow else max(rows)) + _GAP + notes
        columns = 2 if count > 1 and wide > 5.0 else 1
        lines = math.ceil(count / columns)
        rest = room - drawing - below if high else lines * (_PANEL[1] + _UNDER + _GAP)
        roomy = high and columns == 2 and rest / lines > _PANEL[2] + _UNDER + _GAP
        if roomy and rest / count > _PANEL[0] + _UNDER + _GAP:
            columns, lines = 1, count
        each = rest / lines - _UNDER - _GAP
        if high and each > _PANEL[2]:  # what is left goes to the drawing
            drawing += (each - _PANEL[2]) * lines
            each = _PANEL[2]
        elif high and each < _PANEL[0]:
            drawing -= min((_PANEL[0] - each) * lines, max(drawing - _DRAWING[0], 0.0))
            each = (room - drawing - below) / lines - _UNDER - _GAP
            if each < 1.1:  # the least that a name beside it fits in
                remedy = "ask for fewer, or give paper= as a width in inches"
                raise InputError(f"{count} plots do not fit on the sheet; {remedy}")
        self.drawing = (0.0, _HEAD, share, drawing)
        at = _HEAD + drawing + notes + 0.5 * _GAP
        if beside:
            side = share + 0.25
            self.tables = [(side, _HEAD + 0.1, wide - side, rows[0]), (0.0, at, wide, rows[1])]
        elif narrow:
            self.tables = [(0.0, at, wide, rows[0]), (0.0, at + rows[0] + _GAP, wide, rows[1])]
        else:
            first = 0.34 * wide
            self.tables = [(0.0, at, first, rows[0]), (first + _GAP, at, wide - first - _GAP, rows[1])]
        top, pitch = _HEAD + drawing + below + _GAP, wide / columns
        whole = columns == 2 and count % 2 == 1  # the last one has its row for itself
        self.panels = []
        for k in range(count):
            start, under = k % columns * (pitch + 0.12) + _BESIDE, top + k // columns * (each + _UNDER + _GAP)
            alone = columns == 1 or k % 2 == 1 or (whole and k == count - 1)  # reaches the right margin
            self.panels.append((start, under, (wide - start) if alone else pitch - _BESIDE - 0.12, each))
        self.height = top + lines * (each + _UNDER + _GAP) - _GAP


# -- what there is to say ---------------------------------------------------------------------------------------------


def _default_traces(data: Poses) -> tuple[str, ...]:
    points = data.names[: len(data.topology.points)]
    if data.names[len(points) :]:
        return data.names[len(points) :][:2]
    moving = [n for k, n in enumerate(points) if np.ptp(data.places[data.extent_poses, k], axis=0).any()]
    return tuple(moving[-1:])


def _default_quantities(data: Poses, points: Sequence[str]) -> tuple[str, ...]:
    top, motion = data.topology, data.motion
    names = [s for s in top.scalars if s not in motion.driven][:2]
    for point in points[:1]:
        names += [f"{point}.{axis}" for axis in "xyz"[: data.dim]]
        names += [f"{noun} {point}" for noun in ("velocity", "acceleration")[: len(motion.rates)]]
    return tuple(names)


def _dimension_table(data: Poses) -> list[tuple[str, ...]]:
    """List the lengths of links and of the ground, as they are in the first pose that is right."""
    top, x = data.topology, data.places[data.extent_poses[0]]
    n = len(top.points)
    fixed: np.ndarray = np.all(np.array(top.fixed[: n * top.dim], bool).reshape(n, top.dim), axis=1)
    sets = [("ground", [k for k in range(n) if fixed[k]])] + [(b.name, [k for k in b.points]) for b in top.bodies]
    rows: list[tuple[str, ...]] = []
    for name, points in sets:
        pairs = list(itertools.pairwise(points)) + ([(points[0], points[-1])] if len(points) == 3 else [])
        for a, b in pairs:
            rows.append((name, f"{top.points[a]}–{top.points[b]}", short(float(np.linalg.norm(x[b] - x[a])))))
            name = ""
    most = 16  # dimensions in the table
    if len(rows) > most:
        rows = [*rows[: most - 1], ("…", "", "")]
    return [("link", "length", f"[{top.length_unit}]" if top.length_unit else ""), *rows]


def _extreme_table(x: Quantity, panels: list) -> list[tuple[str, ...]]:
    """List the least and the greatest value in the poses of what is plotted, and where."""
    unit = f" [{x.unit}]" if x.unit else ""
    rows: list[tuple[str, ...]] = [
        (f"of {len(x.values)} poses", "least", f"at {symbol(x.label)}{unit}", "greatest", f"at {symbol(x.label)}{unit}")
    ]
    for group in panels:
        for q in group:
            size = q.values if q.values.ndim == 1 else np.linalg.norm(q.values, axis=1)
            if q.kind in ("place", "components") or not np.isfinite(size).any():
                continue
            at = [np.nanargmin(size), np.nanargmax(size)]
            label = q.label if q.kind == "number" else f"|{q.label}|"
            label = f"{label} [{q.unit}]" if q.unit else label
            rows.append((label, *(v for k in at for v in (short(float(size[k])), short(float(x.values[k]))))))
    return rows


# -- putting it on paper ----------------------------------------------------------------------------------------------


def _write_heading(figure: Figure, data: Poses, box, title: str | None) -> None:
    left, bottom, _, high = box
    name = data.topology.name if title is None else title
    freedoms = data.motion.system.degrees_of_freedom
    facts = [f"{freedoms} degree{'s' * (freedoms != 1)} of freedom"]
    for driven in data.motion.driven:
        q = abscissa(data, driven)
        ends = q.values[[0, -1]]
        facts.append(f"{q.label} from {short(float(ends[0]))} to {short(float(ends[1]))} {q.unit}".rstrip())
    bad = int((~data.good).sum())
    facts.append(counted(data.count, "pose") + (f", {bad} of them not right" if bad else ""))
    look: dict[str, Any] = {"ha": "left", "va": "top", "parse_math": False}
    figure.text(left, bottom + high, name, fontsize=14.0, color=LIGHT["ink"], fontweight="bold", gid="title", **look)
    figure.text(left, bottom + 0.5 * high, "  ·  ".join(facts), fontsize=NUMBERS, color=LIGHT["soft"], **look)


def _write(figure: Figure, table: list[tuple[str, ...]], box, row: float) -> None:
    """Write a table with rules above, under its head and below; numbers stand at the right."""
    left, bottom, wide, high = box
    lengths = [max(len(line[c]) for line in table) + 1.5 for c in range(len(table[0]))]
    text = min(NUMBERS, wide * figure.get_figwidth() * 72.0 / (0.56 * sum(lengths)))
    ends = left + wide * np.cumsum(lengths) / sum(lengths)
    starts = [left, *ends[:-1]]
    words = 2 if len(table[0]) == 3 else 1  # columns of words
    top = bottom + high
    for k, line in enumerate(table):
        y = top - (k + 0.62 + (0.25 if k else 0.0)) * row
        for c, cell in enumerate(line):
            number = c >= words
            figure.text(
                ends[c] if number else starts[c], y, cell, fontsize=text, ha="right" if number else "left",
                va="center_baseline", color=LIGHT["ink"] if k else LIGHT["soft"], parse_math=False,
            )  # fmt: skip
    for y, width in ((top + 0.05 * row, 0.8), (top - 1.15 * row, 0.5), (top - (len(table) + 0.42) * row, 0.8)):
        rule = Line2D([left, left + wide], [y, y], color=LIGHT["ink"], linewidth=width, transform=figure.transFigure)
        figure.add_artist(rule).set_gid("rule")


def _panel(ax, data: Poses, x: Quantity, group: list[Quantity]) -> None:
    furnish(ax)
    if group[0].kind == "place":
        draw_paths(ax, data, group)
    else:
        draw_curves(ax, data, x, group)
        ax.set_xlabel(x.axis)
        if len(group) == 1 and group[0].kind != "number":  # its name stands beside the axis, not before each part
            (q,) = group
            for line in ax.lines:
                line.set_label(str(line.get_label()).removeprefix(f"{q.label}, "))
            ax.set_ylabel(axis_name(q.label, q.unit))
    height = 72.0 * ax.get_position().height * ax.figure.get_figheight()
    ax.set_ylabel("\n".join(wrap(ax.get_ylabel(), TEXT, height)))
    crown(ax)
