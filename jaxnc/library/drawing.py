"""Home poses from dimensions: the plane geometry that ready mechanisms are drawn with, and their default drives."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from jaxnc.errors import MechanismError, drawn_with_numbers, nearest
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.mechanism.checks import LARGEST

Point = tuple[float, float]

TURN = 2.0 * math.pi
_STEPS = 1440  # poses tried around a full turn when looking for the limits of an input
_MARGIN = 0.02  # part of a limited range that a default drive leaves out at either end
FLAT = 0.005  # sine of a transmission angle: below it a dyad stands at a dead point (and no step above skips one)


def number(what: str, **values: Any) -> tuple[float, ...]:
    """Finite numbers by name, as floats in order; `what` is the mechanism, for messages."""
    out = []
    for name, value in values.items():
        try:
            out.append(float(value))
        except (TypeError, ValueError, OverflowError):
            why = drawn_with_numbers(value) or f", got {value!r}"
            raise MechanismError(f"{what}: {name} must be a number{why}") from None
        if not abs(out[-1]) <= LARGEST:
            raise MechanismError(f"{what}: {name} must be finite, at most {LARGEST:g}, got {value!r}")
    return tuple(out)


def positive(what: str, **values: Any) -> tuple[float, ...]:
    """Positive lengths by name, as floats in order."""
    out = number(what, **values)
    for name, value in zip(values, out, strict=True):
        if value <= 0:
            raise MechanismError(f"{what}: {name} must be positive, got {value:g}; give a length above zero")
    return out


def place(what: str, name: str, value: Any) -> Point:
    """Two finite numbers: the argument `name` of the mechanism `what`."""
    try:
        x, y = value
    except (TypeError, ValueError, OverflowError):
        raise MechanismError(f"{what}: {name} must be two numbers, got {value!r}") from None
    x, y = number(what, **{f"{name}[0]": x, f"{name}[1]": y})
    return x, y


def choice(what: str, name: str, value: Any, allowed: Iterable[str]) -> str:
    """The value of the argument `name`, one of the allowed words."""
    allowed = tuple(allowed)
    if value not in allowed:
        raise MechanismError(f"{what}: {name}={value!r}; use one of {', '.join(map(repr, allowed))}")
    return value


def polar(origin: Point, length: float, angle: float) -> Point:
    """The point at a distance from another, in a direction from the x axis."""
    return origin[0] + length * math.cos(angle), origin[1] + length * math.sin(angle)


def carried(p: Point, q: Point, along: float, across: float) -> Point:
    """A point given in the frame of a segment: origin p, x axis towards q."""
    size = math.dist(p, q)
    x, y = (q[0] - p[0]) / size, (q[1] - p[1]) / size
    return p[0] + along * x - across * y, p[1] + along * y + across * x


def meet(what: str, p: Point, q: Point, side: float, /, **radii: float) -> Point:
    """The point at given distances from two others: the tip of a dyad.

    Args:
        what: the mechanism, for messages.
        p: first centre, lengths.
        q: second centre, lengths.
        side: positive for the point to the left of the way from p to q, negative for the one to the right.
        **radii: the two distances, by the names of the dimensions, that to p first.
    """
    (first, r), (second, s) = radii.items()
    x, y = q[0] - p[0], q[1] - p[1]
    span = math.hypot(x, y)
    along = (span**2 + r**2 - s**2) / (2.0 * span) if span else math.inf
    square = r**2 - along**2
    if square <= 0 or math.sqrt(square) * span <= FLAT * r * s:
        raise MechanismError(
            f"{what}: {first} = {r:g} and {second} = {s:g} do not close over {span:g}, which must lie well between "
            f"{abs(r - s):g} and {r + s:g}; change one of them, or start from another angle"
        )
    across = math.copysign(math.sqrt(square), side)
    return p[0] + (along * x - across * y) / span, p[1] + (along * y + across * x) / span


def travel(draw: Callable[[float], object], home: float) -> tuple[float, float]:
    """How far an input angle can go on the branch of the drawing.

    Returns:
        From 0 to 2π if the mechanism turns through, otherwise its range with a little left out at both
        ends (at the very end the input is at a dead point), radians.
    """

    def possible(angle: float) -> bool:
        try:
            draw(angle)
        except MechanismError:
            return False
        return True

    step = TURN / _STEPS
    if all(possible(home + k * step) for k in range(_STEPS)):
        return 0.0, TURN
    limits = []
    for sign in (-1.0, 1.0):
        k = 1
        while k < _STEPS and possible(home + sign * k * step):
            k += 1
        good, bad = (k - 1) * step, k * step
        for _ in range(40):
            middle = 0.5 * (good + bad)
            good, bad = (middle, bad) if possible(home + sign * middle) else (good, middle)
        limits.append(home + sign * good)
    cut = _MARGIN * (limits[1] - limits[0])
    return limits[0] + cut, limits[1] - cut


def drive(m: Mechanism, outputs: Iterable[str], inputs: Mapping[str, tuple[float, float]]) -> Mechanism:
    """Store the default drive of a mechanism: 361 poses, every input from one value to another within one second."""
    drives = {name: record.Drive(start, end, rate=end - start) for name, (start, end) in inputs.items()}
    m.model.run = record.Run(inputs=drives, outputs=list(outputs))
    return m


def hardpoints(
    what: str, drawn: Mapping[str, Point], bodies: Mapping[str, list[str]], places: Mapping[str, Any] | None
) -> dict[str, Point]:
    """The default places of a mechanism's points, some of them replaced by the user's; apart in each of its bodies."""
    out = dict(drawn)
    for name, value in (places or {}).items():
        if name not in drawn:
            raise MechanismError(f"{what}: places has no point {name!r} to move; {nearest(name, drawn)}")
        out[name] = place(what, f"places[{name!r}]", value)
    for body, points in bodies.items():
        for i, p in enumerate(points):
            for q in points[i + 1 :]:
                if math.dist(out[p], out[q]) == 0:
                    raise MechanismError(
                        f"{what}: {p!r} and {q!r} of the {body} are at the same place; move one of them"
                    )
    return out
