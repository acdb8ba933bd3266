"""The doors of the engine: its methods that are carried out by a package above.

`Mechanism.save` belongs to a mechanism and is done by `jaxnc.io`. The function that does it is named here as text and
loaded when the method is called, so that no module imports upward, not even within a function. `tests/test_floors.py`
reads this table: every door leads upward to a function that there is, and is opened somewhere.
"""

import importlib
from collections.abc import Callable
from typing import Any

DOORS = {
    "Mechanism.compile": "jaxnc.system.assemble:compile_mechanism",
    "Mechanism.save": "jaxnc.io.files:save",
    "Mechanism.to_mjcf": "jaxnc.robots:to_mjcf",
    "Mechanism.to_urdf": "jaxnc.robots:to_urdf",
    "System.degrees_of_freedom": "jaxnc.solvers.assembly:with_degrees_of_freedom",
    "System.extended": "jaxnc.dynamics.extended:look_around",
    "draw": "jaxnc.viz.drawing:draw",
    "show_html": "jaxnc.viz.repr_html:show_html",
}
"""By door: the module and the function that it leads to."""


def door(name: str) -> Callable[..., Any]:
    """Load the function that a door leads to."""
    module, _, function = DOORS[name].partition(":")
    return getattr(importlib.import_module(module), function)
