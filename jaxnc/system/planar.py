"""Compiling a planar description: forms of bodies (§3.1), joints (§3.2) and mixed coordinates (§3.3)."""

from collections.abc import Sequence

import numpy as np

from jaxnc import constraints as kinds
from jaxnc.constraints import Kind
from jaxnc.errors import MechanismError
from jaxnc.mechanism import model as record
from jaxnc.system.assembler import COINCIDENT, Assembler
from jaxnc.system.identity import Thing
from jaxnc.system.topology import BodyIndex, MarkerIndex


class PlanarAssembler(Assembler):
    """Writes planar bodies, joints and coordinates."""

    def rigid(self, a: int, b: int) -> bool:
        """Whether the distance between two points is constant."""
        both = {a, b}
        return bool(self.fixed[[a, b]].all()) or any(both <= set(body.points) for body in self.bodies)

    def add_bodies(self, specs: dict[str, record.Body]) -> None:
        for name, body in specs.items():
            self.add_body(name, body)

    # -- bodies -------------------------------------------------------------------------------------------------

    def base(self, points: tuple[int, ...]) -> tuple[int, int]:
        """The segment that carries a body: its first two points, or the two farthest where those nearly coincide."""
        home = self.home[list(points)]
        gaps = np.linalg.norm(home[:, None] - home[None], axis=-1)
        if gaps[0, 1] >= 0.05 * gaps.max():
            return points[0], points[1]
        i, j = np.unravel_index(int(gaps.argmax()), gaps.shape)
        return points[min(i, j)], points[max(i, j)]

    def add_body(self, name: str, body: record.Body) -> None:
        self.owner = self.owning(Thing.BODY, name)
        points = self.at(*body.points)
        if len(points) == 1:
            line = self.orientation(name, body)
            self.bodies.append(BodyIndex(name, points, () if line is None else (line,)))
            return
        shape = self.redrawn.get(name, {p: p for p in points})
        base = self.pair(body.points[:2]) if name in self.redrawn else self.base(points)
        self.direction(base, f"body {name!r}")
        self.bodies.append(BodyIndex(name, points, (base,)))

        def add(kind: Kind, *at: int) -> None:
            self.add(kind, at, drawn=tuple(shape[p] for p in at))

        add(kinds.DISTANCE, *base)
        rest = [p for p in points if p not in base]
        if body.form == "exact":
            for p in rest:
                add(kinds.ATTACHED, *base, p)
            return
        i, j = base
        off = [abs(_cross(self.home[j] - self.home[i], self.home[p] - self.home[i])) for p in rest]
        if not rest or max(off) <= 1e-9 * self.size**2:
            for p in rest:
                add(kinds.PROPORTIONAL, i, j, p)
            return
        third = rest[int(np.argmax(off))]
        add(kinds.DISTANCE, i, third)
        add(kinds.DISTANCE, j, third)
        for p in rest:
            if p != third:
                add(kinds.COMBINATION, i, j, third, p)

    def orientation(self, name: str, body: record.Body) -> tuple[int, int] | None:
        """The line that a body of one point keeps its direction to; None where its point moves along an axis."""
        point = body.points[0]
        if body.along is not None:
            return self.pair(body.along)
        at = self.index[point]
        if self.fixed[at].all():
            raise MechanismError(
                f"body {name!r} has only the ground point {point!r}, so nothing of it moves and its orientation is not "
                f"known: give it a second point, or leave the body out (the ground is no body)"
            )
        if self.fixed[at].any():
            return None
        lines = []
        for joint in self.model.joints.values():
            if isinstance(joint, record.Slot) and joint.point == point:
                lines.append(joint.line)
            if isinstance(joint, record.Prismatic) and joint.on[0] == point:
                lines.append(joint.line)
        for line in lines:
            if self.fixed[list(self.at(*line))].all():
                return self.pair(line)
        if lines:
            return self.pair(lines[0])
        raise MechanismError(
            f"body {name!r} has only the point {point!r}, so its orientation is not known: give it a second point, "
            f"let {point!r} slide in a slot, fix one of its coordinates, or say which line it follows with along="
        )

    def marker(self, name: str, data: record.Marker) -> MarkerIndex:
        body = next(b for b in self.bodies if b.name == data.on)
        base = body.base
        if base is None:
            raise MechanismError(
                f"marker {name!r}: body {data.on!r} has one point and no line to carry a marker; give the body "
                f"along=, or a second point"
            )
        shape = self.redrawn.get(data.on, {})
        drawn = (shape.get(base[0], base[0]), shape.get(base[1], base[1]))
        return MarkerIndex(name, data.on, body.points[0] if len(body.points) == 1 else base[0], (base,), (drawn,))

    # -- coordinates --------------------------------------------------------------------------------------------

    def add_angle(self, name: str, data: record.Angle) -> None:
        def pair(end: str | record.Pair) -> tuple[int, ...]:
            return self.at(data.at, end) if isinstance(end, str) and data.at is not None else self.at(*end)

        to = pair(data.to)
        what = f"angle {name!r}"
        self.direction(to, what)
        if data.start is None:
            kind, points = kinds.ANGLE_FROM_X[data.form], to
        else:
            start = pair(data.start)
            self.direction(start, what)
            kind, points = kinds.ANGLE[data.form], start + to
        pairs = [points[i : i + 2] for i in range(0, len(points), 2)]
        lengths = {c: self.length_of(p[0], p[1]) for c, p in zip(kind.constants, pairs, strict=False)}
        if kind.constants:
            for p in pairs:
                self.must_be_rigid(p, f"{what}, form {data.form!r}")
        self.measure(name, kind, points, lengths)

    def add_distance(self, name: str, data: record.Distance) -> None:
        ends = self.at(data.start, data.to)
        if data.along is None:
            self.measure(name, kinds.DISTANCE_BETWEEN, ends, {})
            return
        line = self.at(data.start, data.along) if isinstance(data.along, str) else self.at(*data.along)
        self.along(name, ends, line, data.form)

    def along(self, name: str, ends: tuple[int, ...], line: tuple[int, ...], form: str) -> None:
        self.direction(line, f"distance {name!r}")
        if self.rigid(*line):
            self.measure(name, kinds.DISTANCE_ALONG[form], ends + line, {"line": self.length_of(*line)})
            return
        if form != "exact":
            self.must_be_rigid(line, f"distance {name!r}, form {form!r}")
        self.measure(name, kinds.DISTANCE_ALONG_FREE, ends + line, {})

    def must_be_rigid(self, pair: Sequence[int], what: str) -> None:
        if not self.rigid(*pair):
            a, b = (self.names[i] for i in pair)
            raise MechanismError(
                f"{what}: needs the constant length {a}-{b}, but no body holds both points; use form='exact'"
            )

    # -- joints -------------------------------------------------------------------------------------------------

    def add_revolute(self, name: str, j: record.Revolute) -> None:
        assert j.points is not None
        points = self.at(*j.points)
        self.add(kinds.COINCIDENT, points)
        self.joint(name, "revolute", points, 2, sides=(points[:1], points[1:]))

    def add_prismatic(self, name: str, j: record.Prismatic) -> None:
        line, on = self.at(*j.line), self.at(*j.on)
        self.direction(line, f"prismatic joint {name!r}")
        self.direction(on, f"prismatic joint {name!r}")
        if on[0] not in line:
            self.add(kinds.ALIGNED, (*line, on[0]))
        self.add(kinds.FIXED_ANGLE if j.form == "exact" else kinds.SCALAR_PRODUCT, line + on)
        self.joint(name, "prismatic", line + on, 2, sides=(line, on))

    def add_slot(self, name: str, j: record.Slot) -> None:
        line = self.at(*j.line)
        self.direction(line, f"slot {name!r}")
        points = (*line, self.index[j.point])
        self.add(kinds.ALIGNED, points)
        self.joint(name, "slot", points, 1, sides=(line, points[2:]))

    def add_gear(self, name: str, j: record.Gear) -> None:
        points, lengths = [], {}
        for k, angle in enumerate(j.angles):
            to = self.measured[angle].points[-2:]
            points.extend(to)
            lengths[f"radius{k + 1}"] = self.length_of(*to)
        kind = kinds.INTERNAL_GEAR if j.internal else kinds.EXTERNAL_GEAR
        given = {}
        if j.radii is not None:
            given = {f"radius{k + 1}": self.dimension(f"radius{k + 1}", r) for k, r in enumerate(j.radii)}
            lengths = {}
        self.add(kind, points, [self.scalar(a) for a in j.angles], lengths=lengths, given=given)
        noun = "internal gear" if j.internal else "gear"
        held = points[:1], points[2:3], points[:2], points[2:]
        self.joint(name, noun, points, 1, sides=held, pressure=self.pressure(j.pressure_angle))

    def add_rolling(self, name: str, j: record.Rolling) -> None:
        what = f"rolling joint {name!r}"
        line = self.at(*j.line)
        centre, rim, contact = self.at(j.centre, j.rim, j.contact)
        self.direction(line, what)
        self.direction((centre, contact), what)
        self.direction((centre, rim), what)
        given = {} if j.radius is None else {"radius": self.dimension("radius", j.radius)}
        if abs(_cross(self.home[line[1]] - self.home[line[0]], self.home[centre] - self.home[line[0]])) <= (
            COINCIDENT * self.size**2
        ):
            raise MechanismError(
                f"{what}: centre {j.centre!r} is drawn on the line {j.line[0]}-{j.line[1]}, so the side it rolls on is "
                f"not known; draw it on one side"
            )
        where = (*line, centre, contact)
        if j.form == "exact":
            self.must_be_rigid(line, f"{what}, form 'exact'")
            self.add(kinds.CONTACT, where, lengths={"line": self.length_of(*line)}, given=dict(given))
        else:
            radius = {"length": given["radius"]} if given else {}
            self.add(kinds.DISTANCE, (centre, contact), given=radius)
            self.add(kinds.PERPENDICULAR, (*line, contact, centre))
        self.add(kinds.ALIGNED, (*line, contact))
        to, start = (centre, rim), (centre, contact)
        if j.form == "exact":
            self.measure(j.angle, kinds.ANGLE["exact"], start + to, {})
            self.along(j.distance, (line[0], contact), line, "exact")
        else:
            self.must_be_rigid(to, f"{what}, form 'text'")
            radii = {"length2": self.length_of(*to)} | ({} if given else {"length1": self.length_of(*start)})
            radius = {"length1": given["radius"]} if given else {}
            self.measure(j.angle, kinds.ANGLE["cosine"], start + to, radii, given=radius)
            across, up = np.abs(self.home[line[1]] - self.home[line[0]])
            self.along(j.distance, (line[0], contact), line, "x" if across >= up else "y")
        scalars = (self.scalar(j.distance), self.scalar(j.angle))
        self.add(kinds.ROLLING, where, scalars, given=dict(given))
        self.joint(name, "rolling", (*where, rim), 4, sides=(line, to, (contact,)))

    def add_skate(self, name: str, j: record.Skate) -> None:
        points = (self.index[j.point], *self.at(*j.heading))
        self.direction(points[1:], f"skate {name!r}")
        self.slip(kinds.SKATE, points)
        self.joint(name, "skate", points, 0)

    def add_weld(self, name: str, j: record.Weld) -> None:
        first, second = (next(b for b in self.bodies if b.name == n) for n in j.bodies)
        for body in (first, second):
            if len(body.points) < 2:
                raise MechanismError(f"weld {name!r}: body {body.name!r} has one point; welded bodies need two")
        a, b = first.base, second.base
        assert a is not None and b is not None
        shared = [p for p in second.points if p in first.points]
        if len(shared) > 1:
            return
        if not shared:
            self.add(kinds.ATTACHED, (*a, b[0]))
        self.add(kinds.FIXED_ANGLE, a + b)
        self.joint(name, "weld", a + b, 1 if shared else 3, bodies=j.bodies, sides=(first.points, second.points))


def _cross(a: np.ndarray, b: np.ndarray) -> float:
    return float(a[0] * b[1] - a[1] * b[0])
