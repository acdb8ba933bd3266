"""Analyses of large systems: one pose after the other, with sparse matrices; and what is not offered for them."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax

from jaxnc.errors import InputError
from jaxnc.kinematics.outcome import known_values, lost_in_order, outcome
from jaxnc.kinematics.rates import rates as rates_of
from jaxnc.kinematics.rates import with_held
from jaxnc.solvers.assembly import closest
from jaxnc.solvers.evaluation import evaluate
from jaxnc.solvers.in_order import attach_in_order, follow_in_order
from jaxnc.solvers.newton import largest, newton, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.status import Status
from jaxnc.system.equations import Equations
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
    """Solve for poses and their rates: the counterpart of `jaxnc.kinematics.analysis.analyse`, with its arguments.

    `nearest_turn` counts driven angles of a pose from the turn nearest to their first values.
    """
    known = known_values(view, q0, values)
    frozen, targets, begin = lax.stop_gradient((eq, known, q0))
    begin = begin.at[..., view.fixed].set(frozen.home[view.fixed])
    if method == "continuation":
        found = follow_in_order(view, frozen, nearest_turn(view, begin, targets[0]), targets, begin)
        poses, good, limit, evaluated = found.poses, found.reached, found.limit, found.evaluated
        assembled = largest(view.residual(frozen, begin)) <= 1e3 * tolerance(frozen, begin)
        lost = lost_in_order(found, assembled)
    elif method == "lanes":

        def lane(u):
            one = follow_in_order(view, frozen, nearest_turn(view, begin, u), u[None], begin)
            return jax.tree.map(lambda x: x[0], (one.poses, one.reached, one.limit, one.evaluated)), one.exhausted

        (poses, good, limit, evaluated), exhausted = lax.map(lane, targets)
        lost = jnp.where(exhausted, int(Status.TOO_FAR), int(Status.DID_NOT_ASSEMBLE))
    else:

        def near(lane):
            start, u = lane
            q = view.join(start[view.unknown], u, start[view.fixed])
            q = newton(view, frozen, closest(view, frozen, q).q, 8)[0]
            return q, evaluate(view, frozen, q)

        poses, evaluated = lax.map(near, (begin, targets))
        good, limit = evaluated.upright, jnp.zeros(evaluated.upright.shape, bool)
        lost = jnp.full(good.shape, int(Status.DID_NOT_ASSEMBLE))

    tight = evaluated.size <= jax.vmap(lambda x: tolerance(frozen, x))(poses)
    lost = jnp.where(good, int(Status.DID_NOT_ASSEMBLE), lost)
    status = outcome(view, method, frozen, begin, good & tight, limit, evaluated, lost, lambda: tight)
    q = attach_in_order(view, poses, eq, known)
    q = jnp.where((status == 0)[:, None], q, poses)
    if not orders:
        return q, (), status, evaluated.size, evaluated.pivots
    orders = with_held(view, orders)
    rates = lax.map(lambda lane: tuple(rates_of(view, eq, *lane)), (q, orders, status == 0))
    return q, rates, status, evaluated.size, evaluated.pivots


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
