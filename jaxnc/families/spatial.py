"""Relative coordinates in space: joint variables along a tree, and equations that close its loops (source text §2.1).

All frames are those of the ground in the drawing, so a joint turns about, and slides along, an axis as it is drawn.
Variables that are not the user's own coordinates are zero in the drawing. A ball joint has orientation parameters of
the relative rotation, with the rows that normalise them; a bar that ends in nothing has its direction, with its norm.
A loop is closed by a joint that is left out, or through a body: then every joint has its variables, the body is hung on
both joints, and six equations say that this is one place.
"""

from dataclasses import dataclass, replace

from jaxnc.constraints import SCREW
from jaxnc.errors import InputError
from jaxnc.families.between import Between, Segments
from jaxnc.families.bodies import Origin, Parts
from jaxnc.families.joined import Joined, apart, join, root
from jaxnc.families.planner import Planner
from jaxnc.families.program import Arm, Frame, Linear, Oriented, Place, Reading, Turn, scaled
from jaxnc.families.rows import SAME_TURN
from jaxnc.families.scribe import Scribe, fixed
from jaxnc.families.shapes import Recipe
from jaxnc.families.spatial_graph import (
    Line,
    SpatialEdge,
    along_of,
    drawn,
    edges,
    ends_of,
    holds,
    without_rods,
)
from jaxnc.families.turns import ANGLES, HOME, NORMALISED, PARAMETERS
from jaxnc.system.assemble import Instance
from jaxnc.system.identity import Owner
from jaxnc.system.system import System


@dataclass
class Hung:
    """How a part hangs on the one before it."""

    edge: SpatialEdge  # the joint
    parent: int  # the part before it
    angles: tuple[str, ...] = ()  # names of the joint's angles
    distance: str = ""  # name of its distance
    turn: tuple[str, ...] = ()  # names of its orientation parameters, or of a bar's direction

    @property
    def sides(self) -> tuple[int, int]:
        """Which side of the joint is the parent's, and which is the part's."""
        return (0, 1) if self.parent == self.edge.first else (1, 0)


class SpatialRelative(Planner):
    """Variables and rows of relative coordinates in space."""

    family = "relative"

    def __init__(
        self,
        parts: Parts,
        natural: System,
        keep: tuple[str, ...] = (),
        orientation: str = "euler parameters",
        closed: str = "joint",
    ):
        super().__init__(without_rods(parts), natural, keep)
        self.orientation, self.closed = orientation, closed
        self.hung: dict[int, Hung] = {}

    # -- places -------------------------------------------------------------------------------------------------

    def place(self, scribe: Scribe, k: int, point: int) -> Place:
        """A point of a part."""
        if k == 0:
            return self.ground(scribe, point)
        part, frame, hung = self.parts.parts[k], self.frame(scribe, k), self.hung[k]
        if part.turns == "no":
            return frame.origin
        origin = hung.edge.at[hung.sides[1]]
        if point == origin and hung.edge.how != "free":
            return frame.origin
        rest = part.points if hung.edge.how == "free" else (origin,)
        if part.turns == "bar":
            return (*frame.origin, *self.out(scribe, k, point, Origin(rest)))
        return (*frame.origin, Arm(frame.turn, tuple(scribe.c("from", scribe.at((point, *rest), part)))))

    def along_axis(self, scribe: Scribe, k: int, line: Line) -> tuple[Linear, ...]:
        """Components of a joint's axis, a direction of a part, as drawn."""
        part = self.parts.parts[k]
        return tuple(scribe.c("unit", scribe.at(line[0], part), tuple(scribe.v(v) for v in line[1])))

    def _frame(self, scribe: Scribe, k: int) -> Frame:
        hung = self.hung[k]
        edge, part = hung.edge, self.parts.parts[k]
        mine, other = hung.sides
        if edge.how == "free":
            at = tuple(scribe.s(f"{part.name}.{x}") for x in "xyz")
            turn = Turn(self.orientation, tuple(map(scribe.s, hung.turn))) if part.turns == "fully" else None
            return Frame((Arm(None, at),), turn)
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
            origin = (*origin, *self.offset(scribe, hung), Arm(_along(before, s), axis))
        if hung.angles:
            turn = Turn("about", (self.rotation(scribe, hung),), axis, before)
        return Frame(origin, turn)

    def offset(self, scribe: Scribe, hung: Hung) -> Place:
        """From the parent's point of a sliding joint to the part's, as drawn."""
        mine, other = hung.sides
        at = scribe.at((hung.edge.at[other], hung.edge.at[mine]))
        turn = self.frame(scribe, hung.parent).turn
        return (Arm(turn, tuple(scribe.c("from", at))),)

    def rotation(self, scribe: Scribe, hung: Hung) -> Linear:
        """The rotation from the drawing about the joint's axis on the parent."""
        name = hung.angles[0]
        phi, angle = scribe.s(name), self.a.model.angles.get(name)
        if angle is None and name not in self.a.scalars:
            return phi
        about, start, to = self.ends(hung, name)
        mine = hung.sides[0]
        sign = 1.0 if drawn(self.parts, about) @ drawn(self.parts, hung.edge.axes[mine]) > 0 else -1.0
        if start is None:
            # Counted from the drawing, by a direction of one of the two about an axis of the ground.
            return scaled(phi, sign if hung.parent == 0 else -sign)
        if not self._on(hung, to):
            sign = -sign
        lines = (about, start, to)
        points = tuple(i for line in lines for i in scribe.at(line[0]))
        vectors = tuple(scribe.v(v) for line in lines for v in line[1])
        (before,) = scribe.c("about", points, vectors, tuple(int(bool(line[1])) for line in lines))
        return scaled(phi + scaled(before, -1.0), sign)

    def ends(self, hung: Hung, name: str) -> tuple[Line, Line | None, Line]:
        """Axis, start and end of a user's angle, or of a screw's."""
        if name in self.a.model.angles:
            found = ends_of(self.parts, self.a.model.angles[name])
            assert found is not None
            return found
        joint = self.parts.joint(hung.edge.owner)
        first, second = (
            ((), (self.a.vector_index[d],)) if isinstance(d, str) else (self.a.pair(d), ())
            for d in joint.directions  # pyright: ignore[reportAttributeAccessIssue, reportOptionalIterable, reportOptionalMemberAccess]
        )
        return hung.edge.axes[0], first, second

    def _on(self, hung: Hung, to: Line) -> bool:
        """Whether a direction is the part's, and not its parent's."""
        child = hung.edge.second if hung.parent == hung.edge.first else hung.edge.first
        return holds(self.parts, child, to) and not holds(self.parts, hung.parent, to)

    def displacement(self, scribe: Scribe, hung: Hung) -> Linear:
        """How far the part has slid along the joint's axis on the parent, from the drawing."""
        name, mine = hung.distance, hung.sides[0]
        s = scribe.s(name)
        if name not in self.a.scalars:
            return s
        distance = self.a.model.distances.get(name)
        if distance is None:
            start, to, along = *hung.edge.at, hung.edge.axes[0]
        else:
            start, to = self.a.pair((distance.start, distance.to))
            along = along_of(self.parts, distance)
        sign = 1.0 if drawn(self.parts, along) @ drawn(self.parts, hung.edge.axes[mine]) > 0 else -1.0
        child = hung.edge.second if hung.parent == hung.edge.first else hung.edge.first
        if to not in self.parts.parts[child].points:
            sign = -sign
        points = scribe.at((start, to, *along[0]))
        (before,) = scribe.c("along", points, tuple(scribe.v(v) for v in along[1]))
        return scaled(s + scaled(before, -1.0), sign)

    # -- variables and rows -------------------------------------------------------------------------------------

    def plan(self) -> None:
        """Write variables and rows."""
        points, vectors = apart(self.parts.of_point), apart(self.parts.of_vector)
        used = self.tree(points, vectors)
        for name in self.keep:
            self.kept(name)
        self.share(points, vectors)
        self.hold()
        for data in self.a.instances:
            if data.kind.measure is None and data.kind.rows and not self.rigid(data) and not self.met(data, used):
                self.compose(data)

    def met(self, data: Instance, used: set[Owner]) -> bool:
        """Whether the variables of a joint meet a row: all rows of a joint in the tree but a screw's advance."""
        return not used.isdisjoint(data.owners) and data.kind not in SCREW.values()

    def tree(self, points: Joined, vectors: Joined) -> set[Owner]:
        """Hang every part; the joints whose rows are met."""
        found = edges(self.parts)
        order = sorted(
            range(len(found)), key=lambda i: (not (found[i].angle or found[i].distance), found[i].freedoms, i)
        )
        group, chosen = list(range(len(self.parts.parts))), []
        for i in order:
            edge = found[i]
            bars = [k for k in (edge.first, edge.second) if self.parts.parts[k].turns == "bar"]
            if root(group, edge.first) == root(group, edge.second) or (bars and edge.how != "spherical"):
                continue
            group[root(group, edge.second)] = root(group, edge.first)
            chosen.append(edge)
        reached, used = {0}, set()
        while True:
            edge = next((e for e in chosen if (e.first in reached) != (e.second in reached)), None)
            if edge is None:
                loose = next((k for k in range(1, len(self.parts.parts)) if k not in reached), None)
                if loose is None:
                    if self.closed == "body":
                        self.close([e for e in found if not any(e is c for c in chosen)], points, vectors, used)
                    return used
                part = self.parts.parts[loose]
                at = (part.points or (0,))[0]
                edge = SpatialEdge("free", 0, loose, (at, at), (((), ()), ((), ())), part.owner)
            parent, child = (edge.first, edge.second) if edge.first in reached else (edge.second, edge.first)
            if self.parts.parts[parent].turns == "bar" and edge.how != "free":
                name = self.parts.parts[child].name
                raise InputError(
                    f"relative coordinates: body {name!r} hangs on the bar {self.parts.parts[parent].name!r}, which "
                    f"does not know its rotation about its line; give the bar a point or vector across it"
                )
            self.hang(edge, parent, child)
            reached.add(child)
            for item in edge.shared[0]:
                join(points[item], parent, child)
            for item in edge.shared[1]:
                join(vectors[item], parent, child)
            if edge.drops:
                used.add(edge.owner)

    def close(self, rest: list[SpatialEdge], points: Joined, vectors: Joined, used: set[Owner]) -> None:
        """Hang a part on each joint that the tree left out as well, and write that it is in one place."""
        for edge in rest:
            ends = (edge.first, edge.second)
            parent, child = ends if edge.second and self.parts.parts[edge.second].turns == "fully" else ends[::-1]
            shared = [(points[p], p) for p in edge.shared[0]] + [(vectors[v], v) for v in edge.shared[1]]
            met = shared and not edge.drops and all(root(g, parent) == root(g, child) for g, _ in shared)
            if met or edge.owner in used or any(self.parts.parts[k].turns != "fully" for k in ends):
                continue
            twin, other = len(self.parts.parts), 1 if parent == edge.first else 0
            self.parts.parts.append(replace(self.parts.parts[child]))
            self.hang(replace(edge, **{"first" if other == 0 else "second": twin}), parent, twin)
            for group, _ in shared:
                join(group, parent, child)
            if edge.drops:
                used.add(edge.owner)
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
        hung = self.hung[child] = Hung(edge, parent)
        where = f"between {self.parts.parts[edge.first].name} and {self.parts.parts[edge.second].name}"
        called = self.a.text(edge.owner)
        if edge.how == "free":
            self.free(hung, child)
            return
        if part.turns == "bar":
            self.direct(child)
            return
        if edge.how == "spherical":
            self.parameters(hung, child, where)
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

    def variable(
        self, hung: Hung, child: int, name: str, how: str, i: int, meaning: str, angle: bool, pure: bool = False
    ) -> None:
        """Note a variable of a joint."""
        if name in self.a.scalars:
            self.own(name, meaning)
            return
        scribe, (mine, other) = Scribe(), hung.sides
        edge = hung.edge
        parent, this = (self.segments(scribe, k) for k in (hung.parent, child))
        lines = [x for x in (edge.axes[mine], edge.axes[other]) if x[0] or x[1]]
        axes = tuple(scribe.at(p) if p else (~scribe.v(v[0]),) for p, v in lines)
        at = (scribe.p(edge.at[mine]), scribe.p(edge.at[other]))
        reading = Between(how, i, parent, this, axes, at)
        points = tuple(p for p, _ in scribe.points)
        self.add_variable(name, meaning, reading, points, tuple(scribe.vectors), angle, pure)

    def segments(self, scribe: Scribe, k: int) -> Segments:
        """The segments of a part's frame, in the numbers of an instance; none for the ground."""
        if k == 0:
            return ()
        return tuple(
            scribe.at((s[0], s[1])) if len(s) == 2 else (~scribe.v(~s[0]),) for s in self.parts.parts[k].segments
        )

    def parameters(self, hung: Hung, child: int, where: str) -> None:
        """Note the orientation parameters of a ball joint."""
        part, how = self.parts.parts[child], self.orientation
        called = self.a.text(hung.edge.owner)
        before = f"{called}.{part.name}"
        if f"{before}.{PARAMETERS[how][0]}" in self.variables:
            before = f"{called}.{self.parts.parts[hung.parent].name}.{part.name}"
        hung.turn = tuple(f"{before}.{e}" for e in PARAMETERS[how])
        for i, name in enumerate(hung.turn):
            meaning = f"{how[0].upper()}{how[1:]} {where} at {called}"
            self.variable(hung, child, name, how, i, meaning, how in ANGLES, True)
            self.angles[name] = HOME[how][i]
        self.normalise(hung.edge.owner, hung.turn)

    def normalise(self, owner: Owner, names: tuple[str, ...]) -> None:
        """Write the rows that normalise orientation parameters; angles need none."""
        if self.orientation in NORMALISED:
            scribe = Scribe()
            self.write(NORMALISED[self.orientation], (owner,), scribe, scalars=tuple(scribe.s(n) for n in names))

    def free(self, hung: Hung, child: int) -> None:
        """Note the variables of a part that no joint of the tree holds."""
        part = self.parts.parts[child]
        if not part.points:
            self.lone(child)
            return
        for i, x in enumerate("xyz"):
            reading = Reading(Recipe("mean in space", tuple(range(len(part.points)))), i)
            self.add_variable(f"{part.name}.{x}", f"{x} of {part.name} from the ground", reading, part.points)
        if part.turns == "bar":
            self.direct(child)
        elif part.turns == "fully":
            how = self.orientation
            hung.turn = tuple(f"{part.name}.{e}" for e in PARAMETERS[how])
            scribe = Scribe()
            segments = self.segments(scribe, child)
            points = tuple(p for p, _ in scribe.points)
            for i, name in enumerate(hung.turn):
                reading = Oriented(how, i, segments)
                meaning = f"{how} of {part.name}"
                self.add_variable(name, meaning, reading, points, tuple(scribe.vectors), how in ANGLES, True)
                self.angles[name] = HOME[how][i]
            self.normalise(part.owner, hung.turn)


def _along(before: Turn | None, s: Linear) -> Turn:
    """A stretch by a variable, in a turned frame."""
    return Turn("times", (s,), (), before)
