"""A view of many unknowns on the host: the same as `HostView`, its Jacobians vectors of non-zeros, solved by LU."""

import functools
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jaxnc.records import with_owner
from jaxnc.solvers.host.view import HostView, largest_of_lanes
from jaxnc.solvers.plan import LargePlan, Plan, by_lu, sparse
from jaxnc.solvers.sparse_matrix import SMALL
from jaxnc.system.host import HostEquations

if TYPE_CHECKING:
    from scipy.sparse.linalg import SuperLU


class Level(NamedTuple):
    """Blocks of one or two that are solved together in all lanes: none needs another's solution."""

    # `rows`, `columns`: of each block, (2, blocks); where it has one, the second are those behind all others
    rows: np.ndarray
    columns: np.ndarray
    own: np.ndarray  # places of its numbers, (2, 2, blocks), see `blocks_of_two`
    # rows, columns and places of the numbers that lead to columns of levels before; no row twice in one
    links: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]


@with_owner
def blocks_of_two(plan: LargePlan) -> np.ndarray | None:
    """Find places of the diagonal blocks' numbers, ``(2, 2, blocks)``; None if one is larger than two.

    Blocks of one are filled up with a zero and a one, which stand behind the numbers.
    """
    size = np.array([len(columns) for _, columns in plan.sequence], int)
    if not len(size) or size.max() > 2:
        return None
    p = plan.numbers
    rows, columns = (np.array([[block[k][0], block[k][-1]] for block in plan.sequence]).T for k in (0, 1))
    places = np.stack([np.stack([p.place(r, c) for c in columns]) for r in rows])
    places[:, :, size == 1] = np.array([[0, p.count], [p.count, p.count + 1]])[:, :, None]
    places[0, 0] = p.place(rows[0], columns[0])
    return places


def _pad_numbers(matrix: np.ndarray) -> np.ndarray:
    """Put a zero and a one behind the numbers ``(lanes, nnz)``, lanes last."""
    lanes, dtype = len(matrix), matrix.dtype
    return np.concatenate([matrix.T, np.zeros((1, lanes), dtype), np.ones((1, lanes), dtype)])


@with_owner
def levels(plan: LargePlan) -> tuple[Level, ...]:
    """Sort the blocks of a plan that has `blocks_of_two` into levels."""
    p, own = plan.numbers, blocks_of_two(plan)
    assert own is not None
    (m, n), count = p.shape, len(plan.sequence)
    rows, columns, block_of = np.full((2, count), m), np.full((2, count), n), np.empty(n, int)
    for k, (r, c) in enumerate(plan.sequence):
        rows[: len(r), k], columns[: len(c), k], block_of[c] = r, c, k
    owner = np.empty(m, int)
    owner[rows[rows < m]] = np.broadcast_to(np.arange(count), (2, count))[rows < m]
    outside = np.flatnonzero(owner[p.rows] != block_of[p.columns])
    before: list[list[int]] = [[] for _ in range(count)]
    for e in outside:
        before[owner[p.rows[e]]].append(int(block_of[p.columns[e]]))
    level = np.zeros(count, int)
    for k in range(count):  # in an order in which they can be solved
        level[k] = 1 + max((level[j] for j in before[k]), default=-1)
    out = []
    for number in range(level.max() + 1):
        here = np.flatnonzero(level == number)
        links, left = [], outside[level[owner[p.rows[outside]]] == number]
        while len(left):
            first = np.unique(p.rows[left], return_index=True)[1]
            links.append((p.rows[left[first]], p.columns[left[first]], left[first]))
            left = np.delete(left, first)
        out.append(Level(rows[:, here], columns[:, here], own[:, :, here], tuple(links)))
    return tuple(out)


def solve_levels(plan: LargePlan, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve for right-hand sides ``(lanes, m, c)``, level by level, ``(lanes, n, c)``; not finite if singular.

    It takes as many steps as a chain is long, but each of them for all lanes.
    """
    (m, n), (lanes, _, count) = plan.numbers.shape, right.shape
    numbers = _pad_numbers(matrix)[:, None]
    rest, x = np.zeros((m + 1, count, lanes), matrix.dtype), np.zeros((n + 1, count, lanes), matrix.dtype)
    rest[:m] = np.moveaxis(right, 0, 2)
    for level in levels(plan):
        for row, column, place in level.links:
            rest[row] -= numbers[place] * x[column]
        (a, b), (c, d) = numbers[level.own]
        one, two = rest[level.rows]
        determinant = a * d - b * c
        x[level.columns[0]] = (d * one - b * two) / determinant
        x[level.columns[1]] = (a * two - c * one) / determinant
    return np.moveaxis(x[:n], 2, 0)


class SparseView(HostView):
    """A view of many unknowns; where `HostView` has matrices, this has ``(lanes, nnz)``.

    Steps of a large system are measured by the coordinate that moves most: among thousands of loops one that jumps does
    not show in a sum. Where coordinates are as large as a long chain, not its bars, their rounding is the chain's.
    """

    plan: LargePlan

    def __init__(self, plan: LargePlan, eq: HostEquations):
        super().__init__(plan, eq)
        entries = sum(layout.rows.size * layout.variables.shape[1] for layout in plan.topology.layout)
        # the constraints of lanes which are solved together have a million numbers
        self.shape, self.at_once = (plan.numbers.count,), max(1_000_000 // max(entries, 1), 1)
        self._pairs, self.refines = blocks_of_two(plan), False  # `solver` has the factors alone

    def norm(self, weight: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Measure changes of coordinates, ``(lanes,)``; in a large system by the one that moves most."""
        return largest_of_lanes(weight * change) if self.plan.large else super().norm(weight, change)

    def extent(self, q: np.ndarray) -> np.ndarray:
        """Return how large coordinates are, whose rounding is not the mechanism's."""
        return largest_of_lanes(q) if self.plan.large else super().extent(q)

    def matrices(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return non-zeros of the derivatives by unknown coordinates ``(lanes, nnz)``, and those by known ones."""
        p, (count, n) = self.plan.pattern, (self.plan.numbers.count, len(self.plan.unknown))
        numbers = p.collect(self.eq.entries(q))  # column by column, those of the unknowns first
        known = np.zeros((p.shape[0], len(self.plan.known), q.shape[1]), q.dtype)
        known[p.rows[count:], p.columns[count:] - n] = numbers[count:]
        return np.ascontiguousarray(numbers[:count].T), np.moveaxis(known, 2, 0)

    def lengths(self, matrix: np.ndarray) -> np.ndarray:
        """Jacobians with respect to coordinates as lengths."""
        inner = self.inner if self.inner.ndim == 1 else self.inner[:, 0]
        return matrix / inner[..., self.plan.numbers.columns]

    def damped_step(self, slope: np.ndarray, rows: np.ndarray, damping: np.ndarray) -> np.ndarray:
        """See `HostView.damped_step`."""
        (m, n), plan = self.plan.numbers.shape, self.plan
        out = np.empty((len(slope), n))
        for k, data in enumerate(slope):
            amount = damping[k] * np.sum(data * data) / n + self.least.tiny
            right = np.concatenate([rows[:, k], np.zeros(n)])[:, None]
            out[k] = plan.augmented.solve_by(plan.augmented.factorise(plan.symmetric(data, amount)), right)[m:, 0]
        return out

    def approach(self, q: np.ndarray, begin: np.ndarray) -> np.ndarray:
        """See `HostView.approach`; steps of Gauss and Newton, which need more of them."""
        unknown, slope = self.plan.unknown, self.lengths(self.matrices(q)[0])
        apart = np.zeros_like(q)
        apart[unknown] = (begin - q)[unknown]
        rows = self.residual(q) + self.eq.rates(q, [apart])[self.plan.rows]
        back = self.damped_step(slope, rows, np.full(q.shape[1], self.least.damping))
        return apart[unknown] - back.T / self.unknown_weights

    def _factorise_each(self, matrix: np.ndarray) -> "Iterator[tuple[np.ndarray, SuperLU | None]]":
        """Yield what turns each lane's unknowns into lengths, and factors of its matrix."""
        plan, lengths = self.plan, matrix if self.plan.square else self.lengths(matrix)
        for k, data in enumerate(lengths if len(plan.unknown) else ()):
            inner = self.inner if self.inner.ndim == 1 else self.inner[k, 0]
            yield inner, plan.lu.factorise(data) if plan.square else plan.augmented.factorise(plan.symmetric(data))

    def _solve_lane(self, inner: np.ndarray, factors: "SuperLU | None", right: np.ndarray) -> np.ndarray:
        """Solve in one lane for right-hand sides ``(m, c)``."""
        plan, (m, n) = self.plan, self.plan.numbers.shape
        if plan.square:
            return plan.lu.solve_by(factors, right)
        padded = np.concatenate([right, np.zeros((n, right.shape[1]))])
        return plan.augmented.solve_by(factors, padded)[m:] / inner[:, None]

    def solve(self, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
        """See `HostView.solve`."""
        if self._side_by_side(len(matrix)):
            return solve_levels(self.plan, matrix, right)
        x = np.empty((len(matrix), len(self.plan.unknown), right.shape[2]), matrix.dtype)
        for k, (inner, factors) in enumerate(self._factorise_each(matrix)):
            x[k] = self._solve_lane(inner, factors, right[k])
        return x

    def _single(self, q: np.ndarray) -> None:
        """Return None: the program's matrices are not sparse."""

    @property
    def wants_order(self) -> bool:
        """No: inverses are not sparse."""
        return False

    def _side_by_side(self, lanes: int) -> bool:
        """Say whether all lanes level by level take less time than one after the other by LU."""
        if self._pairs is None:
            return False
        # a matrix without unknowns is factorised in the time of 250, and lanes go through a level in that of 150
        return lanes * (250 + len(self.plan.unknown)) > 150 * len(levels(self.plan))

    def factorise(self, matrix: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `HostView.factorise`; in a large system, sizes of determinants of small blocks only, others are one."""
        if self._pairs is not None or not self.plan.sequence:
            return self.solve(matrix, right), *self._orientation(matrix)
        x, found = np.empty((len(matrix), len(self.plan.unknown), right.shape[2]), matrix.dtype), []
        for k, (inner, factors) in enumerate(self._factorise_each(matrix)):
            x[k] = self._solve_lane(inner, factors, right[k])
            found.append(self._block_signs(factors))
        signs, sizes = np.array(found).swapaxes(0, 1)
        return x, signs, sizes

    def _orientation(self, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if not self.plan.sequence:
            return np.ones((len(matrix), 0)), np.zeros((len(matrix), 0))
        if self._pairs is None:
            signs, sizes = np.array(
                [self._block_signs(factors) for _, factors in self._factorise_each(matrix)]
            ).swapaxes(0, 1)
            return signs, sizes
        (a, b), (c, d) = _pad_numbers(matrix)[self._pairs]
        determinants = (a * d - b * c).T
        return np.sign(determinants), np.log(np.maximum(np.abs(determinants), self.least.tiny))

    def _block_signs(self, factors: "SuperLU | None") -> tuple[np.ndarray, np.ndarray]:
        """Return signs and logarithms of the diagonal blocks' determinants in one lane."""
        pivots, signs = self.plan.lu.pivots(factors)
        logarithms = np.log(np.maximum(pivots, self.least.tiny))
        small, block_of = _small_blocks(self.plan)
        return signs, np.where(small, np.bincount(block_of, logarithms, len(small)), 0.0)

    def solver(self, q: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """See `HostView.solver`."""
        if self._side_by_side(q.shape[1]):
            matrix = self.matrices(q)[0]
            return lambda right: solve_levels(self.plan, matrix, right.T[:, :, None])[:, :, 0].T
        each = [functools.partial(self._solve_lane, *factors) for factors in self._factorise_each(self.matrices(q)[0])]

        def one_by_one(right: np.ndarray) -> np.ndarray:
            columns = [solve(right[:, k, None])[:, 0] for k, solve in enumerate(each)]
            return np.stack(columns, axis=1) if columns else np.zeros((len(self.plan.unknown), right.shape[1]))

        return one_by_one

    def polish(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """See `HostView.polish`; the conditioning is the smallest pivot over the largest."""
        n, lanes = len(self.plan.unknown), q.shape[1]
        r, matrix = self.residual(q), self.matrices(q)[0]
        if self._pairs is not None:
            step = self.solve(matrix, r.T[:, :, None])[:, :, 0].T
            return r, step, self._ratio(_pivots(self.lengths(matrix), self._pairs))
        step, found = np.zeros((n, lanes), q.dtype), np.ones(lanes, q.dtype)
        for k, (inner, factors) in enumerate(self._factorise_each(matrix)):
            step[:, k] = self._solve_lane(inner, factors, r[:, k, None])[:, 0]
            found[k] = self._ratio(self._pivots(inner, factors)[None])[0]
        return r, step, found

    def conditioning(self, q: np.ndarray) -> np.ndarray:
        """See `HostView.conditioning`: smallest pivot over the largest."""
        return self.polish(q)[2]

    def _pivots(self, inner: np.ndarray, factors: "SuperLU | None") -> np.ndarray:
        """Return pivots of one lane, coordinates as lengths."""
        plan, m = self.plan, self.plan.numbers.shape[0]
        return plan.lu.pivots(factors)[0] / inner if plan.square else plan.augmented.pivots(factors)[0][m:]

    def relative(self, matrix: np.ndarray, other: np.ndarray) -> np.ndarray:
        """See `orientation_sign`: of hundreds of unknowns a determinant's size says nothing."""
        return self.orientation_sign(matrix, other)

    def orientation_sign(self, matrix: np.ndarray, other: np.ndarray) -> np.ndarray:
        """See `HostView.orientation_sign`; zero if singular."""
        plan, out = self.plan, np.empty(len(matrix))
        for k, (one, two) in enumerate(zip(matrix, other, strict=True)):
            factors = plan.augmented.factorise(plan.symmetric(one, 0.0, two))
            out[k] = plan.augmented.pivots(factors)[1][0]
        return (-1.0) ** plan.numbers.shape[1] * out


def _pivots(matrix: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Return pivots ``(lanes, 2 blocks)`` of diagonal blocks of one or two."""
    (a, b), (c, d) = _pad_numbers(matrix)[pairs]
    first = np.maximum(np.abs(a), np.abs(c))
    second = np.abs(a * d - b * c) / np.where(first > 0.0, first, 1.0)
    # What fills up a block of one is no pivot of the mechanism's.
    return np.concatenate([first, np.where(pairs[1, 1, :, None] > matrix.shape[1], first, second)]).T


@with_owner
def _small_blocks(plan: LargePlan) -> tuple[np.ndarray, np.ndarray]:
    """Say of which diagonal blocks determinants' sizes are told, and find the block of each unknown."""
    block_of = np.zeros(len(plan.unknown), int)
    for k, (_, columns) in enumerate(plan.sequence):
        block_of[columns] = k
    return np.array([not plan.large or len(columns) <= SMALL for _, columns in plan.sequence], bool), block_of


def view_of(plan: Plan, eq: HostEquations) -> HostView:
    """Make the view of a plan: with dense matrices, or by sparse LU where there are many unknowns."""
    return SparseView(sparse(plan), eq) if by_lu(plan) else HostView(plan, eq)
