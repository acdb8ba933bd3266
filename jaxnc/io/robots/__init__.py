"""Files of robot simulators: mechanisms as trees of links whose loops are closed by constraints."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.io.robots.doors import from_mjcf, from_urdf
    from jaxnc.io.robots.export import Exported, to_mjcf, to_urdf
    from jaxnc.io.robots.robot import Robot

__all__ = ["Exported", "Robot", "from_mjcf", "from_urdf", "to_mjcf", "to_urdf"]

__getattr__, __dir__ = on_demand(__name__)
