"""Factorisations of small dense matrices: LAPACK for a single one, loops of our own for a batch.

On a CPU, XLA runs independent operations on a pool of threads, and jaxlib's batched LAPACK kernels wait inside that
pool for work that they hand to it: two of them at once on a machine with two cores wait for ever. Batches therefore
never reach LAPACK. Nothing here is differentiated; derivatives are made in `jaxnc.solvers.linear`.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap
from jaxtyping import Int

from jaxnc.types import Array, Float


def _routed(single: Callable, batched: Callable) -> Callable:
    """A function that is `single` by itself and `batched`, mapped, as soon as it is mapped."""

    @custom_vmap
    def route(*arguments):
        return single(*arguments)

    @route.def_vmap
    def mapped(size, which, *arguments):
        full = [a if has else jnp.broadcast_to(a, (size, *a.shape)) for a, has in zip(arguments, which, strict=True)]
        out = jax.vmap(batched)(*full)
        return out, jax.tree.map(lambda _: True, out)

    return route


def _swap(x: Array, i: Array, j: Array) -> Array:
    """Exchange two entries (rows) by masks, which vectorise over a batch where a gather would not."""
    rows = jnp.arange(x.shape[0])
    at_i, at_j = (rows == i), (rows == j)
    shape = (-1,) + (1,) * (x.ndim - 1)
    row_i = jnp.sum(jnp.where(at_i.reshape(shape), x, 0), axis=0)
    row_j = jnp.sum(jnp.where(at_j.reshape(shape), x, 0), axis=0)
    x = jnp.where(at_i.reshape(shape), row_j, x)
    return jnp.where(at_j.reshape(shape) & (i != j), row_i, x)


def _lu(matrix: Array) -> tuple[Array, Array, Array]:
    n = matrix.shape[0]
    rows = jnp.arange(n)

    def step(k, state):
        a, order, sign = state
        column = jnp.sum(jnp.where(rows[None] == k, a, 0.0), axis=1)
        pivot = jnp.argmax(jnp.where(rows >= k, jnp.abs(column), -1.0))
        a, order = _swap(a, k, pivot), _swap(order, k, pivot)
        sign = jnp.where(pivot == k, sign, -sign)
        column = jnp.sum(jnp.where(rows[None] == k, a, 0.0), axis=1)
        row = jnp.sum(jnp.where(rows[:, None] == k, a, 0.0), axis=0)
        factor = jnp.where(rows > k, column / jnp.sum(jnp.where(rows == k, column, 0.0)), 0.0)
        a = a - factor[:, None] * jnp.where(rows > k, row, 0.0)[None]
        return jnp.where((rows[:, None] > k) & (rows[None] == k), factor[:, None], a), order, sign

    a, order, sign = lax.fori_loop(0, n, step, (matrix, rows, jnp.ones(())))
    return a, order, sign


def _lu_single(matrix: Array) -> tuple[Array, Array, Array]:
    packed, pivots, order = lax.linalg.lu(matrix)
    swaps = jnp.sum(pivots != jnp.arange(matrix.shape[0], dtype=pivots.dtype))
    return packed, order, jnp.where(swaps % 2 == 0, 1.0, -1.0)


_routed_lu = _routed(_lu_single, lambda a: (lambda out: (out[0], out[1].astype(jnp.int32), out[2]))(_lu(a)))


def lu(matrix: Float[Array, "n n"]) -> tuple[Float[Array, "n n"], Int[Array, " n"], Array]:
    """LU factorisation with partial pivoting: packed factors, order of the rows, sign of the permutation."""
    return _routed_lu(matrix)


def _substitute(triangle: Array, right: Array, lower: bool, unit: bool) -> Array:
    """Solve a triangular system ``(n, n)`` for right-hand sides ``(n, k)``, one unknown after the other."""
    n = triangle.shape[0]
    rows = jnp.arange(n)

    def step(i, x):
        k = i if lower else n - 1 - i
        column = jnp.sum(jnp.where(rows[None] == k, triangle, 0.0), axis=1)
        value = jnp.sum(jnp.where(rows[:, None] == k, x, 0.0), axis=0)
        if not unit:
            value = value / jnp.sum(jnp.where(rows == k, column, 0.0))
        beyond = rows > k if lower else rows < k
        x = x - jnp.where(beyond, column, 0.0)[:, None] * value[None]
        return jnp.where(rows[:, None] == k, value[None], x)

    return lax.fori_loop(0, n, step, right)


def _triangular_single(triangle: Array, right: Array, lower: bool, unit: bool) -> Array:
    return lax.linalg.triangular_solve(triangle, right, left_side=True, lower=lower, unit_diagonal=unit)


_TRIANGULAR = {
    (lower, unit): _routed(
        lambda a, b, lower=lower, unit=unit: _triangular_single(a, b, lower, unit),
        lambda a, b, lower=lower, unit=unit: _substitute(a, b, lower, unit),
    )
    for lower in (False, True)
    for unit in (False, True)
}


def triangular(
    matrix: Float[Array, "n n"], right: Float[Array, "n k"], lower: bool, transpose: bool = False, unit: bool = False
) -> Float[Array, "n k"]:
    """Solve with one triangle of a matrix, or its transpose."""
    if transpose:
        matrix, lower = matrix.T, not lower
    return _TRIANGULAR[lower, unit](matrix, right)


def lu_solve(factors, right: Float[Array, "n k"], transpose: bool = False) -> Float[Array, "n k"]:
    """Solve with an LU factorisation, or with the transposed matrix."""
    packed, order, _ = factors
    if not transpose:
        x = triangular(packed, right[order], lower=True, unit=True)
        return triangular(packed, x, lower=False)
    x = triangular(packed, right, lower=False, transpose=True)
    x = triangular(packed, x, lower=True, transpose=True, unit=True)
    return x[jnp.argsort(order)]


def _qr(matrix: Array) -> tuple[Array, Array]:
    """Gram-Schmidt, every column orthogonalised twice, which is as good as Householder's reflections."""
    m, n = matrix.shape
    columns = jnp.arange(n)

    def step(k, state):
        q, r = state
        v = jnp.sum(jnp.where(columns[None] == k, matrix, 0.0), axis=1)
        first = jnp.sum(q * v[:, None], axis=0)
        v = v - jnp.sum(q * first[None], axis=1)
        second = jnp.sum(q * v[:, None], axis=0)
        v = v - jnp.sum(q * second[None], axis=1)
        size = jnp.sqrt(jnp.sum(v * v))
        v = v / jnp.where(size > 0, size, 1.0)
        column = first + second + jnp.where(columns == k, size, 0.0)
        return (
            jnp.where(columns[None] == k, v[:, None], q),
            jnp.where(columns[None] == k, column[:, None], r),
        )

    return lax.fori_loop(0, n, step, (jnp.zeros((m, n)), jnp.zeros((n, n))))


_routed_qr = _routed(lambda a: tuple(jnp.linalg.qr(a)), _qr)


def qr(matrix: Float[Array, "m n"]) -> tuple[Float[Array, "m n"], Float[Array, "n n"]]:
    """QR factorisation of a tall matrix: orthonormal columns, upper triangle."""
    return _routed_qr(matrix)


def cholesky_solve(matrix: Float[Array, "n n"], right: Float[Array, "n k"]) -> Float[Array, "n k"]:
    """Solve with a symmetric positive definite matrix; not finite if it is not."""
    return _routed_cholesky(matrix, right)


def _cholesky_single(matrix: Array, right: Array) -> Array:
    factor = lax.linalg.cholesky(matrix, symmetrize_input=False)
    x = _triangular_single(factor, right, True, False)
    return lax.linalg.triangular_solve(factor, x, left_side=True, lower=True, transpose_a=True)


def _cholesky_batched(matrix: Array, right: Array) -> Array:
    n = matrix.shape[0]
    rows = jnp.arange(n)

    def step(k, a):
        # Of the symmetric matrix with its right-hand sides: elimination without exchanges.
        row = jnp.sum(jnp.where(rows[:, None] == k, a, 0.0), axis=0)
        pivot = row[:n] @ (rows == k).astype(row.dtype)
        pivot = jnp.where(pivot > 0, pivot, jnp.nan)
        column = jnp.sum(jnp.where(rows[None] == k, a[:, :n], 0.0), axis=1)
        factor = jnp.where(rows == k, 0.0, column / pivot)
        a = a - factor[:, None] * row[None]
        return a

    reduced = lax.fori_loop(0, n, step, jnp.concatenate([matrix, right], axis=1))
    return reduced[:, n:] / jnp.diagonal(reduced[:, :n])[:, None]


_routed_cholesky = _routed(_cholesky_single, _cholesky_batched)


def independent_columns(matrix: Float[Array, "n m"]) -> Int[Array, " n"]:
    """A well-conditioned choice of n columns, by Gram-Schmidt that always takes the longest column left."""
    n, m = matrix.shape
    columns = jnp.arange(m)

    def step(k, state):
        a, left, chosen = state
        square = jnp.where(left, jnp.sum(a * a, axis=0), -1.0)
        best = jnp.argmax(square)
        at = columns == best
        v = jnp.sum(jnp.where(at[None], a, 0.0), axis=1)
        size = jnp.sqrt(jnp.sum(v * v))
        v = v / jnp.where(size > 0, size, 1.0)
        a = a - v[:, None] * jnp.sum(v[:, None] * a, axis=0)[None]
        return a, left & ~at, jnp.where(jnp.arange(n) == k, best, chosen)

    start = (matrix, jnp.ones(m, bool), jnp.zeros(n, columns.dtype))
    return jnp.sort(lax.fori_loop(0, n, step, start)[2])
