"""Coulomb friction in joints, proportional to the joint's reaction, which it changes itself.

The reaction is that of `jaxnc.dynamics.reactions`: what passes through the pin, also where the pin is a point that two
bodies share. Accelerations, reactions and friction are made consistent by repetition: with a pin of radius r in links
of length L each pass leaves a part of about ``μ r / L``; in a slider ``μ`` times the slope of the rod that pushes it.
The sign of the sliding speed is smoothed, ``tanh(v / speed)``: a joint that sticks creeps at a part of that speed.
"""

import jax.numpy as jnp
import numpy as np

from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.model import Dynamics, forces
from jaxnc.dynamics.reactions import body_force, row_forces
from jaxnc.system.loads import FrictionIndex
from jaxnc.system.topology import Topology
from jaxnc.types import Array

PASSES = 6
"""How often accelerations and friction are made consistent."""


def has_friction(dyn: Dynamics) -> bool:
    """Whether there is any friction."""
    return bool(dyn.topology.loads.friction)


def settled_forces(
    flow: Flow, t: Array, q: Array, v: Array, baumgarte: tuple[float, float] | None = None
) -> tuple[Array, Array]:
    """Accelerations and multipliers of the view's rows, with friction if there is any."""
    a, lam = flow.accelerate(t, q, v, None, baumgarte)
    if not has_friction(flow.dyn):
        return a, lam
    total = jnp.zeros_like(q)
    rows = jnp.zeros(len(flow.dyn.topology.rows))
    for _ in range(PASSES):
        total = friction_forces(flow.dyn, q, v, a, rows.at[flow.view.rows].set(lam), total, t)
        a, lam = flow.accelerate(t, q, v, total, baumgarte)
    return a, lam


def friction_forces(
    dyn: Dynamics, q: Array, v: Array, a: Array, lam: Array, before: Array | None = None, t: Array | float = 0.0
) -> Array:
    """Generalised forces of friction ``(N,)``.

    Args:
        dyn: the equations of motion.
        q: pose.
        v: rates.
        a: accelerations.
        lam: multipliers of all rows.
        before: the friction forces that accelerations and multipliers were made with.
        t: time.
    """
    top, total = dyn.topology, jnp.zeros_like(q)
    t = jnp.asarray(t, float)
    before = jnp.zeros_like(q) if before is None else before
    for index, numbers in zip(top.loads.friction, dyn.friction, strict=True):
        if index.bodies is not None:
            total = total + _pin(dyn, index, numbers, t, q, v, a, lam)
        elif index.point >= 0:
            total = total + _guided(dyn, index, numbers, t, q, v, a, lam, before)
        else:
            total = total + _slider(dyn, index, numbers, q, v, lam)
    return total


def _pin(dyn: Dynamics, index: FrictionIndex, numbers: Array, t, q, v, a, lam) -> Array:
    top = dyn.topology
    coefficient, speed, radius = numbers
    assert index.bodies is not None
    at = np.arange(top.dim) + index.point * top.dim
    spins = [_spin(top, name, q, v) for name in index.bodies]
    moving = next(name for name in index.bodies if name != "ground")
    # The couple that friction puts on a body has no force at the pin: its own part there is taken out again, and as
    # that is proportional to what is wanted, both follow from one equation.
    pull = body_force(dyn.system, dyn, moving, t[None], q, v, a, lam)[at]
    sign = 1.0 if moving == index.bodies[0] else -1.0
    rate = coefficient * radius * jnp.tanh((spins[0] - spins[1]) * radius / speed)
    couple = _couple(top, moving, q)
    normal = _size(pull)
    for _ in range(4):
        normal = _size(pull + sign * rate * normal * couple[at])
    moment = -rate * normal
    out = jnp.zeros_like(q)
    for name, side in zip(index.bodies, (1.0, -1.0), strict=True):
        if name != "ground":
            out = out + side * moment * _couple(top, name, q)
    return out


def _guided(dyn: Dynamics, index: FrictionIndex, numbers: Array, t, q, v, a, lam, before) -> Array:
    top = dyn.topology
    at = np.arange(top.dim) + index.point * top.dim
    fixed = np.array([top.fixed[c] for c in at])
    whole = dyn.mass @ a + row_forces(dyn.eq, np.arange(len(top.rows)), q, lam) - forces(dyn, t, q, v) - before
    normal = _size(whole[at[fixed]])
    slide = v[at[~fixed]]
    size = _size(slide)
    push = -numbers[0] * normal * jnp.tanh(size / numbers[1]) * slide / jnp.where(size > 0, size, 1.0)
    return jnp.zeros_like(q).at[at[~fixed]].set(push)


def _slider(dyn: Dynamics, index: FrictionIndex, numbers: Array, q, v, lam) -> Array:
    top = dyn.topology
    joint = next(j for j in top.joints if j.name == index.joint)
    i, j, p = joint.points[:3]
    owned = [index.joint in o.split(" and ") for b in top.blocks for o in b.owners for _ in b.kind.rows]
    force = -row_forces(dyn.eq, np.flatnonzero(owned), q, lam)

    def of(x, k):
        return x[k * top.dim : (k + 1) * top.dim]

    d = of(q, j) - of(q, i)
    length = jnp.dot(d, d)
    u = d / jnp.sqrt(length)
    part = jnp.dot(of(q, p) - of(q, i), d) / length
    carried = of(v, i) + part * (of(v, j) - of(v, i))
    slide = jnp.dot(of(v, p) - carried, u)
    on = set(joint.points[2:]) - {i, j}
    normal = _size(jnp.sum(jnp.stack([of(force, k) for k in sorted(on)]), axis=0))
    push = -numbers[0] * normal * jnp.tanh(slide / numbers[1]) * u
    out = jnp.zeros_like(q)
    for k, share in ((p, 1.0), (i, part - 1.0), (j, -part)):
        out = out.at[np.arange(top.dim) + k * top.dim].add(share * push)
    return out


def _base(top: Topology, name: str) -> tuple[int, int]:
    base = next(b for b in top.bodies if b.name == name).base
    assert base is not None
    return base


def _spin(top: Topology, name: str, q: Array, v: Array) -> Array:
    """Angular velocity of a planar body; zero of the ground."""
    if name == "ground":
        return jnp.zeros(())
    i, j = _base(top, name)
    d, w = (x[2 * j : 2 * j + 2] - x[2 * i : 2 * i + 2] for x in (q, v))
    return (d[0] * w[1] - d[1] * w[0]) / jnp.dot(d, d)


def _couple(top: Topology, name: str, q: Array) -> Array:
    """Generalised force of a couple of one on a planar body."""
    i, j = _base(top, name)
    d = q[2 * j : 2 * j + 2] - q[2 * i : 2 * i + 2]
    push = jnp.stack([-d[1], d[0]]) / jnp.dot(d, d)
    out = jnp.zeros_like(q)
    return out.at[2 * i : 2 * i + 2].add(-push).at[2 * j : 2 * j + 2].add(push)


def _size(force: Array) -> Array:
    square = jnp.sum(force * force)
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
