"""Small linear systems: steps inside Newton, where a tiny bias is harmless, and exact solves with derivatives."""

from collections.abc import Callable

import jax.numpy as jnp
from jax import lax

from jaxnc.solvers import dense
from jaxnc.system.precision import limits
from jaxnc.types import Array, Float


def steps(jacobian: Float[Array, "m n"], right: Float[Array, "m k"], independent: bool = False) -> Float[Array, "n k"]:
    """Newton or Gauss-Newton steps for k right-hand sides; not finite where the matrix is singular.

    With more rows than unknowns: of all rows in the least-squares sense, or of an independent choice of them.
    """
    m, n = jacobian.shape
    if n == 0:
        return jnp.zeros((0, right.shape[1]))
    if m > n and independent:
        rows = dense.independent_columns(jacobian.T)
        return dense.eliminate(jacobian[rows], right[rows])[0]
    if m == n:
        return dense.eliminate(jacobian, right)[0]
    # By QR: normal equations would square the condition number, and close to a change point that is too much.
    basis, inverse, _ = dense.orthonormal(jacobian)
    return inverse @ (basis.T @ right)


def damped_step(
    jacobian: Float[Array, "m n"], r: Float[Array, "m ..."], damping: Array | float
) -> Float[Array, "n ..."]:
    """Levenberg-Marquardt step: damping relative to the mean diagonal of the normal matrix."""
    n = jacobian.shape[1]
    normal = jacobian.T @ jacobian
    weight = damping * jnp.trace(normal) / n
    right = (jacobian.T @ r).reshape(n, -1)
    return dense.cholesky_solve(normal + (weight + limits(weight).tiny) * jnp.eye(n), right).reshape(n, *r.shape[1:])


def _times(a: Array, x: Array) -> Array:
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
        rows = dense.independent_columns(lax.stop_gradient(jacobian).T)
        inner = solver(jacobian[rows])
        return lambda b: inner(b[rows])
    fixed = lax.stop_gradient(jacobian)
    if m == n:
        inverse = dense.eliminate(fixed, jnp.eye(n))[0]

        def direct(_, y, trans=0):
            matrix, back = (fixed.T, inverse.T) if trans else (fixed, inverse)
            x = _times(back, y)
            for _ in range(2):
                x = x + _times(back, y - _times(matrix, x))
            return x

        return lambda b: lax.custom_linear_solve(
            lambda x: _times(jacobian, x), b, direct, transpose_solve=lambda v, y: direct(v, y, 1)
        )

    # Least squares as the symmetric system [I J; Jᵀ 0] (y, x) = (b, 0), whose derivatives are exact.
    basis, inverse, _ = dense.orthonormal(fixed)

    def augmented(pair):
        y, x = pair
        return y + _times(jacobian, x), _times(jacobian.T, y)

    def both(b, c):
        forward = _times(inverse.T, c)
        inside = _times(basis.T, b)
        x = _times(inverse, inside - forward)
        return b + _times(basis, forward - inside), x

    def least_squares(_, pair):
        b, c = pair
        y, x = both(b, c)
        dy, dx = both(b - y - _times(fixed, x), c - _times(fixed.T, y))
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
    pivots = dense.eliminate(jacobian, jnp.zeros((n, 0)))[1] if m == n else dense.orthonormal(jacobian)[2]
    pivots = jnp.abs(pivots)
    return jnp.min(pivots) / jnp.maximum(jnp.max(pivots), limits(pivots).tiny)


def determinant(matrix: Float[Array, "n n"]) -> tuple[Array, Array]:
    """Sign of the determinant of a matrix, and the logarithm of its size."""
    _, pivots, sign = dense.eliminate(matrix, jnp.zeros((matrix.shape[0], 0)))
    return sign * jnp.prod(jnp.sign(pivots)), jnp.sum(logarithm(pivots))


def logarithm(size: Array) -> Array:
    """Logarithm of absolute values, finite at zero."""
    return jnp.log(jnp.maximum(jnp.abs(size), limits(size).tiny))


def well_posed(jacobian: Float[Array, "m n"], ok: Array) -> Float[Array, "m n"]:
    """The matrix where `ok`, the identity elsewhere, so that failed lanes stay finite under differentiation."""
    return jnp.where(ok, jacobian, jnp.eye(jacobian.shape[0], jacobian.shape[1]))
