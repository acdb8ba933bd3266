"""Saddle systems: mapped in whatever order, the same solutions, and batches that never reach LAPACK."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.solvers.saddle import saddle

RNG = np.random.default_rng(0)
H, J, F = 2 * np.eye(4), RNG.normal(size=(3, 2, 4)), RNG.normal(size=(3, 2, 4))
EXACT = 1e-13
SHARED = 1e-6  # rounding over the 1e-9 that stands on the diagonal of the rows


def solutions(j, sides):
    """Several right-hand sides of one matrix."""
    solve = saddle(jnp.asarray(H), j, False)
    return jax.vmap(lambda f: solve(f, jnp.ones(2))[0])(sides)


def by_numpy(j, sides):
    whole = np.block([[H, j.T], [j, np.zeros((2, 2))]])
    return np.stack([np.linalg.solve(whole, np.concatenate([f, np.ones(2)]))[:4] for f in sides])


def test_mapped_or_not_the_solutions_are_numpys():
    wanted = np.stack([by_numpy(j, f) for j, f in zip(J, F, strict=True)])
    one, many = jax.jit(solutions), jax.jit(jax.vmap(solutions))
    assert np.abs(one(J[0], F[0]) - wanted[0]).max() <= EXACT
    assert np.abs(many(J, F) - wanted).max() <= EXACT
    assert "getrf" in one.lower(J[0], F[0]).as_text() and "lapack" not in many.lower(J, F).as_text()


def test_redundant_rows_give_the_least_multipliers():
    j = np.concatenate([J[0], J[0][:1]])  # a row twice: its multiplier is shared
    x, y = saddle(jnp.asarray(H), jnp.asarray(j), True)(jnp.asarray(F[0, 0]), jnp.array([1.0, 1.0, 1.0]))
    assert np.abs(x - by_numpy(J[0], F[0])[0]).max() <= EXACT
    assert abs(float(y[0] - y[2])) <= SHARED
