"""A view of a large system on the host: the same as `HostView`, its Jacobians vectors of non-zeros, solved by LU."""

import functools
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jaxnc.solvers.host.view import HostView, largest
from jaxnc.solvers.large import LargePlan
from jaxnc.solvers.lu import SMALL
from jaxnc.solvers.plan import Plan
from jaxnc.system.host import HostEquations

if TYPE_CHECKING:
    from scipy.sparse.linalg import SuperLU

_NUMBERS = 1_000_000  # that the constraints of lanes which are solved together have


class _Blocks(NamedTuple):
    """The diagonal blocks: which are small, the block of each unknown, and `pairs`.

    Attributes:
        pairs: places of the blocks' numbers, ``(2, 2, blocks)``, if none is larger than two; blocks of one are filled
            up with a zero and a one, which stand behind the numbers.
    """

    small: np.ndarray
    of_unknown: np.ndarray
    pairs: np.ndarray | None


class SparseView(HostView):
    """What is solved for of a large system; where `HostView` has matrices, these have ``(lanes, nnz)``.

    Steps are measured by the coordinate that moves most: among thousands of loops one that jumps does not show in a
    sum. Where coordinates are as large as a long chain, not its bars, their rounding is the chain's.
    """

    plan: LargePlan

    def __init__(self, plan: LargePlan, eq: HostEquations):
        super().__init__(plan, eq)
        entries = sum(layout.rows.size * layout.variables.shape[1] for layout in plan.topology.layout)
        self.shape, self.at_once = (plan.numbers.count,), max(_NUMBERS // max(entries, 1), 1)
        self._blocks = _blocks(plan)

    def norm(self, weight: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Lengths ``(lanes,)`` of changes of coordinates: of the one that moves most."""
        return largest(weight * change)

    def extent(self, q: np.ndarray) -> np.ndarray:
        """How large coordinates are, whose rounding is not the mechanism's."""
        return largest(q)

    def matrices(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Non-zeros of the derivatives by unknown coordinates ``(lanes, nnz)``, and all of those by known ones."""
        p, found = self.plan.numbers, self.eq.entries(q)
        padded = np.concatenate([found, np.zeros((1, q.shape[1]))])
        data = sum((padded[g] for g in p.gathers[1:]), padded[p.gathers[0]])
        where, rows, columns = p.known
        known = np.zeros((p.shape[0], len(self.plan.known), q.shape[1]))
        np.add.at(known, (rows, columns), found[where])  # pyright: ignore[reportArgumentType]
        return np.ascontiguousarray(data.T), np.moveaxis(known, 2, 0)

    def lengths(self, matrix: np.ndarray) -> np.ndarray:
        """Jacobians with respect to coordinates as lengths."""
        inner = self.inner if self.inner.ndim == 1 else self.inner[:, 0]
        return matrix / inner[..., self.plan.numbers.columns]

    def damped(self, slope: np.ndarray, rows: np.ndarray, damping: np.ndarray) -> np.ndarray:
        """As `HostView.damped`."""
        (m, n), plan = self.plan.numbers.shape, self.plan
        out = np.empty((len(slope), n))
        for k, data in enumerate(slope):
            amount = damping[k] * np.sum(data * data) / n + self.least.tiny
            right = np.concatenate([rows[:, k], np.zeros(n)])[:, None]
            out[k] = plan.augmented.solved_by(plan.augmented.factorise(plan.symmetric(data, amount)), right)[m:, 0]
        return out

    def _factors(self, matrix: np.ndarray) -> "Iterator[tuple[np.ndarray, SuperLU | None]]":
        """What turns each lane's unknowns into lengths, and factors of its matrix."""
        plan, lengths = self.plan, matrix if self.plan.square else self.lengths(matrix)
        for k, data in enumerate(lengths if len(plan.unknown) else ()):
            inner = self.inner if self.inner.ndim == 1 else self.inner[k, 0]
            yield inner, plan.lu.factorise(data) if plan.square else plan.augmented.factorise(plan.symmetric(data))

    def _solved(self, inner: np.ndarray, factors: "SuperLU | None", right: np.ndarray) -> np.ndarray:
        """Steps of one lane's unknowns for right-hand sides ``(m, c)``."""
        plan, (m, n) = self.plan, self.plan.numbers.shape
        if plan.square:
            return plan.lu.solved_by(factors, right)
        padded = np.concatenate([right, np.zeros((n, right.shape[1]))])
        return plan.augmented.solved_by(factors, padded)[m:] / inner[:, None]

    def solve(self, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
        """As `HostView.solve`."""
        return self.factorised(matrix, right, facing=False)[0]

    def factorised(
        self, matrix: np.ndarray, right: np.ndarray, facing: bool = True
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As `HostView.factorised`; the sizes of determinants of small blocks only, those of others count as one."""
        apart = facing and self.plan.square and self._blocks.pairs is None
        x, found = np.empty((len(matrix), len(self.plan.unknown), right.shape[2])), []
        for k, (inner, factors) in enumerate(self._factors(matrix)):
            x[k] = self._solved(inner, factors, right[k])
            if apart:
                found.append(self._facing(factors))
        signs, sizes = np.array(found).swapaxes(0, 1) if found else self._orientation(matrix, facing and not apart)
        return x, signs, sizes

    def _orientation(self, matrix: np.ndarray, wanted: bool = True) -> tuple[np.ndarray, np.ndarray]:
        if not wanted or not self.plan.square or not len(self.plan.sequence):
            return np.ones((len(matrix), 0)), np.zeros((len(matrix), 0))
        if self._blocks.pairs is None:
            signs, sizes = np.array([self._facing(factors) for _, factors in self._factors(matrix)]).swapaxes(0, 1)
            return signs, sizes
        (a, b), (c, d) = _filled(matrix, self._blocks.pairs)
        determinants = a * d - b * c
        return np.sign(determinants), np.log(np.maximum(np.abs(determinants), self.least.tiny))

    def _facing(self, factors: "SuperLU | None") -> tuple[np.ndarray, np.ndarray]:
        """Signs and logarithms of the diagonal blocks' determinants in one lane."""
        pivots, signs = self.plan.lu.pivots(factors)
        logarithms = np.log(np.maximum(pivots, self.least.tiny))
        small = self._blocks.small
        return signs, np.where(small, np.bincount(self._blocks.of_unknown, logarithms, len(small)), 0.0)

    def solver(self, q: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """As `HostView.solver`."""
        each = [functools.partial(self._solved, *factors) for factors in self._factors(self.matrices(q)[0])]

        def solved(right: np.ndarray) -> np.ndarray:
            columns = [solve(right[:, k, None])[:, 0] for k, solve in enumerate(each)]
            return np.stack(columns, axis=1) if columns else np.zeros((len(self.plan.unknown), right.shape[1]))

        return solved

    def polished(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As `HostView.polished`; the conditioning is the smallest pivot over the largest."""
        n, lanes = len(self.plan.unknown), q.shape[1]
        if lanes > self.at_once:
            some = np.array_split(np.arange(lanes), -(-lanes // self.at_once))
            r, step, found = zip(*(self.taken(which).polished(q[:, which]) for which in some), strict=True)
            return np.concatenate(r, axis=1), np.concatenate(step, axis=1), np.concatenate(found)
        r, matrix, pairs = self.residual(q), self.matrices(q)[0], self._blocks.pairs
        step, found = np.zeros((n, lanes)), np.ones(lanes)
        for k, (inner, factors) in enumerate(self._factors(matrix)):
            step[:, k] = self._solved(inner, factors, r[:, k, None])[:, 0]
            if pairs is None:
                found[k] = self._ratio(self._pivots(inner, factors)[None])[0]
        if pairs is not None:
            found = self._ratio(_pivots(self.lengths(matrix), pairs))
        return r, step, found

    def conditioning(self, q: np.ndarray) -> np.ndarray:
        """As `HostView.conditioning`: smallest pivot over the largest."""
        return self.polished(q)[2]

    def _pivots(self, inner: np.ndarray, factors: "SuperLU | None") -> np.ndarray:
        """Pivots of one lane, coordinates as lengths."""
        plan, m = self.plan, self.plan.numbers.shape[0]
        return plan.lu.pivots(factors)[0] / inner if plan.square else plan.augmented.pivots(factors)[0][m:]

    def relative(self, matrix: np.ndarray, other: np.ndarray) -> np.ndarray:
        """As `facing`: of hundreds of unknowns a determinant's size says nothing."""
        return self.facing(matrix, other)

    def facing(self, matrix: np.ndarray, other: np.ndarray) -> np.ndarray:
        """As `HostView.facing`; zero if singular."""
        plan, out = self.plan, np.empty(len(matrix))
        for k, (one, two) in enumerate(zip(matrix, other, strict=True)):
            factors = plan.augmented.factorise(plan.symmetric(one, 0.0, two))
            out[k] = plan.augmented.pivots(factors)[1][0]
        return (-1.0) ** plan.numbers.shape[1] * out


def _filled(matrix: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Diagonal blocks of one or two, ``(2, 2, lanes, blocks)``."""
    padded = np.concatenate([matrix, np.broadcast_to([0.0, 1.0], (len(matrix), 2))], axis=1)
    return np.moveaxis(padded[:, pairs], 0, 2)


def _pivots(matrix: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Pivots ``(lanes, 2 blocks)`` of diagonal blocks of one or two."""
    (a, b), (c, d) = _filled(matrix, pairs)
    first = np.maximum(np.abs(a), np.abs(c))
    second = np.abs(a * d - b * c) / np.where(first > 0.0, first, 1.0)
    # What fills up a block of one is no pivot of the mechanism's.
    return np.concatenate([first, np.where(pairs[1, 1] > matrix.shape[1], first, second)], axis=1)


@functools.lru_cache(maxsize=64)
def _blocks(plan: LargePlan) -> _Blocks:
    count, of_unknown, p = len(plan.sequence), np.zeros(len(plan.unknown), int), plan.numbers
    size = np.array([len(columns) for _, columns in plan.sequence], int)
    if not count:
        return _Blocks(size <= SMALL, of_unknown, None)
    of_unknown[np.concatenate([columns for _, columns in plan.sequence])] = np.repeat(np.arange(count), size)
    if size.max() > 2:
        return _Blocks(size <= SMALL, of_unknown, None)
    rows, columns = (np.array([[block[k][0], block[k][-1]] for block in plan.sequence]).T for k in (0, 1))
    pairs = np.stack([np.stack([p.place(r, c) for c in columns]) for r in rows])
    pairs[:, :, size == 1] = np.array([[0, p.count], [p.count, p.count + 1]])[:, :, None]
    pairs[0, 0] = p.place(rows[0], columns[0])
    return _Blocks(size <= SMALL, of_unknown, pairs)


def view_of(plan: Plan, eq: HostEquations) -> HostView:
    """What is solved for, of a large system or of any other."""
    return SparseView(plan, eq) if isinstance(plan, LargePlan) else HostView(plan, eq)
