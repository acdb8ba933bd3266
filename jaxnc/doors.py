"""The doors of the engine: its methods that are carried out by a package above.

`Mechanism.save` belongs to a mechanism and is done by `jaxnc.io`. The function that does it is named here as text and
loaded when the method is called, so that no module imports upward, not even within a function. `tests/test_floors.py`
reads this table: every door leads upward to a function that there is, and is opened somewhere.
"""

import importlib
from collections.abc import Callable

DOORS = {
    "Mechanism.compile": "jaxnc.system.assemble:compile_mechanism",
    "Mechanism.save": "jaxnc.io.files:save",
    "Mechanism.to_mjcf": "jaxnc.robots:to_mjcf",
    "Mechanism.to_urdf": "jaxnc.robots:to_urdf",
    "Circuits.draw": "jaxnc.viz.modes:draw_circuits",
    "Dexterity.draw": "jaxnc.viz.modes:draw_dexterity",
    "ModesMap.draw": "jaxnc.viz.modes:draw_modes_map",
    "Modes.draw": "jaxnc.viz.modes:draw_modes",
    "Motion.plot": "jaxnc.viz.plots:plot",
    "Motion.polygon": "jaxnc.viz.polygons:polygon",
    "Motion.animate": "jaxnc.viz.animation:animate",
    "Motion.to_html": "jaxnc.viz.pages.page:to_html",
    "Motion.to_csv": "jaxnc.io.tables:to_csv",
    "Motion.to_npz": "jaxnc.io.tables:to_npz",
    "Motion.to_parts": "jaxnc.workshop:to_parts",
    "Motion.to_frame": "jaxnc.io.tables:to_frame",
    "Motion.to_xarray": "jaxnc.io.tables:to_xarray",
    "SuspensionReport.plot": "jaxnc.viz.studies:plot_suspension",
    "System.degrees_of_freedom": "jaxnc.solvers.assembly:with_degrees_of_freedom",
    "System.extended": "jaxnc.dynamics.extended:look_around",
    "draw": "jaxnc.viz.drawing:draw",
    "show_html": "jaxnc.viz.svg:show_html",
}
"""By door: the module and the function that it leads to."""


def door(name: str) -> Callable:
    """Load the function that a door leads to."""
    module, _, function = DOORS[name].partition(":")
    return getattr(importlib.import_module(module), function)
