"""Checks of names and numbers in a description, made before anything is written down."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from jaxnc.errors import MechanismError, brief, drawn_with_numbers, nearest, writable
from jaxnc.mechanism import model as record

PUNCTUATION = ' .-,;=()[]"'  # not in names of quantities: "B.x", "P-Q", "v(phi) [rad/s]", phi=0:6

LARGEST = 1e100  # of a number in a description: its square is still one
PARALLEL = 1e-9  # sine of an angle below which directions are parallel

TENSOR = (0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)  # xx, yy, zz, xy, xz, yz


class Checks:
    """Checks against what a model has already.

    Each takes what a user gave and `what` it is for, and raises a `MechanismError` that says what to give instead.

    Args:
        model: the records.
    """

    def __init__(self, model: record.Model):
        self.model = model

    def in_space(self, what: str, instead: str = "") -> None:
        """Refuse a mechanism in the plane; `instead` is what to use there."""
        if self.model.dim != 3:
            raise MechanismError(f"{what} is for mechanisms in space, Mechanism(dim=3)" + (instead and f"; {instead}"))

    @staticmethod
    def refuse_unknown(name: str, names: Iterable[str], noun: str, what: str) -> None:
        """Refuse a name that is none of those that there are."""
        if name not in names:
            raise MechanismError(f"{what}: unknown {noun} {name!r}; {nearest(name, names)}")

    def vector(self, name: str, what: str) -> None:
        """Refuse what is not the name of a vector."""
        if not isinstance(name, str) or name not in self.model.all_vectors:
            known = self.model.all_vectors
            hint = nearest(name, known) if known else "there are no vectors yet; add one with vector()"
            raise MechanismError(f"{what}: unknown vector {name!r}; {hint}")

    def direction(self, spec: object, what: str) -> record.Direction:
        """Check a direction: the name of a vector, or two different points."""
        if isinstance(spec, str):
            if spec in self.model.all_points:
                raise MechanismError(
                    f"{what}: {spec!r} is a point, which gives no direction; name a vector, or two points such as "
                    f"({spec!r}, 'Q')"
                )
            self.vector(spec, what)
            return spec
        return self.line(spec, what)

    def directions(self, specs: object, what: str) -> tuple[record.Direction, record.Direction]:
        """Check two directions, one of each body."""
        if isinstance(specs, str) or not isinstance(specs, (tuple, list)) or len(specs) != 2:
            raise MechanismError(
                f"{what}: give two directions, one of each body, such as ('u', ('P', 'Q')); got {brief(specs)}"
            )
        return self.direction(specs[0], what), self.direction(specs[1], what)

    def axis_line(self, line: object, what: str) -> tuple[str, str]:
        """Check a line: two points, or in space a point and a vector."""
        if isinstance(line, str) or not isinstance(line, (tuple, list)) or len(line) != 2:
            raise MechanismError(f"{what}: a line is a point and a vector, or two points; got {brief(line)}")
        if self.model.dim == 3 and line[1] in self.model.all_vectors:
            self.point(line[0], what)
            return (line[0], line[1])
        return self.line(line, what)

    def point(self, name: str | None, what: str) -> None:
        """Refuse what is not the name of a point."""
        if not isinstance(name, str):
            raise MechanismError(f"{what}: the name of a point is wanted, after its own; got {brief(name)}")
        if name not in self.model.ground and name not in self.model.points:
            if name in self.model.markers:
                raise MechanismError(
                    f"{what}: {name!r} is a marker, which only rides on a body; make it a point of that body instead"
                )
            if name in self.model.all_vectors:
                raise MechanismError(f"{what}: {name!r} is a vector; a point is wanted here")
            raise MechanismError(f"{what}: unknown point {name!r}; {nearest(name, self.model.all_points)}")

    def names(self, names: Any, known: Iterable[str], what: str, noun: str = "point") -> list[str]:
        """Make a list of names. One name may stand by itself, but letters of a text are no list."""
        if isinstance(names, str):
            if names not in known and len(names) > 1 and set(names) <= set(known):
                raise MechanismError(f"{what}: {names!r} is one name, and no {noun}; as a list, write {list(names)}")
            return [names]
        try:
            return list(names)
        except TypeError:
            raise MechanismError(f"{what}: {noun}s are a list of names, got {brief(names)}") from None

    def scalar(self, name: str, what: str) -> None:
        """Refuse what is not the name of a coordinate."""
        if not isinstance(name, str):
            raise MechanismError(f"{what}: the name of a coordinate is wanted, after its own; got {brief(name)}")
        point, _, axis = name.partition(".")
        spread = (*self.model.all_points, *self.model.all_vectors)
        if name in self.model.scalar_names or (axis and axis in self.model.axes and point in spread):
            return
        hint = nearest(name, (*self.model.scalar_names, *(f"{p}.{a}" for p in spread for a in self.model.axes)))
        raise MechanismError(f"{what}: unknown coordinate {name!r}; {hint}")

    def new_quantity(self, name: str, noun: str) -> None:
        """Refuse a name that no new point, vector, marker or coordinate can have."""
        m = self.model
        self.name(name, noun)
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
            *((f"a coordinate of joint {n!r}", j.coordinates) for n, j in m.joints.items() if j.coordinates),
        ):
            if name in taken:
                raise MechanismError(f"{noun} {name!r}: the name is already taken by {what}; choose another")

    def new_name(self, name: str, taken: Iterable[str], noun: str) -> None:
        """Refuse a name that is taken already, or is none."""
        self.name(name, noun)
        if name in taken:
            raise MechanismError(f"{noun} {name!r}: the name is already taken by another {noun}; choose another")

    def name(self, name: str, noun: str) -> None:
        """Refuse what is no name, or would not come back from a file, a table or a screen as it was."""
        if not isinstance(name, str):
            raise MechanismError(f"a {noun} has its name first, which is a text; got {brief(name)} for the name")
        if not name:
            raise MechanismError(f"{noun} {name!r}: its name is empty; give it one")
        self.text(name, noun)
        if unseen := [letter for letter in name if not letter.isprintable()]:
            raise MechanismError(
                f"{noun} {name!r}: names are of letters that can be seen; this one has {unseen[0]!r}, a control or "
                f"format character or a space that is none of the keyboard's"
            )
        if name != name.strip():
            raise MechanismError(f"{noun} {name!r}: names do not begin or end with a space")

    @staticmethod
    def text(text: str, noun: str) -> None:
        """Refuse a text that cannot be written."""
        if isinstance(text, str) and not writable(text):
            raise MechanismError(f"{noun} {text!r} holds half of a character (a lone surrogate); type it anew")

    def place(self, at: Any, what: str, noun: str = "place") -> tuple[float, ...]:
        """Check a position, or components of a vector, `dim` numbers."""
        try:
            place = tuple(float(x) for x in at)
        except (TypeError, ValueError, OverflowError):
            place = ()
        if len(place) != self.model.dim:
            why = drawn_with_numbers(at) or f", got {brief(at)}"
            raise MechanismError(f"{what}: its {noun} must be {self.model.dim} numbers{why}")
        for x in place:
            self.finite(x, f"{what}: each number of its {noun}")
        return place

    def unit(self, direction: object, what: str) -> tuple[float, ...]:
        """Check a vector of any length but zero."""
        place = self.place(direction, what, "direction")
        if not any(place):
            raise MechanismError(f"{what} is the zero vector, which has no direction; give one component at least")
        return place

    @staticmethod
    def finite(value: Any, what: str, error: type[MechanismError] = MechanismError) -> float:
        """Check a number."""
        try:
            number = float(value)
        except (TypeError, ValueError, OverflowError):
            why = drawn_with_numbers(value) or f", got {brief(value)}"
            raise error(f"{what} must be a number{why}") from None
        if not abs(number) <= LARGEST:
            raise error(f"{what} must be a finite number, at most {LARGEST:g}, got {brief(value)}")
        return number

    def positive(self, value: object, what: str) -> float:
        """Check a positive number."""
        number = self.finite(value, what)
        if number <= 0:
            raise MechanismError(f"{what} must be positive, got {brief(value)}")
        return number

    def radius(self, value: float | None, what: str) -> float | None:
        """Check a radius; None is read off the drawing."""
        return None if value is None else self.positive(value, f"{what}: radius")

    def distinct(self, pair: tuple[str | None, str | None], what: str) -> None:
        """Refuse two points that are one, or none."""
        for p in pair:
            self.point(p, what)
        if pair[0] == pair[1]:
            raise MechanismError(f"{what} needs two different points, got {pair[0]!r} twice")

    def line(self, line: object, what: str) -> tuple[str, str]:
        """Check a line given by two points."""
        if not isinstance(line, (tuple, list)) or len(line) != 2:
            raise MechanismError(f"{what}: a line is given by two points, got {brief(line)}")
        pair = (line[0], line[1])
        self.distinct(pair, what)
        return pair

    def length_pair(self, pair: Any, points: list[str], what: str) -> tuple[str, str]:
        """Check the two points of a body between which a length is."""
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

    def slide(self, line: object, on: object, what: str) -> tuple[tuple[str, str], str | tuple[str, str]]:
        """Check a line of one body, and the point, or the line, of another that slides along it."""
        line = self.axis_line(line, what)
        if isinstance(on, str):
            self.point(on, what)
            if on in line:
                raise MechanismError(f"{what}: point {on!r} is one of the points of its own line {line}")
            return line, on
        return line, self.axis_line(on, what)

    def new_coordinates(self, angle: str, distance: str, what: str) -> None:
        """Check the names of the angle and the distance that a joint makes."""
        self.new_quantity(angle, f"{what}: angle")
        self.new_quantity(distance, f"{what}: distance")
        if angle == distance:
            raise MechanismError(f"{what}: angle and distance are both called {angle!r}")

    def pressure(self, angle: float | None, what: str) -> float | None:
        """Check a pressure angle."""
        if angle is None:
            return None
        number = self.finite(angle, f"{what}: pressure_angle")
        if not 0.0 <= number < 1.0:
            raise MechanismError(
                f"{what}: pressure_angle={number:g} must be in radians, from 0 to below 1 (20° is 0.349)"
            )
        return number

    def not_negative(self, value: object, what: str) -> float:
        """Check a number that may be zero."""
        number = self.finite(value, what)
        if number < 0:
            raise MechanismError(f"{what} cannot be negative, got {value!r}")
        return number

    def numbers(self, values: Any, what: str) -> tuple[float, ...]:
        """Check a number, or several."""
        several = isinstance(values, list | tuple) or np.ndim(values) == 1
        return tuple(self.finite(x, what) for x in (values if several else (values,)))

    def tensor(self, inertia: object, what: str) -> float | tuple[float, ...]:
        """Check an inertia: a number in the plane, six numbers in space."""
        try:
            values = np.asarray(inertia, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise MechanismError(f"{what}: inertia must be numbers, got {inertia!r}") from None
        if not np.all(np.isfinite(values)):
            raise MechanismError(f"{what}: inertia must be finite, got {inertia!r}")
        if self.model.dim == 2:
            if values.shape != ():
                raise MechanismError(f"{what}: in the plane inertia is one number, got shape {values.shape}")
            return self.not_negative(values, f"{what}: inertia")
        if values.shape == (3,):
            values = np.diag(values)
        elif values.shape == (6,):
            values = values[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
        if values.shape != (3, 3):
            raise MechanismError(
                f"{what}: in space inertia is a matrix (3, 3), its diagonal, or (xx, yy, zz, xy, xz, yz); got shape "
                f"{values.shape}"
            )
        size = float(np.abs(values).max()) or 1.0
        if np.abs(values - values.T).max() > 1e-9 * size:
            raise MechanismError(f"{what}: its inertia tensor is not symmetric; give a symmetric one")
        principal = np.linalg.eigvalsh(values)
        shown = ", ".join(f"{p:.6g}" for p in principal)
        if principal[0] < -1e-9 * size or principal[2] > principal[0] + principal[1] + 1e-9 * size:
            raise MechanismError(
                f"{what}: no body has this inertia tensor: its principal moments {shown} must be positive, and none "
                f"larger than the sum of the others; check the signs of the products of inertia, and that it is about "
                f"the centre of mass"
            )
        return tuple(float(values[i, j]) for i, j in TENSOR)
