"""Analyses of large systems: one pose after the other, with sparse matrices; and what is not offered for them."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax

from jaxnc.errors import InputError
from jaxnc.kinematics.rates import rates as rates_of
from jaxnc.solvers.assembly import closest
from jaxnc.solvers.continuation import inspect
from jaxnc.solvers.in_order import attach_in_order, follow_in_order
from jaxnc.solvers.newton import largest, newton, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.status import Status
from jaxnc.system.equations import Equations, guards
from jaxnc.system.precision import limits
from jaxnc.system.topology import LARGE, Topology
from jaxnc.types import Array


def analyse_large(
    view: Plan,
    method: str,
    eq: Equations,
    q0: Array,
    values: Array,
    orders: tuple[Array, ...],
    nearest_turn: Callable[[Plan, Array, Array], Array],
) -> tuple[Array, tuple[Array, ...], Array, Array, Array]:
    """Solve for poses and their rates; the counterpart of `jaxnc.kinematics.analysis.analyse`.

    Args:
        view: what is solved for (static).
        method: ``"continuation"``, ``"march"``, ``"lanes"`` or ``"guess"`` (static).
        eq: the equations.
        q0: start pose, all coordinates.
        values: driven coordinates, ``(T, driven)``.
        orders: their time derivatives, each ``(T, driven)``.
        nearest_turn: counts driven angles of a pose from the turn nearest to their first values.

    Returns:
        Poses ``(T, N)``, their time derivatives, and of each its status, largest residual and conditioning.
    """
    held = jnp.broadcast_to(q0[view.known[len(view.driven) :]], (values.shape[0], len(view.held)))
    known = jnp.concatenate([values, held], axis=1)
    frozen, targets, begin = lax.stop_gradient((eq, known, q0))
    begin = begin.at[view.fixed].set(frozen.home[view.fixed])
    assembled = largest(view.residual(frozen, begin)) <= 1e3 * tolerance(frozen, begin)
    if method in ("continuation", "march"):
        found = follow_in_order(view, frozen, nearest_turn(view, begin, targets[0]), targets, begin)
        poses, good, limit, looks = found.poses, found.reached, found.limit, found.looks
        stopped_before = jnp.concatenate([jnp.zeros(1, bool), limit[:-1]])  # its limit was met exactly by the last pose
        first_gap = (jnp.cumsum(~good) == 1) & ~stopped_before
        stopped = jnp.where(found.exhausted, int(Status.TOO_FAR), int(Status.SINGULAR))
        lost = jnp.where(first_gap, stopped, int(Status.NOT_REACHED))
        lost = jnp.where(assembled, lost, int(Status.DID_NOT_ASSEMBLE))
    elif method == "lanes":

        def lane(u):
            one = follow_in_order(view, frozen, nearest_turn(view, begin, u), u[None], begin)
            return jax.tree.map(lambda x: x[0], (one.poses, one.reached, one.limit, one.looks)), one.exhausted

        (poses, good, limit, looks), exhausted = lax.map(lane, targets)
        lost = jnp.where(exhausted, int(Status.TOO_FAR), int(Status.DID_NOT_ASSEMBLE))
    else:

        def near(u):
            q = view.join(begin[view.unknown], u, begin[view.fixed])
            q = newton(view, frozen, closest(view, frozen, q).q, 8)[0]
            return q, inspect(view, frozen, q)

        poses, looks = lax.map(near, targets)
        good, limit = looks.upright, jnp.zeros(looks.upright.shape, bool)
        lost = jnp.full(good.shape, int(Status.DID_NOT_ASSEMBLE))

    tight = looks.size <= jax.vmap(lambda x: tolerance(frozen, x))(poses)
    status = jnp.where(good & tight, int(Status.CONVERGED), jnp.where(good, int(Status.DID_NOT_ASSEMBLE), lost))
    singular = looks.pivots <= limits(q0).singular
    status = jnp.where(limit | ((status == 0) & singular), int(Status.SINGULAR), status)
    mirrored = (status != 0) & tight & looks.mirrored
    if method != "guess":
        mirrored = mirrored | jnp.any(guards(frozen, begin)[1] <= 0.0)
    status = jnp.where(mirrored, int(Status.MIRRORED), status)
    status = jnp.where(frozen.misfit > limits(q0).misfit, int(Status.LEFT_CLASS), status)
    q = attach_in_order(view, poses, eq, known)
    q = jnp.where((status == 0)[:, None], q, poses)
    if not orders:
        return q, (), status, looks.size, looks.pivots
    still = jnp.zeros((values.shape[0], len(view.held)))
    orders = tuple(jnp.concatenate([o, still], axis=1) for o in orders)
    rates = lax.map(lambda lane: tuple(rates_of(view, eq, *lane)), (q, orders, status == 0))
    return q, rates, status, looks.size, looks.pivots


def dense_only(topology: Topology, what: str) -> None:
    """Refuse an analysis that forms dense matrices, for a system whose matrices are kept sparse.

    Raises:
        InputError: naming what is offered instead.
    """
    if topology.large:
        raise InputError(
            f"{what} forms dense matrices, and those of {topology.name!r} with its {len(topology.unknown)} unknowns "
            f"are kept sparse; solve_position, sweep, motion, their rates and gradients, and mobility work. "
            f"compile(sparse=False) makes them dense whatever the size, sensible up to a few times {LARGE} unknowns"
        )
