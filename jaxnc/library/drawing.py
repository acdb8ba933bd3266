"""Geometry, places and default drives of ready mechanisms, and the checks of the dimensions that users give."""

import functools
import inspect
import math
from collections.abc import Callable, Collection, Iterable, Mapping
from itertools import combinations
from typing import Annotated, Any, Literal, TypeAlias, TypeVar, get_args, get_origin

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import MechanismError, brief, nearest
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.mechanism.checks import PARALLEL, Checks
from jaxnc.mechanism.model import Place

Length: TypeAlias = Annotated[float, "positive"]
"""A dimension that is above zero; a plain float may have any sign."""

_Draws = TypeVar("_Draws", bound=Callable[..., Mechanism])


class Misfit(MechanismError):
    """Dimensions that make no mechanism; `offer` puts the mechanism's name in front."""


def offer(draw: _Draws) -> _Draws:
    """Open a function that draws a mechanism to users, with checks of what they give.

    Annotations say what its dimensions may be: `Length` a positive number, float any finite one, a tuple of floats a
    place, a literal one of its words. The function gets floats, and what it refuses is said with its name.
    """
    signature = inspect.signature(draw)

    @functools.wraps(draw)
    def draw_checked(*args: object, **options: object) -> Mechanism:
        given = signature.bind(*args, **options)
        given.apply_defaults()
        try:
            for name, value in given.arguments.items():
                given.arguments[name] = check_dimension(name, value, signature.parameters[name].annotation)
            return draw(*given.args, **given.kwargs)
        except Misfit as error:
            raise MechanismError(f"{draw.__name__}: {error}") from None

    offered: Any = public(draw_checked)
    return offered


def check_dimension(name: str, value: object, kind: object) -> object:
    """Convert a dimension to what its annotation says; None is left where the annotation has it."""
    if type(None) in get_args(kind):
        (kind,) = (k for k in get_args(kind) if k is not type(None))
        if value is None:
            return None
    if get_origin(kind) is Literal:
        if value not in get_args(kind):
            raise Misfit(f"{name}={value!r}; use one of {', '.join(map(repr, get_args(kind)))}")
    elif kind in (float, Length):
        value = Checks.finite(value, name, Misfit)
        if kind is Length and value <= 0:
            raise Misfit(f"{name} must be positive, got {value:g}; give a length above zero")
    elif get_origin(kind) is tuple:
        value = as_numbers(name, value, len(get_args(kind)))
    return value


def as_numbers(name: str, value: Any, count: int) -> tuple[float, ...]:
    """Convert two or three finite numbers that the user gave."""
    try:
        found = tuple(value)
    except (TypeError, ValueError, OverflowError):
        found = ()
    if len(found) != count:
        raise Misfit(f"{name} must be {'two' if count == 2 else 'three'} numbers, got {brief(value)}")
    return tuple(Checks.finite(x, f"{name}[{i}]", Misfit) for i, x in enumerate(found))


# -- geometry and drives -----------------------------------------------------------------------------------------------


Point: TypeAlias = tuple[float, float]

Vector: TypeAlias = np.ndarray
"""Three components."""

Places: TypeAlias = Mapping[str, Place]
"""Points (lengths) and directions by name; the names of directions begin with v."""

TURN = math.tau
X, Y, Z = np.eye(3)

_STEPS = 1440  # poses tried around a full turn when looking for the limits of an input
FLAT = 0.005  # sine of a transmission angle: below it a dyad stands at a dead point (and no step above skips one)


# -- in the plane -----------------------------------------------------------------------------------------------


def polar(origin: Point, length: float, angle: float) -> Point:
    """The point at a distance from another, in a direction from the x axis."""
    return origin[0] + length * math.cos(angle), origin[1] + length * math.sin(angle)


def place_along(p: Point, q: Point, along: float, across: float) -> Point:
    """A point given in the frame of a segment: origin p, x axis towards q."""
    size = math.dist(p, q)
    x, y = (q[0] - p[0]) / size, (q[1] - p[1]) / size
    return p[0] + along * x - across * y, p[1] + along * y + across * x


def meet(p: Point, q: Point, side: float, /, **radii: float) -> Point:
    """The point at given distances from two others: the tip of a dyad.

    Args:
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
        raise Misfit(
            f"{first} = {r:g} and {second} = {s:g} do not close over {span:g}, which must lie well between "
            f"{abs(r - s):g} and {r + s:g}; change one of them, or start from another angle"
        )
    across = math.copysign(math.sqrt(square), side)
    return p[0] + (along * x - across * y) / span, p[1] + (along * y + across * x) / span


def turn_crank(a: Point, crank: float, d: Point, side: float, **radii: float) -> Callable[[float], tuple[Point, Point]]:
    """A function of a crank's angle that draws its tip, and that of the dyad from it to the pivot `d`; see `meet`."""

    def draw(phi: float) -> tuple[Point, Point]:
        b = polar(a, crank, phi)
        return b, meet(b, d, side, **radii)

    return draw


def reach_guide(pin: Point, bar: str, length: float, guide: str, height: float, side: float) -> Point:
    """The slider on a guide along x that a bar from a pin carries, to the right or to the left of the pin.

    Args:
        pin: where the bar begins, lengths.
        bar: name of the bar's length, for messages.
        length: of the bar.
        guide: name of the guide's height, for messages.
        height: of the guide.
        side: 1 for the slider to the right of the pin, -1 for the one to the left.
    """
    rise = height - pin[1]
    if abs(rise) >= length * math.sqrt(1.0 - FLAT**2):
        raise Misfit(
            f"{bar} = {length:g} does not reach to {guide} = {height:g}, which is {abs(rise):g} away; give a longer "
            f"{bar}, another {guide}, or start from another angle"
        )
    return pin[0] + side * math.sqrt(length**2 - rise**2), height


# -- in space ---------------------------------------------------------------------------------------------------


def unit_vector(a: Vector) -> Vector:
    """A vector divided by its length."""
    return a / np.linalg.norm(a)


def across_axis(a: Vector, axis: Vector) -> Vector:
    """The unit vector along the part of `a` across a unit `axis`."""
    return unit_vector(a - (a @ axis) * axis)


def rotate(a: Vector, axis: Vector, angle: float) -> Vector:
    """Turn a vector about a unit axis by an angle in radians, by the right-hand rule."""
    along = (a @ axis) * axis
    return along + math.cos(angle) * (a - along) + math.sin(angle) * np.cross(axis, a)


def revolve_point(pivot: Vector, axis: Vector, point: Vector, angle: float) -> Vector:
    """Turn a point about an axis through a pivot by an angle in radians."""
    return pivot + rotate(point - pivot, axis, angle)


def check_swing(pivot: Vector, axis: Vector, point: Vector, length: float, names: str) -> Callable[[Vector], object]:
    """A function of a target that raises where a point turning about an axis can hardly be at a distance from it."""
    arm = (point - pivot) - ((point - pivot) @ axis) * axis
    centre, quarter = point - arm, np.cross(axis, arm)

    def check(target: Vector) -> None:
        w = target - centre
        a, b, c = w @ arm, w @ quarter, 0.5 * (w @ w + arm @ arm - length**2)
        if a * a + b * b - c * c <= FLAT**2 * (a * a + b * b):
            raise Misfit(f"{names} does not close, or is at a dead point; move its places")

    return check


# -- places of the user's ---------------------------------------------------------------------------------------


def as_places(
    given: Mapping[str, object] | None, drawn: Mapping[str, object], dim: int, argument: str
) -> dict[str, Vector]:
    """Convert places that the user moves; `argument` is what the user calls them."""
    out = {}
    for name, value in (given or {}).items():
        if name not in drawn:
            raise Misfit(f"{argument} has no {name!r} to move; {nearest(name, drawn)}")
        out[name] = np.array(as_numbers(f"{argument}[{name!r}]", value, dim))
    return out


def hardpoints(drawn: Places, places: Mapping[str, object] | None) -> dict[str, Vector]:
    """The default hardpoints of a mechanism, some of them replaced by the user's; directions made unit."""
    out = {name: np.array(value, dtype=float) for name, value in drawn.items()}
    out |= as_places(places, drawn, len(next(iter(out.values()))), "places")
    for name, value in out.items():
        if name.startswith("v"):
            if not value.any():
                raise Misfit(f"places[{name!r}] is a zero vector; give it a direction")
            out[name] = unit_vector(value)
    return out


def check_apart(places: Mapping[str, Any], *pairs: tuple[str, str], body: str = "") -> None:
    """Refuse points of one body that are drawn at the same place."""
    for p, q in pairs:
        if math.dist(places[p], places[q]) == 0.0:
            where = f" of the {body}" if body else ""
            raise Misfit(f"{p!r} and {q!r}{where} are at the same place; move one of them")


def check_off_axis(places: Mapping[str, Vector], point: str, pivot: str, axis: str) -> None:
    """Refuse a point on the axis about which it is to turn."""
    check_apart(places, (pivot, point))
    arm = places[point] - places[pivot]
    if np.linalg.norm(np.cross(arm, places[axis])) <= PARALLEL * np.linalg.norm(arm):
        raise Misfit(
            f"point {point!r} is on the axis through {pivot!r} along {axis!r}, about which it is to turn; move it off"
        )


def check_skew(first: str, a: Vector, second: str, b: Vector) -> None:
    """Refuse two directions that are parallel."""
    if np.linalg.norm(np.cross(a, b)) <= PARALLEL * np.linalg.norm(a) * np.linalg.norm(b):
        raise Misfit(f"{first} and {second} are parallel; turn one of them")


# -- the mechanism ----------------------------------------------------------------------------------------------


def lay_out(
    name: str,
    description: str,
    ground: Places,
    moving: Places,
    bodies: Mapping[str, str],
    fixed: Mapping[str, str] | None = None,
    **units: str,
) -> Mechanism:
    """Describe a mechanism by its places and bodies; joints and coordinates are added to it.

    Args:
        name: its name.
        description: what it is, in a sentence.
        ground: places of points on the ground, and directions of its vectors.
        moving: the same of what moves.
        bodies: the names of the points and vectors of each, with spaces between them.
        fixed: coordinates of moving points that never change, such as ``{"R": "y"}``.
        **units: of length and angle, see `Mechanism`.
    """
    dim = len(next(iter({**ground, **moving}.values())))
    m = Mechanism(name, dim=dim, description=description, **units)
    for item, at in ground.items():
        (m.ground_vector if item.startswith("v") else m.ground)(item, at)
    for item, at in moving.items():
        if item.startswith("v"):
            m.vector(item, at)
        else:
            m.point(item, at, fixed=(fixed or {}).get(item, ""))
    for body, names in bodies.items():
        points = [n for n in names.split() if not n.startswith("v")]
        m.body(body, points, vectors=[n for n in names.split() if n.startswith("v")])
    return m


def lay_out_joints(
    name: str, description: str, places: Places, ground: Collection[str], bodies: Mapping[str, str]
) -> Mechanism:
    """Describe a mechanism by its joints, which are apart in each body; `ground` names those that do not move."""
    for body, names in bodies.items():
        check_apart(places, *combinations(names.split(), 2), body=body)
    on = {joint: at for joint, at in places.items() if joint in ground}
    return lay_out(name, description, on, {joint: at for joint, at in places.items() if joint not in on}, bodies)


def drive(m: Mechanism, outputs: Iterable[str], inputs: Mapping[str, tuple[float, float]]) -> Mechanism:
    """Store the default drive of a mechanism: 361 poses, every input from one value to another within one second."""
    drives = {name: record.Drive(start, end, rate=end - start) for name, (start, end) in inputs.items()}
    m.model.run = record.Run(inputs=drives, outputs=list(outputs))
    return m


def crank_travel(draw: Callable[[float], object], home: float = 0.0) -> tuple[float, float]:
    """Find how far an input angle can go on the branch of the drawing.

    Args:
        draw: draws the mechanism at an angle, or raises.
        home: the angle of the drawing, radians.

    Returns:
        From 0 to 2π if the mechanism turns through, otherwise its range with a little left out at both
        ends (at the very end the input is at a dead point), radians.
    """

    def possible(angle: float) -> bool:
        try:
            draw(angle)
        except Misfit:
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
    return _leave_margin(*limits)


def reach(follow: Callable[[float, float], float | None]) -> tuple[float, float]:
    """Find how far a crank can go where the output has no closed form: from 0 to 2π, or its range less a little.

    `follow` gives the output at a crank angle, found from the output a step before; None at and beyond a dead point.
    Both are zero in the drawing, radians.
    """
    step, limits = 2.0 * TURN / _STEPS, []
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
    return _leave_margin(limits[1], limits[0])


def _leave_margin(low: float, high: float) -> tuple[float, float]:
    """Leave out a part of a limited range at either end."""
    cut = 0.02 * (high - low)
    return low + cut, high - cut
