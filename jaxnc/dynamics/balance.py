"""Where a motion's energy comes from and goes to, and by how much the account is wrong."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.polynomial.polynomial import polyder, polyval

from jaxnc.calls import public
from jaxnc.compiling import filter_jit
from jaxnc.dynamics.energy import kinetic_energy, potential_energy
from jaxnc.dynamics.extended import extended
from jaxnc.dynamics.friction import friction_forces, has_friction
from jaxnc.dynamics.model import Dynamics, force_values, variables
from jaxnc.dynamics.reactions import left_open, reactions
from jaxnc.errors import InputError
from jaxnc.kinematics.inputs import outside
from jaxnc.kinematics.motion import Motion
from jaxnc.system.equations import coefficients, slips
from jaxnc.types import Array

_POINTS = 8  # times that multipliers between two of them are read off, if there are as many
_LEAP = 0.1  # of the fastest point's speed: no smooth motion that is seen at more than six times a turn gains it so
_NODES = (0.5 - np.sqrt(21.0) / 14.0, 0.5, 0.5 + np.sqrt(21.0) / 14.0)  # of Lobatto's rule, between the ends


@public
@dataclasses.dataclass(frozen=True)
class EnergyBalance:
    """The energy balance of a motion in time, on the host; times that were not reached are NaN.

    Attributes:
        time: times, s, ``(T,)``, as everything else, which is in J.
        kinetic: kinetic energy.
        potential: potential energy, of gravity, springs and stops.
        inputs: work done by driven coordinates (and rows on velocities that drive) since the start.
        loads: work done by forces, torques and loads since then.
        dissipated: what dampers and stops have taken since then.
        friction: what friction has taken since then.
        error: work less what was taken, less the change of what is stored: 0 for an exact motion.
        doubt: how far `error` may be due to the sum over the times that were kept, and to no error of the motion; of a
            motion that makes leaps between them, an impact, infinite.
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

    @property
    def total(self) -> np.ndarray:
        """Kinetic and potential energy together."""
        return self.kinetic + self.potential

    @property
    def exchanged(self) -> float:
        """The largest amount that one of them has changed by since the start, J."""
        flows = self.inputs, self.loads, self.dissipated, self.friction
        changes = [*flows, self.kinetic - self.kinetic[0], self.potential - self.potential[0]]
        return max(_largest(x) for x in changes)

    @property
    def largest(self) -> float:
        """Largest error at any time, J."""
        return _largest(self.error)

    @property
    def relative(self) -> float:
        """The same as a part of what was exchanged; 0 where nothing was."""
        return self.largest / self.exchanged if self.exchanged > 0 else 0.0

    @property
    def sentence(self) -> str:
        """What there is to be said of it, in a line."""
        part = f", {self.relative:.1g} of the {self.exchanged:.3g} J exchanged" if self.exchanged > 0 else ""
        if self.relative > 1e-6 and not self.doubt < 0.3 * self.largest:
            return f"known to {self.largest:.2g} J only{part}: keep more than {len(self.time)} times to sum work over"
        return f"off by at most {self.largest:.2g} J{part}"


@public
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
        doubt = np.inf if _missed(motion, t[:count]) else _largest((fine - rough).sum(axis=0))
    stored = kinetic + potential
    error = work.sum(axis=0) - (stored - stored[0])
    inputs, loads, damped, rubbed = work
    return EnergyBalance(t, kinetic, potential, inputs, loads, 0.0 - damped, 0.0 - rubbed, error, doubt)


def _largest(x: np.ndarray) -> float:
    return float(np.nanmax(np.abs(x), initial=0.0)) if np.isfinite(x).any() else 0.0


def _missed(motion: Motion, t: np.ndarray) -> bool:
    """Whether points change their velocities between two times by more than their accelerations there account for."""
    places = len(motion.system.topology.points) * motion.system.topology.dim
    v, a = (np.asarray(x)[: len(t), :places] for x in motion.rates[:2])
    leaps = np.linalg.norm(np.diff(v, axis=0) - np.diff(t)[:, None] * (a[1:] + a[:-1]) / 2, axis=1)
    return bool(np.any(leaps > _LEAP * np.linalg.norm(v, axis=1).max(initial=0.0)))


def _exchanges(motion: Motion) -> bool:
    """Whether there is anything that could give or take energy."""
    top = motion.system.topology
    plain = all(b.kind.dissipation is None and b.kind.force is None for b in top.loads.forces)
    return bool(not plain or motion.driven or motion.held or top.loads.friction or top.loads.functions or top.rates)


def _works(motion: Motion, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Work of inputs, loads, dampers and friction since the start, J ``(4, T)``: by Lobatto's rule, and by Simpson's.

    Between two times coordinates are the curves of fifth (third) degree that have their rates there, and multipliers
    those through the nearest eight (four) times.
    """
    found = reactions(motion)
    dyn, *states = found._states()
    t, q, v, a, lam = (np.asarray(x)[:count] for x in (*states, found.multipliers))
    inner = [_between(t, q, v, a, lam, s, 3, _POINTS) for s in _NODES]
    inner.append(_between(t, q, v, a, lam, 0.5, 2, _POINTS // 2))
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
    return tuple(np.pad(np.cumsum(x, axis=1), ((0, 0), (1, 0))) for x in (lobatto, simpson))  # pyright: ignore[reportReturnType]


def _between(t: Any, q: Any, v: Any, a: Any, lam: Any, s: float, order: int, points: int) -> tuple[Any, ...]:
    """States at a part `s` of every interval, by the rates of its ends up to an order less one."""
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
    near = t[at] - where[:, None]
    gaps = t[at][:, :, None] - t[at][:, None, :] + np.eye(width)
    weights = np.stack([np.delete(-near, k, 1).prod(1) / gaps[:, k].prod(1) for k in range(width)], axis=1)
    return where, *curve, np.einsum("ik,ikr->ir", weights, lam[at])


@filter_jit
def _powers(dyn: Dynamics, at: tuple[int, ...], t: Array, q: Array, v: Array, a: Array, lam: Array) -> Array:
    """Powers of inputs (coordinates `at`), loads, dampers and friction in states ``(P, N)``: ``(4, P)``."""
    top = dyn.topology
    pushing, damping = _only(dyn, "force"), _only(dyn, "dissipation")

    def one(t, q, v, a, lam):
        driving = rubbing = jnp.zeros(())
        if at:
            driving = left_open(dyn, t, q, v, a, lam)[np.array(at)] @ v[np.array(at)]
        if top.rates:
            target = coefficients(top, dyn.rates, q) @ v - slips(top, dyn.rates, q, v)
            driving = driving - lam[len(top.rows) :] @ target
        if has_friction(dyn):
            rubbing = friction_forces(dyn, q, v, a, lam, None, t) @ v
        return jnp.stack([driving, _power(pushing, t, q, v), _power(damping, t, q, v), rubbing])

    return jax.vmap(one)(t, q, v, a, lam).T


def _only(dyn: Dynamics, part: str) -> Dynamics:
    """The dynamics with one part of its kinds of force alone; functions go with what pushes."""
    top = dyn.topology
    nothing = {"potential": None, "dissipation": None, "force": None}
    kept = [k for k, b in enumerate(top.loads.forces) if getattr(b.kind, part) is not None]
    forces = tuple(
        dataclasses.replace(b, kind=dataclasses.replace(b.kind, **nothing | {part: getattr(b.kind, part)}))
        for b in (top.loads.forces[k] for k in kept)
    )
    functions = top.loads.functions if part == "force" else ()
    loads = dataclasses.replace(top.loads, forces=forces, functions=functions)
    system = dataclasses.replace(dyn.system, topology=dataclasses.replace(top, loads=loads))
    own = dyn.own if functions else ()
    return dataclasses.replace(dyn, system=system, constants=tuple(dyn.constants[k] for k in kept), own=own)


def _power(dyn: Dynamics, t: Array, q: Array, v: Array) -> Array:
    local, functions = force_values(dyn, t, q, v)
    total: Any = jnp.zeros(())
    for number, values in enumerate(local):
        total = total + jnp.sum(values * v[variables(dyn.topology, number)])
    return sum((f @ v for f in functions), total)
