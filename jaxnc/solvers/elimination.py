"""Elimination on a known sparsity: rows and pivots are chosen once in NumPy, the rest is written out by element.

Of the structure alone are chosen: rows, if some are redundant; diagonal blocks, the block-triangular form of the matrix
(a row for every column, and the order in which blocks are solved); and, inside a block, an order of pivots with few
multiplications and little fill (Markowitz), of which none is small where the matrix was looked at (threshold). Numbers
are then eliminated as whole lanes: an element is an array of any shape, one value for each lane, and nothing but
element-wise arithmetic happens, so that it fuses, maps and differentiates like arithmetic.

No order of pivots is good in every lane: a pivot may vanish where the matrix is far from singular, and lanes pass by
such places. It is then moved by what loses half of the digits, either way (Li and Demmel, 1998, static pivoting), and
whether the matrix is regular is told by the largest that could have been the pivot in its stead.
"""

import dataclasses
import functools
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxnc.records import with_owner
from jaxnc.system.equations import places
from jaxnc.system.structure import host_kind, program
from jaxnc.system.topology import Special, Topology
from jaxnc.types import AnyArray, ArrayLike, Numbers

Elements = Mapping[tuple[int, int], AnyArray]


def with_special(
    top: Topology, jacobians: Sequence[np.ndarray] | np.ndarray, rank: int, sufficient: bool = False
) -> Topology:
    """Return the topology with what is special about a design: rows that are redundant in it, slopes that hardly are.

    Rows and pivots are chosen by the structure alone, at a pose and with constants that are made up, and by these two
    things. So a choice depends on nothing that was compiled before, and designs that differ in numbers only share it.

    Args:
        top: the structure.
        jacobians: derivatives of all rows by all coordinates in poses of the design, every coordinate a length,
            ``(poses, rows, N)``; the last pose has the largest rank.
        rank: that rank.
        sufficient: whether rows that are redundant are so whatever the dimensions.
    """
    size = np.abs(jacobians)
    where = structural_slopes(top)
    held = np.flatnonzero(where[:, top.unknown].any(axis=1))
    free = np.zeros(where.shape[1], bool)
    free[top.unknown] = True
    # 0.1 of the largest derivative of the row, in the drawing, where sweeps begin, or nearby: less may vanish on a way
    small = where & free & (size <= 0.1 * size.max(axis=2, initial=0.0, keepdims=True)).any(axis=0)
    rows = None
    if rank < len(held):
        rows = tuple(int(held[k]) for k in _independent_rows(jacobians[-1][np.ix_(held, top.unknown)], rank))
    return dataclasses.replace(
        top, special=Special(rows, sufficient, tuple((int(r), int(c)) for r, c in np.argwhere(small)))
    )


def structural_slopes(top: Topology) -> np.ndarray:
    """Say which derivatives can differ from zero, ``(rows, N)``."""
    row, column, nonzero = places(top)
    out = np.zeros((len(top.rows), len(top.coordinates)), bool)
    out[row[nonzero], column[nonzero]] = True
    return out


@with_owner
def pivot_sizes(top: Topology) -> np.ndarray:
    """Sizes of the derivatives ``(rows, N)`` to choose pivots by, from a made-up pose; tiny where the design's are."""
    rng = np.random.default_rng(1)
    q = rng.uniform(0.4, 1.6, len(top.coordinates)) * rng.choice([-1.0, 1.0], len(top.coordinates))
    out = np.zeros((len(top.rows), len(q)))
    for block, layout in zip(top.blocks, top.layout, strict=True):
        constants = rng.uniform(0.4, 1.6, (len(block.kind.constants), block.count))
        if program(block.kind, "residual", top.dim) is None or not block.kind.rows:
            continue
        read = host_kind(block.kind, top.dim)
        with np.errstate(all="ignore"):
            slopes = read.slopes([*q[layout.variables.T], *constants])
        for (r, v), slope in zip(read.places, slopes, strict=True):
            np.add.at(out, (layout.rows[:, r], layout.variables[:, v]), slope)
    out, other = np.abs(out), rng.uniform(0.5, 1.0, out.shape)
    out = np.where(structural_slopes(top), np.where(np.isfinite(out) & (out > 0), out, other), 0.0)
    for r, c in top.special.small if top.special else ():
        out[r, c] = 1e-300  # still a place where elimination may write
    return out


def _independent_rows(matrix: np.ndarray, rank: int) -> list[int]:
    """Choose independent rows, the earliest that will do: in no ordinary design does rounding decide which."""
    left, chosen = matrix.copy(), []
    for _ in range(rank):
        lengths = np.linalg.norm(left, axis=1)
        # the first row that is as independent as 0.1 of the largest that is left is taken
        k = int(np.argmax(lengths >= 0.1 * lengths.max()))
        chosen.append(k)
        way = left[k] / lengths[k]
        left = left - np.outer(left @ way, way)
        left[chosen] = 0.0
    return sorted(chosen)


def independent_coordinates(jacobian: np.ndarray, freedom: int, first: np.ndarray) -> list[int]:
    """Choose coordinates (columns) that the others follow from.

    The jacobian is that of the rows with respect to the unknowns, ``(m, n)``, every coordinate a length; `first` has
    columns in the order in which they are preferred.
    """
    if not freedom:
        return []
    free = np.linalg.svd(jacobian)[2][jacobian.shape[1] - freedom :].T if jacobian.size else np.eye(jacobian.shape[1])
    return [int(first[k]) for k in _independent_rows(free[first], freedom)]


def match_rows(rows: Sequence[Sequence[int]], count: int) -> list[int]:
    """Choose for each column a row of its own, of those that it has an entry in; -1 where there is none."""
    owner, matched = [-1] * count, [-1] * len(rows)
    for column in range(len(rows)):
        # Augmenting path, breadth first: from the column over its rows to the columns that own them.
        came: dict[int, int] = {}
        queue = [column]
        for at in queue:
            free = -1
            for row in rows[at]:
                if row not in came:
                    came[row] = at
                    if owner[row] < 0:
                        free = row
                        break
                    queue.append(owner[row])
            if free >= 0:
                while free >= 0:
                    at = came[free]
                    owner[free] = at
                    matched[at], free = free, matched[at]
                break
    return matched


def strong_components(leads: Sequence[Sequence[int]]) -> list[list[int]]:
    """Strong components of a directed graph, each after all that it leads to (Tarjan, without recursion)."""
    number, low = [-1] * len(leads), [0] * len(leads)
    inside = [False] * len(leads)
    waiting: list[int] = []
    path: list[tuple[int, Iterator[int]]] = []
    out: list[list[int]] = []
    order = itertools.count()

    def enter(node: int) -> None:
        number[node] = low[node] = next(order)
        waiting.append(node)
        inside[node] = True
        path.append((node, iter(leads[node])))

    for root in range(len(leads)):
        if number[root] < 0:
            enter(root)
        while path:
            node, rest = path[-1]
            for other in rest:
                if number[other] < 0:
                    enter(other)
                    break
                if inside[other]:
                    low[node] = min(low[node], number[other])
            else:
                path.pop()
                if path:
                    parent = path[-1][0]
                    low[parent] = min(low[parent], low[node])
                if low[node] == number[node]:
                    component = [node]
                    while (other := waiting.pop()) != node:
                        component.append(other)
                    for other in component:
                        inside[other] = False
                    out.append(sorted(component))
    return out


@dataclass(frozen=True)
class Elimination:
    """A planned elimination of a square sparse matrix that is one diagonal block."""

    rows: tuple[int, ...]  # rows and columns in the order in which they are eliminated
    columns: tuple[int, ...]
    sign: int  # of that permutation
    cost: int  # multiplications of one factorisation


def plan_elimination(sample: np.ndarray) -> Elimination:
    """Choose the pivots of a matrix: Markowitz with threshold pivoting, which eliminates the sample along with it.

    The sample has typical sizes of the elements, ``(n, n)``; structural zeros are zero.
    """
    a = sample.astype(float)
    pattern = a != 0
    n, cost = len(a), 0
    left_r, left_c = list(range(n)), list(range(n))
    rows, columns = [], []
    largest = np.abs(a).max(initial=0.0)
    for _ in range(n):
        best, chosen = None, None
        for i in left_r:
            row = np.abs(a[i, left_c])
            top = row.max(initial=0.0)
            # 1e-10 of the largest element: smaller pivots where the matrix was looked at are not trusted
            if top <= 1e-10 * largest:
                continue
            inside = int(pattern[i, left_c].sum()) - 1
            for j in left_c:
                # a pivot is at least 0.1 of the largest element of its row
                if not pattern[i, j] or abs(a[i, j]) < 0.1 * top:
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
        rows.append(i)
        columns.append(j)
    signs = [np.linalg.slogdet(np.eye(n)[order])[0] for order in (rows, columns)]
    return Elimination(tuple(rows), tuple(columns), int(signs[0] * signs[1]), cost)


class Pivots(NamedTuple):
    """The pivots of a matrix."""

    least: AnyArray  # the smallest of what each could have been, its column where it is eliminated; zero where singular
    most: AnyArray  # the largest, of rows that have grown what they were before
    grown: AnyArray  # the largest, with all growth: rounding is a part of it


@dataclass(frozen=True)
class EliminatedPair:
    """An eliminated dense matrix of two rows, by Cramer's rule: no order of its pivots is good at every angle."""

    rows: tuple[int, ...]
    columns: tuple[int, ...]
    elements: tuple[Numbers, Numbers, Numbers, Numbers]
    inverse: AnyArray  # of the determinant
    pivots: Pivots
    determinant: AnyArray

    def solve(self, right: Sequence[Numbers]) -> list[AnyArray]:
        """Solve ``A x = b``; b is a sequence of elements by row, x by column."""
        p, q, r, s = self.elements
        b, d = (right[i] for i in self.rows)
        return _put_at(self.columns, ((s * b - q * d) * self.inverse, (p * d - r * b) * self.inverse))

    def solve_transposed(self, right: Sequence[Numbers]) -> list[Numbers]:
        """Solve ``Aᵀ y = b``; b is by column, y by row."""
        p, q, r, s = self.elements
        b, d = (right[j] for j in self.columns)
        return _put_at(self.rows, ((s * b - r * d) * self.inverse, (p * d - q * b) * self.inverse))


def _put_at(places: Sequence[int], values: Sequence[Numbers]) -> list[Numbers]:
    out: list[AnyArray] = [None] * len(places)
    for k, value in zip(places, values, strict=True):
        out[k] = value
    return out


class _Step(NamedTuple):
    row: int
    column: int
    pivot: Numbers
    below: tuple[tuple[int, Numbers], ...]  # rows further down and their elements in the pivot's column
    right: tuple[tuple[int, Numbers], ...]  # columns not yet eliminated in the pivot row and their elements


@dataclass(frozen=True)
class Factors:
    """An eliminated matrix: solves with it and its transpose, its pivots, and its determinant."""

    steps: tuple[_Step, ...]
    pivots: Pivots
    determinant: AnyArray

    def solve(self, right: Sequence[Numbers]) -> list[AnyArray]:
        """Solve ``A x = b``; b is a sequence of elements by row, x by column."""
        x: list[AnyArray] = [None] * len(right)
        b = list(right)
        # Quotients are what XLA computes once, however many use them.
        for step in self.steps:
            quotient = b[step.row] / step.pivot
            for i, element in step.below:
                b[i] = b[i] - element * quotient
        for step in reversed(self.steps):
            rest = b[step.row]
            for j, a in step.right:
                rest = rest - a * x[j]
            x[step.column] = rest / step.pivot
        return x

    def solve_transposed(self, right: Sequence[Numbers]) -> list[Numbers]:
        """Solve ``Aᵀ y = b``; b is by column, y by row."""
        b, z = list(right), list(right)
        y: list[AnyArray] = [None] * len(right)
        for step in self.steps:
            z[step.row] = b[step.column]
            quotient = z[step.row] / step.pivot
            for j, a in step.right:
                b[j] = b[j] - a * quotient
        for step in reversed(self.steps):
            rest = z[step.row]
            for i, element in step.below:
                rest = rest - element * y[i]
            y[step.row] = rest / step.pivot
        return y


Eliminated = EliminatedPair | Factors


def eliminate_block(
    plan: Elimination, elements: Elements, units: Sequence[ArrayLike] = (), smallest: float = 0.0
) -> Eliminated:
    """Eliminate a matrix whose elements are numbers or lanes; not finite if the last pivot vanishes.

    Each pivot is compared with what could have been one in its stead: where one vanishes by chance, the pose is not
    singular.

    Args:
        plan: the planned elimination.
        elements: of the matrix, by row and column.
        units: by which the elements of each column are larger than those of others, as a rule.
        smallest: how far from zero pivots that another one follows are moved.
    """
    units = units or (1.0,) * len(plan.rows)
    a = dict(elements)
    if len(plan.rows) == 2 and len(a) == 4:
        (i, k), (j, m) = plan.rows, plan.columns
        p, q, r, s = a[i, j], a[i, m], a[k, j], a[k, m]
        determinant = p * s - q * r
        inverse = 1.0 / determinant
        largest = jnp.maximum(jnp.abs(p), jnp.abs(r))
        first, second = largest / units[j], jnp.abs(determinant / largest) / units[m]
        pivots = Pivots(jnp.minimum(first, second), *(jnp.maximum(first, second),) * 2)
        return EliminatedPair(plan.rows, plan.columns, (p, q, r, s), inverse, pivots, determinant * plan.sign)
    steps, left_r, left_c = [], list(plan.rows), list(plan.columns)
    sizes, natural, usual = [], [], None
    for i, j in zip(plan.rows, plan.columns, strict=True):
        left_r.remove(i)
        left_c.remove(j)
        pivot, size = a[i, j], jnp.abs(a[i, j])
        below = [k for k in left_r if (k, j) in a]
        largest = functools.reduce(jnp.maximum, [jnp.abs(a[k, j]) for k in below], size)
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
        if below and right:
            now = largest <= 100.0 * jnp.abs(pivot)  # 100 times a row may be taken from another: beyond, elements grow
            usual = now if usual is None else usual & now
        steps.append(_Step(i, j, pivot, column, right))
    parts = (jnp.minimum, sizes), (jnp.maximum, natural), (jnp.maximum, sizes)
    pivots = Pivots(*(functools.reduce(f, x) for f, x in parts))
    determinant = functools.reduce(lambda x, y: x * y, [step.pivot for step in steps])
    return Factors(tuple(steps), pivots, determinant * plan.sign)
