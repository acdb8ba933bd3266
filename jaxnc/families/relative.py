"""Relative coordinates: the variables of joints along a tree, and equations that close loops (source text §2.1).

In space all frames are those of the ground in the drawing, so a joint turns about, and slides along, an axis as it is
drawn. Variables that are not the user's own coordinates are zero in the drawing. A ball joint has orientation
parameters of the relative rotation, with the rows that normalise them; a bar that ends in nothing has its direction,
with its norm. A loop is closed by a joint that is left out, or through a body: then every joint has its variables, the
body is hung on both joints, and six equations say that this is one place.
"""

from dataclasses import dataclass, replace

from jaxnc.constraints import SCREW
from jaxnc.errors import InputError
from jaxnc.families.bodies import (
    Joined,
    Line,
    Origin,
    PlanarEdge,
    SpatialEdge,
    join,
    planar_edges,
    root,
    spanning_tree,
    spatial_edges,
)
from jaxnc.families.planner import Planner, drawn_angle
from jaxnc.families.program import SAME_TURN, Arm, Frame, Linear, Place, Scribe, Turn, fixed, scale
from jaxnc.families.shapes import Between, Reading, Recipe
from jaxnc.mechanism import model as record
from jaxnc.system.assemble import Instance


@dataclass
class HungInPlane:
    """The place of a part in the tree of a planar mechanism: the joint that it hangs on."""

    edge: PlanarEdge  # the joint
    parent: int  # the part before it
    axis: tuple[int, int]  # the two points whose direction is the part's angle
    origin: tuple[int, ...]  # points whose mean is the origin of its frame
    angle: str = ""  # name of the joint's angle
    distance: str = ""  # name of its distance
    # The direction of the parent that the angle is counted from; none: the x axis, or the parent's axis.
    start: tuple[int, int] | None = None
    backwards: bool = False  # whether the user counts the angle from this part to the parent


class Relative(Planner):
    """Variables and rows of relative coordinates in the plane."""

    family = "relative"
    hung: dict[int, HungInPlane]

    # -- places -------------------------------------------------------------------------------------------------

    def axis(self, k: int) -> tuple[int, int]:
        """The two points whose direction is a part's angle."""
        return self.hung[k].axis

    def sliding(self, k: int) -> bool:
        """Say whether a part's frame is turned to the line that it slides along."""
        hung = self.hung[k]
        return hung.edge.how == "prismatic" and k == hung.edge.second

    def angle(self, scribe: Scribe, ends: tuple[int, int], k: int | None = None) -> Linear | None:
        """The angle of a segment from the x axis."""
        k = self.parts.holder(ends) if k is None else k
        if k and self.sliding(k):
            edge = self.hung[k].edge
            (kept,) = scribe.c("between", scribe.at((*edge.line, *edge.on)))
            turn = self.frame(scribe, k).turn
            assert turn is not None
            return self.segment_angle(scribe, self.parts.parts[k], ends, edge.on, turn.of[0] + kept)
        return super().angle(scribe, ends, k)

    def origin_of(self, k: int) -> Origin:
        """The origin of a part's frame."""
        return Origin(self.hung[k].origin)

    def place(self, scribe: Scribe, k: int, point: int) -> Place:
        """A point of a part."""
        if k == 0 or not self.sliding(k) or self.hung[k].origin == (point,):
            return super().place(scribe, k, point)
        frame, edge = self.frame(scribe, k), self.hung[k].edge
        shape = scribe.at((point, *self.hung[k].origin, *edge.on), self.parts.parts[k])
        at = scribe.c("sliding", (*shape, *scribe.at((*edge.line, *edge.on))))
        return (*frame.origin, Arm(frame.turn, tuple(at)))

    def _frame(self, scribe: Scribe, k: int) -> Frame:
        hung = self.hung[k]
        edge = hung.edge
        if edge.how == "free":
            return self.free_frame(scribe, k)
        if edge.how == "held":
            still = ((1.0, "xy"[self._free(edge.point) ^ 1], scribe.p(edge.point)),)
            both = (scribe.s(hung.distance), still)
            at: Place = (Arm(None, both if self._free(edge.point) == 0 else both[::-1]),)
            return Frame(at, self._turn_by_joint(scribe, hung))
        if edge.how == "revolute":
            return Frame(self.place(scribe, hung.parent, edge.point), self._turn_by_joint(scribe, hung))
        s = scribe.s(hung.distance)
        if k == edge.second:  # along the parent's line
            line = self._turn(self.angle(scribe, edge.line, hung.parent))
            at = (*self.place(scribe, hung.parent, edge.start), Arm(line, (s, ())))
            return Frame(at, line if edge.how == "prismatic" else self._turn_by_joint(scribe, hung))
        if edge.how == "prismatic":
            (kept,) = scribe.c("between", scribe.at((*edge.line, *edge.on)))
            on = self.angle(scribe, edge.on, hung.parent)
            assert on is not None
            turn = self._turn(on + scale(kept, -1.0))
        else:
            turn = self._turn_by_joint(scribe, hung)
        return Frame((*self.place(scribe, hung.parent, edge.point), Arm(turn, (scale(s, -1.0), ()))), turn)

    def _turn_by_joint(self, scribe: Scribe, hung: HungInPlane) -> Turn | None:
        """The rotation of a part by its joint's angle."""
        if not hung.angle:
            return None
        phi, start = scribe.s(hung.angle), hung.start
        if start is not None:
            before = self.angle(scribe, start, hung.parent)
        else:
            turn = self.frame(scribe, hung.parent).turn
            before = () if turn is None else turn.of[0]
        assert before is not None
        return self._turn(before + scale(phi, -1.0 if hung.backwards else 1.0))

    @staticmethod
    def _turn(angle: Linear | None) -> Turn:
        assert angle is not None
        return Turn("angle", (angle,))

    def _free(self, point: int) -> int:
        """The axis along which a point that is held in part may move."""
        return int(self.a.fixed[point][0])

    # -- variables and rows -------------------------------------------------------------------------------------

    def place_parts(self, points: Joined, vectors: Joined) -> None:
        """Hang every part, along a spanning tree of the joints."""

        def lacking(edge: PlanarEdge) -> int:
            """The number of variables of a joint that the user has not named."""
            return edge.freedoms - bool(edge.angle) - bool(edge.distance)

        def free(k: int) -> PlanarEdge:
            part = self.parts.parts[k]
            return PlanarEdge(how="free", first=0, second=k, point=part.points[0], owner=part.owner)

        self.hung = {}
        found = sorted(planar_edges(self.parts), key=lambda e: (lacking(e), e.freedoms))
        for edge, parent, child in spanning_tree(len(self.parts.parts), found, free):
            self.hang(edge, parent, child)
            if edge.how == "revolute":
                join(points[edge.point], parent, child)
            elif edge.how == "held":
                self.held.add(edge.point)
            elif edge.how in ("prismatic", "slot"):
                self.used.add(edge.owner)

    def hang(self, edge: PlanarEdge, parent: int, child: int) -> None:
        """Hang a part on the one before it, and note the joint's variables."""
        part = self.parts.parts[child]
        if edge.how == "free":
            self.hung[child] = HungInPlane(edge, parent, part.axis, part.points)
            self.free(child, f"{part.name} from the ground", part.name)
            return
        on_line = edge.how in ("prismatic", "slot") and child == edge.first
        if edge.how == "prismatic" or on_line:
            axis = edge.line if on_line else edge.on
        else:
            axis = part.axis
            if edge.point in axis:
                axis = (edge.point, axis[1] if edge.point == axis[0] else axis[0])
        hung = HungInPlane(edge, parent, axis, (edge.start,) if on_line else (edge.point,))
        self.hung[child] = hung
        where = f"{self.parts.parts[edge.first].name} and {self.parts.parts[edge.second].name}"
        if edge.how in ("prismatic", "slot", "held"):
            self.distance(hung, where)
        if edge.how != "prismatic" and part.turns != "no":
            self.turning(hung, child, f"between {where} at {self.parts.point(edge.point)}")

    def distance(self, hung: HungInPlane, where: str) -> None:
        """Note the variable of a sliding joint."""
        edge = hung.edge
        if edge.how == "held":
            axis = self._free(edge.point)
            hung.distance = f"{self.parts.point(edge.point)}.{'xy'[axis]}"
            reading = Reading(Recipe("mean", (0,)), axis)
            self.add_variable(hung.distance, f"{'xy'[axis]} of {self.parts.point(edge.point)}", reading, (edge.point,))
            return
        called = self.a.text(edge.owner)
        hung.distance = edge.distance or f"s_{called}"
        points = (edge.start, edge.point, *edge.line)
        self.add_variable(
            hung.distance,
            f"distance in {self.a.text(edge.owner)} between {where}",
            Reading(Recipe("along", (0, 1, 2, 3))),
            points,
        )

    def turning(self, hung: HungInPlane, child: int, where: str) -> None:
        """Note the variable of a turning joint: the user's angle, or that from the parent's axis to the part's."""
        edge, points = hung.edge, hung.axis
        if edge.angle:
            hung.angle = edge.angle
            ends = self.a.measured[edge.angle].points
            to, start = (ends[-2], ends[-1]), (ends[0], ends[1]) if len(ends) == 4 else None
            hung.backwards = self.parts.holder(to) == hung.parent
            mine, hung.start = (start, to) if hung.backwards else (to, start)
            on_line = child == edge.first and edge.how == "slot"
            if mine is not None and not (on_line and set(mine) != set(edge.line)):
                hung.axis = mine
            points = ends
        else:
            hung.angle = f"theta_{self.a.text(edge.owner)}"
            if hung.angle in self.variables:
                hung.angle += f"_{self.parts.parts[child].name}"
            if hung.parent and self.sliding(hung.parent):
                hung.start = self.hung[hung.parent].edge.on
                points = (*hung.start, *hung.axis)
            elif hung.parent:
                points = (*self.axis(hung.parent), *hung.axis)
        reading = Reading(Recipe("between" if len(points) == 4 else "direction", tuple(range(len(points)))))
        self.angles[hung.angle] = self.drawn.get(hung.angle, drawn_angle(self.a.home, points))
        self.add_variable(hung.angle, f"angle {where}", reading, points, angle=True)


@dataclass
class HungInSpace:
    """The place of a part in the tree of a spatial mechanism: the joint that it hangs on."""

    edge: SpatialEdge  # the joint
    parent: int  # the part before it
    angles: tuple[str, ...] = ()  # names of the joint's angles
    distance: str = ""  # name of its distance
    turn: tuple[str, ...] = ()  # names of its orientation parameters, or of a bar's direction

    @property
    def sides(self) -> tuple[int, int]:
        """The side of the joint that is the parent's, and the part's."""
        return (0, 1) if self.parent == self.edge.first else (1, 0)


class SpatialRelative(Planner):
    """Variables and rows of relative coordinates in space."""

    family = "relative"
    closed = "joint"  # how a loop is closed: by a "joint" that is left out, or through a "body"
    hung: dict[int, HungInSpace]

    # -- places -------------------------------------------------------------------------------------------------

    def origin_of(self, k: int) -> Origin:
        """The origin of a part's frame: its point of the joint that it hangs on, or the middle of its points."""
        hung = self.hung[k]
        return self.parts.parts[k].origin if hung.edge.how == "free" else Origin((hung.edge.at[hung.sides[1]],))

    def along_axis(self, scribe: Scribe, k: int, line: Line) -> tuple[Linear, ...]:
        """Components of a joint's axis, a direction of a part, as drawn."""
        part = self.parts.parts[k]
        return tuple(scribe.c("unit", scribe.at(line[0], part), tuple(scribe.v(v) for v in line[1])))

    def _frame(self, scribe: Scribe, k: int) -> Frame:
        hung = self.hung[k]
        edge, part = hung.edge, self.parts.parts[k]
        mine, other = hung.sides
        if edge.how == "free":
            return self.free_frame(scribe, k)
        before = self.frame(scribe, hung.parent).turn
        origin = self.place(scribe, hung.parent, edge.at[mine])
        if part.turns == "bar":
            return Frame(origin, None)
        if edge.how == "spherical":
            return Frame(origin, Turn(self.orientation, tuple(map(scribe.s, hung.turn)), (), before))
        axis = self.along_axis(scribe, hung.parent, edge.axes[mine])
        if edge.how == "universal":
            second = self.along_axis(scribe, k, edge.axes[other])
            first, last = (scribe.s(name) for name in hung.angles)
            return Frame(origin, Turn("about", (last,), second, Turn("about", (first,), axis, before)))
        turn = before
        if hung.distance:
            s = self.displacement(scribe, hung)
            # From the parent's point of the joint to the part's, as drawn, and then along the axis.
            offset = Arm(before, tuple(scribe.c("from", scribe.at((edge.at[other], edge.at[mine])))))
            origin = (*origin, offset, Arm(Turn("times", (s,), (), before), axis))
        if hung.angles:
            turn = Turn("about", (self.rotation(scribe, hung),), axis, before)
        return Frame(origin, turn)

    def rotation(self, scribe: Scribe, hung: HungInSpace) -> Linear:
        """The rotation from the drawing about the joint's axis on the parent."""
        name = hung.angles[0]
        phi, angle = scribe.s(name), self.a.model.angles.get(name)
        if angle is None and name not in self.a.scalars:
            return phi
        about, start, to = self.angle_ends(hung, name)
        sign = self.side(about, hung)
        if start is None:
            # Counted from the drawing, by a direction of one of the two about an axis of the ground.
            return scale(phi, sign if hung.parent == 0 else -sign)
        child = hung.edge.second if hung.parent == hung.edge.first else hung.edge.first
        if not self.parts.parts[child].holds(*to) or self.parts.parts[hung.parent].holds(*to):
            sign = -sign
        lines = (about, start, to)
        points = tuple(i for line in lines for i in scribe.at(line[0]))
        vectors = tuple(scribe.v(v) for line in lines for v in line[1])
        (before,) = scribe.c("about", points, vectors, ("".join("v" if line[1] else "p" for line in lines),))
        return scale(phi + scale(before, -1.0), sign)

    def angle_ends(self, hung: HungInSpace, name: str) -> tuple[Line, Line | None, Line]:
        """Axis, start and end of a user's angle, or of a screw's."""
        if name in self.a.model.angles:
            about, start, to = self.parts.ends(self.a.model.angles[name])
            assert about is not None
            return about, start, to
        joint = self.parts.joint(hung.edge.owner)
        assert isinstance(joint, record.Screw)
        first, second = map(self.parts.line, joint.directions)
        return hung.edge.axes[0], first, second

    def side(self, line: Line, hung: HungInSpace) -> float:
        """1 for a direction that is drawn along the joint's axis on the parent, -1 for one against it."""
        return 1.0 if self.parts.unit_along(line) @ self.parts.unit_along(hung.edge.axes[hung.sides[0]]) > 0 else -1.0

    def displacement(self, scribe: Scribe, hung: HungInSpace) -> Linear:
        """The way that the part has slid along the joint's axis on the parent, from the drawing."""
        name = hung.distance
        s = scribe.s(name)
        if name not in self.a.scalars:
            return s
        distance = self.a.model.distances.get(name)
        if distance is None:
            start, to, along = *hung.edge.at, hung.edge.axes[0]
        else:
            start, to = self.a.pair((distance.start, distance.to))
            along = self.parts.along(distance)
        sign = self.side(along, hung)
        child = hung.edge.second if hung.parent == hung.edge.first else hung.edge.first
        if to not in self.parts.parts[child].points:
            sign = -sign
        points = scribe.at((start, to, *along[0]))
        (before,) = scribe.c("along", points, tuple(scribe.v(v) for v in along[1]))
        return scale(s + scale(before, -1.0), sign)

    # -- variables and rows -------------------------------------------------------------------------------------

    def place_parts(self, points: Joined, vectors: Joined) -> None:
        """Hang every part, along a spanning tree of the joints; with `closed` "body" on the joints left out as well."""
        parts, self.hung = self.parts.parts, {}

        def free(k: int) -> SpatialEdge:
            at = (parts[k].points or (0,))[0]
            return SpatialEdge(how="free", first=0, second=k, at=(at, at), owner=parts[k].owner)

        known = (e for e in spatial_edges(self.parts) if e.in_tree)
        found = sorted(known, key=lambda e: (not (e.angle or e.distance), e.freedoms))
        usable = [
            e for e in found if e.how == "spherical" or "bar" not in (parts[e.first].turns, parts[e.second].turns)
        ]
        chosen = []
        for edge, parent, child in spanning_tree(len(parts), usable, free):
            if parts[parent].turns == "bar" and edge.how != "free":
                raise InputError(
                    f"relative coordinates: body {parts[child].name!r} hangs on the bar {parts[parent].name!r}, which "
                    f"does not know its rotation about its line; give the bar a point or vector across it"
                )
            self.hang(edge, parent, child)
            chosen.append(edge)
            for joined, items in zip((points, vectors), edge.shared, strict=True):
                for item in items:
                    join(joined[item], parent, child)
            if edge.drops:
                self.used.add(edge.owner)
        if self.closed == "body":
            self.close([e for e in found if not any(e is c for c in chosen)], points, vectors)

    def met(self, data: Instance) -> bool:
        """Say whether the variables of a joint meet a row: all rows of a joint in the tree but a screw's advance."""
        return super().met(data) and data.kind not in SCREW.values()

    def close(self, rest: list[SpatialEdge], points: Joined, vectors: Joined) -> None:
        """Hang a part on each joint that the tree left out as well, and write that it is in one place."""
        for edge in rest:
            ends = (edge.first, edge.second)
            parent, child = ends if edge.second and self.parts.parts[edge.second].turns == "fully" else ends[::-1]
            shared = [(points[p], p) for p in edge.shared[0]] + [(vectors[v], v) for v in edge.shared[1]]
            met = shared and not edge.drops and all(root(g, parent) == root(g, child) for g, _ in shared)
            if met or edge.owner in self.used or any(self.parts.parts[k].turns != "fully" for k in ends):
                continue
            twin, other = len(self.parts.parts), 1 if parent == edge.first else 0
            self.parts.parts.append(replace(self.parts.parts[child]))
            self.hang(replace(edge, **{"first" if other == 0 else "second": twin}), parent, twin)
            for group, _ in shared:
                join(group, parent, child)
            if edge.drops:
                self.used.add(edge.owner)
            self.coincide(child, twin, edge.at[other])
            scribe = Scribe()
            arms = tuple(
                Arm(self.frame(scribe, k).turn, tuple(fixed(float(i == axis)) for i in range(3)))
                for k in (child, twin)
                for axis in range(3)
            )
            self.write(SAME_TURN, (edge.owner,), scribe, directions=arms)

    def hang(self, edge: SpatialEdge, parent: int, child: int) -> None:
        """Hang a part on the one before it, and note the joint's variables."""
        part = self.parts.parts[child]
        hung = self.hung[child] = HungInSpace(edge, parent)
        where = f"between {self.parts.parts[edge.first].name} and {self.parts.parts[edge.second].name}"
        called = self.a.text(edge.owner)
        if edge.how == "free":
            self.free(child, f"{part.name} from the ground", part.name)
            return
        if part.turns == "bar":
            self.direct(child)
            return
        if edge.how == "spherical":
            hung.turn = self.parameters(f"{called}.{part.name}")
            if hung.turn[0] in self.variables:
                hung.turn = self.parameters(f"{called}.{self.parts.parts[parent].name}.{part.name}")
            meaning = f"{self.orientation.capitalize()} {where} at {called}"
            self.orient(hung.turn, *self.between(hung, child, self.orientation, 0), meaning, edge.owner)
            return
        if edge.how in ("revolute", "cylindrical", "universal"):
            names = [edge.angle or f"theta_{called}"]
            if edge.how == "universal":
                names = [f"theta_{called}", f"phi_{called}"]
            if not edge.angle and names[0] in self.variables:
                names = [f"{n}_{part.name}" for n in names]
            hung.angles = tuple(names)
            for i, name in enumerate(names):
                how = "universal" if edge.how == "universal" else "about"
                self.variable(hung, child, name, how, i, f"angle {where} at {called}", True)
                self.angles[name] = self.drawn.get(name, 0.0)
        if edge.how in ("prismatic", "cylindrical"):
            hung.distance = edge.distance or f"s_{called}"
            self.variable(hung, child, hung.distance, "slide", 0, f"distance {where} at {called}", False)

    def variable(self, hung: HungInSpace, child: int, name: str, how: str, i: int, meaning: str, angle: bool) -> None:
        """Note a variable of a joint."""
        if name in self.a.scalars:
            self.own(name, meaning)
            return
        reading, scribe = self.between(hung, child, how, i)
        points = tuple(p for p, _ in scribe.points)
        self.add_variable(name, meaning, reading, points, tuple(scribe.vectors), angle)

    def between(self, hung: HungInSpace, child: int, how: str, i: int) -> tuple[Between, Scribe]:
        """The reading of a variable of a joint, and what it takes."""
        scribe, sides, edge = Scribe(), hung.sides, hung.edge
        parent, this = (self.segments(scribe, k) for k in (hung.parent, child))
        lines = [edge.axes[side] for side in sides if any(edge.axes[side])]
        axes = tuple(scribe.at(p) if p else (~scribe.v(v[0]),) for p, v in lines)
        return Between(how, i, parent, this, axes, tuple(scribe.p(edge.at[side]) for side in sides)), scribe
