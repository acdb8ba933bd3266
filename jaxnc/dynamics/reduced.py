"""Motion in independent coordinates: poses and rates from them, and their accelerations, differentiable."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp

from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.initial import independent_names
from jaxnc.errors import InputError, nearest
from jaxnc.records import record, static
from jaxnc.solvers.newton import attach
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.system import System
from jaxnc.types import Array


@record
class Reduced:
    """The neighbourhood of a pose in independent coordinates z.

    Attributes:
        flow: the motion.
        q: the pose.
        view: the plan whose inputs are z.
    """

    flow: Flow
    q: Array
    view: Plan = static()

    @classmethod
    def of(cls, system: System, flow: Flow, q: Array, names: Sequence[str] | None = None) -> "Reduced":
        """The neighbourhood of a pose.

        Args:
            system: the system.
            flow: its motion.
            q: the pose, in the coordinates of the dynamics; it meets the constraints.
            names: the independent coordinates; chosen where the pose is if not given.

        Raises:
            InputError: unknown names, or not as many as there are freedoms.
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

    @property
    def z(self) -> Array:
        """Their values at the pose."""
        return self.q[self.view.known]

    def pose(self, z: Array) -> Array:
        """The pose at z; right, with all its derivatives, at the z of the pose."""
        return attach(self.view, jax.lax.stop_gradient(self.q), self.flow.dyn.eq, z)

    def rates(self, z: Array, dz: Array) -> Array:
        """Rates of all coordinates."""
        return jax.jvp(self.pose, (z,), (dz,))[1]

    def basis(self) -> Array:
        """R: how all coordinates change with z, ``(N, g)``."""
        return jax.jacfwd(self.pose)(self.z)

    def accelerations(self, z: Array, dz: Array, extra: Array | None = None, t: Array | float = 0.0) -> Array:
        """Second rates of z under the forces, with further generalised forces `extra` ``(N,)``."""
        a, _ = self.flow.accelerate(jnp.asarray(t, float), self.pose(z), self.rates(z, dz), extra)
        return a[self.view.known]
