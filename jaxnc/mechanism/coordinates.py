"""Angles, distances and linear relations between them: the mixed coordinates of a description."""

from collections.abc import Mapping
from typing import Any

from jaxnc.errors import MechanismError
from jaxnc.mechanism import model as record
from jaxnc.mechanism.forms import angle_forms, distance_forms
from jaxnc.mechanism.loads import LoadBuilder


class CoordinateBuilder(LoadBuilder):
    """The methods of `Mechanism` that make coordinates of angles and distances."""

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
        self._new_quantity(name, "angle")
        spatial = self.model.dim == 3
        forms = angle_forms(self.model.dim)
        if form not in forms:
            raise MechanismError(f"{what}: form={form!r}; use one of {', '.join(forms)}")
        if isinstance(to, str) and not to:
            raise MechanismError(f"{what}: say what it goes to, to='B' or to=('A', 'B')")
        if spatial and about is None:
            raise MechanismError(f"{what}: in space an angle is about an axis; give about=, a vector or two points")
        if about is not None:
            self._in_space(f"{what}: about=", "in the plane angles are anticlockwise")
            about = self._direction(about, what)
        for end in (to, start):
            if isinstance(end, str) and end not in self.all_vectors:
                if at is None:
                    raise MechanismError(f"{what}: with a single point {end!r}, say where the angle is: at='A'")
                self._distinct((at, end), what)
            elif end is not None:
                self._direction(end, what)
        if at is not None:
            self._known_point(at, what)
        self.model.angles[name] = record.Angle(_pair(to), at, _pair(start), form, about)
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
        self._new_quantity(name, "distance")
        self._distinct((start, to), what)
        forms = distance_forms(self.model.dim)
        if form not in forms:
            raise MechanismError(f"{what}: form={form!r}; use one of {', '.join(forms)}")
        if along is None and form != "exact":
            raise MechanismError(f"{what}: form={form!r} needs a line; give along=")
        if isinstance(along, str) and along not in self.all_vectors:
            self._distinct((start, along), what)
        elif along is not None:
            self._direction(along, what)
        self.model.distances[name] = record.Distance(start, to, _pair(along), form)
        return name

    def relation(self, name: str, terms: Mapping[str, float], constant: float | None = None) -> str:
        """Tie scalar coordinates by a linear relation, ``k1 s1 + … = constant``.

        Args:
            name: its name.
            terms: factors by coordinate: angles, distances, or single coordinates of points such as ``"P.x"``.
            constant: right-hand side; read off the drawing if not given.
        """
        what = f"relation {name!r}"
        self._new_name(name, self.model.relations, "relation")
        if not isinstance(terms, Mapping):
            raise MechanismError(f"{what}: terms= takes factors by name such as {{'phi': 1, 'P.x': -2}}, got {terms!r}")
        if not terms:
            raise MechanismError(f"{what} has no terms")
        for s, k in terms.items():
            self._known_scalar(s, what)
            self._finite(k, f"{what}: factor of {s!r}")
        if not any(terms.values()):
            raise MechanismError(f"{what}: all factors are zero")
        if constant is not None and "constant" in terms:
            raise MechanismError(
                f"{what}: its constant and the factor of the coordinate 'constant' would both be addressed as "
                f"'{name}.constant'; call the coordinate something else, or leave constant= out"
            )
        c = None if constant is None else self._finite(constant, f"{what}: constant")
        self.model.relations[name] = record.Relation({s: float(k) for s, k in terms.items()}, c)
        return name


def _pair(end: Any) -> Any:
    return tuple(end) if isinstance(end, (list, tuple)) else end
