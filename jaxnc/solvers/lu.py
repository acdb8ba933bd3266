"""Sparse LU of large matrices, by SuperLU on the host.

The order of the columns is found once for a pattern; partial pivoting is done anew for every matrix. The last few
factorisations are kept, so that several solves with one matrix cost one. SciPy's sparse matrices, which take longer to
import than a small mechanism to sweep, are imported where a large one needs them.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np

from jaxnc.solvers.answers import ask_host
from jaxnc.threads import one_thread
from jaxnc.types import Array

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import SuperLU

SMALL = 4  # columns of a diagonal block that are eliminated in the order in which the block has them
_KEPT = 2


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
    _order: np.ndarray | None = None
    _into: np.ndarray | None = None
    _matrix: "csc_matrix | None" = None
    _places: tuple[np.ndarray, np.ndarray] | None = None
    _last: list[tuple[np.ndarray, "SuperLU | None"]] = field(default_factory=list)

    def _prepare(self) -> None:
        """Order the columns by the pattern alone, and lay the numbers out in that order."""
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
        self._into = np.argsort(key, kind="stable")
        starts = np.concatenate([[0], np.cumsum(np.bincount(order[self.columns], minlength=self.size))])
        indices, size = self.rows[self._into].astype(np.int32), (self.size, self.size)
        self._matrix = sp.csc_matrix((sample, indices, starts.astype(np.int32)), shape=size)
        self._order = order

    def factorise(self, data: np.ndarray) -> "SuperLU | None":
        """Factors of the matrix with these numbers, None if it is singular."""
        from scipy.sparse.linalg import splu

        one_thread("scipy")
        if self._order is None:
            self._prepare()
        assert self._into is not None and self._matrix is not None
        if not np.isfinite(data).all():
            return None
        self._matrix.data = data[self._into]
        try:
            # Mechanisms have no dense columns to gather into panels: width one is several times faster.
            factors = splu(self._matrix, permc_spec="NATURAL", panel_size=1, relax=1)
        except RuntimeError:  # exactly singular
            return None
        self.stored = factors.nnz
        return factors

    def _kept(self, data: np.ndarray) -> "SuperLU | None":
        """The same for traced code, which asks for several solves with one matrix one after the other."""
        data = np.asarray(data)
        for known, factors in self._last:
            if np.array_equal(known, data):
                return factors
        self._last = [(data.copy(), self.factorise(data)), *self._last[: _KEPT - 1]]
        return self._last[0][1]

    def solved(self, data: np.ndarray, right: np.ndarray, transposed: bool = False) -> np.ndarray:
        """Solve for right-hand sides ``(size, k)``; not a number where the matrix is singular."""
        return self.solved_by(self._kept(data), np.asarray(right, dtype=float), transposed)

    def solved_by(self, factors: "SuperLU | None", right: np.ndarray, transposed: bool = False) -> np.ndarray:
        """The same by factors that `factorise` has made."""
        if factors is None or not np.all(np.isfinite(right)):
            return np.full(right.shape, np.nan)
        assert self._order is not None
        if transposed:
            return factors.solve(right[np.argsort(self._order)], trans="T")
        return factors.solve(right)[self._order]

    def pivots(self, factors: "SuperLU | None") -> tuple[np.ndarray, np.ndarray]:
        """Pivot of every column, and sign of each diagonal block's determinant; 0 if singular."""
        if factors is None:
            return np.zeros(self.size), np.zeros(self._block.count)
        assert self._order is not None
        at = factors.perm_c[self._order]  # where each column went
        pivots = factors.U.diagonal()[at]
        negative = np.bincount(self._block.of_column, pivots < 0.0, self._block.count)
        signs = 1.0 - 2.0 * ((negative + self._turned(factors.perm_r, at)) % 2)
        vanish = np.bincount(self._block.of_column, pivots == 0.0, self._block.count) > 0
        return np.abs(pivots), np.where(vanish | np.isnan(signs), 0.0, signs)

    def _turned(self, order: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Of each block, how many rows change places where its columns take their pivots; not finite if in others."""
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
    def _block(self) -> "_Blocks":
        every = np.arange(self.size)
        blocks = self.blocks or ((every, every),)
        rows, columns = (np.concatenate([b[k] for b in blocks] or [every]) for k in (0, 1))
        of_column, place_of_row = np.empty(self.size, int), np.empty(self.size, int)
        of_column[columns] = np.repeat(np.arange(len(blocks)), [len(c) for _, c in blocks])
        place_of_row[rows] = every
        return _Blocks(len(blocks), columns, of_column, place_of_row)

    # -- in traced code -----------------------------------------------------------------------------------------

    def solve(self, data: Array, right: Array, transposed: bool = False) -> Array:
        """`solved` for traced values; mapped, it goes one by one."""
        like = jax.ShapeDtypeStruct(right.shape, right.dtype)
        return self._ask(like, functools.partial(self.solved, transposed=transposed), data, right)

    def evaluate(self, data: Array) -> tuple[Array, Array]:
        """`pivots` for traced values."""
        like = tuple(jax.ShapeDtypeStruct(s, data.dtype) for s in ((self.size,), (self._block.count,)))
        return self._ask(like, lambda x: self.pivots(self._kept(x)), data)

    def _ask(self, like: Any, f: Callable[..., Any], *given: Array) -> Any:
        def nothing(*_: np.ndarray) -> Any:
            return jax.tree.map(lambda a: np.full(a.shape, np.nan, a.dtype), like)

        return ask_host("solved by sparse LU", like, f, *given, given_up=nothing, remedy="")
