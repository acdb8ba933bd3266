"""Burmester's curves on paper."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jaxnc.calls import public
from jaxnc.types import ArrayLike
from jaxnc.viz.picture import Picture, Size, inches, save, sized
from jaxnc.viz.style import BODIES, LIGHT, LINES, TEXT, crown, furnish

if TYPE_CHECKING:
    from jaxnc.synthesis.exact.burmester import BurmesterCurves

_FRAME = 2.6  # half width of the picture, in half widths of the poses and poles


@public
@sized
def burmester(
    curves: "BurmesterCurves",
    poses: ArrayLike | None = None,
    path: str | Path | None = None,
    title: str = "Circle points and their centres",
    size: Size = 6.4,
    dpi: float = 200.0,
) -> Figure:
    """Draw the circle-point and centre-point curves of four poses, their poles, and the poses as small frames.

    Args:
        curves: the curves.
        poses: x, y and angle of the body in each pose, ``(4, 3)``, to be drawn too.
        path: file to write as well: PNG, SVG, PDF or JPG.
        title: heading.
        size: width of the figure, inches, with the height that it needs; or width and height.
        dpi: dots per inch of a file.

    Raises:
        OutputError: a file that cannot be written.
    """
    figure = Picture(figsize=inches(size, lambda width: 0.82 * width), layout="constrained")
    FigureCanvasAgg(figure)
    ax = figure.add_subplot()
    ax.plot(*curves.circle.T, color=BODIES[0], lw=1.6, label="circle points, first pose", zorder=3)
    ax.plot(*curves.centre.T, color=BODIES[1], lw=1.6, ls=LINES[1], label="centre points", zorder=3)
    poles = curves.poles[np.isfinite(curves.poles).all(axis=1)]
    ax.plot(*poles.T, "o", ms=4.5, mfc="white", mec=LIGHT["ink"], mew=1.0, label="poles", zorder=4)
    frames = np.zeros((0, 3)) if poses is None else np.asarray(poses, float)
    known = frames[:, :2] if len(frames) else poles
    middle = 0.5 * (known.min(axis=0) + known.max(axis=0))
    half = _FRAME * max(float(np.ptp(known, axis=0).max()) / 2.0, 1e-300)
    for k, (x, y, angle) in enumerate(frames):
        for turn, shade in ((0.0, 1.0), (0.5 * np.pi, 0.5)):
            tip = 0.22 * half * np.array([np.cos(angle + turn), np.sin(angle + turn)]) * shade
            ax.annotate(
                "", (x + tip[0], y + tip[1]), (x, y), zorder=5,
                arrowprops={"arrowstyle": "-|>", "color": LIGHT["ink"], "lw": 1.0, "shrinkA": 0, "shrinkB": 0},
            )  # fmt: skip
        ax.annotate(str(k + 1), (x, y), (-8, -9), textcoords="offset points", fontsize=TEXT, color=LIGHT["ink"])
    ax.set_xlim(middle[0] - 1.22 * half, middle[0] + 1.22 * half)
    ax.set_ylim(middle[1] - half, middle[1] + half)
    ax.set_aspect("equal")
    furnish(ax)
    crown(ax, title)
    if path is not None:
        save(figure, path, dpi)
    return figure
