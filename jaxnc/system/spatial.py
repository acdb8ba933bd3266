"""Compiling joints (§4.2) and mixed coordinates (§4.3) in space."""

import functools

import numpy as np

from jaxnc import constraints as kinds
from jaxnc.errors import MechanismError
from jaxnc.mechanism import model as record
from jaxnc.system.assembler import COINCIDENT
from jaxnc.system.identity import Quantity
from jaxnc.system.spatial_bodies import SpatialBodies
from jaxnc.system.topology import Segment

_PARALLEL = 1e-6  # sine of an angle below which a direction has no projection across an axis
_ACROSS = 1e-6  # cosine up to which two directions count as perpendicular


class SpatialAssembler(SpatialBodies):
    """Writes spatial joints and coordinates."""

    # -- checks -------------------------------------------------------------------------------------------------

    def sine(self, a: Segment, b: Segment) -> float:
        """Sine of the drawn angle between two segments."""
        d, e = self.drawn(a), self.drawn(b)
        return float(np.linalg.norm(np.cross(d, e)) / (np.linalg.norm(d) * np.linalg.norm(e)))

    def given(self, direction: record.Direction, what: str) -> Segment:
        """The segment of a direction, refused where its points coincide."""
        segment = self.segment(direction)
        if len(segment) == 2:
            self.direction(segment, what)
        return segment

    def across(self, axis: Segment, direction: Segment, what: str) -> None:
        """Refuse a direction along an axis, about which it shows no angle."""
        if self.sine(axis, direction) < _PARALLEL:
            raise MechanismError(
                f"{what}: the {self.called(direction)} is drawn along the axis, the {self.called(axis)}, so it shows "
                f"no rotation about it; choose a direction across the axis"
            )

    def line(self, line: record.Pair, what: str) -> tuple[int, Segment]:
        """Point and direction of a line given as point and vector, or as two points."""
        point = self.index[line[0]]
        if line[1] in self.vector_index:
            return point, (~self.vector_index[line[1]],)
        return point, self.given(line, what)

    def note(
        self, name: str, kind: str, removed: int, points=(), segments=(), sides=(), pressure=-1, bodies=()
    ) -> None:
        """Note a joint for reports and drawings."""
        at = (*points, *(i for s in segments if len(s) == 2 for i in s))
        vectors = tuple(~s[0] for s in segments if len(s) == 1)
        self.joint(name, kind, tuple(dict.fromkeys(at)), removed, vectors, bodies, sides, pressure)

    # -- coordinates --------------------------------------------------------------------------------------------

    def end(self, at: str | None, end: record.Direction, what: str) -> Segment:
        """Where an angle starts or goes to: a point seen from `at`, a pair of points, or a vector."""
        if isinstance(end, str) and end in self.index:
            assert at is not None
            return self.given((at, end), what)
        return self.given(end, what)

    def add_angle(self, name: str, data: record.Angle) -> None:
        what = f"angle {name!r}"
        assert data.about is not None
        axis, to = self.given(data.about, what), self.end(data.at, data.to, what)
        self.across(axis, to, what)
        if data.start is not None:
            start = self.end(data.at, data.start, what)
            self.across(axis, start, what)
            self.turn(name, axis, start, to, data.form)
            return
        if not set(axis) <= self.rigid_sets[0]:
            raise MechanismError(
                f"{what}: its axis moves, so say from which direction it counts: start=, a vector, a point or two "
                f"points"
            )
        if data.form != "exact":
            raise MechanismError(f"{what}: form={data.form!r} needs a direction to start from; give start=")
        self.measured_write(kinds.angle_from_drawing, name, (axis, to))

    def turn(self, name: str, axis: Segment, start: Segment, to: Segment, form: str = "exact") -> None:
        """Write an angle about an axis."""
        if form != "exact":
            for segment in (start, to):
                if not self.rigid(segment):
                    raise MechanismError(
                        f"angle {name!r}, form {form!r}: needs a constant length of the {self.called(segment)}, but no "
                        f"body holds both points; use form='exact'"
                    )
                if not self.across_constant(axis, segment):
                    raise MechanismError(
                        f"angle {name!r}, form {form!r}: needs a constant angle between the {self.called(segment)} and "
                        f"the axis, the {self.called(axis)}, but no body holds both; use form='exact'"
                    )
        self.measured_write(functools.partial(kinds.angle_about, form), name, (axis, start, to))

    def measured_write(self, make, name: str, segments) -> None:
        """Write the row of a mixed coordinate over directions."""
        data = self.write(make, segments, scalars=(self.scalar(name),))
        assert data is not None
        self.measured[name] = data

    def add_distance(self, name: str, data: record.Distance) -> None:
        ends = self.pair((data.start, data.to))
        if data.along is None:
            self.measure(name, kinds.DISTANCE_BETWEEN, ends)
            return
        self.advance(name, ends, self.end(data.start, data.along, f"distance {name!r}"), data.form)

    def advance(self, name: str, ends: tuple[int, int], along: Segment, form: str = "exact") -> None:
        """Write a distance along a direction."""
        vectors = (~along[0],) if len(along) == 1 else ()
        points = ends if vectors else (*ends, *along)
        kind = kinds.distance_along(form, "v" if vectors else "p")
        self.measure(name, kind, points, owner=self.owner, vectors=vectors)

    # -- joints -------------------------------------------------------------------------------------------------

    def together(self, points: record.Pair | None) -> int:
        """Write that two points coincide; how many freedoms that removes."""
        if points is None:
            return 0
        self.add(kinds.COINCIDENT_IN_SPACE, self.at(*points))
        return 3

    def parallel(self, name: str, a: Segment, b: Segment) -> int:
        """Write that two directions stay parallel; how many freedoms that removes."""
        if a == b:
            return 0
        for segment in (a, b):
            self.held(segment, f"joint {name!r}")
        self.write(kinds.parallel, (a, b))
        return 2

    def held(self, segment: Segment, what: str) -> None:
        """Refuse a direction between points of different bodies."""
        if len(segment) == 2 and not self.rigid(segment):
            raise MechanismError(
                f"{what}: no body holds both points of the {self.called(segment)}, so it is not a direction of a body; "
                f"name a vector, or two points of one body"
            )

    def shares(self, what: str, on: str, axis: Segment, noun: str) -> None:
        """Refuse a point whose body does not share the axis that it slides along."""
        p, known = self.index[on], (self.rigid_sets[0], *self.members.values())
        mine = [body for body in known if p in body]
        others = [body for body in known if set(axis) <= body]
        if mine and not any(
            set(axis) <= body or self.spans(body & other, axis, whole=True) for body in mine for other in others
        ):
            example = self.vector_names[~axis[0]] if len(axis) == 1 else "u"
            only = "use slot()" if noun == "axis" else f"give the plane's own normal, on=({on!r}, {example!r})"
            raise MechanismError(
                f"{what}: the body of point {on!r} does not share the {noun}, the {self.called(axis)}; give the body "
                f"that vector, or say which direction of its own is along it, on=({on!r}, {example + '2'!r}); if the "
                f"point alone stays there and its body may tilt, {only}"
            )

    def slide(self, name: str, what: str, line: record.Pair, on: str | record.Pair) -> tuple[int, Segment, int, int]:
        """Write that a point or line slides along a line: its point and direction, what slides, freedoms removed."""
        point, axis = self.line(line, what)
        removed = 0
        other, second = (self.index[on], None) if isinstance(on, str) else self.line(on, what)
        if second is None and not what.startswith("slot"):
            self.shares(what, str(on), axis, "axis")
        ends = (point, *(axis if len(axis) == 2 else ()))
        sliding = [other]
        if second is not None and len(second) == 2 and len(axis) == 2:
            sliding.append(second[1])
        for p in sliding:
            if p not in ends:
                self.write(kinds_aligned, ((point, p), axis))
                removed += 2
        if second is not None and len(sliding) == 1:
            removed += self.parallel(name, second, axis)
        return point, axis, other, removed

    def sliding(self, on: str | record.Pair, axis: Segment) -> tuple[int, ...]:
        """What a sliding body is held by: its point, and its own line or the axis that it shares."""
        if isinstance(on, str):
            return (self.index[on], *axis)
        point, own = self.line(on, "")
        return (point, *own)

    def add_spherical(self, name: str, j: record.Spherical) -> None:
        points = self.at(*j.points)
        self.note(name, "spherical", self.together(j.points), points, sides=(points[:1], points[1:]))

    def add_revolute(self, name: str, j: record.Revolute) -> None:
        what = f"revolute joint {name!r}"
        assert j.axes is not None
        a, b = (self.given(axis, what) for axis in j.axes)
        removed = self.together(j.points) + self.parallel(name, a, b)
        self.note(name, "revolute", removed, self.at(*(j.points or ())), (a, b), (a, b))

    def add_cylindrical(self, name: str, j: record.Cylindrical) -> None:
        point, axis, other, removed = self.slide(name, f"cylindrical joint {name!r}", j.line, j.on)
        self.note(name, "cylindrical", removed, (point, other), (axis,), ((point, *axis), self.sliding(j.on, axis)))

    def add_prismatic(self, name: str, j: record.Prismatic) -> None:
        what = f"prismatic joint {name!r}"
        point, axis, other, removed = self.slide(name, what, j.line, j.on)
        assert j.directions is not None
        a, b = (self.given(d, what) for d in j.directions)
        for d in (a, b):
            self.across(axis, d, what)
        if j.form == "exact":
            self.write(kinds.no_turn, (axis, a, b))
        else:
            if self.sine(a, b) < 1e-3:
                raise MechanismError(
                    f"{what}: the {self.called(a)} and the {self.called(b)} are drawn parallel, where the scalar "
                    f"product of form='text' does not hold them (erratum 9); use form='exact', or directions at an "
                    f"angle"
                )
            for d in (a, b):
                self.held(d, what)
            self.write(kinds.product, (a, b))
        held = (point, *axis, *a), (*self.sliding(j.on, axis), *b)
        self.note(name, "prismatic", removed + 1, (point, other), (axis, a, b), held)

    def add_slot(self, name: str, j: record.Slot) -> None:
        point, axis, other, removed = self.slide(name, f"slot {name!r}", j.line, j.point)
        self.note(name, "slot", removed, (point, other), (axis,), ((point, *axis), (other,)))

    def add_universal(self, name: str, j: record.Universal) -> None:
        what = f"universal joint {name!r}"
        a, b = (self.given(axis, what) for axis in j.axes)
        if self.sine(a, b) < 0.1:
            raise MechanismError(
                f"{what}: the arms of its cross, the {self.called(a)} and the {self.called(b)}, are drawn nearly "
                f"parallel; draw them across each other (a Cardan joint has them perpendicular)"
            )
        for arm in (a, b):
            self.held(arm, what)
        removed = self.together(j.points)
        self.write(kinds.product, (a, b))
        self.note(name, "universal", removed + 1, self.at(*(j.points or ())), (a, b), (a, b))

    def add_screw(self, name: str, j: record.Screw) -> None:
        what = f"screw joint {name!r}"
        point, axis, other, removed = self.slide(name, what, j.line, j.on)
        a, b = (self.given(d, what) for d in j.directions)
        for d in (a, b):
            self.across(axis, d, what)
        self.turn(j.angle, axis, a, b)
        self.advance(j.distance, (point, other), axis)
        per = "pitch" if j.lead is None else "lead"
        value = j.pitch if j.lead is None else j.lead
        assert value is not None
        given = {per: self.dimension(per, value, Quantity.PLACE)}
        self.add(kinds.SCREW[per], (), (self.scalar(j.distance), self.scalar(j.angle)), given=given)
        held = (point, *axis, *a), (*self.sliding(j.on, axis), *b)
        self.note(name, "screw", removed + 1, (point, other), (axis, a, b), held)

    def add_planar(self, name: str, j: record.Planar) -> None:
        what = f"planar joint {name!r}"
        point, normal = self.line(j.plane, what)
        other, second = (self.index[j.on], normal) if isinstance(j.on, str) else self.line(j.on, what)
        if isinstance(j.on, str):
            self.shares(what, j.on, normal, "normal")
        self.write(kinds.product, ((point, other), normal))
        removed = 1 + self.parallel(name, second, normal)
        self.note(name, "planar", removed, (point, other), (normal,), ((point, *normal), (other, *second)))

    def add_bevelgear(self, name: str, j: record.BevelGear) -> None:
        what = f"bevel gear {name!r}"
        axes, centres, rims, ends = [], [], [], []
        for k, angle in enumerate(j.angles):
            data = self.model.angles[angle]
            assert data.about is not None
            axes.append(self.segment(data.about))
            to = self.end(data.at, data.to, what)
            if data.at is None and len(to) == 1:
                raise MechanismError(
                    f"{what}: angle {angle!r} goes to a vector and has no at=, so the wheel's centre is not known; "
                    f"give the angle at=, a point of the wheel's axis"
                )
            ends.append(to)
            centre = to[0] if data.at is None else self.index[data.at]
            rim = to[1] if len(to) == 2 else centre
            if rim == centre and j.radii is None:
                raise MechanismError(f"{what}: wheel {k + 1} has no rim point to read its radius from; give radii=")
            centres.append(centre)
            rims += [centre, rim]
        given = {}
        if j.radii is not None:
            given = {f"radius{k + 1}": self.dimension(f"radius{k + 1}", r) for k, r in enumerate(j.radii)}
        scalars = [self.scalar(a) for a in j.angles]
        self.write(lambda forms: kinds.bevel(forms, j.internal), axes, (*centres, *rims), scalars=scalars, given=given)
        kind = "internal bevel gear" if j.internal else "bevel gear"
        held = (*((centre, *axis) for centre, axis in zip(centres, axes, strict=True)), *ends)
        self.note(name, kind, 1, rims, axes, held, self.pressure(j.pressure_angle))

    def add_rackandpinion(self, name: str, j: record.RackAndPinion) -> None:
        what = f"rack and pinion {name!r}"
        angle, distance = self.model.angles[j.angle], self.model.distances[j.distance]
        if distance.along is None:
            raise MechanismError(f"{what}: distance {j.distance!r} has no direction; give it along=, the rack's line")
        assert angle.about is not None
        axis, to = self.segment(angle.about), self.end(angle.at, angle.to, what)
        centre = self.index[angle.at] if angle.at is not None else to[0] if len(to) == 2 else None
        if centre is None:
            raise MechanismError(f"{what}: angle {j.angle!r} has no at=, so the pinion's centre is not known; give it")
        start = self.index[distance.start]
        along = self.end(distance.start, distance.along, what)
        self.perpendicular(axis, along, what, "the pinion's axis", "the rack's line")
        if j.radius is None:
            w = self.home[start] - self.home[centre]
            d = self.drawn(along) / np.linalg.norm(self.drawn(along))
            if np.linalg.norm(w - (w @ d) * d) < 1e-9 * self.size:
                raise MechanismError(
                    f"{what}: the pinion's centre is drawn on the rack's line, so its radius is not known; give radius="
                )
        given = {} if j.radius is None else {"radius": self.dimension("radius", j.radius)}
        scalars = (self.scalar(j.distance), self.scalar(j.angle))
        self.write(lambda forms: kinds.rack(forms, False), (axis, along), (centre, start), scalars=scalars, given=given)
        held, pressure = ((centre, *axis), (start, *along), to), self.pressure(j.pressure_angle)
        self.note(name, "rack and pinion", 1, (centre, start), (axis, along), held, pressure)

    def perpendicular(self, a: Segment, b: Segment, what: str, noun: str, other: str) -> None:
        """Refuse two directions that are not drawn perpendicular."""
        d, e = self.drawn(a), self.drawn(b)
        cosine = float(d @ e / (np.linalg.norm(d) * np.linalg.norm(e)))
        if abs(cosine) > _ACROSS:
            degrees = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
            raise MechanismError(
                f"{what}: {noun}, the {self.called(a)}, must be perpendicular to {other}, the {self.called(b)}, but is "
                f"drawn at {degrees:.4g}° to it; draw it across"
            )

    def add_constantvelocity(self, name: str, j: record.ConstantVelocity) -> None:
        what = f"constant-velocity joint {name!r}"
        axes = [self.given(a, what) for a in j.axes]
        marks = [self.given(a, what) for a in j.marks]
        for axis, mark in zip(axes, marks, strict=True):
            self.across(axis, mark, what)
        if float(self.drawn(axes[0]) @ self.drawn(axes[1])) <= 0.0:
            raise MechanismError(
                f"{what}: its axes, the {self.called(axes[0])} and the {self.called(axes[1])}, are drawn at 90° or "
                f"more; let both point the same way along the drive line"
            )
        removed = self.together(j.points)
        self.write(kinds.constant_velocity, (axes[0], marks[0], axes[1], marks[1]))
        held = tuple((*axis, *mark) for axis, mark in zip(axes, marks, strict=True))
        self.note(name, "constant velocity", removed + 1, self.at(*(j.points or ())), (*axes, *marks), held)

    def add_rolling(self, name: str, j: record.Rolling) -> None:
        what = f"rolling joint {name!r}"
        start, line = self.line(j.line, what)
        centre, rim, contact = self.at(j.centre, j.rim, j.contact)
        assert j.axis is not None
        axis = self.given(j.axis, what)
        self.perpendicular(axis, line, what, "the disc's axis", "the line")
        for pair in ((centre, contact), (centre, rim)):
            self.direction(pair, what)
            self.across(axis, pair, what)
        given = {} if j.radius is None else {"radius": self.dimension("radius", j.radius)}
        self.write(kinds.contact, (line, axis), (centre, contact), given=dict(given))
        if contact not in (start, *line):
            self.write(kinds_aligned, ((start, contact), line))
        self.turn(j.angle, axis, (centre, contact), (centre, rim))
        self.advance(j.distance, (start, contact), line)
        scalars = (self.scalar(j.distance), self.scalar(j.angle))
        self.write(
            lambda forms: kinds.rack(forms, True),
            (axis, line),
            (centre, contact),
            scalars=scalars,
            given=dict(given),
        )
        held = (start, *line), (centre, rim), (contact,)
        self.note(name, "rolling", 6, (start, centre, contact, rim), (line, axis), held)

    def add_rollingdisc(self, name: str, j: record.RollingDisc) -> None:
        what = f"rolling disc {name!r}"
        points = (self.index[j.centre], self.index[j.plane[0]])
        axis, mark, normal = (self.vector_index[u] for u in (j.axis, j.mark, j.plane[1]))
        if not any({axis, mark} <= set(b.vectors) and points[0] in b.points for b in self.bodies):
            raise MechanismError(
                f"{what}: no body has the point {j.centre!r} and the vectors {j.axis!r} and {j.mark!r} together; give "
                f"them to the disc's body"
            )
        self.across((~axis,), (~mark,), what)
        n = self.vectors[normal]
        height = float((self.home[points[0]] - self.home[points[1]]) @ n)
        if height <= COINCIDENT * self.size:
            raise MechanismError(
                f"{what}: its centre {j.centre!r} is drawn {-height:.4g} below the plane; draw it on the side that the "
                f"normal {j.plane[1]!r} points to"
            )
        if np.linalg.norm(np.cross(self.vectors[axis], n)) < _ACROSS:
            raise MechanismError(f"{what} is drawn flat on the plane, so it has no point of contact; draw it upright")
        given = {} if j.radius is None else {"radius": self.dimension("radius", j.radius)}
        self.add(kinds.TOUCHING, points, vectors=(axis, normal), given=dict(given))
        self.slip(kinds.ROLLING_DISC, points, (), (axis, mark, normal), given=dict(given))
        self.note(name, "rolling disc", 1, points, ((~axis,), (~normal,)))

    def add_weld(self, name: str, j: record.Weld) -> None:
        first, second = (next(b for b in self.bodies if b.name == n) for n in j.bodies)
        for body in (first, second):
            if len(body.segments) < 2:
                raise MechanismError(
                    f"weld {name!r}: body {body.name!r} is a bar that does not know its rotation about its own line; "
                    f"give it a point or vector across it"
                )
        held = self.members[first.name]
        needed = dict.fromkeys(i for s in second.segments for i in s)
        points = [i for i in needed if i >= 0] or [second.points[0]]
        shared = [i for i in second.points if i in held]
        anchor = shared[0] if shared else points[0]
        free = [i for i in dict.fromkeys((anchor, *points)) if i not in held]
        vectors = [i for i in needed if i < 0 and i not in held]
        for p in free:
            self.write(kinds.carried, (*first.segments, (first.points[0], p)))
        for k in vectors:
            self.write(kinds.carried, (*first.segments, (k,)))
        removed = 6 if not shared else 3
        held = self.members[first.name], self.members[second.name]
        ends = *first.segments, *second.segments
        self.note(name, "weld", removed, (first.points[0], anchor), ends, held, bodies=j.bodies)


def kinds_aligned(forms: str):
    """The kind for a segment (always two points) along a direction."""
    return kinds.aligned(forms[1])
