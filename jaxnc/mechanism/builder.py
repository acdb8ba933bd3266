"""`Mechanism`, the only mutable object: names and numbers as the user draws them. No JAX here."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from jaxnc.errors import MechanismError, nearest
from jaxnc.mechanism import model as record
from jaxnc.types import Place

if TYPE_CHECKING:
    from pathlib import Path

    from jaxnc.constraints import Kind
    from jaxnc.system.system import System


class Mechanism:
    """A planar mechanism in natural coordinates, described piece by piece.

    Every method that creates something checks its names at once and returns the name, to be used in later calls.

    Args:
        name: what reports and pictures call it.
        dim: 2 (planar).
        description: a sentence for reports and files.
        length_unit: label of the length unit in reports and plots; numbers are never converted.
        angle_unit: ``"rad"`` or ``"deg"``: how reports and plots show angles. Python calls always take radians.
    """

    def __init__(
        self,
        name: str = "mechanism",
        dim: int = 2,
        description: str = "",
        length_unit: str = "m",
        angle_unit: str = "rad",
    ):
        if dim != 2:
            raise MechanismError(f"dim={dim!r}: mechanisms are planar (dim=2)")
        if angle_unit not in ("rad", "deg"):
            raise MechanismError(f"angle_unit={angle_unit!r}: use 'rad' or 'deg'")
        self.model = record.Model(
            name=str(name), description=description, units=record.Units(length=length_unit, angle=angle_unit)
        )
        self.kinds: dict[str, Kind] = {}

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        return self.model.name

    def __repr__(self) -> str:
        m = self.model
        return (
            f"Mechanism({m.name!r}: {len(m.ground)} ground points, {len(m.points)} points, {len(m.bodies)} bodies, "
            f"{len(m.angles) + len(m.distances)} mixed coordinates, {len(m.joints)} joints)"
        )

    # -- points -------------------------------------------------------------------------------------------------

    def ground(self, name: str, at: Place) -> str:
        """Add a point fixed to the ground.

        Args:
            name: its name.
            at: where it is drawn, ``(x, y)``, lengths.

        Returns:
            The name.

        Raises:
            MechanismError: name already taken, or coordinates that are not two finite numbers.
        """
        self._new_quantity(name, "ground point")
        self.model.ground[name] = self._place(at, f"ground point {name!r}")
        return name

    def point(self, name: str, at: Place, fixed: str = "") -> str:
        """Add a basic point.

        Args:
            name: its name.
            at: where it is drawn, ``(x, y)``, lengths.
            fixed: coordinates that never change: ``"x"``, ``"y"`` or ``"xy"``. They are eliminated, not constrained.

        Returns:
            The name.

        Raises:
            MechanismError: name already taken, bad coordinates, or `fixed` not made of axis names.
        """
        self._new_quantity(name, "point")
        place = self._place(at, f"point {name!r}")
        if set(fixed) - set("xy") or len(set(fixed)) != len(fixed):
            raise MechanismError(f"point {name!r}: fixed={fixed!r}; use 'x', 'y' or 'xy'")
        self.model.points[name] = record.Point(place, fixed) if fixed else place
        return name

    def marker(self, name: str, on: str, at: Place) -> str:
        """Add a marker: a point that rides on a body and adds no unknowns.

        Args:
            name: its name.
            on: the body it rides on.
            at: where it is drawn, ``(x, y)``, lengths.

        Returns:
            The name.

        Raises:
            MechanismError: name already taken, unknown body, bad coordinates.
        """
        self._new_quantity(name, "marker")
        if on not in self.model.bodies:
            raise MechanismError(f"marker {name!r}: unknown body {on!r}; {nearest(on, self.model.bodies)}")
        self.model.markers[name] = record.Marker(on, self._place(at, f"marker {name!r}"))
        return name

    # -- bodies and joints --------------------------------------------------------------------------------------

    def body(
        self,
        name: str,
        points: Sequence[str],
        lengths: Mapping[tuple[str, str], float] | None = None,
        local: Mapping[str, Place] | None = None,
        form: str = "exact",
        along: tuple[str, str] | None = None,
    ) -> str:
        """Add a rigid body.

        Its shape is read off the drawing, except for what is given here.

        Args:
            name: its name.
            points: its points, at least two; one is enough where the orientation is known (the point slides in a
                slot, is fixed in one coordinate, or `along` is given).
            lengths: explicit distances, ``{(B, C): 3.0}``.
            local: explicit places in the body's own frame (origin at its first point, x towards its second),
                ``{P: (0.07, 0.05)}``.
            form: ``"exact"``: further points as ``a d + b d⊥`` of the base segment d, never degenerate and without
                a mirrored twin; ``"text"``: three distances (24)-(26), proportionality where aligned (27)-(29),
                linear combinations of three points from the fourth on (30)-(34).
            along: for a body of one point, the line ``(C, D)`` whose direction it keeps.

        Returns:
            The name.

        Raises:
            MechanismError: duplicate name, unknown point, a point listed twice, a body listed twice, bad dimensions.
        """
        m, what = self.model, f"body {name!r}"
        self._new_name(name, m.bodies, "body")
        points = [points] if isinstance(points, str) else list(points)
        if not points:
            raise MechanismError(f"{what} has no points; give it at least two")
        for p in points:
            self._known_point(p, what)
        for p in points:
            if points.count(p) > 1:
                raise MechanismError(f"{what} lists point {p!r} twice; list each point once")
        for other, data in m.bodies.items():
            theirs = data.points if isinstance(data, record.Body) else data
            if set(theirs) == set(points):
                raise MechanismError(
                    f"{what} has the same points {points} as body {other!r}: the body is listed twice; remove one"
                )
        spec = record.Body(points)
        for pair, value in (lengths or {}).items():
            spec.lengths["-".join(self._length_pair(pair, points, what))] = self._positive(
                value, f"{what}: length {'-'.join(map(str, pair))}"
            )
        for p, place in (local or {}).items():
            if p not in points[2:]:
                raise MechanismError(
                    f"{what}: local={{{p!r}: …}}; local places are for its third and further points, {points[2:]}"
                )
            spec.local[p] = self._place(place, f"{what}, local place of {p!r}")
        if form not in ("exact", "text"):
            raise MechanismError(f"{what}: form={form!r}; use 'exact' or 'text'")
        spec.form = form
        if along is not None:
            if len(points) > 1:
                raise MechanismError(f"{what}: along= is for a body of one point; this one has {len(points)}")
            spec.along = self._line(along, what)
        m.bodies[name] = spec
        return name

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
        for a, b in zip(points, points[1:], strict=False):
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

    # -- mixed coordinates and relations ------------------------------------------------------------------------

    def angle(
        self,
        name: str,
        at: str | None = None,
        to: str | tuple[str, str] = "",
        start: str | tuple[str, str] | None = None,
        form: str = "exact",
    ) -> str:
        """Add an angle as a coordinate: signed, anticlockwise, smooth through any number of turns (§3.3.1).

        Args:
            name: its name.
            at: the point where the angle is; not needed if `to` (and `start`) are pairs of points.
            to: the point it goes to, or a pair (P, Q) for the direction from P to Q.
            start: the point or pair it starts from; the x axis if not given.
            form: ``"exact"``: one row valid at every angle; ``"cosine"`` (38), ``"sine"`` (39), ``"switched"``
                (fig. 17), ``"redundant"`` (both), ``"sum"``, ``"difference"``.

        Returns:
            The name.

        Raises:
            MechanismError: duplicate name, unknown point, no direction.
        """
        what = f"angle {name!r}"
        self._new_quantity(name, "angle")
        if form not in record.AngleForm.__args__:
            raise MechanismError(f"{what}: form={form!r}; use one of {', '.join(record.AngleForm.__args__)}")
        if not to:
            raise MechanismError(f"{what}: say what it goes to, to='B' or to=('A', 'B')")
        for end in (to, start):
            if isinstance(end, str):
                if at is None:
                    raise MechanismError(f"{what}: with a single point {end!r}, say where the angle is: at='A'")
                self._distinct((at, end), what)
            elif end is not None:
                self._line(end, what)
        if at is not None:
            self._known_point(at, what)
        self.model.angles[name] = record.Angle(_pair(to), at, _pair(start), form)
        return name

    def distance(
        self, name: str, start: str, to: str, along: str | tuple[str, str] | None = None, form: str = "exact"
    ) -> str:
        """Add a distance as a coordinate (§3.3.2).

        Args:
            name: its name.
            start: the point it is measured from.
            to: the point it is measured to.
            along: a point or pair that gives the line: the distance is then signed, the projection on the direction
                from `start` to that point (or from the first to the second of the pair). Without it the distance is
                the positive one between the points, (42b).
            form: with `along`: ``"exact"``: one row valid at every inclination; ``"x"`` (41), ``"y"`` (42),
                ``"switched"``, ``"redundant"``, ``"sum"``, ``"difference"``.

        Returns:
            The name.

        Raises:
            MechanismError: duplicate name, unknown point, no direction.
        """
        what = f"distance {name!r}"
        self._new_quantity(name, "distance")
        self._distinct((start, to), what)
        if form not in record.DistanceForm.__args__:
            raise MechanismError(f"{what}: form={form!r}; use one of {', '.join(record.DistanceForm.__args__)}")
        if along is None and form != "exact":
            raise MechanismError(f"{what}: form={form!r} needs a line; give along=")
        if isinstance(along, str):
            self._distinct((start, along), what)
        elif along is not None:
            self._line(along, what)
        self.model.distances[name] = record.Distance(start, to, _pair(along), form)
        return name

    def relation(self, terms: Mapping[str, float], constant: float | None = None, name: str | None = None) -> str:
        """Tie scalar coordinates by a linear relation, ``k1 s1 + … = constant``.

        Args:
            terms: factors by coordinate: angles, distances, or single coordinates of points such as ``"P.x"``.
            constant: right-hand side; read off the drawing if not given.
            name: its name; ``"relation 1"``, … if not given.
        """
        name = name or f"relation {len(self.model.relations) + 1}"
        what = f"relation {name!r}"
        self._new_name(name, self.model.relations, "relation")
        if not terms:
            raise MechanismError(f"{what} has no terms")
        for s, k in terms.items():
            self._known_scalar(s, what)
            self._finite(k, f"{what}: factor of {s!r}")
        if not any(terms.values()):
            raise MechanismError(f"{what}: all factors are zero")
        c = None if constant is None else self._finite(constant, f"{what}: constant")
        self.model.relations[name] = record.Relation({s: float(k) for s, k in terms.items()}, c)
        return name

    def constrain(
        self,
        kind: "Kind",
        points: Sequence[str] = (),
        scalars: Sequence[str] = (),
        constants: Mapping[str, float] | None = None,
        name: str | None = None,
    ) -> str:
        """Add a constraint of any kind, the catalogue's or the user's own (see `jaxnc.Kind`).

        Args:
            kind: the kind.
            points: names of the points of this instance, as many as the kind takes.
            scalars: names of its scalars.
            constants: explicit constants by name; the rest is read off the drawing.
            name: its name; ``"<kind> 1"``, … if not given.
        """
        name = name or f"{kind.name} {len(self.model.constraints) + 1}"
        what = f"constraint {name!r}"
        self._new_name(name, self.model.constraints, "constraint")
        if len(points) != kind.points or len(scalars) != kind.scalars or kind.vectors:
            raise MechanismError(
                f"{what}: kind {kind.name!r} takes {kind.points} points and {kind.scalars} scalars, "
                f"got {len(points)} and {len(scalars)}"
            )
        for p in points:
            self._known_point(p, what)
        for s in scalars:
            self._known_scalar(s, what)
        for c, value in (constants or {}).items():
            if c not in kind.constants:
                raise MechanismError(f"{what}: unknown constant {c!r}; {nearest(c, kind.constants)}")
            self._finite(value, f"{what}: constant {c!r}")
        if self.kinds.setdefault(kind.name, kind) != kind:
            raise MechanismError(f"{what}: another kind is already called {kind.name!r}; give yours its own name")
        self.model.constraints[name] = record.Constraint(
            kind.name, list(points), list(scalars), {k: float(v) for k, v in (constants or {}).items()}
        )
        return name

    # -- out ----------------------------------------------------------------------------------------------------

    def compile(self) -> "System":
        """Check the whole description and turn it into an immutable `System`.

        Returns:
            The system, whose parameters are what is drawn and the explicit dimensions.

        Raises:
            MechanismError: no points, a segment without length where a direction is needed, lengths that no triangle
                has, a body of one point whose orientation is not known; also when 64-bit numbers are off.
        """
        from jaxnc.solvers.assembly import with_degrees_of_freedom
        from jaxnc.system.assemble import assemble

        return with_degrees_of_freedom(assemble(self))

    def save(self, path: "str | Path") -> None:
        """Write the description to a TOML or JSON model file (`jaxnc.load` reads it back).

        Args:
            path: file name ending in ``.toml`` or ``.json``.

        Raises:
            OutputError: if the file cannot be written.
            MechanismError: if the mechanism uses kinds that are not in the catalogue.
        """
        from jaxnc.io.files import save

        save(self, path)

    # -- checks -------------------------------------------------------------------------------------------------

    @property
    def all_points(self) -> tuple[str, ...]:
        """Names of ground points and points, in order."""
        return (*self.model.ground, *self.model.points)

    @property
    def scalar_names(self) -> tuple[str, ...]:
        """Names of the mixed coordinates, in order: angles, distances, then those of rolling joints."""
        rolling = [j for j in self.model.joints.values() if isinstance(j, record.Rolling)]
        return (*self.model.angles, *self.model.distances, *(s for j in rolling for s in (j.angle, j.distance)))

    def _known_point(self, name: str, what: str) -> None:
        if name not in self.model.ground and name not in self.model.points:
            if name in self.model.markers:
                raise MechanismError(
                    f"{what}: {name!r} is a marker, which only rides on a body; make it a point of that body instead"
                )
            raise MechanismError(f"{what}: unknown point {name!r}; {nearest(name, self.all_points)}")

    def _known_scalar(self, name: str, what: str) -> None:
        point, _, axis = name.partition(".")
        if name in self.scalar_names or (axis in ("x", "y") and point in self.all_points):
            return
        hint = nearest(name, (*self.scalar_names, *(f"{p}.{a}" for p in self.all_points for a in "xy")))
        raise MechanismError(f"{what}: unknown coordinate {name!r}; {hint}")

    def _new_quantity(self, name: str, noun: str) -> None:
        m = self.model
        if not isinstance(name, str) or not name or set(name) & set(".- \t\n,"):
            raise MechanismError(f"{noun} {name!r}: names are non-empty and without dots, dashes, commas or spaces")
        for what, taken in (
            ("ground point", m.ground),
            ("point", m.points),
            ("marker", m.markers),
            ("coordinate", self.scalar_names),
        ):
            if name in taken:
                raise MechanismError(f"{noun} {name!r}: the name is already taken by a {what}; choose another")

    def _new_name(self, name: str, taken: Iterable[str], noun: str) -> None:
        if not isinstance(name, str) or not name:
            raise MechanismError(f"{noun} {name!r}: names are non-empty strings")
        if name in taken:
            raise MechanismError(f"{noun} {name!r}: the name is already taken by another {noun}; choose another")

    def _new_joint(self, name: str) -> None:
        self._new_name(name, self.model.joints, "joint")

    def _place(self, at: Any, what: str) -> tuple[float, ...]:
        try:
            place = tuple(float(x) for x in at)
        except (TypeError, ValueError):
            place = ()
        if len(place) != self.model.dim:
            raise MechanismError(f"{what}: its place must be {self.model.dim} numbers, got {at!r}")
        for x in place:
            self._finite(x, what)
        return place

    def _finite(self, value: Any, what: str) -> float:
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise MechanismError(f"{what} must be a number, got {value!r}") from None
        if not math.isfinite(number):
            raise MechanismError(f"{what} must be a finite number, got {value!r}")
        return number

    def _positive(self, value: Any, what: str) -> float:
        number = self._finite(value, what)
        if number <= 0:
            raise MechanismError(f"{what} must be positive, got {value!r}")
        return number

    def _distinct(self, pair: tuple[str, str], what: str) -> None:
        for p in pair:
            self._known_point(p, what)
        if pair[0] == pair[1]:
            raise MechanismError(f"{what} needs two different points, got {pair[0]!r} twice")

    def _line(self, line: Any, what: str) -> tuple[str, str]:
        if isinstance(line, str) or len(line) != 2:
            raise MechanismError(f"{what}: a line is given by two points, got {line!r}")
        pair = (line[0], line[1])
        self._distinct(pair, what)
        return pair

    def _length_pair(self, pair: Any, points: list[str], what: str) -> tuple[str, str]:
        if isinstance(pair, str) or len(pair) != 2:
            raise MechanismError(f"{what}: a length is between two points, got {pair!r}; write {{('B', 'C'): 3.0}}")
        for p in pair:
            if p not in points:
                raise MechanismError(f"{what}: length between {pair}: {p!r} is not one of its points {points}")
        if pair[0] == pair[1]:
            raise MechanismError(f"{what}: length between {pair[0]!r} and itself")
        return (pair[0], pair[1])


def _pair(end: Any) -> Any:
    return tuple(end) if isinstance(end, (list, tuple)) else end
