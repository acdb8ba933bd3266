"""The compiled part of an analysis: poses, rates, and what became of each."""

import functools

import jax
import jax.numpy as jnp
from jax import lax

from jaxnc.compiling import jit
from jaxnc.kinematics.large import analyse_large
from jaxnc.kinematics.outcome import known_values, lost_in_order, outcome
from jaxnc.kinematics.rates import rates_in_lanes, with_held
from jaxnc.solvers import batch
from jaxnc.solvers.assembly import closest
from jaxnc.solvers.chunks import in_chunks
from jaxnc.solvers.designs import followed, scattered
from jaxnc.solvers.look import inspect
from jaxnc.solvers.newton import attach, largest, newton, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.status import Status
from jaxnc.system.equations import Equations
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
        q0: start pose, all coordinates.
        values: driven coordinates, ``(T, driven)``.
        orders: their time derivatives, each ``(T, driven)``.

    Returns:
        Poses ``(T, N)``, their time derivatives, and of each its status, largest residual and conditioning.
    """
    if view.large:
        return analyse_large(view, method, eq, q0, values, orders, nearest_turn)
    known = known_values(view, q0, values)
    frozen, targets, begin = lax.stop_gradient((eq, known, q0))
    begin = begin.at[view.fixed].set(frozen.home[view.fixed])
    assembled = largest(view.residual(frozen, begin)) <= 1e3 * tolerance(frozen, begin)

    def fits(sizes: Array, poses: Array) -> Array:
        return sizes <= jax.vmap(lambda x: tolerance(frozen, x))(poses)

    if method in ("continuation", "march"):
        turned = nearest_turn(view, begin, targets[0])
        found = followed(view, frozen, turned[None], targets[None], begin[None], method == "continuation")
        found = jax.tree.map(lambda x: x[0], found)
        poses, good, limit, looks = found.poses, found.reached, found.limit, found.looks
        lost = lost_in_order(found, assembled)
    elif method == "lanes":
        turns = 2 * jnp.pi * turns_to(view, begin, targets)
        if values.shape[0] >= batch.LEAST and batch.suits(view):
            found = scattered(view, frozen, begin, targets - turns, targets)
        else:
            starts = jnp.broadcast_to(begin, (targets.shape[0], begin.shape[0])).at[:, view.known].add(turns)
            found = followed(view, frozen, starts, targets[:, None], jnp.broadcast_to(begin, starts.shape))
        poses, good, limit = found.poses[:, 0], found.reached[:, 0], found.limit[:, 0]
        looks = jax.tree.map(lambda x: x[:, 0], found.looks)
        lost = jnp.where(found.exhausted, int(Status.TOO_FAR), int(Status.DID_NOT_ASSEMBLE))
    else:

        def near(u):
            q = view.join(begin[view.unknown], u, begin[view.fixed])
            q = newton(view, frozen, closest(view, frozen, q).q, 8)[0]
            return q, inspect(view, frozen, q)

        poses, looks = in_chunks(jax.vmap(near), _CHUNK, targets)
        good, limit = looks.upright & fits(looks.size, poses), jnp.zeros(looks.upright.shape, bool)
        lost = jnp.full(good.shape, int(Status.DID_NOT_ASSEMBLE))

    sizes, pivots = looks.size, looks.pivots
    status = outcome(view, method, frozen, begin, good, limit, looks, lost, lambda: fits(sizes, poses))
    return finished(view, eq, q0, values, orders, poses, status, sizes, pivots)


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
