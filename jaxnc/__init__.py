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
    from jaxnc import constraints as constraints
    from jaxnc import dynamics as dynamics
    from jaxnc import families as families
    from jaxnc import forces as forces
    from jaxnc import io as io
    from jaxnc import kinematics as kinematics
    from jaxnc import library as library
    from jaxnc import reporting as reporting
    from jaxnc import robots as robots
    from jaxnc import synthesis as synthesis
    from jaxnc import system as system
    from jaxnc import vehicle as vehicle
    from jaxnc import viz as viz
    from jaxnc import workshop as workshop
    from jaxnc.compiling import jit as jit
    from jaxnc.dynamics.equilibrium import equilibrium as equilibrium
    from jaxnc.dynamics.inverse import inverse_dynamics as inverse_dynamics
    from jaxnc.dynamics.inverse import reactions as reactions
    from jaxnc.dynamics.linear import linearise as linearise
    from jaxnc.dynamics.simulate import simulate as simulate
    from jaxnc.errors import AssemblyError as AssemblyError
    from jaxnc.errors import CallError as CallError
    from jaxnc.errors import InputError as InputError
    from jaxnc.errors import JaxncError as JaxncError
    from jaxnc.errors import MechanismError as MechanismError
    from jaxnc.errors import ModelFileError as ModelFileError
    from jaxnc.errors import OutputError as OutputError
    from jaxnc.families import formulate as formulate
    from jaxnc.io.cache import cache as cache
    from jaxnc.io.files import load as load
    from jaxnc.io.stream import stream as stream
    from jaxnc.kinematics.arc import circuit as circuit
    from jaxnc.kinematics.arc import travel as travel
    from jaxnc.kinematics.circuits import circuits as circuits
    from jaxnc.kinematics.diagnosis import diagnose as diagnose
    from jaxnc.kinematics.instant import instant_centre as instant_centre
    from jaxnc.kinematics.instant import transmission_angle as transmission_angle
    from jaxnc.kinematics.mobility import grashof as grashof
    from jaxnc.kinematics.mobility import mobility as mobility
    from jaxnc.kinematics.modes import modes as modes
    from jaxnc.kinematics.motion import Motion as Motion
    from jaxnc.kinematics.position import motion as motion
    from jaxnc.kinematics.position import solve_position as solve_position
    from jaxnc.kinematics.position import sweep as sweep
    from jaxnc.kinematics.sensitivity import sensitivity as sensitivity
    from jaxnc.kinematics.spread import shard as shard
    from jaxnc.mechanism import Mechanism as Mechanism
    from jaxnc.reporting.study import report as report
    from jaxnc.robots.api import from_mjcf as from_mjcf
    from jaxnc.robots.api import from_urdf as from_urdf
    from jaxnc.status import Status as Status
    from jaxnc.synthesis.tolerance.spread import tolerance as tolerance
    from jaxnc.system.system import System as System
    from jaxnc.vehicle.suspension import suspension as suspension
    from jaxnc.viz.pages.widget import widget as widget

__version__ = "0.1.0"

__getattr__, __dir__ = on_demand(__name__)
