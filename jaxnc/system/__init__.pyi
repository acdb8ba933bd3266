from jaxnc.kinematics.closure import closed as closed
from jaxnc.system.equations import Equations as Equations
from jaxnc.system.equations import jacobian as jacobian
from jaxnc.system.equations import residual as residual
from jaxnc.system.system import Parameters as Parameters
from jaxnc.system.system import System as System
from jaxnc.system.topology import Topology as Topology
