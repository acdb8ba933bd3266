"""Sparse LU of any large matrix, by SuperLU on the host: what no block elimination fits.

The order of the columns is found once for a pattern; partial pivoting is done anew for every matrix. The last few
factorisations are kept, so that several solves with one matrix cost one. SciPy's sparse matrices, which take longer to
import than a small mechanism to sweep, are imported where a large one needs them.
"""

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.threads import one_thread
from jaxnc.types import Array

if TYPE_CHECKING:
    from scipy.sparse.linalg import SuperLU

_KEPT = 2
_PIECE = 8192  # numbers, 64 KB


@dataclass(eq=False)
class Factoriser:
    """Factorises square matrices of one pattern.

    Attributes:
        size: rows and columns.
        rows: row of every number.
        columns: column of every number.
        blocks: rows and columns of the diagonal blocks of its block-triangular form, in an order in which they can be
            solved; empty if none are known.
        stored: numbers in the factors of the last matrix.
    """

    size: int
    rows: np.ndarray
    columns: np.ndarray
    blocks: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
    stored: int = 0
    _order: np.ndarray | None = None
    _into: np.ndarray | None = None
    _shape: tuple[np.ndarray, np.ndarray] | None = None
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
            order = np.argsort(np.lexsort((order, -block)))
        key = order[self.columns].astype(np.int64) * self.size + self.rows
        self._into = np.argsort(key, kind="stable")
        starts = np.concatenate([[0], np.cumsum(np.bincount(order[self.columns], minlength=self.size))])
        self._shape = (self.rows[self._into].astype(np.int32), starts.astype(np.int32))
        self._order = order

    def factorise(self, data: np.ndarray) -> "SuperLU | None":
        """Factors of the matrix with these numbers, None if it is singular."""
        import scipy.sparse as sp
        from scipy.sparse.linalg import splu

        one_thread("scipy")
        data = np.asarray(data)
        for known, factors in self._last:
            if np.array_equal(known, data):
                return factors
        if self._order is None:
            self._prepare()
        assert self._into is not None and self._shape is not None
        factors = None
        if np.all(np.isfinite(data)):
            indices, starts = self._shape
            matrix = sp.csc_matrix((data[self._into], indices, starts), shape=(self.size, self.size))
            try:
                # Mechanisms have no dense columns to gather into panels: width one is several times faster.
                factors = splu(matrix, permc_spec="NATURAL", panel_size=1, relax=1)
                self.stored = factors.nnz
            except RuntimeError:  # exactly singular
                factors = None
        self._last = [(data.copy(), factors), *self._last[: _KEPT - 1]]
        return factors

    def solved(self, data: np.ndarray, right: np.ndarray, transposed: bool = False) -> np.ndarray:
        """Solve for right-hand sides ``(size, k)``; not a number where the matrix is singular."""
        right = np.asarray(right, dtype=float)
        factors = self.factorise(data)
        if factors is None or not np.all(np.isfinite(right)):
            return np.full(right.shape, np.nan)
        assert self._order is not None
        if transposed:
            return factors.solve(right[np.argsort(self._order)], trans="T")
        return factors.solve(right)[self._order]

    def pivots(self, data: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pivot of every column, sign of each diagonal block's determinant, and of the whole one's; 0 if singular."""
        factors = self.factorise(data)
        if factors is None:
            return np.zeros(self.size), np.zeros(len(self.blocks)), np.zeros(())
        assert self._order is not None
        at = factors.perm_c[self._order]  # where each column went
        pivots = factors.U.diagonal()[at]
        row_of = np.argsort(factors.perm_r)[at]
        signs = np.array([_sign(rows, columns, row_of, pivots) for rows, columns in self.blocks])
        every = np.arange(self.size)
        return np.abs(pivots), signs, np.array(_sign(every, every, row_of, pivots))

    # -- in traced code -----------------------------------------------------------------------------------------

    def solve(self, data: Array, right: Array, transposed: bool = False) -> Array:
        """`solved` for traced values; mapped, it goes one by one."""
        shape = jax.ShapeDtypeStruct(right.shape, right.dtype)
        return _on_host(functools.partial(self.solved, transposed=transposed), shape, data, right)

    def evaluate(self, data: Array) -> tuple[Array, Array, Array]:
        """`pivots` for traced values."""
        shapes = tuple(jax.ShapeDtypeStruct(s, data.dtype) for s in ((self.size,), (len(self.blocks),), ()))
        return _on_host(self.pivots, shapes, data)


def _on_host(f: Callable, shapes: Any, *arrays: Array) -> Any:
    """Call a function of NumPy arrays from traced code; mapped, it goes one by one.

    The arrays are handed over in pieces. What is larger than 100 KB JAX copies in a thread of the pool that the call
    itself waits in: on a machine with one core it would wait for ever.
    """
    pieces = [jnp.split(a.reshape(-1), list(range(_PIECE, a.size, _PIECE))) for a in arrays]

    given, counts = [a.shape for a in arrays], [len(some) for some in pieces]

    def whole(*parts: Any) -> Any:
        left = iter(parts)
        together = [np.concatenate([np.asarray(next(left)) for _ in range(n)]) for n in counts]
        return f(*(x.reshape(shape) for x, shape in zip(together, given, strict=True)))

    return jax.pure_callback(whole, shapes, *itertools.chain(*pieces), vmap_method="sequential")


def _sign(rows: np.ndarray, columns: np.ndarray, row_of: np.ndarray, pivots: np.ndarray) -> float:
    """Sign of a block's determinant: that of its pivots times that of the permutation from its columns to its rows."""
    from scipy.sparse import csgraph, csr_matrix

    sign = float(np.prod(np.sign(pivots[columns])))
    order = np.argsort(rows)
    place = order[np.minimum(np.searchsorted(rows, row_of[columns], sorter=order), len(rows) - 1)]
    if len(np.unique(place)) < len(rows):
        return 0.0  # pivots were taken across blocks, which happens in a singular matrix only
    graph = csr_matrix((np.ones(len(place)), (np.arange(len(place)), place)))
    cycles = csgraph.connected_components(graph, directed=False)[0]
    return sign * (-1.0) ** (len(place) - cycles)
