"""Accelerations with Coulomb friction, which is proportional to reactions that it changes itself."""

from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.model import Dynamics
from jaxnc.types import Array


def has_friction(dyn: Dynamics) -> bool:
    """Whether there is any friction."""
    return bool(dyn.topology.loads.friction)


def friction_forces(dyn: Dynamics, q: Array, v: Array, a: Array, lam: Array, efforts: Array | None = None) -> Array:
    """Generalised forces of friction."""
    raise NotImplementedError


def settled_forces(flow: Flow, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
    """Accelerations and multipliers, with friction if there is any."""
    return flow.accelerate(t, q, v)
