"""Newton's method as it is written in a book, on many starts at once: undamped, without a fall-back, all lanes alike.

What the library solves with is safer. This is for comparing formulations.
"""

import functools

import jax
import jax.numpy as jnp
from jax import lax

from jaxnc.compiling import jit
from jaxnc.solvers.newton import largest, tolerance
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import Equations
from jaxnc.system.system import System
from jaxnc.types import Array


@functools.partial(jit, static_argnums=(0, 3))
def attempt(view: Plan, eq: Equations, starts: Array, iterations: int) -> tuple[Array, Array, Array, Array]:
    """Undamped Newton (Gauss-Newton, with redundant rows) from many starts.

    Args:
        view: what is solved for.
        eq: the equations.
        starts: poses with the known coordinates at their values, ``(B, N)``.
        iterations: how many steps.

    Returns:
        The last poses ``(B, N)``, their largest residuals ``(B,)``, estimates of their reciprocal condition numbers
        ``(B,)``, and how many steps each needed to meet the tolerance, ``(B,)``; `iterations` + 1 if it did not.
    """

    def one(q: Array) -> tuple[Array, Array, Array, Array]:
        def step(state, k):
            q, needed = state
            r, jacobian, _ = view.linearise(eq, q)
            good = largest(r) <= tolerance(eq, q)
            needed = jnp.where(good & (needed > k), k, needed)
            dx = view.steps(eq, jacobian, r[:, None])[:, 0]
            dx = jnp.where(jnp.all(jnp.isfinite(dx)), dx, 0.0)
            return (view.move(q, -dx), needed), None

        start = (q, jnp.full((), iterations + 1))
        (q, needed), _ = lax.scan(step, start, jnp.arange(iterations))
        r, jacobian, _ = view.linearise(eq, q)
        needed = jnp.where((largest(r) <= tolerance(eq, q)) & (needed > iterations), iterations, needed)
        return q, largest(r), view.conditioning(eq, jacobian), needed

    return jax.vmap(one)(starts)


def inputs_view(system: System, names: tuple[str, ...]) -> Plan:
    """The plan of a system for some inputs."""
    return plan(system.topology, names, (), system.degrees_of_freedom)
