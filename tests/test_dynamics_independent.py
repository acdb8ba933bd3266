"""Benchmark problems in space against Lagrange's equations in independent coordinates, integrated by SciPy."""

import jax
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.library import benchmarks
from tests.independent import lagrange


@pytest.mark.slow
def test_spatial_slider_crank():
    lagrangian, slider = lagrange.spatial_slider_crank()
    t = np.linspace(0, 1, 6)
    phi, rate = lagrange.motion(lagrangian, [0.0], [6.0], t)
    run = nc.simulate(benchmarks.spatial_slider_crank().compile(), t, rates={"phi": 6.0}, method="rk4", step=2e-3)
    assert (
        np.abs(run["s"] - np.asarray(jax.vmap(slider)(phi[:, 0]))[:, 0]).max() <= 1e-6
    )  # RK4's error; 1e-11 by dopri8
    assert np.abs(run.velocity("phi") - rate[:, 0]).max() <= 1e-4
    assert float(run.drift) <= 1e-6
