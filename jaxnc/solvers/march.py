"""Many lanes along their own ways at once: predict along the tangent, solve, and check that the branch was kept.

Every lane takes the same number of steps. One that fails a check stays where it was and says so; what then becomes of
it is for the robust walk (`jaxnc.solvers.continuation`), which takes as many steps as it needs.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax

from jaxnc.solvers.kernel import Kernel, Solved, always, apart
from jaxnc.solvers.newton import ACCEPT, ROUNDING
from jaxnc.system.equations import Equations, pure_numbers
from jaxnc.types import Array

_SHARP = 0.2  # a correction may be this part of the predicted step; as in the walk
_POOR = 1e-9  # of the largest pivot: where a pivot is smaller, the planned elimination is not trusted


class March(NamedTuple):
    """Where the lanes are after every step.

    Attributes:
        x: coordinates that are not fixed, unknown ones first, each ``(steps, lanes)``.
        size: largest residual, ``(steps, lanes)``.
        pivots: smallest over largest pivot, ``(steps, lanes)``.
        good: whether the lane is on its branch, and was in all steps before, ``(steps, lanes)``.
    """

    x: tuple[Array, ...]
    size: Array
    pivots: Array
    good: Array


def right(eq: Equations, found: Solved, signs: Sequence[Any]) -> Array:
    """Which lanes are solved, on the branch of the given orientation, and not met by a mirror image."""
    ok = found.upright & (found.size <= tolerance(eq, found.x)) & (found.pivots > _POOR)
    for a, b in zip(found.signs, signs, strict=True):
        ok = ok & (a == b)
    return ok


def tolerance(eq: Equations, x: Sequence[Any]) -> Array:
    """Largest residual of a pose that counts as a solution, lane by lane; as `newton.tolerance`."""
    largest = jnp.abs(x[0])
    for v in x[1:]:
        largest = jnp.maximum(largest, jnp.abs(v))
    return ACCEPT * eq.length + ROUNDING * largest


def march(kernel: Kernel, eq: Equations, x: Sequence[Any], signs: Sequence[Any], known: Array) -> March:
    """March lanes along their known coordinates.

    Args:
        kernel: the blocks of a plan.
        eq: the equations, of one design or one for each lane (lanes last).
        x: all coordinates where the lanes begin, each a number or lanes.
        signs: orientation of the blocks that is to be kept, each a number or lanes.
        known: values of the known coordinates after every step, ``(steps, k, lanes)``.

    Returns:
        The poses.
    """
    plan = kernel.plan
    lanes = known.shape[2:]
    pure = pure_numbers(plan.topology)
    moving = [int(c) for c in (*plan.unknown, *plan.known)]
    fixed = {int(c): x[int(c)] for c in plan.fixed}

    def whole(y):
        return [fixed[c] if c in fixed else y[moving.index(c)] for c in range(len(x))]

    def norm(y):
        total = jnp.zeros(lanes)
        for v, c in zip(y, moving, strict=True):
            v = v * eq.length if pure[c] else v
            total = total + v * v
        return jnp.sqrt(total)

    def lanewise(x):
        return tuple(jnp.zeros(lanes) if x[c] is None else jnp.broadcast_to(x[c], lanes) for c in moving)

    def step(state, target):
        y, good = state
        at = whole(y)
        change: list[Any] = [None] * len(x)
        for k, c in enumerate(plan.known):
            change[int(c)] = target[k] - at[int(c)]
        slope = apart(go, lambda: lanewise(kernel.tangent(eq, at, change)))
        guess = whole([v + jnp.where(jnp.isfinite(d), d, 0.0) for v, d in zip(y, slope, strict=True)])
        for k, c in enumerate(plan.known):
            guess[int(c)] = target[k]
        found = kernel.solve(eq, guess, signs)
        new = apart(go, lambda: lanewise(found.x))
        kept = right(eq, found._replace(x=whole(new)), signs)
        off = norm([a - guess[c] for a, c in zip(new, moving, strict=True)])
        good = good & kept & (off <= _SHARP * norm(slope) + 1e-9 * eq.length)
        y = apart(go, lambda: tuple(jnp.where(good, a, b) for a, b in zip(new, y, strict=True)))
        return (y, good), (y, found.size * one, found.pivots * one, good)

    go, one = always(eq), jnp.ones(lanes)
    _, (y, *rest) = lax.scan(step, (lanewise(x), jnp.ones(lanes, bool)), known)
    return March(y, *rest)
