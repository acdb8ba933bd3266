"""A pose inside of a page: SVG in the page's own colours, in the plane and in space."""

import base64
import io
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxnc.viz.poses import Poses
from jaxnc.viz.still import still

_LARGEST = 400_000  # letters of a drawing; larger ones are drawn as pixels
_DPI = 150.0
_SIZE = (6.4, 4.8)


def inlined(data: Poses, pose: int, traces: Sequence[int] = ()) -> str:
    """A pose as an element of a page that has the colours of `jaxnc.viz.page.colours`.

    `traces` are columns whose paths are drawn; if none, that of the last that moves.
    """
    if not traces and data.count > 2:
        moves = [k for k in range(len(data.names)) if np.ptp(data.places[data.shown, k], axis=0).any()]
        traces = moves[-1:]
    drawn = still(data, traces=traces, shown=pose) if data.dim == 2 else _in_space(data, pose, traces)
    return drawn if len(drawn) <= _LARGEST else _pixels(data, pose)


def _in_space(data: Poses, pose: int, traces: Sequence[int]) -> str:
    """Lines and letters in the page's colours, and what is shaded as pixels between them."""
    from matplotlib import rc_context
    from matplotlib.collections import PolyCollection

    from jaxnc.viz.drawing import draw
    from jaxnc.viz.style import LIGHT

    figure: Any = draw(data.motion, pose=pose, trace=[data.names[k] for k in traces], title="", size=_SIZE)
    figure.patch.set_visible(False)
    for ax in figure.axes:
        ax.patch.set_visible(False)
        for artist in ax.get_children():
            if isinstance(artist, PolyCollection):
                artist.set_rasterized(True)
    text = io.StringIO()
    settings: Any = {"svg.hashsalt": "jaxnc", "svg.fonttype": "none"}
    with rc_context(settings):
        figure.savefig(text, format="svg", dpi=_DPI, metadata={"Date": None})
    drawn = re.sub(r"<metadata>.*?</metadata>", "", text.getvalue()[text.getvalue().index("<svg") :], flags=re.S)
    drawn = re.sub(r"font-family: [^;\"]*;", "", drawn)
    drawn = re.sub(r'(<svg [^>]*?)width="[^"]*" height="[^"]*" ', r"\1", drawn, count=1)
    for name in ("ink", "soft", "paper"):
        drawn = drawn.replace(LIGHT[name], f"var(--{name})")
    return drawn


def _pixels(data: Poses, pose: int) -> str:
    from jaxnc.viz.drawing import draw

    figure: Any = draw(data.motion, pose=pose, title="", size=_SIZE)
    raw = io.BytesIO()
    figure.savefig(raw, format="png", dpi=_DPI)
    return f'<img alt="the mechanism" src="data:image/png;base64,{base64.b64encode(raw.getvalue()).decode()}">'
