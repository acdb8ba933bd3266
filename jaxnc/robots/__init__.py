"""Files of robot simulators: mechanisms as trees of links whose loops are closed by constraints."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.robots.api import Exported as Exported
    from jaxnc.robots.api import from_mjcf as from_mjcf
    from jaxnc.robots.api import from_urdf as from_urdf
    from jaxnc.robots.api import to_mjcf as to_mjcf
    from jaxnc.robots.api import to_urdf as to_urdf
    from jaxnc.robots.robot import Robot as Robot


__getattr__, __dir__ = on_demand(__name__)
