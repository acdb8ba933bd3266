"""Motion under forces: mass matrices, energies, and what simulations, reactions and the rest return."""

from jaxnc.exports import on_demand

__getattr__, __dir__ = on_demand(__name__)
