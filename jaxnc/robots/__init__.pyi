from jaxnc.robots.api import Exported as Exported
from jaxnc.robots.api import from_mjcf as from_mjcf
from jaxnc.robots.api import from_urdf as from_urdf
from jaxnc.robots.api import to_mjcf as to_mjcf
from jaxnc.robots.api import to_urdf as to_urdf
from jaxnc.robots.robot import Robot as Robot
