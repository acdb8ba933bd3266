"""Systems of motion with constraints: ``H x + Jᵀ λ = f, J x = g``, whatever rows are redundant.

Redundant rows make the matrix singular, though x is unique and Jᵀλ too. The matrix that is factorised has -ε on the
diagonal of the rows, and its solution is refined against the true one: each refinement takes away all but a part
ε/σ of what is left in a direction that the rows see with strength σ, and nothing at all enters the directions that they
do not see. So x comes out exact, and λ with the smallest norm (the proximal form of Bayo's augmented Lagrangian).
"""

from collections.abc import Callable

import jax.numpy as jnp
from jax import lax

from jaxnc.solvers import dense
from jaxnc.types import Array, Float

_REDUNDANT = 1e-9  # ε where rows are redundant: larger is safer at singular positions, smaller converges faster
_PLAIN = 1e-13  # where they are not
_REFINEMENTS = 2


def saddle(
    hessian: Float[Array, "n n"], jacobian: Float[Array, "m n"], redundant: bool
) -> Callable[[Array, Array], tuple[Array, Array]]:
    """Factorise once, to solve for several right-hand sides; differentiable to any order, forward and reverse.

    Args:
        hessian: symmetric, positive definite where ``J x = 0``; of size one.
        jacobian: rows of size one, may be redundant.
        redundant: whether rows are (or may become) redundant.

    Returns:
        A function from f ``(n,)`` and g ``(m,)`` to x and λ.
    """
    m, n = jacobian.shape
    h, j = lax.stop_gradient((hessian, jacobian))
    small = _REDUNDANT if redundant else _PLAIN
    matrix = jnp.concatenate(
        [jnp.concatenate([h, j.T], axis=1), jnp.concatenate([j, -small * jnp.eye(m)], axis=1)], axis=0
    )
    inverse = dense.eliminate(matrix, jnp.eye(n + m))[0]

    def product(pair, a=hessian, b=jacobian):
        # Transposition asks that both parts depend on everything that may be perturbed.
        x, y = pair
        first = _times(a, x) + _times(b.T, y)
        return first, _times(b, x) + 0.0 * jnp.sum(first)

    def direct(_, right):
        f, g = right
        b = jnp.concatenate([f, g])
        z = _times(inverse, b)
        for _ in range(_REFINEMENTS + redundant):
            back = product((z[:n], z[n:]), h, j)
            z = z + _times(inverse, b - jnp.concatenate(back))
        return z[:n], z[n:]

    def solve(f: Array, g: Array) -> tuple[Array, Array]:
        nothing = 0.0 * (jnp.sum(f) + jnp.sum(g))
        return lax.custom_linear_solve(product, (f + nothing, g + nothing), direct, symmetric=True)

    return solve


def _times(a: Array, x: Array) -> Array:
    return jnp.sum(a * x[..., None, :], axis=-1)
