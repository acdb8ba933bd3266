"""Small linear systems: steps inside Newton, where a tiny bias is harmless, and exact solves with derivatives."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Int

from jaxnc.types import Array, Float


def independent_rows(jacobian: Float[Array, "m n"]) -> Int[Array, " n"]:
    """A well-conditioned choice of n independent rows, by QR with column pivoting of the transpose."""
    n = jacobian.shape[1]
    _, _, order = jax.scipy.linalg.qr(lax.stop_gradient(jacobian).T, mode="economic", pivoting=True)
    return jnp.sort(order[:n])


def steps(jacobian: Float[Array, "m n"], right: Float[Array, "m k"], independent: bool = False) -> Float[Array, "n k"]:
    """Newton or Gauss-Newton steps for k right-hand sides; not finite where the matrix is singular.

    With more rows than unknowns: of all rows in the least-squares sense, or of an independent choice of them.
    """
    m, n = jacobian.shape
    if n == 0:
        return jnp.zeros((0, right.shape[1]))
    if m > n and independent:
        rows = independent_rows(jacobian)
        return jnp.linalg.solve(jacobian[rows], right[rows])
    if m == n:
        return jnp.linalg.solve(jacobian, right)
    return damped_step(jacobian, right, 1e-14)


def damped_step(
    jacobian: Float[Array, "m n"], r: Float[Array, "m ..."], damping: Array | float
) -> Float[Array, "n ..."]:
    """Levenberg-Marquardt step: damping relative to the mean diagonal of the normal matrix."""
    n = jacobian.shape[1]
    normal = jacobian.T @ jacobian
    weight = damping * jnp.trace(normal) / n
    factor = jax.scipy.linalg.cho_factor(normal + (weight + 1e-300) * jnp.eye(n), lower=True)
    return jax.scipy.linalg.cho_solve(factor, jacobian.T @ r)


def _times(a: Array, x: Array) -> Array:
    return jnp.sum(a * x[..., None, :], axis=-1)


def solver(
    jacobian: Float[Array, "m n"], independent: bool = False
) -> Callable[[Float[Array, " m"]], Float[Array, " n"]]:
    """Factorise once, to solve ``J x = b`` to working precision for several b, least squares if rows are redundant.

    The solutions are differentiable to any order with respect to J and b, forward and reverse.

    Args:
        jacobian: matrix of full column rank, ``m >= n``.
        independent: choose independent rows instead of least squares.

    Returns:
        A function from b to x; x is refined once against the matrix itself.
    """
    m, n = jacobian.shape
    if n == 0:
        return lambda b: jnp.zeros(0)
    if m > n and independent:
        rows = independent_rows(jacobian)
        inner = solver(jacobian[rows])
        return lambda b: inner(b[rows])
    fixed = lax.stop_gradient(jacobian)
    if m == n:
        lu = jax.scipy.linalg.lu_factor(fixed)

        def direct(_, y, trans=0):
            matrix = fixed.T if trans else fixed
            x = jax.scipy.linalg.lu_solve(lu, y, trans=trans)
            return x + jax.scipy.linalg.lu_solve(lu, y - _times(matrix, x), trans=trans)

        return lambda b: lax.custom_linear_solve(
            lambda x: _times(jacobian, x), b, direct, transpose_solve=lambda v, y: direct(v, y, 1)
        )

    # Least squares as the symmetric system [I J; Jᵀ 0] (y, x) = (b, 0), whose derivatives are exact.
    basis, triangle = jnp.linalg.qr(fixed)

    def augmented(pair):
        y, x = pair
        return y + _times(jacobian, x), _times(jacobian.T, y)

    def once(b, c):
        forward = jax.scipy.linalg.solve_triangular(triangle, c, trans=1)
        inside = _times(basis.T, b)
        x = jax.scipy.linalg.solve_triangular(triangle, inside - forward)
        return b + _times(basis, forward - inside), x

    def least_squares(_, pair):
        b, c = pair
        y, x = once(b, c)
        dy, dx = once(b - y - _times(fixed, x), c - _times(fixed.T, y))
        return y + dy, x + dx

    # Transposition asks that every part of the right-hand side depends on b, the zeros too.
    return lambda b: lax.custom_linear_solve(
        augmented, (b, jnp.zeros(n) + 0.0 * jnp.sum(b)), least_squares, symmetric=True
    )[1]


def conditioning(jacobian: Float[Array, "m n"]) -> Array:
    """Estimate of the reciprocal condition number: smallest pivot over largest. Zero at a singular position."""
    m, n = jacobian.shape
    if n == 0:
        return jnp.ones(())
    if m == n:
        pivots = jnp.abs(jnp.diagonal(jax.scipy.linalg.lu_factor(jacobian)[0]))
    else:
        pivots = jnp.abs(jnp.diagonal(jnp.linalg.qr(jacobian, mode="r")))
    return jnp.min(pivots) / jnp.maximum(jnp.max(pivots), 1e-300)


def well_posed(jacobian: Float[Array, "m n"], ok: Array) -> Float[Array, "m n"]:
    """The matrix where `ok`, the identity elsewhere, so that failed lanes stay finite under differentiation."""
    return jnp.where(ok, jacobian, jnp.eye(jacobian.shape[0], jacobian.shape[1]))
