"""Coulomb friction in joints, proportional to the joint's reaction, which it changes itself.

The reaction is that of `jaxnc.dynamics.reactions`: what passes through the pin, also where the pin is a point that two
bodies share. Accelerations, reactions and friction are made consistent by repetition: with a pin of radius r in links
of length L each pass leaves a part of about ``μ r / L``; in a slider ``μ`` times the slope of the rod that pushes it.
The sign of the sliding speed is smoothed, ``tanh(v / speed)``: a joint that sticks creeps at a part of that speed.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.dynamics.flow import ACCELERATION, Answer, Flow
from jaxnc.dynamics.model import Dynamics, forces
from jaxnc.dynamics.moments import size as _size
from jaxnc.dynamics.wrenches import Ledger, parts, row_forces
from jaxnc.records import record
from jaxnc.system.frames import spins, spread
from jaxnc.system.identity import GROUND
from jaxnc.system.loads import FrictionIndex
from jaxnc.system.topology import Topology
from jaxnc.types import Array

PASSES = 6
"""How often accelerations and friction are made consistent."""


def has_friction(dyn: Dynamics) -> bool:
    """Whether there is any friction."""
    return bool(dyn.topology.loads.friction)


def settled(flow: Flow, t: Any, q: Array, v: Array) -> Answer:
    """Accelerations and multipliers, with friction if there is any."""
    if not has_friction(flow.dyn):
        return flow.answer(ACCELERATION, t, q, v)

    def settle(state, _):  # a loop, so that accelerations are compiled once
        total, _ = state
        found = flow.answer(ACCELERATION, t, q, v, total)
        rows = flow.all_rows(found.multipliers)
        return (friction_forces(flow.dyn, q, v, found.change, rows, total, t), found), None

    zero = jnp.zeros_like(q)
    start = zero, Answer(zero, flow.no_multipliers(), jnp.zeros(()), jnp.zeros(()))
    return lax.scan(settle, start, None, length=PASSES + 1)[0][1]


@record
class FrictionFlow:
    """The motion of a design in which something rubs."""

    flow: Flow

    def impose(self, t: Any, q: Array, v: Array) -> tuple[Array, Array]:
        """Put the state where the drives have it, as `Flow.impose`."""
        return self.flow.impose(t, q, v)

    def answer(self, what: Any, t: Any, q: Array, v: Array) -> Answer:
        """Solve as `Flow.answer`, for accelerations with friction."""
        if isinstance(what, int):
            return settled(self.flow, t, q, v) if what == ACCELERATION else self.flow.answer(what, t, q, v)
        return lax.cond(
            what == ACCELERATION, lambda: settled(self.flow, t, q, v), lambda: self.flow.answer(what, t, q, v)
        )


def friction_forces(
    dyn: Dynamics, q: Array, v: Array, a: Array, lam: Array, before: Array | None = None, t: Array | float = 0.0
) -> Array:
    """Generalised forces of friction ``(N,)``."""
    return sum((f for pair in frictions(dyn, q, v, a, lam, before, t) for f in pair), jnp.zeros_like(q))


def frictions(
    dyn: Dynamics, q: Array, v: Array, a: Array, lam: Array, before: Array | None, t: Array | float
) -> list[tuple[Array, Array]]:
    """The same one by one, on the two bodies of `jaxnc.dynamics.sides.rubbing`."""
    top, found = dyn.topology, []
    t = jnp.asarray(t, float)
    before = jnp.zeros_like(q) if before is None else before
    for index, numbers in zip(top.loads.friction, dyn.friction, strict=True):
        if index.bodies is not None:
            pin = _pin if top.dim == 2 else _hinge
            found.append(pin(dyn, index, numbers, t, q, v, a, lam))
        elif index.point >= 0:
            found.append((_guided(dyn, index, numbers, t, q, v, a, lam, before), jnp.zeros_like(q)))
        else:
            slider = _slider if top.dim == 2 else _sleeve
            found.append(slider(dyn, index, numbers, q, v, lam))
    return found


def _through(dyn: Dynamics, b: int, point: int, t, q, v, a, lam) -> tuple[Array, np.ndarray]:
    """The force that passes into a body where it holds a point, and the points that belong to the joint there."""
    top = dyn.topology
    ledger = Ledger(top, parts(dyn.system, dyn, t, q, v, a, lam), {}, only=b)
    found = ledger.through(b, point)
    assert found is not None
    key, group = found
    return ledger.wrenches[b][key][0][0], np.array([i for i in group.items if i >= 0])


def _pin(dyn: Dynamics, index: FrictionIndex, numbers: Array, t, q, v, a, lam) -> tuple[Array, Array]:
    top = dyn.topology
    coefficient, speed, radius = numbers
    assert index.bodies is not None
    at = np.arange(top.dim) + index.point * top.dim
    spins = [_spin(top, body, q, v) for body in index.bodies]
    moving = next(body for body in index.bodies if body != GROUND)
    # The couple that friction puts on a body has no force at the pin: its own part there is taken out again, and as
    # that is proportional to what is wanted, both follow from one equation.
    pull, _ = _through(dyn, moving, index.point, t, q, v, a, lam)
    sign = 1.0 if moving == index.bodies[0] else -1.0
    rate = coefficient * radius * jnp.tanh((spins[0] - spins[1]) * radius / speed)
    couple = _couple(top, moving, q)
    normal = _size(pull)
    for _ in range(4):
        normal = _size(pull + sign * rate * normal * couple[at])
    moment = -rate * normal
    first, second = (
        jnp.zeros_like(q) if body == GROUND else side * moment * _couple(top, body, q)
        for body, side in zip(index.bodies, (1.0, -1.0), strict=True)
    )
    return first, second


def _hinge(dyn: Dynamics, index: FrictionIndex, numbers: Array, t, q, v, a, lam) -> tuple[Array, Array]:
    """A pin or ball in space: a couple against the relative rotation, in proportion to the joint's force."""
    top = dyn.topology
    coefficient, speed, radius = numbers
    assert index.bodies is not None
    turns = [_turning(top, body, q, v) for body in index.bodies]
    rate = turns[0][0] - turns[1][0]
    size = _size(rate)
    against = -coefficient * radius * jnp.tanh(size * radius / speed) * rate / jnp.where(size > 0, size, 1.0)
    moving = next(body for body in index.bodies if body != GROUND)
    k = index.bodies.index(moving)
    # As for a pin in the plane: what the couple itself puts on the body where the joint holds it is taken out again.
    pull, at = _through(dyn, moving, index.point, t, q, v, a, lam)
    own = jnp.sum(spread(top, turns[k][1](against if k == 0 else -against))[0][at], axis=0)
    normal = _size(pull)
    for _ in range(4):
        normal = _size(pull - normal * own)
    return normal * turns[0][1](against), -normal * turns[1][1](against)


def _turning(top: Topology, body: int, q: Array, v: Array) -> tuple[Array, Callable[[Array], Array]]:
    """Angular velocity of a body in space, and the generalised force of a couple on it, by virtual power."""
    if body == GROUND:
        return jnp.zeros(3), lambda couple: jnp.zeros_like(q)
    segments = top.bodies[body].segments
    rate, back = jax.vjp(lambda x: spins(top, segments, q, (x,)), v)
    return rate, lambda couple: back(couple)[0]


def _sleeve(dyn: Dynamics, index: FrictionIndex, numbers: Array, q: Array, v: Array, lam: Array) -> tuple[Array, Array]:
    """A prismatic, cylindrical or slot joint in space: what its rows press across the line, against the sliding."""
    top = dyn.topology
    assert index.joint is not None
    points, vectors = spread(top, q)
    start, far, *on = index.line
    u = vectors[~far] if far < 0 else points[far] - points[start]
    u = u / _size(u)
    rates, _ = spread(top, v)
    force, _ = spread(top, row_forces(dyn.eq, top.rows_of(index.joint), q, lam))
    normal = _size(jnp.sum(force[np.array(on)], axis=0))
    slide = jnp.dot(rates[on[0]] - rates[start], u)
    push = -numbers[0] * normal * jnp.tanh(slide / numbers[1]) * u
    rest = jnp.zeros_like(q)
    return rest.at[np.arange(3) + on[0] * 3].add(push), rest.at[np.arange(3) + start * 3].add(-push)


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


def _slider(dyn: Dynamics, index: FrictionIndex, numbers: Array, q, v, lam) -> tuple[Array, Array]:
    top = dyn.topology
    joint = next(j for j in top.joints if j.owner == index.joint)
    i, j, p = joint.points[:3]
    force = -row_forces(dyn.eq, top.rows_of(joint.owner), q, lam)

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
    rest, at = jnp.zeros_like(q), np.arange(top.dim)
    line = rest.at[at + i * top.dim].add((part - 1.0) * push).at[at + j * top.dim].add(-part * push)
    return rest.at[at + p * top.dim].add(push), line


def _base(top: Topology, body: int) -> tuple[int, int]:
    base = top.bodies[body].base
    assert base is not None
    return base


def _spin(top: Topology, body: int, q: Array, v: Array) -> Array:
    """Angular velocity of a planar body; zero of the ground."""
    if body == GROUND:
        return jnp.zeros(())
    i, j = _base(top, body)
    d, w = (x[2 * j : 2 * j + 2] - x[2 * i : 2 * i + 2] for x in (q, v))
    return (d[0] * w[1] - d[1] * w[0]) / jnp.dot(d, d)


def _couple(top: Topology, body: int, q: Array) -> Array:
    """Generalised force of a couple of one on a planar body."""
    i, j = _base(top, body)
    d = q[2 * j : 2 * j + 2] - q[2 * i : 2 * i + 2]
    push = jnp.stack([-d[1], d[0]]) / jnp.dot(d, d)
    out = jnp.zeros_like(q)
    return out.at[2 * i : 2 * i + 2].add(-push).at[2 * j : 2 * j + 2].add(push)
