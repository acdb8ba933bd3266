"""Moments and unit vectors of poses ``(P, …)``: in NumPy where all is known, else in JAX."""

from typing import Any

import jax.numpy as jnp
import numpy as np


def library(*arrays: Any) -> Any:
    """NumPy where all is known, so that reading a wrench compiles nothing; else JAX."""
    return np if all(isinstance(a, np.ndarray) for a in arrays) else jnp


def cross(a: Any, b: Any) -> Any:
    """Moment of a force b with the arm a: ``(...,)`` in the plane, ``(..., 3)`` in space."""
    if a.shape[-1] == 2:
        return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    parts = [a[..., i] * b[..., j] - a[..., j] * b[..., i] for i, j in ((1, 2), (2, 0), (0, 1))]
    return library(*parts).stack(parts, -1)


def size(x: Any) -> Any:
    """Length of vectors ``(..., dim)``; zero, with derivative zero, of none."""
    square = (x * x).sum(-1)
    where = library(square).where
    return where(square > 0, where(square > 0, square, 1.0) ** 0.5, 0.0)


def unit(x: Any) -> Any:
    """Unit vectors ``(..., dim)``."""
    return x / size(x)[..., None]
