"""NumPy's and SciPy's linear algebra on one thread: set once, where the first matrix is met, and never again."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg  # noqa: F401  (loads its BLAS)
from threadpoolctl import ThreadpoolController, threadpool_limits

from jaxnc import library, process
from jaxnc.solvers import dense
from jaxnc.solvers.saddle import saddle
from jaxnc.solvers.sparse_matrix import Factoriser


@pytest.fixture
def several():
    """BLAS on two threads, as in a process where nothing has been solved yet; how many threads each library has."""
    process.one_thread.cache_clear()
    process._single.clear()
    blas = ThreadpoolController().select(user_api="blas")
    if not blas.lib_controllers:
        pytest.skip("no BLAS here whose threads can be counted")

    def counts():
        return {found["num_threads"] for found in blas.info()}

    with threadpool_limits(2, user_api="blas"):
        if counts() != {2}:
            pytest.skip("this BLAS has no threads")
        yield counts
    for found in blas.lib_controllers:
        found.set_num_threads(1)


def diagonal():
    return Factoriser(2, np.arange(2), np.arange(2)).factorise(np.ones(2))


def saddle_point():  # of a size that no other test has: what JAX has traced it does not look at again
    return jax.make_jaxpr(lambda h, j: saddle(h, j, False)(h[0], j[:, 0]))(jnp.eye(13), jnp.ones((1, 13)))


@pytest.mark.parametrize(
    "meet",
    [
        pytest.param(lambda: library.four_bar().compile(), id="compile"),
        pytest.param(lambda: jax.make_jaxpr(dense.eliminate)(jnp.eye(13), jnp.eye(13)), id="dense"),
        pytest.param(saddle_point, id="saddle"),
        pytest.param(diagonal, id="sparse"),
    ],
)
def test_whatever_factorises_does_it_on_one_thread(several, meet):
    meet()
    assert several() == {1}


def test_threads_set_afterwards_stay(several):
    diagonal()
    with threadpool_limits(2, user_api="blas"):
        diagonal()
        library.four_bar().compile()
        assert several() == {2}
