"""Dimensions that come in sizes: lengths from a list, multiples of a step, and a search for the best combination.

The sizes are given, one combination a lane, and what is left free is refined again. First come all ways to round each
of the best relaxed designs up or down. Then, from the best combinations so far, all steps to the next size of one
dimension and of two are tried until none of them is better. Each combination is tried from the design beside it.
"""

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.design import geometry_components, geometry_vector
from jaxnc.kinematics.inputs import positive
from jaxnc.synthesis.conditions import Condition, Seen, check_points
from jaxnc.synthesis.problem import Problem, with_fields
from jaxnc.synthesis.validate import as_floats, check_name
from jaxnc.system.system import System
from jaxnc.types import Array

if TYPE_CHECKING:
    from jaxnc.synthesis.search.goal import Goal
    from jaxnc.synthesis.search.refine import Refinement


Sizes = tuple[int, ...]
"""The number of the size of each dimension."""


@public
@dataclasses.dataclass(frozen=True)
class Stock(Condition):
    """A length between two points, or a design variable, that has one of certain sizes.

    Attributes:
        what: two points, or the name of a design variable.
        sizes: ascending; empty if they are the multiples of `step`.
        step: between sizes.
        place: of the variable in the flat parameters.
    """

    what: tuple[str, str] | str
    sizes: tuple[float, ...] = ()
    step: float = 1.0
    place: int | None = None
    equality = True

    @property
    def name(self) -> str:
        return f"{self.label} in stock" if self.sizes else f"{self.label} a multiple of {self.step:g}"

    @property
    def spans(self) -> tuple[tuple[str, str], ...]:
        return (self.what,) if isinstance(self.what, tuple) else ()

    @property
    def label(self) -> str:
        """Name of the length or variable."""
        return self.what if isinstance(self.what, str) else "-".join(self.what)

    def prepare(self, system: System, driven: str) -> "Stock":
        top = system.topology
        every = [part for _, part, _ in geometry_components(system)]
        if isinstance(self.what, str) and self.what in every:
            return dataclasses.replace(self, place=every.index(self.what))
        ends = self.what.partition("-")[::2] if isinstance(self.what, str) else self.what
        if isinstance(self.what, str) and not ends[1]:
            check_name(self.what, every, f"{self.name}: {top.name!r} has no design variable {self.what!r}")
        check_points(system, self.name, *ends)
        return dataclasses.replace(self, what=tuple(ends))

    def value(self, seen: Seen) -> Array:
        """Value of the length or variable."""
        if self.place is not None:
            return geometry_vector(seen.system)[self.place]
        return seen.distance(*self.what)

    def values(self, seen: Seen) -> Array:
        value = self.value(seen)
        if not self.sizes:
            return ((value - self.step * jnp.round(value / self.step)) / seen.size)[None]
        far = value - jnp.stack([jnp.asarray(size) for size in self.sizes])
        return (far[jnp.argmin(jnp.abs(far))] / seen.size)[None]

    def number(self, value: float) -> int:
        """Number of the largest size that is not above a value, of the smallest one if all are."""
        if not self.sizes:
            return int(np.floor(value / self.step + 1e-9))
        return max(int(np.searchsorted(self.sizes, value + 1e-9 * abs(value), side="right")) - 1, 0)

    def valid(self, number: int) -> bool:
        """Tell whether there is a size of this number; a length is not zero or less."""
        if self.sizes:
            return 0 <= number < len(self.sizes)
        return self.place is not None or number > 0

    def size(self, number: int) -> float:
        """The size of a number."""
        return self.sizes[number] if self.sizes else self.step * number


@dataclasses.dataclass(frozen=True)
class Measure(Condition):
    """The value that a stock condition looks at, to be compared with a size."""

    stock: Stock
    equality = True

    def values(self, seen: Seen) -> Array:
        return (self.stock.value(seen) / seen.size)[None]


@dataclasses.dataclass(frozen=True)
class Range(Condition):
    """A range for the value of a stock condition: from its smallest to its largest size."""

    stock: Stock
    words = "{0.stock.label} in the range of its sizes"

    def values(self, seen: Seen) -> Array:
        value = self.stock.value(seen)
        if not self.stock.sizes:  # a length of at least one step
            return ((value - self.stock.step) / seen.size)[None]
        return jnp.stack([value - self.stock.sizes[0], self.stock.sizes[-1] - value]) / seen.size


@public
def stock(what: tuple[str, str] | str, sizes: Sequence[float]) -> Stock:
    """A length, or a design variable, has one of the sizes of a list.

    Args:
        what: two points of one body, or the name of a component of the design: ``("B", "C")``, ``"coupler.B-C"``.
        sizes: that there are, in any order.

    Raises:
        InputError: no sizes, or sizes that are not finite or, of a length, not positive.
    """
    found = np.unique(as_floats(sizes))
    if found.ndim != 1 or not found.size or not np.isfinite(found).all():
        raise InputError(f"stock({what!r}): sizes must be a list of finite numbers, got {sizes!r}")
    _check_what(what, "stock")
    if not isinstance(what, str) and found[0] <= 0:
        raise InputError(f"stock({what!r}): a length is positive, got the size {found[0]:g}")
    return Stock(what, tuple(found.tolist()))


@public
def integer(what: tuple[str, str] | str, step: float = 1.0) -> Stock:
    """A length, or a design variable, is a whole number of steps.

    Args:
        what: two points of one body, or the name of a component of the design.
        step: in its unit.

    Raises:
        InputError: a step that is not positive.
    """
    positive(step, f"integer({what!r}): step")
    _check_what(what, "integer")
    return Stock(what, (), float(step))


def _check_what(what: object, caller: str) -> None:
    pair = isinstance(what, tuple) and len(what) == 2 and all(isinstance(w, str) for w in what)
    if not (pair or isinstance(what, str)):
        raise InputError(f"{caller}: give two points, or the name of a design variable; got {what!r}")


def relax(problem: Problem, measured: bool = False) -> Problem:
    """Allow any dimension within the range of its sizes; a problem without stock conditions stays as it is.

    Where `measured`, what stock conditions look at comes first, to be compared with sizes that a search gives.
    """
    stocks = [c for c in problem.conditions if isinstance(c, Stock)]
    rows = [*(Measure(s) for s in stocks if measured), *(Range(s) for s in stocks if s.sizes or s.place is None)]
    others = [c for c in problem.conditions if not isinstance(c, Stock)]
    return with_fields(problem, conditions=(*rows, *others)) if stocks else problem


def best_sizes(
    goal: "Goal", rows: Sequence[np.ndarray], begin: Callable[[], "Refinement"]
) -> list[tuple[float, np.ndarray]]:
    """Find the best design of each combination of sizes that is tried, best first, as rows of the search.

    Args:
        goal: what is wanted, with sizes.
        rows: relaxed designs, best first.
        begin: makes what refines, as in the search before.
    """
    found: dict[Sizes, tuple[float, np.ndarray]] = {}
    tried: set[tuple[Sizes, Sizes | None]] = set()
    own, n = goal.size_places, goal.problem.count

    def refine(starts: list[tuple[Sizes, np.ndarray]]) -> None:
        run = begin()
        for sizes, x in starts:
            row = goal.row
            row[:n], row[own] = x[:n], goal.size_arguments(sizes)
            run.queue.append(row)
        by_sizes = {goal.size_arguments(s).tobytes(): s for s, _ in starts}
        for error, x in run.run():
            sizes = by_sizes[x[own].tobytes()]
            if sizes not in found or error < found[sizes][0]:
                found[sizes] = error, x

    # 6 relaxed designs are rounded
    first = [(sizes, x) for x in rows[:6] for sizes in _rounded_sizes(goal.stocks, goal.measure(x))]
    refine(first)
    for _ in range(60):  # rounds of looking around, at most
        best = sorted(found, key=lambda s: found[s][0])[:4]  # the neighbours of 4 combinations are looked at
        moves = []
        for base in best:
            for sizes in _next_sizes(goal.stocks, base):
                if (sizes, base) not in tried:
                    tried.add((sizes, base))
                    moves.append((sizes, found[base][1]))
        if not moves:
            break
        refine(moves)
    return sorted(found.values(), key=lambda pair: pair[0])


def _rounded_sizes(stocks: tuple[Stock, ...], values: np.ndarray) -> list[Sizes]:
    """The ways to round values up or down, those with the smallest changes first."""
    ways = []
    for s, v in zip(stocks, values, strict=True):
        low = s.number(float(v))
        each = [n for n in (low, low + 1) if s.valid(n)] or [low + 1]
        ways.append(sorted(each, key=lambda n, s=s, v=v: abs(s.size(n) - v)))
    out: list[tuple[float, Sizes]] = []
    for sizes in itertools.islice(itertools.product(*ways), 4096):
        gap = sum((s.size(n) - v) ** 2 for s, n, v in zip(stocks, sizes, values, strict=True))
        out.append((gap, sizes))
    return [sizes for _, sizes in sorted(out)[:64]]  # 64 ways to round it, the nearest first


def _next_sizes(stocks: tuple[Stock, ...], sizes: Sizes) -> list[Sizes]:
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
