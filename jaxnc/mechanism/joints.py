"""Joints that sharing a point does not already give, as builder methods."""

from collections.abc import Sequence
from itertools import pairwise

from jaxnc.errors import MechanismError, nearest
from jaxnc.mechanism import model as record
from jaxnc.mechanism.checked import CheckedModel


class JointBuilder(CheckedModel):
    """The part of `Mechanism` that adds joints."""

    def revolute(
        self,
        name: str,
        point: str | None = None,
        other: str | None = None,
        axes: tuple[record.Direction, record.Direction] | None = None,
    ) -> str:
        """Pin two bodies that do not share everything a revolute joint needs (what they share needs no joint).

        Args:
            name: its name.
            point: a point of one body, on the joint's axis.
            other: the point of the other body that coincides with it. In space both may be left out where the bodies
                share a point of the axis.
            axes: in space: the direction of the joint's axis in each body, vectors or pairs of points (§4.2.2).
        """
        what = f"revolute joint {name!r}"
        self._new_joint(name)
        if self.model.dim == 2:
            self._distinct((point, other), what)  # pyright: ignore[reportArgumentType]
            self.model.joints[name] = record.Revolute((point, other))  # pyright: ignore[reportArgumentType]
            return name
        if axes is None:
            raise MechanismError(
                f"{what}: in space it needs its axis in each body, axes=('u', 'v'); bodies that share a point and a "
                f"vector (or two points) need no joint, and a ball joint is spherical()"
            )
        self.model.joints[name] = record.Revolute(self._both(point, other, what), self._directions(axes, what))
        return name

    def _both(self, point: str | None, other: str | None, what: str) -> tuple[str, str] | None:
        """Two coincident points of a joint, or none where the bodies share it."""
        if point is None and other is None:
            return None
        if point is None or other is None:
            raise MechanismError(f"{what}: give the point of each body, or neither if the bodies share it")
        self._distinct((point, other), what)
        return point, other

    def prismatic(
        self,
        name: str,
        line: tuple[str, str],
        on: str | tuple[str, str],
        form: str = "exact",
        directions: tuple[record.Direction, record.Direction] | None = None,
    ) -> str:
        """Let a body slide along a line of another without turning relative to it, (35)-(36), (131)-(141).

        Args:
            name: its name.
            line: the line in one body: two points, or in space a point and a vector.
            on: in the plane two points of the sliding body, the first one on the line. In space its point on the line
                if it shares the line's vector, else its own line, a point and a vector or two points.
            form: ``"exact"`` keeps its rank at every angle (erratum 9); ``"text"`` is the scalar product (36), (134),
                (141).
            directions: in space: a direction of each body, not along the line, between which the angle stays.
        """
        what = f"prismatic joint {name!r}"
        self._new_joint(name)
        if form not in ("exact", "text"):
            raise MechanismError(f"{what}: form={form!r}; use 'exact' or 'text'")
        if self.model.dim == 2:
            if directions is not None:
                self._in_space(f"{what}: directions=")
            if isinstance(on, str):
                raise MechanismError(f"{what}: on= is two points of the sliding body; one, as {on!r}, is for slot()")
            self.model.joints[name] = record.Prismatic(self._line(line, what), self._line(on, what), None, form)
            return name
        if directions is None:
            raise MechanismError(
                f"{what}: in space it also keeps the bodies from turning about the line; give a direction of each "
                f"body that is not along it, directions=('u', 'v')"
            )
        line, on = self._slide(line, on, what)
        self.model.joints[name] = record.Prismatic(line, on, self._directions(directions, what), form)
        return name

    def _slide(self, line: object, on: object, what: str) -> tuple[tuple[str, str], str | tuple[str, str]]:
        """A line of one body, and the point, or the line, of another that slides along it."""
        line = self._axis_line(line, what)
        if isinstance(on, str):
            self._known_point(on, what)
            if on in line:
                raise MechanismError(f"{what}: point {on!r} is one of the points of its own line {line}")
            return line, on
        return line, self._axis_line(on, what)

    def slot(self, name: str, point: str, line: tuple[str, str]) -> str:
        """Let a pin slide along a line (special prismatic joint, pin in slot), (37).

        Args:
            name: its name.
            point: the pin.
            line: two points of the body that carries the slot; in space also a point and a vector.
        """
        what = f"slot {name!r}"
        self._new_joint(name)
        self._known_point(point, what)
        line = self._axis_line(line, what)
        if point in line:
            raise MechanismError(f"{what}: point {point!r} is one of the points of its own line {line}")
        self.model.joints[name] = record.Slot(point, line)
        return name

    def gear(
        self,
        name: str,
        angle1: str,
        angle2: str,
        radii: tuple[float, float] | None = None,
        internal: bool = False,
        pressure_angle: float | None = None,
    ) -> str:
        """Mesh two wheels, (47): ``R1 φ1 + R2 φ2 = c`` external, ``R1 φ1 - R2 φ2 = c`` internal.

        In space this is `bevel_gear`, which covers parallel axes too.

        Args:
            name: its name.
            angle1: angle of the first wheel, measured at its centre from the line of centres (or from any direction
                that keeps its angle to it).
            angle2: angle of the second wheel, measured likewise.
            radii: pitch radii, lengths; read off the drawing (centre to the point that the angle goes to) if not given.
            internal: whether the teeth of the larger wheel are inside.
            pressure_angle: rad; reactions then have the separating force F tan α beside the tangential force F.
        """
        what = f"gear pair {name!r}"
        self._new_joint(name)
        make = record.Gear if self.model.dim == 2 else record.BevelGear
        pressure = self._pressure(pressure_angle, what)
        self.model.joints[name] = make(*self._wheels(what, angle1, angle2, radii), bool(internal), pressure)
        return name

    def _pressure(self, angle: float | None, what: str) -> float | None:
        """A pressure angle, refused where it is none."""
        if angle is None:
            return None
        number = self._finite(angle, f"{what}: pressure_angle")
        if not 0.0 <= number < 1.0:
            raise MechanismError(
                f"{what}: pressure_angle={number:g} must be in radians, from 0 to below 1 (20° is 0.349)"
            )
        return number

    def _wheels(self, what: str, angle1: str, angle2: str, radii: tuple[float, float] | None):
        for a in (angle1, angle2):
            if a not in self.model.angles:
                raise MechanismError(f"{what}: unknown angle {a!r}; {nearest(a, self.model.angles)}")
        if angle1 == angle2:
            raise MechanismError(f"{what}: both wheels use the angle {angle1!r}; give each its own")
        given = None
        if radii is not None:
            try:
                first, second = radii
            except (TypeError, ValueError, OverflowError):
                raise MechanismError(f"{what}: radii= are two, one of each wheel; got {radii!r}") from None
            given = (self._positive(first, f"{what}: radius 1"), self._positive(second, f"{what}: radius 2"))
        return (angle1, angle2), given

    def rolling(
        self,
        name: str,
        centre: str,
        rim: str,
        contact: str,
        line: tuple[str, str],
        angle: str,
        distance: str,
        radius: float | None = None,
        form: str = "exact",
        axis: record.Direction | None = None,
    ) -> str:
        """Let a disc roll along a line without slip, on a fixed line (54)-(60) or a moving one (61)-(75).

        Creates the coordinates `angle` (of the rim point from the contact direction) and `distance` (of the contact
        point along the line). The disc itself is a body of `centre` and `rim`.

        Args:
            name: its name.
            centre: centre of the disc.
            rim: a point fixed to the disc, to measure its rotation.
            contact: the point of contact, a basic point of its own.
            line: two points of the body that the disc rolls on (in space also a point and a vector); the distance is
                counted from the first.
            angle: name of the new angle.
            distance: name of the new distance.
            radius: length; read off the drawing (centre to contact) if not given. The side follows the drawing.
            form: ``"exact"`` has no mirrored twin and is valid at every angle; ``"text"`` writes (55)-(60) or (67),
                (71)-(75) as they are printed (in the plane): the angle by its cosine, the distance by its x (by its y
                if the line is drawn steeper than 45°). They lose their grip where the angle is 0 or π.
            axis: in space: the disc's axis of rotation, across the line. The joint does not hold it there: share it
                with a body that does, or with the ground.
        """
        what = f"rolling joint {name!r}"
        self._new_joint(name)
        for p in (centre, rim, contact):
            self._known_point(p, what)
        self._distinct((centre, rim), what)
        self._distinct((centre, contact), what)
        line = self._axis_line(line, what)
        self._new_coordinates(angle, distance, what)
        if self.model.dim == 3:
            if axis is None:
                raise MechanismError(f"{what}: in space the disc needs its axis, axis='u' or two points")
            axis = self._direction(axis, what)
        elif axis is not None:
            self._in_space(f"{what}: axis=")
        if form not in (("exact", "text") if self.model.dim == 2 else ("exact",)):
            raise MechanismError(f"{what}: form={form!r}; use 'exact' or 'text'")
        r = None if radius is None else self._positive(radius, f"{what}: radius")
        text: record.TextForm = "text" if form == "text" else "exact"
        self.model.joints[name] = record.Rolling(centre, rim, contact, line, angle, distance, r, text, axis)
        return name

    def _new_coordinates(self, angle: str, distance: str, what: str) -> None:
        self._new_quantity(angle, f"{what}: angle")
        self._new_quantity(distance, f"{what}: distance")
        if angle == distance:
            raise MechanismError(f"{what}: angle and distance are both called {angle!r}")

    def skate(self, name: str, point: str, heading: tuple[str, str]) -> str:
        """In the plane: let a point move along a heading only, a skate or a wheel seen from above (nonholonomic).

        Its row is linear in velocities. Positions do not see it: counts, poses and sweeps are those of the mechanism
        without it, and it acts in `jaxnc.simulate`.

        Args:
            name: its name.
            point: the point that does not slip sideways.
            heading: two points of its body, from one to the other the direction it moves in.
        """
        what = f"skate {name!r}"
        self._new_joint(name)
        if self.model.dim == 3:
            raise MechanismError(f"{what}: in space use rolling_disc(), or constrain() with a RateKind")
        self._known_point(point, what)
        self.model.joints[name] = record.Skate(point, self._line(heading, what))
        return name

    def cable(self, name: str, points: Sequence[str], length: float | None = None) -> str:
        """Run an inextensible cable through points: the sum of its straight segments is constant (§3.3).

        Args:
            name: its name.
            points: the points it passes, at least two.
            length: its length; read off the drawing if not given.
        """
        what = f"cable {name!r}"
        self._new_joint(name)
        points = self._listed(points, self.all_points, what)
        if len(points) < 2:
            raise MechanismError(f"{what} needs at least two points, got {points}")
        for a, b in pairwise(points):
            self._distinct((a, b), what)
        self.model.joints[name] = record.Cable(
            points, None if length is None else self._positive(length, f"{what}: length")
        )
        return name

    def weld(self, name: str, body: str, other: str) -> str:
        """Make two bodies move as one, as they are drawn.

        Args:
            name: its name.
            body: a body; in the plane of at least two points.
            other: another body.
        """
        what = f"weld {name!r}"
        self._new_joint(name)
        for b in (body, other):
            if b not in self.model.bodies:
                raise MechanismError(f"{what}: unknown body {b!r}; {nearest(b, self.model.bodies)}")
        if body == other:
            raise MechanismError(f"{what}: a body cannot be welded to itself ({body!r})")
        self.model.joints[name] = record.Weld((body, other))
        return name
