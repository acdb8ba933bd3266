"""Reference-point coordinates: every body by a point and its orientation, as if it were free (source text §2.2)."""

from collections.abc import Mapping

import numpy as np

from jaxnc.constraints import ALIGNED, FIXED_ANGLE, SCALAR_PRODUCT
from jaxnc.families import planar
from jaxnc.families.bodies import Parts
from jaxnc.families.joined import apart
from jaxnc.families.origins import refer
from jaxnc.families.planner import Planner
from jaxnc.families.program import Arm, Frame, Oriented, Place, Reading, Turn
from jaxnc.families.scribe import Scribe, fixed
from jaxnc.families.shapes import Recipe
from jaxnc.families.turns import ANGLES, NORMALISED, PARAMETERS
from jaxnc.mechanism import model as record
from jaxnc.system.identity import Owner
from jaxnc.system.system import System


class Reference(Planner):
    """Variables and rows of reference-point coordinates.

    `reference` is ``"mass"``, ``"middle"``, or the reference points of some bodies; see `formulate`.
    """

    family = "reference point"

    def __init__(
        self,
        parts: Parts,
        natural: System,
        keep: tuple[str, ...] = (),
        orientation: str = "euler parameters",
        reference: str | Mapping[str, str | record.Place] = "mass",
    ):
        super().__init__(parts, natural, keep)
        self.orientation = orientation
        refer(parts, natural, reference)

    def names(self, k: int) -> tuple[str, ...]:
        """Names of the variables of a part in space."""
        part = self.parts.parts[k]
        turn = {"fully": PARAMETERS[self.orientation], "bar": ("ux", "uy", "uz"), "no": ()}[part.turns]
        return tuple(f"{part.name}.{x}" for x in ("x", "y", "z", *turn))

    def _frame(self, scribe: Scribe, k: int) -> Frame:
        part = self.parts.parts[k]
        if self.parts.dim == 2:
            return planar.frame(scribe, part)
        found = [scribe.s(name) for name in self.names(k)]
        turn = Turn(self.orientation, tuple(found[3:])) if part.turns == "fully" else None
        return Frame((Arm(None, tuple(found[:3])),), turn)

    def place(self, scribe: Scribe, k: int, point: int) -> Place:
        """A point of a part."""
        if k == 0:
            return self.ground(scribe, point)
        part, frame = self.parts.parts[k], self.frame(scribe, k)
        if part.turns == "no":
            return frame.origin
        if self.parts.dim == 2:
            at = planar.local(scribe, part, point, part.axis, part.origin.points, part.origin.how)
            return (*frame.origin, Arm(frame.turn, at))
        if part.turns == "bar":
            return (*frame.origin, *self.out(scribe, k, point, part.origin))
        origin = part.origin
        vectors = tuple(scribe.v(v) for v in origin.vectors)
        at = tuple(scribe.c("from", scribe.at((point, *origin.points), part), vectors, origin.how))
        return (*frame.origin, Arm(frame.turn, at))

    def plan(self) -> None:
        """Write variables and rows."""
        for k, part in enumerate(self.parts.parts[1:], start=1):
            self.body(k)
            if self.parts.dim == 2 and part.turns == "fully":
                self.angles[planar.names(part)[2]] = self.angle_of(*part.axis)
        for name in self.keep:
            self.kept(name)
        self.share(apart(self.parts.of_point), apart(self.parts.of_vector))
        self.hold()
        for data in self.a.instances:
            if data.kind.measure is None and data.kind.rows and not self.rigid(data) and not self.special(data):
                self.compose(data)

    def body(self, k: int) -> None:
        """The variables of a part, and the rows that normalise its orientation."""
        part, dim = self.parts.parts[k], self.parts.dim
        what = f"body {part.name}" if part.turns != "no" else f"point {part.name}"
        if dim == 2:
            for name, how, points, i in planar.readings(part):
                made = part.origin.how if how == "mean" else ()
                reading = Reading(Recipe(how, tuple(range(len(points))), (), made), i)
                meaning = f"angle of {what}" if how == "direction" else f"{'xy'[i]} of the reference point of {what}"
                self.add_variable(name, meaning, reading, points, angle=how == "direction")
            return
        names = self.names(k)
        if not part.points:
            self.lone(k)
            return
        for i, name in enumerate(names[:3]):
            origin = part.origin
            at = tuple(range(len(origin.points))), tuple(range(len(origin.vectors)))
            reading = Reading(Recipe("mean in space", *at, origin.how), i)
            meaning = f"{'xyz'[i]} of the reference point of {what}"
            self.add_variable(name, meaning, reading, origin.points, origin.vectors)
        scribe = Scribe()
        if part.turns == "fully":
            points = tuple(p for s in part.segments if len(s) == 2 for p in s)
            vectors = tuple(~s[0] for s in part.segments if len(s) == 1)
            segments = tuple(
                tuple(points.index(p) for p in s) if len(s) == 2 else (~vectors.index(~s[0]),) for s in part.segments
            )
            for i, name in enumerate(names[3:]):
                reading = Oriented(self.orientation, i, segments)
                angle = self.orientation in ANGLES
                self.add_variable(name, f"{self.orientation} of {what}", reading, points, vectors, angle, True)
            if self.orientation in NORMALISED:
                scalars = tuple(scribe.s(n) for n in names[3:])
                self.write(NORMALISED[self.orientation], (part.owner,), scribe, scalars=scalars)
        elif part.turns == "bar":
            self.direct(k)

    def special(self, data) -> bool:
        """Write what the text writes otherwise than in points: the prismatic joint (9)-(10), the pin in a slot."""
        if self.parts.dim != 2 or data.kind not in (ALIGNED, FIXED_ANGLE, SCALAR_PRODUCT):
            return False
        joints = [j for owner in data.owners if (j := self.parts.joint(owner)) is not None]
        joint = joints[0] if joints else None
        if isinstance(joint, record.Prismatic):
            line, on = self.a.pair(joint.line), self.a.pair(joint.on)
            i, j = self.parts.holder(line), self.parts.holder(on)
            if not i or not j or on[0] in line:
                return False
            if data.kind is ALIGNED:
                self.slide(data.owners, i, j, line, on)
            else:
                self.together(data.owners, line, on)
            return True
        if isinstance(joint, record.Slot):
            line = self.a.at(*joint.line)
            i = self.parts.holder(line)
            if i:
                self.pin(data.owners, i, line, self.a.index[joint.point])
                return True
        return False

    def together(self, owners: tuple[Owner, ...], line: tuple[int, int], on: tuple[int, int]) -> None:
        """Two bodies turn together (9)."""
        scribe = Scribe()
        (kept,) = scribe.c("between", scribe.at((*line, *on)))
        one, other = self.angle(scribe, line), self.angle(scribe, on)
        assert one is not None and other is not None
        turns = round((self.estimate(scribe, other) - self.estimate(scribe, one + kept)) / (2 * np.pi))
        self.write(planar.EQUAL, owners, scribe, scalars=(other, one + kept + fixed(2 * np.pi * turns)))

    def slide(self, owners: tuple[Owner, ...], i: int, j: int, line: tuple[int, ...], on: tuple[int, ...]) -> None:
        """A body slides along a line of another (10)."""
        scribe = Scribe()
        first, second = self.parts.parts[i], self.parts.parts[j]
        points = (
            *scribe.at((*second.axis, *on), second),
            *scribe.at(line, first),
            *scribe.at((*line, *on)),
            *scribe.at(second.origin.points, second),
            *scribe.at(first.origin.points, first),
        )
        extra = (len(second.origin.points), second.origin.how, first.origin.how)
        gamma, offset = scribe.c("prismatic", points, (), extra)
        one, other = self.frame(scribe, i), self.frame(scribe, j)
        assert other.turn is not None
        self.write(planar.PROJECTION, owners, scribe, (one.origin, other.origin), (other.turn.of[0] + gamma, offset))

    def pin(self, owners: tuple[Owner, ...], i: int, line: tuple[int, ...], point: int) -> None:
        """A point slides along a line of a body (37), as its projection on the line's normal."""
        scribe = Scribe()
        part = self.parts.parts[i]
        origin = part.origin
        gamma, offset = scribe.c("normal", scribe.at((*line, *part.axis, *origin.points), part), (), origin.how)
        frame = self.frame(scribe, i)
        assert frame.turn is not None
        holder = next(k for k in self.parts.of_point[point] if k != i)
        place = self.place(scribe, holder, point)
        self.write(planar.PROJECTION, owners, scribe, (place, frame.origin), (frame.turn.of[0] + gamma, offset))
