"""Mass, energies and momenta of states, single or in batches, and the energy balance of a motion."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.polynomial.polynomial import polyder, polyval

from jaxnc.calls import public
from jaxnc.compiling import filter_jit, jit, on_device
from jaxnc.dynamics.extended import extended, is_concrete, lift_states
from jaxnc.dynamics.model import (
    Dynamics,
    check_loads,
    dynamics,
    energy_formula,
    force_values,
    force_variables,
    potential,
)
from jaxnc.dynamics.reactions import open_forces, reactions, states_of
from jaxnc.dynamics.wrenches import cross, friction_forces, has_friction
from jaxnc.errors import InputError
from jaxnc.internals import outermost
from jaxnc.kinematics.inputs import outside
from jaxnc.kinematics.motion import Motion
from jaxnc.system.equations import slips
from jaxnc.system.frames import spread
from jaxnc.system.precision import as_its_system
from jaxnc.system.system import System
from jaxnc.types import Array, ArrayLike, Float, Numbers
from jaxnc.validate import as_shape


@public
def total_mass(system: System) -> Array:
    """Mass of everything that has one, kg."""
    check_loads(system, "total_mass()", moves=True)
    return dynamics(extended(system)).total


@public
def centre_of_mass(motion: Motion) -> Float[Array, "... dim"]:
    """Centre of mass of the whole mechanism in every pose of a motion."""
    return _evaluate(motion, 0, _centre)


@public
def kinetic_energy(motion: Motion) -> Float[Array, "..."]:
    """Kinetic energy in every state of a motion that carries velocities, J."""
    return _evaluate(motion, 1, _kinetic)


@public
def potential_energy(motion: Motion) -> Float[Array, "..."]:
    """Potential energy of gravity, springs and stops in every pose of a motion, J."""
    return _evaluate(motion, 0, _potential)


def energy(motion: Motion) -> Float[Array, "..."]:
    """Kinetic and potential energy together, J."""
    return _evaluate(motion, 1, _both)


@public
def momentum(motion: Motion) -> Float[Array, "... dim"]:
    """Linear momentum, kg m/s."""
    return _evaluate(motion, 1, _momentum)


@public
@as_its_system
def angular_momentum(motion: Motion, about: ArrayLike | None = None) -> Array:
    """Angular momentum about a fixed place, kg m²/s.

    Args:
        motion: states with velocities.
        about: the place, ``(dim,)``; the origin if not given.

    Returns:
        Anticlockwise ``(...,)`` in the plane, ``(..., 3)`` in space.
    """
    top = motion.system.topology
    place = jnp.zeros(top.dim) if about is None else jnp.asarray(as_shape(about, "angular_momentum(): about", top.dim))
    return _evaluate(motion, 1, _angular_momentum, place)


# Functions of all states at once: of NumPy's arrays or of JAX's.


def _centre(dyn: Dynamics, q: Numbers, v: Numbers) -> Numbers:
    return q @ dyn.moments.T / dyn.total


def _kinetic(dyn: Dynamics, q: Numbers, v: Numbers) -> Numbers:
    return 0.5 * ((v @ dyn.mass) * v).sum(axis=-1)


def _potential(dyn: Dynamics, q: Numbers, v: Numbers) -> Numbers:
    if not isinstance(q, np.ndarray):
        return jax.vmap(lambda x: potential(dyn, x))(q)
    top, total = dyn.topology, np.zeros(len(q), q.dtype)
    for number, block in enumerate(top.loads.forces):
        if block.kind.potential is not None:
            x, c = q[:, force_variables(top, number)], np.asarray(dyn.constants[number])
            found = energy_formula(block.kind, top.dim).on_lanes([*np.moveaxis(x, -1, 0), *c.T])[0]
            total = total + np.broadcast_to(found, x.shape[:2]).sum(axis=1)
    return total - q @ dyn.moments.T @ dyn.gravity


def _both(dyn: Dynamics, q: Numbers, v: Numbers) -> Numbers:
    return _kinetic(dyn, q, v) + _potential(dyn, q, v)


def _momentum(dyn: Dynamics, q: Numbers, v: Numbers) -> Numbers:
    return v @ dyn.moments.T


def _angular_momentum(dyn: Dynamics, q: Any, v: Any, about: Any) -> Any:
    (points, vectors), (p, couples) = (spread(dyn.topology, x) for x in (q, v @ dyn.mass))
    return cross(points - about, p).sum(1) + cross(vectors, couples).sum(1)


def _evaluate(motion: Motion, order: int, f: Callable, *more: object) -> Array:
    """Evaluate a function of states over all states of a motion, in the coordinates of its dynamics."""
    if not isinstance(motion, Motion):
        raise InputError(f"energies and momenta are those of a motion, got {type(motion).__name__}")
    if len(motion.rates) < order:
        raise InputError("this motion carries no rates, so it has no velocities; pass rates= when you make it")
    check_loads(motion.system, "energies and momenta", moves=True)
    system, lead = motion.system, motion.status.shape
    if is_concrete(motion, more) and outermost():
        states: Any = motion.poses, motion.rates[0] if order else motion.poses
        q, v = (np.asarray(x).reshape(-1, len(system.topology.coordinates)) for x in states)
        dyn = jax.tree.map(np.asarray, dynamics(extended(system)))
        with np.errstate(all="ignore"):
            out = f(dyn, *lift_states(system.topology, q, v), *map(np.asarray, more))
        return on_device(out.reshape((*lead, *out.shape[1:])))
    q = motion.q.reshape(-1, motion.q.shape[-1])
    v = motion.rates[0].reshape(q.shape) if order else jnp.zeros_like(q)
    out = _evaluate_traced(f, system, q, v, *more)
    return out.reshape((*lead, *out.shape[1:]))


@functools.partial(jit, static_argnums=0)
def _evaluate_traced(f: Callable[..., Any], system: System, q: Array, v: Array, *more: Array) -> Array:
    return f(dynamics(extended(system)), *lift_states(system.topology, q, v), *more)


# -- where the energy comes from and goes to --------------------------------------------------------------------------

_NODES = (0.5 - np.sqrt(21.0) / 14.0, 0.5, 0.5 + np.sqrt(21.0) / 14.0)  # of Lobatto's rule, between the ends


@public
@dataclasses.dataclass(frozen=True)
class EnergyBalance:
    """The energy balance of a motion in time, on the host; times that were not reached are NaN.

    Attributes:
        time: times, s, ``(T,)``, as everything else.
        kinetic: kinetic energy.
        potential: potential energy, of gravity, springs and stops.
        inputs: work done by driven coordinates (and rows on velocities that drive) since the start.
        loads: work done by forces, torques and loads since then.
        dissipated: what dampers and stops have taken since then.
        friction: what friction has taken since then.
        error: work less what was taken, less the change of what is stored: 0 for an exact motion.
        doubt: how far `error` may be due to the sum over the times that were kept, and to no error of the motion; of a
            motion that makes leaps between them, an impact, infinite.
        unit: of all energies.
    """

    time: np.ndarray
    kinetic: np.ndarray
    potential: np.ndarray
    inputs: np.ndarray
    loads: np.ndarray
    dissipated: np.ndarray
    friction: np.ndarray
    error: np.ndarray
    doubt: float
    unit: str = "J"

    @property
    def total(self) -> np.ndarray:
        """Kinetic and potential energy together."""
        return self.kinetic + self.potential

    @property
    def exchanged(self) -> float:
        """Largest amount that one kind of energy has changed by since the start, J."""
        flows = self.inputs, self.loads, self.dissipated, self.friction
        changes = [*flows, self.kinetic - self.kinetic[0], self.potential - self.potential[0]]
        return max(_largest_magnitude(x) for x in changes)

    @property
    def largest(self) -> float:
        """Largest error at any time, J."""
        return _largest_magnitude(self.error)

    @property
    def relative(self) -> float:
        """Largest error as a part of what was exchanged, or of the kinetic energy where that is more."""
        return self.largest / self._whole if self._whole > 0 else 0.0

    @property
    def _whole(self) -> float:
        return max(self.exchanged, _largest_magnitude(self.kinetic))

    @property
    def sentence(self) -> str:
        """The balance in a line of words."""
        unit, most = self.unit, f"{self.largest:.2g} {self.unit}"
        kind = "exchanged" if self._whole == self.exchanged else "of kinetic energy"
        part = f", {self.relative:.1g} of the {self._whole:.3g} {unit} {kind}" if self._whole > 0 else ""
        if self.relative > 1e-6 and not self.doubt < 0.3 * self.largest:
            return f"known to {most} only{part}: keep more than {len(self.time)} times to sum work over"
        return f"off by at most {most}{part}"


@public
@as_its_system
def energy_balance(motion: Motion) -> EnergyBalance:
    """Account for a motion's energy: what came in, what is stored, what was taken, and the error.

    Work is summed over the times that the motion has, and curves between them: what happens in between is not seen.

    Args:
        motion: a simulation, or a motion in time with velocities and accelerations.

    Raises:
        InputError: a motion without time or velocities, a batch, or a motion inside of traced code.
    """
    outside(motion, "energy_balance()")
    if motion.time is None or motion.status.ndim != 1:
        raise InputError("an energy balance is of one motion in time: of simulate(), or of motion(system, inputs, t)")
    bad = np.asarray(motion.status) != 0
    t = np.asarray(motion.time, float)
    kinetic, potential = (np.where(bad, np.nan, np.asarray(f(motion))) for f in (kinetic_energy, potential_energy))
    count = len(t) if not bad.any() else int(np.argmax(bad))  # no work beyond what was not reached
    work, doubt = np.full((4, len(t)), np.nan), 0.0
    work[:, :count] = 0.0
    if count > 1 and _exchanges(motion):
        fine, rough = _works(motion, count)
        work[:, :count] = fine
        doubt = np.inf if _leaps(motion, t[:count]) else _largest_magnitude((fine - rough).sum(axis=0))
    stored = kinetic + potential
    error = work.sum(axis=0) - (stored - stored[0])
    inputs, loads, damped, rubbed = work
    unit = motion.system.topology.load_unit("energy")
    return EnergyBalance(t, kinetic, potential, inputs, loads, 0.0 - damped, 0.0 - rubbed, error, doubt, unit)


def _largest_magnitude(x: np.ndarray) -> float:
    return float(np.nanmax(np.abs(x), initial=0.0)) if np.isfinite(x).any() else 0.0


def _leaps(motion: Motion, t: np.ndarray) -> bool:
    """Tell whether points change their velocities between two times by more than their accelerations account for."""
    places = len(motion.system.topology.points) * motion.system.topology.dim
    v, a = (np.asarray(x)[: len(t), :places] for x in motion.rates[:2])
    leaps = np.linalg.norm(np.diff(v, axis=0) - np.diff(t)[:, None] * (a[1:] + a[:-1]) / 2, axis=1)
    # 0.1 of the fastest point's speed: no smooth motion that is seen at more than six times a turn gains it so
    return bool(np.any(leaps > 0.1 * np.linalg.norm(v, axis=1).max(initial=0.0)))


def _exchanges(motion: Motion) -> bool:
    """Tell whether there is anything that could give or take energy."""
    top = motion.system.topology
    plain = all(b.kind.dissipation is None and b.kind.force is None for b in top.loads.forces)
    return bool(not plain or motion.driven or motion.held or top.loads.friction or top.loads.functions or top.rates)


def _works(motion: Motion, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Sum work of inputs, loads, dampers and friction since the start, J ``(4, T)``, by Lobatto's and Simpson's rules.

    Between two times coordinates are the curves of fifth (third) degree that have their rates there, and multipliers
    those through the nearest eight (four) times.
    """
    found = reactions(motion)
    dyn, *states = states_of(motion)
    t, q, v, a, lam = (np.asarray(x)[:count] for x in (*states, found.multipliers))
    often = 8  # times that multipliers between two of them are read off, if there are as many
    inner = [_between(t, q, v, a, lam, s, 3, often) for s in _NODES]
    inner.append(_between(t, q, v, a, lam, 0.5, 2, often // 2))
    every = [np.concatenate(x) for x in zip((t, q, v, a, lam), *inner, strict=True)]
    more = 2 ** int(np.ceil(np.log2(len(every[0])))) - len(every[0])  # few numbers of states are compiled for
    padded = [np.concatenate([x, np.repeat(x[-1:], more, axis=0)]) for x in every]
    position = extended(motion.system).topology.position
    at = tuple(position[name] for name in (*motion.driven, *motion.held))
    powers = np.asarray(_powers(dyn, at, *padded))
    steps, width = np.diff(t), count - 1
    first, last = powers[:, :width], powers[:, 1:count]
    low, middle, high, rough = (powers[:, count + k * width : count + (k + 1) * width] for k in range(4))
    lobatto = ((first + last) / 20 + 49 * (low + high) / 180 + 16 * middle / 45) * steps
    simpson = (first + 4 * rough + last) / 6 * steps
    works, rougher = (np.pad(np.cumsum(x, axis=1), ((0, 0), (1, 0))) for x in (lobatto, simpson))
    return works, rougher


def _between(
    t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, lam: np.ndarray, s: float, order: int, points: int
) -> tuple[np.ndarray, ...]:
    """Interpolate states at a part `s` of every interval, by the rates of its ends up to an order less one."""
    h = np.diff(t)[:, None]
    ends = [x * h**k for k, x in enumerate((q[:-1], v[:-1], a[:-1])[:order])]
    ends += [x * h**k for k, x in enumerate((q[1:], v[1:], a[1:])[:order])]

    def row(x: float, k: int) -> np.ndarray:
        """The k-th derivatives at x of a polynomial's powers."""
        return np.asarray(polyval(x, polyder(np.eye(2 * order), k)))

    inverse = np.linalg.inv(np.array([row(x, k) for x in (0.0, 1.0) for k in range(order)]))
    curve = [np.tensordot(row(s, k) @ inverse, np.stack(ends), 1) / h**k for k in range(3)]
    count, width = len(t), min(points, len(t))
    first = np.clip(np.arange(count - 1) - width // 2 + 1, 0, count - width)
    at = first[:, None] + np.arange(width)
    where = t[:-1] + s * h[:, 0]
    near = np.subtract(t[at], where[:, None], dtype=float) / h  # in parts of the interval, whatever the unit of time
    gaps = (t[at][:, :, None] - t[at][:, None, :]) / h[:, None] + np.eye(width)
    weights = np.stack([np.delete(-near, k, 1).prod(1) / gaps[:, k].prod(1) for k in range(width)], axis=1)
    return where, *curve, np.einsum("ik,ikr->ir", weights, lam[at])


@filter_jit
def _powers(dyn: Dynamics, at: tuple[int, ...], t: Array, q: Array, v: Array, a: Array, lam: Array) -> Array:
    """Return powers of inputs (coordinates `at`), loads, dampers and friction in states ``(P, N)``: ``(4, P)``."""
    top = dyn.topology

    def one(t, q, v, a, lam):
        driving = rubbing = jnp.zeros(())
        if at:
            driving = open_forces(dyn, t, q, v, a, lam)[np.array(at)] @ v[np.array(at)]
        if top.rates:
            driving = driving + lam[len(top.rows) :] @ slips(top, dyn.rates, q, jnp.zeros_like(v))  # of rows that drive
        if has_friction(dyn):
            rubbing = friction_forces(dyn, q, v, a, lam, t) @ v
        return jnp.stack([driving, *(_power(dyn, t, q, v, part) for part in ("force", "dissipation")), rubbing])

    return jax.vmap(one)(t, q, v, a, lam).T


def _power(dyn: Dynamics, t: Array, q: Array, v: Array, part: str) -> Array:
    """Return the power of what kinds of force state as a part."""
    local, functions = force_values(dyn, t, q, v, part)
    total: Any = jnp.zeros(())
    for number, values in enumerate(local):
        total = total + jnp.sum(values * v[force_variables(dyn.topology, number)])
    return sum((f @ v for f in functions), total)
