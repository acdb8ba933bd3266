"""The compiled part of an analysis: poses, rates, and what became of each."""

import functools

import jax
import jax.numpy as jnp
from jax import lax

from jaxnc.compiling import jit
from jaxnc.kinematics.columns import Columns
from jaxnc.kinematics.large import analyse_large
from jaxnc.kinematics.outcome import known_values, outcome
from jaxnc.kinematics.rates import rates_in_lanes, with_held
from jaxnc.kinematics.solved import solved
from jaxnc.solvers import batch
from jaxnc.solvers.assembly import closest
from jaxnc.solvers.chunks import in_chunks
from jaxnc.solvers.evaluation import evaluate
from jaxnc.solvers.kernel import writes_out_derivatives
from jaxnc.solvers.newton import attach, attach_lanes, newton, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.status import Status
from jaxnc.system.equations import Equations
from jaxnc.types import Array

_CHUNK = 64  # lanes solved at a time


@functools.partial(jit, static_argnums=(0, 1, 6))
def analyse(
    view: Plan, method: str, eq: Equations, q0: Array, values: Array, orders: tuple[Array, ...], repair: bool = True
) -> tuple[Array, tuple[Array, ...], Array, Array, Array]:
    """Solve for poses and their rates; compiled once per plan, method and number of poses.

    Args:
        view: what is solved for (static).
        method: ``"continuation"``, ``"lanes"`` or ``"guess"`` (static).
        eq: the equations.
        q0: start pose, all coordinates; for ``"guess"`` one for each pose, ``(T, N)``.
        values: driven coordinates, ``(T, driven)``.
        orders: their time derivatives, each ``(T, driven)``.
        repair: ask the host for what is not found (static).

    Returns:
        Poses ``(T, N)``, their time derivatives, and of each its status, largest residual and conditioning.
    """
    if view.large:
        return analyse_large(view, method, eq, q0, values, orders, nearest_turn)
    if method != "guess":
        columns, rates, status, sizes, pivots = in_columns(view, method, eq, q0, values, orders, repair)
        return columns.whole(), rates, status, sizes, pivots
    known = known_values(view, q0, values)
    frozen, targets, begin = lax.stop_gradient((eq, known, q0))

    def near(start, u):
        q = view.join(start[view.unknown], u, frozen.home[view.fixed])
        q = newton(view, frozen, closest(view, frozen, q).q, 8)[0]
        return q, evaluate(view, frozen, q)

    poses, evaluated = in_chunks(jax.vmap(near), _CHUNK, begin, targets)
    fits = evaluated.size <= jax.vmap(lambda x: tolerance(frozen, x))(poses)
    good, limit = evaluated.upright & fits, jnp.zeros(evaluated.upright.shape, bool)
    lost = jnp.full(good.shape, int(Status.DID_NOT_ASSEMBLE))
    status = outcome(view, method, frozen, begin, good, limit, evaluated, lost, lambda: fits)
    # A pose that was not asked for has no derivative: it is handed on as a constant.
    q = jnp.where((status == 0)[:, None], jax.vmap(lambda x, u: attach(view, x, eq, u))(poses, known), poses)
    rates = rates_in_lanes(view, eq, q, with_held(view, orders), status == 0) if orders else ()
    return q, rates, status, evaluated.size, evaluated.pivots


@functools.partial(jit, static_argnums=(0, 1, 6))
def in_columns(
    view: Plan, method: str, eq: Equations, q0: Array, values: Array, orders: tuple[Array, ...], repair: bool = True
) -> tuple[Columns, tuple[Array, ...], Array, Array, Array]:
    """`analyse` where poses are followed from the start pose; its poses coordinate by coordinate.

    What is not looked at, as most coordinates in traced code are, is then not put together either.
    """
    driven = values.shape[1]
    known = known_values(view, q0, values)
    frozen, targets, begin = lax.stop_gradient((eq, known, q0))
    begin = begin.at[view.fixed].set(frozen.home[view.fixed])
    found = solved(view, method, repair, frozen, begin, targets)
    inputs = jnp.stack(found.known, axis=1) if len(view.known) else values
    good = found.status == int(Status.CONVERGED)
    if view.square and writes_out_derivatives(view):
        x = attach_lanes(view, found.x, eq, tuple(known[:, k] for k in range(known.shape[1])), good)
    else:
        places = tuple(int(c) for c in (*view.unknown, *view.known))
        q = Columns(begin, found.x, inputs, places).whole()
        q = jnp.where(good[:, None], jax.vmap(lambda x, u: attach(view, x, eq, u))(q, known), q)
        x = tuple(q[:, int(c)] for c in view.unknown)
    # A pose that was not asked for has no derivative: it is handed on as a constant.
    poses = columns_of(view, eq, q0, x, jnp.where(good[:, None], values, inputs[:, :driven]))
    rates = rates_in_lanes(view, eq, poses.whole(), with_held(view, orders), good) if orders else ()
    return poses, rates, found.status, found.size, found.pivots


def columns_of(view: Plan, eq: Equations, q0: Array, x: tuple[Array, ...], driven: Array) -> Columns:
    """Poses from their unknown and driven coordinates; the held ones are those of the start pose."""
    held = view.known[driven.shape[-1] :]
    rest = lax.stop_gradient(q0).at[view.fixed].set(eq.home[view.fixed]).at[held].set(q0[held])
    return Columns(rest, x, driven, tuple(int(c) for c in (*view.unknown, *view.known[: driven.shape[-1]])))


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
