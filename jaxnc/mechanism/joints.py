"""Joints that sharing a point does not already give, as builder methods."""

from collections.abc import Sequence
from itertools import pairwise

from jaxnc.errors import MechanismError, nearest
from jaxnc.mechanism import model as record
from jaxnc.mechanism.checked import CheckedModel


class JointBuilder(CheckedModel):
    """The part of `Mechanism` that adds joints."""

    def revolute(self, name: str, point: str, other: str) -> str:
        """Pin two bodies that each have a point of their own (shared points need no joint).

        Args:
            name: its name.
            point: a point of one body.
            other: the point of the other body that coincides with it.
        """
        self._new_joint(name)
        self._distinct((point, other), f"revolute joint {name!r}")
        self.model.joints[name] = record.Revolute((point, other))
        return name

    def prismatic(self, name: str, line: tuple[str, str], on: tuple[str, str], form: str = "exact") -> str:
        """Let a body slide along a line of another without turning relative to it, (35)-(36).

        Args:
            name: its name.
            line: two points of one body that define the line.
            on: two points of the sliding body; the first one lies on the line.
            form: ``"exact"`` keeps its rank at every angle (erratum 9); ``"text"`` is the scalar product (36).
        """
        what = f"prismatic joint {name!r}"
        self._new_joint(name)
        if form not in ("exact", "text"):
            raise MechanismError(f"{what}: form={form!r}; use 'exact' or 'text'")
        self.model.joints[name] = record.Prismatic(self._line(line, what), self._line(on, what), form)
        return name

    def slot(self, name: str, point: str, line: tuple[str, str]) -> str:
        """Let a pin slide along a line (special prismatic joint, pin in slot), (37).

        Args:
            name: its name.
            point: the pin.
            line: two points of the body that carries the slot.
        """
        what = f"slot {name!r}"
        self._new_joint(name)
        self._known_point(point, what)
        line = self._line(line, what)
        if point in line:
            raise MechanismError(f"{what}: point {point!r} is one of the points of its own line {line}")
        self.model.joints[name] = record.Slot(point, line)
        return name

    def gear(
        self, name: str, angle1: str, angle2: str, radii: tuple[float, float] | None = None, internal: bool = False
    ) -> str:
        """Mesh two wheels, (47): ``R1 φ1 + R2 φ2 = c`` external, ``R1 φ1 - R2 φ2 = c`` internal.

        Args:
            name: its name.
            angle1: angle of the first wheel, measured at its centre from the line of centres (or from any direction
                that keeps its angle to it).
            angle2: angle of the second wheel, measured likewise.
            radii: pitch radii, lengths; read off the drawing (centre to the point that the angle goes to) if not given.
            internal: whether the teeth of the larger wheel are inside.
        """
        what = f"gear pair {name!r}"
        self._new_joint(name)
        for a in (angle1, angle2):
            if a not in self.model.angles:
                raise MechanismError(f"{what}: unknown angle {a!r}; {nearest(a, self.model.angles)}")
        if angle1 == angle2:
            raise MechanismError(f"{what}: both wheels use the angle {angle1!r}; give each its own")
        given = None
        if radii is not None:
            given = (self._positive(radii[0], f"{what}: radius 1"), self._positive(radii[1], f"{what}: radius 2"))
        self.model.joints[name] = record.Gear((angle1, angle2), given, bool(internal))
        return name

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
    ) -> str:
        """Let a disc roll along a line without slip, on a fixed line (54)-(60) or a moving one (61)-(75).

        Creates the coordinates `angle` (of the rim point from the contact direction) and `distance` (of the contact
        point along the line). The disc itself is a body of `centre` and `rim`.

        Args:
            name: its name.
            centre: centre of the disc.
            rim: a point fixed to the disc, to measure its rotation.
            contact: the point of contact, a basic point of its own.
            line: two points of the body that the disc rolls on; the distance is counted from the first.
            angle: name of the new angle.
            distance: name of the new distance.
            radius: length; read off the drawing (centre to contact) if not given. The side follows the drawing.
            form: ``"exact"`` has no mirrored twin; ``"text"`` writes (55) and (57).
        """
        what = f"rolling joint {name!r}"
        self._new_joint(name)
        for p in (centre, rim, contact):
            self._known_point(p, what)
        self._distinct((centre, rim), what)
        self._distinct((centre, contact), what)
        line = self._line(line, what)
        self._new_quantity(angle, "angle")
        self._new_quantity(distance, "distance")
        if angle == distance:
            raise MechanismError(f"{what}: angle and distance are both called {angle!r}")
        if form not in ("exact", "text"):
            raise MechanismError(f"{what}: form={form!r}; use 'exact' or 'text'")
        r = None if radius is None else self._positive(radius, f"{what}: radius")
        self.model.joints[name] = record.Rolling(centre, rim, contact, line, angle, distance, r, form)
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
        points = list(points)
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
            body: a body of at least two points.
            other: another body of at least two points.
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
