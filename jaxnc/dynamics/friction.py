"""Accelerations with Coulomb friction, which is proportional to reactions that it changes itself."""

from jaxnc.dynamics.flow import Flow
from jaxnc.types import Array


def settled_forces(flow: Flow, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
    """Accelerations and multipliers, with friction if there is any."""
    return flow.accelerate(t, q, v)
