"""`Problem`: a mechanism as a starting idea, what it should do, what may change, and what must hold.

A kind of problem says how the inputs follow from its own unknowns (timings, offsets) and what its errors are; see
`jaxnc.synthesis.path`. Everything here is pure, so that thousands of designs are looked at at once.
"""

import copy
import dataclasses
import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import jit
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import sweep
from jaxnc.kinematics.redesign import attached
from jaxnc.mechanism import Mechanism
from jaxnc.pickling import Remade, fields_of
from jaxnc.solvers.assembly import derive, settle
from jaxnc.solvers.kernel import brief
from jaxnc.solvers.plan import plan
from jaxnc.synthesis.conditions import Condition, Seen
from jaxnc.synthesis.variables import Variables
from jaxnc.system.system import System
from jaxnc.types import Array

_RANGE = 48  # poses at which conditions look at the range of the input
POSES = 181  # at which what comes out is judged


class Extras(NamedTuple):
    """Unknowns of a problem besides the design: timings, offsets."""

    names: tuple[str, ...]
    home: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def none(cls) -> "Extras":
        """No unknowns."""
        return cls((), np.zeros(0), np.zeros(0), np.zeros(0))


class Look(NamedTuple):
    """What a vector of unknowns means.

    Attributes:
        errors: to be made small, ``(m,)``, divided by `Problem.size`.
        conditions: zero or positive where they are met, ``(k,)``.
        ok: whether all targets' poses are found.
    """

    errors: Array
    conditions: Array
    ok: Array


@dataclasses.dataclass(frozen=True, eq=False)
class Problem(Remade):
    """A synthesis problem; make one with `PathGeneration`, `FunctionGeneration`, `MotionGeneration`, `Objective`.

    Attributes:
        system: the starting idea.
        driven: name of the input.
        variables: what may change.
        extras: unknowns of the problem itself.
        conditions: what must hold.
        hold: free coordinates that keep their start values.
        travel: range of the input over which conditions are looked at.
        size: by what errors are divided, in units of the target.
        length: by what conditions on lengths are divided.
        minimax: whether the largest error counts rather than the sum of squares.
        mechanism: the description that the system was compiled from, if known: then designs can be written as models.
    """

    noun = "problem"
    system: System
    driven: str
    variables: Variables
    extras: Extras
    conditions: tuple[Condition, ...]
    hold: tuple[str, ...]
    travel: tuple[float, float]
    size: float
    length: float
    minimax: bool
    mechanism: Mechanism | None

    def __copy__(self) -> "Problem":
        new = object.__new__(type(self))
        new.__dict__.update(self.__dict__)
        return new

    def __deepcopy__(self, memo: dict) -> "Problem":
        memo[id(self)] = new = object.__new__(type(self))
        new.__dict__.update(copy.deepcopy(fields_of(self), memo))
        return new

    @property
    def name(self) -> str:
        """What reports call it."""
        return f"{type(self).__name__} with {self.system.name!r}"

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
        """Whether a condition asks for the whole range."""
        return any(c.turning for c in self.conditions)

    # -- what kinds of problems say --------------------------------------------------------------------------------

    def inputs(self, extra: Array) -> Array:
        """Values of the input at the targets, ``(T,)``, from the problem's own unknowns."""
        raise NotImplementedError

    def errors(self, motion: Motion, extra: Array) -> Array:
        """Errors at the targets, in units of the target."""
        raise NotImplementedError

    def own(self, extra: Array) -> Array:
        """Conditions on the problem's own unknowns (the order of timings), zero or positive."""
        return jnp.zeros(0)

    def guesses(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Random values of the problem's own unknowns, ``(count, extras)``."""
        return np.broadcast_to(self.extras.home, (count, len(self.extras.names))).copy()

    def fitted(self, x: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Starts ``(B, n)`` and divided errors ``(B, m)``, what is linear of the problem's own unknowns fitted."""
        return x, errors

    @property
    def dense(self) -> bool:
        """Whether the values of the input at the targets go through its whole range."""
        return False

    @functools.cached_property
    def origin(self) -> "Problem":
        """A problem that moves as this one does; the same for those that differ in their conditions only."""
        return self

    @property
    def unit(self) -> str:
        """Unit of the errors."""
        return self.system.topology.length_unit

    def shown(self, square: float) -> float:
        """The error that is reported for a sum of squares of the divided errors."""
        return float(np.sqrt(square) * self.size if self.minimax else square * self.size**2)

    # -- what follows ----------------------------------------------------------------------------------------------

    def split(self, x: Any) -> tuple[Array, Array]:
        """Design variables and the problem's own unknowns."""
        n = len(self.variables.names)
        return x[:n], x[n:]

    def design(self, x: Any) -> System:
        """The design that a vector of unknowns means."""
        return self.variables.design(self.split(jnp.asarray(x))[0])

    def move(self, x: Any, method: str = "continuation") -> Motion:
        """The motion through the targets."""
        z, extra = self.split(jnp.asarray(x))
        return self.swept(self.variables.design(z), self.inputs(extra), method)

    def swept(self, system: System, values: Any, method: str = "march") -> Motion:
        """A design's motion through values of the input."""
        return sweep(system, {self.driven: values}, method=method, hold=self.hold)

    def span(self, system: System, extra: Array) -> tuple[Any, Any]:
        """Range of the input over which conditions are looked at: from the drawing once round, or as given."""
        low, high = self.travel
        if not np.isclose(high - low, 2 * np.pi):
            return low, high
        home = system_home(system, self.driven)
        return home, home + 2 * np.pi

    def moves(self, x: Array, poses: int) -> tuple[Motion, Motion | None]:
        """The motions through the targets and over the range of the input; pure.

        Args:
            x: the unknowns.
            poses: at least so many over the range, none for no such motion.
        """
        z, extra = self.split(x)
        system, values = self.variables.design(z), self.inputs(extra)
        count = values.shape[0]
        if not poses:
            return self.swept(system, values), None
        if self.dense and count >= poses:
            motion = self.swept(system, values)
            return motion, motion
        # Side by side, so that it is compiled once: the targets with other values between them, and the range.
        total = max(poses, count)
        through, at = _filled(values, total)
        low, high = self.span(system, extra)
        over = low + (high - low) * jnp.linspace(0.0, 1.0, total)
        both = jax.vmap(lambda v: self.swept(system, v))(jnp.stack([through, over]))
        motion, turn = (dataclasses.replace(both.pose(k), system=system) for k in (0, 1))
        return motion.pose(at), turn

    def found(self, x: Any, poses: int) -> tuple[Motion, Motion | None]:
        """The same as `moves` of one design by itself, not pure: what is compiled does not depend on `poses`."""
        system, through = _asked(self.origin, jnp.asarray(x))
        ways, same = [through], self.dense and len(through) >= poses
        if poses and not same:
            low, high = self.span(system, self.split(x)[1])
            ways.append(low + (high - low) * np.linspace(0.0, 1.0, poses))
        out = []
        for values in map(np.asarray, ways):
            count = len(values)
            if self.together:
                values, at = _filled(values, max(count, POSES))
            else:  # a walk takes the steps that it needs
                values, at = np.append(values, np.full(max(POSES - count, 0), values[-1])), np.arange(count)
            out.append(jax.tree.map(np.asarray, self.swept(system, values)).pose(at))
        return out[0], out[-1] if poses else None

    def look(self, x: Array, found: tuple[Motion, Motion | None] | None = None) -> Look:
        """Errors and conditions of a vector of unknowns; pure.

        Args:
            x: the unknowns.
            found: the motions through the targets and over the range, if they are known; derivatives are theirs all
                the same.
        """
        motion, turn = self.moves(x, self.poses) if found is None else self._attached(x, *found)
        extra = self.split(x)[1]
        errors = jnp.ravel(self.errors(motion, extra)) / self.size
        rows = [*self.met(motion, turn), jnp.ravel(self.own(extra))]
        return Look(errors, jnp.concatenate(rows), jnp.all(motion.converged))

    def _attached(self, x: Array, motion: Motion, turn: Motion | None) -> tuple[Motion, Motion | None]:
        z, extra = self.split(x)
        system = self.variables.design(z)
        same = turn is not None and self.dense and motion.status.shape[0] >= self.poses
        motion = attached(motion, system, self.inputs(extra)[:, None])
        if same:
            return motion, motion
        if turn is not None:
            count = turn.status.shape[0]
            low, high = self.span(system, extra)
            turn = attached(turn, system, (low + (high - low) * jnp.linspace(0.0, 1.0, count))[:, None])
        return motion, turn

    def met(self, motion: Motion, turn: Motion | None) -> list[Array]:
        """The numbers of each condition, zero or positive where it is met."""
        seen = Seen(motion.system, motion, turn, self.length)
        return [jnp.ravel(c.values(seen)) for c in self.conditions]

    @property
    def poses(self) -> int:
        """How many poses over the range a search looks at."""
        return _RANGE if any(c.over_range for c in self.conditions) else 0

    @functools.cached_property
    def together(self) -> bool:
        """Whether designs move together, rather than one after the other: where blocks are small."""
        top = self.system.topology
        return brief(plan(top, (self.driven,), self.hold, self.system.degrees_of_freedom))

    @property
    def core(self) -> "Problem":
        """The problem inside of all others; its unknowns come first."""
        return self

    @functools.cached_property
    def still(self) -> tuple[Motion, Motion | None]:
        """Motions of the right shapes that go nowhere, to find out how many numbers come of them."""
        count = jax.eval_shape(lambda x: self.inputs(self.split(x)[1]), jnp.asarray(self.start)).shape[0]
        turn = resting(self.system, self.driven, self.hold, self.poses) if self.poses else None
        return resting(self.system, self.driven, self.hold, count), turn

    @functools.cached_property
    def _rows(self) -> tuple[int, list[int], int]:
        """How many errors there are, numbers of each condition, and conditions of its own."""
        still = self.still

        def rows(x):
            extra = self.split(x)[1]
            return jnp.ravel(self.errors(still[0], extra)), self.met(*still), self.own(extra)

        errors, each, own = jax.eval_shape(rows, jnp.asarray(self.start))
        return errors.shape[0], [s.shape[0] for s in each], own.shape[0]

    @property
    def counts(self) -> list[int]:
        """How many numbers each condition has."""
        return self._rows[1]

    @property
    def shape(self) -> tuple[int, int]:
        """How many errors and how many conditions a `Look` has."""
        errors, each, own = self._rows
        return errors, sum(each) + own

    @property
    def equalities(self) -> np.ndarray:
        """Which of the conditions' numbers must be zero, ``(k,)``."""
        _, each, own = self._rows
        out = [c.equality for c, count in zip(self.conditions, each, strict=True) for _ in range(count)]
        return np.array(out + [False] * own, dtype=bool)

    @property
    def start(self) -> np.ndarray:
        """The starting idea as a vector of unknowns."""
        return np.concatenate([self.variables.home, self.extras.home])

    @property
    def low(self) -> np.ndarray:
        """Lower bounds of the unknowns."""
        return np.concatenate([self.variables.low, self.extras.low])

    @property
    def high(self) -> np.ndarray:
        """Upper bounds of the unknowns."""
        return np.concatenate([self.variables.high, self.extras.high])

    @property
    def pinned(self) -> np.ndarray:
        """Which unknowns keep in each lane the value they start with, ``(n,)``."""
        return np.zeros(self.count, dtype=bool)

    @property
    def scale(self) -> np.ndarray:
        """How much unknowns change typically."""
        return np.concatenate([self.variables.scale, np.ones(len(self.extras.names))])


@functools.partial(jit, static_argnums=0)
def _asked(problem: Problem, x: Array) -> tuple[System, Array]:
    """A design, and the values of the input at its targets."""
    z, extra = problem.split(x)
    return problem.variables.design(z), problem.inputs(extra)


def _filled(values: Any, total: int) -> tuple[Any, np.ndarray]:
    """A sequence with other values between its own, `total` of them, and where its own are."""
    count = values.shape[0]
    each = (total - 1) // max(count - 1, 1)
    at = np.minimum(np.arange(total), (count - 1) * each)
    before, part = at // each, (at % each) / each
    along = values[np.minimum(before + 1, count - 1)] - values[before]
    return values[before] + part * along, np.arange(count) * each


def resting(system: System, driven: str, hold: Sequence[str], count: int) -> Motion:
    """So many times the drawing as it is."""
    home = np.asarray(derive(system).home)
    zero, none = jnp.asarray(np.zeros(count)), jnp.asarray(np.zeros(count, int))
    poses = jnp.asarray(np.broadcast_to(home, (count, len(home))))
    asked = jnp.asarray(np.zeros((count, 1)))
    return Motion(system, (driven,), tuple(hold), poses, (), asked, none, zero, zero)


def system_home(system: System, driven: str) -> Array:
    """The value of a coordinate in the drawing, as a pose of the assembled drawing has it."""
    eq = derive(system)
    q = settle(eq, np.zeros(len(system.topology.coordinates))).q
    return jax.lax.stop_gradient(q[system.topology.position[driven]])
