"""All assemblies of a mechanism side by side."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.viz.drawing import draw
from jaxnc.viz.picture import finish

if TYPE_CHECKING:
    from jaxnc.kinematics.modes import Modes

_MOST = 40  # panels in a picture
_PANEL = 2.6  # inches


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
    count = min(len(modes), _MOST)
    if not count:
        raise InputError(f"{modes.poses.system.topology.name!r} has no assembly at these inputs, so none can be drawn")
    if columns < 1:
        raise InputError(f"columns must be at least 1, got {columns}")
    columns = min(columns, count)
    rows = math.ceil(count / columns)
    figure = Figure(figsize=(_PANEL * columns, _PANEL * rows), layout="constrained")
    space = modes.poses.system.topology.dim == 3
    for k in range(count):
        ax = figure.add_subplot(rows, columns, k + 1, projection="3d" if space else None)
        draw(modes.poses, k, ax=ax, title=str(k), labels=count <= 8, frame=False)
    return finish(figure, path, dpi)
