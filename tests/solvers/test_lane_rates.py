"""Rates of large batches by the kernel's elimination, against linear solves pose by pose."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxnc as nc
from jaxnc.kinematics.traced import pose_rates
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.fill import LEAST
from jaxnc.solvers.plan import plan

ROUNDING = 1e-12  # of the largest rate


def test_rates_of_a_large_batch_are_those_of_single_poses():
    """A four-bar that dead points keep from turning: failed poses have no rates."""
    system = nc.library.four_bar().compile()
    short = system.replace({"rocker.C-D": 0.6 * float(system["rocker.C-D"])})
    phi = np.linspace(-3.0, 3.0, LEAST)
    motion = nc.solve_position(short, {"phi": phi}, rates={"phi": 2.0 + phi}, accelerations={"phi": 0.5})
    assert 0 < int(motion.failures) < LEAST
    view, eq = plan(short.topology, ("phi",), (), 1), derive(short)
    orders = [jnp.asarray(2.0 + phi)[:, None], jnp.full((LEAST, 1), 0.5)]
    one = jax.jit(jax.vmap(lambda q, v, a, ok: tuple(pose_rates(view, eq, q, (v, a), ok))))
    for found, wanted in zip(motion.rates, one(motion.q, *orders, motion.converged), strict=True):
        assert found.shape == motion.q.shape
        np.testing.assert_allclose(found, wanted, atol=ROUNDING * float(jnp.max(jnp.abs(wanted))))
        assert not np.any(np.asarray(found)[~np.asarray(motion.converged)])
