"""Mass, energies and momenta as functions of a state, single or in batches."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from jaxnc.compiling import jit
from jaxnc.dynamics.extended import extended, lift, lift_rates
from jaxnc.dynamics.model import Dynamics, check_loads, dynamics, kinetic, potential
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.system.frames import spread
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Float


def total_mass(system: System) -> Array:
    """Mass of everything that has one, kg."""
    check_loads(system, "total_mass()")
    return dynamics(extended(system)).total


def centre_of_mass(motion: Motion) -> Float[Array, "... dim"]:
    """Centre of mass of the whole mechanism in every pose of a motion."""
    return _over(motion, 0, _centre)


def kinetic_energy(motion: Motion) -> Float[Array, "..."]:
    """Kinetic energy in every state of a motion that carries velocities, J."""
    return _over(motion, 1, _kinetic)


def potential_energy(motion: Motion) -> Float[Array, "..."]:
    """Potential energy of gravity, springs and stops in every pose of a motion, J."""
    return _over(motion, 0, _potential)


def energy(motion: Motion) -> Float[Array, "..."]:
    """Kinetic and potential energy together, J."""
    return _over(motion, 1, _both)


def momentum(motion: Motion) -> Float[Array, "... dim"]:
    """Linear momentum, kg m/s."""
    return _over(motion, 1, _momentum)


def angular_momentum(motion: Motion, about: Any = None) -> Array:
    """Angular momentum about a fixed place, kg m²/s.

    Args:
        motion: states with velocities.
        about: the place, ``(dim,)``; the origin if not given.

    Returns:
        Anticlockwise ``(...,)`` in the plane, ``(..., 3)`` in space.
    """
    top = motion.system.topology
    return _over(motion, 1, _turning, jnp.zeros(top.dim) if about is None else jnp.asarray(about, float))


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


def _centre(dyn: Dynamics, q: Array, v: Array) -> Array:
    return dyn.moments @ q / dyn.total


def _kinetic(dyn: Dynamics, q: Array, v: Array) -> Array:
    return kinetic(dyn, v)


def _potential(dyn: Dynamics, q: Array, v: Array) -> Array:
    return potential(dyn, q)


def _both(dyn: Dynamics, q: Array, v: Array) -> Array:
    return kinetic(dyn, v) + potential(dyn, q)


def _momentum(dyn: Dynamics, q: Array, v: Array) -> Array:
    return dyn.moments @ v


def _turning(dyn: Dynamics, q: Array, v: Array, about: Array) -> Array:
    top = dyn.topology
    turned = jnp.stack([rotated(top, q, axis, about) for axis in range(1 if top.dim == 2 else 3)])
    h = turned @ (dyn.mass @ v)
    return h[0] if top.dim == 2 else h


def _over(motion: Motion, order: int, f: Callable[..., Array], *more: Array) -> Array:
    """A function of single states over all states of a motion, in the coordinates of its dynamics."""
    if len(motion.rates) < order:
        raise InputError("this motion carries no rates, so it has no velocities; pass rates= when you make it")
    check_loads(motion.system, "energies and momenta")
    q, lead = motion.q, motion.q.shape[:-1]
    v = motion.rates[0] if order else jnp.zeros_like(q)
    out = _each(f, motion.system, q.reshape(-1, q.shape[-1]), v.reshape(-1, v.shape[-1]), *more)
    return out.reshape(*lead, *out.shape[1:])


@functools.partial(jit, static_argnums=0)
def _each(f: Callable[..., Array], system: System, q: Array, v: Array, *more: Array) -> Array:
    dyn, top = dynamics(extended(system)), system.topology
    return jax.vmap(lambda q, v: f(dyn, lift(top, q), lift_rates(top, q, v), *more))(q, v)
