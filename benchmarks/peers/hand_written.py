"""Newton for the four-bar written by hand in JAX: the best kernel found, for this one mechanism and nothing else.

Structure of arrays, lanes last, chunks of a few thousand lanes that stay in the cache, a fixed few iterations in
lockstep, outputs written in place by `lax.map`; residual and branch of every lane are checked at the result, and a
chunk with a lane that fails is iterated further. Sine and cosine are polynomials, because XLA's own are
scalar calls on the CPU in 64 bits.
"""

import functools
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from benchmarks.circles import FourBars

_CHUNK = 4000  # lanes; 1,000 to 10,000 are equal to within noise
_FEW, _MORE = 6, 24  # iterations from one cold guess: six are enough everywhere on a full turn of the default lengths
_TOLERANCE = 1e-12  # of the ground's length squared, for residuals that are squared lengths
_PIO2 = (1.5707963267948966, 6.123233995736766e-17)

Kernel = Callable[[Any], tuple[Any, Any, Any, Any]]


def sine_cosine(x: Any) -> tuple[Any, Any]:
    """Sine and cosine to about 1e-16 for moderate angles, in multiplications and additions only."""
    k = jnp.round(x * (2 / np.pi))
    r = (x - k * _PIO2[0]) - k * _PIO2[1]
    z = r * r
    s, c = 0.0, 0.0
    for n in range(7, 0, -1):  # Taylor's series to the terms in r^15 and r^14
        s = z * (s + (-1) ** n / math.factorial(2 * n + 1))
        c = z * (c + (-1) ** n / math.factorial(2 * n))
    s, c = r + r * s, 1 + c
    q = k.astype(jnp.int32) & 3
    odd = (q & 1) == 1
    sine, cosine = jnp.where(odd, c, s), jnp.where(odd, s, c)
    return jnp.where(q >= 2, -sine, sine), jnp.where((q == 1) | (q == 2), -cosine, cosine)


def kernel(bars: FourBars, unknowns: int) -> Kernel:
    """A jitted function of angles ``(N,)`` that returns x and y of C, residuals and statuses, each ``(N,)``.

    Args:
        bars: one design.
        unknowns: 2: only C is solved for, the crank pin follows from the angle; 4: B and C are.
    """
    a, b, c, d = (float(x) for x in (bars.crank, bars.coupler, bars.rocker, bars.ground))
    side = float(bars.side)
    home_b, home_c = (np.asarray(p) for p in bars.poses(bars.home))

    def rows(bx, by, x, y):
        px, py, rx = x - bx, y - by, x - d
        return px, py, rx, px * px + py * py - b * b, rx * rx + y * y - c * c

    def two(q, pin):
        x, y = q
        px, py, rx, f, g = rows(pin[0], pin[1], x, y)
        inverse = 0.5 / (px * y - py * rx)
        return x - (f * y - g * py) * inverse, y - (px * g - rx * f) * inverse

    def four(q, pin):
        bx, by, x, y = q
        ex, ey = pin[0] - bx, pin[1] - by
        px, py, rx, f, g = rows(bx, by, x, y)
        f = f - 2 * (px * ex + py * ey)
        inverse = 0.5 / (px * y - py * rx)
        return bx + ex, by + ey, x - (f * y - g * py) * inverse, y - (px * g - rx * f) * inverse

    step = two if unknowns == 2 else four
    start = home_c if unknowns == 2 else np.concatenate([home_b, home_c])

    def chunk(u):
        s, co = sine_cosine(u)
        pin = (a * co, a * s)

        def look(q):
            x, y = q[-2:]
            bx, by = pin if unknowns == 2 else q[:2]
            px, py, rx, f, g = rows(bx, by, x, y)
            worst = jnp.maximum(jnp.abs(f), jnp.abs(g))
            if unknowns == 4:
                worst = jnp.maximum(worst, d * jnp.maximum(jnp.abs(q[0] - pin[0]), jnp.abs(q[1] - pin[1])))
            return worst, (worst < _TOLERANCE * d * d) & (side * (px * y - py * rx) > 0)

        def more(state):
            return (state[0] < _MORE) & ~jnp.all(look(state[1])[1])

        q = lax.fori_loop(0, _FEW, lambda _, q: step(q, pin), tuple(jnp.full_like(u, v) for v in start))
        q = lax.while_loop(more, lambda state: (state[0] + 1, step(state[1], pin)), (0, q))[1]
        worst, ok = look(q)
        return *q[-2:], worst, jnp.where(ok, 0, 1).astype(jnp.int32)

    return jax.jit(functools.partial(_in_chunks, chunk))


def _in_chunks(chunk: Callable, phi: Any) -> Any:
    count = phi.shape[0]
    width = min(_CHUNK, count)
    chunks = -(-count // width)
    out = lax.map(chunk, jnp.pad(phi, (0, chunks * width - count), mode="edge").reshape(chunks, width))
    return tuple(x.reshape(-1)[:count] for x in out)
