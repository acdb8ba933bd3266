"""Factorisations of small dense matrices: LAPACK for a single one, loops of our own for a batch.

On a CPU, XLA runs independent operations on a pool of threads, and jaxlib's batched LAPACK kernels wait inside that
pool for work that they hand to it: two of them at once on a machine with two cores wait for ever. Batches therefore
never reach LAPACK. Everything that is needed of a factorisation comes out of one loop, because what is felt of these
loops is the time that it takes to compile them. Factorisations are not differentiated; solves by `solver` are.
"""

import functools
from collections.abc import Callable
from typing import NoReturn, TypeVar, cast

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap

from jaxnc.autodiff import attach, solve_linear
from jaxnc.errors import InputError
from jaxnc.process import one_thread
from jaxnc.system.precision import limits, numbers
from jaxnc.types import Array, Float, Int

F = TypeVar("F", bound=Callable)


def _with_batch(batched: Callable | None = None) -> Callable[[F], F]:
    """Give a function of one matrix a program for a batch: `batched`, mapped, or without it one after the other."""

    def decorate(single: F) -> F:
        @custom_vmap
        def route(*arguments):
            one_thread("scipy")
            return single(*arguments)

        @route.def_vmap
        def mapped(size, which, *arguments):
            with numbers(arguments[0]):
                full = [
                    a if has else jnp.broadcast_to(a, (size, *a.shape)) for a, has in zip(arguments, which, strict=True)
                ]
                out = jax.vmap(batched)(*full) if batched else lax.map(lambda one: route(*one), full)
                return out, jax.tree.map(lambda _: True, out)

        return cast(F, functools.update_wrapper(route, single))

    return decorate


def _masked_line(x: Array, at: Array, axis: int) -> Array:
    """Take a row (column) by a mask, which vectorises over a batch where a gather would not."""
    return jnp.sum(jnp.where(at[:, None] if axis == 0 else at[None], x, 0.0), axis=axis)


def _eliminate_batched(matrix: Array, right: Array) -> tuple[Array, Array, Array]:
    n = matrix.shape[0]
    rows, columns = jnp.arange(n), jnp.arange(n + right.shape[1])

    def step(k, state):
        a, pivots, sign = state
        column = _masked_line(a, columns == k, 1)
        best = jnp.argmax(jnp.where(rows >= k, jnp.abs(column), -1.0))
        row, other = _masked_line(a, rows == best, 0), _masked_line(a, rows == k, 0)
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


@_with_batch(_eliminate_batched)
def eliminate(
    matrix: Float[Array, "n n"], right: Float[Array, "n k"]
) -> tuple[Float[Array, "n k"], Float[Array, " n"], Array]:
    """Eliminate with partial pivoting: the solutions, the pivots, and the sign of the permutation of the rows."""
    packed, swaps, order = lax.linalg.lu(matrix)
    x = right[order]
    if right.shape[1]:
        x = lax.linalg.triangular_solve(packed, x, left_side=True, lower=True, unit_diagonal=True)
        x = lax.linalg.triangular_solve(packed, x, left_side=True, lower=False)
    odd = jnp.sum(swaps != jnp.arange(matrix.shape[0], dtype=swaps.dtype)) % 2
    return x, jnp.diagonal(packed), 1.0 - 2.0 * odd


def _orthonormal_batched(matrix: Array) -> tuple[Array, Array, Array]:
    # Gram-Schmidt, every column orthogonalised twice, which is as good as Householder's reflections. What is done to
    # the columns is done to those of the identity too: they become the inverse of the triangle.
    m, n = matrix.shape
    columns = jnp.arange(n)
    whole = jnp.concatenate([matrix, jnp.eye(n)])

    def step(k, state):
        q, sizes = state
        v = _masked_line(whole, columns == k, 1)
        for _ in range(2):
            v = v - jnp.sum(q * jnp.sum(q[:m] * v[:m, None], axis=0)[None], axis=1)
        size = jnp.sqrt(jnp.sum(v[:m] * v[:m]))
        v = v / jnp.where(size > 0, size, 1.0)
        return jnp.where((columns == k)[None], v[:, None], q), jnp.where(columns == k, size, sizes)

    q, sizes = lax.fori_loop(0, n, step, (jnp.zeros((m + n, n)), jnp.zeros(n)))
    return q[:m], q[m:], sizes


@_with_batch(_orthonormal_batched)
def orthonormal(
    matrix: Float[Array, "m n"],
) -> tuple[Float[Array, "m n"], Float[Array, "n n"], Float[Array, " n"]]:
    """Factorise a tall matrix by QR: orthonormal columns, the inverse of the triangle, sizes of its diagonal."""
    q, r = jnp.linalg.qr(matrix)
    inverse = lax.linalg.triangular_solve(r, jnp.eye(matrix.shape[1]), left_side=True, lower=False)
    return q, inverse, jnp.abs(jnp.diagonal(r))


def _cholesky_batched(matrix: Array, right: Array) -> Array:
    n = matrix.shape[0]
    rows, columns = jnp.arange(n), jnp.arange(n + right.shape[1])

    def step(k, state):
        a, pivots = state
        row = _masked_line(a, rows == k, 0)
        pivot = jnp.sum(jnp.where(columns == k, row, 0.0))
        pivot = jnp.where(pivot > 0, pivot, jnp.nan)
        factor = jnp.where(rows == k, 0.0, _masked_line(a, columns == k, 1) / pivot)
        return a - factor[:, None] * row[None], jnp.where(rows == k, pivot, pivots)

    a, pivots = lax.fori_loop(0, n, step, (jnp.concatenate([matrix, right], axis=1), jnp.zeros(n)))
    return a[:, n:] / pivots[:, None]


@_with_batch(_cholesky_batched)
def cholesky_solve(matrix: Float[Array, "n n"], right: Float[Array, "n k"]) -> Float[Array, "n k"]:
    """Solve with a symmetric positive definite matrix; not finite if it is not."""
    factor = lax.linalg.cholesky(matrix, symmetrize_input=False)
    x = lax.linalg.triangular_solve(factor, right, left_side=True, lower=True)
    return lax.linalg.triangular_solve(factor, x, left_side=True, lower=True, transpose_a=True)


def independent_columns(matrix: Float[Array, "n m"]) -> Int[Array, " n"]:
    """Choose n well-conditioned columns, by Gram-Schmidt that always takes the longest column left."""
    n, m = matrix.shape
    columns = jnp.arange(m)

    def step(k, state):
        a, left, chosen = state
        best = jnp.argmax(jnp.where(left, jnp.sum(a * a, axis=0), -1.0))
        v = _masked_line(a, columns == best, 1)
        size = jnp.sqrt(jnp.sum(v * v))
        v = v / jnp.where(size > 0, size, 1.0)
        a = a - v[:, None] * jnp.sum(v[:, None] * a, axis=0)[None]
        return a, left & (columns != best), jnp.where(jnp.arange(n) == k, best, chosen)

    start = (matrix, jnp.ones(m, bool), jnp.zeros(n, columns.dtype))
    return jnp.sort(lax.fori_loop(0, n, step, start)[2])


@_with_batch()
def _svd(matrix: Array) -> tuple[Array, Array, Array]:
    return tuple(jnp.linalg.svd(matrix, full_matrices=False))


@jax.custom_jvp
def _singular_vectors(matrix: Array) -> tuple[Array, Array]:
    left, _, right = _svd(matrix)
    return left, right


@_singular_vectors.defjvp
def _refuse_second_derivatives(*_: object) -> NoReturn:
    raise InputError("singular values are differentiated once; a second derivative of them is not known")


@_with_batch()
def _svd_values(matrix: Array) -> Array:
    return jnp.linalg.svd(matrix, compute_uv=False)


def singular_values(matrix: Float[Array, "m n"]) -> Float[Array, " k"]:
    """Singular values, largest first, with their first derivatives."""
    return attach(_change_singular_values, None, _svd_values(lax.stop_gradient(matrix)), matrix)


def _change_singular_values(_: None, value: Array, args: tuple, changes: tuple) -> Array:
    left, right = _singular_vectors(args[0])
    return jnp.einsum("mk,mn,kn->k", left, changes[0], right)


@_with_batch()
def symmetric_eigen(matrix: Float[Array, "n n"]) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """Eigenvalues of a symmetric matrix, smallest first, and eigenvectors as columns; not differentiable."""
    values, vectors = jnp.linalg.eigh(matrix)
    return values, vectors


@_with_batch()
def eigen(matrix: Float[Array, "n n"]) -> tuple[Array, Array, Array]:
    """Eigenvalues of any matrix and its left and right eigenvectors as columns, complex; not differentiable.

    The left ones are met as ``left.conj().T @ matrix = values[:, None] * left.conj().T``.
    """
    values, left, right = lax.linalg.eig(matrix)
    return values, left, right


# -- linear systems -----------------------------------------------------------------------------------------------


def newton_steps(
    jacobian: Float[Array, "m n"], right: Float[Array, "m k"], independent: bool = False
) -> Float[Array, "n k"]:
    """Solve for Newton or Gauss-Newton steps with k right-hand sides; not finite where the matrix is singular.

    With more rows than unknowns: of all rows in the least-squares sense, or of an independent choice of them.
    """
    m, n = jacobian.shape
    if n == 0:
        return jnp.zeros((0, right.shape[1]))
    if m > n and independent:
        rows = independent_columns(jacobian.T)
        return eliminate(jacobian[rows], right[rows])[0]
    if m == n:
        return eliminate(jacobian, right)[0]
    # By QR: normal equations would square the condition number, and close to a change point that is too much.
    basis, inverse, _ = orthonormal(jacobian)
    return inverse @ (basis.T @ right)


def damped_step(
    jacobian: Float[Array, "m n"], r: Float[Array, "m ..."], damping: Array | float
) -> Float[Array, "n ..."]:
    """Levenberg-Marquardt step: damping relative to the mean diagonal of the normal matrix."""
    n = jacobian.shape[1]
    normal = jacobian.T @ jacobian
    weight = damping * jnp.trace(normal) / n
    right = (jacobian.T @ r).reshape(n, -1)
    return cholesky_solve(normal + (weight + limits(weight).tiny) * jnp.eye(n), right).reshape(n, *r.shape[1:])


def _times_vector(a: Array, x: Array) -> Array:
    return jnp.sum(a * x[..., None, :], axis=-1)


def solver(
    jacobian: Float[Array, "m n"], independent: bool = False
) -> Callable[[Float[Array, " m"]], Float[Array, " n"]]:
    """Factorise once, to solve ``J x = b`` to working precision for several b, least squares if rows are redundant.

    The solutions are differentiable to any order with respect to J and b, forward and reverse.

    The matrix ``(m, n)``, ``m >= n``, has full column rank; `independent` rows may be chosen instead of least squares.
    x is refined once.
    """
    m, n = jacobian.shape
    if n == 0:
        return lambda b: jnp.zeros(0)
    if m > n and independent:
        rows = independent_columns(lax.stop_gradient(jacobian).T)
        inner = solver(jacobian[rows])
        return lambda b: inner(b[rows])
    fixed = lax.stop_gradient(jacobian)
    if m == n:
        inverse = eliminate(fixed, jnp.eye(n))[0]

        def direct(_, y, trans=0):
            matrix, back = (fixed.T, inverse.T) if trans else (fixed, inverse)
            x = _times_vector(back, y)
            for _ in range(2):
                x = x + _times_vector(back, y - _times_vector(matrix, x))
            return x

        return lambda b: lax.custom_linear_solve(
            lambda x: _times_vector(jacobian, x), b, direct, transpose_solve=lambda v, y: direct(v, y, 1)
        )

    both = least_squares(fixed)

    def augmented(pair):
        y, x = pair
        return y + _times_vector(jacobian, x), _times_vector(jacobian.T, y)

    return lambda b: solve_linear(augmented, (b, jnp.zeros(n)), lambda pair: both(*pair))[1]


def least_squares(jacobian: Float[Array, "m n"]) -> Callable[[Array, Array], tuple[Array, Array]]:
    """Factorise once, to solve ``y + J x = b, Jᵀ y = c`` to working precision for several b and c.

    With c = 0, x is the least-squares solution of ``J x = b`` and y what is left. The system is symmetric, so that its
    derivatives are exact.
    """
    basis, inverse, _ = orthonormal(jacobian)

    def once(b, c):
        forward = _times_vector(inverse.T, c)
        inside = _times_vector(basis.T, b)
        x = _times_vector(inverse, inside - forward)
        return b + _times_vector(basis, forward - inside), x

    def refined(b, c):
        y, x = once(b, c)
        dy, dx = once(b - y - _times_vector(jacobian, x), c - _times_vector(jacobian.T, y))
        return y + dy, x + dx

    return refined


def conditioning(jacobian: Float[Array, "m n"]) -> Array:
    """Estimate of the reciprocal condition number: smallest pivot over largest. Zero at a singular position."""
    m, n = jacobian.shape
    if n == 0:
        return jnp.ones(())
    pivots = eliminate(jacobian, jnp.zeros((n, 0)))[1] if m == n else orthonormal(jacobian)[2]
    pivots = jnp.abs(pivots)
    return jnp.min(pivots) / jnp.maximum(jnp.max(pivots), limits(pivots).tiny)


def determinant_sign(matrix: Float[Array, "n n"]) -> Array:
    """Sign of the determinant of a matrix."""
    _, pivots, sign = eliminate(matrix, jnp.zeros((matrix.shape[0], 0)))
    return sign * jnp.prod(jnp.sign(pivots))


def well_posed(jacobian: Float[Array, "m n"], ok: Array) -> Float[Array, "m n"]:
    """The matrix where `ok`, the identity elsewhere, so that failed lanes stay finite under differentiation."""
    return jnp.where(ok, jacobian, jnp.eye(jacobian.shape[0], jacobian.shape[1]))
