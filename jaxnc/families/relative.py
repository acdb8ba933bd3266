"""Relative coordinates in the plane: the variables of joints, and equations that close loops (source text §2.1)."""

from dataclasses import dataclass

from jaxnc.families import planar
from jaxnc.families.bodies import Parts
from jaxnc.families.graph import Edge, edges, tree
from jaxnc.families.planner import Planner
from jaxnc.families.program import Arm, Frame, Linear, Place, Reading, Turn, scaled
from jaxnc.families.scribe import Scribe
from jaxnc.families.shapes import Recipe
from jaxnc.system.system import System


@dataclass
class Hung:
    """How a part hangs on the one before it in the tree."""

    edge: Edge  # the joint
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

    def __init__(self, parts: Parts, natural: System, keep: tuple[str, ...] = ()):
        super().__init__(parts, natural, keep)
        self.hung: dict[int, Hung] = {}

    # -- places -------------------------------------------------------------------------------------------------

    def axis(self, k: int) -> tuple[int, int]:
        """The two points whose direction is a part's angle."""
        return self.hung[k].axis

    def sliding(self, k: int) -> bool:
        """Whether a part's frame is turned to the line that it slides along."""
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
            return planar.segment(scribe, self.parts.parts[k], ends, edge.on, turn.of[0] + kept)
        return super().angle(scribe, ends, k)

    def place(self, scribe: Scribe, k: int, point: int) -> Place:
        """A point of a part."""
        if k == 0:
            return self.ground(scribe, point)
        part, hung, frame = self.parts.parts[k], self.hung[k], self.frame(scribe, k)
        if hung.origin == (point,):
            return frame.origin
        if self.sliding(k):
            edge = hung.edge
            at = (*scribe.at((point, *hung.origin, *edge.on), part), *scribe.at((*edge.line, *edge.on)))
            return (*frame.origin, Arm(frame.turn, tuple(scribe.c("sliding", at))))
        return (*frame.origin, Arm(frame.turn, planar.local(scribe, part, point, hung.axis, hung.origin)))

    def _frame(self, scribe: Scribe, k: int) -> Frame:
        hung = self.hung[k]
        edge, part = hung.edge, self.parts.parts[k]
        if edge.how == "free":
            return planar.frame(scribe, part)
        if edge.how == "held":
            still = ((1.0, "xy"[self._free(edge.point) ^ 1], scribe.p(edge.point)),)
            both = (scribe.s(hung.distance), still)
            at: Place = (Arm(None, both if self._free(edge.point) == 0 else both[::-1]),)
            return Frame(at, self._turned(scribe, hung))
        if edge.how == "revolute":
            return Frame(self.place(scribe, hung.parent, edge.point), self._turned(scribe, hung))
        s = scribe.s(hung.distance)
        if k == edge.second:  # along the parent's line
            line = self._turn(self.angle(scribe, edge.line, hung.parent))
            at = (*self.place(scribe, hung.parent, edge.start), Arm(line, (s, ())))
            return Frame(at, line if edge.how == "prismatic" else self._turned(scribe, hung))
        if edge.how == "prismatic":
            (kept,) = scribe.c("between", scribe.at((*edge.line, *edge.on)))
            on = self.angle(scribe, edge.on, hung.parent)
            assert on is not None
            turn = self._turn(on + scaled(kept, -1.0))
        else:
            turn = self._turned(scribe, hung)
        return Frame((*self.place(scribe, hung.parent, edge.point), Arm(turn, (scaled(s, -1.0), ()))), turn)

    def _turned(self, scribe: Scribe, hung: Hung) -> Turn | None:
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
        return self._turn(before + scaled(phi, -1.0 if hung.backwards else 1.0))

    @staticmethod
    def _turn(angle: Linear | None) -> Turn:
        assert angle is not None
        return Turn("angle", (angle,))

    def _free(self, point: int) -> int:
        """The axis along which a point that is held in part may move."""
        return int(self.a.fixed[point][0])

    # -- variables and rows -------------------------------------------------------------------------------------

    def plan(self) -> None:
        """Write variables and rows."""
        found = tree(self.parts, edges(self.parts))
        for edge, parent, child in found.steps:
            self.hang(edge, parent, child)
        for name in self.keep:
            self.kept(name)
        self.share(found.points, found.vectors)
        self.hold(frozenset(e.point for e, _, _ in found.steps if e.how == "held"))
        used = {e.owner for e, _, _ in found.steps if e.how in ("prismatic", "slot")}
        for data in self.a.instances:
            if data.kind.measure is None and data.kind.rows and not self.rigid(data) and used.isdisjoint(data.owners):
                self.compose(data)

    def hang(self, edge: Edge, parent: int, child: int) -> None:
        """Hang a part on the one before it, and note the joint's variables."""
        part = self.parts.parts[child]
        if edge.how == "free":
            self.hung[child] = Hung(edge, parent, part.axis, part.points)
            for name, how, points, i in planar.readings(part):
                reading = Reading(Recipe(how, tuple(range(len(points)))), i)
                self.add_variable(name, f"{part.name} from the ground", reading, points, angle=how == "direction")
                if how == "direction":
                    self.angles[name] = self.angle_of(*part.axis)
            return
        on_line = edge.how in ("prismatic", "slot") and child == edge.first
        if edge.how == "prismatic" or on_line:
            axis = edge.line if on_line else edge.on
        else:
            axis = part.axis
            if edge.point in axis:
                axis = (edge.point, axis[1] if edge.point == axis[0] else axis[0])
        hung = Hung(edge, parent, axis, (edge.start,) if on_line else (edge.point,))
        self.hung[child] = hung
        where = f"{self.parts.parts[edge.first].name} and {self.parts.parts[edge.second].name}"
        if edge.how in ("prismatic", "slot", "held"):
            self.distance(hung, where)
        if edge.how != "prismatic" and part.turns != "no":
            self.turning(hung, child, f"between {where} at {self.parts.point(edge.point)}")

    def distance(self, hung: Hung, where: str) -> None:
        """Note the variable of a sliding joint."""
        edge = hung.edge
        assert edge.owner is not None
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

    def turning(self, hung: Hung, child: int, where: str) -> None:
        """Note the variable of a turning joint: the user's angle, or that from the parent's axis to the part's."""
        edge, points = hung.edge, hung.axis
        assert edge.owner is not None
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
        self.angles[hung.angle] = self.drawn.get(hung.angle, planar.drawn_angle(self.a.home, points))
        self.add_variable(hung.angle, f"angle {where}", reading, points, angle=True)
