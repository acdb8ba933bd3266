"""The joint graph of a planar mechanism, and a tree in it: which joints get variables, and which close loops.

A joint that shares a point is found from the point, the others are those of the description. The tree takes the joints
that the user has named a coordinate for first, then those with the fewest freedoms: every joint left out closes one
independent loop, with as many equations as the joint takes freedoms away.
"""

from dataclasses import dataclass, field
from itertools import combinations

from jaxnc.families.bodies import Parts
from jaxnc.families.joined import Joined, apart, join, root
from jaxnc.mechanism import model as record
from jaxnc.system.identity import Owner, Thing


@dataclass
class Edge:
    """A joint between two parts."""

    how: str  # "revolute", "prismatic", "slot", "held" (a slot along an axis of the ground), "free"
    first: int  # the part that carries the line, or either of them
    second: int  # the other
    point: int  # the pin, or the point that slides
    line: tuple[int, int] = (0, 0)  # the line, two points; of a distance, the direction that it is counted in
    on: tuple[int, int] = (0, 0)  # of a prismatic joint, the direction that slides
    start: int = 0  # where the distance is counted from
    owner: Owner | None = None  # the joint, or the point that is shared
    freedoms: int = 1  # relative freedoms
    angle: str = ""  # the user's coordinate that is its angle
    distance: str = ""  # the user's coordinate that is its distance


@dataclass
class Tree:
    """Joints of a spanning tree from the ground, ``(edge, parent, child)``, and what they join."""

    steps: list[tuple[Edge, int, int]] = field(default_factory=list)
    points: Joined = field(default_factory=dict)
    vectors: Joined = field(default_factory=dict)


def edges(parts: Parts) -> list[Edge]:
    """All joints of a planar mechanism that a tree may be made of."""
    found: list[Edge] = []
    for p, holders in parts.of_point.items():
        found += [Edge("revolute", a, b, p, owner=Owner(Thing.POINT, p)) for a, b in combinations(holders, 2)]
        axes = parts.a.fixed[p]
        if axes.any() and not axes.all():
            for k in holders:
                turning = parts.parts[k].turns != "no"
                found.append(Edge("held", 0, k, p, owner=Owner(Thing.POINT, p), freedoms=1 + turning))
    for name, joint in parts.model.joints.items():
        owner = parts.a.owning(Thing.JOINT, name)
        if isinstance(joint, record.Prismatic):
            line, on = parts.a.pair(joint.line), parts.a.pair(joint.on)
            i, j = parts.holder(line), parts.holder(on)
            if i is not None and j is not None and i != j:
                found.append(Edge("prismatic", i, j, on[0], line, on, line[0], owner))
        elif isinstance(joint, record.Slot):
            line, pin = parts.a.pair(joint.line), parts.a.index[joint.point]
            i = parts.holder(line)
            for j in parts.of_point[pin] if i is not None else ():
                if j != i:
                    turning = parts.parts[j].turns != "no"
                    found.append(Edge("slot", i, j, pin, line, start=line[0], owner=owner, freedoms=1 + turning))  # pyright: ignore[reportArgumentType]
    for edge in found:
        _name(parts, edge)
    return found


def _name(parts: Parts, edge: Edge) -> None:
    """Find the user's coordinates of a joint."""
    for name, data in parts.a.measured.items():
        ends: tuple[int, ...] = data.points
        if name in parts.model.angles and edge.how in ("revolute", "slot", "held") and not edge.angle:
            start = 0 if len(ends) == 2 else parts.holder((ends[0], ends[1]))
            to = parts.holder((ends[-2], ends[-1]))
            turn = "no" not in (parts.parts[edge.first].turns, parts.parts[edge.second].turns)
            if start is not None and to is not None and turn and {start, to} == {edge.first, edge.second}:
                edge.angle = name
        if name in parts.model.distances and edge.how in ("prismatic", "slot") and not edge.distance:
            along = len(ends) == 4 and set(ends[2:]) == set(edge.line)
            if along and ends[0] in edge.line and ends[1] == edge.point:
                edge.distance, edge.start, edge.line = name, ends[0], parts.a.pair([parts.point(p) for p in ends[2:]])


def tree(parts: Parts, found: list[Edge]) -> Tree:
    """A spanning tree of the joint graph."""
    out = Tree(points=apart(parts.of_point), vectors=apart(parts.of_vector))
    group = list(range(len(parts.parts)))
    chosen: list[Edge] = []

    def named(edge: Edge) -> int:
        wanted = 1 if edge.how in ("revolute", "prismatic") else edge.freedoms
        return bool(edge.angle) + bool(edge.distance) - wanted

    order = sorted(range(len(found)), key=lambda i: (-named(found[i]), found[i].freedoms, i))
    for i in order:
        edge = found[i]
        a, b = (root(group, k) for k in (edge.first, edge.second))
        if a == b:
            continue
        group[b] = a
        chosen.append(edge)
    reached, waiting = {0}, chosen
    numbers = [k for k in range(1, len(parts.parts)) if parts.parts[k].points]
    while True:
        step = next((e for e in waiting if (e.first in reached) != (e.second in reached)), None)
        if step is None:
            loose = next((k for k in numbers if k not in reached), None)
            if loose is None:
                break
            freedoms = 3 if parts.parts[loose].turns != "no" else 2
            step = Edge("free", 0, loose, parts.parts[loose].points[0], freedoms=freedoms)
        else:
            waiting = [e for e in waiting if e is not step]
        parent, child = (step.first, step.second) if step.first in reached else (step.second, step.first)
        out.steps.append((step, parent, child))
        reached.add(child)
        if step.how == "revolute":
            join(out.points[step.point], parent, child)
    return out
