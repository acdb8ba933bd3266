"""The compiled mechanism: static topology, differentiable parameters, residual and Jacobian."""

from jaxnc.exports import on_demand

__getattr__, __dir__ = on_demand(__name__)
