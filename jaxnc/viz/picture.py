"""Figures that notebooks show and files keep, the same bytes each time."""

import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jaxnc.viz.output import writing

PICTURES = (".png", ".svg", ".pdf", ".jpg")
"""Files that a figure can be written to."""

_UNIT = 4.6  # radius of a joint on paper, points, in a figure of its own


class Picture(Figure):
    """A figure that notebooks show, without the global state of pyplot."""

    def _repr_png_(self) -> bytes:
        data = io.BytesIO()
        FigureCanvasAgg(self).print_png(data)
        return data.getvalue()


def unit_on(paper: np.ndarray) -> float:
    """Size of a unit on paper of some width and height ``(2,)``, points: smaller on small paper."""
    return _UNIT * float(np.clip(paper.min() / 230.0, 0.3, 1.0))


def save(figure: Figure, path: str | Path, dpi: float = 200.0) -> Path:
    """Write a figure to a file, the same bytes each time.

    Raises:
        OutputError: unknown suffix, or a file that cannot be written.
    """
    settings: Any = {"svg.hashsalt": "jaxnc", "pdf.fonttype": 42}
    undated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with writing(path, PICTURES, "a picture") as new, rc_context(settings):
        figure.savefig(new, dpi=dpi, metadata=undated.get(new.suffix.lower()))
    return Path(path).expanduser()
