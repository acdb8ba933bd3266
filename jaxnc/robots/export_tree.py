"""A mechanism as a tree of links: its joints, what closes loops, what links weigh; joint values of poses."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from jaxnc.dynamics.extended import extended, lift
from jaxnc.dynamics.model import body_inertia
from jaxnc.families.bodies import (
    Joined,
    Line,
    Part,
    Parts,
    apart,
    closures,
    join,
    planar_edges,
    root,
    spanning_tree,
    spatial_edges,
)
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.mechanism.checks import PARALLEL
from jaxnc.robots.import_tree import (
    Description,
    ElementaryJoint,
    Inertia,
    Link,
    LoopClosure,
    Tie,
    Vec,
    cross_matrix,
    free_name,
    join_inertias,
    perpendicular,
    rotate_about,
)
from jaxnc.solvers.assembly import derive, rank_of, to_host
from jaxnc.system.frames import marker_along, quaternions
from jaxnc.system.identity import Thing
from jaxnc.system.system import System

# -- poses ------------------------------------------------------------------------------------------------------------


class TreePose:
    """A pose of a mechanism in space: places of points, directions of vectors, rotations of parts from home.

    `q` are all coordinates, ``(N,)``; `home` is the home pose, None for the home pose itself.
    """

    def __init__(self, parts: Parts, q: np.ndarray, home: "TreePose | None" = None):
        self.parts, self.q = parts, np.asarray(q, dtype=float)
        dim, count, vectors = parts.dim, len(parts.a.names), len(parts.a.vector_names)
        self.points = np.zeros((count, 3))
        self.points[:, :dim] = self.q[: dim * count].reshape(count, dim)
        self.vectors = self.q[dim * count : dim * (count + vectors)].reshape(vectors, dim)
        self.home = self if home is None else home

    def span(self, segment: tuple[int, ...]) -> Vec:
        """Return the unit vector along a segment: two points, or ~vector."""
        d = self.vectors[~segment[0]] if len(segment) == 1 else self.points[segment[1]] - self.points[segment[0]]
        return d / np.linalg.norm(d)

    def along(self, line: tuple[tuple[int, ...], tuple[int, ...]]) -> Vec:
        """Return the unit vector along a line: its two points, or its vector if it has one."""
        points, vectors = line
        return self.span((~vectors[0],) if vectors else points)

    def axes(self, part: Part) -> np.ndarray:
        """Return orthonormal axes of a part as rows."""
        if self.parts.dim == 2:
            x = self.span(part.axis)
            return np.array([x, [-x[1], x[0], 0.0], [0.0, 0.0, 1.0]])
        x = self.span(part.segments[0])
        y = self.span(part.segments[1])
        y = y - (y @ x) * x
        y /= np.linalg.norm(y)
        return np.array([x, y, np.cross(x, y)])

    def turn(self, k: int) -> np.ndarray | None:
        """Return the rotation of a part from home, of a bar without spin; None for a part without orientation."""
        part = self.parts.parts[k]
        if k == 0:
            return np.eye(3)
        if part.turns == "no":
            return None
        if part.turns == "bar":
            return _least_turn(self.home.span(part.segments[0]), self.span(part.segments[0]))
        return self.axes(part).T @ self.home.axes(part)


def _least_turn(a: Vec, b: Vec) -> np.ndarray:
    """Return the smallest rotation that takes one unit vector to another."""
    c, v = float(a @ b), np.cross(a, b)
    if c < -1.0 + 1e-12:  # half a turn, about anything across
        u = perpendicular(a)
        return 2.0 * np.outer(u, u) - np.eye(3)
    x = cross_matrix(v)
    return np.eye(3) + x + x @ x / (1.0 + c)


def _angle_about(axis: Vec, start: Vec, end: Vec) -> float:
    """Return the angle about an axis from one direction to another."""
    a, b = start - (start @ axis) * axis, end - (end @ axis) * axis
    return math.atan2(float(np.cross(a, b) @ axis), float(a @ b))


def _frames(links: list[Link], pose: TreePose) -> list[tuple[np.ndarray, Vec]]:
    """Find the rotation from home and the origin of every link in a pose."""
    out = [(np.eye(3), links[0].origin)]
    for link in links[1:]:
        if link.reference >= 0:
            out.append((out[link.parent][0], pose.points[link.reference]))
            continue
        part = pose.parts.parts[link.part]
        turn = out[link.parent][0] if link.spinless else pose.turn(link.part)
        assert turn is not None
        at = part.points[0]
        out.append((turn, pose.points[at] + turn @ (link.origin - pose.home.points[at])))
    return out


def joint_values(links: list[Link], pose: TreePose, before: np.ndarray | None = None) -> np.ndarray:
    """Find the values of all joints, in their order, of a pose: numbers of hinges and slides, a quaternion of a ball.

    Hinges are counted on from the values `before`.
    """
    at, out = _frames(links, pose), []
    for link, (turn, place) in zip(links[1:], at[1:], strict=True):
        base, where = at[link.parent]
        relative = base.T @ turn
        moved = base.T @ (place - where) - (link.origin - links[link.parent].origin)
        out += _link_values(link, relative, moved)
    values = np.array(out)
    if before is not None and len(values):
        hinge = np.repeat([j.kind == "hinge" for k in links for j in k.joints],
                          [j.width for k in links for j in k.joints])  # fmt: skip
        turns = np.round((values - before) / (2.0 * math.pi))
        values = np.where(hinge, values - 2.0 * math.pi * turns, values)
    return values


def _link_values(link: Link, relative: np.ndarray, moved: Vec) -> list[float]:
    """Find the values of the joints of one link from its rotation and displacement in its parent's frame."""
    joints, out = link.joints, {i: [0.0] for i in range(len(link.joints))}
    if len(joints) == 1 and joints[0].kind == "free":
        return [*(link.origin + moved), *map(float, quaternions(relative))]
    rotations = [i for i, j in enumerate(joints) if j.kind != "slide"]
    slides = [i for i, j in enumerate(joints) if j.kind == "slide"]
    if slides:
        own = bool(rotations) and slides[0] > rotations[0]  # they come after the rotation: along axes of the link
        axes = np.array([joints[i].axis for i in slides])
        found = np.linalg.lstsq(axes.T, relative.T @ moved if own else moved, rcond=None)[0]
        for i, value in zip(slides, found, strict=True):
            out[i] = [float(value)]
    for i, value in zip(rotations, _hinge_values([joints[i] for i in rotations], relative), strict=True):
        out[i] = value
    return [x for i in range(len(joints)) for x in out[i]]


def _hinge_values(joints: list[ElementaryJoint], relative: np.ndarray) -> list[list[float]]:
    if not joints:
        return []
    if joints[0].kind == "ball":
        return [list(map(float, quaternions(relative)))]
    first = joints[0].axis
    if len(joints) == 1:
        u = perpendicular(first)
        return [[_angle_about(first, u, relative @ u)]]
    second = joints[1].axis  # R = R(first, α) R(second, β): the second axis is seen where α has put it
    a = _angle_about(first, second, relative @ second)
    u = perpendicular(second)
    return [[a], [_angle_about(second, u, rotate_about(first, a).T @ relative @ u)]]


# -- joints between parts ---------------------------------------------------------------------------------------------


Z = np.array([0.0, 0.0, 1.0])


@dataclass
class TreeEdge:
    """A joint between two parts: a point of the second slides in directions of the first and the second turns about it.

    All directions are those of the home pose.
    """

    name: str  # what it is called after: a joint, or the point that is shared
    first: int  # a part; the one that carries the line, the plane, or the ground
    second: int  # the other part
    at: tuple[int, int]  # the joint's point on each of them
    slides: Sequence[Vec] = ()  # directions in which it slides
    hinges: Sequence[Vec] | None = ()  # axes about which the second turns, one after the other; None for a ball
    points: tuple[int, ...] = ()  # points that it makes one, of those that both parts hold
    vectors: tuple[int, ...] = ()  # vectors that it makes one
    holder: int = -1  # the point whose fixed coordinates it is, or -1
    # Whether it is a joint of the description, which is written once for all parts that hold its point.
    user: bool = False
    wanted: bool = False  # whether a coordinate of the user is its own

    @property
    def freedoms(self) -> int:
        """Count the relative freedoms."""
        return len(self.slides) + (3 if self.hinges is None else len(self.hinges))

    @property
    def _alike(self) -> bool:
        """Tell whether the second slides in the same directions when it has turned."""
        if len(self.slides) in (0, 3) or self.freedoms == len(self.slides):
            return True
        along = [abs(float(s @ h)) for s in self.slides for h in self.hinges or np.eye(3)]
        return all(x >= 1.0 - PARALLEL if len(self.slides) == 1 else x <= PARALLEL for x in along)

    def sequence(self, parent: int) -> tuple[int, list[tuple[str, Vec]]]:
        """Return the child's point of the joint, and its elementary joints (kind, axis) seen from a parent."""
        forward = parent == self.first
        slides = [("slide", axis) for axis in self.slides]
        turning = [("ball", Z)] if self.hinges is None else [("hinge", axis) for axis in self.hinges]
        if self.hinges is None and len(slides) == 3:
            return self.at[1], [("free", Z)]
        if forward:
            return self.at[1], slides + turning
        # A line turns about the pin of its parent, and slides along itself.
        return (self.at[0], slides + turning[::-1]) if self._alike else (self.at[1], turning[::-1] + slides)


def find_edges(parts: Parts, home: TreePose) -> tuple[list[TreeEdge], dict[str, str]]:
    """Find all joints of a mechanism that a tree of links can be made of, and the kinds of the others by name."""
    lost: dict[str, str] = {}
    found = _planar_edges(parts, home) if parts.dim == 2 else _spatial_edges(parts, home)
    known = {e.name for e in found if e.user}
    for name, joint in parts.model.joints.items():
        if isinstance(joint, record.Rolling) and (pair := _rolling_edges(parts, home, name, joint)):
            found += pair
            known.add(name)
        told = record.Gear | record.BevelGear | record.RackAndPinion | record.Cable | record.Weld
        if name not in known and not isinstance(joint, told):
            lost[name] = "".join(f" {c.lower()}" if c.isupper() else c for c in type(joint).__name__).strip()
    return found, lost


def can_turn(parts: Parts, *ks: int) -> bool:
    """Tell whether all of some parts have an orientation."""
    return all(parts.parts[k].turns != "no" for k in ks)


def _planar_edges(parts: Parts, home: TreePose) -> list[TreeEdge]:
    found = []
    for e in planar_edges(parts):
        if e.how == "held":
            found.append(_edge_of_fixed_point(parts, e.second, e.point))
            continue
        pin = e.how == "revolute"
        at = (e.line[0], e.on[0]) if e.how == "prismatic" else (e.point, e.point)
        slides, points = ([], (e.point,)) if pin else ([home.span(e.line)], ())
        hinges = () if e.how == "prismatic" else _turning_axes(parts, e.second)
        found.append(TreeEdge(parts.a.text(e.owner), e.first, e.second, at, slides, hinges, points, user=not pin,
                          wanted=bool(e.angle or e.distance)))  # fmt: skip
    for name, joint in parts.model.joints.items():
        if isinstance(joint, record.Revolute) and joint.points:
            p, q = parts.a.pair(joint.points)
            apart = ((i, j) for i in parts.of_point[p] for j in parts.of_point[q] if i != j)
            if pair := next(apart, None):
                found.append(TreeEdge(name, *pair, (p, q), hinges=[Z], user=True))
    return found


def _turning_axes(parts: Parts, *ks: int) -> Sequence[Vec] | None:
    """Return the axes about which a part turns that hangs on a point, if all of some parts know a rotation."""
    return () if not can_turn(parts, *ks) else [Z] if parts.dim == 2 else None


def _edge_of_fixed_point(parts: Parts, k: int, p: int) -> TreeEdge:
    """Make the edge of a point that slides with fixed coordinates."""
    axes = [np.eye(3)[i] for i in range(parts.dim) if not parts.a.fixed[p][i]]
    return TreeEdge(parts.point(p), 0, k, (p, p), axes, _turning_axes(parts, k), holder=p)


def _spatial_edges(parts: Parts, home: TreePose) -> list[TreeEdge]:
    found = []
    for e in spatial_edges(parts):
        name, user = parts.a.text(e.owner), e.owner.thing is Thing.JOINT
        if e.how == "universal":
            slides, hinges, vectors = [], list(map(home.along, e.axes)), ()
        else:
            along = [] if e.how in ("revolute", "spherical") else [home.along(e.axes[0])]
            slides = _two_across(along[0]) if e.how == "planar" else along
            hinges, vectors = _hinges_of(home, e.kept), parts.both_hold(e.first, e.second)
        found.append(TreeEdge(name, e.first, e.second, e.at, slides, hinges, e.shared[0], vectors, user=user,
                          wanted=bool(e.angle or e.distance)))  # fmt: skip
    for p, holders in parts.of_point.items():
        fixed = parts.a.fixed[p]
        if fixed.any() and not fixed.all():
            found += [_edge_of_fixed_point(parts, k, p) for k in holders if k]
        loose = [k for k in holders if not can_turn(parts, k)]
        found += [TreeEdge(parts.point(p), i, j, (p, p), hinges=None, points=(p,)) for i, j in combinations(holders, 2)
                  if loose and not (i in loose and j in loose)]  # fmt: skip
    for name, joint in parts.model.joints.items():
        if isinstance(joint, record.Slot):
            pin = parts.a.index[joint.point]
            i, axis = _find_carrier(parts, home, joint.line)
            loose = (j for j in parts.of_point[pin] if j != i and not can_turn(parts, j))
            found += [TreeEdge(name, i, j, (pin, pin), [axis], user=True) for j in loose if i is not None]
    return found + _edges_of_vectors(parts, home, found)


def _edges_of_vectors(parts: Parts, home: TreePose, others: list[TreeEdge]) -> list[TreeEdge]:
    """Make the edges of parts that share vectors, where no other joint keeps them together."""
    joined = apart({v: holders for v, holders in parts.of_vector.items() if len(holders) > 1})
    for edge in others:
        for v in edge.vectors:
            join(joined[v], edge.first, edge.second)
    pairs: dict[tuple[int, int], list[int]] = {}
    for v, i, j in closures(joined):
        pairs.setdefault((i, j), []).append(v)
    found = []
    for (i, j), vectors in pairs.items():
        at = (parts.parts[i].points or parts.parts[j].points)[0], parts.parts[j].points[0]
        kept = tuple(((), (v,)) for v in vectors)
        other = next((k for k in kept[1:] if not parts.parallel(k, kept[0])), None)
        hinges = _hinges_of(home, kept[:1] if other is None else (kept[0], other))
        found.append(TreeEdge(parts.a.vector_names[vectors[0]], i, j, at, list(np.eye(3)), hinges, (), tuple(vectors)))
    return found


def _hinges_of(home: TreePose, kept: tuple[Line, ...]) -> Sequence[Vec] | None:
    """Return the axes of the turns that keep some directions: none of a ball, which keeps nothing."""
    return [home.along(kept[0])] if len(kept) == 1 else () if kept else None


def _two_across(normal: Vec) -> list[Vec]:
    one = perpendicular(normal)
    return [one, np.cross(normal, one)]


def _find_carrier(parts: Parts, home: TreePose, line: tuple[str, str]) -> tuple[int | None, Vec]:
    """Find the part that carries a line, a point and a vector or two points, and the direction of the line."""
    points, vectors = direction = parts.line(line)
    return parts.holder((parts.a.index[line[0]], *points), vectors), home.along(direction)


def _rolling_edges(parts: Parts, home: TreePose, name: str, joint: record.Rolling) -> list[TreeEdge]:
    """Make the edges of a disc that rolls on a line: its centre slides along it and it turns; its contact slides."""
    i, along = _find_carrier(parts, home, joint.line)
    j = parts.holder((parts.a.index[joint.centre], parts.a.index[joint.rim]))
    if i is None or j is None or i == j:
        return []
    axis = Z if joint.axis is None else home.along(parts.line(joint.axis))
    centre, contact = parts.a.index[joint.centre], parts.a.index[joint.contact]
    out = [TreeEdge(name, i, j, (contact, centre), [along], [axis], user=True)]
    for k in parts.of_point[contact]:
        if not can_turn(parts, k):
            out.append(TreeEdge(f"{name} contact", i, k, (contact, contact), [along], user=True))
    return out


# -- coordinates ------------------------------------------------------------------------------------------------------


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
        starts, ends = ([0] if x is None else [k for k, part in enumerate(parts.parts) if part.holds(*x)]
                        for x in (start, to))  # fmt: skip
        return _sum_of_hinges(tree, starts, ends, axis)
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
            return _sum_of_hinges(tree, [edge.first], [edge.second], (edge.hinges or [Z])[-1])
        return _sum_of_slides(tree, edge.first, edge.at[0 if isinstance(joint, record.Rolling) else 1], edge.slides[0])
    return None


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
    rows = tree.jacobian
    first = len(top.coordinates) - len(top.scalars)
    for k, (owner, *_) in enumerate(top.row_owners):
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


# -- freedoms ---------------------------------------------------------------------------------------------------------


def note_lost(tree: "ExportTree") -> None:
    """Name what the links do not keep of the mechanism: what hinders a motion that they have from the home pose."""
    top, parts, dim = tree.system.topology, tree.parts, tree.parts.dim
    twists, null = _motions(tree)
    lost: list[tuple[Thing, str]] = []
    rates, known = np.zeros((len(null), len(top.coordinates))), np.zeros(len(top.coordinates), bool)

    def moving(k: int, what: int, vector: bool) -> np.ndarray:
        x, twist = (tree.home.vectors if vector else tree.home.points)[what], twists[tree.link_of[k]]
        return np.cross(twist[:, :3], x) + (0.0 if vector else twist[:, 3:])

    for vector, holding in ((False, parts.of_point), (True, parts.of_vector)):
        small = 1e-6 * (1.0 if vector else tree.size)
        for item, holders in holding.items():
            ways = [moving(k, item, vector)[:, :dim] for k in holders if k in tree.link_of]
            if not ways:  # a vector of no body
                continue
            at = dim * (item + vector * len(top.points)) + np.arange(dim)
            rates[:, at], known[at] = ways[0], True
            noun, name = (Thing.VECTOR, top.vectors[item]) if vector else (Thing.POINT, top.points[item])
            apart = any(np.abs(way - ways[0]).max(initial=0.0) > small for way in ways)
            if apart or np.abs(rates[:, at[np.array(top.fixed)[at]]]).max(initial=0.0) > small:
                lost.append((noun, name))
    rows, free = tree.jacobian @ rates.T, tree.jacobian[:, ~known]
    rows = rows - free @ np.linalg.lstsq(free, rows, rcond=None)[0]
    scale = np.abs(tree.jacobian).sum(axis=1) * np.abs(rates).max(initial=0.0)
    for k in np.flatnonzero(np.abs(rows).max(axis=1, initial=0.0) > 1e-6 * scale):
        (owner, *_) = top.row_owners[k]
        lost.append((owner.thing, top.called(owner)))
    left = tree.description.left_out
    for thing, name in dict.fromkeys(lost):
        if not any(repr(name) in said for said in left):
            left.append(f"{thing.noun} {name!r}: the file's joints do not keep it wholly, and move against it")


def _motions(tree: "ExportTree") -> tuple[np.ndarray, np.ndarray]:
    """Return the twists of all links ``(links, motions, 6)`` in the motions that loops leave, and these motions."""
    column, ways, found = {}, [[]], []
    for link in tree.links[1:]:
        start = len(found)
        for joint in link.joints:
            column[joint.name] = len(found)
            for axis in np.eye(3) if joint.kind in ("ball", "free") else [joint.axis]:
                found += [[*axis, *np.cross(link.origin, axis)]] * (joint.kind != "slide")
                found += [[0.0, 0.0, 0.0, *axis]] * (joint.kind in ("slide", "free"))
        ways.append([*ways[link.parent], *range(start, len(found))])
    screws, d = np.reshape(found, (-1, 6)), tree.description

    def place(k: int, x: Vec) -> np.ndarray:
        out = np.zeros((3, len(screws)))
        out[:, ways[k]] = (screws[ways[k], 3:] + np.cross(screws[ways[k], :3], x)).T
        return out

    rows = [np.zeros((0, len(screws)))]
    for loop in d.loops:
        corners = [np.zeros(3), *(tree.size * np.eye(3) if loop.kind == "weld" else ())]
        rows += [place(loop.first, at + x) - place(loop.second, at + x) for at in loop.at[:1] for x in corners]
    for tie in d.ties:
        rows.append(np.zeros((1, len(screws))))
        rows[-1][0, [column[joint] for joint in tie.terms]] = list(tie.terms.values())
    site = {name: (k, at) for k, link in enumerate(tree.links) for name, at in link.sites.items()}
    for points in tree.cables.values():
        rows.append(np.zeros((1, len(screws))))
        for (i, p), (j, q) in pairwise(site[name] for name in points):
            rows[-1][0] += (q - p) / np.linalg.norm(q - p) @ (place(j, q) - place(i, p))
    null = rank_of(np.concatenate(rows))[1]
    twists = np.zeros((len(tree.links), len(null), 6))
    for k, link in enumerate(tree.links[1:], start=1):
        own = ways[k][len(ways[link.parent]) :]
        twists[k] = twists[link.parent] + null[:, own] @ screws[own]
    return twists, null


# -- the tree ---------------------------------------------------------------------------------------------------------


class ExportTree:
    """The tree of a mechanism in one design.

    Attributes:
        description: links, loops and ties; what of the mechanism is left out, and what was chosen.
        coordinates: the mechanism's coordinates in joints.
        cables: sites along each cable, by its name.
        link_of: number of the link of each part.
    """

    def __init__(self, mechanism: Mechanism, system: System, q: np.ndarray):
        self.mechanism, self.system = mechanism, system
        self.parts = Parts(mechanism)
        self.home = TreePose(self.parts, q)
        self.jacobian = to_host(derive(system)).jacobian(self.home.q[:, None])[0]
        self.size = float(np.linalg.norm(np.ptp(self.home.points, axis=0))) or 1.0
        self.links = [Link("ground", -1, np.zeros(3), part=0)]
        self.description = Description(mechanism.name, self.links)
        self.coordinates: dict[str, JointSum] = {}
        self.cables: dict[str, list[str]] = {}
        self.link_of = {0: 0}
        self._points: Joined = apart(self.parts.of_point)
        self._vectors: Joined = apart(self.parts.of_vector)
        self._held: set[int] = set()  # points whose fixed coordinates are kept
        self._done: set[str] = set()  # joints of the user that are written
        self.edges, lost = find_edges(self.parts, self.home)
        for edge in self._hang():
            self._close(edge)
        self.description.left_out += [f"joint {n!r} ({what}): its freedoms are not kept" for n, what in lost.items()]
        self._sort_in_depth()
        self._add_sites()
        add_coordinates(self)
        self._add_masses()
        self._leave_out_rest()
        note_lost(self)

    def joint_values(self, q: np.ndarray) -> np.ndarray:
        """Return values of all joints ``(..., nq)`` of poses ``(..., N)``, hinges counted on through whole turns."""
        out, before = [], None
        for x in q.reshape(-1, q.shape[-1]):
            before = joint_values(self.links, TreePose(self.parts, x, self.home), before)
            out.append(before)
        return np.reshape(out, (*q.shape[:-1], sum(j.width for j in self.joints.values())))

    @property
    def joints(self) -> dict[str, ElementaryJoint]:
        """All joints by name, in their order."""
        return self.description.joints

    def path(self, i: int, j: int) -> list[tuple[float, Link]]:
        """List the links on the way from one part to another, with the sign of their joints."""
        one, other = (self._way(self.link_of[k]) for k in (i, j))
        while one and other and one[0] == other[0]:
            one, other = one[1:], other[1:]
        return [(-1.0, self.links[k]) for k in one[::-1]] + [(1.0, self.links[k]) for k in other]

    def _way(self, k: int) -> list[int]:
        """List the links from the ground to a link, the ground left out."""
        out = []
        while k > 0:
            out.append(k)
            k = self.links[k].parent
        return out[::-1]

    # -- the tree -----------------------------------------------------------------------------------------------

    def _hang(self) -> list[TreeEdge]:
        """Hang every part on another, or free on the ground; the joints that are left close loops.

        A joint is called after the user's, or after its point and the part that hangs on it.
        """
        parts = self.parts
        edges = sorted(self.edges, key=lambda e: (not e.wanted, e.freedoms))
        count = 1 + sum(bool(part.points) for part in parts.parts[1:])  # after these come vectors of no body

        def free(k: int) -> TreeEdge:
            at = parts.parts[k].points[0]
            return TreeEdge(
                parts.parts[k].name, 0, k, (at, at), list(np.eye(3)[: parts.dim]), _turning_axes(parts, k), user=True
            )

        waiting = {id(edge): edge for edge in edges}
        for edge, parent, child in spanning_tree(count, edges, free):
            name = edge.name if edge.user else f"{edge.name} {parts.parts[child].name}"
            self._add(child, self.link_of[parent], *edge.sequence(parent), name)
            if waiting.pop(id(edge), None):  # or it hangs free
                self._note_shared(edge)
        return list(waiting.values())

    def _add(self, k: int, parent: int, at: int, sequence: list[tuple[str, Vec]], name: str) -> None:
        part = self.parts.parts[k]
        link = Link(_new_name(part.name, self.links), parent, self.home.points[at].copy(), part=k)
        link.reference = at if part.turns == "no" else -1
        link.spinless = part.turns == "bar" and all(kind in ("hinge", "slide") for kind, _ in sequence)
        self.link_of[k] = len(self.links)
        self.links.append(link)
        self._add_joints(link, sequence, name)

    def _add_joints(self, link: Link, sequence: list[tuple[str, Vec]], name: str) -> None:
        kinds = [kind for kind, _ in sequence]
        for i, (kind, axis) in enumerate(sequence):
            more = f" {kind}" if len(sequence) > 1 else ""
            more += f" {i + 1}" if kinds.count(kind) > 1 else ""
            link.joints.append(ElementaryJoint(_new_name(name + more, list(self.joints.values())), kind, axis))

    def _note_shared(self, edge: TreeEdge) -> None:
        for items, shared in ((self._points, edge.points), (self._vectors, edge.vectors)):
            for i in shared:
                join(items[i], edge.first, edge.second)
        if edge.holder >= 0:
            self._held.add(edge.holder)
        elif edge.user:
            self._done.add(edge.name)

    # -- loops --------------------------------------------------------------------------------------------------

    def _close(self, edge: TreeEdge) -> None:
        """Close a loop by a joint that is not in the tree, if nothing else does so already."""
        if (edge.user and edge.name in self._done) or edge.holder in self._held:
            return
        i, j = self.link_of[edge.first], self.link_of[edge.second]
        at = self.home.points[edge.at[1]]
        hinges = edge.hinges
        if not edge.slides and (hinges is None or len(hinges) == 1):
            self._pin(edge, i, j, at)
            self._note_shared(edge)
            return
        one = hinges is not None and len(hinges) == 1
        moves = [("slide", axis) for axis in edge.slides] + [("hinge", axis) for axis in (not one and hinges) or ()]
        k = self._piece(edge, moves) if moves else i
        whole = hinges is not None and not one and can_turn(self.parts, edge.first, edge.second)
        self._loop(edge.name, "weld" if whole else "connect", k, j, at)
        if hinges and one and self.parts.dim == 3:
            self._loop_axis(edge, k, j, at, hinges[0])
        self._note_shared(edge)

    def _pin(self, edge: TreeEdge, i: int, j: int, at: Vec) -> None:
        """Write a pin or ball: what is joined already is not written again."""
        met = [p for p in edge.points if root(self._points[p], edge.first) == root(self._points[p], edge.second)]
        if not met:
            self._loop(edge.name, "connect", i, j, at)
        if edge.hinges and self.parts.dim == 3 and len(met) < 2:
            self._loop_axis(edge, i, j, at, edge.hinges[0])

    def _loop_axis(self, edge: TreeEdge, i: int, j: int, at: Vec, axis: Vec) -> None:
        """Keep another place of an axis together, unless a vector along it is shared."""
        groups = (self._vectors[v] for v in edge.vectors)
        if not any(root(group, edge.first) == root(group, edge.second) for group in groups):
            self._loop(f"{edge.name} axis", "connect", i, j, at + 0.25 * self.size * axis)

    def _loop(self, name: str, kind: str, i: int, j: int, at: Vec) -> None:
        loops = self.description.loops
        loops.append(LoopClosure(_new_name(name, loops), kind, i, j, (at, at)))

    def _piece(self, edge: TreeEdge, sequence: list[tuple[str, Vec]]) -> int:
        """Add a link without mass that has moved by some of a joint's freedoms."""
        name, point = _new_name(f"{edge.name} piece", self.links), edge.at[1]
        place = self.home.points[point].copy()
        link = Link(name, self.link_of[edge.first], place, part=edge.second, auxiliary=True)
        if all(kind == "slide" for kind, _ in sequence):
            link.reference = point
        self.links.append(link)
        self._add_joints(link, sequence, name)
        return len(self.links) - 1

    def name_closure(self, name: str) -> str:
        """Return a name that no loop and no tie has."""
        return _new_name(name, [*self.description.loops, *self.description.ties])

    def _sort_in_depth(self) -> None:
        """Put the links in the order of a file: each followed by what hangs on it."""
        links, order = list(self.links), [0]
        waiting = [k for k in range(len(links) - 1, 0, -1) if links[k].parent == 0]
        while waiting:
            k = waiting.pop()
            order.append(k)
            waiting += [c for c in range(len(links) - 1, 0, -1) if links[c].parent == k]
        new = {old: i for i, old in enumerate(order)} | {-1: -1}
        for link in links:
            link.parent = new[link.parent]
        self.links[:] = [links[k] for k in order]
        self.link_of = {part: new[k] for part, k in self.link_of.items()}
        for loop in self.description.loops:
            loop.first, loop.second = new[loop.first], new[loop.second]

    # -- what links carry ---------------------------------------------------------------------------------------

    def _add_sites(self) -> None:
        """Add places of points and markers, and lines to be shown."""
        a, taken = self.parts.a, set()
        for k, part in enumerate(self.parts.parts):
            if not part.points:
                continue
            link = self.links[self.link_of[k]]
            for p in part.points:
                name = a.names[p] if a.names[p] not in taken else f"{a.names[p]} on {part.name}"
                taken.add(a.names[p])
                link.sites[name] = self.home.points[p]
            if k:
                link.lines = [(self.home.points[p], self.home.points[q]) for p, q in pairwise(part.points)]
                if len(part.points) > 2:
                    link.lines.append((self.home.points[part.points[-1]], self.home.points[part.points[0]]))
        top, eq = self.system.topology, derive(self.system)
        numbers = {marker.name: number for number, marker in enumerate(top.markers)}
        for name, marker in self.mechanism.model.markers.items():
            if marker.direction is not None:
                self.description.left_out.append(f"marker {name!r}: a direction, and sites are places")
                continue
            if self._of_one_point(marker.on):
                self.description.left_out.append(f"marker {name!r}: body {marker.on!r} of one point is no link")
                continue
            at = np.zeros(3)
            at[: top.dim] = np.asarray(marker_along(eq, numbers[name], self.home.q, ()))
            self.links[self.link_of[self._part_of(marker.on)]].sites[name] = at

    def _of_one_point(self, body: str) -> bool:
        """Tell whether a planar body is a point, and no part of its own."""
        specs = self.parts.a.specs
        return self.parts.dim == 2 and body in specs and len(specs[body].points) == 1

    def _part_of(self, body: str) -> int:
        """Return the part of a body; the ground if there is none."""
        return next((k for k, part in enumerate(self.parts.parts) if body in part.bodies), 0)

    def _add_masses(self) -> None:
        """Give the links the masses of the mechanism; those without get little, or none if no body has any."""
        inner, notes = extended(self.system), self.description.notes
        for k, number in self.link_of.items():
            pieces = [self._body_inertia(inner, body) for body in self.parts.parts[k].bodies]
            pieces += self._point_masses(k)
            self.links[number].inertia = join_inertias([p for p in pieces if p is not None and p.mass > 0])
        moving = [link for link in self.links[1:] if not link.auxiliary]
        known = [link.inertia for link in moving if link.inertia is not None]
        if not known:
            if moving:
                what = f"links have that of their capsules, {self.density:.4g} kg a cubic unit of length"
                notes.append(f"no body has a mass: {what}")
            return
        # 1e-6 of the mean mass get links that have none, where others do
        light = 1e-6 * float(np.mean([i.mass for i in known]))
        for link in self.links[1:]:
            if link.inertia is None:
                link.inertia = Inertia(light, link.origin, light * (0.1 * self.size) ** 2 * np.eye(3))
                notes.append(f"link {link.name!r} has no mass: it is given {light:.3g}, since no link may be without")
            else:
                self._fill(link.name, link.inertia)

    @property
    def density(self) -> float:
        """Of capsules where no body has a mass: so much that MuJoCo takes their inertias, whatever their unit."""
        return max(1000.0, 2e-3 / self.size**5)

    def _body_inertia(self, inner: System, body: str) -> Inertia | None:
        """Return mass, centre of mass and inertia of a body in the home pose, by its own mass matrix."""
        dim, top = self.parts.dim, inner.topology
        if not top.loads.inertias:
            return None
        at, local, first, m = map(np.asarray, body_inertia(inner, body))
        if not float(m):
            return None
        q = np.asarray(lift(self.system.topology, self.home.q))[at]
        com = np.zeros(3)
        com[:dim] = first @ q / float(m)
        # A turn about the centre of mass moves the nodes, and their mass matrix knows the energy of that.
        turns = np.zeros((len(at), 3))
        for n in range(0, len(at), dim):
            arm = np.zeros(3)
            arm[:dim] = q[n : n + dim]
            if at[n] < dim * len(top.points):
                arm = arm - com
            turns[n : n + dim] = -cross_matrix(arm)[:dim]
        tensor = turns.T @ local @ turns
        if dim == 2:  # what is flat turns about z only: what it has about the other axes is never felt
            tensor = np.diag([0.6, 0.6, 1.0]) * tensor[2, 2]
        return Inertia(float(m), com, tensor)

    def _point_masses(self, k: int) -> list[Inertia]:
        """List the point masses that a part carries, and bodies of one point; of several holders the first does."""
        physical, out = np.asarray(self.system.parameters.physical), []
        for group in self.system.topology.loads.inertias:
            for index in group:
                holders = [h for h in self.parts.of_point[index.origin] if h]
                if (not index.body or self._of_one_point(index.body)) and holders and holders[0] == k:
                    mass = float(physical[index.mass])
                    out.append(Inertia(mass, self.home.points[index.origin], np.zeros((3, 3))))
                    if index.segments and not all(self.parts.a.fixed[list(index.segments[0])].ravel()):
                        what = "its mass is put on its point, as if it did not turn with its line"
                        self.description.notes.append(f"body {index.body!r}: {what}")
        return out

    def _fill(self, name: str, inertia: Inertia) -> None:
        """Make an inertia one that a simulator takes: positive about every axis."""
        values, axes = np.linalg.eigh(inertia.tensor)
        largest, rest = values[-1], values[0] + values[1]
        rounding = 1e-10
        if 0.0 < largest < rest * (1.0 + rounding) and rest < largest * (1.0 + rounding):
            values[:2] *= 1.0 + 2.0 * rounding  # what is flat: rounding must not make one moment larger than the others
            inertia.tensor = (axes * values) @ axes.T
        if largest <= 0.0:
            inertia.tensor = inertia.mass * (1e-3 * self.size) ** 2 * np.eye(3)
            what = "is a point mass: it is given the inertia of a small ball, since no link may be without"
            self.description.notes.append(f"link {name!r} {what}")
        elif values[0] < 1e-9 * largest:  # the link has no inertia about an axis
            share = 1e-2  # of the largest moment
            inertia.tensor = (axes * np.maximum(values, share * largest)) @ axes.T
            what = f"has no inertia about its own line: it is given {share:g} of that across it"
            self.description.notes.append(f"link {name!r} {what}")

    def _leave_out_rest(self) -> None:
        """Write welds between links, and name what a tree has nothing for."""
        model, d = self.mechanism.model, self.description
        d.left_out += [f"constraint {name!r} of kind {c.kind!r}" for name, c in model.constraints.items()]
        d.left_out += [f"friction {name!r}: Coulomb friction in proportion to a reaction" for name in model.friction]
        loose = [part.name for part in self.parts.parts[1:] if not part.points]
        d.left_out += [f"vector {name!r}: it belongs to no body" for name in loose]
        for name, joint in model.joints.items():
            if isinstance(joint, record.Weld):
                one, other = (self._part_of(body) for body in joint.bodies)
                if one != other:
                    i, j = self.link_of[one], self.link_of[other]
                    self._loop(name, "weld", i, j, self.links[j].origin)
        if model.units.length != "m":
            d.notes.append(f"lengths are in {model.units.length} as in the mechanism, and numbers are not converted")


def _new_name(name: str, things: Iterable[Link | ElementaryJoint | LoopClosure | Tie]) -> str:
    """Return a name that none of some things has, and that is not "world"."""
    return free_name(name, {"world", *(thing.name for thing in things)})
