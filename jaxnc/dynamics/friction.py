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
from jax import lax

from jaxnc.dynamics.flow import ACCELERATION, Flow, StageSolution
from jaxnc.dynamics.model import Dynamics, forces
from jaxnc.dynamics.wrenches import Ledger, magnitude, pose_parts, row_forces
from jaxnc.records import record
from jaxnc.system.frames import spins, spread
from jaxnc.system.identity import GROUND
from jaxnc.system.loads import FrictionIndex
from jaxnc.system.topology import Topology
from jaxnc.types import Array, ArrayLike


def has_friction(dyn: Dynamics) -> bool:
    """Tell whether there is any friction."""
    return bool(dyn.topology.loads.friction)


def accelerate_with_friction(flow: Flow, t: Array, q: Array, v: Array) -> StageSolution:
    """Solve for accelerations and multipliers, with friction if there is any."""
    if not has_friction(flow.dyn):
        return flow.solve_stage(ACCELERATION, t, q, v)

    def settle(state, _):  # a loop, so that accelerations are compiled once
        total, _ = state
        found = flow.solve_stage(ACCELERATION, t, q, v, total)
        rows = flow.place_multipliers(found.multipliers)
        return (friction_forces(flow.dyn, q, v, found.change, rows, total, t), found), None

    zero = jnp.zeros_like(q)
    start = zero, StageSolution(zero, flow.zero_multipliers(), jnp.zeros(()), jnp.zeros(()))
    # Six times accelerations and friction are made consistent.
    return lax.scan(settle, start, None, length=7)[0][1]


@record
class FrictionFlow:
    """The motion of a design in which something rubs."""

    flow: Flow

    def impose(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Put the state where the drives have it, as `Flow.impose`."""
        return self.flow.impose(t, q, v)

    def solve_stage(self, stage: ArrayLike, t: Array, q: Array, v: Array) -> StageSolution:
        """Solve a stage as `Flow.solve_stage`, for accelerations with friction."""

        def accelerate() -> StageSolution:
            return accelerate_with_friction(self.flow, t, q, v)

        def project() -> StageSolution:
            return self.flow.solve_stage(stage, t, q, v)

        if isinstance(stage, int):
            return accelerate() if stage == ACCELERATION else project()
        return lax.cond(stage == ACCELERATION, accelerate, project)


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
        if index.bodies is not None:
            rub = _pin if top.dim == 2 else _hinge
        elif index.point >= 0:
            rub = _guide
        else:
            rub = _slider if top.dim == 2 else _sleeve
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


def _pin(now: _Instant, index: FrictionIndex, numbers: Array) -> tuple[Array, Array]:
    """Put a couple on both bodies of a pin in the plane, against the relative rotation."""
    top, q, v = now.dyn.topology, now.q, now.v
    coefficient, speed, radius = numbers
    assert index.bodies is not None
    at = np.arange(top.dim) + index.point * top.dim
    spins = [_spin(top, body, q, v) for body in index.bodies]
    moving = next(body for body in index.bodies if body != GROUND)
    # The couple that friction puts on a body has no force at the pin: its own part there is taken out again, and as
    # that is proportional to what is wanted, both follow from one equation.
    pull, _ = _through(now, moving, index.point)
    sign = 1.0 if moving == index.bodies[0] else -1.0
    rate = coefficient * radius * jnp.tanh((spins[0] - spins[1]) * radius / speed)
    couple = _couple(top, moving, q)
    normal = magnitude(pull)
    for _ in range(4):
        normal = magnitude(pull + sign * rate * normal * couple[at])
    moment = -rate * normal
    first, second = (
        jnp.zeros_like(q) if body == GROUND else side * moment * _couple(top, body, q)
        for body, side in zip(index.bodies, (1.0, -1.0), strict=True)
    )
    return first, second


def _hinge(now: _Instant, index: FrictionIndex, numbers: Array) -> tuple[Array, Array]:
    """Put a couple on both bodies of a pin or ball in space, against the relative rotation."""
    top = now.dyn.topology
    coefficient, speed, radius = numbers
    assert index.bodies is not None
    turns = [_turning(top, body, now.q, now.v) for body in index.bodies]
    rate = turns[0][0] - turns[1][0]
    size = magnitude(rate)
    against = -coefficient * radius * jnp.tanh(size * radius / speed) * rate / jnp.where(size > 0, size, 1.0)
    moving = next(body for body in index.bodies if body != GROUND)
    k = index.bodies.index(moving)
    # As for a pin in the plane: what the couple itself puts on the body where the joint holds it is taken out again.
    pull, at = _through(now, moving, index.point)
    own = jnp.sum(spread(top, turns[k][1](against if k == 0 else -against))[0][at], axis=0)
    normal = magnitude(pull)
    for _ in range(4):
        normal = magnitude(pull - normal * own)
    return normal * turns[0][1](against), -normal * turns[1][1](against)


def _turning(top: Topology, body: int, q: Array, v: Array) -> tuple[Array, Callable[[Array], Array]]:
    """Return the angular velocity of a body in space, and the generalised force of a couple on it by virtual power."""
    if body == GROUND:
        return jnp.zeros(3), lambda couple: jnp.zeros_like(q)
    segments = top.bodies[body].segments
    rate, back = jax.vjp(lambda x: spins(top, segments, q, (x,)), v)
    return rate, lambda couple: back(couple)[0]


def _sleeve(now: _Instant, index: FrictionIndex, numbers: Array) -> tuple[Array, Array]:
    """Rub along the line of a prismatic, cylindrical or slot joint in space, by what its rows press across it."""
    top = now.dyn.topology
    assert index.joint is not None
    points, vectors = spread(top, now.q)
    start, far, *on = index.line
    u = vectors[~far] if far < 0 else points[far] - points[start]
    u = u / magnitude(u)
    rates, _ = spread(top, now.v)
    force, _ = spread(top, row_forces(now.dyn.eq, top.rows_of(index.joint), now.q, now.lam))
    normal = magnitude(jnp.sum(force[np.array(on)], axis=0))
    slide = jnp.dot(rates[on[0]] - rates[start], u)
    push = -numbers[0] * normal * jnp.tanh(slide / numbers[1]) * u
    rest = jnp.zeros_like(now.q)
    return rest.at[np.arange(3) + on[0] * 3].add(push), rest.at[np.arange(3) + start * 3].add(-push)


def _guide(now: _Instant, index: FrictionIndex, numbers: Array) -> tuple[Array, Array]:
    """Rub at a point with a fixed coordinate, by what holds the coordinate."""
    dyn, top = now.dyn, now.dyn.topology
    at = np.arange(top.dim) + index.point * top.dim
    fixed = np.array([top.fixed[c] for c in at])
    whole = dyn.mass @ now.a + row_forces(dyn.eq, np.arange(len(top.rows)), now.q, now.lam)
    whole = whole - forces(dyn, now.t, now.q, now.v) - now.before
    normal = magnitude(whole[at[fixed]])
    slide = now.v[at[~fixed]]
    size = magnitude(slide)
    push = -numbers[0] * normal * jnp.tanh(size / numbers[1]) * slide / jnp.where(size > 0, size, 1.0)
    return jnp.zeros_like(now.q).at[at[~fixed]].set(push), jnp.zeros_like(now.q)


def _slider(now: _Instant, index: FrictionIndex, numbers: Array) -> tuple[Array, Array]:
    """Rub along the line of a slot or prismatic joint in the plane, by what its rows press across it."""
    top, q, v = now.dyn.topology, now.q, now.v
    joint = next(j for j in top.joints if j.owner == index.joint)
    i, j, p = joint.points[:3]
    force = -row_forces(now.dyn.eq, top.rows_of(joint.owner), q, now.lam)

    def of(x, k):
        return x[k * top.dim : (k + 1) * top.dim]

    d = of(q, j) - of(q, i)
    length = jnp.dot(d, d)
    u = d / jnp.sqrt(length)
    part = jnp.dot(of(q, p) - of(q, i), d) / length
    carried = of(v, i) + part * (of(v, j) - of(v, i))
    slide = jnp.dot(of(v, p) - carried, u)
    on = set(joint.points[2:]) - {i, j}
    normal = magnitude(jnp.sum(jnp.stack([of(force, k) for k in sorted(on)]), axis=0))
    push = -numbers[0] * normal * jnp.tanh(slide / numbers[1]) * u
    rest, at = jnp.zeros_like(q), np.arange(top.dim)
    line = rest.at[at + i * top.dim].add((part - 1.0) * push).at[at + j * top.dim].add(-part * push)
    return rest.at[at + p * top.dim].add(push), line


def _base(top: Topology, body: int) -> tuple[int, int]:
    base = top.bodies[body].base
    assert base is not None
    return base


def _spin(top: Topology, body: int, q: Array, v: Array) -> Array:
    """Return the angular velocity of a planar body; zero of the ground."""
    if body == GROUND:
        return jnp.zeros(())
    i, j = _base(top, body)
    d, w = (x[2 * j : 2 * j + 2] - x[2 * i : 2 * i + 2] for x in (q, v))
    return (d[0] * w[1] - d[1] * w[0]) / jnp.dot(d, d)


def _couple(top: Topology, body: int, q: Array) -> Array:
    """Return the generalised force of a couple of one on a planar body."""
    i, j = _base(top, body)
    d = q[2 * j : 2 * j + 2] - q[2 * i : 2 * i + 2]
    push = jnp.stack([-d[1], d[0]]) / jnp.dot(d, d)
    out = jnp.zeros_like(q)
    return out.at[2 * i : 2 * i + 2].add(-push).at[2 * j : 2 * j + 2].add(push)
