"""Families of coordinates side by side: sizes, cost, and how far away Newton's method may start."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.families.compare import SPREADS, Comparison
from jaxnc.viz.picture import Size, inches, save, sized
from jaxnc.viz.style import BODIES, LIGHT, LINES, NUMBERS, TEXT, crown, furnish


@public
@sized
def plot_families(
    comparison: Comparison, path: str | Path | None = None, size: Size = 9.6, dpi: float = 200.0
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
    rows = [row for row in comparison.families if row.n is not None]
    if not rows:
        raise InputError(f"{comparison.mechanism!r}: no family has numbers to plot")
    figure = Figure(figsize=inches(size, lambda width: 0.36 * width), layout="constrained")
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
    axes[2].set_xlabel("distance of the start, part of the size")
    axes[2].set_ylabel("ends at the drawing's assembly")
    axes[2].legend(frameon=False, fontsize=NUMBERS, handlelength=3.6)  # so that dashes are seen beside the mark
    for axis, grid in zip(axes, "xxy", strict=True):
        furnish(axis, grid)
    axes[0].tick_params(axis="y", labelsize=TEXT)
    crown(axes[0], room=0.3 * inches(size)[0])
    if path is not None:
        save(figure, path, dpi)
    return figure
