"""Branches and circuits over the range of an input."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.viz.drawing import draw
from jaxnc.viz.picture import Picture, Size, finish, inches
from jaxnc.viz.style import BODIES, LIGHT, LINES, NUMBERS, axis_name, crown, furnish, symbol

if TYPE_CHECKING:
    from jaxnc.kinematics.circuits import Circuits


@public
def draw_circuits(
    circuits: "Circuits",
    path: str | Path | None = None,
    over: str | None = None,
    title: str | None = None,
    size: Size = 9.6,
    dpi: float = 200.0,
) -> Figure:
    """Draw all branches over the input, a colour for each circuit, with an assembly of each beside them.

    Below stands how many assemblies there are.

    Args:
        circuits: the branches.
        path: file to write as well: PNG, SVG, PDF or JPG.
        over: the quantity that tells the branches apart: an angle, a distance or a single coordinate such as ``"C.y"``;
            the coordinate in which they are farthest from each other, if not given.
        title: heading; the mechanism's name if not given, none if ``""``.
        size: width of the figure, inches, with the height that it needs; or width and height.
        dpi: dots per inch of a file.

    Returns:
        The figure. Dead points are marked, where two branches meet; the drawing's circuit is the first.

    Raises:
        InputError: no assembly in the range, or no such quantity.
        OutputError: a file that cannot be written.
    """
    if not circuits.branches:
        raise InputError(f"no assembly over this range of {circuits.name!r}, so there is nothing to draw")
    top = circuits.branches[0].poses.system.topology
    over = over or _telling_apart(circuits)
    turned = np.degrees(1.0) if top.is_angle(over) else 1.0
    shown = circuits.branches[:6]  # there is room for six beside the curves
    figure = Picture(
        figsize=inches(size, lambda width: 0.5 * width), layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.05)
    )
    grid = figure.add_gridspec(1, 2, width_ratios=(1.15, 1.0))
    curves = grid[0].subgridspec(2, 1, height_ratios=(5, 1))
    ax = figure.add_subplot(curves[0])
    below = figure.add_subplot(curves[1], sharex=ax)
    factor = np.degrees(1.0) if circuits.angle else 1.0
    branches = [
        (np.asarray(b.poses.inputs[circuits.name]) * factor, np.asarray(b.poses[over]) * turned)
        for b in circuits.branches
    ]
    ends: dict[float, list[tuple[int, int]]] = {}  # at each dead point: branches that end there, and on which side
    for k, b in enumerate(circuits.branches):
        for side, value in ((0, b.lower), (-1, b.upper)):
            if b.dead[side]:
                ends.setdefault(value, []).append((k, side))
    for value, some in ends.items():  # branches meet halfway between their last poses
        meeting = float(np.mean([branches[k][1][side] for k, side in some]))
        ax.plot(value * factor, meeting, "o", ms=4.5, mfc="white", mec=LIGHT["ink"], mew=1.0, zorder=4)
        for k, side in some:
            x, y = branches[k]
            at = len(x) if side else 0
            branches[k] = np.insert(x, at, value * factor), np.insert(y, at, meeting)
    told = set()
    for k, (b, (x, y)) in enumerate(zip(circuits.branches, branches, strict=True)):
        whose = "the drawing's circuit" if b.circuit == circuits.drawn else f"circuit {b.circuit}"
        label = "_" if b.circuit in told else whose
        told.add(b.circuit)
        look = {"color": BODIES[b.circuit % len(BODIES)], "linestyle": LINES[b.circuit % len(LINES)]}
        ax.plot(x, y, linewidth=1.6, label=label, gid=f"branch {k}", **look)
        if k < len(shown):
            pose = len(x) // 2
            ax.plot(x[pose], y[pose], "o", ms=3.0, color=look["color"])
            ax.annotate(
                str(k), (x[pose], y[pose]), (3, 3), textcoords="offset points", fontsize=NUMBERS, color=LIGHT["ink"]
            )
    below.step(circuits.values * factor, circuits.count, where="mid", color=LIGHT["ink"], linewidth=1.2, gid="count")
    below.set_ylim(0, max(1, int(circuits.count.max())) * 1.15)
    below.yaxis.set_major_locator(MaxNLocator(3, integer=True))
    ax.set_xlim(circuits.values[0] * factor, circuits.values[-1] * factor)
    ax.set_ylabel(axis_name(symbol(over), "°" if top.is_angle(over) else top.unit(over)))
    below.set_ylabel("number")
    below.set_xlabel(axis_name(symbol(circuits.name), "°" if circuits.angle else top.unit(circuits.name)))
    for axes in (ax, below):
        furnish(axes)
    ax.tick_params(labelbottom=False)
    crown(ax, circuits.branches[0].poses.system.name if title is None else title)
    if circuits.angle:
        below.xaxis.set_major_locator(MaxNLocator(7, steps=[1, 1.5, 3, 4.5, 6, 9, 10]))
    columns = 1 if len(shown) <= 2 else 2
    panels = grid[1].subgridspec(-(-len(shown) // columns), columns)
    for k, branch in enumerate(shown):
        panel = figure.add_subplot(panels[k // columns, k % columns], projection="3d" if top.dim == 3 else None)
        draw(branch.poses, len(branch.poses.status) // 2, ax=panel, title=str(k), labels=False, frame=False)
    return finish(figure, path, dpi)


def _telling_apart(circuits: "Circuits") -> str:
    """Choose the coordinate in which branches are farthest from each other: the nearest two, over all values."""
    top = circuits.branches[0].poses.system.topology
    count = len(top.coordinates) - len(top.scalars)
    every = np.full((len(circuits.branches), len(circuits.values), count), np.nan)
    for k, branch in enumerate(circuits.branches):
        first = int(np.searchsorted(circuits.values, np.asarray(branch.poses.inputs[circuits.name])[0]))
        every[k, first : first + len(branch.poses.status)] = np.asarray(branch.poses.q)[:, :count]
    gaps = np.diff(np.sort(every, axis=0), axis=0)
    nearest = np.nan_to_num(gaps, nan=np.inf).min(axis=0, initial=np.inf)
    score = np.where(np.isfinite(nearest), nearest, 0.0).sum(axis=0)
    if not score.any():  # never two at once
        score = np.nanmax(every, axis=(0, 1)) - np.nanmin(every, axis=(0, 1))
    return top.coordinates[int(np.argmax(score))]
