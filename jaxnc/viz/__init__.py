"""Seeing a mechanism: drawings, plots, animations and pages. Loaded on first use; matplotlib is needed only here."""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jaxnc.viz.animation import animate
    from jaxnc.viz.band import band
    from jaxnc.viz.burmester import burmester
    from jaxnc.viz.drawing import draw
    from jaxnc.viz.energy import plot_energy
    from jaxnc.viz.families import plot_families
    from jaxnc.viz.gallery import sheet
    from jaxnc.viz.page import to_html
    from jaxnc.viz.plots import plot

_HOME = {
    "animate": "jaxnc.viz.animation",
    "band": "jaxnc.viz.band",
    "burmester": "jaxnc.viz.burmester",
    "draw": "jaxnc.viz.drawing",
    "plot": "jaxnc.viz.plots",
    "plot_energy": "jaxnc.viz.energy",
    "plot_families": "jaxnc.viz.families",
    "sheet": "jaxnc.viz.gallery",
    "to_html": "jaxnc.viz.page",
}

__all__ = ["animate", "band", "burmester", "draw", "plot", "plot_energy", "plot_families", "sheet", "to_html"]


def __getattr__(name: str):
    if name in _HOME:
        return getattr(importlib.import_module(_HOME[name]), name)
    raise AttributeError(f"module 'jaxnc.viz' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
