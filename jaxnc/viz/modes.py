"""All assemblies side by side, their number and dexterity as maps over two inputs, and branches over one."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from jaxnc.calls import public
from jaxnc.errors import InputError, nearest
from jaxnc.viz.drawing import draw
from jaxnc.viz.picture import Picture, Size, finish, inches
from jaxnc.viz.style import BODIES, FOUND, LIGHT, LINES, NUMBERS, TEXT, axis_name, crown, furnish, mix, symbol

if TYPE_CHECKING:
    from jaxnc.kinematics.circuits import Circuits
    from jaxnc.kinematics.dexterity import Dexterity
    from jaxnc.kinematics.modes import Modes, ModesMap
    from jaxnc.system.topology import Topology


@public
def draw_modes(modes: "Modes", path: str | Path | None = None, columns: int = 4, dpi: float = 150.0) -> Figure:
    """Draw all assemblies side by side, in the order of their list; the first forty of many.

    Args:
        modes: the assemblies.
        path: file to write as well: PNG, SVG, PDF or JPG.
        columns: how many stand in a row.
        dpi: dots per inch of a file.

    Returns:
        The figure.

    Raises:
        InputError: no assembly, or no column.
        OutputError: a file that cannot be written.
    """
    count = min(len(modes), 40)  # panels in a picture
    if not count:
        raise InputError(f"{modes.poses.system.topology.name!r} has no assembly at these inputs, so none can be drawn")
    if columns < 1:
        raise InputError(f"columns must be at least 1, got {columns}")
    columns = min(columns, count)
    rows = math.ceil(count / columns)
    side = 2.6  # inches of a panel
    figure = Figure(figsize=(side * columns, side * rows), layout="constrained")
    space = modes.poses.system.topology.dim == 3
    for k in range(count):
        ax = figure.add_subplot(rows, columns, k + 1, projection="3d" if space else None)
        draw(modes.poses, k, ax=ax, title=str(k), labels=count <= 8, frame=False)
    return finish(figure, path, dpi)


@public
def draw_modes_map(
    modes: "ModesMap",
    path: str | Path | None = None,
    title: str | None = None,
    size: Size = (5.6, 5.0),
    dpi: float = 200.0,
) -> Figure:
    """Draw the number of assemblies over two inputs, and the singularity loci, where two of them meet.

    Args:
        modes: the assemblies on a grid of two inputs, ``(m, n)``, one input along each axis.
        path: file to write as well: PNG, SVG, PDF or JPG.
        title: heading; the mechanism's name if not given, none if ``""``.
        size: width and height, inches.
        dpi: dots per inch of a file.

    Returns:
        The figure. Places at which assemblies may be missing are crossed out.

    Raises:
        InputError: the inputs are no such grid.
        OutputError: a file that cannot be written.
    """
    top = modes.poses.system.topology
    figure = Picture(figsize=inches(size), layout="constrained")
    ax = figure.add_subplot()
    x, y, across = map_axes(ax, modes.inputs, top)
    count, doubtful = (a if across else a.T for a in (modes.count, modes.doubtful))
    numbers = np.unique(count)
    shade = {int(n): mix(FOUND, LIGHT["paper"], 0.85 * k / max(1, len(numbers) - 1)) for k, n in enumerate(numbers)}
    which = np.searchsorted(numbers, count)
    ax.pcolormesh(x, y, which.T, cmap=ListedColormap([*shade.values()]), vmin=-0.5, vmax=len(numbers) - 0.5)
    if len(numbers) > 1:
        levels = np.arange(0.5, len(numbers) - 1)
        ax.contour(x, y, which.T, levels=levels, colors=LIGHT["ink"], linewidths=1.0)
    at = np.argwhere(doubtful)
    ax.plot(x[at[:, 0]], y[at[:, 1]], "x", color=LIGHT["failure"], ms=3)
    handles = [Patch(facecolor=c, edgecolor=LIGHT["soft"], label=str(n), linewidth=0.5) for n, c in shade.items()]
    legend = figure.legend(
        handles=handles, loc="outside right upper", frameon=False, fontsize=NUMBERS, title="assemblies"
    )
    legend.get_title().set_fontsize(NUMBERS)
    crown(ax, top.name if title is None else title)
    return finish(figure, path, dpi)


MEASURES = ("dexterity", "manipulability")
"""What `draw_dexterity` draws."""


@public
def draw_dexterity(
    found: "Dexterity",
    path: str | Path | None = None,
    measure: str = "dexterity",
    title: str | None = None,
    size: Size = (5.9, 5.0),
    dpi: float = 200.0,
) -> Figure:
    """Draw a measure of dexterity over two inputs, with the singularity loci of both kinds.

    Args:
        found: the measures on a grid of two inputs, ``(m, n)``, one input along each axis.
        path: file to write as well: PNG, SVG, PDF or JPG.
        measure: ``"dexterity"`` or ``"manipulability"``.
        title: heading; the mechanism's name if not given, none if ``""``.
        size: width and height, inches.
        dpi: dots per inch of a file.

    Returns:
        The figure. Places that are not reached are white. Of a hand that has as many directions as there are actuators
        a full line is where it is not held, a dashed one where it loses a direction.

    Raises:
        InputError: the inputs are no such grid, or another measure.
        OutputError: a file that cannot be written.
    """
    if measure not in MEASURES:
        raise InputError(f"draw_dexterity(): no measure {measure!r}; {nearest(str(measure), MEASURES)}")
    top = found.motion.system.topology
    figure = Picture(figsize=inches(size), layout="constrained")
    ax = figure.add_subplot()
    x, y, across = map_axes(ax, {n: np.asarray(v) for n, v in found.motion.inputs.items()}, top)
    values, held = (a.T if across else a for a in (getattr(found, measure), found.held))
    shade = LinearSegmentedColormap.from_list("jaxnc", [mix(FOUND, LIGHT["paper"], 0.08), FOUND])
    finite = np.where(np.isfinite(values), values, np.nan)
    mesh = ax.pcolormesh(x, y, finite, cmap=shade, vmin=0.0)
    bar = figure.colorbar(mesh, ax=ax, shrink=0.9)
    bar.set_label(measure, fontsize=TEXT)
    bar.ax.tick_params(labelsize=NUMBERS)
    rows, columns = found.jacobian.shape[-2:]
    loci = [(held, "-", "not held")]
    if rows == columns:
        with np.errstate(invalid="ignore"):
            lost = np.linalg.det(np.where(np.isfinite(found.jacobian), found.jacobian, np.nan)) * found.held
        loci.append((lost.T if across else lost, "--", "loses a direction"))
    for locus, line, label in loci:
        if np.nanmin(locus, initial=1.0) < 0.0 < np.nanmax(locus, initial=-1.0):
            ax.contour(x, y, locus, levels=[0.0], colors=LIGHT["failure"], linewidths=1.3, linestyles=line)
            ax.plot([], [], color=LIGHT["failure"], linestyle=line, linewidth=1.3, label=label)
    crown(ax, top.name if title is None else title)
    return finish(figure, path, dpi)


def map_axes(ax: Axes, inputs: dict[str, np.ndarray], top: "Topology") -> tuple[np.ndarray, np.ndarray, bool]:
    """Name the axes of a map over two inputs; their values, and whether the first of them runs along the first axis."""
    moving = {n: v for n, v in inputs.items() if np.ptp(v) > 0.0}
    grid = len(moving) == 2 and all(v.ndim == 2 for v in moving.values())
    first, second = moving.values() if grid else (np.zeros((1, 1)),) * 2
    across = grid and bool((first == first[:, :1]).all() and (second == second[:1]).all())
    if not across and not (grid and (first == first[:1]).all() and (second == second[:, :1]).all()):
        shapes = ", ".join(f"{n}: {v.shape}" for n, v in inputs.items())
        raise InputError(
            f"a map of {top.name!r} is over two inputs on a grid, such as np.meshgrid(x, y, indexing='ij') gives; got "
            f"{shapes}, of which {len(moving)} vary"
        )
    furnish(ax, grid="")
    values = []
    for name, v, axis in zip(moving, (first, second), (ax.xaxis, ax.yaxis), strict=True):
        factor, text = in_degrees(top, name)
        values.append(np.unique(v) * factor)
        axis.set_label_text(text)
    return values[0], values[1], across


def in_degrees(top: "Topology", name: str) -> tuple[float, str]:
    """Find what values of a coordinate are multiplied by to be shown, angles in degrees, and the name of their axis."""
    if top.is_angle(name):
        return float(np.degrees(1.0)), axis_name(symbol(name), "°")
    return 1.0, axis_name(symbol(name), top.unit(name))


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
    (factor, along), (turned, across) = in_degrees(top, circuits.name), in_degrees(top, over)
    shown = circuits.branches[:6]  # there is room for six beside the curves
    figure = Picture(
        figsize=inches(size, lambda width: 0.5 * width), layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.05)
    )
    grid = figure.add_gridspec(1, 2, width_ratios=(1.15, 1.0))
    curves = grid[0].subgridspec(2, 1, height_ratios=(5, 1))
    ax = figure.add_subplot(curves[0])
    below = figure.add_subplot(curves[1], sharex=ax)
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
    ax.set_ylabel(across)
    below.set(xlabel=along, ylabel="number")
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
