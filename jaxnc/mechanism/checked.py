"""The records of a mechanism with the checks of names and numbers that every builder method makes."""

import math
from collections.abc import Iterable
from typing import Any

from jaxnc.errors import MechanismError, nearest
from jaxnc.mechanism import model as record


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
