"""The coordinates of a mechanism as joint values of its tree, and the relations between them."""

from typing import TYPE_CHECKING

import numpy as np

from jaxnc.io.robots.tree import Reading, Tie, Vec
from jaxnc.mechanism import model as record
from jaxnc.solvers.assembly import derive, evaluate
from jaxnc.system.identity import Thing

if TYPE_CHECKING:
    from jaxnc.io.robots.grown import Grown
    from jaxnc.io.robots.joints import Edge

_ALONG = 1e-9  # sine of an angle below which directions are parallel


def add_readings(grown: "Grown", found: "list[Edge]") -> None:
    """Say what every angle and distance is in the tree, and tie those that are in linear relations."""
    tree, top = grown.tree, grown.system.topology
    for name in top.scalars:
        home = float(grown.home.q[top.position[name]])
        reading = _reading(grown, found, name, home)
        if reading is not None:
            tree.readings[name] = reading
    for name in top.coordinates[: len(top.coordinates) - len(top.scalars)]:
        point, _, axis = name.rpartition(".")
        if point in grown.parts.a.index and not top.fixed[top.position[name]]:
            terms = _shift(grown, 0, [grown.parts.a.index[point]], np.eye(3)["xyz".index(axis)])
            if terms:
                tree.readings[name] = Reading(terms, float(grown.home.q[top.position[name]]))
    _tie(grown)
    for name, joint in grown.mechanism.model.joints.items():
        if isinstance(joint, record.Cable):
            tree.cables[grown.unused(name, _closing(grown))] = list(joint.points)
        elif isinstance(joint, record.Rolling):
            _roll(grown, name)


def _roll(grown: "Grown", name: str) -> None:
    """A rolling disc and its contact slide alike."""

    def slide(start: str) -> str | None:
        owned = [j for j in grown.tree.joints if j == start or j.startswith(f"{start} ")]
        return next((j for j in owned if grown.tree.joints[j][1].kind == "slide"), None)

    contact = slide(f"{name} contact")
    disc = next((j for j in (slide(f"{name} slide"), slide(f"{name} piece")) if j), None)
    if contact and disc:
        grown.tree.ties.append(Tie(grown.unused(f"{name} contact", _closing(grown)), {contact: 1.0, disc: -1.0}))


def _reading(grown: "Grown", found: "list[Edge]", name: str, home: float) -> Reading | None:
    parts, model = grown.parts, grown.mechanism.model
    terms: dict[str, float] | None = None
    if name in model.angles:
        if parts.dim == 2:
            ends = parts.a.measured[name].points
            start = [0] if len(ends) == 2 else _holders(parts, ends[:2])
            terms = _turning(grown, start, _holders(parts, ends[-2:]), np.eye(3)[2])
        else:
            lines = parts.ends(model.angles[name])
            assert lines is not None
            about, start, to = lines
            begin = [0] if start is None else _holders(parts, *start)
            axis = grown.home.vectors[about[1][0]] if about[1] else grown.home.span(about[0])
            terms = _turning(grown, begin, _holders(parts, *to), axis / np.linalg.norm(axis))
    elif name in model.distances:
        distance = model.distances[name]
        if distance.along is None:
            return Reading({}, home, (distance.start, distance.to))
        p, q = parts.a.pair((distance.start, distance.to))
        flat = parts.dim == 2
        line = (parts.a.measured[name].points[-2:], ()) if flat else parts.along(distance)
        axis = grown.home.vectors[line[1][0]] if line[1] else grown.home.span(line[0])
        for i in parts.of_point[p]:
            terms = terms or _shift(grown, i, [q], axis / np.linalg.norm(axis))
    else:
        terms = _made(grown, found, name)
    return Reading(terms, home) if terms else None


def _made(grown: "Grown", found: "list[Edge]", name: str) -> dict[str, float] | None:
    """An angle or distance that a rolling joint or a screw makes."""
    for joint_name, joint in grown.mechanism.model.joints.items():
        if not isinstance(joint, record.Rolling | record.Screw) or name not in (joint.angle, joint.distance):
            continue
        edge = next((e for e in found if e.name == joint_name), None)
        if edge is None:
            return None
        if name == joint.angle:
            return _turning(grown, [edge.first], [edge.second], edge.axes[-1])
        point = edge.at[0] if isinstance(joint, record.Rolling) else edge.at[1]
        return _shift(grown, edge.first, [point], edge.axes[0])
    return None


def _holders(parts, points, vectors=()) -> list[int]:
    """Parts that hold a direction."""
    return [k for k, part in enumerate(parts.parts)
            if set(points) <= set(part.points) and set(vectors) <= set(part.vectors)]  # fmt: skip


def _turning(grown: "Grown", starts: list[int], ends: list[int], axis: Vec) -> dict[str, float] | None:
    """The angle about an axis between two parts as a sum of hinges, if all between them are parallel to it."""
    for i in starts:
        for j in ends:
            if i == j or i not in grown.link_of or j not in grown.link_of:
                continue
            terms: dict[str, float] | None = {}
            for sign, link in _between(grown, i, j):
                for joint in link.joints:
                    along = float(joint.axis @ axis)
                    if joint.kind == "slide":
                        continue
                    if joint.kind != "hinge" or np.linalg.norm(np.cross(joint.axis, axis)) > _ALONG:
                        terms = None
                        break
                    terms[joint.name] = sign * (1.0 if along > 0 else -1.0)
                if terms is None:
                    break
            if terms:
                return terms
    return None


def _shift(grown: "Grown", i: int, points: list[int], axis: Vec) -> dict[str, float] | None:
    """How far a point moves along an axis of a part, as a sum of slides; None where anything turns it."""
    for p in points:
        for j in grown.parts.of_point[p]:
            if j == i or i not in grown.link_of or j not in grown.link_of:
                continue
            terms, good = {}, True
            way = _between(grown, i, j)
            for n, (sign, link) in enumerate(way):
                turned = False
                for joint in link.joints:
                    if joint.kind == "slide":
                        factor = float(joint.axis @ axis)
                        good = good and not turned
                        if abs(factor) > _ALONG:
                            terms[joint.name] = sign * factor
                    else:
                        turned = True
                at_pin = np.allclose(link.origin, grown.home.points[p], atol=1e-12 * grown.size)
                # A turn about the point itself does not move it; seen from a link below the axis would turn.
                good = good and not (turned and not (sign > 0 and n == len(way) - 1 and at_pin))
            if good and terms:
                return terms
    return None


def _between(grown: "Grown", i: int, j: int):
    """Links on the way from one part to another, with the sign of their joints."""
    one, other = grown.tree.way(grown.link_of[i]), grown.tree.way(grown.link_of[j])
    while one and other and one[0] == other[0]:
        one, other = one[1:], other[1:]
    links = grown.tree.links
    return [(-1.0, links[k]) for k in one[::-1]] + [(1.0, links[k]) for k in other]


def _tie(grown: "Grown") -> None:
    """Rows that only coordinates with a reading stand in (gears, racks, screws, relations), as ties of joints."""
    top, tree = grown.system.topology, grown.tree
    _, jacobian = evaluate(derive(grown.system), grown.home.q)
    rows = np.asarray(jacobian)
    if not rows.size:
        return
    first = len(top.coordinates) - len(top.scalars)
    things = (Thing.JOINT, Thing.RELATION)
    for k, owners in enumerate(top.row_owners):
        (owner, *_) = owners
        if owner.thing not in things:
            continue
        columns = [int(c) for c in np.flatnonzero(rows[k]) if not top.fixed[c]]
        name = top.called(owner)
        if owner.thing is Thing.JOINT and (not columns or min(columns) < first):
            continue
        names = [top.coordinates[c] for c in columns]
        lacking = [n for n in names if n not in tree.readings or tree.readings[n].ends]
        if lacking:
            tree.left_out.append(
                f"{owner.thing.noun} {name!r}: it ties {', '.join(names)}, and {lacking[0]} is not a joint of the tree"
            )
            continue
        terms: dict[str, float] = {}
        for c, n in zip(columns, names, strict=True):
            for joint, factor in tree.readings[n].terms.items():
                terms[joint] = terms.get(joint, 0.0) + float(rows[k, c]) * factor
        terms = {j: f for j, f in terms.items() if abs(f) > 1e-12 * max(map(abs, terms.values()))}
        if terms:
            tree.ties.append(Tie(grown.unused(name, _closing(grown)), terms))


def _closing(grown: "Grown") -> list[str]:
    """Names that constraints have already."""
    return [x.name for x in (*grown.tree.loops, *grown.tree.ties)]
