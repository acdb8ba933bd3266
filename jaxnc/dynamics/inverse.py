"""Inverse dynamics: the efforts that a prescribed motion takes, its multipliers, and the reactions of any motion."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import filter_jit, refuse_fork
from jaxnc.dynamics.extended import extended, lift, lift_rates, lift_second_rates, shown_places
from jaxnc.dynamics.friction import friction_forces, has_friction
from jaxnc.dynamics.model import Dynamics, check_loads, dynamics, forces
from jaxnc.dynamics.reactions import Reactions, motion_reactions
from jaxnc.dynamics.saddle import saddle
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.records import record
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import coefficients, jacobian, refuse_rates, weights
from jaxnc.system.system import System
from jaxnc.types import Array, ArrayLike


@public
@record
class InverseDynamics:
    """Efforts and multipliers of a prescribed motion.

    ``result["phi"]`` is the effort on the driven coordinate phi, a torque on an angle, a force on a distance.

    Attributes:
        motion: the motion.
        efforts: efforts on driven and held coordinates, ``(..., inputs)``, N m or N.
        multipliers: Lagrange multipliers of all rows, ``(..., rows)`` (M q̈ + Φ_qᵀ λ = Q + efforts), last those of rows
            on velocities.
        supports: forces of the ground on all coordinates, zero where they are not fixed, ``(..., N)``.
    """

    motion: Motion
    efforts: Array
    multipliers: Array
    supports: Array

    def __getitem__(self, name: str) -> Array:
        """Effort on a driven or held coordinate, ``(...,)``."""
        return self.reactions.effort(name)

    @property
    def power(self) -> Array:
        """Power of all efforts together, W, ``(...,)``."""
        top = self.motion.system.topology
        at = [top.position[name] for name in (*self.motion.driven, *self.motion.held)]
        return jnp.sum(self.efforts * self.motion.rates[0][..., jnp.array(at, dtype=int)], axis=-1)

    @property
    def reactions(self) -> Reactions:
        """Reactions in the joints."""
        return Reactions(self.motion, self.multipliers, self.efforts)


@public
def inverse_dynamics(system: System, motion: Motion) -> InverseDynamics:
    """Find the efforts of the inputs for a prescribed motion, and the reactions in every joint.

    Args:
        system: the system; its bodies have masses. It may be the motion's own, or one with other masses and forces.
        motion: poses with velocities and accelerations: of `jaxnc.motion`, or of `jaxnc.sweep` with rates.

    Returns:
        Efforts, multipliers and reactions, differentiable. Where a pose failed they are zero.

    Raises:
        InputError: a motion without rates; nothing has a mass.

    Source: J. García de Jalón, E. Bayo, Kinematic and Dynamic Simulation of Multibody Systems, ch. 6.
    """
    check_loads(system, "inverse_dynamics()")
    if not isinstance(motion, Motion):
        raise InputError(f"inverse_dynamics() needs a motion, of motion() or sweep(); got {type(motion).__name__}")
    if len(motion.rates) < 2:
        raise InputError(
            "inverse_dynamics needs velocities and accelerations: make the motion with motion(system, {'phi': f}, t) "
            "or pass rates= to sweep"
        )
    if motion.q.shape[-1] != len(system.topology.coordinates):
        raise InputError(
            f"inverse_dynamics(): the motion is one of {motion.system.name!r}, and {system.name!r} has other "
            f"coordinates; give inverse_dynamics(motion.system, motion), or the same mechanism with other masses"
        )
    inner = extended(system)
    dyn = dynamics(inner)
    view = plan(inner.topology, motion.driven, motion.held)
    if len(motion.driven) + len(motion.held) + len(inner.topology.rate_rows) > system.degrees_of_freedom:
        refuse_rates(
            inner.topology,
            "inverse_dynamics",
            "with every freedom driven nothing says which part of a force they take. Drive as many fewer in "
            "simulate(inputs=) and hand over that run",
        )
    t = 0.0 if motion.time is None else motion.time
    efforts, lam, supports = _inverse(system, dyn, view, t, motion.q, *motion.rates[:2], motion.status == 0)
    if system is not motion.system:  # reactions are those of the masses and forces that were asked for
        motion = dataclasses.replace(motion, system=system)
    return InverseDynamics(motion, efforts, lam, supports)


@filter_jit
def _inverse(system: System, dyn: Dynamics, view: Plan, t: ArrayLike, q: Array, v: Array, a: Array, ok: Array):
    """Find efforts, multipliers and supports of poses ``(..., N)``; zero of poses that are not `ok`."""
    top, lead = system.topology, q.shape[:-1]
    t, ok = jnp.broadcast_to(t, lead).reshape(-1), ok.reshape(-1, 1)
    flat = (x.reshape(-1, x.shape[-1]) for x in (q, v, a))
    rates = len(dyn.topology.rate_rows)
    redundant = len(view.rows) + rates > len(view.unknown)
    at = np.concatenate([view.rows, len(dyn.topology.rows) + np.arange(rates, dtype=view.rows.dtype)])

    def one(t, q, v, a):
        x, dx = lift(top, q), lift_rates(top, q, v)
        ddx = lift_second_rates(top, q, v, a)
        right = forces(dyn, t, x, dx) - dyn.mass @ ddx
        _, j, _ = view.linearise(dyn.eq, x)
        everything = jacobian(dyn.eq, x)
        if rates:
            b = coefficients(dyn.topology, dyn.rates, x)
            j, everything = jnp.concatenate([j, b[:, view.unknown]]), jnp.concatenate([everything, b])
        weight = weights(dyn.eq)[view.unknown]
        mass = dyn.mass[view.unknown[:, None], view.unknown[None]] / (weight[:, None] * weight[None])
        size = jnp.max(jnp.diagonal(mass), initial=1e-30)
        solve = saddle(mass / size + 1e-6 * jnp.eye(len(weight)), j / weight, redundant)

        def multipliers(right):
            _, y = solve(right[view.unknown] / (weight * size), jnp.zeros(len(at)))
            return jnp.zeros(everything.shape[0]).at[at].set(y * size)

        lam = multipliers(right)
        total = right
        if has_friction(dyn):
            for _ in range(4):  # the forces of friction change the reactions that they are proportional to
                total = right + friction_forces(dyn, x, dx, ddx, lam, total - right, t)
                lam = multipliers(total)
        whole = everything.T @ lam - total
        supports = jnp.zeros_like(whole).at[view.fixed].set(whole[view.fixed])
        return whole[view.known], lam, supports[shown_places(top)]

    return tuple(jnp.where(ok, x, 0.0).reshape(*lead, -1) for x in jax.vmap(one)(t, *flat))


@public
def reactions(motion: Motion | InverseDynamics | Reactions) -> Reactions:
    """The reactions in the joints of a simulation, or of a motion that its inputs drive.

    Args:
        motion: a simulation, a motion with rates (its inputs then take the efforts that it needs), or the result of
            `jaxnc.inverse_dynamics`.

    Returns:
        The reactions; ``.at("B", on="coupler")`` is the wrench on a body at a shared point.
    """
    refuse_fork()
    if isinstance(motion, Reactions):
        return motion
    if isinstance(motion, InverseDynamics):
        return motion.reactions
    if not isinstance(motion, Motion):
        raise InputError(f"reactions() takes a simulation, or a motion with rates, got {type(motion).__name__}")
    multipliers = getattr(motion, "multipliers", None)  # of a simulation
    if multipliers is not None:
        return motion_reactions(motion, multipliers)
    return inverse_dynamics(motion.system, motion).reactions
