"""How things show themselves in a notebook: a drawing and a few lines of text, quickly; pages as they are."""

import base64
import html
from pathlib import Path
from typing import Any

from jaxnc.errors import JaxncError
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.system.system import System
from jaxnc.viz.poses import poses
from jaxnc.viz.still import still
from jaxnc.viz.typed import caption

_TEXT = "font:13px/1.5 system-ui,sans-serif;white-space:pre-wrap;margin:2px 0 0"


def shown(thing: Mechanism | System | Motion) -> str:
    """A drawing and what is to be said of it, as HTML.

    Args:
        thing: a mechanism, a system or a motion; a batch, or what cannot be drawn, is said in words only.
    """
    words = str(thing) if isinstance(thing, (System, Motion)) else f"{thing!r}\n{caption(thing)}"
    try:
        picture = _picture(thing)
    except JaxncError:
        picture = ""
    return f'<div style="max-width:480px">{picture}<div style="{_TEXT}">{html.escape(words)}</div></div>'


def _picture(thing: Mechanism | System | Motion) -> str:
    data = poses(thing)
    if data.dim == 2:
        return still(data, paper=True)
    from jaxnc.viz.drawing import draw

    figure = draw(thing, pose=int(data.shown[0]), size=(4.8, 3.6), title="")
    return f'<img alt="" src="data:image/png;base64,{base64.b64encode(_png(figure)).decode()}">'


def _png(figure: Any) -> bytes:
    return figure._repr_png_()


class Page(type(Path())):
    """The path of a page, which a notebook shows as the page."""

    def _repr_html_(self) -> str:
        try:
            text = self.read_text(encoding="utf-8")
        except OSError:
            return html.escape(str(self))
        look = "width:100%;height:760px;border:0"
        return f'<iframe style="{look}" sandbox="allow-scripts allow-downloads" srcdoc="{html.escape(text)}"></iframe>'


class Animation(type(Path())):
    """The path of an animation, which a notebook shows as the animation."""

    def _repr_html_(self) -> str:
        try:
            data = base64.b64encode(self.read_bytes()).decode()
        except OSError:
            return html.escape(str(self))
        if self.suffix.lower() == ".mp4":
            return f'<video controls loop src="data:video/mp4;base64,{data}"></video>'
        return f'<img alt="{html.escape(self.name)}" src="data:image/gif;base64,{data}">'
