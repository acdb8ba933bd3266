"""Sine and cosine in plain arithmetic.

XLA calls the C library for them in float64, number by number, which costs more than all the rest of a small mechanism's
equations. Written out, they are vectorised with what stands around them. Cody and Waite's reduction by multiples of
π/2 in three parts, and the minimax polynomials of fdlibm's ``__kernel_sin`` and ``__kernel_cos`` (Sun, 1993); the error
stays below one unit in the last place of 1 as long as the multiple has 20 bits (260,000 turns), and grows slowly from
there on. In float32 the same with shorter parts and the polynomials of Cephes' ``sinf`` and ``cosf`` (Moshier, 1992).
"""

import contextlib
import functools
import math
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.constraints.symbols import Expression
from jaxnc.reading import Number

_PARTS = (1.57079632673412561417e00, 6.07710050650619224932e-11, 2.02226624879595063154e-21)  # of π/2
_SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
_PARTS_32 = (1.5703125, 4.837512969970703125e-4, 7.549789954891882e-8)
_SINE_32 = (-1.6666654611e-1, 8.3321608736e-3, -1.9515295891e-4)
_COSINE_32 = (4.166664568298827e-2, -1.388731625493765e-3, 2.443315711809948e-5)
_WRITTEN = {
    np.dtype(np.float64): (_PARTS, _SINE, _COSINE),
    np.dtype(np.float32): (_PARTS_32, _SINE_32, _COSINE_32),
}


_spelled = [True]


@contextlib.contextmanager
def by_name() -> Iterator[None]:
    """Leave sine and cosine as the operations that they are, for what is traced to be read, not compiled."""
    _spelled.append(False)
    try:
        yield
    finally:
        _spelled.pop()


def sin(x: Any) -> Any:
    """Sine; of a plain number without JAX, so that probing a kind compiles nothing."""
    if isinstance(x, float):
        return math.sin(x)
    if isinstance(x, Number | Expression):
        return x.apply("sin")
    return _sin(x) if _spelled[-1] and jnp.result_type(x) in _WRITTEN else lax.sin(jnp.asarray(x, float))


def cos(x: Any) -> Any:
    """Cosine; of a plain number without JAX."""
    if isinstance(x, float):
        return math.cos(x)
    if isinstance(x, Number | Expression):
        return x.apply("cos")
    return _cos(x) if _spelled[-1] and jnp.result_type(x) in _WRITTEN else lax.cos(jnp.asarray(x, float))


@jax.custom_jvp
def _sin(x):
    return _shifted(x, 0)


@jax.custom_jvp
def _cos(x):
    return _shifted(x, 1)


@_sin.defjvp
def _sin_jvp(primals, tangents):
    (x,), (dx,) = primals, tangents
    return _sin(x), _cos(x) * dx


@_cos.defjvp
def _cos_jvp(primals, tangents):
    (x,), (dx,) = primals, tangents
    return _cos(x), -_sin(x) * dx


@functools.partial(jax.jit, static_argnums=1)  # traced once for each type: a mechanism asks for it dozens of times
def _shifted(x, quarters: int):
    """``sin(x + quarters π/2)``."""
    parts, sine, cosine = _WRITTEN[jnp.result_type(x)]
    k = jnp.round(x * (2.0 / math.pi))
    r = ((x - k * parts[0]) - k * parts[1]) - k * parts[2]
    z = r * r
    si = r + r * z * _polynomial(sine, z)
    co = 1.0 - 0.5 * z + z * z * _polynomial(cosine, z)
    # The quadrant by arithmetic on whole numbers held as floats: conversions to integers are slow.
    n = k + quarters
    odd = n - 2.0 * jnp.floor(0.5 * n)
    half = jnp.floor(0.5 * n)
    turned = half - 2.0 * jnp.floor(0.5 * half)
    value = jnp.where(odd > 0.5, co, si)
    return jnp.where(turned > 0.5, -value, value)


def _polynomial(coefficients, z):
    out = coefficients[-1]
    for c in coefficients[-2::-1]:
        out = c + z * out
    return out
