"""Path and motion generation: a point goes through points, or along a curve; a body goes through poses."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.inputs import positive
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.synthesis.clearance import refuse_enclosed
from jaxnc.synthesis.conditions import Condition
from jaxnc.synthesis.problem import Extras, Problem, array_module
from jaxnc.synthesis.statement import compile_idea, complete, set_up
from jaxnc.synthesis.validate import as_floats, as_points, as_timing, as_weights, check_name, check_radians
from jaxnc.system.frames import quaternions
from jaxnc.system.system import System
from jaxnc.types import Array, ArrayLike, Numbers

_SENSE = "sense of the input"  # its sign counts


@public
@dataclasses.dataclass(frozen=True, eq=False, init=False, repr=False)
class PathGeneration(Problem):
    """A point goes through target points.

    Attributes:
        point: its name.
        target: the points, ``(M, dim)``.
        timing: values of the input at them, ``(M,)``; None where they are free.
        closed: whether the points follow one another round a closed curve.
        offset: whether prescribed timings count from a value of the input that is free.
        either_sense: whether the input may run the other way from there.
        ordered: whether free timings follow the order of the points; if not, each is that of the nearest point of the
            curve.
    """

    by_target = ("target", "weights")
    point: str
    target: np.ndarray
    timing: np.ndarray | None
    closed: bool
    offset: bool
    either_sense: bool
    ordered: bool
    _least = 3  # targets

    def __init__(
        self,
        mechanism: Mechanism | System,
        point: str,
        target: ArrayLike,
        timing: ArrayLike | None = None,
        input: str | None = None,
        free: Sequence[str] | None = None,
        bounds: Mapping[str, Sequence[float | None]] | None = None,
        subject_to: Sequence[Condition] = (),
        hold: Sequence[str] = (),
        travel: tuple[float, float] | None = None,
        closed: bool = False,
        offset: bool = False,
        weights: ArrayLike | None = None,
        minimax: bool = False,
        ordered: bool = True,
        start_timing: ArrayLike | None = None,
        either_sense: bool = False,
    ):
        """State the problem.

        Args:
            mechanism: the starting idea, as a `Mechanism` or compiled.
            point: name of the point or marker that traces the path.
            target: points it should go through, in order, ``(M, dim)``.
            timing: value of the input at each of them, radians or lengths; if not given they are free, and only the
                order of the points is kept (the error is then the distance to the curve).
            input: name of the driven coordinate; may be left out where there is only one angle or distance.
            free: names of what may change: points, markers, dimensions, components such as ``"D.x"``; all if not given.
            bounds: ``(low, high)`` by name of a variable, or of a length by the names of two points: ``"B-C"``.
            subject_to: conditions, see `jaxnc.synthesis.conditions`.
            hold: free coordinates that keep their start values.
            travel: range of the input that conditions look at; a full turn from the drawing where it is an angle.
            closed: the points follow one another round a closed curve, the last before the first.
            offset: the timings count from a value of the input that is free.
            weights: of the points.
            minimax: make the largest error small rather than the sum of squares.
            ordered: the points are passed in the order in which they are given. If not, the error at each is its
                distance to the nearest point of the curve, whatever comes before it.
            start_timing: of free timings, those of the starting idea: values of the input, ``(M,)``.
            either_sense: with `offset`, designs whose input runs the other way, by minus the timings, are sought too.

        Raises:
            InputError: unknown names, targets that are not finite or fewer than three, timings that do not match them,
                weights that are not positive; whatever contradicts itself.
        """
        what = type(self).__name__
        set_up(self, what, mechanism, input, free, bounds, subject_to, hold, travel)
        top, (low, high) = self.system.topology, self.travel
        turn = max(2 * np.pi, high - low) if top.is_angle(self.driven) else np.inf
        known = (*top.points, *(m.name for m in top.markers if not m.direction))
        check_name(point, known, f"{what}: {top.name!r} has no point {point!r}")
        places = top.dim * top.points.index(point) + np.arange(top.dim) if point in top.points else []
        if len(places) and np.array(top.fixed)[places].all():
            raise InputError(f"{what}: {point!r} is a ground point, which stays; name a point or marker that moves")
        goal = as_points(target, top.dim, what, self._least, closed)
        size = float(np.max(np.ptp(goal, axis=0)))
        if not size > 0:
            raise InputError(f"{what}: all target points are the same")
        refuse_enclosed(what, self.conditions, point, goal)
        asked = None
        if timing is not None:
            asked = as_timing(timing, len(goal), f"{what}: timing", turn)
        elif offset:
            raise InputError(
                f"{what}: offset=True lets given timings count from a value that is free; give timing=, or leave out "
                f"offset=: free timings begin anywhere"
            )
        if asked is not None and not (ordered and start_timing is None):
            raise InputError(
                f"{what}: timing= says where the input is at each target; leave it out for free timings, which "
                f"{'begin with start_timing=' if ordered else 'ordered=False makes those of the nearest points'}"
            )
        if either_sense and not (offset and asked is not None):
            raise InputError(
                f"{what}: either_sense=True lets the input run through given timings either way from a value that is "
                f"free; give timing= and offset=True (free timings go either way by themselves)"
            )
        if asked is None:
            span = high - low
            if not span > 0:
                raise InputError(f"{what}: free timing needs the range of {self.driven!r}: travel=(low, high)")
            count = len(goal)
            fill = span * (count - 1) / count if closed else 0.8 * span
            names = ("timing of the first point", *(f"timing from point {k} to {k + 1}" for k in range(1, count)))
            first = np.append(low, np.full(count - 1, fill / (count - 1)))
            if start_timing is not None:
                begun = as_timing(start_timing, count, f"{what}: start_timing", turn, ordered)
                first = np.append(begun[:1], np.diff(begun))
            extras = Extras(names, first)
        elif offset:
            extras = Extras(("timing offset",), np.array([low - asked[0]]))
        else:
            extras = Extras()
        if either_sense:
            extras = extras.join(Extras((_SENSE,), np.ones(1)))
        extras = extras.join(self._frame(top.dim))
        complete(
            self,
            extras=extras,
            size=size,
            length=size,
            minimax=minimax,
            weights=as_weights(weights, len(goal), what),
            point=point,
            target=goal,
            timing=asked,
            closed=closed,
            offset=offset,
            either_sense=either_sense,
            ordered=ordered,
        )

    def _frame(self, dim: int) -> Extras:
        """Unknowns behind the timings."""
        return Extras()

    def inputs(self, extra: Numbers) -> Any:
        if self.timing is None:
            return array_module(extra).cumsum(extra)
        if not self.offset:
            return self.timing
        way = array_module(extra).where(extra[..., 1:2] >= 0.0, 1.0, -1.0) if self.either_sense else 1.0
        return extra[..., :1] + way * self.timing

    @property
    def affine(self) -> bool:
        return not self.either_sense

    def misses(self, motion: Motion, extra: Array) -> Array:
        return motion[self.point] - self.target

    @property
    def rule(self) -> tuple[str, str]:
        if not self.ordered:
            return "the range of the input", "leaves the range of the input"
        if self.whole or self.timing is not None:
            return super().rule
        return "order and range of the timings", "meets the targets out of order, or beyond the range of the input"

    def own(self, extra: Array) -> Array:
        if self.timing is not None:
            return jnp.zeros(0)
        if not self.ordered:
            values, (low, high) = jnp.cumsum(extra), self.travel
            return jnp.zeros(0) if self.whole else jnp.concatenate([values - low, high - values])
        # One way round, as the first start had it: forwards, or, with all steps negative, backwards.
        way = jax.lax.stop_gradient(jnp.where(jnp.sum(extra[1:]) >= 0.0, 1.0, -1.0))
        span = self.travel[1] - self.travel[0]
        apart = 1e-4  # of a radian (of the travel): timings stay in order by at least this
        steps = way * extra[1:] - apart
        rest = span - way * jnp.sum(extra[1:]) - (apart if self.closed else 0.0)
        if self.whole:
            return jnp.append(steps, rest)
        ends, (low, high) = jnp.stack([extra[0], jnp.sum(extra)]), self.travel
        return jnp.concatenate([steps, rest[None], ends - low, high - ends])

    def guesses(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Random timings, as far as they are unknown, ``(count, …)``: the first one, and the steps to the others."""
        if self.timing is not None:
            first = self.extras.home[:1] + rng.uniform(-np.pi, np.pi, (count, 1))
            if self.either_sense:
                return np.concatenate([first, rng.choice([-1.0, 1.0], (count, 1))], axis=1)
            return first if self.offset else np.zeros((count, 0))
        low, high = self.travel
        span, total = high - low, len(self.target)
        chord = np.linalg.norm(np.diff(self.target, axis=0, append=self.target[:1]), axis=1)
        chord = np.maximum(chord if self.closed else chord[:-1], 1e-3 * self.size)
        share = chord / chord.sum() * np.exp(0.4 * rng.normal(size=(count, len(chord))))
        share = share / share.sum(axis=1, keepdims=True)
        fill = span if self.closed else span * rng.uniform(0.1, 0.9, (count, 1))
        steps = (share * fill)[:, : total - 1]
        way = rng.choice([-1.0, 1.0], count)
        if self.whole:
            begin = low + span * rng.uniform(size=count)
        else:
            begin = low + rng.uniform(size=count) * (span - steps.sum(axis=1))
            begin = np.where(way > 0, begin, high + low - begin)
        return np.concatenate([begin[:, None], way[:, None] * steps], axis=1)


@public
@dataclasses.dataclass(frozen=True, eq=False, init=False, repr=False)
class MotionGeneration(PathGeneration):
    """A frame that rides on a body goes through poses; where and how it sits on the body is free.

    Attributes:
        body: name of the body.
        turns: orientations wanted: angles ``(M,)`` in the plane, rotations ``(M, 3, 3)`` in space.
        reach: length by which an error of an angle counts as much as one of a place.
    """

    by_target = ("target", "weights", "turns")
    body: str
    turns: np.ndarray
    reach: float
    _least = 2  # poses

    def __init__(
        self,
        mechanism: Mechanism | System,
        body: str,
        point: str,
        places: ArrayLike,
        orientations: ArrayLike,
        timing: ArrayLike | None = None,
        input: str | None = None,
        free: Sequence[str] | None = None,
        bounds: Mapping[str, Sequence[float | None]] | None = None,
        subject_to: Sequence[Condition] = (),
        hold: Sequence[str] = (),
        travel: tuple[float, float] | None = None,
        offset: bool = False,
        weights: ArrayLike | None = None,
        reach: float | None = None,
        minimax: bool = False,
    ):
        """State the problem.

        Args:
            mechanism: the starting idea, as a `Mechanism` or compiled.
            body: name of the body that is guided.
            point: a point or marker on it, the origin of the frame that is guided.
            places: where the origin should be, ``(M, dim)``.
            orientations: of the frame: angles ``(M,)``, radians; in space rotation matrices ``(M, 3, 3)``. How the
                frame is turned against the body is free.
            timing: values of the input at the poses; free, in order, if not given.
            input: name of the driven coordinate.
            free: names of what may change; all if not given.
            bounds: as in `PathGeneration`.
            subject_to: conditions.
            hold: free coordinates that keep their start values.
            travel: as in `PathGeneration`.
            offset: as in `PathGeneration`.
            weights: of the poses.
            reach: length that turns an error of an angle into one of a place; the extent of the places if not given.
            minimax: make the largest error small rather than the sum of squares.

        Raises:
            InputError: unknown names, numbers that are not finite or do not match each other.
        """
        what = "MotionGeneration"
        top = compile_idea(what, mechanism).topology
        dim = top.dim
        goal = as_points(places, dim, what, self._least)
        shape = (len(goal),) if dim == 2 else (len(goal), 3, 3)
        turns = as_floats(orientations, f"{what}: orientations must be numbers, shape {shape}, got {orientations!r}")
        if turns.shape != shape or not np.isfinite(turns).all():
            raise InputError(f"{what}: orientations must be finite, shape {shape}; got shape {turns.shape}")
        if dim == 3 and not np.allclose(turns @ np.swapaxes(turns, 1, 2), np.eye(3), atol=1e-6):
            raise InputError(f"{what}: orientations must be rotation matrices; these are not orthonormal")
        if dim == 2:
            check_radians(turns, f"{what}: orientations", 2 * np.pi, "leave out whole turns")
        bodies = {b.name: [top.points[i] for i in b.points] for b in top.bodies}
        for marker in top.markers:
            bodies.get(marker.body, []).append(marker.name)
        check_name(body, bodies, f"{what}: {top.name!r} has no body {body!r}")
        if point not in bodies[body] and any(point in names for names in bodies.values()):
            raise InputError(
                f"{what}: point {point!r} is not on body {body!r}, whose frame it is to be the origin of; its points "
                f"are {', '.join(bodies[body])}, and markers can be put on it: mechanism.marker(…)"
            )
        if reach is not None:
            positive(reach, f"{what}: reach, a length that turns angles into lengths,")
            reach = float(reach)
        vars(self).update(body=body, turns=turns, reach=float(reach or np.max(np.ptp(goal, axis=0))))
        super().__init__(
            mechanism,
            point,
            goal,
            timing=timing,
            input=input,
            free=free,
            bounds=bounds,
            subject_to=subject_to,
            hold=hold,
            travel=travel,
            offset=offset,
            weights=weights,
            minimax=minimax,
        )

    def _frame(self, dim: int) -> Extras:
        names = ("turn of the frame",) if dim == 2 else tuple(f"turn of the frame about {axis}" for axis in "xyz")
        return Extras(names, np.zeros(len(names)))

    @property
    def own_turns(self) -> int:
        """How many unknowns say how the frame is turned."""
        return 1 if self.system.topology.dim == 2 else 3

    def inputs(self, extra: Numbers) -> Any:
        return super().inputs(extra[: -self.own_turns])

    def own(self, extra: Array) -> Array:
        return super().own(extra[: -self.own_turns])

    def misses(self, motion: Motion, extra: Array) -> Array:
        place = motion[self.point] - self.target
        found = motion.orientation(self.body)
        if self.system.topology.dim == 2:
            turn = 2.0 * jnp.sin(0.5 * (found - extra[-1] - self.turns))[:, None]
        else:
            turn = (found @ rotation_matrix(extra[-3:]) - self.turns).reshape(-1, 9) / np.sqrt(2.0)
        return jnp.concatenate([place, self.reach * turn], axis=1)

    def guesses(self, rng: np.random.Generator, count: int) -> np.ndarray:
        turn = rng.uniform(-np.pi, np.pi, (count, self.own_turns))
        return np.concatenate([super().guesses(rng, count), turn], axis=1)


def rotation_matrix(v: Any) -> np.ndarray:
    """Rotation by a vector (Rodrigues), smooth at zero; NumPy's by NumPy's."""
    of = array_module(v)
    square = of.sum(v * v)
    small = square < 1e-8
    angle = of.sqrt(of.where(small, 1.0, square))
    a = of.where(small, 1.0 - square / 6.0, of.sin(angle) / angle)
    b = of.where(small, 0.5 - square / 24.0, (1.0 - of.cos(angle)) / of.where(small, 1.0, square))
    k = of.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return of.eye(3) + a * k + b * (k @ k)


def rotation_vector(r: np.ndarray) -> np.ndarray:
    """The vectors ``(…, 3)`` whose `rotation` matrices are ``(…, 3, 3)``."""
    p = np.asarray(quaternions(r))
    p = np.where(p[..., :1] < 0.0, -p, p)
    w, v = p[..., 0], p[..., 1:]
    long = np.linalg.norm(v, axis=-1)
    return v * np.where(long > 1e-12, 2.0 * np.arctan2(long, w) / np.maximum(long, 1e-300), 2.0)[..., None]
