"""Continuation steps of many lanes at once: predict along the tangent, solve, and check that the branch was kept.

Every lane takes the same number of steps. One that fails a check stays where it was and says so; what then becomes of
it is for the host (`jaxnc.solvers.host`), which takes as many steps as it needs.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp

from jaxnc.solvers.branch import SHARP, STEP, smooth, steady
from jaxnc.solvers.kernel import Kernel, Solved, always, apart
from jaxnc.solvers.plan import Plan
from jaxnc.system.equations import Equations, pure_numbers
from jaxnc.system.precision import limits
from jaxnc.types import Array


class State(NamedTuple):
    """Where the lanes are."""

    x: tuple[Array, ...]  # coordinates that are not fixed, unknown ones first, each (lanes,)
    good: Array  # whether the lane is on its branch, and was in all steps before
    size: Array  # largest residual
    pivots: Array  # smallest over largest pivot
    determinants: tuple[Array, ...]  # of every block
    rise: tuple[Array, ...]  # how much they changed in the last step that went anywhere
    way: tuple[Array, ...]  # how the known coordinates changed in it


def on_branch(eq: Equations, found: Solved, signs: Sequence[Any] | Array, passing: Any = False) -> Array:
    """Which lanes are solved, regular, on the branch of the given orientation, and not met by a mirror image.

    Poses that are only passed on the way (`passing`) may be ones at which a planned elimination loses its digits: of
    32-bit numbers these are many.
    """
    ok = found.upright & (found.size <= tolerance(eq, found.x)) & (passing | (found.pivots > limits(eq.length).poor))
    for a, b in zip(found.determinants, signs, strict=True):
        ok = ok & (jnp.sign(a) == b)
    return ok


def tolerance(eq: Equations, x: Sequence[Any]) -> Array:
    """Largest residual of a pose that counts as a solution, lane by lane; as `newton.tolerance`."""
    least, largest = limits(eq.length), jnp.zeros(())
    for v, pure in zip(x, pure_numbers(eq.topology), strict=True):
        largest = jnp.maximum(largest, eq.length * jnp.abs(v) if pure else jnp.abs(v))
    return least.accept * eq.length + least.rounding * largest


def length_of(plan: Plan, eq: Equations) -> Callable[[list[Array]], Array]:
    """Return the function that measures a change of the unknown coordinates."""
    pure = pure_numbers(plan.topology)[plan.unknown]
    return lambda change: jnp.sqrt(sum((d * eq.length if p else d) ** 2 for d, p in zip(change, pure, strict=True)))


def beginning(kernel: Kernel, eq: Equations, x: Sequence[Any], lanes: tuple[int, ...]) -> State:
    """Where lanes begin: at a pose, all coordinates each a number or lanes."""
    none, moving = jnp.zeros(lanes), [int(c) for c in (*kernel.plan.unknown, *kernel.plan.known)]
    determinants = tuple(jnp.broadcast_to(d, lanes) for d in kernel.determinants(eq, x))
    at = tuple(jnp.broadcast_to(x[c], lanes) for c in moving)
    still = (none,) * len(determinants), (none,) * len(kernel.plan.known)
    return State(at, jnp.ones(lanes, bool), none, none, determinants, *still)


def stepper(kernel: Kernel, eq: Equations, x: Sequence[Any], signs: Sequence[Any]) -> Callable[[State, Array], State]:
    """A step of lanes, from where they are to the next values of the known coordinates ``(k, lanes)``."""
    plan = kernel.plan
    pure = pure_numbers(plan.topology)
    moving = [int(c) for c in (*plan.unknown, *plan.known)]
    fixed = {int(c): x[int(c)] for c in plan.fixed}
    # What has a closed form needs no guess: there is one solution of each orientation.
    guessing = kernel.jumps or bool(kernel.guessed)
    go = always(eq)

    def whole(y):
        return [fixed[c] if c in fixed else y[moving.index(c)] for c in range(len(x))]

    def norm(y):
        total = jnp.zeros(y[0].shape)
        for v, c in zip(y, moving, strict=True):
            v = v * eq.length if pure[c] else v
            total = total + v * v
        return jnp.sqrt(total)

    def step(old, target):
        y, good, lanes = old.x, old.good, old.good.shape
        at = whole(y)
        change: list[Any] = [None] * len(x)
        for k, c in enumerate(plan.known):
            change[int(c)] = target[k] - at[int(c)]
        ahead = [change[int(c)] for c in plan.known]
        square = sum(w * w for w in old.way)
        share = sum(w * d for w, d in zip(old.way, ahead, strict=True)) / jnp.where(square > 0.0, square, 1.0)

        def lanewise(x):
            return tuple(jnp.zeros(lanes) if x[c] is None else jnp.broadcast_to(x[c], lanes) for c in moving)

        guess, slope = at, None
        if guessing:
            slope = apart(go, lambda: lanewise(kernel.tangent(eq, at, change)))
            guess = whole([v + jnp.where(jnp.isfinite(d), d, 0.0) for v, d in zip(y, slope, strict=True)])
        for k, c in enumerate(plan.known):
            guess[int(c)] = target[k]
        found = kernel.solve(eq, guess, signs)
        new = apart(go, lambda: lanewise(found.x))
        kept = on_branch(eq, found._replace(x=whole(new)), signs)
        determinants = tuple(jnp.broadcast_to(d, lanes) for d in found.determinants)
        good = good & kept & steady(determinants, old.determinants, old.rise, share)
        for k in plan.angles:
            good = good & (jnp.abs(ahead[k]) <= STEP)
        if slope is not None:
            off = norm([a - guess[c] for a, c in zip(new, moving, strict=True)])
            slack = limits(eq.length).close * eq.length
            good = good & (off <= SHARP * norm(slope) + slack)
            if kernel.jumps:
                after = apart(go, lambda: lanewise(kernel.tangent(eq, whole(new), change)))
                both = list(zip(slope, after, strict=True))
                kink = norm([a - b - 0.5 * (d + e) for a, b, (d, e) in zip(new, y, both, strict=True)])
                good = good & smooth(norm([e - d for d, e in both]), kink, norm(slope) + norm(after), slack)
        y = apart(go, lambda: tuple(jnp.where(good, a, b) for a, b in zip(new, y, strict=True)))
        moves = sum(d * d for d in ahead) > 0.0
        rise = [a - b for a, b in zip(determinants, old.determinants, strict=True)]
        rise = tuple(jnp.where(moves, a, b) for a, b in zip(rise, old.rise, strict=True))
        way = tuple(jnp.where(moves, d, w) for d, w in zip(ahead, old.way, strict=True))
        size, pivots = (jnp.broadcast_to(v, lanes) for v in (found.size, found.pivots))
        return State(y, good, size, pivots, determinants, rise, way)

    return step
