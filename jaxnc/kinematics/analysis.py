"""The compiled part of an analysis: poses, rates, and what became of each."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.core import Tracer
from jax.custom_batching import sequential_vmap

from jaxnc.compiling import jit
from jaxnc.kinematics.columns import Columns
from jaxnc.kinematics.large import analyse_large
from jaxnc.kinematics.outcome import known_values, lost_in_order, outcome
from jaxnc.kinematics.rates import rates_in_lanes, with_held
from jaxnc.solvers import batch
from jaxnc.solvers.assembly import closest
from jaxnc.solvers.chunks import in_chunks
from jaxnc.solvers.designs import followed
from jaxnc.solvers.follow import Followed
from jaxnc.solvers.found import taken_apart
from jaxnc.solvers.kernel import brief
from jaxnc.solvers.look import Look, inspect
from jaxnc.solvers.newton import attach, attach_lanes, largest, newton, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.scattered import scattered
from jaxnc.solvers.walk import walk
from jaxnc.status import Status
from jaxnc.system.equations import Equations, guards, residual
from jaxnc.types import Array

_CHUNK = 64  # lanes solved at a time


@functools.partial(jit, static_argnums=(0, 1))
def analyse(
    view: Plan, method: str, eq: Equations, q0: Array, values: Array, orders: tuple[Array, ...]
) -> tuple[Array, tuple[Array, ...], Array, Array, Array]:
    """Solve for poses and their rates; compiled once per plan, method and number of poses.

    Args:
        view: what is solved for (static).
        method: ``"continuation"``, ``"march"``, ``"lanes"`` or ``"guess"`` (static).
        eq: the equations.
        q0: start pose, all coordinates; for ``"guess"`` one for each pose, ``(T, N)``.
        values: driven coordinates, ``(T, driven)``.
        orders: their time derivatives, each ``(T, driven)``.

    Returns:
        Poses ``(T, N)``, their time derivatives, and of each its status, largest residual and conditioning.
    """
    if view.large:
        return analyse_large(view, method, eq, q0, values, orders, nearest_turn)
    if method != "guess":
        columns, rates, status, sizes, pivots = in_columns(view, method, eq, q0, values, orders)
        return columns.whole(), rates, status, sizes, pivots
    known = known_values(view, q0, values)
    frozen, targets, begin = lax.stop_gradient((eq, known, q0))

    def near(start, u):
        q = view.join(start[view.unknown], u, frozen.home[view.fixed])
        q = newton(view, frozen, closest(view, frozen, q).q, 8)[0]
        return q, inspect(view, frozen, q)

    poses, looks = in_chunks(jax.vmap(near), _CHUNK, begin, targets)
    fits = looks.size <= jax.vmap(lambda x: tolerance(frozen, x))(poses)
    good, limit = looks.upright & fits, jnp.zeros(looks.upright.shape, bool)
    lost = jnp.full(good.shape, int(Status.DID_NOT_ASSEMBLE))
    status = outcome(view, method, frozen, begin, good, limit, looks, lost, lambda: fits)
    return finished(view, eq, q0, values, orders, poses, status, looks.size, looks.pivots)


@functools.partial(jit, static_argnums=(0, 1))
def in_columns(
    view: Plan, method: str, eq: Equations, q0: Array, values: Array, orders: tuple[Array, ...]
) -> tuple[Columns, tuple[Array, ...], Array, Array, Array]:
    """`analyse` where poses are followed from the start pose; its poses coordinate by coordinate.

    What is not looked at, as most coordinates in traced code are, is then not put together either.
    """
    driven = values.shape[1]
    known = known_values(view, q0, values)
    frozen, targets, begin = lax.stop_gradient((eq, known, q0))
    begin = begin.at[view.fixed].set(frozen.home[view.fixed])
    if method == "lanes":
        turns = 2 * jnp.pi * turns_to(view, begin, targets)
        found = scattered(view, frozen, begin, targets - turns, targets)
        lost = jnp.where(found.exhausted, int(Status.TOO_FAR), int(Status.DID_NOT_ASSEMBLE))
    else:
        turned = nearest_turn(view, begin, targets[0])
        if method == "march" and not brief(view):
            found = taken_apart(view, _plodded(view)(frozen, turned, targets))
        else:
            found = followed(view, frozen, turned[None], targets[None], begin[None], method == "continuation")
            found = jax.tree.map(lambda x: x[0], found)
        assembled = largest(view.residual(frozen, begin)) <= 1e3 * tolerance(frozen, begin)
        lost = lost_in_order(found, assembled)
    places = tuple(int(c) for c in (*view.unknown, *view.known))
    inputs = jnp.stack(found.known, axis=1) if places[len(view.unknown) :] else values

    def whole():
        return Columns(begin, found.x, inputs, places).whole()

    def fits():
        return found.size <= jax.vmap(lambda x: tolerance(frozen, x))(whole())

    status = outcome(view, method, frozen, begin, found.reached, found.limit, found, lost, fits)
    good = status == int(Status.CONVERGED)
    if view.square and brief(view):
        x = attach_lanes(view, found.x, eq, tuple(known[:, k] for k in range(known.shape[1])), good)
    else:
        q = whole()
        q = jnp.where(good[:, None], jax.vmap(lambda x, u: attach(view, x, eq, u))(q, known), q)
        x = tuple(q[:, int(c)] for c in view.unknown)
    # A pose that was not asked for has no derivative: it is handed on as a constant.
    poses = columns_of(view, eq, q0, x, jnp.where(good[:, None], values, inputs[:, :driven]))
    rates = rates_in_lanes(view, eq, poses.whole(), with_held(view, orders), good) if orders else ()
    return poses, rates, status, found.size, found.pivots


def columns_of(view: Plan, eq: Equations, q0: Array, x: tuple[Array, ...], driven: Array) -> Columns:
    """Poses from their unknown and driven coordinates; the held ones are those of the start pose."""
    held = view.known[driven.shape[-1] :]
    rest = lax.stop_gradient(q0).at[view.fixed].set(eq.home[view.fixed]).at[held].set(q0[held])
    return Columns(rest, x, driven, tuple(int(c) for c in (*view.unknown, *view.known[: driven.shape[-1]])))


def columnar(view: Plan, given: Any) -> bool:
    """Whether an analysis is better done by `in_columns`: in traced code, where the compiler sees what is wanted."""
    return not view.large and any(isinstance(x, Tracer) for x in jax.tree.leaves(given))


@functools.lru_cache(maxsize=256)
def _plodded(view: Plan):
    """A march where blocks are too large to be written out: a walk from value to value, one design after the other.

    Mapped over designs it stays as it is: what is compiled is small, and of such blocks lanes do not go any faster.
    """

    @sequential_vmap
    def one(eq: Equations, q: Array, values: Array) -> Followed:
        total = values.shape[0]
        index = jnp.arange(total)
        # The last value may be there again and again, so that sequences of any length share what is compiled.
        differs = jnp.any(values[1:] != values[:-1], axis=1)
        last = jnp.max(jnp.where(differs, index[1:], 0), initial=0)
        seen = walk(view, eq, q, values, jnp.ones((), int), last + 1)
        within = jnp.minimum(index, last)
        good = within < seen.reached

        def look(before, way):
            k, x, good = way

            def new():
                return _polished(view, eq, jnp.where(good, x, seen.last))

            now = lax.cond(k <= last, new, lambda: before)
            return now, now

        blank = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(lambda: _polished(view, eq, q)[1]))
        _, (poses, looks) = lax.scan(look, (q, blank), (index, seen.poses, good))
        at_limit = seen.touched[within] & good
        kept = at_limit | (seen.between[within] & good)
        poses = jnp.where(kept[:, None], seen.poses[within], poses)
        fits = (looks.size <= jax.vmap(lambda x: tolerance(eq, x))(poses)) & looks.upright
        good = jnp.cumsum(~(good & (fits | at_limit))) == 0
        return Followed(poses, good, at_limit, looks, seen.part, seen.exhausted)

    return one


def _polished(view: Plan, eq: Equations, q: Array) -> tuple[Array, Look]:
    """A solved pose after one more step of Newton, and what it looks like, from one Jacobian for both."""
    r, jacobian, _ = view.linearise(eq, q)
    step = view.steps(eq, jacobian, r[:, None])[:, 0]
    new = view.move(q, -jnp.where(jnp.isfinite(step), step, 0.0))
    before, after = (largest(residual(eq, x)) for x in (q, new))
    q = jnp.where(after < before, new, q)
    rows, bodies = guards(eq, q)
    upright = jnp.all(rows > 0.0) & jnp.all(bodies > 0.0)
    sizes = jnp.minimum(before, after), view.conditioning(eq, jacobian)
    return q, Look(*sizes, jnp.zeros(0), upright, jnp.any(bodies <= 0.0))


def finished(
    view: Plan,
    eq: Equations,
    q0: Array,
    values: Array,
    orders: tuple[Array, ...],
    poses: Array,
    status: Array,
    sizes: Array,
    pivots: Array,
) -> tuple[Array, tuple[Array, ...], Array, Array, Array]:
    """Poses with their derivatives, and their rates: what `analyse` returns, from what it has found."""
    known = known_values(view, q0, values)
    # A pose that was not asked for has no derivative: it is handed on as a constant.
    q = jax.vmap(lambda x, u: attach(view, x, eq, u))(poses, known)
    q = jnp.where((status == 0)[:, None], q, poses)
    rates = rates_in_lanes(view, eq, q, with_held(view, orders), status == 0) if orders else ()
    return q, rates, status, sizes, pivots


def nearest_turn(view: Plan, q: Array, target: Array) -> Array:
    """Count driven angles that nothing else depends on from the turn nearest to their first value."""
    return q.at[view.known].add(2 * jnp.pi * turns_to(view, q, target))


def turns_to(view: Plan, q: Array, targets: Array) -> Array:
    """Whole turns from a pose to values of the first known coordinates ``(..., k)``; zero where turns are counted."""
    known = view.known[: targets.shape[-1]]
    turning = batch.periodic(view)[: targets.shape[-1]]
    if not turning.any():
        return jnp.zeros_like(targets)
    return jnp.where(turning, jnp.round((targets - q[known]) / (2 * jnp.pi)), 0.0)
