"""Designs moved through their targets and over the range of the input, to be judged and drawn."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxnc.kinematics.motion import Motion
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.host import HostView
from jaxnc.solvers.plan import plan
from jaxnc.synthesis.poses import Reached, reached
from jaxnc.synthesis.problem import POSES, Problem, moving
from jaxnc.system.host import from_jax
from jaxnc.system.system import System


class Moved(NamedTuple):
    """A design and what it does."""

    x: np.ndarray  # the unknowns
    motion: Motion  # through the targets
    turn: Motion  # over the range of the input; the same where it has none


def moved(problem: Problem, xs: Sequence[np.ndarray]) -> list[Moved]:
    """Move designs, all at once; see `walked` for one that fails one of its checks."""
    if not len(xs):
        return []
    x, poses, core = np.stack(xs), POSES if problem.travel[1] > problem.travel[0] else 0, problem.core
    found, out = reached(core, x[:, : core.count], poses, way="close"), []
    for k, one in enumerate(x):
        system = problem.design(one)

        def motion(way: Reached, k: int = k, system: System = system) -> Motion:
            unknown = np.full(way.values[k].shape, np.nan)
            return moving(system, core.driven, core.hold, way.q[k], way.status[k], way.values[k], unknown, unknown)

        through = motion(found)
        out.append(Moved(one, through, through if found.turn is None else motion(found.turn)))
    return out


def walked(problem: Problem, one: Moved) -> Moved:
    """The same design with motions that were lost on the way followed again, and what their poses are worth."""
    motion = _found(problem, one.motion)
    return Moved(one.x, motion, motion if one.turn is one.motion else _found(problem, one.turn))


def _found(problem: Problem, motion: Motion) -> Motion:
    system = motion.system
    view = plan(system.topology, motion.driven, motion.held, system.degrees_of_freedom)
    if view.large or not np.asarray(motion.converged).all():
        return problem.swept(system, np.asarray(motion.asked)[:, 0])
    inner, q = HostView(view, from_jax(derive(system))), np.asarray(motion.poses).T
    with np.errstate(all="ignore"):
        residual = np.max(np.abs(inner.residual(q)), axis=0, initial=0.0)
        return dataclasses.replace(motion, residual=residual, conditioning=inner.conditioning(q))
