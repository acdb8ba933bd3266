"""Conditions over a range, kept between the poses that a search looks at.

A search looks at fewer poses of the range than the judge. Between its poses a condition that it just meets is missed by
a little. What a design misses there is added to a margin that the search keeps from then on, and the design is refined
again: the margin comes from what was measured, and the condition is met where it is judged.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxnc.synthesis.evaluate import moved
from jaxnc.synthesis.problem import Evaluation, Extras, Problem
from jaxnc.synthesis.result import shortfalls
from jaxnc.synthesis.search.basins import Valley
from jaxnc.synthesis.search.sqp import MEETS, Ended
from jaxnc.synthesis.wrapped import Wrapped
from jaxnc.types import Array

_ROUNDS = 3  # of refining again
_AMPLE = 1.02  # times what was missed: the gap between two poses changes with the design
_LEAST = 1e-9  # more, so that what is refined to 1e-8 is met


@dataclasses.dataclass(frozen=True, eq=False, init=False)
class Margins(Wrapped):
    """A problem with a margin of each condition over the range as its last arguments."""

    # Of each such condition, its number among the conditions, and the first and the last but one of the rows that it
    # has in an `Evaluation`.
    places: tuple[tuple[int, int, int], ...]

    @classmethod
    def of(cls, inner: Problem) -> "Problem":
        """Make it from a problem; the problem itself if it has none."""
        plain = inner
        while isinstance(plain, Wrapped):
            plain = plain.inner
        ends = np.cumsum([0, *plain.counts])
        places = tuple(
            (i, int(ends[i]), int(ends[i + 1]))
            for i, c in enumerate(inner.conditions)
            if c.over_range and not c.equality
        )
        if not places:
            return inner
        out, k = object.__new__(cls), len(places)
        out.wrap(inner, Extras.none(), np.zeros(k))
        object.__setattr__(out, "places", places)
        return out

    def evaluate(self, x: Array, moves: Any = None, given: Any = ()) -> Evaluation:
        """With the margins taken from what the conditions leave."""
        inner, margins = self.inside(x, moves, given)
        conditions = inner.conditions
        for k, (_, first, end) in enumerate(self.places):
            conditions = conditions.at[first:end].add(-margins[k])
        return inner._replace(conditions=jnp.asarray(conditions))


def tightened(
    problem: Problem,
    goal: Problem,
    unknowns: int,
    best: Sequence[Valley],
    refine: Callable[[list[np.ndarray]], list[Ended]],
) -> list[Valley]:
    """Designs that miss a condition between the poses that were looked at, refined again with a margin.

    Designs are judged by the conditions of `problem`; `goal` is it with margins, and of any other one designs stay as
    they are. So many `unknowns` are refined, before the arguments.
    """
    if not isinstance(goal, Margins):
        return list(best)
    first = unknowns + goal.inner.arguments
    last = first + len(goal.places)
    names = [goal.inner.conditions[i].name for i, *_ in goal.places]
    left, done = list(best), []
    for _ in range(_ROUNDS):
        short = []
        for valley in left:
            far = shortfalls(problem, valley.one)
            if not far:
                done.append(valley)
                continue
            new = valley.end.row.copy()
            new[first:last] += [_AMPLE * far[n] + _LEAST if n in far else 0.0 for n in names]
            short.append((valley, new))
        if not short:
            return done
        ends, left = refine([row for _, row in short]), []
        moves = moved(problem, [end.row[: problem.count] for end in ends])
        for (valley, _), end, one in zip(short, ends, moves, strict=True):
            if end.feasibility <= MEETS:
                left.append(valley._replace(one=one, end=end))
            else:
                done.append(valley)
    return done + left
