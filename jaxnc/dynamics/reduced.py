"""Motion in independent coordinates, near a state."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp

from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.initial import independent_names
from jaxnc.dynamics.rows import evaluate
from jaxnc.dynamics.saddle import saddle
from jaxnc.errors import InputError, nearest
from jaxnc.records import record, static
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import weights
from jaxnc.system.system import System
from jaxnc.types import Array


@record
class Reduced:
    """The neighbourhood of a pose in independent coordinates z."""

    flow: Flow  # the motion
    q: Array  # the pose
    view: Plan = static()  # the plan whose inputs are z

    @classmethod
    def of(cls, system: System, flow: Flow, q: Array, names: Sequence[str] | None = None) -> "Reduced":
        """The neighbourhood of a pose.

        The pose, in the coordinates of the dynamics, meets the constraints; independent coordinates are chosen there,
        if their names are not given.
        """
        top, freedom = system.topology, system.degrees_of_freedom
        chosen = tuple(names) if names is not None else independent_names(system, flow, q)
        for name in chosen:
            if name not in top.position:
                raise InputError(f"{top.name!r} has no coordinate {name!r}; {nearest(name, top.coordinates)}")
        if len(chosen) != freedom:
            raise InputError(f"{top.name!r} has {freedom} degrees of freedom; {len(chosen)} coordinates were given")
        return cls(flow, q, plan(flow.dyn.topology, chosen, (), freedom))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the independent coordinates."""
        return self.flow.dyn.topology.named(self.view.driven)

    def ways(self, v: Array) -> tuple[Array, Array, Array]:
        """How the state changes with z and with its rates, by derivatives of the rows alone.

        Where all rates are v, rows ``Φ(q) = 0`` go on being met if ``Φ_q δq = 0`` and ``Φ_q δv = -Φ_qq v δq``.

        The rates ``(N,)`` meet the constraints.

        Returns:
            R, how all coordinates change with z (and their rates with those of z), ``(N, g)``; how their rates change
            with z, ``(N, g)``; what the unknown coordinates are found from, rows and columns as lengths.
        """
        view, eq, q, n = self.view, self.flow.dyn.eq, self.q, len(self.view.unknown)
        weight = weights(eq)[view.unknown]
        _, unknown, known, _ = evaluate(view, eq, q, v)
        solve = saddle(jnp.eye(n), unknown / weight, unknown.shape[0] > n)

        def found(right: Array) -> Array:
            some = jax.vmap(lambda g: solve(jnp.zeros(n), -g)[0] / weight, in_axes=1, out_axes=1)(right)
            return jnp.zeros((len(q), right.shape[1])).at[view.unknown].set(some)

        def bent(way: Array) -> Array:
            return 0.5 * jax.jvp(lambda v: evaluate(view, eq, q, v)[3], (v,), (way,))[1]

        basis = found(known).at[view.known].set(jnp.eye(known.shape[1]))
        return basis, found(jax.vmap(bent, in_axes=1, out_axes=1)(basis)), unknown / weight
