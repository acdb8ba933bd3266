"""Files of robot simulators: mechanisms as trees of links whose loops are closed by constraints."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.io.robots.export import Exported, to_mjcf
    from jaxnc.io.robots.robot import Robot, from_mjcf

__all__ = ["Exported", "Robot", "from_mjcf", "to_mjcf"]

__getattr__, __dir__ = on_demand(
    __name__,
    {
        "jaxnc.io.robots.export": ("Exported", "to_mjcf"),
        "jaxnc.io.robots.robot": ("Robot", "from_mjcf"),
    },
)
