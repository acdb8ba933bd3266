"""The coordinates of a mechanism as joint values of its tree, and the relations between them."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jaxnc.families.bodies import Line
from jaxnc.mechanism import model as record
from jaxnc.mechanism.checks import PARALLEL
from jaxnc.robots.description import Tie, Vec
from jaxnc.solvers.assembly import derive, evaluate
from jaxnc.system.identity import Thing

if TYPE_CHECKING:
    from jaxnc.robots.export_tree import ExportTree


@dataclass
class JointSum:
    """A coordinate of the mechanism as a sum of joint values, or as the distance of two sites."""

    terms: dict[str, float]  # factors by joint; the coordinate is their sum and `home`
    home: float  # value in the home pose
    ends: tuple[str, str] | None = None  # names of the two sites, of a distance

    @property
    def joint(self) -> tuple[str, float] | None:
        """The one joint that the coordinate is, with its factor; None if it is a distance or a sum of more."""
        return next(iter(self.terms.items())) if self.ends is None and len(self.terms) == 1 else None

    def __str__(self) -> str:
        if self.ends:
            return f"the distance of the sites {self.ends[0]!r} and {self.ends[1]!r}"
        terms = (f"{'-' if f < 0 else '+'} {'' if abs(f) == 1 else f'{abs(f):g} '}{j!r}" for j, f in self.terms.items())
        return f"{self.home:.6g} {' '.join(terms)}"


def add_coordinates(tree: "ExportTree") -> None:
    """Say what every angle and distance is in the tree, and tie joints that are in linear relations."""
    top, index = tree.system.topology, tree.parts.a.index
    for name in top.scalars:
        home = float(tree.home.q[top.position[name]])
        distance = tree.mechanism.model.distances.get(name)
        if distance is not None and distance.along is None:
            tree.coordinates[name] = JointSum({}, home, (distance.start, distance.to))
        elif terms := _sum_of_joints(tree, name):
            tree.coordinates[name] = JointSum(terms, home)
    for name in top.coordinates[: len(top.coordinates) - len(top.scalars)]:
        point, _, axis = name.rpartition(".")
        if point not in index or top.fixed[top.position[name]]:
            continue
        if terms := _sum_of_slides(tree, 0, index[point], np.eye(3)["xyz".index(axis)]):
            tree.coordinates[name] = JointSum(terms, float(tree.home.q[top.position[name]]))
    _add_ties(tree)
    for name, joint in tree.mechanism.model.joints.items():
        if isinstance(joint, record.Cable):
            tree.cables[tree.name_closure(name)] = list(joint.points)
        elif isinstance(joint, record.Rolling):
            _tie_contact(tree, name)


def _tie_contact(tree: "ExportTree", name: str) -> None:
    """Let a rolling disc and its contact slide alike."""

    def slide(start: str) -> str | None:
        slides = (n for n, joint in tree.joints.items() if joint.kind == "slide")
        return next((n for n in slides if n == start or n.startswith(f"{start} ")), None)

    contact = slide(f"{name} contact")
    disc = slide(f"{name} slide") or slide(f"{name} piece")
    if contact and disc:
        tree.description.ties.append(Tie(tree.name_closure(f"{name} contact"), {contact: 1.0, disc: -1.0}))


def _sum_of_joints(tree: "ExportTree", name: str) -> dict[str, float] | None:
    """Write an angle, or a distance along a line, as a sum of joints; None if it is none."""
    parts, model = tree.parts, tree.mechanism.model
    if name in model.angles:
        about, start, to = parts.ends(model.angles[name])
        axis = np.eye(3)[2] if about is None else tree.home.along(about)
        return _sum_of_hinges(tree, [0] if start is None else _holders(tree, start), _holders(tree, to), axis)
    if name in model.distances:
        distance = model.distances[name]
        p, q = parts.a.pair((distance.start, distance.to))
        axis = tree.home.along(parts.along(distance))
        return next(filter(None, (_sum_of_slides(tree, i, q, axis) for i in parts.of_point[p])), None)
    for joint_name, joint in model.joints.items():  # an angle or distance that a rolling joint or a screw makes
        if not isinstance(joint, record.Rolling | record.Screw) or name not in (joint.angle, joint.distance):
            continue
        edge = next((e for e in tree.edges if e.name == joint_name), None)
        if edge is None:
            return None
        if name == joint.angle:
            return _sum_of_hinges(tree, [edge.first], [edge.second], edge.axes[-1])
        return _sum_of_slides(tree, edge.first, edge.at[0 if isinstance(joint, record.Rolling) else 1], edge.axes[0])
    return None


def _holders(tree: "ExportTree", line: Line) -> list[int]:
    """Find the parts that hold a line."""
    points, vectors = line
    return [k for k, part in enumerate(tree.parts.parts)
            if set(points) <= set(part.points) and set(vectors) <= set(part.vectors)]  # fmt: skip


def _sum_of_hinges(tree: "ExportTree", starts: list[int], ends: list[int], axis: Vec) -> dict[str, float] | None:
    """Write the angle about an axis between two parts as a sum of hinges, if all between them are parallel to it."""
    for i in starts:
        for j in ends:
            if i == j or i not in tree.link_of or j not in tree.link_of:
                continue
            joints = [(sign, joint) for sign, link in tree.path(i, j) for joint in link.joints if joint.kind != "slide"]
            if all(x.kind == "hinge" and np.linalg.norm(np.cross(x.axis, axis)) <= PARALLEL for _, x in joints):
                terms = {x.name: sign * (1.0 if float(x.axis @ axis) > 0 else -1.0) for sign, x in joints}
                if terms:
                    return terms
    return None


def _sum_of_slides(tree: "ExportTree", i: int, point: int, axis: Vec) -> dict[str, float] | None:
    """Write how far a point moves along an axis of a part as a sum of slides; None where anything turns it."""
    for j in tree.parts.of_point[point]:
        if j == i or i not in tree.link_of or j not in tree.link_of:
            continue
        terms, good = {}, True
        way = tree.path(i, j)
        for n, (sign, link) in enumerate(way, start=1):
            turned = False
            for joint in link.joints:
                if joint.kind == "slide":
                    factor = float(joint.axis @ axis)
                    good = good and not turned
                    if abs(factor) > PARALLEL:
                        terms[joint.name] = sign * factor
                else:
                    turned = True
            at_pin = np.allclose(link.origin, tree.home.points[point], atol=1e-12 * tree.size)
            # A turn about the point itself does not move it; seen from a link below the axis would turn.
            good = good and not (turned and not (sign > 0 and n == len(way) and at_pin))
        if good and terms:
            return terms
    return None


def _add_ties(tree: "ExportTree") -> None:
    """Tie joints by rows in which only coordinates made of joints stand: gears, racks, screws, relations."""
    top, d = tree.system.topology, tree.description
    _, jacobian = evaluate(derive(tree.system), tree.home.q)
    rows = np.asarray(jacobian)
    if not rows.size:
        return
    first = len(top.coordinates) - len(top.scalars)
    for k, owners in enumerate(top.row_owners):
        (owner, *_) = owners
        if owner.thing not in (Thing.JOINT, Thing.RELATION):
            continue
        columns = [int(c) for c in np.flatnonzero(rows[k]) if not top.fixed[c]]
        name = top.called(owner)
        if owner.thing is Thing.JOINT and (not columns or min(columns) < first):
            continue
        names = [top.coordinates[c] for c in columns]
        lacking = [n for n in names if n not in tree.coordinates or tree.coordinates[n].ends]
        if lacking:
            what = f"it ties {', '.join(names)}, and {lacking[0]} is not a joint of the tree"
            d.left_out.append(f"{owner.thing.noun} {name!r}: {what}")
            continue
        terms: dict[str, float] = {}
        for c, n in zip(columns, names, strict=True):
            for joint, factor in tree.coordinates[n].terms.items():
                terms[joint] = terms.get(joint, 0.0) + float(rows[k, c]) * factor
        terms = {j: f for j, f in terms.items() if abs(f) > 1e-12 * max(map(abs, terms.values()))}
        if terms:
            d.ties.append(Tie(tree.name_closure(name), terms))
