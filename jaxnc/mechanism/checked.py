"""The records of a mechanism with the checks of names and numbers that every builder method makes."""

from collections.abc import Iterable
from typing import Any

from jaxnc.errors import MechanismError, brief, drawn_with_numbers, nearest, writable
from jaxnc.mechanism import model as record

PUNCTUATION = ' .-,;=()[]"'  # not in names of quantities: "B.x", "P-Q", "v(phi) [rad/s]", phi=0:6

LARGEST = 1e100  # of a number in a description: its square is still one


class CheckedModel:
    """A model whose names and numbers are checked before they are written down.

    Args:
        model: the records.
    """

    def __init__(self, model: record.Model):
        self.model = model

    @property
    def all_points(self) -> tuple[str, ...]:
        """Names of ground points and points, in order."""
        return (*self.model.ground, *self.model.points)

    @property
    def all_vectors(self) -> tuple[str, ...]:
        """Names of ground vectors and vectors, in order."""
        return (*self.model.ground_vectors, *self.model.vectors)

    @property
    def axes(self) -> str:
        """The axes of the mechanism's space, ``"xy"`` or ``"xyz"``."""
        return "xyz"[: self.model.dim]

    @property
    def scalar_names(self) -> tuple[str, ...]:
        """Names of the mixed coordinates, in order: angles, distances, then those of rolling and screw joints."""
        made = (s for _, j in self._making() for s in (j.angle, j.distance))
        return (*self.model.angles, *self.model.distances, *made)

    def _making(self) -> list[tuple[str, record.Rolling | record.Screw]]:
        """Joints that make coordinates of their own."""
        return [(n, j) for n, j in self.model.joints.items() if isinstance(j, record.Rolling | record.Screw)]

    def _in_space(self, what: str, instead: str = "") -> None:
        if self.model.dim != 3:
            raise MechanismError(f"{what} is for mechanisms in space, Mechanism(dim=3)" + (instead and f"; {instead}"))

    def _known_vector(self, name: Any, what: str) -> None:
        if not isinstance(name, str) or name not in self.all_vectors:
            known = self.all_vectors
            hint = nearest(name, known) if known else "there are no vectors yet; add one with vector()"
            raise MechanismError(f"{what}: unknown vector {name!r}; {hint}")

    def _direction(self, spec: Any, what: str) -> record.Direction:
        """A direction: the name of a vector, or two different points."""
        if isinstance(spec, str):
            if spec in self.all_points:
                raise MechanismError(
                    f"{what}: {spec!r} is a point, which gives no direction; name a vector, or two points such as "
                    f"({spec!r}, 'Q')"
                )
            self._known_vector(spec, what)
            return spec
        return self._line(spec, what)

    def _directions(self, specs: Any, what: str) -> tuple[record.Direction, record.Direction]:
        if isinstance(specs, str) or not isinstance(specs, (tuple, list)) or len(specs) != 2:
            raise MechanismError(
                f"{what}: give two directions, one of each body, such as ('u', ('P', 'Q')); got {brief(specs)}"
            )
        return self._direction(specs[0], what), self._direction(specs[1], what)

    def _axis_line(self, line: Any, what: str) -> tuple[str, str]:
        """A line in space: a point and a vector, or two points."""
        if isinstance(line, str) or not isinstance(line, (tuple, list)) or len(line) != 2:
            raise MechanismError(f"{what}: a line is a point and a vector, or two points; got {brief(line)}")
        if self.model.dim == 3 and line[1] in self.all_vectors:
            self._known_point(line[0], what)
            return (line[0], line[1])
        return self._line(line, what)

    def _known_point(self, name: str, what: str) -> None:
        if not isinstance(name, str):
            raise MechanismError(f"{what}: the name of a point is wanted, after its own; got {brief(name)}")
        if name not in self.model.ground and name not in self.model.points:
            if name in self.model.markers:
                raise MechanismError(
                    f"{what}: {name!r} is a marker, which only rides on a body; make it a point of that body instead"
                )
            if name in self.all_vectors:
                raise MechanismError(f"{what}: {name!r} is a vector; a point is wanted here")
            raise MechanismError(f"{what}: unknown point {name!r}; {nearest(name, self.all_points)}")

    def _listed(self, names: Any, known: Iterable[str], what: str, noun: str = "point") -> list[str]:
        """A list of names; one name may stand by itself, but letters of a text are no list."""
        if isinstance(names, str):
            if names not in known and len(names) > 1 and set(names) <= set(known):
                raise MechanismError(f"{what}: {names!r} is one name, and no {noun}; as a list, write {list(names)}")
            return [names]
        try:
            return list(names)
        except TypeError:
            raise MechanismError(f"{what}: {noun}s are a list of names, got {brief(names)}") from None

    def _known_scalar(self, name: str, what: str) -> None:
        if not isinstance(name, str):
            raise MechanismError(f"{what}: the name of a coordinate is wanted, after its own; got {brief(name)}")
        point, _, axis = name.partition(".")
        spread = (*self.all_points, *self.all_vectors)
        if name in self.scalar_names or (axis and axis in self.axes and point in spread):
            return
        hint = nearest(name, (*self.scalar_names, *(f"{p}.{a}" for p in spread for a in self.axes)))
        raise MechanismError(f"{what}: unknown coordinate {name!r}; {hint}")

    def _new_quantity(self, name: str, noun: str) -> None:
        m = self.model
        self._named(name, noun)
        if wrong := sorted(set(name) & set(PUNCTUATION)):
            raise MechanismError(
                f"{noun} {name!r}: names are without dots, dashes, commas, brackets, quotes and spaces, which tables "
                f"and settings put around them; this one has {wrong[0]!r}"
            )
        for what, taken in (
            ("a ground point", m.ground),
            ("a point", m.points),
            ("a ground vector", m.ground_vectors),
            ("a vector", m.vectors),
            ("a marker", m.markers),
            ("an angle", m.angles),
            ("a distance", m.distances),
            *((f"a coordinate of joint {n!r}", (j.angle, j.distance)) for n, j in self._making()),
        ):
            if name in taken:
                raise MechanismError(f"{noun} {name!r}: the name is already taken by {what}; choose another")

    def _new_name(self, name: str, taken: Iterable[str], noun: str) -> None:
        self._named(name, noun)
        if name in taken:
            raise MechanismError(f"{noun} {name!r}: the name is already taken by another {noun}; choose another")

    def _named(self, name: Any, noun: str) -> None:
        """Refuse what is no name, or would not come back from a file, a table or a screen as it was."""
        if not isinstance(name, str):
            raise MechanismError(f"a {noun} has its name first, which is a text; got {brief(name)} for the name")
        if not name:
            raise MechanismError(f"{noun} {name!r}: its name is empty; give it one")
        self._writable(name, noun)
        if unseen := [letter for letter in name if not letter.isprintable()]:
            raise MechanismError(
                f"{noun} {name!r}: names are of letters that can be seen; this one has {unseen[0]!r}, a control or "
                f"format character or a space that is none of the keyboard's"
            )
        if name != name.strip():
            raise MechanismError(f"{noun} {name!r}: names do not begin or end with a space")

    def _writable(self, text: Any, noun: str) -> None:
        if isinstance(text, str) and not writable(text):
            raise MechanismError(f"{noun} {text!r} holds half of a character (a lone surrogate); type it anew")

    def _new_joint(self, name: str) -> None:
        self._new_name(name, self.model.joints, "joint")

    def _place(self, at: Any, what: str) -> tuple[float, ...]:
        try:
            place = tuple(float(x) for x in at)
        except (TypeError, ValueError, OverflowError):
            place = ()
        if len(place) != self.model.dim:
            why = drawn_with_numbers(at) or f", got {brief(at)}"
            raise MechanismError(f"{what}: its place must be {self.model.dim} numbers{why}")
        for x in place:
            self._finite(x, f"{what}: each number of its place")
        return place

    def _unit(self, direction: Any, what: str) -> tuple[float, ...]:
        """A direction as given; only its direction counts, but it must have one."""
        place = self._place(direction, what)
        if not any(place):
            raise MechanismError(f"{what} is the zero vector, which has no direction; give one component at least")
        return place

    def _finite(self, value: Any, what: str) -> float:
        try:
            number = float(value)
        except (TypeError, ValueError, OverflowError):
            why = drawn_with_numbers(value) or f", got {brief(value)}"
            raise MechanismError(f"{what} must be a number{why}") from None
        if not abs(number) <= LARGEST:
            raise MechanismError(f"{what} must be a finite number, at most {LARGEST:g}, got {brief(value)}")
        return number

    def _positive(self, value: Any, what: str) -> float:
        number = self._finite(value, what)
        if number <= 0:
            raise MechanismError(f"{what} must be positive, got {brief(value)}")
        return number

    def _distinct(self, pair: tuple[str, str], what: str) -> None:
        for p in pair:
            self._known_point(p, what)
        if pair[0] == pair[1]:
            raise MechanismError(f"{what} needs two different points, got {pair[0]!r} twice")

    def _line(self, line: Any, what: str) -> tuple[str, str]:
        if not isinstance(line, (tuple, list)) or len(line) != 2:
            raise MechanismError(f"{what}: a line is given by two points, got {brief(line)}")
        pair = (line[0], line[1])
        self._distinct(pair, what)
        return pair

    def _length_pair(self, pair: Any, points: list[str], what: str) -> tuple[str, str]:
        if isinstance(pair, str) or len(pair) != 2:
            raise MechanismError(
                f"{what}: a length is between two points, got {brief(pair)}; write {{('B', 'C'): 3.0}}"
            )
        for p in pair:
            if p not in points:
                raise MechanismError(f"{what}: length between {pair}: {p!r} is not one of its points {points}")
        if pair[0] == pair[1]:
            raise MechanismError(f"{what}: length between {pair[0]!r} and itself")
        return (pair[0], pair[1])
