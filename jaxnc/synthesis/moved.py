"""Designs moved through their targets and over the range of the input, to be judged and drawn."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.kinematics.motion import Motion
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.program import program
from jaxnc.types import Array

POSES = 181  # over the range of the input
_LANES = 8  # designs moved together


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


def moved(problem: Problem, xs: Sequence[np.ndarray]) -> list[Moved]:
    """Move designs; those that fail a check of the march go by the robust walk, each by itself."""
    problem, out = problem.origin, []
    for first in range(0, len(xs), _LANES):
        some = xs[first : first + _LANES]
        lanes = np.stack([*some, *[some[-1]] * (_LANES - len(some))])
        both = jax.tree.map(np.asarray, _marched(problem, jnp.asarray(lanes)))
        for k, x in enumerate(some):
            motion, turn = (m if m is None else _checked(problem, x, _lane(m, k)) for m in both)
            out.append(Moved(np.asarray(x), motion, motion if turn is None else turn))
    return out


def _lane(motion: Motion, k: int) -> Motion:
    return jax.tree.map(lambda a: jnp.asarray(a[k]), motion)


def _checked(problem: Problem, x: np.ndarray, motion: Motion) -> Motion:
    """A motion, found again if the march has lost it."""
    if np.asarray(motion.converged).all():
        return motion
    values = np.asarray(motion.asked)[:, 0]
    count = len(values)
    if count < POSES:  # the last value again and again: one length, which is compiled once
        values = np.append(values, np.full(POSES - count, values[-1]))
    found = _walked(problem, jnp.asarray(x), jnp.asarray(values))
    return jax.tree.map(jnp.asarray, _first(jax.tree.map(np.asarray, found), count))


def _first(motion: Motion, count: int) -> Motion:
    return motion.pose(slice(count))


@program(static=0)
def _marched(problem: Problem, x: Array) -> tuple[Motion, Motion | None]:
    poses = POSES if problem.travel[1] > problem.travel[0] else 0
    return jax.vmap(lambda x: problem.moves(x, poses))(x)


@program(static=0)
def _walked(problem: Problem, x: Array, values: Array) -> Motion:
    system = problem.variables.design(problem.split(x)[0])
    return problem.swept(system, values, "continuation")
