"""jaxnc: mechanisms that can be designed by gradient, in natural coordinates on JAX.

``import jaxnc as nc``, describe a mechanism with `Mechanism`, compile it, and analyse it with `solve_position`,
`sweep`, `motion`, `mobility`, `travel`, `diagnose`, `simulate`, `inverse_dynamics`, `equilibrium`.
Everything is loaded on first use. Numbers such as (128) in docstrings are equations of the source text, and "erratum 2"
a place where it is wrong: docs/sources.md.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jaxnc import constraints, dynamics, families, forces, io, kinematics, library, solvers, synthesis, system, viz
    from jaxnc.compiling import jit
    from jaxnc.constraints import Kind, RateKind
    from jaxnc.dynamics.energy import (
        angular_momentum,
        centre_of_mass,
        kinetic_energy,
        momentum,
        potential_energy,
        total_mass,
    )
    from jaxnc.dynamics.equilibrium import Equilibrium, equilibrium
    from jaxnc.dynamics.inverse import InverseDynamics, inverse_dynamics
    from jaxnc.dynamics.linear import Linearisation, linearise
    from jaxnc.dynamics.reactions import Reactions, reactions
    from jaxnc.dynamics.simulate import simulate
    from jaxnc.dynamics.simulation import Simulation
    from jaxnc.errors import AssemblyError, InputError, JaxncError, MechanismError, ModelFileError, OutputError
    from jaxnc.families import Formulation, formulate
    from jaxnc.forces import ForceKind
    from jaxnc.io.cache import cache
    from jaxnc.io.files import load
    from jaxnc.io.stream import Streamed, stream
    from jaxnc.io.svg import Outline, outline
    from jaxnc.io.tables import load_npz
    from jaxnc.kinematics.arc import Travel, travel
    from jaxnc.kinematics.diagnosis import Diagnosis, diagnose
    from jaxnc.kinematics.mobility import Mobility, mobility
    from jaxnc.kinematics.motion import Motion
    from jaxnc.kinematics.planar import Grashof, grashof, grashof_type, instant_centre, transmission_angle
    from jaxnc.kinematics.position import motion, solve_position, sweep
    from jaxnc.kinematics.sensitivity import Sensitivity, sensitivity
    from jaxnc.kinematics.spread import shard
    from jaxnc.kinematics.suspension import Suspension, suspension
    from jaxnc.mechanism import Mechanism
    from jaxnc.status import Status
    from jaxnc.synthesis.allocation import Allocation, allocate_tolerances
    from jaxnc.synthesis.calibration import Calibration, calibrate
    from jaxnc.synthesis.robust import robust
    from jaxnc.synthesis.tolerance import Tolerance, tolerance
    from jaxnc.system.equations import equations, jacobian, residual
    from jaxnc.system.system import Parameters, System

_HOME = {
    "jaxnc.compiling": ("jit",),
    "jaxnc.constraints": ("Kind", "RateKind"),
    "jaxnc.dynamics.energy": (
        "angular_momentum",
        "centre_of_mass",
        "kinetic_energy",
        "momentum",
        "potential_energy",
        "total_mass",
    ),
    "jaxnc.dynamics.equilibrium": ("Equilibrium", "equilibrium"),
    "jaxnc.dynamics.inverse": ("InverseDynamics", "inverse_dynamics"),
    "jaxnc.dynamics.linear": ("Linearisation", "linearise"),
    "jaxnc.dynamics.reactions": ("Reactions", "reactions"),
    "jaxnc.dynamics.simulate": ("simulate",),
    "jaxnc.dynamics.simulation": ("Simulation",),
    "jaxnc.errors": ("AssemblyError", "InputError", "JaxncError", "MechanismError", "ModelFileError", "OutputError"),
    "jaxnc.families": ("Formulation", "formulate"),
    "jaxnc.forces": ("ForceKind",),
    "jaxnc.io.cache": ("cache",),
    "jaxnc.io.files": ("load",),
    "jaxnc.io.stream": ("Streamed", "stream"),
    "jaxnc.io.svg": ("Outline", "outline"),
    "jaxnc.io.tables": ("load_npz",),
    "jaxnc.kinematics.arc": ("Travel", "travel"),
    "jaxnc.kinematics.diagnosis": ("Diagnosis", "diagnose"),
    "jaxnc.kinematics.mobility": ("Mobility", "mobility"),
    "jaxnc.kinematics.motion": ("Motion",),
    "jaxnc.kinematics.planar": ("Grashof", "grashof", "grashof_type", "instant_centre", "transmission_angle"),
    "jaxnc.kinematics.position": ("motion", "solve_position", "sweep"),
    "jaxnc.kinematics.sensitivity": ("Sensitivity", "sensitivity"),
    "jaxnc.kinematics.spread": ("shard",),
    "jaxnc.kinematics.suspension": ("Suspension", "suspension"),
    "jaxnc.mechanism": ("Mechanism",),
    "jaxnc.status": ("Status",),
    "jaxnc.synthesis.allocation": ("Allocation", "allocate_tolerances"),
    "jaxnc.synthesis.calibration": ("Calibration", "calibrate"),
    "jaxnc.synthesis.robust": ("robust",),
    "jaxnc.synthesis.tolerance": ("Tolerance", "tolerance"),
    "jaxnc.system.equations": ("equations", "jacobian", "residual"),
    "jaxnc.system.system": ("Parameters", "System"),
}
_WHERE = {name: module for module, names in _HOME.items() for name in names}
_PACKAGES = (
    "constraints",
    "dynamics",
    "families",
    "forces",
    "io",
    "kinematics",
    "library",
    "solvers",
    "synthesis",
    "system",
    "viz",
)

__version__ = "0.1.0"
__all__ = [
    "Allocation",
    "AssemblyError",
    "Calibration",
    "Diagnosis",
    "Equilibrium",
    "ForceKind",
    "Formulation",
    "Grashof",
    "InputError",
    "InverseDynamics",
    "JaxncError",
    "Kind",
    "Linearisation",
    "Mechanism",
    "MechanismError",
    "Mobility",
    "ModelFileError",
    "Motion",
    "Outline",
    "OutputError",
    "Parameters",
    "RateKind",
    "Reactions",
    "Sensitivity",
    "Simulation",
    "Status",
    "Streamed",
    "Suspension",
    "System",
    "Tolerance",
    "Travel",
    "allocate_tolerances",
    "angular_momentum",
    "cache",
    "calibrate",
    "centre_of_mass",
    "constraints",
    "diagnose",
    "dynamics",
    "equations",
    "equilibrium",
    "families",
    "forces",
    "formulate",
    "grashof",
    "grashof_type",
    "instant_centre",
    "inverse_dynamics",
    "io",
    "jacobian",
    "jit",
    "kinematics",
    "kinetic_energy",
    "library",
    "linearise",
    "load",
    "load_npz",
    "mobility",
    "momentum",
    "motion",
    "outline",
    "potential_energy",
    "reactions",
    "residual",
    "robust",
    "sensitivity",
    "shard",
    "simulate",
    "solve_position",
    "solvers",
    "stream",
    "suspension",
    "sweep",
    "synthesis",
    "system",
    "tolerance",
    "total_mass",
    "transmission_angle",
    "travel",
    "viz",
]


def __getattr__(name: str):
    if name in _WHERE:
        found = globals()[name] = getattr(importlib.import_module(_WHERE[name]), name)
        return found
    if name in _PACKAGES:
        return importlib.import_module(f"jaxnc.{name}")
    raise AttributeError(f"module 'jaxnc' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
