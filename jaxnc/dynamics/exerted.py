"""What springs, dampers, actuators and loads do, each by its name: one number as its maker gives it, and its power."""

from collections import Counter
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.constraints.elementary import ratio
from jaxnc.constraints.kind import dot, norm
from jaxnc.dynamics.model import variables
from jaxnc.dynamics.moments import cross
from jaxnc.dynamics.wrenches import Parts
from jaxnc.errors import InputError, nearest
from jaxnc.forces import COUPLE, EFFORT
from jaxnc.system.frames import spread
from jaxnc.system.identity import Thing, find
from jaxnc.system.topology import Topology
from jaxnc.types import Array


@public
class Load(NamedTuple):
    """What a spring, damper, stop, actuator, force or friction does.

    Attributes:
        value: of what acts between two points the tension, N ``(...,)``, positive where it draws them together; on an
            angle, distance or single coordinate the effort, N m or N ``(...,)``, positive where it drives it up; of a
            force on a point its components, N ``(..., dim)``; of a couple on a body the couple, N m ``(...,)``; of
            everything else the generalised forces on all coordinates ``(..., N)``.
        power: what it gives to the mechanism, W ``(...,)``: negative where it stores or dissipates.
    """

    value: Array
    power: Array


def load_of(top: Topology, found: Parts, v: Array, name: str, seen: np.ndarray) -> Load:
    """One load of poses ``(P, …)`` by name.

    The user's system has the coordinates that are `seen`.
    """
    owner = find(top.names, name, (Thing.FORCE, Thing.FRICTION))
    if owner is None:
        known = [*top.names[Thing.FORCE], *top.names[Thing.FRICTION]]
        hint = nearest(name, known) if known else "it has no springs, dampers, forces or frictions"
        raise InputError(f"{top.name!r} has no load {name!r}; {hint}")
    plain = top.names[owner.thing][owner.number]
    if owner.thing is Thing.FRICTION:
        at = [index.name for index in top.loads.friction].index(plain)
        force = sum(found.friction[at], v * 0.0)
        return Load(force[:, seen], (force * v).sum(-1))
    for b, block in enumerate(top.loads.forces):
        if plain in block.names:
            return _of_kind(top, found, v, b, block.names.index(plain), seen)
    at = [f.name for f in top.loads.functions].index(plain)
    function, force = top.loads.functions[at], found.functions[at]
    power = (force * v).sum(-1)
    if function.acts == "effort":
        return Load(force[:, function.at], power)
    if function.acts == "force":
        return Load(force[:, function.at * top.dim : (function.at + 1) * top.dim], power)
    return Load(force[:, seen], power)


def _of_kind(top: Topology, found: Parts, v: Array, b: int, i: int, seen: np.ndarray) -> Load:
    block = top.loads.forces[b]
    kind, at, force = block.kind, variables(top, b)[i], found.loads[b][:, i]
    power = (force * v[:, at]).sum(-1)
    takes = kind.points, kind.vectors, kind.scalars
    if takes == (0, 0, 1):
        return Load(force[:, 0], power)
    if takes == (1, 0, 0):
        return Load(force, power)
    if takes == (2, 0, 0):
        points = spread(top, found.q)[0]
        start, end = block.points[i]
        along = points[:, end] - points[:, start]
        first, second = force[:, : top.dim], force[:, top.dim :]
        if kind == COUPLE:
            return Load(cross(along, second), power)
        return Load(0.5 * jax.vmap(lambda f, d: ratio(dot(f, d), norm(d)))(first - second, along), power)
    return Load(jnp.zeros_like(v).at[:, at].add(force)[:, seen], power)


def loads_on(top: Topology, coordinate: str) -> list[str]:
    """Names of the actuators, then of the springs, dampers and stops, that act on a coordinate."""
    at = top.position.get(coordinate)
    found = [
        (block.kind != EFFORT, name)
        for block in top.loads.forces
        for name, scalars in zip(block.names, block.scalars, strict=True)
        if at in scalars
    ]
    found += [(False, f.name) for f in top.loads.functions if f.acts == "effort" and f.at == at]
    return [name for _, name in sorted(found, key=lambda entry: entry[0])]


def named_rows(top: Topology) -> list[str]:
    """Names of all rows that have multipliers, those on velocities last, each once."""
    names = [*top.rows, *top.rate_rows]
    often = Counter(names)
    return [f"{name} (row {k + 1})" if often[name] > 1 else name for k, name in enumerate(names)]
