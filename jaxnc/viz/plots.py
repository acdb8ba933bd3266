"""Curves: paths of points in the plane, and quantities over the input."""

from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FuncFormatter, MultipleLocator

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.viz.picture import Picture, Size, finish, inches
from jaxnc.viz.poses import Poses, poses
from jaxnc.viz.quantities import Quantity, abscissa, default_plots, quantity
from jaxnc.viz.style import BODIES, LIGHT, LINES, NUMBERS, axis_name, crown, furnish

_FLAT, _REST = 0.1, 1e-4  # of what axes show: curves that vary by less look flat, and those that stand still


@public
def plot(
    motion: Motion,
    *names: str | Sequence[str],
    against: str | None = None,
    path: str | Path | None = None,
    title: str | None = None,
    size: Size = 6.4,
    dpi: float = 200.0,
    unit: str | None = None,
) -> Figure:
    """Plot paths of points and quantities over the input.

    Args:
        motion: a sequence of poses.
        *names: ``"P"``: the path of a point or marker in the plane, in space its three coordinates (``draw`` shows
            paths there), and those of a unit vector; ``"P.x"``, ``"phi"``: a coordinate;
            ``"velocity P"``, ``"acceleration P.x"``, ``"velocity phi"``, ``"jerk P"``: a rate;
            ``"orientation coupler"`` (in the plane), ``"angular velocity coupler"``: of a body; ``"energy"``,
            ``"kinetic energy"``, ``"potential energy"``; ``"load spring"`` (its tension or torque), ``"effort phi"`` of
            an input, ``"support A"`` of the ground, ``"reaction B on coupler"``: forces of a motion that carries rates.
            Quantities of one dimension share their axes, unless one would look flat beside another (a tenth of the
            height); names in a list share axes of their own in any case: ``["P.x"], ["P.y"]`` are apart,
            ``["P.x", "P.y"]`` together. If none is axis_name: all angles and distances that are not driven, or else the
            last point.
        against: what is on the horizontal axis: a coordinate, ``"time"`` or ``"pose"``. Default: time if the motion
            has one, otherwise its input; of several the first that runs one way, or the number of the pose.
        path: file to write as well: PNG, SVG, PDF or JPG.
        title: heading; the mechanism's name if not given, none if ``""``.
        size: width of the figure, inches, with the height that it needs; or width and height.
        dpi: dots per inch of a file.
        unit: what angles are shown in, ``"rad"`` or ``"deg"``; the mechanism's ``angle_unit`` if not given.

    Returns:
        The figure. Poses that are not right are gaps, shaded.

    Raises:
        InputError: unknown names, names of several units in one list, rates that are missing, a single pose or a batch
            of several axes.
        OutputError: a file that cannot be written.
    """
    data = poses(motion, unit)
    if data.single or data.count < 2:
        raise InputError(
            f"{data.topology.name!r}: one pose has no curve; plot a sweep, or use draw() to see the mechanism"
        )
    found = group_quantities(data, names or default_plots(data))
    x = abscissa(data, against)
    places = [group for group in found if group[0].kind == "place"]
    rows = [group for group in found if group[0].kind != "place"]
    figure, planes, axes = stack_axes(places, len(rows), size)
    for ax, group in zip(planes, places, strict=True):
        draw_paths(ax, data, group)
    for ax, group in zip(axes, rows, strict=True):
        draw_curves(ax, data, x, group)
    for ax in axes[:-1]:
        ax.tick_params(labelbottom=False)
    if axes:
        axes[-1].set_xlabel(x.axis)
    heading = data.topology.name if title is None else title
    more = 0.0
    for ax in planes + axes:
        more += max(0.0, crown(ax, heading) - 18.0)  # 18 points above axes, for a heading or a legend of one row
        heading = ""
    if np.size(size) == 1:  # legends of many rows do not take it from the curves
        figure.set_figheight(figure.get_figheight() + more / 72.0)
    return finish(figure, path, dpi)


def group_quantities(data: Poses, names: Iterable[str | Sequence[str]]) -> list[list[Quantity]]:
    """Group quantities that share axes.

    Those in a list of their own do; of the others paths do, and those of one dimension as long as none looks flat.
    """
    out: list[list[Quantity]] = []
    loose: list[list[Quantity]] = []
    for name in dict.fromkeys(name if isinstance(name, str) else tuple(name) for name in names):
        together = [quantity(data, one) for one in ((name,) if isinstance(name, str) else name)]
        if not together:
            raise InputError("a list of quantities that share axes is empty; name one, such as 'P.x'")
        first, last = together[0], next((q for q in together if not _alike(q, together[0])), together[0])
        if last is not first:
            raise InputError(
                f"{first.name!r} ({first.axis}) and {last.name!r} ({last.axis}) cannot share axes; name them without a "
                f"list, {first.name!r}, {last.name!r}"
            )
        shared = next((group for group in loose if isinstance(name, str) and _fit(group, first)), None)
        if shared is not None:
            shared.append(first)
            continue
        out.append(together)
        if isinstance(name, str):
            loose.append(together)
    return out


def _alike(one: Quantity, other: Quantity) -> bool:
    """Tell whether two quantities can be drawn in the same axes."""
    return one.unit == other.unit and (one.kind == "place") == (other.kind == "place")


def _fit(group: list[Quantity], further: Quantity) -> bool:
    """Tell whether a quantity has the dimension of others, and none of them looks flat in axes for all."""
    if group[0].axis != further.axis or not _alike(group[0], further):
        return False
    if further.kind == "place":
        return True
    ends = np.array([_ends(q) for q in (*group, further)])
    ends = ends[np.isfinite(ends).all(axis=1)]
    if not len(ends):
        return True
    span, whole = ends[:, 1] - ends[:, 0], float(np.ptp(ends))
    varies = span > _REST * whole
    if not varies.any():
        return True
    moving = ends[varies]
    # for curves that stand still axes show at most 2.5 times what varies
    return bool(span[varies].min() >= _FLAT * whole and whole <= 2.5 * float(np.ptp(moving)))


def _ends(q: Quantity) -> tuple[float, float]:
    """Find the least and the greatest value that is drawn of a quantity; NaN of one that no pose has."""
    values = [q.values.ravel(), np.linalg.norm(q.values, axis=1)] if q.kind == "vector" else [q.values.ravel()]
    x = np.concatenate(values)
    x = x[np.isfinite(x)]
    return (float(x.min()), float(x.max())) if len(x) else (np.nan, np.nan)


def stack_axes(places: list[list[Quantity]], rows: int, size: Size) -> tuple[Figure, list[Axes], list[Axes]]:
    """Make axes one above the other: those of paths in the plane, and so many rows of curves below them."""
    width = inches(size)[0]
    heights = []
    for group in places:
        x = np.concatenate([q.values for q in group])
        x = x[np.isfinite(x).all(axis=1)]
        span = np.ptp(x, axis=0) if len(x) else np.ones(2)
        ratio = float(np.clip(span[1] / max(span[0], 1e-300), 0.35, 0.85)) if span.any() else 0.6
        heights.append(ratio * (width - 0.8))
    heights += [1.7 if rows > 1 else 2.7] * rows
    high = sum(heights) + 0.5 + 0.25 * len(heights)
    figure = Picture(figsize=inches(size, lambda _: high), layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.05))
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    planes = [figure.add_subplot(grid[k]) for k in range(len(places))]
    axes: list[Axes] = []
    for k in range(rows):
        axes.append(figure.add_subplot(grid[len(places) + k], sharex=axes[0] if axes else None))
    for ax in planes + axes:
        furnish(ax)
    return figure, planes, axes


def draw_paths(ax: Axes, data: Poses, places: list[Quantity]) -> None:
    """Draw paths in the plane, with their starts and directions."""
    unit = data.topology.length_unit
    for k, q in enumerate(places):
        colour = BODIES[k % len(BODIES)]
        ax.plot(
            q.values[:, 0], q.values[:, 1], color=colour, linewidth=1.5, linestyle=LINES[k % len(LINES)],
            label=q.label, gid=f"path {q.name}",
        )  # fmt: skip
        right = np.flatnonzero(np.isfinite(q.values).all(axis=1))
        if not len(right):
            continue
        first = q.values[right[0]]
        ax.plot(*first, "o", ms=5, mfc="white", mec=colour, mew=1.4, zorder=3, gid=f"start {q.name}")
        _add_direction(ax, q.values[right], colour)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.08)
    ax.set(xlabel=axis_name("x", unit), ylabel=axis_name("y", unit))
    failed = int(np.sum(~data.good))
    if failed:
        ax.text(
            0.99, 0.01, f"{failed} of {data.count} poses failed", transform=ax.transAxes, ha="right", va="bottom",
            fontsize=NUMBERS, color=LIGHT["failure"], gid="failure",
        )  # fmt: skip


def _add_direction(ax: Axes, x: np.ndarray, colour: str) -> None:
    """Draw an arrowhead that shows which way a path is run, a tenth of its length along."""
    step = np.hypot(*np.diff(x, axis=0).T)
    total = step.sum()
    if not total > 0:
        return
    k = int(np.searchsorted(np.cumsum(step), 0.1 * total))
    k = min(max(k, 0), len(x) - 2)
    if step[k] > 0:
        head = {"arrowstyle": "-|>", "color": colour, "lw": 0, "mutation_scale": 15, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", x[k + 1], x[k], arrowprops=head)


def draw_curves(ax: Axes, data: Poses, x: Quantity, group: list[Quantity]) -> None:
    """Draw quantities of one unit over another quantity; poses that are not right are gaps, shaded."""
    for start, end in data.gaps:
        lo = x.values[start] if start == 0 else 0.5 * (x.values[start - 1] + x.values[start])
        hi = x.values[end - 1] if end == data.count else 0.5 * (x.values[end - 1] + x.values[end])
        ax.axvspan(min(lo, hi), max(lo, hi), facecolor=LIGHT["failure"], alpha=0.10, linewidth=0, gid="failure")
        ax.text(
            0.5 * (lo + hi), 0.97, "failed", transform=ax.get_xaxis_transform(), ha="center", va="top",
            fontsize=NUMBERS - 1, color=LIGHT["failure"], clip_on=True,
        )  # fmt: skip
    count, vectors = 0, sum(q.kind == "vector" for q in group)
    for q in group:
        if q.kind == "number":
            ax.plot(x.values, q.values, **_look(count), label=q.label, gid=q.name)
            count += 1
            continue
        for k, axis in enumerate("xyz"[: data.dim]):
            ax.plot(x.values, q.values[:, k], **_look(count), label=f"{q.label}, {axis}", gid=f"{q.name}.{axis}")
            count += 1
        if q.kind == "components":
            continue
        size = np.linalg.norm(q.values, axis=1)
        look: dict[str, Any] = (
            {"color": LIGHT["soft"]} if vectors == 1 else _look(count)
        )  # a colour for each, where there are several
        look |= {"linewidth": 2.4, "alpha": 0.45, "zorder": 1.8}
        ax.plot(x.values, size, **look, label=f"{q.label}, magnitude", gid=f"|{q.name}|")
        count += vectors > 1
    single = len(group) == 1 and group[0].kind == "number"
    dimensions = dict.fromkeys(q.dimension for q in group)
    ax.set_ylabel(axis_name(group[0].label if single else ", ".join(dimensions), group[0].unit))
    if single:
        ax.lines[-1].set_label("_")  # named by its axis
    _angle_ticks(ax.xaxis, x, most=int(np.clip(1.7 * ax.figure.canvas.figure.get_figwidth() - 1.4, 2, 8)))
    if all(q.dimension == "angle" for q in group):
        _angle_ticks(ax.yaxis, group[0], [q.values for q in group])
    finite = x.values[np.isfinite(x.values)]
    if len(finite) and np.ptp(finite) > 0:
        ax.set_xlim(finite.min(), finite.max())


def _look(count: int) -> dict[str, Any]:
    return {"color": BODIES[count % len(BODIES)], "linewidth": 1.4, "linestyle": LINES[count % len(LINES)]}


def _angle_ticks(axis, q: Quantity, values: list[np.ndarray] | None = None, most: int = 8) -> None:
    """Put ticks at fractions of a turn, for angles that cover enough of one."""
    x = np.concatenate(values if values is not None else [q.values])
    x = x[np.isfinite(x)]
    if q.unit not in ("°", "rad") or not len(x):
        return
    turn = 360.0 if q.unit == "°" else 2 * np.pi
    turns = float(np.ptp(x)) / turn
    if turns < 0.45:
        return
    steps = (1 / 12, 1 / 8, 1 / 4, 1 / 2, 1, 2, 5, 10, 20, 50, 100)[q.unit == "rad" :]
    step = next((s for s in steps if turns / s <= most), 1000)
    if q.unit == "rad":
        axis.set_major_formatter(FuncFormatter(lambda v, _: _pi(v)))
    axis.set_major_locator(MultipleLocator(step * turn))


def _pi(value: float) -> str:
    top, bottom = Fraction(round(value / (np.pi / 4)), 4).as_integer_ratio()
    text = {0: "0", 1: "π", -1: "-π"}.get(top, f"{top}π").replace("-", "−")
    return text if bottom == 1 else f"{text}/{bottom}"
