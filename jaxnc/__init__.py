"""jaxnc: mechanisms that can be designed by gradient, in natural coordinates on JAX.

``import jaxnc as nc``, describe a mechanism with `Mechanism`, compile it, and analyse it with `solve_position`,
`sweep`, `motion`, `mobility`, `travel`, `diagnose`, `simulate`, `inverse_dynamics`, `equilibrium`.
Everything is loaded on first use. What functions return, and what is asked for less often, is in the packages.
Numbers such as (128) in docstrings are equations of the source text, and "erratum 2" a place where it is wrong:
docs/sources.md.
"""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc import (
        constraints,
        dynamics,
        families,
        forces,
        io,
        kinematics,
        library,
        reporting,
        synthesis,
        system,
        viz,
    )
    from jaxnc.compiling import jit
    from jaxnc.dynamics.equilibrium import equilibrium
    from jaxnc.dynamics.inverse import inverse_dynamics
    from jaxnc.dynamics.linear import linearise
    from jaxnc.dynamics.reactions import reactions
    from jaxnc.dynamics.simulate import simulate
    from jaxnc.errors import AssemblyError, InputError, JaxncError, MechanismError, ModelFileError, OutputError
    from jaxnc.families import formulate
    from jaxnc.io.cache import cache
    from jaxnc.io.files import load
    from jaxnc.io.robots.doors import from_mjcf, from_urdf
    from jaxnc.io.stream import stream
    from jaxnc.kinematics.arc import circuit, travel
    from jaxnc.kinematics.diagnosis import diagnose
    from jaxnc.kinematics.instant import instant_centre
    from jaxnc.kinematics.mobility import mobility
    from jaxnc.kinematics.motion import Motion
    from jaxnc.kinematics.planar import grashof, transmission_angle
    from jaxnc.kinematics.position import motion, solve_position, sweep
    from jaxnc.kinematics.sensitivity import sensitivity
    from jaxnc.kinematics.spread import shard
    from jaxnc.kinematics.suspension import suspension
    from jaxnc.mechanism import Mechanism
    from jaxnc.reporting.study import report
    from jaxnc.status import Status
    from jaxnc.synthesis.tolerance import tolerance
    from jaxnc.system.system import System
    from jaxnc.viz.notebook import widget

__version__ = "0.1.0"
__all__ = [
    "AssemblyError",
    "InputError",
    "JaxncError",
    "Mechanism",
    "MechanismError",
    "ModelFileError",
    "Motion",
    "OutputError",
    "Status",
    "System",
    "cache",
    "circuit",
    "constraints",
    "diagnose",
    "dynamics",
    "equilibrium",
    "families",
    "forces",
    "formulate",
    "from_mjcf",
    "from_urdf",
    "grashof",
    "instant_centre",
    "inverse_dynamics",
    "io",
    "jit",
    "kinematics",
    "library",
    "linearise",
    "load",
    "mobility",
    "motion",
    "reactions",
    "report",
    "reporting",
    "sensitivity",
    "shard",
    "simulate",
    "solve_position",
    "stream",
    "suspension",
    "sweep",
    "synthesis",
    "system",
    "tolerance",
    "transmission_angle",
    "travel",
    "viz",
    "widget",
]

__getattr__, __dir__ = on_demand(__name__)
