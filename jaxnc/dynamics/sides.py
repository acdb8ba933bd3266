"""Which body each row and each load acts on, from the points and vectors that bodies hold: static, no numbers.

An item is a point i, or a vector k as ~k. A row or load names items; what one body alone holds is that body's. Of what
several hold, a joint's sides say whose it is (the line of a slot belongs to the rocker, though its pivot is also the
ground's). What stays open acts on the pin itself, and passes through it to each body that shares it.
"""

from dataclasses import dataclass

import numpy as np

from jaxnc.remembered import with_owner
from jaxnc.system.identity import GROUND, Owner, Thing
from jaxnc.system.loads import FrictionIndex
from jaxnc.system.topology import JointIndex, Topology

NOBODY = -2
"""In place of a body's number: none alone."""

_SEPARATE = ("gear", "internal gear", "bevel gear", "internal bevel gear", "rack and pinion", "cable", "relation")
"""Joints that are something else than what their bodies share."""


Key = tuple[str, str]
"""What exerts a wrench: its sort (``"joint"``, ``"relation"``, ``"point"``, ``"load"``, ``"coordinate"``) and name."""


def key_of(joint: JointIndex) -> Key:
    """Under which name the wrenches of a joint, relation or constraint are kept."""
    return joint.owner.thing.noun, joint.name


@dataclass(frozen=True)
class Group:
    """What a body shares with the same neighbours: a pin, a hinge's point and axis, the fixed coordinate of a point."""

    items: tuple[int, ...]
    neighbours: tuple[int, ...]


def items(top: Topology, body: int) -> tuple[int, ...]:
    """Points and ~vectors of a body."""
    found = top.bodies[body]
    return (*found.points, *(~u for u in found.vectors))


def _fixed(top: Topology, item: int) -> tuple[bool, ...]:
    first = (item if item >= 0 else len(top.points) + ~item) * top.dim
    return top.fixed[first : first + top.dim]


@with_owner
def holders(top: Topology) -> dict[int, tuple[int, ...]]:
    """The bodies that hold each item, and the ground where it is fixed."""
    out: dict[int, list[int]] = {}
    for b in range(len(top.bodies)):
        for i in items(top, b):
            out.setdefault(i, []).append(b)
    for i in (*range(len(top.points)), *(~u for u in range(len(top.vectors)))):
        if all(_fixed(top, i)):
            out.setdefault(i, []).append(GROUND)
    return {i: tuple(found) for i, found in out.items()}


def whose(top: Topology, item: int, among: tuple[int, ...] = ()) -> int:
    """The body that an item acts for; NOBODY where that is open."""
    found = holders(top).get(item, ())
    if len(found) > 1:
        found = tuple(b for b in found if b in among)
    return found[0] if len(found) == 1 else NOBODY


def whose_segment(top: Topology, segment: tuple[int, ...], others: tuple[int, ...] = ()) -> int:
    """The body that a direction acts for; NOBODY where that is open.

    The ground before others; of several that share it the one that holds most of the others, as the axis it turns
    about; the first of those that share two points.
    """
    both = [set(holders(top).get(i, ())) for i in segment]
    common = set.intersection(*both)
    if GROUND in common:
        return GROUND
    near = {b: len({*items(top, b)} & {*others}) for b in common}
    best = [b for b in sorted(common) if near[b] == max(near.values())]
    return best[0] if len(best) == 1 or (best and len(segment) == 2) else NOBODY


@with_owner
def rides(top: Topology) -> dict[int, tuple[int, int]]:
    """Bodies of one point that keep the direction of a line of another: that line."""
    return {
        b: body.segments[0]
        for b, body in enumerate(top.bodies)
        if top.dim == 2 and len(body.points) == 1 and body.segments and not set(body.segments[0]) <= {*body.points}
    }  # pyright: ignore[reportReturnType]


@with_owner
def sides(top: Topology) -> tuple[tuple[int, ...], ...]:
    """The bodies that each joint holds together, one for each of its sides; NOBODY where that is open."""
    out = []
    for joint in top.joints:
        found = []
        for side in joint.sides:
            both = [set(holders(top).get(i, ())) for i in side]
            common = set.intersection(*both) if both else set()
            riders = [b for b, line in rides(top).items() if b in common and set(line) <= set(joint.points)]
            if GROUND in common:
                found.append(GROUND)
            elif len(riders) == 1:
                found.append(riders[0])
            else:
                found.append(common.pop() if len(common) == 1 else NOBODY)
        out.append(tuple(found))
    return tuple(out)


@with_owner
def groups(top: Topology, body: int) -> tuple[Group, ...]:
    """What a body shares, parted by neighbours; a vector belongs to the first part that has a neighbour in common."""
    held = holders(top)
    shared = {i: {*held[i]} - {body} for i in items(top, body) if len(held[i]) > 1 or any(_fixed(top, i))}
    parts: list[tuple[list[int], set[int]]] = []
    for i in (i for i in shared if i >= 0):
        joined = [part for part in parts if part[1] & shared[i]]
        one = [k for part in joined for k in part[0]] + [i], shared[i].union(*(part[1] for part in joined))
        parts = [part for part in parts if part not in joined] + [one]
    parts.sort(key=lambda part: min(top.bodies[body].points.index(i) for i in part[0]))
    for i in (i for i in shared if i < 0):
        part = next((part for part in parts if part[1] & shared[i]), None)
        if part is None:
            parts.append(([i], shared[i]))
        else:
            part[0].append(i)
    return tuple(Group(tuple(found), tuple(sorted(near))) for found, near in parts)


@with_owner
def slots(top: Topology) -> tuple[np.ndarray, ...]:
    """Per block, the body that each point and vector of each instance acts for, ``(instances, points + vectors)``."""
    makers = _makers(top)
    out = []
    for b, block in enumerate(top.blocks):
        found = np.full((block.count, block.kind.points + block.kind.vectors), NOBODY)
        for i in range(block.count):
            among = sides(top)[makers[b, i]] if (b, i) in makers else ()
            at = (*block.points[i], *(~u for u in block.vectors[i]))
            found[i] = [whose(top, item, among) for item in at]
            if block.kind.measure is not None:
                for k in range(0, block.kind.points - 1, 2):
                    one = whose_segment(top, at[k : k + 2], at)
                    if one != NOBODY:
                        found[i, k : k + 2] = one
                for k in range(block.kind.points, len(at)):
                    found[i, k] = whose_segment(top, at[k : k + 1], at)
        out.append(found)
    return tuple(out)


@with_owner
def _makers(top: Topology) -> dict[tuple[int, int], int]:
    """Which joint wrote each instance, the rows of the coordinates that it makes included."""
    number = {joint.owner: j for j, joint in enumerate(top.joints)}
    out = {
        (b, i): number[owners[0]]
        for b, block in enumerate(top.blocks)
        for i, owners in enumerate(block.owners)
        if owners[0] in number
    }
    first = len(top.coordinates) - len(top.scalars)
    for (b, i), j in list(out.items()):
        if top.joints[j].type in ("rolling", "screw"):
            out |= {top.measures[c - first]: j for c in top.blocks[b].scalars[i]}
    return out


def instances(top: Topology, joint: int) -> list[tuple[int, int]]:
    """Blocks and instances of a joint's own rows, without those of the coordinates that it makes."""
    return [at for at, j in _makers(top).items() if j == joint and top.blocks[at[0]].kind.measure is None]


def rows(top: Topology, joint: int) -> np.ndarray:
    """Rows that a joint writes, with those of the coordinates that it makes."""
    found = [top.layout[b].rows[i] for (b, i), j in _makers(top).items() if j == joint]
    return np.concatenate(found) if found else np.zeros(0, int)


def body_rows(top: Topology, body: int) -> np.ndarray:
    """Rows that keep a body rigid."""
    me = Owner(Thing.BODY, body)
    return np.flatnonzero([owners[0] == me for owners in top.row_owners])


@with_owner
def contacts(top: Topology) -> dict[int, tuple[int, int, int]]:
    """Points of contact of rolling discs that no body holds: the disc's centre, the disc, the body it rolls on."""
    out = {}
    for joint, (first, *rest) in zip(top.joints, (s or (NOBODY,) for s in sides(top)), strict=True):
        if joint.type == "rolling" and not holders(top).get(joint.sides[2][0]):
            out[joint.sides[2][0]] = joint.sides[1][0], rest[0], first
    return out


def between(top: Topology, first: int, second: int) -> list[int]:
    """Joints that hold two bodies together, apart from meshes, cables and relations."""
    pair = {first, second}
    return [j for j, joint in enumerate(top.joints) if joint.type not in _SEPARATE and pair == set(sides(top)[j][:2])]


def rubbing(top: Topology, index: FrictionIndex) -> tuple[int, int]:
    """The two bodies that a friction acts between."""
    if index.bodies is not None:
        return index.bodies
    if index.point >= 0:
        return whose(top, index.point), GROUND
    found = next(sides(top)[j] for j, joint in enumerate(top.joints) if joint.owner == index.joint)
    return found[1], found[0]
