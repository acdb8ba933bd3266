"""Coulomb friction in joints, proportional to the joint's reaction, which it changes itself.

The reaction is that of `jaxnc.dynamics.reactions`: what passes through the pin, also where the pin is a point that two
bodies share. Accelerations, reactions and friction are made consistent by repetition: with a pin of radius r in links
of length L each pass leaves a part of about ``μ r / L``; in a slider ``μ`` times the slope of the rod that pushes it.
The sign of the sliding speed is smoothed, ``tanh(v / speed)``: a joint that sticks creeps at a part of that speed.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.dynamics.model import Dynamics, forces
from jaxnc.dynamics.wrenches import Ledger, cross, magnitude, pose_parts, row_forces
from jaxnc.system.frames import spins, spread
from jaxnc.system.identity import GROUND
from jaxnc.system.loads import FrictionIndex
from jaxnc.system.topology import Topology
from jaxnc.types import Array


def has_friction(dyn: Dynamics) -> bool:
    """Tell whether there is any friction."""
    return bool(dyn.topology.loads.friction)


class _Instant(NamedTuple):
    """A state of a motion in which something rubs."""

    dyn: Dynamics
    t: Array
    q: Array
    v: Array
    a: Array
    lam: Array  # multipliers of all rows
    before: Array  # the friction that `a` and `lam` were found with, (N,)


def friction_forces(
    dyn: Dynamics, q: Array, v: Array, a: Array, lam: Array, before: Array | None = None, t: Array | float = 0.0
) -> Array:
    """Sum the generalised forces of friction ``(N,)``."""
    return sum((f for pair in frictions(dyn, q, v, a, lam, before, t) for f in pair), jnp.zeros_like(q))


def frictions(
    dyn: Dynamics, q: Array, v: Array, a: Array, lam: Array, before: Array | None, t: Array | float
) -> list[tuple[Array, Array]]:
    """Evaluate each friction's forces on the two bodies of `jaxnc.dynamics.wrenches.friction_bodies`, ``(N,)`` each."""
    top, found = dyn.topology, []
    before = jnp.zeros_like(q) if before is None else before
    now = _Instant(dyn, jnp.asarray(t, float), q, v, a, lam, before)
    for index, numbers in zip(top.loads.friction, dyn.friction, strict=True):
        rub = _rub_hinge if index.bodies is not None else _rub_guide if index.point >= 0 else _rub_slider
        found.append(rub(now, index, numbers))
    return found


def _through(now: _Instant, body: int, point: int) -> tuple[Array, np.ndarray]:
    """Return the force that passes into a body where it holds a point, and the points of the joint there."""
    dyn, top = now.dyn, now.dyn.topology
    found = pose_parts(dyn.system, dyn, now.t, now.q, now.v, now.a, now.lam)
    ledger = Ledger(top, jax.tree.map(lambda x: x[None], found), {}, only=body)
    passing = ledger.through(body, point)
    assert passing is not None
    key, group = passing
    return ledger.wrenches[body][key][0][0], np.array([i for i in group.items if i >= 0])


def _oppose(rate: Array, speed: Array) -> Array:
    """Return the direction against a rate ``(k,)``, smoothed where it is slower than `speed`."""
    size = magnitude(rate)
    # At rest it is the slope that counts, of which JAX would find nothing in a direction without length.
    return -jnp.where(size > 0, jnp.tanh(size / speed) / jnp.where(size > 0, size, 1.0), 1.0 / speed) * rate


def _rub_hinge(now: _Instant, index: FrictionIndex, numbers: Array) -> tuple[Array, Array]:
    """Put a couple on both bodies of a pin, hinge or ball, against the relative rotation."""
    top = now.dyn.topology
    coefficient, speed, radius = numbers
    assert index.bodies is not None
    turns = [_spin_and_couple(top, body, now.q, now.v) for body in index.bodies]
    against = coefficient * radius * _oppose((turns[0][0] - turns[1][0]) * radius, speed)
    moving = next(body for body in index.bodies if body != GROUND)
    k = index.bodies.index(moving)
    # What the couple itself puts on the body where the joint holds it is taken out again, and as that is proportional
    # to the force that is wanted, both follow from one equation.
    pull, at = _through(now, moving, index.point)
    own = jnp.sum(spread(top, turns[k][1](against if k == 0 else -against))[0][at], axis=0)
    normal = magnitude(pull)
    for _ in range(4):
        normal = magnitude(pull - normal * own)
    return normal * turns[0][1](against), -normal * turns[1][1](against)


def _spin_and_couple(top: Topology, body: int, q: Array, v: Array) -> tuple[Array, Callable[[Array], Array]]:
    """Return a body's angular velocity, and the generalised force of a couple on it by virtual power.

    Both have one component in the plane, and three in space.
    """
    if body == GROUND:
        return jnp.zeros(2 * top.dim - 3), lambda couple: jnp.zeros_like(q)
    found = top.bodies[body]

    def spin(v: Array) -> Array:
        if top.dim == 3:
            return spins(top, found.segments, q, (v,))
        assert found.base is not None
        d, w = (x[found.base[1]] - x[found.base[0]] for x in (spread(top, q)[0], spread(top, v)[0]))
        return cross(d, w)[None] / jnp.dot(d, d)

    rate, back = jax.vjp(spin, v)
    return rate, lambda couple: back(couple)[0]


def _rub_guide(now: _Instant, index: FrictionIndex, numbers: Array) -> tuple[Array, Array]:
    """Rub at a point with a fixed coordinate, by what holds the coordinate."""
    dyn, top = now.dyn, now.dyn.topology
    at = np.arange(top.dim) + index.point * top.dim
    fixed = np.array([top.fixed[c] for c in at])
    whole = dyn.mass @ now.a + row_forces(dyn.eq, np.arange(len(top.rows)), now.q, now.lam)
    whole = whole - forces(dyn, now.t, now.q, now.v) - now.before
    normal = magnitude(whole[at[fixed]])
    push = numbers[0] * normal * _oppose(now.v[at[~fixed]], numbers[1])
    return jnp.zeros_like(now.q).at[at[~fixed]].set(push), jnp.zeros_like(now.q)


def _rub_slider(now: _Instant, index: FrictionIndex, numbers: Array) -> tuple[Array, Array]:
    """Rub along the line of a slot, prismatic or cylindrical joint, by what its rows press across it."""
    top = now.dyn.topology
    assert index.joint is not None
    joint = next(j for j in top.joints if j.owner == index.joint)
    start, far, at, *rest = index.line or joint.points
    on = [at, *rest] if index.line else sorted({at, *rest} - {start, far})
    (points, vectors), (rates, _) = spread(top, now.q), spread(top, now.v)
    along = vectors[~far] if far < 0 else points[far] - points[start]
    size = magnitude(along)
    u = along / size
    # What the line feels is put on both of its points in the plane, and on the first in space: the same if it is rigid.
    part = jnp.dot(points[at] - points[start], u) / size if top.dim == 2 else 0.0
    ends = {start: part - 1.0, far: -part} if top.dim == 2 else {start: -1.0}
    force, _ = spread(top, row_forces(now.dyn.eq, top.rows_of(index.joint), now.q, now.lam))
    normal = magnitude(jnp.sum(force[np.array(on)], axis=0))
    slide = jnp.dot(rates[at] + sum(share * rates[k] for k, share in ends.items()), u)
    push = -numbers[0] * normal * jnp.tanh(slide / numbers[1]) * u
    none, axes = jnp.zeros_like(now.q), np.arange(top.dim)
    line = sum((none.at[axes + k * top.dim].add(share * push) for k, share in ends.items()), none)
    return none.at[axes + at * top.dim].add(push), line
