"""Several mechanisms on one sheet."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.viz.drawing import draw
from jaxnc.viz.picture import Picture, save


@public
def sheet(
    items: Iterable[Motion | tuple[Motion, Mapping[str, Any]]] | Mapping[str, Motion],
    path: str | Path,
    columns: int | None = None,
    cell: tuple[float, float] = (3.2, 2.9),
    dpi: float = 200.0,
    **options: Any,
) -> Path:
    """Draw several motions in a grid.

    Args:
        items: motions, each alone or with its own options of `draw`, or motions by title.
        path: file to write: PNG, SVG, PDF or JPG.
        columns: how many side by side; about as many as rows, with few empty places, if not given.
        cell: width and height of each, inches.
        dpi: dots per inch.
        **options: options of `draw` for all; each is drawn with a scale, without axes, unless ``frame`` says so.

    Raises:
        InputError: no items, or as in `draw`.
        OutputError: a file that cannot be written.
    """
    if isinstance(items, Mapping):
        items = [(motion, {"title": title}) for title, motion in items.items()]
    cells = [item if isinstance(item, tuple) else (item, {}) for item in items]
    if not cells:
        raise InputError("a sheet needs at least one motion; items is empty")
    wide = columns if columns is not None else abreast(len(cells), math.ceil(math.sqrt(len(cells))))
    if wide < 1:
        raise InputError(f"columns={columns!r}: a sheet has at least one column")
    wide = min(wide, len(cells))
    high = math.ceil(len(cells) / wide)
    figure = Picture(figsize=(wide * cell[0], high * cell[1]))
    FigureCanvasAgg(figure)
    title, gap = 0.28 / cell[1], 0.1 / cell[0]
    for k, (motion, own) in enumerate(cells):
        row, column = divmod(k, wide)
        ax = figure.add_axes(
            (
                (column + gap) / wide,
                1.0 - (row + 1 - gap) / high,
                (1 - 2 * gap) / wide,
                (1 - gap - title) / high,
            ),
            projection="3d" if isinstance(motion, Motion) and motion.system.topology.dim == 3 else None,
        )
        draw(motion, ax=ax, **{"frame": "scale", **options, **own})
    return save(figure, path, dpi)


def abreast(count: int, usual: int) -> int:
    """How many of some pictures stand side by side: about as many as is usual, with few empty places."""
    if count <= usual:
        return count
    return min(range(max(usual - 1, 2), usual + 1), key=lambda n: -count % n + 1.1 * (usual - n))
