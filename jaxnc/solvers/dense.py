"""Factorisations of small dense matrices: LAPACK for a single one, loops of our own for a batch.

On a CPU, XLA runs independent operations on a pool of threads, and jaxlib's batched LAPACK kernels wait inside that
pool for work that they hand to it: two of them at once on a machine with two cores wait for ever. Batches therefore
never reach LAPACK. Everything that is needed of a factorisation comes out of one loop, because what is felt of these
loops is the time that it takes to compile them. Nothing here is differentiated; derivatives are made in
`jaxnc.solvers.linear`.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap

from jaxnc.system.precision import numbers
from jaxnc.threads import one_thread
from jaxnc.types import Array, Float, Int


def _routed(single: Callable, batched: Callable | None = None) -> Callable:
    """A function that is `single` by itself and `batched`, mapped, as soon as it is mapped; one by one without it."""

    @custom_vmap
    def route(*arguments):
        one_thread("scipy")
        return single(*arguments)

    @route.def_vmap
    def mapped(size, which, *arguments):
        with numbers(arguments[0]):
            return rule(size, which, arguments)

    def rule(size, which, arguments):
        full = [a if has else jnp.broadcast_to(a, (size, *a.shape)) for a, has in zip(arguments, which, strict=True)]
        out = jax.vmap(batched)(*full) if batched else lax.map(lambda one: route(*one), full)
        return out, jax.tree.map(lambda _: True, out)

    return route


def _entry(x: Array, at: Array, axis: int) -> Array:
    """A row (column) by a mask, which vectorises over a batch where a gather would not."""
    return jnp.sum(jnp.where(at[:, None] if axis == 0 else at[None], x, 0.0), axis=axis)


def _eliminate_batched(matrix: Array, right: Array) -> tuple[Array, Array, Array]:
    n = matrix.shape[0]
    rows, columns = jnp.arange(n), jnp.arange(n + right.shape[1])

    def step(k, state):
        a, pivots, sign = state
        column = _entry(a, columns == k, 1)
        best = jnp.argmax(jnp.where(rows >= k, jnp.abs(column), -1.0))
        row, other = _entry(a, rows == best, 0), _entry(a, rows == k, 0)
        a = jnp.where((rows == best)[:, None], other, a)
        a = jnp.where((rows == k)[:, None], row, a)
        column = jnp.where(rows == best, jnp.sum(jnp.where(rows == k, column, 0.0)), column)
        pivot = jnp.sum(jnp.where(columns == k, row, 0.0))
        factor = jnp.where(rows == k, 0.0, column / pivot)
        sign = jnp.where(best == k, sign, -sign)
        return a - factor[:, None] * row[None], jnp.where(rows == k, pivot, pivots), sign

    start = (jnp.concatenate([matrix, right], axis=1), jnp.zeros(n), jnp.ones(()))
    a, pivots, sign = lax.fori_loop(0, n, step, start)
    return a[:, n:] / pivots[:, None], pivots, sign


def _eliminate_single(matrix: Array, right: Array) -> tuple[Array, Array, Array]:
    packed, swaps, order = lax.linalg.lu(matrix)
    x = right[order]
    if right.shape[1]:
        x = lax.linalg.triangular_solve(packed, x, left_side=True, lower=True, unit_diagonal=True)
        x = lax.linalg.triangular_solve(packed, x, left_side=True, lower=False)
    odd = jnp.sum(swaps != jnp.arange(matrix.shape[0], dtype=swaps.dtype)) % 2
    return x, jnp.diagonal(packed), 1.0 - 2.0 * odd


_eliminate = _routed(_eliminate_single, _eliminate_batched)


def eliminate(
    matrix: Float[Array, "n n"], right: Float[Array, "n k"]
) -> tuple[Float[Array, "n k"], Float[Array, " n"], Array]:
    """Elimination with partial pivoting: the solutions, the pivots, and the sign of the permutation of the rows."""
    return _eliminate(matrix, right)


def _orthonormal_batched(matrix: Array) -> tuple[Array, Array, Array]:
    # Gram-Schmidt, every column orthogonalised twice, which is as good as Householder's reflections. What is done to
    # the columns is done to those of the identity too: they become the inverse of the triangle.
    m, n = matrix.shape
    columns = jnp.arange(n)
    whole = jnp.concatenate([matrix, jnp.eye(n)])

    def step(k, state):
        q, sizes = state
        v = _entry(whole, columns == k, 1)
        for _ in range(2):
            v = v - jnp.sum(q * jnp.sum(q[:m] * v[:m, None], axis=0)[None], axis=1)
        size = jnp.sqrt(jnp.sum(v[:m] * v[:m]))
        v = v / jnp.where(size > 0, size, 1.0)
        return jnp.where((columns == k)[None], v[:, None], q), jnp.where(columns == k, size, sizes)

    q, sizes = lax.fori_loop(0, n, step, (jnp.zeros((m + n, n)), jnp.zeros(n)))
    return q[:m], q[m:], sizes


def _orthonormal_single(matrix: Array) -> tuple[Array, Array, Array]:
    q, r = jnp.linalg.qr(matrix)
    inverse = lax.linalg.triangular_solve(r, jnp.eye(matrix.shape[1]), left_side=True, lower=False)
    return q, inverse, jnp.abs(jnp.diagonal(r))


_orthonormal = _routed(_orthonormal_single, _orthonormal_batched)


def orthonormal(
    matrix: Float[Array, "m n"],
) -> tuple[Float[Array, "m n"], Float[Array, "n n"], Float[Array, " n"]]:
    """QR factorisation of a tall matrix: orthonormal columns, the inverse of the triangle, sizes of its diagonal."""
    return _orthonormal(matrix)


def _cholesky_single(matrix: Array, right: Array) -> Array:
    factor = lax.linalg.cholesky(matrix, symmetrize_input=False)
    x = lax.linalg.triangular_solve(factor, right, left_side=True, lower=True)
    return lax.linalg.triangular_solve(factor, x, left_side=True, lower=True, transpose_a=True)


def _cholesky_batched(matrix: Array, right: Array) -> Array:
    n = matrix.shape[0]
    rows, columns = jnp.arange(n), jnp.arange(n + right.shape[1])

    def step(k, state):
        a, pivots = state
        row = _entry(a, rows == k, 0)
        pivot = jnp.sum(jnp.where(columns == k, row, 0.0))
        pivot = jnp.where(pivot > 0, pivot, jnp.nan)
        factor = jnp.where(rows == k, 0.0, _entry(a, columns == k, 1) / pivot)
        return a - factor[:, None] * row[None], jnp.where(rows == k, pivot, pivots)

    a, pivots = lax.fori_loop(0, n, step, (jnp.concatenate([matrix, right], axis=1), jnp.zeros(n)))
    return a[:, n:] / pivots[:, None]


_cholesky = _routed(_cholesky_single, _cholesky_batched)


def cholesky_solve(matrix: Float[Array, "n n"], right: Float[Array, "n k"]) -> Float[Array, "n k"]:
    """Solve with a symmetric positive definite matrix; not finite if it is not."""
    return _cholesky(matrix, right)


def independent_columns(matrix: Float[Array, "n m"]) -> Int[Array, " n"]:
    """A well-conditioned choice of n columns, by Gram-Schmidt that always takes the longest column left."""
    n, m = matrix.shape
    columns = jnp.arange(m)

    def step(k, state):
        a, left, chosen = state
        best = jnp.argmax(jnp.where(left, jnp.sum(a * a, axis=0), -1.0))
        v = _entry(a, columns == best, 1)
        size = jnp.sqrt(jnp.sum(v * v))
        v = v / jnp.where(size > 0, size, 1.0)
        a = a - v[:, None] * jnp.sum(v[:, None] * a, axis=0)[None]
        return a, left & (columns != best), jnp.where(jnp.arange(n) == k, best, chosen)

    start = (matrix, jnp.ones(m, bool), jnp.zeros(n, columns.dtype))
    return jnp.sort(lax.fori_loop(0, n, step, start)[2])


_singular_values = _routed(lambda matrix: jnp.linalg.svd(matrix, compute_uv=False))


def singular_values(matrix: Float[Array, "m n"]) -> Float[Array, " k"]:
    """Singular values, largest first."""
    return _singular_values(matrix)


_eigen = _routed(lambda matrix: tuple(jnp.linalg.eigh(matrix)))


def symmetric_eigen(matrix: Float[Array, "n n"]) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """Eigenvalues of a symmetric matrix, smallest first, and eigenvectors as columns; not differentiable."""
    values, vectors = _eigen(matrix)
    return values, vectors
