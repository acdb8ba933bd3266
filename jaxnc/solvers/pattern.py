"""Where the non-zeros of a large Jacobian are: compressed by columns, gathered from the entries of the constraints."""

import dataclasses
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from jaxnc.records import record, static
from jaxnc.types import Array, Float

_WIDE = 4.0  # times the non-zeros: so much padding is cheaper than adding up one by one


@record
class Columns:
    """The derivatives with respect to the known coordinates; ``columns @ way`` is all that is done with them."""

    values: Float[Array, " e"]  # its entries, (e,)
    rows: np.ndarray  # row of each
    places: np.ndarray  # column of each
    count: int = static()  # number of rows

    def __matmul__(self, way: Array) -> Array:
        return jnp.zeros(self.count).at[self.rows].add(self.values * way[self.places])


@dataclass(frozen=True, eq=False)
class Pattern:
    """Static structure of a sparse Jacobian with m rows and n unknown columns; its numbers are a vector ``(nnz,)``."""

    shape: tuple[int, int]  # m and n
    rows: np.ndarray  # row of every number, column by column
    columns: np.ndarray  # column of every number, ascending
    # Index arrays (nnz,) into the entries (with a zero appended), whose gathered sum is the numbers.
    gathers: tuple[np.ndarray, ...]
    # Places in the entries, rows and columns of the derivatives with respect to known coordinates.
    known: tuple[np.ndarray, np.ndarray, np.ndarray]
    # Per row, which numbers and which columns, (m, most) each, padded; None where rows are too unequal.
    wide: tuple[np.ndarray, np.ndarray] | None

    @property
    def count(self) -> int:
        """Numbers stored."""
        return len(self.rows)

    def numbers(self, entries: Array) -> tuple[Array, Columns]:
        """The non-zeros ``(nnz,)`` and the columns of the known coordinates, from the entries of all constraints."""
        padded = jnp.concatenate([entries, jnp.zeros(1)])
        data = sum((padded[g] for g in self.gathers[1:]), padded[self.gathers[0]])
        where, rows, columns = self.known
        return data, Columns(entries[where], rows, columns, self.shape[0])

    def times(self, data: Array, x: Array) -> Array:
        """Product with a vector, ``(n,)`` to ``(m,)``; differentiable and transposable."""
        if self.wide is None:
            return jnp.zeros(self.shape[0]).at[self.rows].add(data * x[self.columns])
        padded = jnp.concatenate([data, jnp.zeros(1)])
        numbers, columns = self.wide
        return jnp.sum(padded[numbers] * x[columns], axis=1)

    def transposed(self, data: Array, y: Array) -> Array:
        """Product of the transpose with a vector, ``(m,)`` to ``(n,)``."""
        return jnp.zeros(self.shape[1]).at[self.columns].add(data * y[self.rows])

    def place(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Where the numbers at rows and columns are kept, `count` where there is none."""
        key = self.columns.astype(np.int64) * self.shape[0] + self.rows
        wanted = columns.astype(np.int64) * self.shape[0] + rows
        at = np.minimum(np.searchsorted(key, wanted), max(self.count - 1, 0))
        return np.where(key[at] == wanted, at, self.count) if self.count else np.zeros(wanted.shape, int)


def pattern(where: np.ndarray, r: np.ndarray, c: np.ndarray, shape: tuple[int, int], pad: int) -> Pattern:
    """Compress a list of places in the entries; those named twice are added up.

    Columns from n on belong to known coordinates; `pad` is the index of the zero behind the entries.
    """
    m, n = shape
    inner = c < n
    known = (where[~inner], r[~inner], c[~inner] - n)
    where, key = where[inner], c[inner].astype(np.int64) * m + r[inner]
    found = np.unique(key)
    gathers, left = [], np.arange(len(where))
    while len(left) or not gathers:
        _, first = np.unique(key[left], return_index=True)
        index = np.full(len(found), pad, dtype=np.int64)
        index[np.searchsorted(found, key[left[first]])] = where[left[first]]
        gathers.append(index)
        left = np.delete(left, first)
    columns, rows = np.divmod(found, max(m, 1))
    return dataclasses.replace(Pattern(shape, rows, columns, tuple(gathers), known, None), wide=_wide(rows, columns, m))


def _wide(rows: np.ndarray, columns: np.ndarray, m: int) -> tuple[np.ndarray, np.ndarray] | None:
    lengths = np.bincount(rows, minlength=m)
    most = int(lengths.max(initial=0))
    if not len(rows) or most * m > _WIDE * len(rows):
        return None
    order = np.argsort(rows, kind="stable")
    slot = np.arange(len(rows)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    numbers, at = np.full((m, most), len(rows)), np.zeros((m, most), dtype=np.int64)
    numbers[rows[order], slot], at[rows[order], slot] = order, columns[order]
    return numbers, at
