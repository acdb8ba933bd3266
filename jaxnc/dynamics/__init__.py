"""Motion under forces: mass matrices, energies, and what simulations, reactions and the rest return."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.dynamics.balance import EnergyBalance, energy_balance
    from jaxnc.dynamics.energy import (
        angular_momentum,
        centre_of_mass,
        kinetic_energy,
        momentum,
        potential_energy,
        total_mass,
    )
    from jaxnc.dynamics.equilibrium import Equilibrium
    from jaxnc.dynamics.exerted import Load
    from jaxnc.dynamics.inertia import mass_matrix
    from jaxnc.dynamics.inverse import InverseDynamics
    from jaxnc.dynamics.linear import Linearisation
    from jaxnc.dynamics.reactions import Reactions, Wrench
    from jaxnc.dynamics.simulation import Simulation
    from jaxnc.dynamics.state import State

__all__ = [
    "EnergyBalance",
    "Equilibrium",
    "InverseDynamics",
    "Linearisation",
    "Load",
    "Reactions",
    "Simulation",
    "State",
    "Wrench",
    "angular_momentum",
    "centre_of_mass",
    "energy_balance",
    "kinetic_energy",
    "mass_matrix",
    "momentum",
    "potential_energy",
    "total_mass",
]

__getattr__, __dir__ = on_demand(__name__)
