"""Systems of motion with constraints: ``H x + Jᵀ λ = f, J x = g``, whatever rows are redundant.

Redundant rows make the matrix singular, though x is unique and Jᵀλ too. The matrix that is factorised has -ε on the
diagonal of the rows, and its solution is refined against the true one: each refinement takes away all but a part
ε/σ of what is left in a direction that the rows see with strength σ, and nothing at all enters the directions that they
do not see. So x comes out exact, and λ with the smallest norm (the proximal form of Bayo's augmented Lagrangian).

A single system keeps its LU factors; mapped, the factors are the inverse (batches never reach LAPACK).
"""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap

from jaxnc.autodiff import solve_linear
from jaxnc.process import one_thread
from jaxnc.solvers import dense
from jaxnc.system.precision import limits, numbers
from jaxnc.types import Array, Float


def saddle(
    hessian: Float[Array, "n n"], jacobian: Float[Array, "m n"], redundant: bool, refinements: int = 2
) -> Callable[[Array, Array], tuple[Array, Array]]:
    """A function from f ``(n,)`` and g ``(m,)`` to x and λ, factorised once; differentiable to any order, both ways.

    The hessian is symmetric, of size one, and positive definite where ``J x = 0``; rows are of size one, too. Redundant
    rows get one refinement more.
    """
    m, n = jacobian.shape
    h, j = lax.stop_gradient((hessian, jacobian))
    # ε where rows are redundant: larger is safer at singular positions, smaller converges faster
    small = limits(jacobian).redundant if redundant else limits(jacobian).damping
    matrix = jnp.concatenate(
        [jnp.concatenate([h, j.T], axis=1), jnp.concatenate([j, -small * jnp.eye(m)], axis=1)], axis=0
    )
    factors = _factors(matrix)

    def product(pair, a=hessian, b=jacobian):
        x, y = pair
        return _times(a, x) + _times(b.T, y), _times(b, x)

    def direct(right):
        b = jnp.concatenate(right)
        z = _solutions(*factors, b[None])[0]
        for _ in range(refinements + redundant):
            back = product((z[:n], z[n:]), h, j)
            z = z + _solutions(*factors, (b - jnp.concatenate(back))[None])[0]
        return z[:n], z[n:]

    return lambda f, g: solve_linear(product, (f, g), direct)


def _times(a: Array, x: Array) -> Array:
    return jnp.sum(a * x[..., None, :], axis=-1)


@custom_vmap
def _factors(matrix: Array) -> tuple[Array, Array]:
    """LU factors and the order of the rows of a single matrix; of mapped ones the inverse, and an order not used."""
    one_thread("scipy")
    packed, _, order = lax.linalg.lu(matrix)
    return packed, order


@_factors.def_vmap
def _(size, which, matrix):
    with numbers(matrix):
        inverse = jax.vmap(lambda a: dense.eliminate(a, jnp.eye(a.shape[0]))[0])(matrix)
        order = jnp.zeros(matrix.shape[:-1], jnp.int32)
    return (inverse, order), (True, True)


@custom_vmap
def _solutions(packed: Array, order: Array, rights: Array) -> Array:
    """Solutions ``(k, n)``, by LU factors; by the inverse where `_factors` was mapped."""
    x = lax.linalg.triangular_solve(packed, rights.T[order], left_side=True, lower=True, unit_diagonal=True)
    return lax.linalg.triangular_solve(packed, x, left_side=True, lower=False).T


@_solutions.def_vmap
def _(size, which, packed, order, rights):
    if not which[0]:
        flat = rights.reshape(math.prod(rights.shape[:-1]), rights.shape[-1])  # of no rows, or of no poses, too
        return _solutions(packed, order, flat).reshape(rights.shape), True
    rights = rights if which[2] else jnp.broadcast_to(rights, (size, *rights.shape))
    if rights.shape[1] == 1:  # sums that XLA makes one loop with what stands around them
        return _times(packed, rights[:, 0])[:, None], True
    return jnp.einsum("bij,bkj->bki", packed, rights), True
