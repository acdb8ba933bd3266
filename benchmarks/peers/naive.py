"""What everybody writes in JAX: vmap of a while loop around jacfwd and a linear solve.

`four_bar` is written out for the four-bar, with the unknowns, the tolerance, the cold guess and the jit of the other
ways; `of_system` does the same for any mechanism, from the residual that this library gives.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

import jaxnc as nc
from benchmarks.circles import FourBars
from jaxnc.system.equations import equations

_TOLERANCE = 1e-12
_MOST = 50  # iterations


def newton(residual: Callable[[Any], Any], guess: Any, tolerance: Any, least_squares: bool = False) -> tuple[Any, Any]:
    """Newton until the largest residual is below the tolerance; returns unknowns and whether it is."""

    def unfinished(state):
        i, x = state
        return (i < _MOST) & (jnp.max(jnp.abs(residual(x))) > tolerance)

    def step(state):
        i, x = state
        jacobian, r = jax.jacfwd(residual)(x), residual(x)
        dx = jnp.linalg.lstsq(jacobian, r)[0] if least_squares else jnp.linalg.solve(jacobian, r)
        return i + 1, x - dx

    x = lax.while_loop(unfinished, step, (0, guess))[1]
    return x, jnp.max(jnp.abs(residual(x))) <= tolerance


def four_bar_residual(bars: FourBars, unknowns: int) -> tuple[Callable[[Any, Any], Any], np.ndarray]:
    """Residual ``(x, phi)`` of the four-bar with 2 or 4 unknowns, as squared lengths, and the cold guess."""
    a, b, c, d = (float(x) for x in (bars.crank, bars.coupler, bars.rocker, bars.ground))
    home = [np.asarray(p) for p in bars.poses(bars.home)]
    pivot = jnp.array([d, 0.0])

    def residual(x, phi):
        pin = a * jnp.stack([jnp.cos(phi), jnp.sin(phi)])
        at_b, at_c = (pin, x) if unknowns == 2 else (x[:2], x[2:])
        coupler, rocker = at_c - at_b, at_c - pivot
        bars = jnp.stack([jnp.sum(coupler**2) - b * b, jnp.sum(rocker**2) - c * c])
        return bars if unknowns == 2 else jnp.concatenate([d * (at_b - pin), bars])

    return residual, home[1] if unknowns == 2 else np.concatenate(home)


def four_bar(bars: FourBars, unknowns: int) -> Callable[[Any], Any]:
    """A jitted function of angles ``(N,)``: unknowns ``(N, unknowns)``, C last, and whether they converged."""
    residual, guess = four_bar_residual(bars, unknowns)
    tolerance = _TOLERANCE * float(bars.ground) ** 2
    return jax.jit(jax.vmap(lambda phi: newton(lambda x: residual(x, phi), jnp.array(guess), tolerance)))


def of_system(
    system: nc.System, driven: Sequence[str], hold: Sequence[str], seeds: nc.Motion | None = None
) -> Callable[[Any], Any]:
    """The naive solver of any mechanism.

    Args:
        system: the system.
        driven: names of the inputs.
        hold: coordinates that keep their drawn value.
        seeds: earlier poses; every lane starts from the one whose inputs are nearest, otherwise from the drawing.

    Returns:
        A jitted function of inputs ``(N, driven)``: all coordinates ``(N, coordinates)`` and whether they converged.
    """
    top = system.topology
    inputs = np.array([top.position[name] for name in driven])
    unknown = np.array([i for i in top.unknown if top.coordinates[i] not in {*driven, *hold}])
    eq = equations(system)
    table = eq.home[None] if seeds is None else seeds.q
    weights = 1 / jnp.maximum(jnp.ptp(table[:, inputs], axis=0), 1e-9)
    tolerance = _TOLERANCE * float(eq.length)
    square = len(unknown) == len(top.rows)

    def lane(u):
        near = jnp.argmin(jnp.sum(((table[:, inputs] - u) * weights) ** 2, axis=1))
        q = table[near].at[inputs].set(u)

        def residual(x):
            return nc.system.residual(eq, q.at[unknown].set(x))

        x, ok = newton(residual, q[unknown], tolerance, least_squares=not square)
        return q.at[unknown].set(x), ok

    return jax.jit(jax.vmap(lane))


def stacked(inputs: Mapping[str, Any]) -> jax.Array:
    """Inputs by name as one array ``(N, inputs)``."""
    return jnp.stack([jnp.asarray(v) for v in inputs.values()], axis=-1)
