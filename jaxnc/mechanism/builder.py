"""`Mechanism`, the only mutable object: names and numbers as the user draws them. No JAX here."""

import copy
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NoReturn, get_args

import msgspec
import numpy as np

from jaxnc.calls import public
from jaxnc.doors import door
from jaxnc.errors import CallError, MechanismError, brief, nearest
from jaxnc.mechanism import model as record
from jaxnc.mechanism.checks import Checks
from jaxnc.mechanism.model import Place
from jaxnc.notebooks import Drawn
from jaxnc.pickling import Remade

if TYPE_CHECKING:
    from pathlib import Path

    from jaxnc.constraints import Kind, RateKind
    from jaxnc.forces import ForceKind
    from jaxnc.kinematics.motion import Motion
    from jaxnc.robots import Exported
    from jaxnc.system.system import System

_SIZES = {  # of a shape, in the plane and in space
    "rod": ((), ()),
    "plate": ((), ()),
    "box": (("a", "b"), ("a", "b", "c")),
    "cylinder": (("radius",), ("radius", "length")),
    "sphere": (("radius",), ("radius",)),
}


@dataclass(frozen=True)
class Acting(Remade):
    """A function that is a force."""

    noun = "force"
    name: str
    function: Callable


class Fall(tuple):
    """Acceleration of free fall, empty for none. Calling it raises an error that says how to set it."""

    __slots__ = ()

    def __call__(self, *given: object, **named: object) -> NoReturn:
        """Refuse, in words."""
        raise CallError(
            "gravity is set, not called: m.gravity = (0, -9.81), or (0, 0, -9.81) in space; its length unit is that of "
            "the drawing"
        )


@public
class Mechanism(Drawn):
    """A planar or spatial mechanism in natural coordinates, described piece by piece.

    Every method that creates something checks its names at once and returns the name, to be used in later calls.

    Args:
        name: what reports and pictures call it.
        dim: 2 (planar) or 3 (spatial).
        description: a sentence for reports and files.
        length_unit: label of the length unit in reports and plots; numbers are never converted.
        angle_unit: ``"rad"`` or ``"deg"``: how reports and plots show angles. Python calls always take radians.
    """

    _KEPT = "model", "kinds", "force_kinds", "functions", "members"

    def __init__(
        self,
        name: str = "mechanism",
        dim: int = 2,
        description: str = "",
        length_unit: str = "m",
        angle_unit: str = "rad",
    ):
        if not isinstance(name, str):
            raise MechanismError(
                f"a mechanism's name is text, got {brief(name)}; one in space is Mechanism('name', dim=3)"
            )
        if not isinstance(dim, int) or dim not in (2, 3):
            raise MechanismError(f"dim={brief(dim)}: mechanisms are planar (dim=2) or spatial (dim=3)")
        if not isinstance(angle_unit, str) or angle_unit not in ("rad", "deg"):
            raise MechanismError(f"angle_unit={brief(angle_unit)}: use 'rad' or 'deg'")
        for noun, text in (("name", name), ("description", description), ("length_unit", length_unit)):
            if not isinstance(text, str):
                raise MechanismError(f"a mechanism's {noun} is text, got {brief(text)}")
            Checks.text(text, noun)
        if set(length_unit) & set("[]") or not length_unit.isprintable():
            raise MechanismError(f"length_unit={length_unit!r}: tables write it in brackets; use a word such as 'mm'")
        units = record.Units(length=length_unit, angle=angle_unit)
        self.model = record.Model(name=name, dim=dim, description=description, units=units)
        self.kinds: "dict[str, Kind | RateKind]" = {}
        self.force_kinds: dict[str, ForceKind] = {}
        self.functions: dict[str, tuple[Acting, Any]] = {}
        self.members: dict[tuple[frozenset, frozenset], str] = {}

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        return self.model.name

    @property
    def all_points(self) -> tuple[str, ...]:
        """Names of ground points and points, in order."""
        return self.model.all_points

    @property
    def all_vectors(self) -> tuple[str, ...]:
        """Names of ground vectors and vectors, in order."""
        return self.model.all_vectors

    @property
    def axes(self) -> str:
        """The axes of the mechanism's space, ``"xy"`` or ``"xyz"``."""
        return self.model.axes

    @property
    def scalar_names(self) -> tuple[str, ...]:
        """Names of the mixed coordinates, in order: angles, distances, then those of rolling and screw joints."""
        return self.model.scalar_names

    @property
    def _check(self) -> Checks:
        """The checks of what is given, against the model as it is."""
        return Checks(self.model)

    def __setattr__(self, name: str, value: object) -> None:
        if name not in self._KEPT and not hasattr(type(self), name):
            raise MechanismError(
                f"a mechanism has nothing called {name!r} that could be set; {nearest(name, ('gravity',))}"
            )
        super().__setattr__(name, value)

    def __repr__(self) -> str:
        m = self.model
        return (
            f"Mechanism({m.name!r}: {len(m.ground)} ground points, {len(m.points)} points, "
            + (f"{len(self.all_vectors)} vectors, " if m.dim == 3 else "")
            + f"{len(m.bodies)} bodies, "
            f"{len(m.angles) + len(m.distances)} mixed coordinates, {len(m.joints)} joints)"
        )

    # -- points -------------------------------------------------------------------------------------------------

    def ground(self, name: str, at: Place) -> str:
        """Add a point fixed to the ground.

        Args:
            name: its name.
            at: where it is drawn, ``(x, y)`` or ``(x, y, z)``, lengths.

        Raises:
            MechanismError: name already taken, or coordinates that are not two (three) finite numbers.
        """
        self._check.new_quantity(name, "ground point")
        self.model.ground[name] = self._check.place(at, f"ground point {name!r}")
        return name

    def point(self, name: str, at: Place, fixed: str = "") -> str:
        """Add a basic point.

        Args:
            name: its name.
            at: where it is drawn, ``(x, y)`` or ``(x, y, z)``, lengths.
            fixed: coordinates that never change, such as ``"y"`` or ``"xz"``. They are eliminated, not constrained.

        Raises:
            MechanismError: name already taken, bad coordinates, or `fixed` not made of axis names.
        """
        self._check.new_quantity(name, "point")
        place = self._check.place(at, f"point {name!r}")
        if set(fixed) - set(self.axes) or len(set(fixed)) != len(fixed):
            raise MechanismError(f"point {name!r}: fixed={fixed!r}; use some of the axes {', '.join(self.axes)}")
        self.model.points[name] = record.Point(place, fixed) if fixed else place
        return name

    def ground_vector(self, name: str, direction: Place) -> str:
        """Add a unit vector fixed to the ground (in space).

        Args:
            name: its name.
            direction: components, ``(x, y, z)``; only the direction counts, it is normalised.

        Raises:
            MechanismError: name already taken, a zero vector, or components that are not three finite numbers.
        """
        self._check.in_space(f"ground vector {name!r}", "in the plane points are enough")
        self._check.new_quantity(name, "ground vector")
        self.model.ground_vectors[name] = self._check.unit(direction, f"ground vector {name!r}")
        return name

    def vector(self, name: str, direction: Place) -> str:
        """Add a unit vector as a natural coordinate (in space): an axis, or the orientation of a body.

        Args:
            name: its name.
            direction: components as drawn, ``(x, y, z)``; only the direction counts, it is normalised.

        Raises:
            MechanismError: name already taken, a zero vector, or components that are not three finite numbers.
        """
        self._check.in_space(f"vector {name!r}", "in the plane points are enough")
        self._check.new_quantity(name, "vector")
        self.model.vectors[name] = self._check.unit(direction, f"vector {name!r}")
        return name

    def marker(self, name: str, on: str, at: Place | None = None, direction: Place | None = None) -> str:
        """Add a marker: a point, or in space a unit vector, that rides on a body and adds no unknowns.

        Args:
            name: its name.
            on: the body it rides on.
            at: where it is drawn, ``(x, y)`` or ``(x, y, z)``, lengths.
            direction: instead of `at`: the components of a unit vector as drawn; only the direction counts.

        Raises:
            MechanismError: name already taken, unknown body, bad coordinates, both or none of `at` and `direction`.
        """
        what = f"marker {name!r}"
        self._check.new_quantity(name, "marker")
        self._check.refuse_unknown(on, self.model.bodies, "body", what)
        if (at is None) == (direction is None):
            raise MechanismError(f"{what}: say where it is drawn with at=, or give a unit vector with direction=")
        if direction is not None:
            self._check.in_space(f"{what}, a direction,")
            self.model.markers[name] = record.Marker(on, direction=self._check.unit(direction, what))
        else:
            self.model.markers[name] = record.Marker(on, self._check.place(at, what))
        return name

    # -- bodies --------------------------------------------------------------------------------------

    def body(
        self,
        name: str,
        points: Sequence[str],
        lengths: Mapping[tuple[str, str], float] | None = None,
        local: Mapping[str, Place] | None = None,
        form: str = "exact",
        along: tuple[str, str] | None = None,
        vectors: Sequence[str] = (),
        mass: float | None = None,
        com: Place | None = None,
        inertia: "float | Sequence[float] | Sequence[Sequence[float]] | np.ndarray | None" = None,
        shape: str | None = None,
        size: Sequence[float] = (),
    ) -> str:
        """Add a rigid body.

        Its shape is read off the drawing, except for what is given here. In space a body needs an orientation: two
        directions, each between two of its points or one of its vectors. With all of them in one line it is a bar of
        five freedoms, which does not know its rotation about that line.

        Args:
            name: its name.
            points: its points, at least two in the plane; one is enough where the orientation is known (the point
                slides in a slot, is fixed in one coordinate, or `along` is given). In space at least one.
            lengths: explicit distances, ``{(B, C): 3.0}``.
            local: in the plane: explicit places in the body's own frame (origin at its first point, x towards its
                second), ``{P: (0.07, 0.05)}``.
            form: ``"exact"``: further points and vectors as a combination of the first segments and the direction
                across them, never degenerate and without a mirrored twin; ``"text"``: in the plane three distances
                (24)-(26), proportionality where aligned (27)-(29), linear combinations of three points from the
                fourth on (30)-(34); in space a base of three segments with six equations (104)-(109), (116)-(121),
                two with three where all are in one plane (110)-(112), and linear combinations for the rest
                (113)-(115), (122)-(127).
            along: in the plane: for a body of one point, the line ``(C, D)`` whose direction it keeps.
            vectors: in space: its unit vectors.
            mass: its mass, kg; with two points and nothing else said, that of a uniform rod between them.
            com: where its centre of mass is drawn.
            inertia: its inertia about the centre of mass, kg m²: a number in the plane; in space a matrix ``(3, 3)`` in
                the axes of the drawing, its diagonal, or ``(xx, yy, zz, xy, xz, yz)``.
            shape: instead of inertia, a uniform ``"rod"`` between its first two points, ``"plate"`` with its points as
                corners, ``"box"``, ``"cylinder"`` (a disc in the plane) or ``"sphere"`` around the middle of its points
                (or `com`): the first edge or the axis from its first point to the next, or along its first vector;
                the second edge towards what is listed after that, points before vectors.
            size: edges of a box; radius, in space and length, of a cylinder; radius of a sphere.

        Raises:
            MechanismError: duplicate name, unknown point or vector, one listed twice, a body listed twice, bad
                dimensions, no orientation.

        Source: source text, (22)-(34) in the plane, (88)-(127) in space.
        """
        m, what = self.model, f"body {name!r}"
        self._check.new_name(name, m.bodies, "body")
        if name == "ground":
            raise MechanismError(f"{what}: 'ground' stands for the ground itself; choose another name")
        for option, given in (("lengths", lengths), ("local", local)):
            if given is not None and not isinstance(given, Mapping):
                usual = "{('A', 'B'): 3.0}" if option == "lengths" else "{'P': (0.07, 0.05)}"
                raise MechanismError(
                    f"{what}: {option}= takes numbers by name such as {usual}, got {given!r}; all points of a body "
                    f"stand in one list, body({name!r}, ['A', 'B'])"
                )
        points = self._check.names(points, self.all_points, what)
        vectors = self._check.names(vectors, self.all_vectors, what, "vector")
        if not points:
            raise MechanismError(f"{what} has no points; give it at least {'two' if m.dim == 2 else 'one'}")
        for p in points:
            if p in self.model.all_vectors:
                raise MechanismError(f"{what}: {p!r} is a vector, no point: list it in vectors=[{p!r}]")
            self._check.point(p, what)
        if vectors:
            self._check.in_space(f"{what}: vectors=")
        for u in vectors:
            self._check.vector(u, what)
        for noun, members in (("point", points), ("vector", vectors)):
            for p in members:
                if members.count(p) > 1:
                    raise MechanismError(f"{what} lists {noun} {p!r} twice; list each {noun} once")
        other = self._bodies_by_members().get((frozenset(points), frozenset(vectors)))
        if other is not None:
            listed = f"points {points}" + (f" and vectors {vectors}" if vectors else "")
            raise MechanismError(
                f"{what} has the same {listed} as body {other!r}: the body is listed twice; remove one"
            )
        if m.dim == 3 and len(points) + len(vectors) < 2:
            raise MechanismError(
                f"{what} has only the point {points[0]!r}, so it has no orientation: give it a second point (a bar), "
                f"or two vectors, a point and a vector, or two points"
            )
        spec = record.Body(points, vectors)
        for pair, value in (lengths or {}).items():
            spec.lengths["-".join(self._check.length_pair(pair, points, what))] = self._check.positive(
                value, f"{what}: length {'-'.join(map(str, pair))}"
            )
        for p, place in (local or {}).items():
            if m.dim == 3:
                raise MechanismError(f"{what}: local= is for planar bodies; in space draw the point where it is")
            if p not in points[2:]:
                raise MechanismError(
                    f"{what}: local={{{p!r}: …}}; local places are for its third and further points, {points[2:]}"
                )
            spec.local[p] = self._check.place(place, f"{what}, local place of {p!r}")
        if form not in ("exact", "text"):
            raise MechanismError(f"{what}: form={form!r}; use 'exact' or 'text'")
        spec.form = form
        if along is not None:
            if len(points) > 1 or m.dim == 3:
                raise MechanismError(f"{what}: along= is for a planar body of one point; this one has {len(points)}")
            spec.along = self._check.line(along, what)
        self._inertia(spec, what, mass, com, inertia, shape, size)
        m.bodies[name] = spec
        self.members[frozenset(points), frozenset(vectors)] = name
        return name

    def _bodies_by_members(self) -> dict[tuple[frozenset, frozenset], str]:
        """Which body has which points and vectors; made anew when the model was changed from outside."""
        if len(self.members) != len(self.model.bodies):
            specs = {name: record.whole(body) for name, body in self.model.bodies.items()}
            self.members = {(frozenset(b.points), frozenset(b.vectors)): n for n, b in specs.items()}
        return self.members

    # -- mixed coordinates, relations and own constraints -------------------------------------------------------------

    def angle(
        self,
        name: str,
        at: str | None = None,
        to: record.Direction = "",
        start: record.Direction | None = None,
        form: record.AngleForm = "exact",
        about: record.Direction | None = None,
    ) -> str:
        """Add an angle as a coordinate: signed, smooth through any number of turns (§3.3.1, §4.3.1).

        In the plane it is anticlockwise; in space it is counted about an axis by the right-hand rule, between the
        projections of its two directions on the plane across the axis.

        Args:
            name: its name.
            at: the point where the angle is; not needed if `to` (and `start`) are pairs of points or vectors.
            to: the point it goes to, or a pair (P, Q) for the direction from P to Q, or a vector.
            start: the point, pair or vector it starts from. If not given: in the plane the x axis; in space, about an
                axis of the ground, the drawn direction of `to`, so that the angle is zero in the drawing.
            form: ``"exact"``: one row valid at every angle; ``"cosine"`` (38), (143); ``"sine"`` (39), (144)-(146)
                along the axis; ``"switched"`` (fig. 17); ``"redundant"`` (all); in the plane ``"sum"`` and
                ``"difference"``; in space ``"sine x"`` (144), ``"sine y"`` (145), ``"sine z"`` (146), best along the
                axis's largest component, and ``"sines"``, all three.
            about: in space: the axis, a vector or a pair of points.

        Raises:
            MechanismError: duplicate name, unknown point or vector, no direction, no axis.

        Source: source text, (38)-(40), where the forms but ``"exact"`` lose their grip; (143)-(146).
        """
        what = f"angle {name!r}"
        self._check.new_quantity(name, "angle")
        spatial = self.model.dim == 3
        forms = record.angle_forms(self.model.dim)
        if form not in forms:
            raise MechanismError(f"{what}: form={form!r}; use one of {', '.join(forms)}")
        if isinstance(to, str) and not to:
            raise MechanismError(f"{what}: say what it goes to, to='B' or to=('A', 'B')")
        if spatial and about is None:
            raise MechanismError(f"{what}: in space an angle is about an axis; give about=, a vector or two points")
        if about is not None:
            self._check.in_space(f"{what}: about=", "in the plane angles are anticlockwise")
            about = self._check.direction(about, what)
        for end in (to, start):
            if isinstance(end, str) and end not in self.all_vectors:
                if at is None:
                    raise MechanismError(f"{what}: with a single point {end!r}, say where the angle is: at='A'")
                self._check.distinct((at, end), what)
            elif end is not None:
                self._check.direction(end, what)
        if at is not None:
            self._check.point(at, what)
        self.model.angles[name] = record.Angle(_as_pair(to), at, _as_pair(start), form, about)
        return name

    def distance(
        self,
        name: str,
        start: str,
        to: str,
        along: record.Direction | None = None,
        form: record.DistanceForm = "exact",
    ) -> str:
        """Add a distance as a coordinate (§3.3.2, §4.3.2).

        Args:
            name: its name.
            start: the point it is measured from.
            to: the point it is measured to.
            along: a point, pair or vector that gives the line: the distance is then signed, the projection on the
                direction from `start` to that point (or from the first to the second of the pair, or of the vector).
                Without it the distance is the positive one between the points, (42b), (150).
            form: with `along`: ``"exact"``: one row valid at every inclination; ``"x"`` (41), (147), ``"y"`` (42),
                (148), ``"z"`` (149), ``"switched"``, ``"redundant"``, in the plane ``"sum"``, ``"difference"``.

        Raises:
            MechanismError: duplicate name, unknown point or vector, no direction.
        """
        what = f"distance {name!r}"
        self._check.new_quantity(name, "distance")
        self._check.distinct((start, to), what)
        forms = record.distance_forms(self.model.dim)
        if form not in forms:
            raise MechanismError(f"{what}: form={form!r}; use one of {', '.join(forms)}")
        if along is None and form != "exact":
            raise MechanismError(f"{what}: form={form!r} needs a line; give along=")
        if isinstance(along, str) and along not in self.all_vectors:
            self._check.distinct((start, along), what)
        elif along is not None:
            self._check.direction(along, what)
        self.model.distances[name] = record.Distance(start, to, _as_pair(along), form)
        return name

    def relation(self, name: str, terms: Mapping[str, float], constant: float | None = None) -> str:
        """Tie scalar coordinates by a linear relation, ``k1 s1 + … = constant``.

        Args:
            name: its name.
            terms: factors by coordinate: angles, distances, or single coordinates of points such as ``"P.x"``.
            constant: right-hand side; read off the drawing if not given.
        """
        what = f"relation {name!r}"
        self._check.new_name(name, self.model.relations, "relation")
        if not isinstance(terms, Mapping):
            raise MechanismError(f"{what}: terms= takes factors by name such as {{'phi': 1, 'P.x': -2}}, got {terms!r}")
        if not terms:
            raise MechanismError(f"{what} has no terms")
        for s, k in terms.items():
            self._check.scalar(s, what)
            self._check.finite(k, f"{what}: factor of {s!r}")
        if not any(terms.values()):
            raise MechanismError(f"{what}: all factors are zero")
        if constant is not None and "constant" in terms:
            raise MechanismError(
                f"{what}: its constant and the factor of the coordinate 'constant' would both be addressed as "
                f"'{name}.constant'; call the coordinate something else, or leave constant= out"
            )
        c = None if constant is None else self._check.finite(constant, f"{what}: constant")
        self.model.relations[name] = record.Relation({s: float(k) for s, k in terms.items()}, c)
        return name

    def constrain(
        self,
        name: str,
        kind: "Kind | RateKind",
        points: Sequence[str] = (),
        vectors: Sequence[str] = (),
        scalars: Sequence[str] = (),
        constants: Mapping[str, float] | None = None,
    ) -> str:
        """Add a constraint of any kind, the catalogue's or your own (`Kind`, `RateKind` of `constraints`).

        Args:
            name: its name.
            kind: the kind.
            points: names of the points of this instance, as many as the kind takes.
            vectors: names of its unit vectors.
            scalars: names of its scalars.
            constants: explicit constants by name; the rest is read off the drawing.
        """
        what = f"constraint {name!r}"
        self._check.new_name(name, self.model.constraints, "constraint")
        if not hasattr(kind, "scalars"):
            raise MechanismError(f"{what}: after its name comes a kind of constraint, a Kind; got {kind!r}")
        given = self._check_instance(self.kinds, kind, what, points, vectors, scalars, constants, "constant")
        self.model.constraints[name] = record.Constraint(kind.name, *given)
        return name

    def _check_instance(
        self,
        kinds: dict,
        kind: "Kind | RateKind | ForceKind",
        what: str,
        points: Sequence[str],
        vectors: Sequence[str],
        scalars: Sequence[str],
        values: Mapping[str, float] | None,
        noun: str,
    ) -> tuple[list[str], list[str], list[str], dict[str, float]]:
        """Check the points, vectors, scalars and values of an instance of a kind, which is then one of `kinds`.

        `noun` is what the kind calls its values, "constant" or "parameter".
        """
        points = self._check.names(points, self.all_points, what)
        vectors = self._check.names(vectors, self.all_vectors, what, "vector")
        scalars = self._check.names(scalars, self.scalar_names, what, "scalar")
        counts = {
            "points": (kind.points, len(points)),
            "vectors": (kind.vectors, len(vectors)),
            "scalars": (kind.scalars, len(scalars)),
        }
        if any(takes != given for takes, given in counts.values()):
            asked = {name: both for name, both in counts.items() if any(both)}
            takes = ", ".join(f"{takes} {name}" for name, (takes, _) in asked.items())
            given = ", ".join(str(given) for _, given in asked.values())
            raise MechanismError(f"{what}: kind {kind.name!r} takes {takes}, got {given}")
        for names, check in ((points, self._check.point), (vectors, self._check.vector), (scalars, self._check.scalar)):
            for one in names:
                check(one, what)
        known, positive, checked = getattr(kind, f"{noun}s"), getattr(kind, "positive", ()), {}
        for key, value in (values or {}).items():
            self._check.refuse_unknown(key, known, noun, what)
            check = self._check.not_negative if key in positive else self._check.finite
            checked[key] = check(value, f"{what}: {key}")
        if kinds.setdefault(kind.name, kind) != kind:
            raise MechanismError(f"{what}: another kind is already called {kind.name!r}; give yours its own name")
        return points, vectors, scalars, checked

    # -- joints -------------------------------------------------------------------------------------------------------

    def add_joint(self, name: str, joint: record.Joint) -> str:
        """Add a joint by its record, as a model file holds it; the methods below make these records.

        Args:
            name: its name.
            joint: a record of `jaxnc.mechanism.model`.
        """
        what = f"{joint.noun} {name!r}"
        if joint.in_plane is not None:
            self._check.in_space(what, joint.in_plane)
        self._check.new_name(name, self.model.joints, "joint")
        self.model.joints[name] = joint.check(self._check, what)
        return name

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
        return self.add_joint(name, record.Revolute(_coincident(point, other), axes))

    def prismatic(
        self,
        name: str,
        line: tuple[str, str],
        on: str | tuple[str, str],
        form: record.TextForm = "exact",
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
        return self.add_joint(name, record.Prismatic(line, on, directions, form))

    def slot(self, name: str, point: str, line: tuple[str, str]) -> str:
        """Let a pin slide along a line (special prismatic joint, pin in slot), (37).

        Args:
            name: its name.
            point: the pin.
            line: two points of the body that carries the slot; in space also a point and a vector.
        """
        return self.add_joint(name, record.Slot(point, line))

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
        return self.add_joint(name, record.Gear((angle1, angle2), radii, internal, pressure_angle))

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
        form: record.TextForm = "exact",
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
        return self.add_joint(name, record.Rolling(centre, rim, contact, line, angle, distance, radius, form, axis))

    def skate(self, name: str, point: str, heading: tuple[str, str]) -> str:
        """In the plane: let a point move along a heading only, a skate or a wheel seen from above (nonholonomic).

        Its row is linear in velocities. Positions do not see it: counts, poses and sweeps are those of the mechanism
        without it, and it acts in `jaxnc.simulate`.

        Args:
            name: its name.
            point: the point that does not slip sideways.
            heading: two points of its body, from one to the other the direction it moves in.
        """
        return self.add_joint(name, record.Skate(point, heading))

    def cable(self, name: str, points: Sequence[str], length: float | None = None) -> str:
        """Run an inextensible cable through points: the sum of its straight segments is constant (§3.3).

        Args:
            name: its name.
            points: the points it passes, at least two.
            length: its length; read off the drawing if not given.
        """
        return self.add_joint(name, record.Cable(points, length))  # pyright: ignore[reportArgumentType]

    def weld(self, name: str, body: str, other: str) -> str:
        """Make two bodies move as one, as they are drawn.

        Args:
            name: its name.
            body: a body; in the plane of at least two points.
            other: another body.
        """
        return self.add_joint(name, record.Weld((body, other)))

    # -- joints in space (source text §4.2) -----------------------------------------------------------------------
    #
    # A line is given by a point and a vector, or by two points; a direction by a vector or by two points. What two
    # bodies share (a point, a vector) needs no joint and no equation.

    def spherical(self, name: str, point: str, other: str) -> str:
        """Join two bodies by a ball joint where each has a point of its own (§4.2.1).

        Args:
            name: its name.
            point: the ball's centre in one body.
            other: the same in the other.
        """
        return self.add_joint(name, record.Spherical((point, other)))

    def cylindrical(self, name: str, line: tuple[str, str], on: str | tuple[str, str]) -> str:
        """Let a body slide along and turn about a line of another, (128)-(130), (135)-(140).

        Args:
            name: its name.
            line: the axis in one body, a point and a vector or two points.
            on: the other body's point on the axis if it shares the axis's vector, else its own line.
        """
        return self.add_joint(name, record.Cylindrical(line, on))

    def universal(
        self,
        name: str,
        axes: tuple[record.Direction, record.Direction],
        point: str | None = None,
        other: str | None = None,
    ) -> str:
        """Join two bodies by a universal (Cardan) joint: the arms of its cross keep their angle, (142).

        Args:
            name: its name.
            axes: the arm of the cross that turns in each body, a vector or two points.
            point: centre of the cross in one body; leave both points out where the bodies share it.
            other: the same in the other body.
        """
        return self.add_joint(name, record.Universal(axes, _coincident(point, other)))

    def screw(
        self,
        name: str,
        line: tuple[str, str],
        on: str | tuple[str, str],
        directions: tuple[record.Direction, record.Direction],
        angle: str,
        distance: str,
        lead: float | None = None,
        pitch: float | None = None,
    ) -> str:
        """Join two bodies by a screw (helical) joint: a cylindrical one whose advance is proportional to its turn.

        Creates the coordinates `angle` (about the line, from the first of `directions` to the second) and `distance`
        (along the line, to the point of `on`).

        Args:
            name: its name.
            line: the axis in one body, a point and a vector or two points.
            on: the other body's point on the axis if it shares the axis's vector, else its own line.
            directions: a direction of each body that is not along the line, to measure the turn.
            angle: name of the new angle.
            distance: name of the new distance.
            lead: advance per turn, a length, positive for a right-handed screw.
            pitch: instead of `lead`: advance per radian.
        """
        return self.add_joint(name, record.Screw(line, on, directions, angle, distance, lead, pitch))

    def planar(self, name: str, plane: tuple[str, str], on: str | tuple[str, str]) -> str:
        """Let a body slide and turn on a plane of another (planar joint): three relative freedoms.

        Args:
            name: its name.
            plane: a point of the plane and its normal, a vector, in one body.
            on: the other body's point on the plane (at the drawn height above it) if it shares the normal, else the
                point and its own normal. The point and the plane's normal: the point alone stays at that height, such
                as a ball at the end of a rod that may tilt.
        """
        return self.add_joint(name, record.Planar(plane, on))

    def bevel_gear(
        self,
        name: str,
        angle1: str,
        angle2: str,
        radii: tuple[float, float] | None = None,
        internal: bool = False,
        pressure_angle: float | None = None,
    ) -> str:
        """Mesh two wheels on axes at any angle, also parallel ones, (157): ``R1 φ1 ± R2 φ2 = c``.

        The sign follows from the drawing: with both axes pointing away from the point where they meet (or both towards
        it), or parallel the same way, it is plus. ``internal=True`` reverses it.

        Args:
            name: its name.
            angle1: angle of the first wheel about its axis.
            angle2: angle of the second wheel about its axis.
            radii: pitch radii, lengths (numbers of teeth do as well, except for reactions between axes that meet); read
                off the drawing (axis to the point that the angle goes to) if not given.
            internal: whether the larger wheel is toothed inside.
            pressure_angle: rad; reactions then have the separating force F tan α beside the tangential force F.
        """
        return self.add_joint(name, record.BevelGear((angle1, angle2), radii, internal, pressure_angle))

    def rack_and_pinion(
        self,
        name: str,
        angle: str,
        distance: str,
        radius: float | None = None,
        pressure_angle: float | None = None,
    ) -> str:
        """Let a pinion drive a rack, (199): ``s ∓ R ψ = c``, the sign from the side on which it is drawn.

        Args:
            name: its name.
            angle: the pinion's angle about its axis, from a direction that stands still to the pinion.
            distance: the rack's distance along its line, from a point that stands still to one on its pitch line.
            radius: pitch radius, a length; read off the drawing (the pinion's centre to the rack's line) if not given.
            pressure_angle: rad; reactions then have the separating force F tan α beside the tangential force F.
        """
        return self.add_joint(name, record.RackAndPinion(angle, distance, radius, pressure_angle))

    def constant_velocity(
        self,
        name: str,
        axes: tuple[record.Direction, record.Direction],
        marks: tuple[record.Direction, record.Direction],
        point: str | None = None,
        other: str | None = None,
    ) -> str:
        """Join two shafts by a constant-velocity joint.

        Args:
            name: its name.
            axes: the axis of each shaft, pointing the same way along the drive line.
            marks: a direction of each shaft that is not along its axis, to count its rotation from the drawing.
            point: centre of the joint in one body; leave both points out where the bodies share it.
            other: the same in the other body.
        """
        return self.add_joint(name, record.ConstantVelocity(axes, marks, _coincident(point, other)))

    def rolling_disc(
        self, name: str, centre: str, axis: str, mark: str, plane: tuple[str, str], radius: float | None = None
    ) -> str:
        """Let a disc roll on a plane of the ground, leaning and turning as it likes, without slip (nonholonomic).

        One row keeps its rim on the plane; two rows, linear in velocities, keep it from slipping. Positions do not see
        these two: counts, poses and sweeps are those of a disc that slides, and they act in `jaxnc.simulate`.

        Args:
            name: its name.
            centre: centre of the disc.
            axis: a unit vector of the disc's body, its axis of rotation.
            mark: another unit vector of the body, not along the axis, by which its rotation is known.
            plane: a point of the plane and its normal, on the side of the disc; both of the ground.
            radius: length; read off the drawing if not given.
        """
        return self.add_joint(name, record.RollingDisc(centre, axis, mark, plane, radius))

    # -- masses -------------------------------------------------------------------------------------------------

    @property
    def gravity(self) -> tuple[float, ...]:
        """Acceleration of free fall, such as ``(0, -9.81)``; empty for none. A design variable by components."""
        return Fall(self.model.gravity or ())

    @gravity.setter
    def gravity(self, value: Place | None) -> None:
        none = value is None or (isinstance(value, Fall) and not value)
        self.model.gravity = None if none else self._check.place(value, "gravity", "vector")

    def point_mass(self, name: str, point: str, mass: float) -> str:
        """Add a mass concentrated in a point.

        Args:
            name: its name.
            point: the point.
            mass: kg.

        Raises:
            MechanismError: unknown point, name already taken, negative mass.
        """
        what = f"point mass {name!r}"
        self._check.new_name(name, self.model.masses, "point mass")
        self._check.point(point, what)
        self.model.masses[name] = record.PointMass(point, self._check.not_negative(mass, f"{what}: mass"))
        return name

    def mass(
        self,
        body: str,
        mass: float,
        com: Place | None = None,
        inertia: object = None,
        shape: str | None = None,
        size: Sequence[float] = (),
    ) -> str:
        """Give a body that is already there its mass; the arguments are those of `body`.

        Returns:
            The name of the body.

        Raises:
            MechanismError: unknown body, or an inertia that it cannot have.
        """
        self._check.refuse_unknown(body, self.model.bodies, "body", "mass")
        plain = {"mass": None, "com": None, "inertia": None, "shape": None, "size": ()}
        spec = msgspec.structs.replace(record.whole(self.model.bodies[body]), **plain)
        self._inertia(spec, f"body {body!r}", mass, com, inertia, shape, size)
        self.model.bodies[body] = spec
        return body

    def _inertia(self, spec: record.Body, what: str, mass, com, inertia, shape, size) -> None:
        """Write what is said about a body's inertia into its record."""
        size = self._check.numbers(size, f"{what}: size")
        given = {"com": com, "inertia": inertia, "shape": shape, "size": size or None}
        if mass is None:
            if extra := [k for k, v in given.items() if v is not None]:
                raise MechanismError(f"{what}: {extra[0]}= without a mass; give mass= as well")
            return
        spec.mass = self._check.not_negative(mass, f"{what}: mass")
        if com is not None:
            spec.com = self._check.place(com, f"{what}: centre of mass")
        if shape is not None:
            if shape not in get_args(record.BodyShape):
                raise MechanismError(f"{what}: shape={shape!r}; {nearest(str(shape), get_args(record.BodyShape))}")
            if inertia is not None:
                raise MechanismError(f"{what}: both inertia= and shape= are given; give one of them")
            wanted = _SIZES[shape][self.model.dim - 2]
            if len(size) != len(wanted):
                form = f"size=({', '.join(wanted)})" if wanted else "no size, it is read off its points"
                raise MechanismError(f"{what}: a {shape} has {form}; got {len(size)} numbers")
            spec.size = tuple(self._check.positive(s, f"{what}: size {n}") for s, n in zip(size, wanted, strict=True))
            least = {"rod": 2, "plate": 3}.get(shape, 1)
            if len(spec.points) < least:
                raise MechanismError(f"{what}: a {shape} needs {least} points, it has {len(spec.points)}")
            spec.shape = shape
            return
        if size:
            raise MechanismError(f"{what}: size= without a shape; give shape='box', 'cylinder' or 'sphere'")
        if inertia is not None:
            spec.inertia = self._check.tensor(inertia, what)
            return
        if len(spec.points) == 2 and not spec.vectors and com is None:
            spec.shape = "rod"
        elif len(spec.points) + len(spec.vectors) > 1 and spec.mass:
            raise MechanismError(
                f"{what} has a mass but no inertia, and only a body of two points is a rod by default; give "
                f"inertia= (and com=), or shape= one of {', '.join(get_args(record.BodyShape))}"
            )

    def spring(
        self,
        name: str,
        start: str,
        to: str | None = None,
        *,
        stiffness: float,
        free: float | None = None,
        preload: float = 0.0,
        cubic: float = 0.0,
    ) -> str:
        """Add a spring between two points, or on a coordinate (torsional on an angle).

        Its force against lengthening by x beyond its free length is ``preload + stiffness x + cubic x³``.

        Args:
            name: its name.
            start: a point; or the coordinate it acts on, an angle or distance.
            to: the other point.
            stiffness: N/m, on an angle N m/rad.
            free: free length (angle); as drawn if not given.
            preload: force (moment) at the free length.
            cubic: N/m³.

        Returns:
            The name. Its parameters are design variables, ``<name>.stiffness``, …

        Raises:
            MechanismError: unknown point or coordinate, name already taken, numbers that no spring has.
        """
        values = {"stiffness": stiffness, "free": free, "preload": preload, "cubic": cubic}
        return self._apply_named("spring", name, start, to, values, ("free",))

    def damper(self, name: str, start: str, to: str | None = None, *, damping: float, quadratic: float = 0.0) -> str:
        """Add a damper between two points, or on a coordinate; its force is ``damping u + quadratic u|u|``.

        Args:
            name: its name.
            start: a point; or the coordinate it acts on.
            to: the other point.
            damping: N s/m, on an angle N m s/rad.
            quadratic: N s²/m².
        """
        return self._apply_named("damper", name, start, to, {"damping": damping, "quadratic": quadratic})

    def stop(
        self,
        name: str,
        start: str,
        to: str | None = None,
        *,
        stiffness: float,
        lower: float | None = None,
        upper: float | None = None,
        damping: float = 0.0,
        restitution: float | None = None,
        speed: float | None = None,
    ) -> str:
        """Add elastic stops of the distance of two points, or of a coordinate: end stops, bumpers.

        Pressed in by x they push back with ``stiffness x + damping x ẋ``, without a jump where they are touched.

        Args:
            name: its name.
            start: a point; or the coordinate.
            to: the other point.
            stiffness: N/m (N m/rad) beyond a stop.
            lower: where the lower stop is; none if not given.
            upper: where the upper stop is.
            damping: N s/m for each metre that the stop is pressed in.
            restitution: instead of damping: which part of its speed is left to what comes in with `speed`, whatever
                its mass; above 0, at most 1.
            speed: the speed (m/s, rad/s) at which `restitution` holds; slower ones keep more.

        Raises:
            MechanismError: neither stop is given, a restitution out of range or without its speed.

        Source: K. H. Hunt and F. R. E. Crossley, Coefficient of restitution interpreted as damping in vibroimpact, J.
        Appl. Mech. 42 (1975).
        """
        what = f"stop {name!r}"
        if lower is None and upper is None:
            raise MechanismError(f"{what}: give lower=, upper= or both")
        if lower is not None and upper is not None:
            low, high = self._check.finite(lower, f"{what}: lower"), self._check.finite(upper, f"{what}: upper")
            if low >= high:
                raise MechanismError(f"{what}: lower = {low:g} must be below upper = {high:g}")
        if (restitution is None) != (speed is None) or (restitution is not None and damping):
            raise MechanismError(f"{what}: give damping=, or restitution= together with the speed= at which it holds")
        if restitution is not None and speed is not None:
            part = self._check.positive(restitution, f"{what}: restitution")
            if part > 1:
                raise MechanismError(f"{what}: restitution = {part:g} would make energy; at most 1")
            rate = self._check.positive(speed, f"{what}: speed")
            damping = stop_loss(part) * self._check.positive(stiffness, f"{what}: stiffness") / rate
        values = {"stiffness": stiffness, "lower": lower, "upper": upper, "damping": damping}
        return self._apply_named("stop", name, start, to, values, ("lower", "upper"))

    def _apply_named(
        self,
        kind: str,
        name: str,
        start: str,
        to: str | None,
        values: Mapping[str, object],
        optional: Sequence[str] = (),
    ) -> str:
        from jaxnc.forces import CATALOGUE

        given: dict[str, Any] = {k: v for k, v in values.items() if v is not None or k not in optional}
        if to is None:
            return self.apply(name, CATALOGUE[f"coordinate {kind}"], scalars=[start], parameters=given)
        return self.apply(name, CATALOGUE[kind], points=[start, to], parameters=given)

    def force(self, name: str, point: str, value: object, parameters: object = None) -> str:
        """Add a force on a point.

        Args:
            name: its name.
            point: the point.
            value: components in the ground's axes, N; or a function ``f(t, state, parameters)`` that returns them (see
                `jaxnc.dynamics.model.State`).
            parameters: what the function gets: any pytree of float arrays, design variables all.
        """
        self._check.new_name(name, self.model.forces, "force")
        self._check.point(point, f"force {name!r}")
        if callable(value):
            return self._function(name, "force", [point], [], value, parameters)
        from jaxnc.forces import FORCE, FORCE_IN_SPACE

        place = self._check.place(value, f"force {name!r}", "vector")
        kind = FORCE if self.model.dim == 2 else FORCE_IN_SPACE
        return self.apply(name, kind, points=[point], parameters=dict(zip(self.axes, place, strict=True)))

    def torque(self, name: str, coordinate: str, value: float | Callable, parameters: object = None) -> str:
        """Add an effort on a coordinate: a torque on an angle, a force along a distance (an actuator).

        Args:
            name: its name.
            coordinate: the angle or distance, or a single coordinate such as ``"P.x"``.
            value: N m or N; or a function ``f(t, state, parameters)`` that returns it.
            parameters: what the function gets: any pytree of float arrays.
        """
        self._check.new_name(name, self.model.forces, "force")
        self._check.scalar(coordinate, f"torque {name!r}")
        if callable(value):
            return self._function(name, "effort", [], [coordinate], value, parameters)
        from jaxnc.forces import EFFORT

        return self.apply(name, EFFORT, scalars=[coordinate], parameters={"value": value})

    def load(self, name: str, function: Callable, parameters: object = None) -> str:
        """Add a generalised force of one's own on all coordinates.

        Args:
            name: its name, for reports and messages.
            function: pure, ``(t, q, v, parameters) -> (N,)``, in the order of ``system.topology.coordinates``.
            parameters: any pytree of float arrays, design variables all.
        """
        return self._function(name, "load", [], [], function, parameters)

    def apply(
        self,
        name: str,
        kind: "ForceKind",
        points: Sequence[str] = (),
        vectors: Sequence[str] = (),
        scalars: Sequence[str] = (),
        parameters: Mapping[str, float] | None = None,
    ) -> str:
        """Add a force of any kind, the catalogue's or the user's own (see `jaxnc.forces.ForceKind`).

        Args:
            name: its name.
            kind: the kind.
            points: names of its points, as many as the kind takes.
            vectors: names of its unit vectors.
            scalars: names of its scalar coordinates.
            parameters: values by name; the rest is as drawn.

        Raises:
            MechanismError: wrong number of points, unknown names, parameters missing, negative or not finite.
        """
        self._check.new_name(name, self.model.forces, "force")
        if not hasattr(kind, "potential"):
            raise MechanismError(f"force {name!r}: after its name comes a kind of force, a ForceKind; got {kind!r}")
        what = f"{kind.name} {name!r}"
        given = self._check_instance(self.force_kinds, kind, what, points, vectors, scalars, parameters, "parameter")
        if len(set(given[0])) != len(given[0]):
            raise MechanismError(f"{what} needs different points, got {', '.join(given[0])}")
        from jaxnc.forces import CATALOGUE  # which whoever has a kind has imported

        if CATALOGUE.get(kind.name) is kind and kind.drawn is not None:
            dim = self.model.dim
            drawn = kind.drawn(np.eye(max(kind.points, dim))[:, :dim], np.eye(dim), np.zeros(max(kind.scalars, 1)))
            for key, value in zip(kind.parameters, drawn, strict=True):
                if value is None and key not in given[3]:
                    raise MechanismError(f"{what}: {key} must be given")
        self.model.forces[name] = record.Force(kind.name, *given)
        return name

    def _function(self, name, kind, points, scalars, function, parameters) -> str:
        if not callable(function):
            raise MechanismError(f"force {name!r}: expected a function of (t, …, parameters), got {function!r}")
        self._check.new_name(name, self.model.forces, "force")
        self.model.forces[name] = record.Force(f"function: {kind}", points, [], scalars)
        self.functions[name] = (Acting(name, function), () if parameters is None else parameters)
        return name

    def friction(
        self,
        name: str,
        *,
        coefficient: float,
        bodies: tuple[str, str] | None = None,
        at: str | None = None,
        radius: float | None = None,
        joint: str | None = None,
        speed: float = 1e-3,
    ) -> str:
        """Add Coulomb friction, proportional to the reaction of a joint.

        Args:
            name: its name.
            coefficient: coefficient of friction.
            bodies: two bodies pinned to each other at the point `at`, in space by a hinge or a ball; ``"ground"`` for
                the ground.
            at: the point that the bodies share; alone, a point that slides with a fixed coordinate.
            radius: radius of the pin or ball, a length.
            joint: instead of `bodies`: a slot, prismatic or cylindrical joint (which rubs along its line); or a point
                that slides with a fixed coordinate, where no joint has its name.
            speed: sliding speed (m/s) within which the force is smoothed: ``tanh(v / speed)``.
        """
        what = f"friction {name!r}"
        self._check.new_name(name, self.model.friction, "friction")
        values: dict[str, Any] = {
            "coefficient": self._check.not_negative(coefficient, f"{what}: coefficient"),
            "speed": self._check.positive(speed, f"{what}: speed"),
        }
        sliding = [
            n
            for n, j in self.model.joints.items()
            if isinstance(j, record.Slot | record.Prismatic | record.Cylindrical)
        ]
        guided = [n for n, p in self.model.points.items() if isinstance(p, record.Point) and p.fixed]
        if joint is not None:
            if joint not in (*sliding, *guided):
                raise MechanismError(f"{what}: no slot, prismatic or cylindrical joint or guided point {joint!r}; "
                                     f"{nearest(joint, [*sliding, *guided])}")  # fmt: skip
            # A joint and a point may have one name: what is meant is written down where it is said.
            values["joint" if joint in sliding else "point"] = joint
            self.model.friction[name] = record.Friction(**values)
            return name
        if bodies is None and radius is None and at in guided:
            self.model.friction[name] = record.Friction(**values, point=at)
            return name
        if bodies is None or at is None or radius is None:
            raise MechanismError(
                f"{what}: give bodies=, at= and radius= of a pin, joint= of a slider, or at= of a point with a fixed "
                f"coordinate"
            )
        self._check.point(at, what)
        pair = self._check.names(bodies, self.model.bodies, what, "body")
        if len(pair) != 2:
            raise MechanismError(f"{what}: bodies= are two, such as ('crank', 'ground'); got {brief(bodies)}")
        for body in pair:
            if body == "ground":
                if at not in self.model.ground:
                    raise MechanismError(f"{what}: {at!r} is no point of the ground")
                continue
            self._check.refuse_unknown(body, self.model.bodies, "body", what)
            if at not in record.whole(self.model.bodies[body]).points:
                raise MechanismError(f"{what}: body {body!r} has no point {at!r}; name a point that both bodies share")
        radius = self._check.positive(radius, f"{what}: radius")
        self.model.friction[name] = record.Friction(**values, bodies=(pair[0], pair[1]), point=at, radius=radius)
        return name

    # -- out ----------------------------------------------------------------------------------------------------

    def in_form(self, form: str = "text", angle: str | None = None, distance: str | None = None) -> "Mechanism":
        """Write every body, joint, angle and distance of the mechanism in one form.

        Args:
            form: ``"text"``: the source text's own equations, as printed in its examples; ``"exact"``: those that keep
                their rank in every pose.
            angle: form of the angles (see `angle`); with ``"text"`` ``"cosine"`` if not given. In space those that are
                counted from the drawing stay as they are.
            distance: form of the distances along a line (see `distance`); with ``"text"`` ``"x"``, ``"y"`` or ``"z"``
                if not given, along which the line is drawn most.

        Returns:
            A mechanism of its own; this one stays as it is.

        Raises:
            MechanismError: a form that there is not.

        Source: source text, (21), (45), (46), (53), (58), (59), (73), (74), (155), (156), (197), (201) and §3.1-4.2.
        """
        other = copy.copy(self)
        other.model = record.in_form(self.model, form, angle, distance)
        other.kinds, other.force_kinds = dict(self.kinds), dict(self.force_kinds)
        other.functions, other.members = dict(self.functions), dict(self.members)
        return other

    def compile(self, sparse: bool | None = None, dtype: str | None = None) -> "System":
        """Check the whole description and turn it into an immutable `System`.

        Args:
            sparse: keep matrices sparse, so that memory and time grow linearly with the mechanism; if not given, with
                more than 200 unknowns.
            dtype: type of its numbers, ``"float64"`` if not given. With ``"float32"`` everything that is calculated for
                the system is so, faster and to about 6 digits; the system itself is derived with 64 bits.

        Returns:
            The system, whose parameters are what is drawn and the explicit dimensions.

        Raises:
            MechanismError: no points, a segment without length where a direction is needed, lengths that no triangle
                has, a body of one point whose orientation is not known; a large mechanism whose degrees of freedom
                cannot be told.
            JaxncError: 64-bit numbers are asked for, and JAX has them switched off.
            InputError: another type of numbers than those two, or a large system with 32-bit ones.
        """
        return door("Mechanism.compile")(self, sparse, dtype)

    def save(self, path: "str | Path", kinds: "Mapping[str, Kind | RateKind | ForceKind] | None" = None) -> "Path":
        """Write the description to a TOML or JSON model file (`jaxnc.load` reads it back).

        Args:
            path: file name ending in ``.toml`` or ``.json``.
            kinds: own kinds that whoever loads the file will hand to `jaxnc.load` again.

        Raises:
            OutputError: if the file cannot be written.
            MechanismError: if the mechanism uses other kinds that are not in the catalogue.
        """
        return door("Mechanism.save")(self, path, kinds)

    def to_mjcf(self, path: "str | Path", at: "System | Motion | None" = None) -> "Exported":
        """Write a MuJoCo file (MJCF) of the mechanism, a design of it, or a motion; see `jaxnc.robots.to_mjcf`."""
        return door("Mechanism.to_mjcf")(self, path, at)

    def to_urdf(self, path: "str | Path", at: "System | Motion | None" = None) -> "Exported":
        """Write a URDF file of the mechanism, with a table of its loops; see `jaxnc.robots.to_urdf`."""
        return door("Mechanism.to_urdf")(self, path, at)


def _as_pair(end: object) -> Any:
    return tuple(end) if isinstance(end, (list, tuple)) else end


def _coincident(point: str | None, other: str | None) -> Any:
    """Two coincident points of a joint, one of each body; None where neither is given."""
    return None if point is None and other is None else (point, other)


def stop_loss(restitution: float) -> float:
    """Find ``damping speed / stiffness`` of an end stop that leaves a part of the speed.

    From ``m v dv = -(k + c v) x dx``, the same at touching and at leaving: a = c v / k solves
    ``a - ln(1 + a) = -e a - ln(1 - e a)``, where the mass does not appear.
    """
    if restitution == 1.0:
        return 0.0

    def left(a: float) -> float:
        return a - math.log1p(a) + restitution * a + math.log1p(-restitution * a)

    low, high = 0.5 * (1.0 - restitution), 1.0 / restitution
    for _ in range(200):
        middle = 0.5 * (low + high)
        if restitution * middle < 1.0 and left(middle) > 0.0:
            low = middle
        else:
            high = middle
    return low
