"""Building blocks of kinds besides arithmetic: small vectors, and functions of numbers of every sort.

The numbers are JAX's, plain ones, or those that write down what is done with them. Kinds are written for arrays. Given
a `Small` instead, their arithmetic falls apart into that of single numbers, of which nothing has to be put together and
taken apart again: lanes of them are plain arithmetic on long vectors.

Sine and cosine are written out. XLA calls the C library for them in float64, number by number, which costs more than
all the rest of a small mechanism's equations; written out, they are vectorised with what stands around them. They are
Cody and Waite's reduction by multiples of π/2 in three parts, and the minimax polynomials of fdlibm's ``__kernel_sin``
and ``__kernel_cos`` (Sun, 1993). The error stays below one unit in the last place of 1 as long as the multiple has 20
bits (260,000 turns), and grows slowly from there on. In float32 the parts are shorter and the polynomials are those of
Cephes' ``sinf`` and ``cosf`` (Moshier, 1992). What is read as a program has the operation itself.
"""

import math
import operator
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.constraints.symbols import Expression
from jaxnc.reading import Number, OutOfRange
from jaxnc.types import Scalar

_Writing = Number | Expression


class Small:
    """A few numbers (or rows of such) that can be indexed, added, subtracted, and multiplied, item by item."""

    __slots__ = ("items",)

    def __init__(self, items: Iterable):
        self.items = tuple(items)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array that it stands for."""
        inner = self.items[0].shape if self.items and isinstance(self.items[0], Small) else ()
        return (len(self.items), *inner)

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator:
        return iter(self.items)

    def __getitem__(self, at: int | slice | tuple) -> Any:
        if isinstance(at, tuple):
            first, *rest = at
            if not rest:
                return self[first]
            rest = tuple(rest) if len(rest) > 1 else rest[0]
            return Small(row[rest] for row in self[first]) if isinstance(first, slice) else self[first][rest]
        if isinstance(at, slice):
            for end in (at.start, at.stop):
                self._check(end, 1)
            return Small(self.items[at])
        if isinstance(at, bool):
            raise TypeError("True and False are no places")  # of an array they make another one
        self._check(at, 0)
        return self.items[at]

    def _check(self, at: object, beyond: int) -> None:
        """Refuse a place that is not there, which an array of JAX's would move to its end in silence."""
        size = len(self.items)
        if isinstance(at, int) and not -size <= at < size + beyond:
            raise OutOfRange(f"index {at} in an array of {size}")

    def _with(self, f: Callable, other: Any) -> "Small":
        shape = getattr(other, "shape", (len(other),) if isinstance(other, tuple) else ())
        if not shape:
            return Small(f(a, other) for a in self.items)
        if shape != self.shape:
            raise TypeError(f"shapes {self.shape} and {shape} do not fit")
        return Small(f(a, b) for a, b in zip(self.items, other, strict=True))

    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        raise TypeError("items are compared by arrays")

    def __add__(self, other: object) -> "Small":
        return self._with(operator.add, other)

    __radd__ = __add__

    def __sub__(self, other: object) -> "Small":
        return self._with(operator.sub, other)

    def __rsub__(self, other: object) -> "Small":
        return self._with(lambda a, b: b - a, other)

    def __mul__(self, other: object) -> "Small":
        return self._with(operator.mul, other)

    __rmul__ = __mul__

    def __truediv__(self, other: object) -> "Small":
        return self._with(operator.truediv, other)

    def __neg__(self) -> "Small":
        return Small(-a for a in self.items)


# -- functions of one number or two ---------------------------------------------------------------------------------


def where(condition: Any, a: Any, b: Any) -> Any:
    """Choose one of two numbers."""
    if isinstance(condition, bool | np.bool_):
        return a if condition else b
    return condition.apply("select", a, b) if isinstance(condition, Number) else jnp.where(condition, a, b)


def sqrt(x: Any) -> Any:
    """Square root."""
    if isinstance(x, _Writing):
        return x.apply("sqrt")
    return math.sqrt(x) if isinstance(x, float) else jnp.sqrt(x)


def root(square: Any) -> Any:
    """Square root of what may be zero, or rounded to less: with a zero (not NaN) derivative there."""
    if isinstance(square, Expression):
        return sqrt(square)
    positive = square > 0
    return where(positive, sqrt(where(positive, square, 1.0)), 0.0)


def ratio(a: Scalar, b: Scalar) -> Any:
    """``a / b``, and 0 where b is 0, with finite derivatives."""
    if isinstance(a, Expression) or isinstance(b, Expression):
        return a / b
    nonzero = b != 0
    return where(nonzero, a / where(nonzero, b, 1.0), 0.0)


def angle(sine: Scalar, cosine: Scalar) -> Any:
    """The angle of a direction from its two parts, zero where there is none."""
    safe = (cosine != 0) | (sine != 0)
    y, x = where(safe, sine, 0.0), where(safe, cosine, 1.0)
    return y.apply("atan2", x) if isinstance(y, Number) else jnp.arctan2(y, x)


def stacked(components: Any) -> Any:
    """Components as one small vector."""
    if isinstance(components[0], Small | _Writing) or any(isinstance(x, _Writing) for x in components):
        return Small(components)
    return np.array(components) if all(isinstance(x, float) for x in components) else jnp.stack(components)


# -- sine and cosine ------------------------------------------------------------------------------------------------

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


def sin(x: Scalar) -> Any:
    """Sine; of a plain number without JAX, so that probing a kind compiles nothing."""
    if isinstance(x, float):
        return math.sin(x)
    if isinstance(x, _Writing):
        return x.apply("sin")
    return _sin(x) if jnp.result_type(x) in _WRITTEN else lax.sin(jnp.asarray(x, float))


def cos(x: Scalar) -> Any:
    """Cosine; of a plain number without JAX."""
    if isinstance(x, float):
        return math.cos(x)
    if isinstance(x, _Writing):
        return x.apply("cos")
    return _cos(x) if jnp.result_type(x) in _WRITTEN else lax.cos(jnp.asarray(x, float))


# Functions that are compiled apart are traced once for each type: a mechanism asks for them dozens of times.
# `jaxnc.reading` knows them by these names, and reads the operation that they stand for.


@jax.jit
def sine_in_full(x):
    """Sine, written out."""
    return _shifted_sine(x, 0)


@jax.jit
def cosine_in_full(x):
    """Cosine, written out."""
    return _shifted_sine(x, 1)


_sin, _cos = jax.custom_jvp(sine_in_full), jax.custom_jvp(cosine_in_full)
_sin.defjvps(lambda dx, sine, x: _cos(x) * dx)
_cos.defjvps(lambda dx, cosine, x: -_sin(x) * dx)


def _shifted_sine(x, quarters: int):
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
