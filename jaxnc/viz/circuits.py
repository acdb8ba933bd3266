"""Branches and circuits over the range of an input."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.viz.drawing import draw
from jaxnc.viz.picture import finish

if TYPE_CHECKING:
    from jaxnc.kinematics.circuits import Circuits


@public
def draw_circuits(
    circuits: "Circuits",
    path: str | Path | None = None,
    over: str | None = None,
    size: tuple[float, float] = (9.0, 4.5),
    dpi: float = 150.0,
) -> Figure:
    """Draw all branches over the input, a colour for each circuit, with an assembly of each beside them.

    Args:
        circuits: the branches.
        path: file to write as well: PNG, SVG, PDF or JPG.
        over: the quantity that tells the branches apart: an angle, a distance or a single coordinate such as ``"C.y"``;
            the coordinate in which they differ most, if not given.
        size: width and height, inches.
        dpi: dots per inch of a file.

    Returns:
        The figure. Dead points are marked; the drawing's circuit is the first.

    Raises:
        InputError: no assembly in the range, or no such quantity.
        OutputError: a file that cannot be written.
    """
    if not circuits.branches:
        raise InputError(f"no assembly over this range of {circuits.name!r}, so there is nothing to draw")
    top = circuits.branches[0].poses.system.topology
    if over is None:
        spread = [np.ptp(np.concatenate([np.asarray(b.poses.q) for b in circuits.branches]), axis=0)]
        over = top.coordinates[int(np.argmax(spread[0][: len(top.coordinates) - len(top.scalars)]))]
    shown = circuits.branches[:6]  # 6 assemblies beside the curves
    figure = Figure(figsize=size, layout="constrained")
    rows = max(1, (len(shown) + 1) // 2)
    grid = figure.add_gridspec(rows, 4)
    ax = figure.add_subplot(grid[:, :2])
    turn = np.degrees(1.0) if circuits.angle else 1.0
    for k, branch in enumerate(circuits.branches):
        x, y = np.asarray(branch.poses.inputs[circuits.name]) * turn, np.asarray(branch.poses[over])
        ax.plot(x, y, color=f"C{branch.circuit % 10}", lw=1.8)
        middle = len(x) // 2
        if k < len(shown):
            ax.annotate(str(k), (x[middle], y[middle]), fontsize=8)
        for dead, end in zip(branch.dead, (0, -1), strict=True):
            if dead:
                ax.plot(x[end], y[end], "o", color="0.2", ms=4)
    ax.set_xlabel(f"{circuits.name}, {'°' if circuits.angle else top.length_unit}")
    ax.set_ylabel(over)
    for k, branch in enumerate(shown):
        place = grid[k // 2, 2 + k % 2]
        panel = figure.add_subplot(place, projection="3d" if top.dim == 3 else None)
        draw(branch.poses, len(branch.poses.status) // 2, ax=panel, title=str(k), labels=False, frame=False)
    return finish(figure, path, dpi)
