"""Ready mechanisms by the names they have on the command line."""

import inspect
from collections.abc import Callable

from jaxnc.library import bars, gears, robots, sliders, spatial_loops, straight_lines, suspensions
from jaxnc.mechanism import Mechanism

CATALOGUE: dict[str, Callable[..., Mechanism]] = {
    name.replace("_", "-"): draw
    for module in (bars, gears, robots, sliders, spatial_loops, straight_lines, suspensions)
    for name, draw in vars(module).items()
    if inspect.isfunction(draw) and draw.__module__ == module.__name__ and not name.startswith("_")
}
"""Every function of the library by its name with dashes. Called without arguments, each returns a mechanism whose
``model.run`` holds a default drive."""
