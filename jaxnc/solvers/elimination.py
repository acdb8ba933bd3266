"""Elimination on a known sparsity, planned once in NumPy and written out element by element.

The plan is a sequence of diagonal blocks (the block-triangular form of the matrix) and, inside a block, an order of
pivots: few multiplications and little fill (Markowitz), pivots that are not small where the matrix was looked at
(threshold). Numbers are then eliminated as whole lanes: an element is an array of any shape, one value for each lane,
and nothing but element-wise arithmetic happens, so that it fuses, maps and differentiates like arithmetic.

No order of pivots is good in every lane: a pivot may vanish where the matrix is far from singular, and lanes pass by
such places. It is then moved by what loses half of the digits, either way (Li and Demmel, 1998, static pivoting), and
whether the matrix is regular is told by the largest that could have been the pivot in its stead.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

_THRESHOLD = 0.1  # a pivot is at least this part of the largest element of its row
_LOST = 1e-10  # of the largest element: smaller pivots where the matrix was looked at are not trusted
_COMPARED = 150  # multiplications of a factorisation, at most, whose pivots are compared: it takes long to compile
_USUAL = 100.0  # a row times more may be taken from another: beyond, elements grow

Elements = Mapping[tuple[int, int], Any]


class Block(NamedTuple):
    """A diagonal block: pairs of row and column in the order they are eliminated, and the sign of that permutation."""

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    sign: int


@dataclass(frozen=True)
class Elimination:
    """A planned elimination of a square sparse matrix."""

    size: int  # number of rows and columns
    blocks: tuple[Block, ...]  # the diagonal blocks in the order in which they can be solved
    cost: int  # multiplications of one factorisation


def plan_elimination(sequence: Sequence[tuple[np.ndarray, np.ndarray]], sample: np.ndarray) -> Elimination:
    """Choose the pivots.

    `sequence` has rows and columns of the diagonal blocks in the order in which they can be solved; `sample` typical
    sizes of the elements, ``(n, n)``, where structural zeros are zero.
    """
    blocks, cost = [], 0
    for rows, columns in sequence:
        block, spent = _pivots(np.asarray(rows), np.asarray(columns), sample)
        blocks.append(block)
        cost += spent
    return Elimination(sample.shape[0], tuple(blocks), cost)


def _pivots(rows: np.ndarray, columns: np.ndarray, sample: np.ndarray) -> tuple[Block, int]:
    """Markowitz with threshold pivoting on one block, eliminating the sample along with the pattern."""
    a = sample[np.ix_(rows, columns)].astype(float)
    pattern = a != 0
    n, cost = len(rows), 0
    left_r, left_c = list(range(n)), list(range(n))
    order_r, order_c = [], []
    largest = np.abs(a).max(initial=0.0)
    for _ in range(n):
        best, chosen = None, None
        for i in left_r:
            row = np.abs(a[i, left_c])
            top = row.max(initial=0.0)
            if top <= _LOST * largest:
                continue
            inside = int(pattern[i, left_c].sum()) - 1
            for j in left_c:
                if not pattern[i, j] or abs(a[i, j]) < _THRESHOLD * top:
                    continue
                fill = inside * (int(pattern[left_r, j].sum()) - 1)
                key = (fill, -abs(a[i, j]) / top)
                if best is None or key < best:
                    best, chosen = key, (i, j)
        if chosen is None:  # singular where it was looked at: any structural pivot
            chosen = next(((i, j) for i in left_r for j in left_c if pattern[i, j]), (left_r[0], left_c[0]))
        i, j = chosen
        left_r.remove(i)
        left_c.remove(j)
        for k in left_r:
            if not pattern[k, j]:
                continue
            factor = a[k, j] / a[i, j] if a[i, j] else 0.0
            for m in left_c:
                if pattern[i, m]:
                    a[k, m] -= factor * a[i, m]
                    pattern[k, m] = True
                    cost += 1
            a[k, j] = 0.0
        order_r.append(i)
        order_c.append(j)
    sign = _parity(order_r) * _parity(order_c)
    return Block(tuple(int(rows[i]) for i in order_r), tuple(int(columns[j]) for j in order_c), sign), cost


def _parity(order: Sequence[int]) -> int:
    seen, sign = [False] * len(order), 1
    for start in range(len(order)):
        length, k = 0, start
        while not seen[k]:
            seen[k] = True
            k = order[k]
            length += 1
        if length and length % 2 == 0:
            sign = -sign
    return sign


@dataclass(frozen=True)
class _Step:
    row: int
    column: int
    pivot: Any
    below: tuple[tuple[int, Any], ...]  # rows further down and their elements in the pivot's column
    right: tuple[tuple[int, Any], ...]  # columns not yet eliminated in the pivot row and their elements


@dataclass(frozen=True)
class _Pair:
    """A dense diagonal block of two rows, by Cramer's rule: no order of its pivots is good at every angle."""

    rows: tuple[int, int]
    columns: tuple[int, int]
    elements: tuple[Any, Any, Any, Any]
    inverse: Any  # of the determinant

    def solve(self, b: Sequence[Any]) -> tuple[Any, Any]:
        p, q, r, s = self.elements
        return (s * b[0] - q * b[1]) * self.inverse, (p * b[1] - r * b[0]) * self.inverse

    def solve_transposed(self, b: Sequence[Any]) -> tuple[Any, Any]:
        p, q, r, s = self.elements
        return (s * b[0] - r * b[1]) * self.inverse, (p * b[1] - q * b[0]) * self.inverse


class Pivots(NamedTuple):
    """The pivots of a block."""

    least: Any  # the smallest of what each could have been, its column where it is eliminated; zero where singular
    most: Any  # the largest, of rows that have grown what they were before
    grown: Any  # the largest, with all growth: rounding is a part of it


@dataclass(frozen=True)
class Factors:
    """An eliminated matrix: solves with it and its transpose, its pivots, and the orientation of its blocks."""

    steps: tuple[tuple[_Step, ...] | _Pair, ...]
    before: tuple[tuple[tuple[int, int, Any], ...], ...]  # per block: elements (row, column) left of the diagonal block
    pivots: tuple[Pivots, ...]
    determinants: tuple[Any, ...]

    def solve(self, right: Sequence[Any]) -> list[Any]:
        """Solution of ``A x = b``; b and x are sequences of elements by row and by column."""
        x: list[Any] = [None] * len(right)
        for steps, before in zip(self.steps, self.before, strict=True):
            rows = steps.rows if isinstance(steps, _Pair) else [step.row for step in steps]
            b = {i: right[i] for i in rows}
            for i, j, a in before:
                b[i] = b[i] - a * x[j]
            if isinstance(steps, _Pair):
                x[steps.columns[0]], x[steps.columns[1]] = steps.solve([b[i] for i in rows])
                continue
            # Quotients are what XLA computes once, however many use them.
            for step in steps:
                quotient = b[step.row] / step.pivot
                for i, element in step.below:
                    b[i] = b[i] - element * quotient
            for step in reversed(steps):
                rest = b[step.row]
                for j, a in step.right:
                    rest = rest - a * x[j]
                x[step.column] = rest / step.pivot
        return x

    def solve_transposed(self, right: Sequence[Any]) -> list[Any]:
        """Solution of ``Aᵀ y = b``; b is by column, y by row."""
        b = list(right)
        y: list[Any] = [None] * len(right)
        for steps, before in zip(reversed(self.steps), reversed(self.before), strict=True):
            if isinstance(steps, _Pair):
                for i, value in zip(steps.rows, steps.solve_transposed([b[j] for j in steps.columns]), strict=True):
                    y[i] = value
                for i, j, a in before:
                    b[j] = b[j] - a * y[i]
                continue
            z: dict[int, Any] = {}
            for step in steps:
                z[step.row] = b[step.column]
                quotient = z[step.row] / step.pivot
                for j, a in step.right:
                    b[j] = b[j] - a * quotient
            for step in reversed(steps):
                rest = z[step.row]
                for i, element in step.below:
                    rest = rest - element * y[i]
                y[step.row] = rest / step.pivot
            for i, j, a in before:
                b[j] = b[j] - a * y[i]
        return y


def eliminate(plan: Elimination, elements: Elements, units: Sequence[Any] = (), smallest: float = 0.0) -> Factors:
    """Eliminate a matrix whose elements are numbers or lanes; not finite if a block's last pivot vanishes.

    Elements of each column are by `units` larger than those of others, as a rule; pivots that another one follows are
    moved away from zero by the `smallest`.
    """
    units = units or (1.0,) * plan.size
    steps, before, pivots, determinants = [], [], [], []
    for block in plan.blocks:
        inside = set(block.columns)
        a = {(i, j): elements[i, j] for i in block.rows for j in block.columns if (i, j) in elements}
        outside = tuple((i, j, e) for (i, j), e in elements.items() if i in block.rows and j not in inside)
        before.append(outside)
        if len(block.rows) == 2 and len(a) == 4:
            (i, k), (j, m) = block.rows, block.columns
            p, q, r, s = a[i, j], a[i, m], a[k, j], a[k, m]
            determinant = p * s - q * r
            steps.append(_Pair((i, k), (j, m), (p, q, r, s), 1.0 / determinant))
            largest = jnp.maximum(jnp.abs(p), jnp.abs(r))
            first, second = largest / units[j], jnp.abs(determinant / largest) / units[m]
            pivots.append(Pivots(jnp.minimum(first, second), *(jnp.maximum(first, second),) * 2))
        else:
            made, seen = _eliminated(block, a, units, smallest, plan.cost <= _COMPARED)
            steps.append(tuple(step for step, _ in made))
            pivots.append(seen)
            determinant = made[0][1]
            for _, pivot in made[1:]:
                determinant = determinant * pivot
        determinants.append(determinant * block.sign)
    return Factors(tuple(steps), tuple(before), tuple(pivots), tuple(determinants))


def _eliminated(
    block: Block, a: dict[tuple[int, int], Any], units: Sequence[Any], smallest: float, compared: bool
) -> tuple[list[tuple[_Step, Any]], Pivots]:
    """Eliminate one block: its steps, each with its pivot, and what the pivots are.

    Unless they are `compared` with what could have been a pivot in their stead, a pose at which one vanishes by chance
    is not told from a singular one.
    """
    made, left_r, left_c = [], list(block.rows), list(block.columns)
    sizes, natural, usual = [], [], None
    for i, j in zip(block.rows, block.columns, strict=True):
        left_r.remove(i)
        left_c.remove(j)
        pivot, size = a[i, j], jnp.abs(a[i, j])
        below = [k for k in left_r if (k, j) in a]
        others = [jnp.abs(a[k, j]) for k in below] if compared else []
        largest = functools.reduce(jnp.maximum, others, size)
        if below and smallest:
            away = smallest * units[j]
            pivot = pivot + jnp.where(size < away, jnp.where(pivot < 0.0, -away, away), 0.0)
        right = tuple((m, a[i, m]) for m in left_c if (i, m) in a)
        column = tuple((k, a[k, j]) for k in below)
        for k, element in column:
            factor = element / pivot
            for m, e in right:
                a[k, m] = a[k, m] - factor * e if (k, m) in a else -(factor * e)
        sizes.append(largest / units[j])
        natural.append(sizes[-1] if usual is None else jnp.where(usual, sizes[-1], 0.0))
        if below and right and compared:
            now = largest <= _USUAL * jnp.abs(pivot)
            usual = now if usual is None else usual & now
        made.append((_Step(i, j, pivot, column, right), pivot))
    seen = (jnp.minimum, sizes), (jnp.maximum, natural), (jnp.maximum, sizes)
    return made, Pivots(*(functools.reduce(f, x) for f, x in seen))
