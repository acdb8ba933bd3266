"""Figures that notebooks show and files keep, the same bytes each time."""

import io
from collections.abc import Callable
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jaxnc.errors import InputError
from jaxnc.io.target import writing

Size = float | tuple[float, float]
"""Of a figure, inches: its width and height, or a width alone."""

PICTURES = (".png", ".svg", ".pdf", ".jpg")
"""Files that a figure can be written to."""


class Picture(Figure):
    """A figure that notebooks show, without the global state of pyplot."""

    def __init__(self, **options: Any):
        super().__init__(**options)
        FigureCanvasAgg(self)

    def _repr_png_(self) -> bytes:
        data = io.BytesIO()
        FigureCanvasAgg(self).print_png(data)
        return data.getvalue()


def unit_on(paper: np.ndarray) -> float:
    """Choose the size of a unit on paper of some width and height ``(2,)``, points: smaller on small paper."""
    # 4.6 points is the radius of a joint on paper, in a figure of its own
    return 4.6 * float(np.clip(paper.min() / 230.0, 0.3, 1.0))


def inches(size: Size, height: Callable[[float], float] = lambda width: width / 1.28) -> tuple[float, float]:
    """Read width and height of a figure, with the height that belongs to a width alone."""
    given = np.asarray(size)
    given = given.astype(float) if given.dtype.kind in "iuf" and given.size in (1, 2) else np.array(np.nan)
    if not ((given >= 1) & (given <= 200)).all():
        raise InputError(
            f"size={size!r}: expected a width in inches, such as 6.4, or width and height, (6.4, 5.0); from 1 to 200"
        )
    wide, *high = given.reshape(-1).tolist()
    return wide, high[0] if high else height(wide)


def dots(dpi: float) -> float:
    """Read the dots per inch of a file."""
    # Letters of the smallest figures have no height below 15.
    if isinstance(dpi, bool) or not isinstance(dpi, Real) or not 20 <= dpi <= 2400:
        raise InputError(f"dpi={dpi!r}: expected dots per inch, such as 200; from 20 to 2400")
    return dpi


def finish(figure: Figure, path: str | Path | None, dpi: float = 200.0) -> Figure:
    """Write a figure to a file if there is a path, the same bytes each time; returns the figure."""
    dpi = dots(dpi)
    if path is not None:
        settings: Any = {"svg.hashsalt": "jaxnc", "pdf.fonttype": 42}
        undated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
        with writing(path, PICTURES, "a picture") as new, rc_context(settings):
            figure.savefig(new, dpi=dpi, metadata=undated.get(new.suffix.lower()))
    return figure
