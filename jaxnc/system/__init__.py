"""The compiled mechanism: static topology, differentiable parameters, residual and Jacobian."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.system.equations import Equations, jacobian, residual
    from jaxnc.system.system import Parameters, System
    from jaxnc.system.topology import Topology

__all__ = ["Equations", "Parameters", "System", "Topology", "jacobian", "residual"]

__getattr__, __dir__ = on_demand(__name__)
