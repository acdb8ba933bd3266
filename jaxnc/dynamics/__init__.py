"""Motion under forces: mass matrices, energies, and what simulations, reactions and the rest return."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.dynamics.energy import EnergyBalance as EnergyBalance
    from jaxnc.dynamics.energy import angular_momentum as angular_momentum
    from jaxnc.dynamics.energy import centre_of_mass as centre_of_mass
    from jaxnc.dynamics.energy import energy_balance as energy_balance
    from jaxnc.dynamics.energy import kinetic_energy as kinetic_energy
    from jaxnc.dynamics.energy import momentum as momentum
    from jaxnc.dynamics.energy import potential_energy as potential_energy
    from jaxnc.dynamics.energy import total_mass as total_mass
    from jaxnc.dynamics.equilibrium import Equilibrium as Equilibrium
    from jaxnc.dynamics.field import VectorField as VectorField
    from jaxnc.dynamics.field import vector_field as vector_field
    from jaxnc.dynamics.inverse import InverseDynamics as InverseDynamics
    from jaxnc.dynamics.linear import Linearisation as Linearisation
    from jaxnc.dynamics.mass import mass_matrix as mass_matrix
    from jaxnc.dynamics.model import State as State
    from jaxnc.dynamics.reactions import Load as Load
    from jaxnc.dynamics.reactions import Reactions as Reactions
    from jaxnc.dynamics.reactions import Wrench as Wrench
    from jaxnc.dynamics.simulation import Simulation as Simulation


__getattr__, __dir__ = on_demand(__name__)
