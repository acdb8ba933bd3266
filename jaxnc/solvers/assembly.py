"""The start pose: the drawing, moved as little as it takes to meet the constraints."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.solvers import linear
from jaxnc.solvers.newton import largest
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import Equations, equations
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Coordinates

_RANK = 1e-9  # of the largest singular value


def closest(plan: Plan, eq: Equations, q: Coordinates, iterations: int = 200) -> tuple[Coordinates, Array]:
    """Levenberg-Marquardt on the unknowns of a plan: a pose that meets the constraints, or comes closest to it.

    Args:
        plan: what is solved for; freedoms may be left, and then the pose moves as little as possible.
        eq: the equations.
        q: start pose, known coordinates at their values.
        iterations: the most trial steps.

    Returns:
        The pose and its largest residual.
    """
    floor = 1e-15 * eq.length

    def cost(r):
        return jnp.sum(r * r)

    def more(state):
        i, _, r, _, damping, moved, _ = state
        return (i < iterations) & (largest(r) > floor) & (damping < 1e8) & (moved > 1e-15)

    def improve(state):
        # One evaluation per iteration: of the trial, kept if it is better.
        i, q, r, jacobian, damping, _, trial = state
        new, new_jacobian, _ = plan.linearise(eq, trial)
        better = cost(new) < cost(r)
        moved = jnp.sqrt(jnp.sum((trial - q) ** 2)) / eq.length
        q, r = jnp.where(better, trial, q), jnp.where(better, new, r)
        jacobian = jnp.where(better, new_jacobian, jacobian)
        damping = jnp.where(better, jnp.maximum(0.1 * damping, 1e-13), jnp.where(i == 0, damping, 10.0 * damping))
        dx = linear.damped_step(jacobian, r, damping)
        dx = jnp.where(jnp.all(jnp.isfinite(dx)), dx, 0.0)
        return i + 1, q, r, jacobian, damping, jnp.where(better & (i > 0), moved, 1.0), plan.move(q, -dx)

    m, n = len(plan.rows), len(plan.unknown)
    start = (0, q, jnp.full(m, jnp.inf), jnp.zeros((m, n)), jnp.asarray(1e-2), jnp.ones(()), q)
    _, q, r, *_ = lax.while_loop(more, improve, start)
    return q, largest(r)


def free_plan(topology: Topology) -> Plan:
    """The plan with nothing driven: every coordinate that is not fixed may move."""
    return plan(topology, (), ())


@jax.jit
def derive(system: System) -> Equations:
    """The equations of a system, compiled once for its topology."""
    return equations(system)


@jax.jit
def settle(eq: Equations, nudge: Array) -> tuple[Coordinates, Array]:
    """Assemble from the drawing moved by `nudge`, ``(N,)``: the start pose and its largest residual.

    Compiled once for a topology, differentiated nowhere.
    """
    eq, nudge = lax.stop_gradient((eq, nudge))
    view = free_plan(eq.topology)
    if not len(view.rows):
        return eq.home + nudge, jnp.zeros(())
    return closest(view, eq, eq.home + nudge)


@jax.jit
def _free_jacobian(eq: Equations, q: Coordinates) -> Array:
    return free_plan(eq.topology).linearise(eq, q)[1]


def with_degrees_of_freedom(system: System) -> System:
    """Count a system's degrees of freedom at its assembled drawing, and at a pose nearby in case that one is special.

    Args:
        system: a system straight from the builder.

    Returns:
        The same system, carrying the count.
    """
    view = free_plan(system.topology)
    n, rank = len(view.unknown), 0
    if len(view.rows) and n:
        eq = derive(system)
        nudge = np.zeros(len(system.topology.coordinates))
        for attempt in range(2):
            q, _ = settle(eq, nudge)
            _, values, right = np.linalg.svd(np.asarray(_free_jacobian(eq, q)))
            here = int(np.sum(values > _RANK * max(values[0], 1e-300)))
            rank = max(rank, here)
            null = right[here:]
            if attempt or not len(null):
                break
            step = 0.03 * float(eq.length) * np.random.default_rng(7).uniform(0.5, 1.0, len(null)) @ null
            nudge[view.unknown] = step
    return System(system.topology, system.parameters, n - rank)
