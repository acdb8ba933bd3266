"""Designs moved through their targets and over the range of the input, to be judged and drawn."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import jit
from jaxnc.kinematics.motion import Motion
from jaxnc.synthesis.problem import POSES, Problem
from jaxnc.types import Array


class Moved(NamedTuple):
    """A design and what it does.

    Attributes:
        x: the unknowns.
        motion: through the targets.
        turn: over the range of the input; the same where it has none.
    """

    x: np.ndarray
    motion: Motion
    turn: Motion


def moved(problem: Problem, x: np.ndarray) -> Moved:
    """Move a design, by the march; see `walked` for one that fails one of its checks."""
    poses = POSES if problem.travel[1] > problem.travel[0] else 0
    motion, turn = jax.tree.map(jnp.asarray, problem.origin.found(np.asarray(x), poses))
    return Moved(np.asarray(x), motion, motion if turn is None else turn)


def walked(problem: Problem, one: Moved) -> Moved:
    """The same design with motions that the march has lost found again by the robust walk."""
    motion = _found(problem, one.x, one.motion)
    return Moved(one.x, motion, motion if one.turn is one.motion else _found(problem, one.x, one.turn))


def _found(problem: Problem, x: np.ndarray, motion: Motion) -> Motion:
    if np.asarray(motion.converged).all():
        return motion
    values = np.asarray(motion.asked)[:, 0]
    count = len(values)
    if count < POSES:  # the last value again and again: one length, which is compiled once
        values = np.append(values, np.full(POSES - count, values[-1]))
    found = jax.tree.map(np.asarray, _walked(problem.origin, jnp.asarray(x), jnp.asarray(values)))
    return jax.tree.map(jnp.asarray, found.pose(slice(count)))


@functools.partial(jit, static_argnums=0)
def _walked(problem: Problem, x: Array, values: Array) -> Motion:
    system = problem.variables.design(problem.split(x)[0])
    return problem.swept(system, values, "continuation")
