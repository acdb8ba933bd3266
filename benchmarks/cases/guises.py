"""The same four-bar described differently: no description may be faster than another."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxnc as nc
from benchmarks.cases.crank_rocker import BARS, Turn
from benchmarks.circles import fraction
from benchmarks.clock import Way
from benchmarks.mechanisms import Guise, guises
from benchmarks.suite import Suite


def _way(guise: Guise, name: str) -> Way:
    return Way(
        name,
        lambda phi: jax.block_until_ready(nc.solve_position(guise.system, {guise.angle: phi}, throw=False)),
        lambda mo, data: fraction(
            np.asarray(mo[guise.point]),
            guise.place(BARS.poses(data.phi)[1]),
            float(BARS.ground),
            np.asarray(mo.converged),
        ),
        prepare=lambda data: jnp.asarray(data.phi + guise.turn),
        compiles=True,
        note=guise.name,
    )


def described_differently(suite: Suite) -> None:
    """Turned and moved, renamed with points permuted, and built from a kind that the package does not know."""
    plain, *others = guises(BARS)
    ways = [_way(plain, "jaxnc"), *(_way(g, f"jaxnc: {g.name}") for g in others)]
    suite.compare("guises", ways, Turn.draw, suite.size(400_000, 50_000))
