"""Conditions on a design besides its target: smooth functions of the design, zero or positive where they are met.

A condition is a small record with one method: `values` takes what is known of a design (`Seen`) and returns numbers,
made comparable with 1 by the size of the problem. A new one is a class like these, or `condition` around a function.
Its finite numbers are traced when `values` is called (see `jaxnc.synthesis.pytree`), so that other numbers compile
nothing anew.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.circuits import circuits
from jaxnc.kinematics.flip import flip_margin
from jaxnc.kinematics.inputs import positive
from jaxnc.kinematics.instant import transmission_angle as angle_at
from jaxnc.kinematics.motion import Motion
from jaxnc.pickling import Remade
from jaxnc.synthesis.loops import Loop, four_bar_loop, loop_sines
from jaxnc.synthesis.pytree import Leaves
from jaxnc.synthesis.validate import as_floats, as_interval, call_on_motion, check_limit, check_name
from jaxnc.system.system import System
from jaxnc.types import Array, ArrayLike

LARGE = 20.0  # sizes of a problem: a link is not longer, and a mechanism not wider, unless that is asked for
LEAST_TRANSMISSION = float(np.radians(5.0))  # below it a mechanism hardly moves what it drives: that is a defect
NO_POSE = -1.0  # in place of a margin where there is no pose


class Seen(NamedTuple):
    """A design and its motions, as a condition sees them."""

    system: System  # the design
    motion: Motion  # its poses at the targets
    turn: Motion | None  # its poses over the whole range of the input, None unless a condition asks for them
    size: float  # length by which lengths are made comparable

    def distance(self, a: str, b: str) -> Array:
        """Distance of two points at the first target."""
        return jnp.linalg.norm(self.motion[a][0] - self.motion[b][0])


@public
@dataclass(frozen=True)
class Condition(Leaves):
    """A condition on a design.

    Attributes:
        words: what reports call it, a format of its fields; the name of its class if not given.
        planar: the function that makes it, if it is for planar mechanisms only.
        equality: whether its values must be zero; otherwise they must not be negative.
        over_range: whether it looks at the whole range of the input.
        turning: whether it makes sure that the input can go through its whole range.
    """

    words = ""
    planar = ""
    equality = False
    over_range = False
    turning = False

    @property
    def name(self) -> str:
        """Name in reports."""
        return self.words.format(self) or type(self).__name__.lower()

    @property
    def spans(self) -> tuple[tuple[str, str], ...]:
        """Pairs of points that it takes to keep their distance as the mechanism moves."""
        return ()

    @property
    def _points(self) -> tuple[str, ...]:
        """Names of points that it looks at."""
        return tuple(name for pair in self.spans for name in pair)

    def prepare(self, system: System, driven: str) -> "Condition":
        """Check names, and find out what needs to be found out once."""
        if self.planar and system.topology.dim != 2:
            raise InputError(f"{self.planar}: {system.name!r} is spatial; this condition is of the plane")
        check_points(system, self.name, *self._points)
        return self

    def over_turn(self, system: System, driven: str) -> "Condition":
        """The condition where the input goes once round, of which some are known without poses."""
        return self

    def values(self, seen: Seen) -> Array:
        """Numbers that are to be zero or positive, ``(k,)``."""
        raise NotImplementedError

    def sag(self, turn: Motion) -> float:
        """How far lengths between poses that follow each other are in doubt; more, the fewer the poses are."""
        return 0.0


@dataclass(frozen=True)
class Length(Condition):
    """Distance of two points of one body, or of the ground."""

    words = "length {0.start}-{0.end}"
    start: str
    end: str
    low: float = -np.inf
    high: float = np.inf

    @property
    def spans(self) -> tuple[tuple[str, str], ...]:
        return ((self.start, self.end),)

    def values(self, seen: Seen) -> Array:
        return _inside(seen.distance(self.start, self.end)[None], ((self.low, self.high),), seen.size)


@dataclass(frozen=True)
class Links(Condition):
    """Lengths that a user has not bounded, none of them many times the problem's size: a problem has it by itself."""

    pairs: tuple[tuple[str, str], ...]
    most: tuple[float, ...]  # of each pair

    @property
    def name(self) -> str:
        return f"links within {min(self.most):.4g}"

    def values(self, seen: Seen) -> Array:
        at = {name: seen.motion[name][0] for pair in self.pairs for name in pair}
        # Squares, as a length of zero has no derivative.
        squares = jnp.stack([jnp.sum((at[a] - at[b]) ** 2) for a, b in self.pairs])
        most = jnp.stack([jnp.asarray(m) for m in self.most])
        return (most - squares / most) / (2.0 * seen.size)


@dataclass(frozen=True)
class Equal(Condition):
    """Two lengths that are equal, or one that has a value."""

    first: tuple[str, str]
    second: tuple[str, str] | float
    equality = True

    @property
    def name(self) -> str:
        second = f"{self.second:g}" if isinstance(self.second, (int, float)) else "-".join(self.second)
        return f"{'-'.join(self.first)} = {second}"

    @property
    def spans(self) -> tuple[tuple[str, str], ...]:
        return (self.first, self.second) if isinstance(self.second, tuple) else (self.first,)

    def values(self, seen: Seen) -> Array:
        other = seen.distance(*self.second) if isinstance(self.second, tuple) else self.second
        return ((seen.distance(*self.first) - other) / seen.size)[None]


@dataclass(frozen=True)
class Symmetric(Condition):
    """Two points of the drawing are mirror images of each other."""

    words = "{0.first} and {0.second} symmetric"
    planar = "symmetric"
    first: str
    second: str
    about: tuple[str | tuple[float, float], str | tuple[float, float]]
    equality = True

    @property
    def _points(self) -> tuple[str, ...]:
        return tuple(n for n in (self.first, self.second, *self.about) if isinstance(n, str))

    def values(self, seen: Seen) -> Array:
        p, q = seen.motion[self.first][0], seen.motion[self.second][0]
        a, b = (seen.motion[n][0] if isinstance(n, str) else jnp.asarray(n) for n in self.about)
        way = (b - a) / jnp.linalg.norm(b - a)
        middle = 0.5 * (p + q) - a
        return jnp.stack([jnp.dot(p - q, way), way[0] * middle[1] - way[1] * middle[0]]) / seen.size


@dataclass(frozen=True)
class Within(Condition):
    """A point stays in a box, in every pose."""

    words = "{0.point} within"
    point: str
    box: tuple[tuple[float, float], ...]

    @property
    def _points(self) -> tuple[str, ...]:
        return (self.point,)

    def prepare(self, system: System, driven: str) -> "Condition":
        if len(self.box) > system.topology.dim:
            raise InputError(f"within({self.point!r}): {system.name!r} is planar; leave z= out")
        return super().prepare(system, driven)

    def values(self, seen: Seen) -> Array:
        return _inside(seen.motion[self.point], self.box, seen.size)


@dataclass(frozen=True)
class Local(Condition):
    """Coordinates of a point in the frame of a body: from one point of it, along the way to another one."""

    words = "{0.point} along {0.along[0]}-{0.along[1]}"
    point: str
    along: tuple[str, str]
    box: tuple[tuple[float, float], ...]
    planar = "local"

    @property
    def spans(self) -> tuple[tuple[str, str], ...]:
        return self.along, (self.along[0], self.point)

    def values(self, seen: Seen) -> Array:
        a, b, p = (seen.motion[n][0] for n in (*self.along, self.point))
        d = (b - a) / jnp.linalg.norm(b - a)
        place = jnp.dot(p - a, d), d[0] * (p - a)[1] - d[1] * (p - a)[0]
        return _inside(jnp.stack(place), self.box, seen.size)


@dataclass(frozen=True)
class Size(Condition):
    """The box around all points in all poses."""

    words = "size"
    most: float
    over_range = True

    def values(self, seen: Seen) -> Array:
        turn, top = seen.turn, seen.system.topology
        assert turn is not None
        spots = (*top.points, *(m.name for m in top.markers if not m.direction))
        q, good = jnp.stack([turn[name] for name in spots]), turn.converged[:, None]
        high, low = (end * jnp.max(jnp.where(good, end * q, -jnp.inf), axis=1) for end in (1.0, -1.0))
        # Of each two points, as a largest value has no derivative where another point takes over.
        extent = high[:, None] - low[None]
        return jnp.ravel(jnp.where(jnp.any(good), (self.most - extent) / seen.size, NO_POSE))


def is_four_bar(system: System) -> bool:
    """Tell whether a four-bar loop is all there is: three bars beside the ground."""
    return len(system.topology.bodies) == 3


@dataclass(frozen=True)
class CrankTurns(Condition):
    """The input goes through its whole range without a dead point."""

    words = "crank turns"
    kind: str | None = None
    margin: float = 0.0
    loop: Loop | None = None
    alone: bool = True  # whether that loop is all there is
    turning = True

    @property
    def over_range(self) -> bool:
        return self.loop is None or not self.alone

    def prepare(self, system: System, driven: str) -> "Condition":
        loop = four_bar_loop(system, driven)
        if self.kind is not None and loop is None:
            raise InputError(f"crank_turns(kind={self.kind!r}): {system.name!r} has no four-bar loop at {driven!r}")
        return CrankTurns(self.kind, self.margin, loop, is_four_bar(system))

    def values(self, seen: Seen) -> Array:
        rows = [] if self.loop is None else [self._grashof(self.loop, seen)]
        if self.over_range:
            assert seen.turn is not None
            found, good = loop_sines(seen.turn), seen.turn.converged[:, None]
            rows.append(jnp.where(good, found - jnp.maximum(self.margin, 1e-3), NO_POSE).reshape(-1))
        return jnp.concatenate(rows)

    def _grashof(self, loop: Loop, seen: Seen) -> Array:
        a, b, c, g = loop.lengths(seen.motion)
        if self.kind == "double-crank":
            a, g = g, a
        if self.kind is None:
            rows = (b + c - g - a, jnp.abs(g - a) - jnp.abs(b - c))
        else:  # the first of a, g is the shortest of all
            rows = (b + c - g - a, g - a - b + c, g - a + b - c)
        return jnp.stack(rows) / seen.size - self.margin


@dataclass(frozen=True)
class TransmissionAngle(Condition):
    """The transmission angle stays above a value over the whole range of the input."""

    words = "transmission angle"
    least: float
    joint: tuple[str, str, str] | None = None
    loop: Loop | None = None  # of a four-bar whose crank goes round

    @property
    def over_range(self) -> bool:
        return self.loop is None

    def prepare(self, system: System, driven: str) -> "Condition":
        if self.joint is not None:
            check_points(system, "transmission_angle", *self.joint)
            return self
        loop = four_bar_loop(system, driven)
        alone = loop is not None and is_four_bar(system)
        return TransmissionAngle(self.least, loop.names(system)[1:]) if loop is not None and alone else self

    def over_turn(self, system: System, driven: str) -> "Condition":
        loop = four_bar_loop(system, driven)
        own = loop is not None and is_four_bar(system) and self.joint == loop.names(system)[1:]
        return TransmissionAngle(self.least, self.joint, loop) if own else self

    def values(self, seen: Seen) -> Array:
        if self.loop is not None:
            rows = [jnp.cos(self.least) + sign * x for x in self.loop.extreme_cosines(seen.motion) for sign in (1, -1)]
            return jnp.stack(rows)
        assert seen.turn is not None
        if self.joint is None:
            found = loop_sines(seen.turn) - jnp.sin(self.least)
            return jnp.where(seen.turn.converged[:, None], found, NO_POSE).reshape(-1)
        # The angle itself has a corner at 90 degrees, where nothing is in danger.
        found = jnp.sin(angle_at(seen.turn, *self.joint)) - jnp.sin(self.least)
        return jnp.where(seen.turn.converged, found, NO_POSE)


@dataclass(frozen=True)
class NoFlip(Condition):
    """Every pose over the whole range of the input stays away from other assemblies, and from dead points."""

    words = "no flip"
    distance: float | None = None
    input: float | None = None
    over_range = True

    def values(self, seen: Seen) -> Array:
        assert seen.turn is not None
        found, good, rows = flip_margin(seen.turn), seen.turn.converged, []
        for value, least, size in ((found.distance, self.distance, seen.size), (found.input, self.input, 1.0)):
            if least is not None:
                near = jnp.isfinite(value)
                margin = jnp.where(near, (jnp.where(near, value, 0.0) - least) / size, 1.0)
                rows.append(jnp.where(good, margin, NO_POSE))
        return jnp.concatenate(rows)


@dataclass(frozen=True)
class OnlyCircuit(Condition):
    """Nothing but the design's circuit can be assembled over its range; a check of found designs, without a slope."""

    words = "only circuit"
    stops: tuple[tuple[str, tuple[float, float]], ...] = ()
    over_range = True

    def prepare(self, system: System, driven: str) -> "Condition":
        every = system.topology.coordinates
        for name, _ in self.stops:
            check_name(name, every, f"only_circuit: {system.name!r} has no coordinate {name!r} with a stop")
        return self

    def values(self, seen: Seen) -> Array:
        return jnp.zeros(0)

    def defect(self, turn: Motion) -> str:
        """Tell what can be assembled instead of a design that moves through its range; empty if nothing."""
        (name,) = turn.driven
        values = np.unique(np.asarray(turn.asked)[:, 0])
        try:
            found = circuits(turn.system, {name: values}, hold=turn.held, unit="rad")
        except InputError as error:  # of gears, cams and others whose assemblies cannot be listed
            return f"may be assembled on another circuit, which cannot be told: {error}"
        if found.doubtful:
            return "has circuits that cannot be told apart over its range"
        drawn = not self.stops
        for branch in found.branches:
            inside = np.ones(len(branch.poses.status), bool)
            for what, (low, high) in self.stops:
                inside &= (np.asarray(branch.poses[what]) >= low) & (np.asarray(branch.poses[what]) <= high)
            if branch.circuit != found.drawn and inside.any():
                at = np.asarray(branch.poses.inputs[name])[np.argmax(inside)]
                return f"can be assembled on another circuit, at {name} = {at:.4g}"
            drawn |= branch.circuit == found.drawn and bool(inside.any())
        return "" if drawn else "is never between the stops itself"


@dataclass(frozen=True)
class AnyTransmission(Condition):
    """Any transmission angle will do: it asks for nothing, and none is a defect."""

    words = "any transmission angle"

    def values(self, seen: Seen) -> Array:
        return jnp.zeros(0)


@dataclass(frozen=True)
class Own(Remade, Condition):
    """A function of a motion that is to be zero or positive."""

    noun = "condition"
    function: Callable[[Motion], Any]
    label: str = "condition"
    equality: bool = False
    over_range: bool = False
    words = "{0.label}"

    def values(self, seen: Seen) -> Array:
        motion = seen.turn if self.over_range else seen.motion
        return jnp.ravel(call_on_motion(self.function, f"condition {self.label!r}", motion))


@public
def crank_turns(kind: str | None = None, margin: float = 0.0) -> Condition:
    """The input turns fully: by Grashof's inequalities for a four-bar, else by its margin from dead points.

    Args:
        kind: ``"crank-rocker"`` or ``"double-crank"`` for one type of four-bar; any that turns if not given.
        margin: how far to stay away: of a four-bar a part of the problem's size, of others the least sine of the angle
            at which constraints meet (1e-3 at least).

    Source: F. Grashof; for other topologies the determinants of the loops' blocks over a sampled range.
    """
    if kind is not None:
        check_name(kind, ("crank-rocker", "double-crank"), f"crank_turns: kind={kind!r}")
    return CrankTurns(kind, check_limit("crank_turns", "zero or more", margin=margin))


@public
def transmission_angle(min: float, joint: tuple[str, str, str] | None = None) -> Condition:
    """The transmission angle is at least `min` radians over the whole range; of a four-bar over a turn exactly.

    Without such a condition, a design whose transmission angle falls below 5 degrees has a defect.

    Args:
        min: radians, between 0 and pi/2; 0 accepts any angle, also at a dead point.
        joint: far point of the coupler, the joint, far point of the driven bar; those of the four-bar loop if not
            given, else the angles at which the constraints of every loop meet.
    """
    if min == 0.0 and not isinstance(min, bool):
        return AnyTransmission()
    positive(min, "transmission_angle: min")
    if not min < np.pi / 2:
        raise InputError(
            f"transmission_angle: min must be between 0 and pi/2 radians, got {min!r} ({np.degrees(min):.6g} degrees)"
        )
    return TransmissionAngle(float(min), _as_joint(joint, "transmission_angle"))


@public
def no_flip(distance: float | None = None, input: float | None = None) -> Condition:
    """The mechanism does not flip into another assembly: it stays away from where two meet, over the whole range.

    Judged, as a transmission angle is, in the poses over the range that a search looks at; see `jaxnc.flip_margin`.

    Args:
        distance: how far a point would have to move at least to the nearest other assembly, a length.
        input: how far a dead point has to be from every pose at least, in radians or lengths of the input.
    """
    for value, what in ((distance, "distance"), (input, "input")):
        if value is not None:
            positive(value, f"no_flip: {what}")
    if distance is None and input is None:
        raise InputError("no_flip: give distance=, a length, or input=, how far dead points have to be, or both")
    return NoFlip(*(None if v is None else float(v) for v in (distance, input)))


@public
def only_circuit(stops: Mapping[str, tuple[float | None, float | None]] | None = None) -> Condition:
    """Over its range the mechanism closes on one circuit only, so that it cannot be assembled wrongly.

    This is no slope that a search could follow, but a check of the designs that it finds: one with another circuit, or
    that is never between the stops, has a defect, and is listed after all those without one. A four-bar that turns has
    two circuits in any case; stops tell which of them can be assembled. A circuit that closes outside of the range only
    counts as several, as `jaxnc.circuits` counts it.

    Args:
        stops: least and largest value of coordinates (``"psi"``, ``"C.y"``) by name, between which a pose has to be for
            it to be assembled; None is no bound.
    """
    found = dict(stops or {})
    if not all(isinstance(name, str) for name in found):
        raise InputError(f"only_circuit: stops={stops!r} must be bounds by name, such as {{'C.y': (0.0, None)}}")
    return OnlyCircuit(tuple((n, as_interval(b, f"only_circuit: the stop of {n!r}")) for n, b in found.items()))


@public
def length(start: str, end: str, min: float | None = None, max: float | None = None) -> Condition:
    """The distance of two points of one body (or of the ground) lies between two values."""
    low, high = as_interval((min, max), f"length {start}-{end}: its bounds")
    if not np.isfinite([low, high]).any():
        raise InputError(f"length {start}-{end}: give min=, max=, or both")
    if high < 0.0:
        raise InputError(f"length {start}-{end}: max={max!r}; a length is zero or more")
    return Length(start, end, low, high)


@public
def equal(first: tuple[str, str], second: tuple[str, str] | float) -> Condition:
    """Two lengths, each between two points, are equal; or one has a value."""
    for ends in (first, second):
        pair = isinstance(ends, (tuple, list)) and len(ends) == 2 and all(isinstance(name, str) for name in ends)
        if isinstance(ends, (tuple, list)) and pair and len({*ends}) < 2:
            raise InputError(f"equal: {ends!r} is no length: name two points")
        if not pair and (ends is first or isinstance(ends, bool) or not isinstance(ends, (int, float, np.number))):
            raise InputError(f"equal: {ends!r} must be the names of two points, as in equal(('A', 'B'), ('C', 'D'))")
    if isinstance(second, (tuple, list)):
        return Equal((first[0], first[1]), (second[0], second[1]))
    if not 0.0 <= second < np.inf:
        raise InputError(f"equal: {second!r}; a length is zero or more")
    return Equal((first[0], first[1]), float(second))


@public
def symmetric(first: str, second: str, about: Sequence[str | Sequence[float]] = ((0.0, 0.0), (0.0, 1.0))) -> Condition:
    """Two points (fixed pivots, joints at the first target) are mirror images of each other about a line.

    Args:
        first: a point.
        second: another one, or the same one, which is then on the line.
        about: two points of the line, each a name or its coordinates; the y axis if not given.
    """
    ends = tuple(about) if isinstance(about, (tuple, list)) else ()
    good = [place for e in ends if (place := e if isinstance(e, str) else _as_place(e)) is not None]
    if len(ends) != 2 or len(good) != 2 or good[0] == good[1]:
        raise InputError(f"symmetric: about={about!r} must be two points of a line, by name or as (x, y)")
    return Symmetric(first, second, (good[0], good[1]))


@public
def within(point: str, x: object = None, y: object = None, z: object = None) -> Condition:
    """A point (a fixed pivot, a joint, a tracer) stays between bounds in every pose."""
    return Within(point, _as_box(f"within({point!r})", *((x, y) if z is None else (x, y, z))))


@public
def local(point: str, along: tuple[str, str], x: object = None, y: object = None) -> Condition:
    """Coordinates of a point in a body's frame, from the first point of `along` towards the second, lie in bounds."""
    if not isinstance(along, (tuple, list)) or len(along) != 2 or along[0] == along[1]:
        raise InputError(f"local({point!r}): along={along!r} must be the names of two points, such as ('B', 'C')")
    return Local(point, (along[0], along[1]), _as_box(f"local({point!r})", x, y))


@public
def size(max: float) -> Condition:
    """The box around all points, the ground's too, is no wider and no higher than `max`, over the whole range."""
    positive(max, "size: max")
    return Size(float(max))


@public
def condition(
    function: Callable[[Motion], Any], name: str = "condition", equality: bool = False, over_range: bool = False
) -> Condition:
    """A condition of your own: a function of a motion whose numbers, of the order of 1, are not to be negative.

    Args:
        function: of the motion at the targets, or over the range.
        name: for reports.
        equality: its numbers are to be zero.
        over_range: whether it takes the motion over the whole range of the input.
    """
    if not callable(function):
        raise InputError(f"condition: {function!r} is no function of a motion, such as lambda m: m['P'][:, 1]")
    return Own(function, name, equality, over_range)


def _as_box(what: str, *axes: object) -> tuple[tuple[float, float], ...]:
    box = tuple(as_interval((None, None) if pair is None else pair, what) for pair in axes)
    if not np.isfinite(box).any():
        raise InputError(f"{what}: give x=(low, high), y=, or both")
    return box


def _as_place(place: Any) -> tuple[float, float] | None:
    found = as_floats(place)
    return (float(found[0]), float(found[1])) if found.shape == (2,) and np.isfinite(found).all() else None


def check_points(system: System, what: str, *names: str) -> None:
    """Refuse unknown names of points."""
    top = system.topology
    every = (*top.points, *(m.name for m in top.markers))
    for name in names:
        check_name(name, every, f"{what}: {top.name!r} has no point {name!r}")


def _inside(values: Array, box: Sequence[tuple[Any, Any]], size: Any) -> Array:
    """By how much numbers ``(…, k)`` stay above and below their bounds, as far as there are any."""
    rows = []
    for k, (low, high) in enumerate(box):
        rows += [values[..., k] - low] if _is_bound(low) else []
        rows += [high - values[..., k]] if _is_bound(high) else []
    return jnp.concatenate([jnp.ravel(row) for row in rows]) / size


def _is_bound(bound: ArrayLike) -> bool:
    """Tell whether a number, traced or not, is a bound; an infinite one is none, and never traced."""
    return not (isinstance(bound, float) and np.isinf(bound))


# -- how a mechanism stands --------------------------------------------------------------------------------------------

_SIDES = {"left": 1.0, "right": -1.0}


@dataclass(frozen=True)
class Direction(Condition):
    """The direction of a line from one point to another at the first target: a value, or between two."""

    words = "direction {0.start}-{0.end}"
    planar = "direction"
    start: str
    end: str
    low: float
    high: float
    equality: bool = False

    @property
    def _points(self) -> tuple[str, ...]:
        return self.start, self.end

    def values(self, seen: Seen) -> Array:
        way = seen.motion[self.end][0] - seen.motion[self.start][0]
        middle = 0.5 * (self.low + self.high)
        along = jnp.cos(middle) * way[0] + jnp.sin(middle) * way[1]
        across = jnp.cos(middle) * way[1] - jnp.sin(middle) * way[0]
        if self.equality:
            return jnp.arctan2(across, along)[None]
        # Its cosine has no jump opposite to the middle.
        return (along / jnp.linalg.norm(way) - jnp.cos(0.5 * (self.high - self.low)))[None]


@dataclass(frozen=True)
class Circuit(Condition):
    """The joint of a dyad stays on one side of the line between the dyad's ends."""

    planar = "on_circuit"
    side: float
    joint: tuple[str, str, str] | None = None

    @property
    def name(self) -> str:
        return f"circuit {'left' if self.side > 0.0 else 'right'}"

    def prepare(self, system: System, driven: str) -> "Condition":
        super().prepare(system, driven)
        if self.joint is None:
            loop = four_bar_loop(system, driven)
            if loop is None:
                raise InputError(
                    f"on_circuit: {system.name!r} has no four-bar loop at {driven!r}; say which joint decides it: "
                    f"joint=(far point of one bar, joint, far point of the other)"
                )
            return replace(self, joint=loop.names(system)[1:])
        check_points(system, "on_circuit", *self.joint)
        return self

    def values(self, seen: Seen) -> Array:
        assert self.joint is not None
        a, joint, b = (seen.motion[name] for name in self.joint)
        p, q = a - joint, b - joint
        across = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
        return self.side * across / (jnp.linalg.norm(p, axis=1) * jnp.linalg.norm(q, axis=1))


@public
def direction(
    start: str, end: str, value: float | None = None, min: float | None = None, max: float | None = None
) -> Condition:
    """The direction of the line from one point to another, of fixed pivots the angle of the ground.

    Of points that move, at the first target.

    Args:
        start: a point.
        end: another one.
        value: of the angle from the x axis, radians; or
        min: its least value, and
        max: its largest, less than a turn above it.
    """
    what = f"direction {start}-{end}"
    if start == end:
        raise InputError(f"{what}: name two points")
    if value is not None and min is None and max is None:
        low = high = _as_angle(value, f"{what}: its value")
    elif value is None and min is not None and max is not None:
        low, high = _as_angle(min, f"{what}: min"), _as_angle(max, f"{what}: max")
        if not 0.0 < high - low < 2 * np.pi:
            raise InputError(
                f"{what}: from min={low:g} to max={high:g} rad ({np.degrees(low):g} to {np.degrees(high):g} degrees) "
                f"must be a way forwards of less than a turn; add 2*pi to max to go through the negative x axis"
            )
    else:
        raise InputError(f"{what}: give a value, or min= and max= (of an angle neither says anything by itself)")
    return Direction(start, end, low, high, value is not None)


@public
def on_circuit(side: str, joint: tuple[str, str, str] | None = None) -> Condition:
    """The mechanism is assembled on one of its two circuits, in every pose through the targets.

    Args:
        side: ``"left"`` or ``"right"``: where the joint between coupler and rocker lies, seen along the line from the
            crank pin to the rocker's fixed pivot.
        joint: first end of another dyad, its joint, second end; those of the four-bar loop at the input if not given.
    """
    check_name(side, _SIDES, f"on_circuit: side={side!r}")
    return Circuit(_SIDES[side], _as_joint(joint, "on_circuit"))


def _as_joint(joint: object, what: str) -> tuple[str, str, str] | None:
    """Check that a joint is the names of three points: far points of two bars, and their joint between."""
    if joint is None:
        return None
    names = tuple(joint) if isinstance(joint, (tuple, list)) else ()
    if len({*names}) != 3 or len(names) != 3 or not all(isinstance(name, str) for name in names):
        raise InputError(
            f"{what}: joint={joint!r} must be the names of three points: the far point of one bar, the joint, the far "
            f"point of the other, as in joint=('B', 'C', 'D')"
        )
    first, between, last = names
    return first, between, last


def _as_angle(value: float, what: str) -> float:
    out = as_floats(value)
    if out.ndim or not abs(out) <= 4 * np.pi:
        raise InputError(f"{what} must be an angle in radians (numpy.radians makes them of degrees), got {value!r}")
    return float(out)
