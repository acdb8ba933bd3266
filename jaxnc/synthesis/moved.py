"""Designs moved through their targets and over the range of the input, to be judged and drawn."""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import jit
from jaxnc.kinematics.motion import Motion
from jaxnc.synthesis.problem import POSES, Problem
from jaxnc.types import Array

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
    """Move designs together, by the march; see `walked` for those that fail one of its checks."""
    problem, out = problem.origin, []
    if not problem.together:
        for x in xs:
            motion, turn = problem.found(np.asarray(x), _poses(problem))
            out.append(Moved(np.asarray(x), motion, motion if turn is None else turn))
        return out
    for first in range(0, len(xs), _LANES):
        some = xs[first : first + _LANES]
        lanes = np.stack([*some, *[some[-1]] * (_LANES - len(some))])
        both = jax.tree.map(np.asarray, _marched(problem, jnp.asarray(lanes)))
        for k, x in enumerate(some):
            motion, turn = (m and _lane(m, k) for m in both)
            out.append(Moved(np.asarray(x), motion, motion if turn is None else turn))
    return out


def walked(problem: Problem, one: Moved) -> Moved:
    """The same design with motions that the march has lost found again by the robust walk."""
    motion = _found(problem, one.x, one.motion)
    return Moved(one.x, motion, motion if one.turn is one.motion else _found(problem, one.x, one.turn))


def _lane(motion: Motion, k: int) -> Motion:
    return jax.tree.map(lambda a: jnp.asarray(a[k]), motion)


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
def _marched(problem: Problem, x: Array) -> tuple[Motion, Motion | None]:
    return jax.vmap(lambda x: problem.moves(x, _poses(problem)))(x)


def _poses(problem: Problem) -> int:
    return POSES if problem.travel[1] > problem.travel[0] else 0


@functools.partial(jit, static_argnums=0)
def _walked(problem: Problem, x: Array, values: Array) -> Motion:
    system = problem.variables.design(problem.split(x)[0])
    return problem.swept(system, values, "continuation")
