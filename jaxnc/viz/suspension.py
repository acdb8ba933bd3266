"""A suspension's numbers over wheel travel or steering: small axes side by side, each with its own scale."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator

from jaxnc.errors import InputError, nearest
from jaxnc.viz.picture import Picture, Size, inches, save, sized
from jaxnc.viz.style import BODIES, LIGHT, furnish

if TYPE_CHECKING:
    from jaxnc.kinematics.wheel_report import SuspensionReport, SuspensionRow

_TEXT = 8.5  # points
_COLUMNS = 3
_HEIGHT = 1.8  # of one pair of axes, inches
_ABOVE, _BELOW, _LEFT = 0.55, 0.5, 0.5  # what is around them
_TRAVEL = (
    "toe", "camber", "caster", "kingpin_inclination", "half_track_change", "wheelbase_change", "roll_centre_height",
    "scrub_radius", "caster_trail", "brake_support_angle", "drive_support_angle", "motion_ratio",
)  # fmt: skip
_STEERING = ("steer", "toe_out_in_turns", "ackermann", "camber", "caster", "scrub_radius", "caster_trail")
_LEAST = {"deg": 0.1, "mm": 1.0, "": 0.02, "%": 1.0}
"""The least span of an axis, so that what hardly changes looks level."""


@sized
def sheet(report: "SuspensionReport", path: str | Path | None, names: Sequence[str], size: Size = 9.6) -> Figure:
    """Draw the numbers of a report; see `SuspensionReport.plot`."""
    wanted = names or (_TRAVEL if report.travels else _STEERING)
    for name in names:
        if name not in report.curves:
            raise InputError(f"suspension plot: no number {name!r}; {nearest(name, report.curves)}")
    shown = [report[name] for name in wanted if name in report.curves]
    count = -(-len(shown) // _COLUMNS)
    width, height = inches(size, lambda _: _HEIGHT * count + _ABOVE + _BELOW)
    figure = Picture(figsize=(width, height))  # margins are given: fitting them takes longer than all the rest
    FigureCanvasAgg(figure)
    grid = figure.subplots(count, _COLUMNS, sharex=True, squeeze=False).reshape(-1)
    figure.subplots_adjust(
        left=_LEFT / width, right=1.0 - 0.12 / width, bottom=_BELOW / height, top=1.0 - _ABOVE / height, hspace=0.28,
        wspace=0.24,
    )  # fmt: skip
    for ax, row in zip(grid, shown, strict=False):
        _curve(ax, report, row)
    for ax in grid[len(shown) :]:
        ax.remove()
    for k in range(max(len(shown) - _COLUMNS, 0), len(shown)):
        _below(grid[k], report)
    look = {"fontsize": _TEXT + 2, "color": LIGHT["ink"], "parse_math": False, "ha": "left", "va": "top"}
    figure.text(0.1 / width, 1.0 - 0.07 / height, f"{report.title} over {report.over}", gid="title", **look)
    if path is not None:
        save(figure, path, 160.0)
    return figure


def _curve(ax: Axes, report: "SuspensionReport", row: "SuspensionRow") -> None:
    """One number over travel, where it is as drawn marked with its value."""
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
    ax.set_title(row.label + unit, loc="left", fontsize=_TEXT, color=LIGHT["ink"], parse_math=False, pad=4.0, y=1.0)
    known = np.append(values[np.isfinite(values)], row.static if np.isfinite(row.static) else [])
    if len(known):
        low, high = float(known.min()), float(known.max())
        wide = max(high - low, _LEAST.get(row.unit, 1e-3 * max(abs(high), 1e-6)))
        middle = 0.5 * (low + high)
        ax.set_ylim(middle - 0.62 * wide, middle + 0.62 * wide)
    if not np.isfinite(row.static):
        return
    ax.plot(0.0, row.static, "o", ms=4.5, mfc="white", mec=BODIES[1], mew=1.5, zorder=4, gid=f"static {row.name}")
    text = f"{row.static:.{_digits(row)}f}".replace("-", "−")
    if row.name == "half_track_change":
        text = f"track {report['track'].static:.1f} {row.unit}"
    rising = row.gradient > 0  # its value stands on the side that the curve leaves free
    ax.annotate(
        text, (0.0, row.static), (-6 if rising else 6, 4), textcoords="offset points",
        ha="right" if rising else "left", va="bottom", fontsize=_TEXT - 0.5, color=BODIES[1], zorder=5,
    )  # fmt: skip


def _digits(row: "SuspensionRow") -> int:
    return {"deg": 2, "mm": 1, "": 3}.get(row.unit, 2)


def _below(ax: Axes, report: "SuspensionReport") -> None:
    ax.tick_params(labelbottom=True)
    ax.set_xlabel(f"{report.over.partition(',')[0]} [{report.unit}]", fontsize=_TEXT, parse_math=False)
    low, high = ("rebound", "bump") if report.travels else ("right", "left")  # y points left
    if report.travels or report.over.startswith("rack"):
        for x, side, text in ((0.0, "left", low), (1.0, "right", high)):
            ax.annotate(
                text, (x, 0.0), (0, -21), xycoords="axes fraction", textcoords="offset points", ha=side, va="top",
                fontsize=_TEXT - 1, color=LIGHT["soft"], annotation_clip=False,
            )  # fmt: skip
