"""Pictures of what was found: an energy balance, families of coordinates, tolerances, the numbers of a suspension."""

from collections.abc import Sequence
from pathlib import Path
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator, MultipleLocator

from jaxnc.calls import public
from jaxnc.dynamics.energy import energy_balance
from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.motion import Motion
from jaxnc.viz.picture import Picture, Size, finish, inches
from jaxnc.viz.plots import stack_axes
from jaxnc.viz.style import BODIES, HEADING, LIGHT, LINES, NUMBERS, TEXT, axis_name, crown, furnish, symbol

if TYPE_CHECKING:
    from jaxnc.families.comparison import Comparison
    from jaxnc.synthesis.tolerance.spread import Tolerance
    from jaxnc.vehicle.report import SuspensionReport, SuspensionRow

_LETTERS = 8.5  # points, of a suspension's numbers
_ABOVE, _BELOW, _LEFT = 0.55, 0.5, 0.5  # what is around them
_TRAVEL = (
    "toe", "camber", "caster", "kingpin_inclination", "half_track_change", "wheelbase_change", "roll_centre_height",
    "scrub_radius", "caster_trail", "brake_support_angle", "drive_support_angle", "motion_ratio",
)  # fmt: skip
_STEERING = ("steer", "toe_out_in_turns", "ackermann", "camber", "caster", "scrub_radius", "caster_trail")
_LEAST = {"deg": 0.1, "mm": 1.0, "": 0.02, "%": 1.0}
"""The least span of an axis, so that what hardly changes looks level."""


@public
def plot_energy(
    motion: Motion, path: str | Path | None = None, title: str | None = None, size: Size = 6.4, dpi: float = 200.0
) -> Figure:
    """Plot kinetic and potential energy and their sum; what came in and was taken; and the error of the balance.

    Args:
        motion: a simulation, or a motion in time that carries velocities.
        path: file to write as well: PNG, SVG, PDF or JPG.
        title: heading; the mechanism's name if not given, none if ``""``.
        size: width of the figure, inches, with the height that it needs; or width and height.
        dpi: dots per inch of a file.

    Returns:
        The figure; times that were not reached are gaps.

    Raises:
        InputError: a motion without time or velocities, or a batch.
        OutputError: a file that cannot be written.
    """
    found = energy_balance(motion)
    t = found.time
    work = {"inputs": found.inputs, "loads": found.loads, "dampers": -found.dissipated, "friction": -found.friction}
    work = {name: x for name, x in work.items() if np.nanmax(np.abs(x), initial=0.0) > 0}
    figure, _, axes = stack_axes([], 3 if work else 2, size)
    for ax, what, rows in (
        (axes[0], "energy [J]", {"kinetic": found.kinetic, "potential": found.potential}),
        (axes[1], "work since the start [J]", work),
    ):
        for colour, dashes, (name, e) in zip(BODIES, LINES, rows.items(), strict=False):
            ax.plot(t, e, color=colour, linestyle=dashes, linewidth=1.4, label=name)
        if rows and ax is axes[0]:
            ax.plot(t, found.total, color=LIGHT["ink"], linewidth=1.4, label="total")
        if rows:
            ax.set_ylabel(what)
    axes[-1].plot(t, found.error, color=LIGHT["ink"], linewidth=1.2)
    axes[-1].set(xlabel="time [s]", ylabel="error of the balance [J]")
    for ax in axes[:-1]:
        ax.tick_params(labelbottom=False)
    heading = motion.system.name if title is None else title
    for ax in axes:
        crown(ax, heading if ax is axes[0] else "")
    return finish(figure, path, dpi)


@public
def plot_families(
    comparison: "Comparison", path: str | Path | None = None, size: Size = 9.6, dpi: float = 200.0
) -> Figure:
    """Plot a comparison: counts, what is written, time of a solve, and basins of convergence.

    Args:
        comparison: of `jaxnc.families.compare`.
        path: file to write as well: PNG, SVG, PDF or JPG.
        size: width of the figure, inches, with the height that it needs; or width and height.
        dpi: dots per inch of a file.

    Returns:
        The figure. A family without numbers has no bar.

    Raises:
        InputError: no family has numbers.
        OutputError: a file that cannot be written.
    """
    from jaxnc.families.comparison import SPREADS

    rows = [row for row in comparison.families if row.n is not None]
    if not rows:
        raise InputError(f"{comparison.mechanism!r}: no family has numbers to plot")
    figure = Picture(figsize=inches(size, lambda width: 0.36 * width), layout="constrained")
    axes = figure.subplots(1, 3, width_ratios=(1.25, 1.0, 1.25))
    at = np.arange(len(rows))
    names = [row.family for row in rows]
    counts = (("variables n", "n"), ("equations r", "r"), ("sines and cosines", "trigonometric"))
    for k, (label, key) in enumerate(counts):
        values = [getattr(row, key) or 0 for row in rows]
        bars = axes[0].barh(at + 0.26 * (k - 1), values, height=0.24, color=BODIES[k], label=label)
        axes[0].bar_label(bars, padding=2, fontsize=NUMBERS - 1, color=LIGHT["ink"])
    axes[0].set_xlabel("number")
    axes[0].margins(x=0.12)
    axes[0].xaxis.get_major_locator().set_params(integer=True)
    times = [row.microseconds or 0.0 for row in rows]
    bars = axes[1].barh(at, times, height=0.5, color=BODIES[3])
    labels = [
        "" if not row.microseconds else "no convergence" if row.iterations is None else f"{row.iterations} iterations"
        for row in rows
    ]
    inside = [t > 0.6 * max(times) for t in times]
    for bar, label, within in zip(bars, labels, inside, strict=True):
        axes[1].annotate(
            label, (bar.get_width(), bar.get_y() + bar.get_height() / 2), (-4 if within else 4, 0),
            textcoords="offset points", va="center", ha="right" if within else "left", fontsize=NUMBERS - 1,
            color=LIGHT["paper"] if within else LIGHT["ink"],
        )  # fmt: skip
    axes[1].set_xlabel("time of a solve in a batch [µs]")
    for axis in axes[:2]:
        axis.set_yticks(at, names if axis is axes[0] else [""] * len(rows))
        axis.invert_yaxis()
        axis.tick_params(axis="y", length=0)
    for k, row in enumerate(rows):
        if row.basin is not None:
            # Curves may coincide: dashes lie on top.
            line = {"color": BODIES[k], "linestyle": LINES[k % 2], "label": row.family, "zorder": 2 + k % 2}
            axes[2].plot(SPREADS, row.basin, marker="o", linewidth=1.4, markersize=3.5, **line)
    axes[2].set_xscale("log")
    axes[2].set_xticks(SPREADS, [f"{s:g}" for s in SPREADS])
    axes[2].minorticks_off()
    axes[2].set_ylim(-0.03, 1.03)
    axes[2].set(xlabel="distance of the start, part of the size", ylabel="ends at the drawing's assembly")
    axes[2].legend(frameon=False, fontsize=NUMBERS, handlelength=3.6)  # so that dashes are seen beside the mark
    for axis, grid in zip(axes, ("x", "x", "y"), strict=True):
        furnish(axis, grid)
    axes[0].tick_params(axis="y", labelsize=TEXT)
    crown(axes[0], room=0.3 * inches(size)[0])
    return finish(figure, path, dpi)


@public
def band(
    tolerance: "Tolerance",
    name: str | None = None,
    path: str | Path | None = None,
    title: str | None = None,
    size: Size = 7.6,
    dpi: float = 200.0,
) -> Figure:
    """Draw the deviation of an output from its nominal value over the input, and who is to blame.

    Args:
        tolerance: from `jaxnc.tolerance`, over a sequence of poses.
        name: the output; the first if not given.
        path: file to write as well: PNG, SVG, PDF or JPG.
        title: heading; the mechanism and the output if not given, none if ``""``.
        size: width of the figure, inches, with the height that it needs; or width and height.
        dpi: dots per inch of a file.

    Returns:
        The figure: the band between the outer percentiles of the samples, the same percentiles to first order (of a
        normal output) as lines, the worst case dashed, and the shares of the dimensions in the variance as bars.

    Raises:
        InputError: an unknown output, or one that is not over a sequence.
        OutputError: a file that cannot be written.
    """
    name = next(iter(tolerance.outputs)) if name is None else name
    found = tolerance[name]
    if found.nominal.ndim != 1 or not tolerance.inputs:
        raise InputError(f"band: output {name!r} is not over a sequence of poses; print the table instead")
    driven, values = next(iter(tolerance.inputs.items()))
    unit = tolerance.input_units[driven]
    x, unit = (np.degrees(values), "deg") if unit == "rad" else (np.asarray(values), unit)
    factor, shown = (180.0 / np.pi, "deg") if found.unit == "rad" else (1.0, found.unit)
    figure = Picture(figsize=inches(size, lambda width: 0.44 * width), layout="constrained")
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": [2.1, 1.0]})
    off = (found.percentiles - found.nominal) * factor
    low, high = tolerance.levels[0], tolerance.levels[-1]
    left.fill_between(
        x, off[0], off[-1], color=BODIES[0], alpha=0.22, lw=0, label=f"{low:g} % … {high:g} % of the samples"
    )
    usual = [NormalDist().inv_cdf(min(max(level / 100.0, 1e-9), 1.0 - 1e-9)) for level in (low, high)]
    for sign, quantile in zip((-1.0, 1.0), usual, strict=True):
        left.plot(
            x, quantile * found.first_order * factor, color=BODIES[0], lw=1.3,
            label="the same to first order, if normal" if sign > 0 else None,
        )  # fmt: skip
        left.plot(
            x, sign * found.worst_case * factor, color=LIGHT["soft"], lw=1.0, ls=(0, (4, 3)),
            label="worst case" if sign > 0 else None,
        )  # fmt: skip
    furnish(left, "y")
    furnish(right, "x")
    left.set(xlabel=axis_name(symbol(driven), unit), ylabel=axis_name(f"deviation of {symbol(name)}", shown))
    left.margins(x=0.0)
    if unit == "deg" and np.ptp(x) >= 180.0:
        left.xaxis.set_major_locator(MultipleLocator(60.0))
    figure.legend(frameon=False, fontsize=NUMBERS, loc="outside lower left", ncols=3, handlelength=1.8)
    order = np.argsort(-found.shares, kind="stable")[:8]  # 8 dimensions are shown
    order = order[found.shares[order] > 5e-4][::-1]
    right.barh(np.arange(len(order)), 100.0 * found.shares[order], color=BODIES[1], height=0.62)
    right.set_yticks(np.arange(len(order)), [tolerance.variables[k] for k in order])
    right.set_xlabel("share of the variance [%]")
    heading = f"{tolerance.name}: tolerances and {name}" if title is None else title
    if heading:
        left.set_title(heading, loc="left", fontsize=HEADING, color=LIGHT["ink"], parse_math=False)
    return finish(figure, path, dpi)


def plot_suspension(
    report: "SuspensionReport", path: str | Path | None, names: Sequence[str], size: Size = 9.6
) -> Figure:
    """Draw the numbers of a report; see `SuspensionReport.plot`."""
    wanted = names or (_TRAVEL if report.travels else _STEERING)
    for name in names:
        if name not in report.curves:
            raise InputError(f"suspension plot: no number {name!r}; {nearest(name, report.curves)}")
    shown = [report[name] for name in wanted if name in report.curves]
    columns = 3  # side by side
    count = -(-len(shown) // columns)
    width, height = inches(size, lambda _: 1.8 * count + _ABOVE + _BELOW)  # 1.8 inches for a pair of axes
    figure = Picture(figsize=(width, height))  # margins are given: fitting them takes longer than all the rest
    grid = figure.subplots(count, columns, sharex=True, squeeze=False).reshape(-1)
    figure.subplots_adjust(
        left=_LEFT / width, right=1.0 - 0.12 / width, bottom=_BELOW / height, top=1.0 - _ABOVE / height, hspace=0.28,
        wspace=0.24,
    )  # fmt: skip
    for ax, row in zip(grid, shown, strict=False):
        _suspension_curve(ax, report, row)
    for ax in grid[len(shown) :]:
        ax.remove()
    for k in range(max(len(shown) - columns, 0), len(shown)):
        _suspension_axis(grid[k], report)
    look = {"fontsize": _LETTERS + 2, "color": LIGHT["ink"], "parse_math": False, "ha": "left", "va": "top"}
    figure.text(0.1 / width, 1.0 - 0.07 / height, f"{report.title} over {report.over}", gid="title", **look)
    return finish(figure, path, 160.0)


def _suspension_curve(ax: Axes, report: "SuspensionReport", row: "SuspensionRow") -> None:
    """Draw a number over travel, where it is as drawn marked with its value."""
    furnish(ax)
    low, high = float(np.nanmin(report.along)), float(np.nanmax(report.along))
    even = abs(low + high) < 1e-6 * (high - low)  # a few ticks each: they are most of what a sheet costs
    ax.xaxis.set_major_locator(FixedLocator(np.linspace(low, high, 5).tolist()) if even else MaxNLocator(5))
    ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    values = report.curves[row.name]
    order = np.argsort(report.along)
    ax.axvline(0.0, color=LIGHT["soft"], linewidth=0.7, zorder=1)
    ax.plot(report.along[order], values[order], color=BODIES[0], linewidth=1.5, gid=row.name)
    unit = f" [{row.unit}]" if row.unit else ""
    ax.set_title(row.label + unit, loc="left", fontsize=_LETTERS, color=LIGHT["ink"], parse_math=False, pad=4.0, y=1.0)
    known = np.append(values[np.isfinite(values)], row.static if np.isfinite(row.static) else [])
    if len(known):
        low, high = float(known.min()), float(known.max())
        wide = max(high - low, _LEAST.get(row.unit, 1e-3 * max(abs(high), 1e-6)))
        middle = 0.5 * (low + high)
        ax.set_ylim(middle - 0.62 * wide, middle + 0.62 * wide)
    if not np.isfinite(row.static):
        return
    ax.plot(0.0, row.static, "o", ms=4.5, mfc="white", mec=BODIES[1], mew=1.5, zorder=4, gid=f"static {row.name}")
    decimals = {"deg": 2, "mm": 1, "": 3}.get(row.unit, 2)
    text = f"{row.static:.{decimals}f}".replace("-", "−")
    if row.name == "half_track_change":
        text = f"track {report['track'].static:.1f} {row.unit}"
    rising = row.gradient > 0  # its value stands on the side that the curve leaves free
    ax.annotate(
        text, (0.0, row.static), (-6 if rising else 6, 4), textcoords="offset points",
        ha="right" if rising else "left", va="bottom", fontsize=_LETTERS - 0.5, color=BODIES[1], zorder=5,
    )  # fmt: skip


def _suspension_axis(ax: Axes, report: "SuspensionReport") -> None:
    ax.tick_params(labelbottom=True)
    ax.set_xlabel(f"{report.over.partition(',')[0]} [{report.unit}]", fontsize=_LETTERS, parse_math=False)
    low, high = ("rebound", "bump") if report.travels else ("right", "left")  # y points left
    if report.travels or report.over.startswith("rack"):
        for x, side, text in ((0.0, "left", low), (1.0, "right", high)):
            ax.annotate(
                text, (x, 0.0), (0, -21), xycoords="axes fraction", textcoords="offset points", ha=side, va="top",
                fontsize=_LETTERS - 1, color=LIGHT["soft"], annotation_clip=False,
            )  # fmt: skip
