"""Seeing a mechanism: drawings, plots, animations and pages. Loaded on first use; matplotlib is needed only here."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.viz.animation import animate as animate
    from jaxnc.viz.burmester_curves import burmester as burmester
    from jaxnc.viz.deviation import band as band
    from jaxnc.viz.drawing import draw as draw
    from jaxnc.viz.energy import plot_energy as plot_energy
    from jaxnc.viz.families import plot_families as plot_families
    from jaxnc.viz.gallery import sheet as sheet
    from jaxnc.viz.notebook import Widget as Widget
    from jaxnc.viz.page import to_html as to_html
    from jaxnc.viz.paper import motion_sheet as motion_sheet
    from jaxnc.viz.plots import plot as plot
    from jaxnc.viz.polygons import polygon as polygon


__getattr__, __dir__ = on_demand(__name__)
