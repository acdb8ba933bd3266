"""Large sparse matrices on the host: where their numbers are, their LU by SuperLU, and their rank by it.

SciPy's sparse matrices, which take longer to import than a small mechanism to sweep, are imported where a large one
needs them.
"""

import contextlib
import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.process import one_thread
from jaxnc.types import Array, PyTree

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import SuperLU

SMALL = 4  # columns of a diagonal block that are eliminated in the order in which the block has them
RANK = 3e-7  # of the largest singular value, sparse or dense: at a double root poses are known to 1e-8 only
_KEPT = 2  # factorisations
_DOUBT = 10.0  # times smaller or larger than the threshold: too close to decide
_SHIFTS = (1e-9, 1e-8, 1e-7)  # of the largest singular value, squared: the first that keeps the factorisation regular


class Pattern:
    """Static structure of a sparse matrix; its numbers are a vector ``(nnz,)``, column by column.

    Args:
        where: places in the entries of constraints; those that belong to one number are added up.
        r, c: row and column of each.
        shape: rows m and columns n.
        pad: index of the zero behind the entries.
    """

    def __init__(self, where: np.ndarray, r: np.ndarray, c: np.ndarray, shape: tuple[int, int], pad: int):
        key, left = c.astype(np.int64) * shape[0] + r, np.arange(len(where))
        found = np.unique(key)
        self.shape, self.count, self.pad = shape, len(found), pad
        self.columns, self.rows = np.divmod(found, max(shape[0], 1))  # of every number
        # Index arrays (nnz,) into the entries (with a zero appended), whose gathered sum is the numbers.
        self.gathers: list[np.ndarray] = []
        while len(left) or not self.gathers:
            _, first = np.unique(key[left], return_index=True)
            index = np.full(len(found), pad, dtype=np.int64)
            index[np.searchsorted(found, key[left[first]])] = where[left[first]]
            self.gathers.append(index)
            left = np.delete(left, first)
        # Per row, which numbers and which columns, (m, most) each, padded; None where rows are too unequal.
        self.wide = _by_rows(self.rows, self.columns, shape[0])

    def collect(self, entries: np.ndarray) -> np.ndarray:
        """Add up the numbers ``(nnz, lanes)`` from the entries of constraints ``(entries, lanes)``, in NumPy."""
        data = entries[self.gathers[0]]
        for g in self.gathers[1:]:
            some = g < len(entries)
            data[some] += entries[g[some]]
        return data

    def times(self, data: Array, x: Array) -> Array:
        """Multiply with a vector, ``(n,)`` to ``(m,)``; differentiable and transposable."""
        if self.wide is None:
            return jnp.zeros(self.shape[0]).at[self.rows].add(data * x[self.columns])
        padded = jnp.concatenate([data, jnp.zeros(1)])
        numbers, columns = self.wide
        return jnp.sum(padded[numbers] * x[columns], axis=1)

    def times_transposed(self, data: Array, y: Array) -> Array:
        """Multiply the transpose with a vector, ``(m,)`` to ``(n,)``."""
        return jnp.zeros(self.shape[1]).at[self.columns].add(data * y[self.rows])

    def place(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Find where the numbers at rows and columns are kept; `count` where there is none."""
        key = self.columns.astype(np.int64) * self.shape[0] + self.rows
        wanted = columns.astype(np.int64) * self.shape[0] + rows
        at = np.minimum(np.searchsorted(key, wanted), max(self.count - 1, 0))
        return np.where(key[at] == wanted, at, self.count) if self.count else np.zeros(wanted.shape, int)


def _by_rows(rows: np.ndarray, columns: np.ndarray, m: int) -> tuple[np.ndarray, np.ndarray] | None:
    lengths = np.bincount(rows, minlength=m)
    most = int(lengths.max(initial=0))
    # padding to 4 times the non-zeros is cheaper than adding up one by one
    if not len(rows) or most * m > 4.0 * len(rows):
        return None
    order = np.argsort(rows, kind="stable")
    slot = np.arange(len(rows)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    numbers, at = np.full((m, most), len(rows)), np.zeros((m, most), dtype=np.int64)
    numbers[rows[order], slot], at[rows[order], slot] = order, columns[order]
    return numbers, at


class _Blocks(NamedTuple):
    """Diagonal blocks, one behind the other: their columns, the block of each column, and the place of each row."""

    count: int
    columns: np.ndarray
    of_column: np.ndarray
    place_of_row: np.ndarray


@dataclass(eq=False)
class Factoriser:
    """Factorises square matrices of one pattern."""

    size: int  # rows and columns
    rows: np.ndarray  # row of every number
    columns: np.ndarray  # column of every number
    # Rows and columns of the diagonal blocks of its block-triangular form, in an order in which they can be solved;
    # empty for a single one of all.
    blocks: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
    stored: int = 0  # numbers in the factors of the last matrix
    _places: tuple[np.ndarray, np.ndarray] | None = None
    _last: list[tuple[np.ndarray, "SuperLU | None"]] = field(default_factory=list)

    @functools.cached_property
    def _layout(self) -> "tuple[np.ndarray, np.ndarray, csc_matrix]":
        """Order of the columns, by the pattern alone; places of the numbers in that order; and a matrix of them."""
        import scipy.sparse as sp
        from scipy.sparse.linalg import splu

        sample = np.random.default_rng(5).uniform(0.5, 1.0, len(self.rows))
        sample[self.rows == self.columns] += 4.0 * self.size
        matrix = sp.csc_matrix((sample, (self.rows, self.columns)), shape=(self.size, self.size))
        try:
            order = splu(matrix, permc_spec="COLAMD").perm_c
        except RuntimeError:
            order = np.arange(self.size)
        if self.blocks:
            # The block that is solved last has its columns to itself: eliminated first, and so on backwards, every
            # block finds its pivots in its own rows, and they say which way round it is.
            block = np.empty(self.size, dtype=int)
            for k, (_, columns) in enumerate(self.blocks):
                block[columns] = k
                if len(columns) <= SMALL:
                    order[columns] = np.arange(len(columns))
            order = np.argsort(np.lexsort((order, -block)))
        key = order[self.columns].astype(np.int64) * self.size + self.rows
        into = np.argsort(key, kind="stable")
        starts = np.concatenate([[0], np.cumsum(np.bincount(order[self.columns], minlength=self.size))])
        indices, size = self.rows[into].astype(np.int32), (self.size, self.size)
        return order, into, sp.csc_matrix((sample, indices, starts.astype(np.int32)), shape=size)

    def factorise(self, data: np.ndarray) -> "SuperLU | None":
        """Factorise the matrix with these numbers; None if it is singular."""
        from scipy.sparse.linalg import splu

        one_thread("scipy")
        if not np.isfinite(data).all():
            return None
        _, into, matrix = self._layout
        matrix.data = data[into]
        try:
            # Mechanisms have no dense columns to gather into panels: width one is several times faster.
            factors = splu(matrix, permc_spec="NATURAL", panel_size=1, relax=1)
        except RuntimeError:  # exactly singular
            return None
        self.stored = factors.nnz
        return factors

    def _factorise_once(self, data: np.ndarray) -> "SuperLU | None":
        """Factorise for traced code, which asks for several solves with one matrix one after the other."""
        data = np.asarray(data)
        for known, factors in self._last:
            if np.array_equal(known, data):
                return factors
        self._last = [(data.copy(), self.factorise(data)), *self._last[: _KEPT - 1]]
        return self._last[0][1]

    def solve_by(self, factors: "SuperLU | None", right: np.ndarray, transposed: bool = False) -> np.ndarray:
        """Solve for right-hand sides ``(size, k)`` by factors; not a number where the matrix is singular."""
        if factors is None or not np.all(np.isfinite(right)):
            return np.full(right.shape, np.nan)
        order = self._layout[0]
        if transposed:
            return factors.solve(right[np.argsort(order)], trans="T")
        return factors.solve(right)[order]

    def pivots(self, factors: "SuperLU | None") -> tuple[np.ndarray, np.ndarray]:
        """Return the pivot of every column, and the sign of each diagonal block's determinant; 0 if singular."""
        if factors is None:
            return np.zeros(self.size), np.zeros(self._block.count)
        at = factors.perm_c[self._layout[0]]  # where each column went
        pivots = factors.U.diagonal()[at]
        negative = np.bincount(self._block.of_column, pivots < 0.0, self._block.count)
        signs = 1.0 - 2.0 * ((negative + self._exchanges(factors.perm_r, at)) % 2)
        vanish = np.bincount(self._block.of_column, pivots == 0.0, self._block.count) > 0
        return np.abs(pivots), np.where(vanish | np.isnan(signs), 0.0, signs)

    def _exchanges(self, order: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Count in each block how often rows change places for the pivots; not finite if pivots are in other blocks."""
        if self._places is None or not np.array_equal(self._places[0], order):
            from scipy.sparse import csgraph, csr_matrix

            block, row_of = self._block, np.argsort(order)[at]
            to = block.place_of_row[row_of[block.columns]]
            graph = csr_matrix((np.ones(self.size), (np.arange(self.size), to)), shape=(self.size, self.size))
            first = np.unique(csgraph.connected_components(graph, directed=False)[1], return_index=True)[1]
            own = block.of_column[block.columns]
            changes = np.bincount(own, minlength=block.count) - np.bincount(own[first], minlength=block.count)
            across = own != own[to]  # which happens in a singular matrix only
            self._places = order.copy(), np.where(np.bincount(own, across, block.count) > 0, np.nan, changes)
        return self._places[1]

    @functools.cached_property
    def _block(self) -> _Blocks:
        every = np.arange(self.size)
        blocks = self.blocks or ((every, every),)
        rows, columns = (np.concatenate([b[k] for b in blocks] or [every]) for k in (0, 1))
        of_column, place_of_row = np.empty(self.size, int), np.empty(self.size, int)
        of_column[columns] = np.repeat(np.arange(len(blocks)), [len(c) for _, c in blocks])
        place_of_row[rows] = every
        return _Blocks(len(blocks), columns, of_column, place_of_row)

    # -- in traced code -----------------------------------------------------------------------------------------

    def solve(self, data: Array, right: Array, transposed: bool = False) -> Array:
        """Solve for traced right-hand sides ``(size, k)`` and numbers; mapped, it goes one by one."""

        def answer(data: np.ndarray, right: np.ndarray) -> np.ndarray:
            return self.solve_by(self._factorise_once(data), np.asarray(right, dtype=float), transposed)

        return self._ask(jax.ShapeDtypeStruct(right.shape, right.dtype), answer, data, right)

    def evaluate(self, data: Array) -> tuple[Array, Array]:
        """Return the `pivots` of traced numbers."""
        like = tuple(jax.ShapeDtypeStruct(s, data.dtype) for s in ((self.size,), (self._block.count,)))
        return self._ask(like, lambda x: self.pivots(self._factorise_once(x)), data)

    def _ask(self, like: PyTree, f: Callable, *given: Array) -> PyTree:
        from jaxnc.solvers.traced import ask_host  # with what only traced code needs

        def nothing(*_: np.ndarray) -> Any:
            return jax.tree.map(lambda a: np.full(a.shape, np.nan, a.dtype), like)

        return ask_host("solved by sparse LU", like, f, *given, given_up=nothing, large=True)


@dataclass(frozen=True)
class Nullity:
    """The null space of a matrix.

    Inverse iteration on a block of directions, by sparse LU of [I A; Aᵀ -δ], leaves those of the smallest singular
    values. Their number below a threshold is the nullity. Where a value lies so close to the threshold that the next
    digit of the drawing would decide, that is said instead of a number.
    """

    count: int  # its dimension
    basis: np.ndarray  # orthonormal directions that span it, (columns, count)
    sure: bool  # whether no singular value is too close to the threshold
    smallest: np.ndarray  # the smallest singular values found, relative to the largest, ascending


def shape_of(matrix: "csc_matrix") -> tuple[int, int]:
    """Rows and columns of a matrix."""
    m, n = matrix.shape  # pyright: ignore[reportGeneralTypeIssues] (SciPy's own annotations forget it)
    return m, n


def matrix_of(data: np.ndarray, rows: np.ndarray, columns: np.ndarray, size: tuple[int, int]) -> "csc_matrix":
    """Make a sparse matrix of a size from its numbers and their places."""
    from scipy.sparse import csc_matrix

    return csc_matrix((np.asarray(data), (rows, columns)), shape=size)


def _factorise_bordered(matrix: "csc_matrix", scale: float, damping: float) -> "SuperLU":
    """Factorise [scale I, A; Aᵀ, -damping I]."""
    import scipy.sparse as sp
    from scipy.sparse.linalg import splu

    m, n = shape_of(matrix)
    whole = sp.bmat([[scale * sp.identity(m), matrix], [matrix.T, -damping * sp.identity(n)]], format="csc")
    return splu(whole, permc_spec="COLAMD", panel_size=1, relax=1)


def _damped_factors(matrix: "csc_matrix", size: float) -> "SuperLU":
    """Factorise [I A; Aᵀ -δ], by the smallest damping that keeps it regular; the largest singular value is `size`."""
    # Scaled like the matrix, the identity keeps small singular values from drowning in it.
    scale = size if size > 0 else 1.0
    dampings = [(shift * size) ** 2 / scale + 1e-300 for shift in _SHIFTS]
    for damping in dampings[:-1]:
        with contextlib.suppress(RuntimeError):  # a pivot has cancelled to the last bit
            return _factorise_bordered(matrix, scale, damping)
    return _factorise_bordered(matrix, scale, dampings[-1])


def _nullity(matrix: "csc_matrix") -> Nullity:
    """Find the directions that a matrix with as many rows as columns, or more, hardly stretches."""
    m, n = shape_of(matrix)
    size, rng, width = _largest_singular_value(matrix), np.random.default_rng(11), min(n, 8)
    factors = _damped_factors(matrix, size)
    x = np.linalg.qr(rng.standard_normal((n, width)))[0]
    while True:
        values = np.zeros(0)
        for _ in range(8):
            y = factors.solve(np.concatenate([np.zeros((m, x.shape[1])), x]))[m:]  # (AᵀA + δ)⁻¹ x, but for a factor
            x = np.linalg.qr(y / np.maximum(np.abs(y).max(axis=0), 1e-300))[0]
            _, values, turn = np.linalg.svd(matrix @ x, full_matrices=False)
            x = x @ turn.T
        smallest = np.zeros(width)  # with fewer rows than directions the rest is not stretched at all
        smallest[width - len(values) :] = values[::-1] / max(size, 1e-300)
        count = int(np.sum(smallest < RANK))
        # a mechanism with 400 freedoms is none of the large ones meant here
        if count < width or width == n or width >= 400:
            break
        grown = min(n, 4 * width)
        x = np.linalg.qr(np.concatenate([x, rng.standard_normal((n, grown - width))], axis=1))[0]
        width = grown
    doubtful = (smallest > RANK / _DOUBT) & (smallest < RANK * _DOUBT)
    sure = not doubtful.any() and (count < width or width == n)
    return Nullity(count, x[:, ::-1][:, :count], sure, smallest)


def _largest_singular_value(matrix: "csc_matrix") -> float:
    """Estimate the largest singular value, to a per cent."""
    x = np.random.default_rng(2).standard_normal(shape_of(matrix)[1])
    size = 0.0
    for _ in range(40):
        norm = np.linalg.norm(x)
        if norm == 0:
            break
        y = matrix @ (x / norm)
        size, x = float(np.linalg.norm(y)), matrix.T @ y
    return size


def null_directions(matrix: "csc_matrix") -> Nullity:
    """Find directions that a matrix does not see; with fewer rows than columns, dependent rows instead."""
    m, n = shape_of(matrix)
    if not min(m, n) or not matrix.nnz:
        return Nullity(min(m, n), np.eye(min(m, n)), True, np.zeros(min(m, n)))
    return _nullity(matrix if m >= n else matrix.T.tocsc())


def dependencies(matrix: "csc_matrix") -> np.ndarray:
    """Find orthonormal combinations of rows that vanish, ``(rows, count)``."""
    if not shape_of(matrix)[0] or not matrix.nnz:
        return np.eye(shape_of(matrix)[0])
    return _nullity(matrix.T.tocsc()).basis


def null_part(matrix: "csc_matrix", direction: np.ndarray) -> np.ndarray:
    """Return the part of a direction ``(columns,)`` that a matrix does not see."""
    m, n = shape_of(matrix)
    factors = _factorise_bordered(matrix.T / max(_largest_singular_value(matrix), 1e-300), 1.0, 1e-14)
    x = factors.solve(np.concatenate([direction, np.zeros(m)]))[:n]
    return factors.solve(np.concatenate([x, np.zeros(m)]))[:n]
