"""`Goal`: a problem as a search sees it, with unknowns and arguments of the search behind the problem's own unknowns.

A search keeps a design as a row of numbers: the problem's unknowns, the height that no error exceeds where the largest
one is made small, and then the arguments. Arguments are no unknowns and may differ from design to design: sizes that
dimensions have to have, margins of conditions over the range, whether the height counts, weights and bounds of several
objectives. They are numbers that a compiled program is given, so that one program serves for every stage of a search.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import jit
from jaxnc.kinematics.motion import Motion
from jaxnc.synthesis.conditions import Seen
from jaxnc.synthesis.evaluate import move_designs
from jaxnc.synthesis.objective import Objective
from jaxnc.synthesis.problem import Evaluation, Problem
from jaxnc.synthesis.pytree import Leaves, shapes
from jaxnc.synthesis.search.stock import Sizes, Stock, relax
from jaxnc.synthesis.validate import call_on_motion
from jaxnc.types import Array, ArrayLike

OPEN = 1e30  # a bound of an objective that is none


@dataclasses.dataclass(frozen=True, eq=False)
class Goal(Leaves):
    """A problem with what a search adds to it."""

    problem: Problem  # what is wanted; dimensions that come in sizes are measured by its first conditions
    stocks: tuple[Stock, ...] = ()  # the sizes; arguments: one of each, and whether designs have to have them
    # Of each condition over the range that is kept with a margin, its number among the conditions, its first row and
    # the row behind its last; arguments: the margins.
    margins: tuple[tuple[int, int, int], ...] = ()
    # Numbers that make up one error (coordinates of a point) where the largest error is made small, else 0; unknown:
    # the height; argument: whether its square is made small, or the sum of squares, from which such a search begins.
    parts: int = 0
    others: tuple[Callable[[Motion], ArrayLike], ...] = ()  # further objectives
    # How many errors each of several objectives has; arguments: weights and bounds of their squares.
    objectives: tuple[int, ...] = ()

    @classmethod
    def of(cls, problem: Problem) -> "Goal":
        """Make the goal of a search for the best designs of a problem."""
        stocks = tuple(c for c in problem.conditions if isinstance(c, Stock))
        problem = relax(problem, measured=True)
        ends = np.cumsum([0, *problem.counts])
        margins = tuple(
            (i, int(ends[i]), int(ends[i + 1]))
            for i, c in enumerate(problem.conditions)
            if c.over_range and not c.equality
        )
        return cls(problem, stocks, margins, math.prod(problem.error_shape[1:]) if problem.minimax else 0)

    @classmethod
    def several(cls, problem: Problem, others: Sequence[Callable[[Motion], ArrayLike]]) -> "Goal":
        """Make the goal of a search for a front: the problem's objectives and functions of its motion."""
        goal = cls(problem, others=tuple(others))
        pieces = shapes(Goal.pieces, goal, problem.still[0], problem.extras.home)
        return dataclasses.replace(goal, objectives=tuple(p.shape[0] for p in pieces))

    # -- unknowns and arguments ------------------------------------------------------------------------------------

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return self.problem.count + bool(self.parts)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return self.problem.names + ("height",) * bool(self.parts)

    @property
    def start(self) -> np.ndarray:
        """The starting idea as a vector of unknowns."""
        return self._with_height(self.problem.start, 1.0)

    @property
    def low(self) -> np.ndarray:
        """Lower bounds of the unknowns."""
        return self._with_height(self.problem.low, 0.0)

    @property
    def high(self) -> np.ndarray:
        """Upper bounds of the unknowns."""
        return self._with_height(self.problem.high, np.inf)

    @property
    def scale(self) -> np.ndarray:
        """Typical changes of the unknowns."""
        return self._with_height(self.problem.scale, 1.0)

    def _with_height(self, values: np.ndarray, height: float) -> np.ndarray:
        return np.append(values, height) if self.parts else values

    @property
    def arguments(self) -> np.ndarray:
        """The arguments with which a search begins, ``(g,)``."""
        sizes, k = np.zeros(len(self.stocks) + bool(self.stocks)), len(self.objectives)
        others = np.append(np.ones(k), np.full(k, OPEN))
        return np.concatenate([sizes, np.zeros(len(self.margins) + bool(self.parts)), others])

    @property
    def row(self) -> np.ndarray:
        """The starting idea as a search keeps it: unknowns and arguments."""
        return np.concatenate([self.start, self.arguments])

    @property
    def size_places(self) -> slice:
        """Places in a row of the sizes, and of whether designs have to have them."""
        return slice(self.count, self.count + len(self.stocks) + bool(self.stocks))

    @property
    def margin_places(self) -> slice:
        """Places in a row of the margins."""
        first = self.size_places.stop
        return slice(first, first + len(self.margins))

    # -- what is evaluated -----------------------------------------------------------------------------------------

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of errors and of conditions in an evaluation."""
        errors, conditions = self.problem.shape
        if self.parts:
            above = 2 * errors if self.parts == 1 else errors // self.parts
            return errors + 1, conditions + above
        return sum(self.objectives) or errors, conditions + len(self.objectives)

    @property
    def equalities(self) -> np.ndarray:
        """Marks of the conditions' numbers that must be zero, ``(k,)``; a search adds none."""
        own = self.problem.equalities
        return np.append(own, np.zeros(self.shape[1] - len(own), dtype=bool))

    def evaluate(self, x: Array, moves: tuple[Motion, Motion | None], given: Array) -> Evaluation:
        """Errors and conditions of a vector of unknowns; pure.

        Args:
            x: the unknowns.
            moves: the motions through the targets and over the range.
            given: the arguments.
        """
        problem = self.problem
        x, height = x[: problem.count], x[-1]
        seen = problem.evaluate(x, moves)
        errors, conditions = seen.errors, seen.conditions
        if self.stocks:
            k = len(self.stocks)
            off = given[k] * (conditions[:k] - given[:k] / problem.length)
            conditions, given = conditions.at[:k].set(off), given[k + 1 :]
        for k, (_, first, end) in enumerate(self.margins):
            conditions = conditions.at[first:end].add(-given[k])
        given = given[len(self.margins) :]
        if self.parts:
            above = self._below(errors, height)
            conditions = jnp.concatenate([conditions, jnp.where(given[0] > 0.0, above, 1.0)])
            errors = jnp.append((1.0 - given[0]) * errors, given[0] * height)
        if self.objectives:
            k = len(self.objectives)
            pieces = [errors, *self._others(moves[0])]
            if not self.others:
                pieces = jnp.split(errors, np.cumsum(self.objectives)[:-1])
            errors = jnp.concatenate([jnp.sqrt(w) * p for w, p in zip(given[:k], pieces, strict=True)])
            squares = jnp.stack([jnp.sum(p * p) for p in pieces])
            conditions = jnp.concatenate([conditions, 1.0 - squares / given[k:]])
        return Evaluation(errors, conditions, seen.ok)

    def _below(self, errors: Array, height: Array) -> Array:
        """Room between errors and the height."""
        if self.parts == 1:
            return jnp.concatenate([height - errors, height + errors])
        each = errors.reshape(-1, self.parts)
        return height - jnp.sqrt(jnp.sum(each * each, axis=1) + 1e-30)

    def fit(self, x: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Fit what is linear of the problem's own unknowns: starts ``(B, n)`` and what is left of their errors."""
        if self.objectives:
            return x, errors
        n, m = self.problem.count, errors.shape[1] - bool(self.parts)
        new, left = self.problem.fit(x[:, :n], errors[:, :m])
        return np.concatenate([new, x[:, n:]], axis=1), np.concatenate([left, errors[:, m:]], axis=1)

    # -- several objectives ----------------------------------------------------------------------------------------

    def _others(self, motion: Motion) -> list[Array]:
        return [jnp.ravel(call_on_motion(f, "pareto: one of others", motion)) for f in self.others]

    def pieces(self, motion: Motion, extra: Array) -> list[Array]:
        """The errors of each objective; those of a problem with one are divided by its size."""
        if isinstance(self.problem, Objective) and not self.others:
            return self.problem.pieces(motion)
        own = jnp.ravel(self.problem.errors(motion, extra)) / self.problem.size
        return [own, *self._others(motion)]

    def values(self, x: np.ndarray) -> np.ndarray:
        """The objectives of a design, each as the root of its sum of squares, ``(k,)``."""
        problem, x = self.problem, x[: self.problem.count]
        pieces = _compiled_objectives(self, move_designs(problem, [x])[0].motion, problem.split(x)[1])
        return np.array([float(np.linalg.norm(p)) for p in pieces])

    # -- sizes -----------------------------------------------------------------------------------------------------

    def measure(self, x: np.ndarray) -> np.ndarray:
        """Values of the dimensions that come in sizes, in a design."""
        return np.asarray(_measure(self, move_designs(self.problem, [x[: self.problem.count]])[0].motion))

    def size_arguments(self, sizes: Sizes) -> np.ndarray:
        """The arguments by which a design is to have certain sizes."""
        return np.array([*(s.size(n) for s, n in zip(self.stocks, sizes, strict=True)), 1.0])


_compiled_objectives = jit(Goal.pieces)


@jit
def _measure(goal: Goal, motion: Motion) -> Array:
    seen = Seen(motion.system, motion, None, goal.problem.length)
    return jnp.stack([s.value(seen) for s in goal.stocks])
