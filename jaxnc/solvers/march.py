"""Many lanes along their own ways at once: predict along the tangent, solve, and check that the branch was kept.

Every lane takes the same number of steps. One that fails a check stays where it was and says so; what then becomes of
it is for the robust walk (`jaxnc.solvers.continuation`), which takes as many steps as it needs.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax

from jaxnc.solvers.kernel import Kernel, Solved, always, apart
from jaxnc.system.equations import Equations, pure_numbers
from jaxnc.system.precision import limits
from jaxnc.types import Array

_SHARP = 0.2  # a correction may be this part of the predicted step; as in the walk
FEEL = 1e-3  # of a step: a first one, that shows in which direction determinants change
_THROWN = 0.3  # of a determinant: less was expected of it


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
    ok = found.upright & (found.size <= tolerance(eq, found.x)) & (found.pivots > limits(eq.length).poor)
    for a, b in zip(found.determinants, signs, strict=True):
        ok = ok & (jnp.sign(a) == b)
    return ok


def steady(new: Sequence[Any], now: Sequence[Any], rise: Sequence[Any], share: Any) -> Array:
    """Whether determinants go on as they did, lane by lane.

    Where a branch ends and its mirror image begins again soon afterwards, no orientation changes between a pose before
    and a pose behind the gap; but a determinant that fell towards zero has been thrown back.

    Args:
        new: determinants of the blocks after a step.
        now: before it.
        rise: how much they changed in the step before.
        share: length of this step in terms of that one.
    """
    ok = jnp.ones(jnp.shape(share), bool)
    for a, b, d in zip(new, now, rise, strict=True):
        ok = ok & ((b + share * d) * jnp.sign(a) >= _THROWN * jnp.abs(a))
    return ok


def tolerance(eq: Equations, x: Sequence[Any]) -> Array:
    """Largest residual of a pose that counts as a solution, lane by lane; as `newton.tolerance`."""
    largest = jnp.abs(x[0])
    for v in x[1:]:
        largest = jnp.maximum(largest, jnp.abs(v))
    least = limits(eq.length)
    return least.accept * eq.length + least.rounding * largest


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
        y, good, now, rise, way = state
        at = whole(y)
        change: list[Any] = [None] * len(x)
        for k, c in enumerate(plan.known):
            change[int(c)] = target[k] - at[int(c)]
        ahead = [change[int(c)] for c in plan.known]
        square = sum(w * w for w in way)
        share = sum(w * d for w, d in zip(way, ahead, strict=True)) / jnp.where(square > 0.0, square, 1.0)
        slope = apart(go, lambda: lanewise(kernel.tangent(eq, at, change)))
        guess = whole([v + jnp.where(jnp.isfinite(d), d, 0.0) for v, d in zip(y, slope, strict=True)])
        for k, c in enumerate(plan.known):
            guess[int(c)] = target[k]
        found = kernel.solve(eq, guess, signs)
        new = apart(go, lambda: lanewise(found.x))
        kept = right(eq, found._replace(x=whole(new)), signs)
        determinants = [jnp.broadcast_to(d, lanes) for d in found.determinants]
        kept = kept & steady(determinants, now, rise, share)
        off = norm([a - guess[c] for a, c in zip(new, moving, strict=True)])
        good = good & kept & (off <= _SHARP * norm(slope) + limits(eq.length).close * eq.length)
        y = apart(go, lambda: tuple(jnp.where(good, a, b) for a, b in zip(new, y, strict=True)))
        moves = sum(d * d for d in ahead) > 0.0
        rise = [jnp.where(moves, a - b, r) for a, b, r in zip(determinants, now, rise, strict=True)]
        way = [jnp.where(moves, d, w) for d, w in zip(ahead, way, strict=True)]
        return (y, good, determinants, rise, way), (y, found.size * one, found.pivots * one, good)

    go, one = always(eq), jnp.ones(lanes)
    now = [jnp.broadcast_to(d, lanes) for d in kernel.determinants(eq, x)]
    none = jnp.zeros(lanes)
    begin = (lanewise(x), jnp.ones(lanes, bool), now, [none] * len(now), [none] * len(plan.known))
    _, (y, *rest) = lax.scan(step, begin, known)
    return March(y, *rest)
