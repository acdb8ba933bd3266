"""Errors, conditions and their derivatives of many designs: poses from the host, what is asked of them compiled once.

What is compiled belongs to the structure of a problem, and to how many designs a search refines at once: 8, 24 or 48.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import jit
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.redesign import attached
from jaxnc.synthesis.poses import Reached, reached
from jaxnc.synthesis.problem import Problem, moving
from jaxnc.types import Array

_WIDTHS = (8, 24, 48)  # designs for which it is compiled


def evaluated(
    goal: Problem, x: np.ndarray, scale: np.ndarray, live: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Look at designs.

    Args:
        goal: the problem, around others or by itself.
        x: unknowns, ``(B, n)``.
        scale: by which derivatives are multiplied, ``(n,)``.
        live: which of the designs matter, ``(B,)``.

    Returns:
        Errors ``(B, m)``, conditions ``(B, k)``, derivatives of both ``(B, m + k, n)``, zero by what is pinned, and
        which designs reach all their targets.
    """
    at, core = np.flatnonzero(live), goal.core
    found = reached(core, x[at, : core.count], goal.poses, changes=True)
    width = next((w for w in _WIDTHS if w >= len(x)), len(x))
    fill = np.minimum(np.arange(width), len(at) - 1)
    some = jax.tree.map(lambda a: a[fill], found)
    out = [np.asarray(a)[: len(at)] for a in _evaluated(goal, x[at[fill]], scale, some)]
    whole = [np.zeros((len(x), *a.shape[1:]), a.dtype) for a in out]
    for a, b in zip(whole, out, strict=True):
        a[at] = b
    errors, conditions, slopes, ok = whole
    return errors, conditions, slopes, ok


@jit
def _evaluated(goal: Problem, x: Array, scale: Array, found: Reached) -> tuple[Array, Array, Array, Array]:
    def one(x: Array, found: Reached) -> tuple[Array, Array, Array, Array]:
        free = np.flatnonzero(~goal.pinned)
        ways, own = (jnp.eye(len(x)) * scale)[free], free[free < goal.core.count]
        turn = found.turn
        poses = [found.q] if turn is None else [found.q, turn.q]
        known = [found.changes] if turn is None else [found.changes, turn.changes]

        def numbers(x: Array, *poses: Array) -> tuple[Array, Any]:
            look = goal.look(x, _moves(goal, x, found, poses))
            return jnp.concatenate([look.errors, look.conditions]), look

        def along(way: Array, *changes: Array) -> tuple[Array, Any]:
            _, slope, look = jax.jvp(numbers, (x, *poses), (way, *changes), has_aux=True)
            return slope, look

        changes = []
        for q, change in zip(poses, known, strict=True):
            moved = jnp.zeros((len(free), *q.shape))
            changes.append(moved if change is None else moved.at[: len(own)].set(change[own] * scale[own, None, None]))
        rows, look = jax.vmap(along, out_axes=(0, None))(ways, *changes)
        slopes = jnp.zeros((rows.shape[1], len(x))).at[:, free].set(rows.T)
        return look.errors, look.conditions, slopes, look.ok

    return jax.vmap(one)(x, found)


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
