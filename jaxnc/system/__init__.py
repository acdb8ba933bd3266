"""The compiled mechanism: static topology, differentiable parameters, residual and Jacobian."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.kinematics.closure import closed as closed
    from jaxnc.system.equations import Equations as Equations
    from jaxnc.system.equations import jacobian as jacobian
    from jaxnc.system.equations import residual as residual
    from jaxnc.system.system import Parameters as Parameters
    from jaxnc.system.system import System as System
    from jaxnc.system.topology import Topology as Topology


__getattr__, __dir__ = on_demand(__name__)
