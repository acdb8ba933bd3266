"""Errors, conditions and their derivatives of many designs: poses from the host, what is asked of them compiled once.

What is compiled belongs to the structure of a problem, and takes a few designs: as many as fit into the processor's
memory, and not many more than often remain. While it runs, the host goes on with the next few.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import jit, on_device
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.redesign import attached
from jaxnc.synthesis.poses import Reached, changing
from jaxnc.synthesis.problem import Problem, moving
from jaxnc.types import Array

_AT_ONCE = 16  # designs for which it is compiled


def leaves_of(problem: Problem) -> tuple[list[Any], Any]:
    """The numbers of a problem, where they are needed, and its structure."""
    leaves, structure = jax.tree.flatten(problem)
    return on_device(leaves), structure


def evaluated(
    goal: Problem,
    leaves: tuple[list[Any], Any],
    x: np.ndarray,
    given: np.ndarray,
    scale: np.ndarray,
    live: np.ndarray,
    way: str = "quick",
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Evaluate designs.

    `leaves` are those of `leaves_of`; derivatives are multiplied by `scale`, ``(n,)``; for the way see
    `jaxnc.synthesis.poses.reached`.

    Returns:
        Errors ``(B, m)``, conditions ``(B, k)``, derivatives of both ``(B, m + k, n)``, and which designs reach all of
        their targets.
    """
    at, core, parts = np.flatnonzero(live), goal.core, []
    for found in changing(core, x[at, : core.count], goal.poses, way, _AT_ONCE):
        first, count = len(parts) * _AT_ONCE, len(found.q)
        fill = np.minimum(np.arange(_AT_ONCE), count - 1)
        some = at[first + fill]
        found = found if count == _AT_ONCE else jax.tree.map(lambda a, fill=fill: a[fill], found)
        parts.append(_evaluated(leaves[1], leaves[0], x[some], given[some], scale, found))
    whole = []
    for each in zip(*parts, strict=True):
        whole.append(np.zeros((len(x), *each[0].shape[1:]), each[0].dtype))
        whole[-1][at] = np.concatenate(each)[: len(at)]
    errors, conditions, slopes, ok = whole
    return errors, conditions, slopes, ok


@functools.partial(jit, static_argnums=0)
def _evaluated(
    structure: Any, leaves: list[Array], x: Array, given: Array, scale: Array, found: Reached
) -> tuple[Array, Array, Array, Array]:
    goal: Problem = jax.tree.unflatten(structure, leaves)

    def one(x: Array, given: Array, found: Reached) -> tuple[Array, Array, Array, Array]:
        turn = found.turn
        poses = [found.q] if turn is None else [found.q, turn.q]
        ways = [found] if turn is None else [found, turn]

        def numbers(x: Array, *poses: Array) -> tuple[Array, Any]:
            seen = goal.evaluate(x, _moves(goal, x, found, poses), given)
            return jnp.concatenate([seen.errors, seen.conditions]), seen

        def along(way: Array, *changes: Array) -> tuple[Array, Any]:
            _, slope, seen = jax.jvp(numbers, (x, *poses), (way, *changes), has_aux=True)
            return slope, seen

        changes = []
        for q, way in zip(poses, ways, strict=True):
            moved = jnp.zeros((len(x), *q.shape))
            if way.changes is not None and way.by is not None:
                some = jnp.concatenate([way.changes[:-1], way.by.T[:, :, None] * way.changes[-1]])
                moved = moved.at[: len(some)].set(some * scale[: len(some), None, None])
            changes.append(moved)
        rows, seen = jax.vmap(along, out_axes=(0, None))(jnp.diag(scale), *changes)
        return seen.errors, seen.conditions, rows.T, seen.ok

    return jax.vmap(one)(x, given, found)


def _moves(goal: Problem, x: Array, found: Reached, poses: Any) -> tuple[Motion, Motion | None]:
    """Motions of a design from poses; where it is not known how these change, they get their derivatives here."""
    core = goal.core
    z, extra = core.split(x[: core.count])
    system = core.designed(z)

    def motion(way: Reached, q: Array, values: Any) -> Motion:
        zero = jnp.zeros(way.values.shape)
        out = moving(system, core.driven, core.hold, q, way.status, way.values, zero, zero)
        return attached(out, system, values()[:, None]) if way.changes is None else out

    def over(way: Reached) -> Array:
        low, high = core.span(way.values[0], extra)
        moved = jnp.linspace(0.0, 1.0, len(way.values)) * (high - low) + low
        return way.values + moved - jax.lax.stop_gradient(moved)

    through, turn = motion(found, poses[0], lambda: core.inputs(extra)), found.turn
    if not goal.poses:
        return through, None
    return through, through if turn is None else motion(turn, poses[1], lambda: over(turn))
