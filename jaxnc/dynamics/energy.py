"""Mass, energies and momenta as functions of a state, single or in batches."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.asking import shaped
from jaxnc.calls import public
from jaxnc.compiling import jit, on_device
from jaxnc.dynamics.extended import extended, known, lift, lift_rates, lifted
from jaxnc.dynamics.model import Dynamics, can_store, check_loads, check_mass, dynamics, potential, stored, variables
from jaxnc.errors import InputError
from jaxnc.internals import outermost
from jaxnc.kinematics.motion import Motion
from jaxnc.system.frames import spread
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Float


@public
def total_mass(system: System) -> Array:
    """Mass of everything that has one, kg."""
    check_loads(system, "total_mass()")
    check_mass(system)
    return dynamics(extended(system)).total


@public
def centre_of_mass(motion: Motion) -> Float[Array, "... dim"]:
    """Centre of mass of the whole mechanism in every pose of a motion."""
    return _over(motion, 0, _centre)


@public
def kinetic_energy(motion: Motion) -> Float[Array, "..."]:
    """Kinetic energy in every state of a motion that carries velocities, J."""
    return _over(motion, 1, _kinetic)


@public
def potential_energy(motion: Motion) -> Float[Array, "..."]:
    """Potential energy of gravity, springs and stops in every pose of a motion, J."""
    return _over(motion, 0, _potential)


def energy(motion: Motion) -> Float[Array, "..."]:
    """Kinetic and potential energy together, J."""
    return _over(motion, 1, _both)


@public
def momentum(motion: Motion) -> Float[Array, "... dim"]:
    """Linear momentum, kg m/s."""
    return _over(motion, 1, _momentum)


@public
def angular_momentum(motion: Motion, about: Any = None) -> Array:
    """Angular momentum about a fixed place, kg m²/s.

    Args:
        motion: states with velocities.
        about: the place, ``(dim,)``; the origin if not given.

    Returns:
        Anticlockwise ``(...,)`` in the plane, ``(..., 3)`` in space.
    """
    top = motion.system.topology
    place = jnp.zeros(top.dim) if about is None else jnp.asarray(shaped(about, "angular_momentum(): about", top.dim))
    return _over(motion, 1, _turning, place)


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


def _centre(dyn: Dynamics, q: Any, v: Any) -> Any:
    return q @ dyn.moments.T / dyn.total


def _kinetic(dyn: Dynamics, q: Any, v: Any) -> Any:
    return 0.5 * ((v @ dyn.mass) * v).sum(axis=-1)


def _potential(dyn: Dynamics, q: Any, v: Any) -> Any:
    return _springs(dyn, q) - q @ dyn.moments.T @ dyn.gravity


def _both(dyn: Dynamics, q: Any, v: Any) -> Any:
    return _kinetic(dyn, q, v) + _potential(dyn, q, v)


def _momentum(dyn: Dynamics, q: Any, v: Any) -> Any:
    return v @ dyn.moments.T


_ON_HOST = _centre, _kinetic, _potential, _both, _momentum
"""Functions of all states at once, of NumPy's arrays or of JAX's."""


def _springs(dyn: Dynamics, q: Any) -> Any:
    """Energies of all forces that have one."""
    if not isinstance(q, np.ndarray):
        return jax.vmap(lambda x: potential(dyn, x) + dyn.gravity @ (dyn.moments @ x))(q)
    top, total = dyn.topology, np.zeros(len(q), q.dtype)
    for number, block in enumerate(top.loads.forces):
        if block.kind.potential is not None:
            x, c = q[:, variables(top, number)], np.asarray(dyn.constants[number])
            found = stored(block.kind, top.dim)([*np.moveaxis(x, -1, 0), *c.T])[0]
            total = total + np.broadcast_to(found, x.shape[:2]).sum(axis=1)
    return total


def _turning(dyn: Dynamics, q: Array, v: Array, about: Array) -> Array:
    top = dyn.topology
    turned = jnp.stack([rotated(top, q, axis, about) for axis in range(1 if top.dim == 2 else 3)])
    h = turned @ (dyn.mass @ v)
    return h[0] if top.dim == 2 else h


def _over(motion: Motion, order: int, f: Callable[..., Array], *more: Array) -> Array:
    """A function of single states over all states of a motion, in the coordinates of its dynamics."""
    if not isinstance(motion, Motion):
        raise InputError(f"energies and momenta are those of a motion, got {type(motion).__name__}")
    if len(motion.rates) < order:
        raise InputError("this motion carries no rates, so it has no velocities; pass rates= when you make it")
    check_loads(motion.system, "energies and momenta")
    check_mass(motion.system)
    system, lead = motion.system, motion.status.shape
    if f in _ON_HOST and known(motion) and outermost() and can_store(system.topology):
        states: Any = motion.poses, motion.rates[0] if order else motion.poses
        q, v = (np.asarray(x).reshape(-1, len(system.topology.coordinates)) for x in states)
        dyn = jax.tree.map(np.asarray, dynamics(extended(system)))
        with np.errstate(all="ignore"):
            found = f(dyn, *lifted(system.topology, q, v))
        return on_device(found.reshape((*lead, *found.shape[1:])))
    q = motion.q
    v = motion.rates[0] if order else jnp.zeros_like(q)
    out = _each(f, system, q.reshape(-1, q.shape[-1]), v.reshape(-1, v.shape[-1]), *more)
    return out.reshape(*lead, *out.shape[1:])


@functools.partial(jit, static_argnums=0)
def _each(f: Callable[..., Array], system: System, q: Array, v: Array, *more: Array) -> Array:
    dyn, top = dynamics(extended(system)), system.topology
    q, v = jax.vmap(lambda q, v: (lift(top, q), lift_rates(top, q, v)))(q, v)
    return f(dyn, q, v) if f in _ON_HOST else jax.vmap(lambda q, v: f(dyn, q, v, *more))(q, v)
