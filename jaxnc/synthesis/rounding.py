"""From a design with any dimensions to one with sizes that there are: round, refine what is left free, look around.

The sizes are given, one combination a lane, and what is left free is refined again. First come all ways to round each
of the best relaxed designs up or down, then, from the best combinations so far, all steps to the next size of one
dimension and of two, until none of them is better. Each combination is tried from the design beside it.
"""

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import jit
from jaxnc.kinematics.motion import Motion
from jaxnc.synthesis.conditions import Condition, Seen
from jaxnc.synthesis.evaluate import moved
from jaxnc.synthesis.problem import Evaluation, Extras, Problem
from jaxnc.synthesis.search.refine import Refinement
from jaxnc.synthesis.sizes import Measure, Range, Stock
from jaxnc.synthesis.wrapped import Wrapped, with_conditions
from jaxnc.types import Array

_SEEDS = 6  # relaxed designs that are rounded
_CORNERS = 64  # ways to round one of them, the nearest first
_BEAM = 4  # combinations whose neighbours are looked at
_STEPS = 60  # rounds of looking around, at most

_Sizes = tuple[int, ...]


@dataclasses.dataclass(frozen=True, eq=False, init=False)
class Rounded(Wrapped):
    """A problem with its sizes, and whether it has to have them, as its first arguments.

    The conditions on them come first. A search begins without them: what is compiled for both is the same.
    """

    stocks: tuple[Stock, ...]  # the conditions

    @classmethod
    def of(cls, problem: Problem) -> "Rounded":
        """Make it from a problem with stock conditions."""
        stocks = tuple(c for c in problem.conditions if isinstance(c, Stock))
        others = [c for c in problem.conditions if not isinstance(c, Stock)]
        inner = with_conditions(problem, [*(Measure(s) for s in stocks), *_ranges(problem), *others])
        out = object.__new__(cls)
        out.wrap(inner, Extras.none(), np.zeros(len(stocks) + 1))
        object.__setattr__(out, "stocks", stocks)
        return out

    def evaluate(self, x: Array, moves: Any = None, given: Any = ()) -> Evaluation:
        k = len(self.stocks)
        inner, given = self.inside(x, moves, given)
        off = given[k] * (inner.conditions[:k] - given[:k] / self.length)
        return inner._replace(conditions=inner.conditions.at[:k].set(off))

    def measured(self, x: np.ndarray) -> np.ndarray:
        """What the dimensions are in a design of the inner problem."""
        return np.asarray(_measured(self, moved(self.inner, [x])[0].motion))

    def asked(self, sizes: _Sizes) -> np.ndarray:
        """The arguments by which a design is to have certain sizes."""
        return np.array([*(s.size(n) for s, n in zip(self.stocks, sizes, strict=True)), 1.0])


@jit
def _measured(goal: Rounded, motion: Motion) -> Array:
    seen = Seen(motion.system, motion, None, goal.length)
    return jnp.stack([s.value(seen) for s in goal.stocks])


def relaxed(problem: Problem) -> Problem:
    """The problem with any dimension within the range of its sizes; the same if it has no stock conditions."""
    if not any(isinstance(c, Stock) for c in problem.conditions):
        return problem
    return with_conditions(problem, [*_ranges(problem), *(c for c in problem.conditions if not isinstance(c, Stock))])


def _ranges(problem: Problem) -> list[Condition]:
    stocks = [c for c in problem.conditions if isinstance(c, Stock)]
    return [Range(s) for s in stocks if s.sizes or s.place is None]


def rounded(goal: Rounded, xs: list[np.ndarray], begin: Callable[[], Refinement]) -> list[tuple[float, np.ndarray]]:
    """The best design, best first, of each combination of sizes that was found: unknowns and arguments, as refined.

    Relaxed designs come best first; `begin` makes what refines, as the search before it did, of `goal` or around it.
    """
    found: dict[_Sizes, tuple[float, np.ndarray]] = {}
    tried: set[tuple[_Sizes, _Sizes | None]] = set()

    def refine(starts: list[tuple[_Sizes, np.ndarray]]) -> None:
        run = begin()
        first = run.problem.count
        for sizes, x in starts:
            row = run.problem.row
            row[: goal.count] = x[: goal.count]
            row[first : first + len(goal.stocks) + 1] = goal.asked(sizes)
            run.queue.append(row)
        by_sizes = {goal.asked(s).tobytes(): s for s, _ in starts}
        for error, x in run.run():
            sizes = by_sizes[x[first : first + len(goal.stocks) + 1].tobytes()]
            if sizes not in found or error < found[sizes][0]:
                found[sizes] = error, x

    first: list[tuple[_Sizes, np.ndarray]] = []
    for x in xs[:_SEEDS]:
        first += [(sizes, x) for sizes in _corners(goal.stocks, goal.measured(x))]
    refine(first)
    for _ in range(_STEPS):
        best = sorted(found, key=lambda s: found[s][0])[:_BEAM]
        moves = []
        for base in best:
            for sizes in _beside(goal.stocks, base):
                if (sizes, base) not in tried:
                    tried.add((sizes, base))
                    moves.append((sizes, found[base][1]))
        if not moves:
            break
        refine(moves)
    return sorted(found.values(), key=lambda pair: pair[0])


def _corners(stocks: tuple[Stock, ...], values: np.ndarray) -> list[_Sizes]:
    """The ways to round values up or down, those with the smallest changes first."""
    ways = []
    for s, v in zip(stocks, values, strict=True):
        low = s.number(float(v))
        each = [n for n in (low, low + 1) if s.valid(n)] or [low + 1]
        ways.append(sorted(each, key=lambda n, s=s, v=v: abs(s.size(n) - v)))
    out: list[tuple[float, _Sizes]] = []
    for sizes in itertools.islice(itertools.product(*ways), 4096):
        gap = sum((s.size(n) - v) ** 2 for s, n, v in zip(stocks, sizes, values, strict=True))
        out.append((gap, sizes))
    return [sizes for _, sizes in sorted(out)[:_CORNERS]]


def _beside(stocks: tuple[Stock, ...], sizes: _Sizes) -> list[_Sizes]:
    """Combinations with the next size of one dimension, or of two."""
    out = []
    steps = [(k, way) for k in range(len(stocks)) for way in (-1, 1)]
    for some in [*((s,) for s in steps), *itertools.combinations(steps, 2)]:
        new = list(sizes)
        for k, way in some:
            new[k] += way
        if tuple(new) != sizes and all(s.valid(n) for s, n in zip(stocks, new, strict=True)):
            out.append(tuple(new))
    return out
