"""Seeing a mechanism: drawings, plots, animations and pages. Loaded on first use; matplotlib is needed only here."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.viz.animation import animate
    from jaxnc.viz.burmester_curves import burmester
    from jaxnc.viz.deviation import band
    from jaxnc.viz.drawing import draw
    from jaxnc.viz.energy import plot_energy
    from jaxnc.viz.families import plot_families
    from jaxnc.viz.gallery import sheet
    from jaxnc.viz.notebook import Widget
    from jaxnc.viz.page import to_html
    from jaxnc.viz.paper import motion_sheet
    from jaxnc.viz.plots import plot
    from jaxnc.viz.polygons import polygon

__all__ = [
    "Widget",
    "animate",
    "band",
    "burmester",
    "draw",
    "motion_sheet",
    "plot",
    "plot_energy",
    "plot_families",
    "polygon",
    "sheet",
    "to_html",
]

__getattr__, __dir__ = on_demand(__name__)
