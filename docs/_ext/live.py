"""The page on the first page: a mechanism that is dragged in the browser, made when the site is built."""

from pathlib import Path

import numpy as np
from sphinx.application import Sphinx

import jaxnc as nc

LIVE = Path(__file__).parent.parent / "_static" / "live"


def make(app: Sphinx) -> None:
    """Write the page."""
    LIVE.mkdir(exist_ok=True)
    leg = nc.library.jansen_leg()
    motion = nc.sweep(leg.compile(), {"phi": np.linspace(0, 2 * np.pi, 181)})
    motion.to_html(LIVE / "leg.html", trace="F", model=leg)


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.connect("builder-inited", make)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
