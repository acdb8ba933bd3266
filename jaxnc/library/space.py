"""Home poses in space: hardpoints and directions, rotations, and how far a crank turns."""

import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np

from jaxnc.errors import MechanismError, nearest
from jaxnc.library.drawing import FLAT, TURN, number
from jaxnc.mechanism.model import Place

Vector: TypeAlias = np.ndarray
"""Three components."""

Places: TypeAlias = Mapping[str, Place]
"""Points (lengths) and directions by name; the names of directions begin with v."""

X, Y, Z = (np.array(axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))

_STEPS = 720  # poses tried around a full turn when looking for the limits of a crank
_MARGIN = 0.02  # part of a limited range that a default drive leaves out at either end
_IN_LINE = 1e-9  # sine of an angle below which directions are parallel


def triple(what: str, name: str, value: Any) -> Vector:
    """Three finite numbers: the argument `name` of the mechanism `what`."""
    try:
        x, y, z = value
    except (TypeError, ValueError, OverflowError):
        raise MechanismError(f"{what}: {name} must be three numbers, got {value!r}") from None
    return np.array(number(what, **{f"{name}[0]": x, f"{name}[1]": y, f"{name}[2]": z}))


def hardpoints(what: str, drawn: Places, places: Mapping[str, Any] | None) -> dict[str, Vector]:
    """The default hardpoints of a mechanism, some of them replaced by the user's; directions made unit."""
    out = {name: np.array(value, dtype=float) for name, value in drawn.items()}
    for name, value in (places or {}).items():
        if name not in drawn:
            raise MechanismError(f"{what}: places has no {name!r} to move; {nearest(name, drawn)}")
        out[name] = triple(what, f"places[{name!r}]", value)
    for name, value in out.items():
        if name.startswith("v"):
            if not value.any():
                raise MechanismError(f"{what}: places[{name!r}] is a zero vector; give it a direction")
            out[name] = unit(value)
    return out


def apart(what: str, places: Mapping[str, Vector], *pairs: tuple[str, str]) -> None:
    """Refuse points of one body that are drawn at the same place."""
    for p, q in pairs:
        if np.array_equal(places[p], places[q]):
            raise MechanismError(f"{what}: {p!r} and {q!r} are at the same place; move one of them")


def off_axis(what: str, places: Mapping[str, Vector], point: str, pivot: str, axis: str) -> None:
    """Refuse a point on the axis about which it is to turn."""
    apart(what, places, (pivot, point))
    arm = places[point] - places[pivot]
    if np.linalg.norm(np.cross(arm, places[axis])) <= _IN_LINE * np.linalg.norm(arm):
        raise MechanismError(
            f"{what}: point {point!r} is on the axis through {pivot!r} along {axis!r}, about which it is to turn; move "
            f"it off"
        )


def skew(what: str, first: str, a: Vector, second: str, b: Vector) -> None:
    """Refuse two directions that are parallel."""
    if np.linalg.norm(np.cross(a, b)) <= _IN_LINE * np.linalg.norm(a) * np.linalg.norm(b):
        raise MechanismError(f"{what}: {first} and {second} are parallel; turn one of them")


def unit(a: Vector) -> Vector:
    """A vector divided by its length."""
    return a / np.linalg.norm(a)


def across(a: Vector, axis: Vector) -> Vector:
    """The unit vector along the part of `a` across a unit `axis`."""
    return unit(a - (a @ axis) * axis)


def turned(a: Vector, axis: Vector, angle: float) -> Vector:
    """A vector turned about a unit axis by an angle in radians, by the right-hand rule."""
    along = (a @ axis) * axis
    return along + math.cos(angle) * (a - along) + math.sin(angle) * np.cross(axis, a)


def revolved(pivot: Vector, axis: Vector, point: Vector, angle: float) -> Vector:
    """A point turned about an axis through a pivot by an angle in radians."""
    return pivot + turned(point - pivot, axis, angle)


def swinging(
    what: str, pivot: Vector, axis: Vector, point: Vector, length: float, names: str
) -> Callable[[Vector], object]:
    """A function of a target that raises where a point turning about an axis can hardly be at a distance from it."""
    arm = (point - pivot) - ((point - pivot) @ axis) * axis
    centre, turned_arm = point - arm, np.cross(axis, arm)

    def check(target: Vector) -> None:
        w = target - centre
        a, b, c = w @ arm, w @ turned_arm, 0.5 * (w @ w + arm @ arm - length**2)
        if a * a + b * b - c * c <= FLAT**2 * (a * a + b * b):
            raise MechanismError(f"{what}: {names} does not close, or is at a dead point; move its places")

    return check


def reach(follow: Callable[[float, float], float | None]) -> tuple[float, float]:
    """How far a crank can go where the output has no closed form: from 0 to 2π, or its range less a little.

    `follow` gives the output at a crank angle, found from the output a step before; None at and beyond a dead point.
    Both are zero in the drawing, radians.
    """
    step, limits = TURN / _STEPS, []
    for sign in (1.0, -1.0):
        angle, output = 0.0, 0.0
        while abs(angle) < TURN - 0.5 * step:
            found = follow(angle + sign * step, output)
            if found is None:
                break
            angle, output = angle + sign * step, found
        else:
            return 0.0, TURN
        limits.append(angle)
    cut = _MARGIN * (limits[0] - limits[1])
    return limits[1] + cut, limits[0] - cut
