"""The compiled part of an analysis: poses, rates, and what became of each."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.compiling import jit
from jaxnc.kinematics.columns import Columns
from jaxnc.kinematics.rates import rates as rates_of
from jaxnc.kinematics.rates import rates_in_lanes, with_held
from jaxnc.kinematics.solved import apiece, nearest_large, solved
from jaxnc.solvers.newton import attach_lanes, attach_pose, closest_pose, largest, newton, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.solvers.traced import in_chunks
from jaxnc.status import Status
from jaxnc.system.equations import Equations, guards, residual
from jaxnc.system.precision import limits
from jaxnc.types import Array

_CHUNK = 64  # lanes solved at a time


@functools.partial(jit, static_argnums=(0, 1, 6))
def analyse(
    view: Plan, method: str, eq: Equations, q0: Array, values: Array, orders: tuple[Array, ...], repair: bool = True
) -> PoseBatch:
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
        return _large(view, method, eq, q0, values, orders)
    if method != "guess":
        found = in_columns(view, method, eq, q0, values, orders, repair)
        return found._replace(q=found.q.whole()) if isinstance(found.q, Columns) else found
    known = known_values(view, q0, values)
    frozen, targets, begin = lax.stop_gradient((eq, known, q0))

    def near(start, u):
        q = view.join(start[view.unknown], u, frozen.home[view.fixed])
        q = newton(view, frozen, closest_pose(view, frozen, q).q, 8)[0]
        rows, bodies = guards(frozen, q)
        size, pivots = largest(residual(frozen, q)), view.conditioning(frozen, view.linearise(frozen, q)[1])
        fits, mirrored = size <= tolerance(frozen, q), jnp.any(bodies <= 0.0)
        status = jnp.where(pivots > limits(q).singular, int(Status.CONVERGED), int(Status.SINGULAR))
        status = jnp.where(fits & jnp.all(rows > 0.0) & ~mirrored, status, int(Status.DID_NOT_ASSEMBLE))
        if any(block.kind.mirror for block in view.topology.blocks):
            status = jnp.where((status != 0) & fits & mirrored, int(Status.MIRRORED), status)
        left = frozen.misfit > limits(q).misfit
        return q, jnp.where(left, int(Status.LEFT_CLASS), status), size, pivots

    poses, status, size, pivots = in_chunks(jax.vmap(near), _CHUNK, begin, targets)
    # A pose that was not asked for has no derivative: it is handed on as a constant.
    q = jnp.where((status == 0)[:, None], jax.vmap(lambda x, u: attach_pose(view, x, eq, u))(poses, known), poses)
    rates = rates_in_lanes(view, eq, q, with_held(view, orders), status == 0) if orders else ()
    return PoseBatch(q, size, pivots, status=status, rates=rates)


@functools.partial(jit, static_argnums=(0, 1, 6))
def in_columns(
    view: Plan, method: str, eq: Equations, q0: Array, values: Array, orders: tuple[Array, ...], repair: bool = True
) -> PoseBatch:
    """`analyse` where poses are followed from the start pose; its poses coordinate by coordinate, if they are `apiece`.

    What is not looked at, as most coordinates in traced code are, is then not put together either.
    """
    driven = values.shape[1]
    known = known_values(view, q0, values)
    frozen, targets, begin = lax.stop_gradient((eq, known, q0))
    begin = jnp.where(np.isin(np.arange(len(frozen.home)), view.fixed), frozen.home, begin)
    found = solved(view, method, repair, frozen, begin, targets)
    inputs = jnp.stack(found.known, axis=1) if len(view.known) else values
    good = found.status == int(Status.CONVERGED)
    if apiece(view):
        x = attach_lanes(view, found.q, eq, tuple(known[:, k] for k in range(known.shape[1])), good)
        # A pose that was not asked for has no derivative: it is handed on as a constant.
        poses = columns_of(view, eq, q0, x, jnp.where(good[:, None], values, inputs[:, :driven]))
    else:
        q = jnp.broadcast_to(begin, (len(values), len(begin)))
        for columns, numbers in ((view.unknown, found.q), (view.known, inputs)):
            q = q.at[:, columns].set(numbers) if len(columns) else q
        new = jax.vmap(lambda x, u, ok: attach_pose(view, x, eq, u, ok))(q, known, good)
        poses = jnp.where(good[:, None], new, q)
    rates = ()
    if orders:
        whole = poses.whole() if isinstance(poses, Columns) else poses
        rates = rates_in_lanes(view, eq, whole, with_held(view, orders), good)
    return PoseBatch(poses, found.size, found.conditioning, status=found.status, rates=rates)


def _large(view: Plan, method: str, eq: Equations, q0: Array, values: Array, orders: tuple[Array, ...]) -> PoseBatch:
    """`analyse` of a large system: the host finds poses, one after the other they are given their derivatives."""
    known = known_values(view, q0, values)
    frozen, targets, begin = lax.stop_gradient((eq, known, q0))
    begin = begin.at[..., view.fixed].set(frozen.home[view.fixed])
    if method == "guess":
        found = nearest_large(view, frozen, begin, targets[:, : len(view.driven)])
    else:
        found = solved(view, method, True, frozen, begin, targets)
    good = found.status == int(Status.CONVERGED)
    attached = lax.map(lambda lane: attach_pose(view, lane[0], eq, lane[1]), (found.q, known))
    q, rates = jnp.where(good[:, None], attached, found.q), ()
    if orders:
        rates = lax.map(lambda lane: tuple(rates_of(view, eq, *lane)), (q, with_held(view, orders), good))
    return found._replace(q=q, rates=rates)


def known_values(view: Plan, q0: Array, values: Array) -> Array:
    """Driven and held coordinates of every pose, ``(T, k)``."""
    held = q0[..., view.known[len(view.driven) :]]
    return jnp.concatenate([values, jnp.broadcast_to(held, (values.shape[0], len(view.held)))], axis=1)


def columns_of(view: Plan, eq: Equations, q0: Array, x: tuple[Array, ...], driven: Array) -> Columns:
    """Poses from their unknown and driven coordinates; the held ones are those of the start pose."""
    held = view.known[driven.shape[-1] :]
    rest = lax.stop_gradient(q0).at[view.fixed].set(eq.home[view.fixed]).at[held].set(q0[held])
    return Columns(rest, x, driven, places(view))


def places(view: Plan) -> tuple[int, ...]:
    """Which coordinates are columns: the unknown ones and the driven ones."""
    return tuple(int(c) for c in (*view.unknown, *view.known[: len(view.driven)]))
