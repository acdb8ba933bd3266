"""optimistix.Newton under vmap, with the unknowns and the cold guess of the naive way."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import optimistix

from benchmarks.circles import FourBars
from benchmarks.peers.naive import four_bar_residual


def newton(bars: FourBars, unknowns: int) -> Callable[[Any], Any]:
    """A jitted function of angles ``(N,)``: unknowns ``(N, unknowns)``, C last, and whether they converged."""
    residual, guess = four_bar_residual(bars, unknowns)
    solver = optimistix.Newton(rtol=1e-12, atol=1e-12)

    def lane(phi):
        found = optimistix.root_find(residual, solver, jnp.array(guess), phi, max_steps=50, throw=False)
        return found.value, found.result == optimistix.RESULTS.successful

    return jax.jit(jax.vmap(lane))
