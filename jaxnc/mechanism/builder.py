"""`Mechanism`, the only mutable object: names and numbers as the user draws them. No JAX here."""

import copy
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from jaxnc.calls import public
from jaxnc.errors import MechanismError, brief, nearest
from jaxnc.mechanism import model as record
from jaxnc.mechanism.coordinates import CoordinateBuilder
from jaxnc.mechanism.forms import reformed
from jaxnc.mechanism.place import Place
from jaxnc.notebooks import Drawn

if TYPE_CHECKING:
    from pathlib import Path

    from jaxnc.constraints import Kind, RateKind
    from jaxnc.forces import ForceKind
    from jaxnc.kinematics.motion import Motion
    from jaxnc.robots import Exported
    from jaxnc.system.system import System


@public
class Mechanism(Drawn, CoordinateBuilder):
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
            self._writable(text, noun)
        if set(length_unit) & set("[]") or not length_unit.isprintable():
            raise MechanismError(f"length_unit={length_unit!r}: tables write it in brackets; use a word such as 'mm'")
        units = record.Units(length=length_unit, angle=angle_unit)  # pyright: ignore[reportArgumentType]
        super().__init__(record.Model(name=name, dim=dim, description=description, units=units))  # pyright: ignore[reportArgumentType]
        self.kinds: "dict[str, Kind | RateKind]" = {}
        self.force_kinds: dict[str, ForceKind] = {}
        self.functions: dict[str, tuple[Any, Any]] = {}
        self.members: dict[tuple[frozenset, frozenset], str] = {}

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        return self.model.name

    def __setattr__(self, name: str, value: Any) -> None:
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
        self._new_quantity(name, "ground point")
        self.model.ground[name] = self._place(at, f"ground point {name!r}")
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
        self._new_quantity(name, "point")
        place = self._place(at, f"point {name!r}")
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
        self._in_space(f"ground vector {name!r}", "in the plane points are enough")
        self._new_quantity(name, "ground vector")
        self.model.ground_vectors[name] = self._unit(direction, f"ground vector {name!r}")
        return name

    def vector(self, name: str, direction: Place) -> str:
        """Add a unit vector as a natural coordinate (in space): an axis, or the orientation of a body.

        Args:
            name: its name.
            direction: components as drawn, ``(x, y, z)``; only the direction counts, it is normalised.

        Raises:
            MechanismError: name already taken, a zero vector, or components that are not three finite numbers.
        """
        self._in_space(f"vector {name!r}", "in the plane points are enough")
        self._new_quantity(name, "vector")
        self.model.vectors[name] = self._unit(direction, f"vector {name!r}")
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
        self._new_quantity(name, "marker")
        if on not in self.model.bodies:
            raise MechanismError(f"{what}: unknown body {on!r}; {nearest(on, self.model.bodies)}")
        if (at is None) == (direction is None):
            raise MechanismError(f"{what}: say where it is drawn with at=, or give a unit vector with direction=")
        if direction is not None:
            self._in_space(f"{what}, a direction,")
            self.model.markers[name] = record.Marker(on, direction=self._unit(direction, what))
        else:
            self.model.markers[name] = record.Marker(on, self._place(at, what))
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
        inertia: Any = None,
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
        self._new_name(name, m.bodies, "body")
        if name == "ground":
            raise MechanismError(f"{what}: 'ground' stands for the ground itself; choose another name")
        for option, given in (("lengths", lengths), ("local", local)):
            if given is not None and not isinstance(given, Mapping):
                usual = "{('A', 'B'): 3.0}" if option == "lengths" else "{'P': (0.07, 0.05)}"
                raise MechanismError(
                    f"{what}: {option}= takes numbers by name such as {usual}, got {given!r}; all points of a body "
                    f"stand in one list, body({name!r}, ['A', 'B'])"
                )
        points = self._listed(points, self.all_points, what)
        vectors = self._listed(vectors, self.all_vectors, what, "vector")
        if not points:
            raise MechanismError(f"{what} has no points; give it at least {'two' if m.dim == 2 else 'one'}")
        for p in points:
            self._known_point(p, what)
        if vectors:
            self._in_space(f"{what}: vectors=")
        for u in vectors:
            self._known_vector(u, what)
        for noun, members in (("point", points), ("vector", vectors)):
            for p in members:
                if members.count(p) > 1:
                    raise MechanismError(f"{what} lists {noun} {p!r} twice; list each {noun} once")
        other = self._members().get((frozenset(points), frozenset(vectors)))
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
            spec.lengths["-".join(self._length_pair(pair, points, what))] = self._positive(
                value, f"{what}: length {'-'.join(map(str, pair))}"
            )
        for p, place in (local or {}).items():
            if m.dim == 3:
                raise MechanismError(f"{what}: local= is for planar bodies; in space draw the point where it is")
            if p not in points[2:]:
                raise MechanismError(
                    f"{what}: local={{{p!r}: …}}; local places are for its third and further points, {points[2:]}"
                )
            spec.local[p] = self._place(place, f"{what}, local place of {p!r}")
        if form not in ("exact", "text"):
            raise MechanismError(f"{what}: form={form!r}; use 'exact' or 'text'")
        spec.form = form
        if along is not None:
            if len(points) > 1 or m.dim == 3:
                raise MechanismError(f"{what}: along= is for a planar body of one point; this one has {len(points)}")
            spec.along = self._line(along, what)
        self._inertia(spec, what, mass, com, inertia, shape, size)
        m.bodies[name] = spec
        self.members[frozenset(points), frozenset(vectors)] = name
        return name

    def _members(self) -> dict[tuple[frozenset, frozenset], str]:
        """Which body has which points and vectors; made anew when the model was changed from outside."""
        if len(self.members) != len(self.model.bodies):
            specs = {n: b if isinstance(b, record.Body) else record.Body(b) for n, b in self.model.bodies.items()}
            self.members = {(frozenset(b.points), frozenset(b.vectors)): n for n, b in specs.items()}
        return self.members

    # -- mixed coordinates and relations ------------------------------------------------------------------------

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
        self._new_name(name, self.model.constraints, "constraint")
        if not hasattr(kind, "scalars"):
            raise MechanismError(f"{what}: after its name comes a kind of constraint, a Kind; got {kind!r}")
        points = self._listed(points, self.all_points, what)
        vectors = self._listed(vectors, self.all_vectors, what, "vector")
        scalars = self._listed(scalars, self.scalar_names, what, "scalar")
        if (len(points), len(vectors), len(scalars)) != (kind.points, kind.vectors, kind.scalars):
            takes = f"{kind.points} points and {kind.scalars} scalars" + (
                f", {kind.vectors} vectors" * bool(kind.vectors)
            )
            raise MechanismError(
                f"{what}: kind {kind.name!r} takes {takes}, got {len(points)} and {len(scalars)}"
                + (f", {len(vectors)} vectors" if vectors or kind.vectors else "")
            )
        for p in points:
            self._known_point(p, what)
        for u in vectors:
            self._known_vector(u, what)
        for s in scalars:
            self._known_scalar(s, what)
        for c, value in (constants or {}).items():
            if c not in kind.constants:
                raise MechanismError(f"{what}: unknown constant {c!r}; {nearest(c, kind.constants)}")
            self._finite(value, f"{what}: constant {c!r}")
        if self.kinds.setdefault(kind.name, kind) != kind:
            raise MechanismError(f"{what}: another kind is already called {kind.name!r}; give yours its own name")
        self.model.constraints[name] = record.Constraint(
            kind.name, list(points), list(vectors), list(scalars), {k: float(v) for k, v in (constants or {}).items()}
        )
        return name

    # -- out ----------------------------------------------------------------------------------------------------

    def in_form(self, form: str = "text", angle: str | None = None, distance: str | None = None) -> "Mechanism":
        """The same mechanism with every body, joint, angle and distance written in one form.

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
        other.model = reformed(self.model, form, angle, distance)
        other.kinds, other.force_kinds = dict(self.kinds), dict(self.force_kinds)
        other.functions, other.members = dict(self.functions), dict(self.members)
        return other

    def compile(self, sparse: bool | None = None, dtype: Any = None) -> "System":
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
        from jaxnc.solvers.assembly import with_degrees_of_freedom
        from jaxnc.system.assemble import assemble
        from jaxnc.system.precision import WIDE, at_once, chosen, numbers

        wanted = chosen(dtype)
        with numbers(WIDE), at_once():
            system = with_degrees_of_freedom(assemble(self, sparse))
            if system.topology.extended is not None:
                from jaxnc.dynamics.extended import look_around

                system = look_around(system)
            return system.astype(wanted)

    def save(self, path: "str | Path", kinds: "Mapping[str, Kind | RateKind] | None" = None) -> "Path":
        """Write the description to a TOML or JSON model file (`jaxnc.load` reads it back).

        Args:
            path: file name ending in ``.toml`` or ``.json``.
            kinds: own kinds that whoever loads the file will hand to `jaxnc.load` again.

        Raises:
            OutputError: if the file cannot be written.
            MechanismError: if the mechanism uses other kinds that are not in the catalogue.
        """
        from jaxnc.io.files import save

        return save(self, path, kinds)

    def to_mjcf(self, path: "str | Path", at: "System | Motion | None" = None) -> "Exported":
        """Write a MuJoCo file (MJCF) of the mechanism, a design of it, or a motion; see `jaxnc.robots.to_mjcf`."""
        from jaxnc import robots

        return robots.to_mjcf(self, path, at)

    def to_urdf(self, path: "str | Path", at: "System | Motion | None" = None) -> "Exported":
        """Write a URDF file of the mechanism, with a table of its loops; see `jaxnc.robots.to_urdf`."""
        from jaxnc import robots

        return robots.to_urdf(self, path, at)
