"""Mass, energies and momenta as functions of a state, single or in batches."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from jaxnc.dynamics.extended import extended, lift, lift_rates
from jaxnc.dynamics.model import Dynamics, dynamics, kinetic, potential
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.system.frames import spread
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Float


def total_mass(system: System) -> Array:
    """Mass of everything that has one, kg."""
    return dynamics(extended(system)).total


def centre_of_mass(motion: Motion) -> Float[Array, "... dim"]:
    """Centre of mass of the whole mechanism in every pose of a motion."""
    return _over(motion, 0, lambda dyn, q, v: dyn.moments @ q / dyn.total)


def kinetic_energy(motion: Motion) -> Float[Array, "..."]:
    """Kinetic energy in every state of a motion that carries velocities, J."""
    return _over(motion, 1, lambda dyn, q, v: kinetic(dyn, v))


def potential_energy(motion: Motion) -> Float[Array, "..."]:
    """Potential energy of gravity, springs and stops in every pose of a motion, J."""
    return _over(motion, 0, lambda dyn, q, v: potential(dyn, q))


def energy(motion: Motion) -> Float[Array, "..."]:
    """Kinetic and potential energy together, J."""
    return _over(motion, 1, lambda dyn, q, v: kinetic(dyn, v) + potential(dyn, q))


def momentum(motion: Motion) -> Float[Array, "... dim"]:
    """Linear momentum, kg m/s."""
    return _over(motion, 1, lambda dyn, q, v: dyn.moments @ v)


def angular_momentum(motion: Motion, about: Any = None) -> Array:
    """Angular momentum about a fixed place, kg m²/s.

    Args:
        motion: states with velocities.
        about: the place, ``(dim,)``; the origin if not given.

    Returns:
        Anticlockwise ``(...,)`` in the plane, ``(..., 3)`` in space.
    """

    def one(dyn: Dynamics, q: Array, v: Array) -> Array:
        top = dyn.topology
        place = jnp.zeros(top.dim) if about is None else jnp.asarray(about, float)
        turned = jnp.stack([rotated(top, q, axis, place) for axis in range(1 if top.dim == 2 else 3)])
        h = turned @ (dyn.mass @ v)
        return h[0] if top.dim == 2 else h

    return _over(motion, 1, one)


def rotated(top: Topology, q: Array, axis: int, about: Array) -> Array:
    """How all points and vectors change when the whole mechanism turns about an axis at unit rate, ``(N,)``.

    In the plane about the normal (`axis` is ignored); angles and distances do not change.
    """
    points, vectors = spread(top, q)

    def turn(w: Array) -> Array:
        if top.dim == 2:
            return jnp.stack([-w[:, 1], w[:, 0]], axis=1)
        return jnp.cross(jnp.broadcast_to(jnp.eye(3)[axis], w.shape), w)

    parts = [turn(points - about).reshape(-1), turn(vectors).reshape(-1), jnp.zeros(len(top.scalars))]
    return jnp.concatenate(parts)


def shifted(top: Topology, axis: int) -> Array:
    """How all points change when the whole mechanism moves along an axis at unit rate, ``(N,)``."""
    step = jnp.zeros((len(top.points), top.dim)).at[:, axis].set(1.0)
    return jnp.concatenate([step.reshape(-1), jnp.zeros(len(top.vectors) * top.dim + len(top.scalars))])


def _over(motion: Motion, order: int, f: Callable[[Dynamics, Array, Array], Array]) -> Array:
    """A function of single states over all states of a motion, in the coordinates of its dynamics."""
    if len(motion.rates) < order:
        raise InputError("this motion carries no rates, so it has no velocities; pass rates= when you make it")
    system = motion.system
    dyn, top = dynamics(extended(system)), system.topology
    q, lead = motion.q, motion.q.shape[:-1]
    v = motion.rates[0] if order else jnp.zeros_like(q)

    def one(q, v):
        return f(dyn, lift(top, q), lift_rates(top, q, v))

    out = jax.vmap(one)(q.reshape(-1, q.shape[-1]), v.reshape(-1, v.shape[-1]))
    return out.reshape(*lead, *out.shape[1:])
