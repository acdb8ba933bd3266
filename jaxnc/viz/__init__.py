"""Seeing a mechanism: drawings, plots, animations and pages. Loaded on first use; matplotlib is needed only here."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.viz.animation import animate as animate
    from jaxnc.viz.circuits import draw_circuits as draw_circuits
    from jaxnc.viz.drawing import draw as draw
    from jaxnc.viz.modes import draw_modes as draw_modes
    from jaxnc.viz.pages.page import to_html as to_html
    from jaxnc.viz.pages.widget import Widget as Widget
    from jaxnc.viz.paper import motion_sheet as motion_sheet
    from jaxnc.viz.plots import plot as plot
    from jaxnc.viz.polygons import polygon as polygon
    from jaxnc.viz.studies import band as band
    from jaxnc.viz.studies import plot_energy as plot_energy
    from jaxnc.viz.studies import plot_families as plot_families
    from jaxnc.viz.synthesis import burmester as burmester


__getattr__, __dir__ = on_demand(__name__)
