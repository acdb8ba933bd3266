"""What kinds are written in besides arithmetic: of JAX's numbers, of plain ones, and of those that write it down."""

import math
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxnc.constraints.small import Small
from jaxnc.constraints.symbols import Expression
from jaxnc.reading import Number

_WRITING = Number | Expression


def where(condition: Any, a: Any, b: Any) -> Any:
    """One of two numbers."""
    if isinstance(condition, bool | np.bool_):
        return a if condition else b
    return condition.apply("select", a, b) if isinstance(condition, Number) else jnp.where(condition, a, b)


def sqrt(x: Any) -> Any:
    """Square root."""
    if isinstance(x, _WRITING):
        return x.apply("sqrt")
    return math.sqrt(x) if isinstance(x, float) else jnp.sqrt(x)


def root(square: Any) -> Any:
    """Square root of what may be zero, or rounded to less: with a zero (not NaN) derivative there."""
    if isinstance(square, Expression):
        return sqrt(square)
    positive = square > 0
    return where(positive, sqrt(where(positive, square, 1.0)), 0.0)


def ratio(a: Any, b: Any) -> Any:
    """``a / b``, and 0 where b is 0, with finite derivatives."""
    if isinstance(a, Expression) or isinstance(b, Expression):
        return a / b
    nonzero = b != 0
    return where(nonzero, a / where(nonzero, b, 1.0), 0.0)


def angle(sine: Any, cosine: Any) -> Any:
    """The angle of a direction from its two parts, zero where there is none."""
    safe = (cosine != 0) | (sine != 0)
    y, x = where(safe, sine, 0.0), where(safe, cosine, 1.0)
    return y.apply("atan2", x) if isinstance(y, Number) else jnp.arctan2(y, x)


def stacked(components: Any) -> Any:
    """Components as one small vector."""
    if isinstance(components[0], Small | _WRITING) or any(isinstance(x, _WRITING) for x in components):
        return Small(components)
    return np.array(components) if all(isinstance(x, float) for x in components) else jnp.stack(components)
