"""`Problem`: a mechanism as a starting idea, what it should do, what may change, and what must hold.

A kind of problem says how the inputs follow from its own unknowns (timings, offsets) and what its errors are; see
`jaxnc.synthesis.path`. A problem is a pytree: its numbers (targets, weights, bounds, timings, limits, the drawing) are
leaves, so that whatever is compiled for one serves for all of the same structure.

Random drawings lie inside all bounds of joints and lengths at once, and others are projected onto them. A box that is
not wider than what the drawing or the target suggests is drawn in; a wider one says nothing of where the joint is.
Around joints in boxes the rest of the mechanism is placed as a whole, and what its lengths miss is evened out.
"""

import copy
import dataclasses
import math
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.compiling import on_device
from jaxnc.errors import InputError
from jaxnc.kinematics.design import geometry_vector, with_geometry
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position, sweep
from jaxnc.mechanism import Mechanism
from jaxnc.pickling import Remade, fields_of, from_fields
from jaxnc.solvers.assembly import derive, settle
from jaxnc.synthesis.conditions import LARGE, Condition, Length, Seen
from jaxnc.synthesis.pytree import Leaves, shapes
from jaxnc.system.system import System
from jaxnc.types import AnyArray, Array, Numbers

if TYPE_CHECKING:
    from jaxnc.synthesis.search.planar import PlanarFit
    from jaxnc.synthesis.search.spatial import Spatial


_P = TypeVar("_P", bound="Problem")
POSES = 181  # at which what comes out is judged


@dataclasses.dataclass(frozen=True, eq=False)
class Variables(Leaves):
    """The free components of a system's design."""

    names: tuple[str, ...]  # of the components: "B.x", "coupler.B-C"
    at: np.ndarray  # their places in the flat parameters (points, vectors, markers, dimensions)
    home: np.ndarray  # their values in the starting idea
    scale: np.ndarray  # how much each changes typically: the size of the drawing, of a unit vector, or of the number
    low: np.ndarray  # lower bounds, -inf where there is none
    high: np.ndarray  # upper bounds
    chosen: bool  # whether they were named, rather than all taken


class Extras(NamedTuple):
    """Unknowns of a problem besides the design: timings, offsets. They have no bounds."""

    names: tuple[str, ...] = ()
    home: np.ndarray = np.zeros(0)

    def join(self, other: "Extras") -> "Extras":
        """Append other unknowns."""
        return Extras(self.names + other.names, np.append(self.home, other.home))


@public
class Evaluation(NamedTuple):
    """Errors and conditions of a vector of unknowns.

    Attributes:
        errors: to be made small, ``(m,)``, divided by `Problem.size`.
        conditions: zero or positive where they are met, ``(k,)``.
        ok: whether all targets' poses are found.
    """

    errors: Array
    conditions: Array
    ok: Array


@public
@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Problem(Remade, Leaves):
    """A synthesis problem; make one with `PathGeneration`, `FunctionGeneration`, `MotionGeneration`, `Objective`.

    Attributes:
        system: the starting idea.
        driven: name of the input.
        variables: what may change.
        extras: unknowns of the problem itself.
        conditions: what must hold.
        hold: free coordinates that keep their start values.
        travel: range of the input over which conditions are looked at.
        whole: whether that is a whole turn, which then begins wherever the drawing is.
        size: by what errors are divided, in units of the target.
        length: by what conditions on lengths are divided.
        minimax: whether the largest error counts rather than the sum of squares.
        dense: whether the values of the input at the targets go through its whole range.
        mechanism: the description that the system was compiled from, if known: then designs can be written as models.
        weights: of the squares of the errors, one for each target, ``(targets,)``.
    """

    noun = "problem"
    apart = ("mechanism",)
    by_target = ("weights",)  # fields with a number, or a row of them, for each target
    random = False  # whether the number that is made small is drawn anew at every step
    longest = 1.0  # by how much every other random design may be larger than the idea
    at_rest = False  # whether it is a number of the design as drawn, without any motion
    system: System
    driven: str
    variables: Variables
    extras: Extras
    conditions: tuple[Condition, ...]
    hold: tuple[str, ...]
    travel: tuple[float, float]
    whole: bool
    size: float
    length: float
    minimax: bool
    dense: bool
    mechanism: Mechanism | None
    weights: AnyArray

    def __copy__(self) -> "Problem":
        return from_fields(type(self), vars(self))

    def __deepcopy__(self, memo: dict) -> "Problem":
        return from_fields(type(self), copy.deepcopy(fields_of(self), memo))

    @property
    def name(self) -> str:
        """Name in reports."""
        return f"{type(self).__name__} with {self.system.name!r}"

    def __repr__(self) -> str:
        free, held = ", ".join(self.names), ", ".join(c.name for c in self.conditions)
        return f"{self.name}: driven by {self.driven}, {self.count} unknowns {free}" + f"; {held}" * bool(held)

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return len(self.variables.names) + len(self.extras.names)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return (*self.variables.names, *self.extras.names)

    @property
    def turning(self) -> bool:
        """True if a condition asks for the whole range."""
        return any(c.turning for c in self.conditions)

    # -- to be given by each kind of problem -----------------------------------------------------------------------

    def inputs(self, extra: Numbers) -> AnyArray:
        """Values of the input at the targets, ``(T,)``, see `affine`; NumPy arrays from NumPy arrays."""
        raise NotImplementedError

    @property
    def affine(self) -> bool:
        """True if the inputs are affine in the problem's own unknowns, also where one of them changes its sign."""
        return True

    def misses(self, motion: Motion, extra: Array) -> Array:
        """Errors at the targets, in units of the target, ``(targets, …)``."""
        raise NotImplementedError

    def errors(self, motion: Motion, extra: Array) -> Array:
        """The numbers that are made small: the misses, times the roots of their weights."""
        misses = self.misses(motion, extra)
        return misses * jnp.sqrt(self.weights).reshape(-1, *(1,) * (misses.ndim - 1))

    @property
    def rule(self) -> tuple[str, str]:
        """The subject of the problem's own conditions, and the defect of a design that misses them."""
        return "the order of the targets", "meets the targets out of order"

    def own(self, extra: Array) -> Array:
        """Conditions on the problem's own unknowns (the order of timings), zero or positive."""
        return jnp.zeros(0)

    def guesses(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Random values of the problem's own unknowns, ``(count, extras)``."""
        return np.broadcast_to(self.extras.home, (count, len(self.extras.names))).copy()

    def fit(self, x: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Fit own unknowns that errors depend on linearly: starts ``(B, n)`` and errors left ``(B, m)``."""
        return x, errors

    @property
    def periodic(self) -> bool:
        """True if the input is an angle that nothing else depends on."""
        top = self.system.topology
        return self.driven in top.scalars and bool(top.periodic[top.scalars.index(self.driven)])

    @property
    def unit(self) -> str:
        """Unit of the errors."""
        return self.system.topology.length_unit

    @property
    def error_unit(self) -> str:
        """Unit of the error that is reported: a sum of squares, unless the largest error counts."""
        return self.unit if self.minimax or not self.unit else f"{self.unit}^2"

    @property
    def weighted(self) -> bool:
        """True if some errors count more than others."""
        return bool(np.any(np.asarray(self.weights) != 1.0))

    def reported_error(self, square: float) -> float:
        """Convert a sum of squares of the divided errors to the error that is reported."""
        return float(np.sqrt(square) * self.size if self.minimax else square * self.size**2)

    # -- derived ---------------------------------------------------------------------------------------------------

    def split(self, x: AnyArray) -> tuple[Array, Array]:
        """Design variables and the problem's own unknowns."""
        n = len(self.variables.names)
        return x[:n], x[n:]

    def design(self, x: Numbers) -> System:
        """The design that a vector of unknowns means."""
        return self.designed(self.split(x)[0])

    def designed(self, z: Numbers) -> System:
        """The system with these values of the variables; pure, for traced values too."""
        flat, at = geometry_vector(self.system), self.variables.at
        if isinstance(z, Tracer) or isinstance(flat, Tracer):
            flat = jnp.asarray(flat)
            return with_geometry(self.system, flat.at[at].set(jnp.asarray(z, flat.dtype)))
        new = np.array(flat)
        new[at] = np.asarray(z)
        return with_geometry(self.system, new)

    def move(self, x: Numbers) -> Motion:
        """The motion through the targets."""
        z, extra = self.split(x if isinstance(x, Tracer) else np.asarray(x))
        return self.sweep(self.designed(z), self.inputs(extra))

    def sweep(self, system: System, values: Numbers, repair: bool = True) -> Motion:
        """A design's motion through values of the input."""
        return sweep(system, {self.driven: values}, hold=self.hold, repair=repair)

    def span(self, home: Numbers, extra: Numbers) -> tuple[AnyArray, AnyArray]:
        """Range of the input over which conditions are looked at: from the drawing once round, or as given.

        Args:
            home: the input's value in the drawing, a number or one for each design.
            extra: the problem's own unknowns, ``(own,)``, or ``(designs, own)``.
        """
        return (home, home + 2 * np.pi) if self.whole else self.travel

    def moves(self, x: Array) -> tuple[Motion, Motion | None]:
        """The motions through the targets and over the range of the input, if a condition looks at it; pure."""
        z, extra = self.split(x)
        system, values = self.designed(z), self.inputs(extra)
        motion = self.sweep(system, values, repair=False)  # of traced code the quickest where many designs are mapped
        if not self.poses or self.through(values.shape[0], self.poses):
            return motion, motion if self.poses else None
        return motion, self.sweep_range(system, extra)

    def sweep_range(self, system: System, extra: Array) -> Motion | None:
        """The motion over the range of the input; None where no condition looks at it; pure."""
        if not self.poses:
            return None
        low, high = self.span(home_value(system, self.driven), extra)
        return self.sweep(system, low + (high - low) * jnp.linspace(0.0, 1.0, self.poses), repair=False)

    def through(self, targets: int, poses: int) -> bool:
        """Tell whether the motion through so many targets shows the range as well as so many poses would."""
        return self.dense and targets >= poses

    def evaluate(self, x: Array, moves: tuple[Motion, Motion | None] | None = None) -> Evaluation:
        """Errors and conditions of a vector of unknowns; pure.

        Args:
            x: the unknowns.
            moves: the motions through the targets and over the range, if they are known.
        """
        motion, turn = self.moves(x) if moves is None else moves
        extra = self.split(x)[1]
        errors = jnp.ravel(self.errors(motion, extra)) / self.size
        rows = [*self.condition_values(motion, turn), jnp.ravel(self.own(extra))]
        return Evaluation(errors, jnp.concatenate(rows), jnp.all(motion.converged))

    def cost(self, x: Array, key: Array | None = None, targets: Array | None = None) -> tuple[Array, Array, Array]:
        """A single number that is made small by steps along gradients; pure.

        Args:
            x: the unknowns.
            key: of random numbers, where the problem is drawn anew at every step.
            targets: places of those that count, in order, ``(some,)``; all if not given.

        Returns:
            The sum of the squares of the divided errors (as many as all targets have), or the largest of them where
            that counts; the conditions, zero or positive where they are met; whether all poses are found.
        """
        z, extra = self.split(x)
        some, values = self, self.inputs(extra)
        if targets is None:
            motion, turn = self.moves(x)
        else:
            values = jnp.asarray(values)[targets]
            some = with_fields(self, **{name: jnp.asarray(getattr(self, name))[targets] for name in self.by_target})
            system = self.designed(z)
            # Between them the way may be long: each is followed from the drawing.
            motion = solve_position(system, {self.driven: values}, hold=self.hold, throw=False, repair=False)
            turn = self.sweep_range(system, extra)
        errors = some.errors(motion, extra) / self.size
        each = jnp.sum(jnp.reshape(errors, (len(errors), -1)) ** 2, axis=1)
        square = jnp.max(each) if self.minimax else jnp.sum(each) * (self.targets / len(values))
        rows = [*some.condition_values(motion, turn), jnp.ravel(self.own(extra))]
        return square, jnp.concatenate(rows), jnp.all(motion.converged)

    def condition_values(self, motion: Motion, turn: Motion | None) -> list[Array]:
        """The numbers of each condition, zero or positive where it is met."""
        seen = Seen(motion.system, motion, turn, self.length)
        return [jnp.ravel(c.values(seen)) for c in self.conditions]

    @property
    def poses(self) -> int:
        """Number of poses over the range that a search looks at."""
        # 48 poses at which conditions look at the range of the input
        return 48 if any(c.over_range for c in self.conditions) else 0

    @property
    def targets(self) -> int:
        """Number of values of the input at the targets."""
        return len(self.inputs(self.extras.home))

    @property
    def still(self) -> tuple[Motion, Motion | None]:
        """Motions of the right shapes that go nowhere, by which numbers of errors and conditions are counted."""
        motion = repeat_drawing(self, self.targets)
        if not self.poses or self.through(self.targets, self.poses):
            return motion, motion if self.poses else None
        return motion, repeat_drawing(self, self.poses)

    @property
    def error_shape(self) -> tuple[int, ...]:
        """Shape of the errors, ``(targets, …)``."""
        return shapes(type(self).errors, self, self.still[0], self.extras.home).shape

    @property
    def counts(self) -> list[int]:
        """Number of values of each condition."""
        return self.count_values(*self.still)

    def count_values(self, motion: Motion, turn: Motion | None) -> list[int]:
        """Number of values of each condition where the motions have these shapes."""
        return [s.shape[0] for s in shapes(Problem.condition_values, self, motion, turn)] if self.conditions else []

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of errors and of conditions in an `Evaluation`."""
        return math.prod(self.error_shape), sum(self.counts) + self._own

    @property
    def equalities(self) -> np.ndarray:
        """Which of the conditions' numbers must be zero, ``(k,)``."""
        return self.mark_equalities(self.counts)

    def mark_equalities(self, counts: Sequence[int]) -> np.ndarray:
        """Mark the numbers that must be zero among so many of each condition, and the problem's own."""
        own = [c.equality for c, count in zip(self.conditions, counts, strict=True) for _ in range(count)]
        return np.array(own + [False] * self._own, dtype=bool)

    @property
    def _own(self) -> int:
        """Number of conditions on the problem's own unknowns."""
        return shapes(type(self).own, self, self.extras.home).shape[0]

    @property
    def start(self) -> np.ndarray:
        """The starting idea as a vector of unknowns."""
        return np.concatenate([self.variables.home, self.extras.home])

    @property
    def low(self) -> np.ndarray:
        """Lower bounds of the unknowns."""
        return np.append(self.variables.low, np.full(len(self.extras.names), -np.inf))

    @property
    def high(self) -> np.ndarray:
        """Upper bounds of the unknowns."""
        return np.append(self.variables.high, np.full(len(self.extras.names), np.inf))

    @property
    def scale(self) -> np.ndarray:
        """Typical changes of the unknowns."""
        return np.concatenate([self.variables.scale, np.ones(len(self.extras.names))])


def with_fields(problem: _P, **fields: object) -> _P:
    """Copy a problem with other values of some fields; nothing is checked again."""
    return from_fields(type(problem), vars(problem) | fields)


def array_module(*values: object) -> ModuleType:
    """The module for arithmetic with arrays: NumPy, which compiles nothing, unless one of them is JAX's."""
    return jnp if any(isinstance(v, (jax.Array, Tracer)) for v in values) else np


def repeat_drawing(problem: Problem, count: int) -> Motion:
    """A motion whose poses are all the drawing."""
    home = np.asarray(derive(problem.system).home)
    poses: AnyArray = np.broadcast_to(home, (count, len(home)))
    zero, none = np.zeros(count), np.zeros(count, int)
    return make_motion(problem, problem.system, poses, none, zero, zero)


def make_motion(
    problem: Problem, system: System, q: AnyArray, status: AnyArray, values: AnyArray, quality: AnyArray
) -> Motion:
    """Make a motion of a design from poses ``(T, N)`` with their status, inputs, and residuals, each ``(T,)``.

    The residuals stand for the conditioning too: neither is looked at.
    """
    known = (problem.driven,), tuple(problem.hold)
    return Motion(system, *known, q, (), values[:, None], status, quality, quality)


def home_value(system: System, driven: str) -> AnyArray:
    """Value of a coordinate in the assembled drawing; it changes with the design as it does in the drawing."""
    eq, place = derive(system), system.topology.position[driven]
    q = settle(eq, np.zeros(len(system.topology.coordinates)), repair=False).q  # of traced code by itself
    if not any(isinstance(x, Tracer) for x in (q, eq.home)):  # a design that is differentiated eagerly is settled too
        return np.asarray(q)[place]
    return eq.home[place] + jax.lax.stop_gradient(q[place] - eq.home[place])


def check_problem(what: str, problem: object, squares: bool = True) -> None:
    """Check that a search is given a problem; one of sums of squares unless any number will do."""
    if squares and isinstance(problem, Problem) and problem.at_rest:
        raise InputError(
            f"{what} makes sums of squares small, and a {type(problem).__name__} is any number: use "
            f"nc.synthesis.descend(loss, optax.adam(1e-2)), or state an Objective"
        )
    if callable(problem) and not isinstance(problem, Problem):
        raise InputError(
            f"{what} takes a problem, got the function {getattr(problem, '__name__', problem)!r}: say of which "
            f"mechanism it is, Loss(mechanism, function), or of its motions, Objective(mechanism, function, values)"
        )
    if not isinstance(problem, Problem):
        raise InputError(
            f"{what} takes a problem, such as PathGeneration(mechanism, 'P', points), got {type(problem).__name__}: "
            f"a mechanism alone does not say what is wanted"
        )


# -- bounds of joints and lengths --------------------------------------------------------------------------------------


class Boxes(NamedTuple):
    """Bounds of the joints and lengths of a problem."""

    low: np.ndarray  # of all parameters, (n,); infinite where there is none
    high: np.ndarray  # upper bounds
    narrow: np.ndarray  # parameters that are drawn in their boxes
    ends: np.ndarray  # of bounded lengths, indices of two points each, (lengths, 2)
    shortest: np.ndarray  # (lengths,)
    longest: np.ndarray  # (lengths,)
    size: float  # of what is drawn
    points: int  # how many points there are

    @classmethod
    def of(cls, problem: Problem) -> "Boxes":
        """Read the bounds of a problem."""
        var, top = problem.variables, problem.system.topology
        low, high = (np.full(len(np.asarray(geometry_vector(problem.system))), v) for v in (-np.inf, np.inf))
        low[var.at], high[var.at] = var.low, var.high
        size = float(problem.length)
        width = np.full(len(low), size)
        width[var.at] = np.maximum(var.scale, size)
        some = [c for c in problem.conditions if isinstance(c, Length) and {c.start, c.end} <= {*top.points}]
        ends = np.array([[top.points.index(n) for n in (c.start, c.end)] for c in some], int).reshape(-1, 2)
        shortest, longest = np.array([max(c.low, 0.0) for c in some]), np.array([c.high for c in some])
        # a box that is wider than 4 sizes is none to draw in
        return cls(low, high, high - low <= 4.0 * width, ends, shortest, longest, size, len(top.points))

    def inside(self, flat: np.ndarray, free: np.ndarray, dim: int) -> np.ndarray:
        """Even out what lengths and boxes of drawings ``(B, n)`` miss over the parameters that are free, ``(n,)``."""
        flat = np.where(self.narrow, np.clip(flat, self.low, self.high), flat)
        if not len(self.ends):
            return flat
        along = np.arange(dim)
        for _ in range(60):  # 60 sweeps over all lengths, at most, until they are met
            far = 0.0
            for (a, b), low, high in zip(self.ends, self.shortest, self.longest, strict=True):
                i, j = dim * a + along, dim * b + along
                d = flat[:, j] - flat[:, i]
                long = np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-300)
                off = (np.clip(long, low, high) - long) * d / long
                far = max(far, float(np.abs(off).max()))
                share = free[i] + 0.0, free[j] + 0.0
                total = np.maximum(share[0] + share[1], 1.0)
                flat[:, i] -= share[0] / total * off
                flat[:, j] += share[1] / total * off
            flat = np.where(self.narrow, np.clip(flat, self.low, self.high), flat)
            if far <= 1e-9 * self.size:  # 1e-9 of the size may a length miss
                break
        return flat

    def room(self, flat: np.ndarray, dim: int, without: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Extents of mechanisms ``(B, n)``, and the least and largest factors by which they may grow, ``(B,)``.

        `without` is a point that is put where it is wanted anyway.
        """
        places = flat[:, : dim * self.points].reshape(len(flat), self.points, dim)
        some = np.delete(places, without, axis=1) if 0 <= without < self.points else places
        extent = np.ptp(some, axis=1).max(axis=1)
        longest = np.max(self.longest[np.isfinite(self.longest)], initial=LARGE * self.size)
        least, most = np.zeros(len(flat)), longest / np.maximum(extent, 1e-300)
        for (a, b), low, high in zip(self.ends, self.shortest, self.longest, strict=True):
            if without in (a, b):
                continue
            long = np.maximum(np.linalg.norm(places[:, a] - places[:, b], axis=1), 1e-300)
            least, most = np.maximum(least, low / long), np.minimum(most, high / long)
        return extent, np.minimum(least, most), most


def draw_designs(
    problem: Problem, rng: np.random.Generator, count: int, fit: "PlanarFit | Spatial | None" = None
) -> np.ndarray:
    """Draw random designs ``(count, n)``: uniform in boxes, the rest around the idea, by up to its size."""
    var, dim, boxes = problem.variables, problem.system.topology.dim, Boxes.of(problem)
    spread = rng.uniform(0.1, 1.0, (count, 1)) * var.scale
    if problem.longest > 1.0:
        spread[1::2] *= problem.longest ** rng.uniform(0.0, 1.0, (count // 2, 1))
    chance = rng.uniform(-1.0, 1.0, (count, len(var.at)))
    flat = np.repeat(np.asarray(geometry_vector(problem.system), float)[None], count, axis=0)
    flat[:, var.at] = var.home + spread * chance
    free = np.zeros(flat.shape[1], bool)
    free[var.at] = True
    narrow = boxes.narrow[var.at]
    goal = flat.copy()
    low, high = var.low[narrow], var.high[narrow]
    goal[:, var.at[narrow]] = low + (high - low) * 0.5 * (1.0 + chance[:, narrow])
    if fit is not None and (any(fit.free.axes) or fit.free.scale):
        if narrow.any() or len(boxes.ends):
            flat = boxes.inside(fit.into(boxes, flat, goal), free, dim)
    else:
        flat = boxes.inside(np.clip(goal, boxes.low, boxes.high), free, dim)
        flat = np.where(free, np.clip(flat, boxes.low, boxes.high), flat)
    return flat[:, var.at]


@dataclasses.dataclass(frozen=True, eq=False)
class Bounds(Leaves):
    """Bounds of the unknowns of a problem, in its scales."""

    low: Array  # of the unknowns, (n,)
    high: Array  # upper bounds
    scale: Array  # by which unknowns are divided
    drawing: Array  # all parameters of the starting idea, (parameters,)
    at: Array  # places of the design variables among them
    share: Array  # of each end of a length, (lengths, 2): how much of what the length misses it takes up
    ends: Array  # places of the ends' coordinates, (lengths, 2, dim)
    shortest: Array  # of the lengths, (lengths,)
    longest: Array  # (lengths,)
    lengths: int  # how many there are

    @classmethod
    def of(cls, problem: Problem) -> "Bounds":
        """Read the bounds of a problem, without those of lengths that are explicit dimensions."""
        boxes, var, top = Boxes.of(problem), problem.variables, problem.system.topology
        free = np.zeros(len(boxes.low), bool)
        free[var.at] = True
        given = {name.rpartition(".")[2] for name in top.dimensions}
        pairs = [(top.points[a], top.points[b]) for a, b in boxes.ends]
        some = np.array([not {f"{a}-{b}", f"{b}-{a}"} & given for a, b in pairs], bool)
        ends = top.dim * boxes.ends[some][:, :, None] + np.arange(top.dim)
        can = free[ends].any(axis=2).astype(float)  # ends that may be moved
        kept = can.any(axis=1)
        share = can[kept] / can[kept].sum(axis=1, keepdims=True)
        drawing = np.asarray(geometry_vector(problem.system), float)
        rows = problem.low / problem.scale, problem.high / problem.scale, problem.scale, drawing, var.at, share
        rest = ends[kept], boxes.shortest[some][kept], boxes.longest[some][kept]
        return cls(*on_device((*rows, *rest)), lengths=int(kept.sum()))

    def project(self, y: Array) -> Array:
        """Put unknowns into their boxes, and even out, some times over, what their lengths miss."""
        y = jnp.clip(y, self.low, self.high)
        if not self.lengths:
            return y
        n = self.at.shape[0]
        free = jnp.zeros(self.drawing.shape).at[self.at].set(1.0)

        def evened(k: Array, z: Array) -> Array:
            a, b = self.ends[k]
            flat = self.drawing.at[self.at].set(z)
            d = flat[b] - flat[a]
            square = jnp.sum(d * d)
            long = jnp.sqrt(jnp.where(square > 0.0, square, 1.0))
            off = (jnp.clip(long, self.shortest[k], self.longest[k]) - long) * d / long
            flat = flat.at[a].add(-self.share[k, 0] * off * free[a]).at[b].add(self.share[k, 1] * off * free[b])
            return flat[self.at]

        def sweep(_: Array, y: Array) -> Array:
            z = lax.fori_loop(0, self.lengths, evened, (y * self.scale)[:n])
            return jnp.clip(y.at[:n].set(z / self.scale[:n]), self.low, self.high)

        return lax.fori_loop(0, 24, sweep, y)  # what is left after 24 sweeps over all lengths is a condition's to mend

    def slope_along(self, y: Array, slope: Array) -> Array:
        """Return what bounds leave of a gradient for a short step down it: what they push back is taken away."""
        size = jnp.linalg.norm(slope)
        short = 1e-4 / jnp.where(size > 0.0, size, 1.0)  # unknowns are of size one
        ahead = y - short * slope
        return slope - (self.project(ahead) - ahead) / short

    def distance_down(self, y: Array, slope: Array) -> Array:
        """Length of a step down the gradient that does not leave the bounds; 0 where they allow none."""
        return jnp.linalg.norm(y - jax.lax.stop_gradient(self.project(y - slope)))
