"""Which variables a row of a kind depends on, and to which degree, found by probing the kind with numbers."""

import functools
from collections.abc import Callable

import jax
import numpy as np

from jaxnc.constraints import Kind
from jaxnc.system.precision import WIDE, numbers


@functools.cache
def pattern(kind: Kind, dim: int) -> np.ndarray:
    """Structural non-zeros of one instance's Jacobian, ``(rows, variables)`` of booleans.

    Every variable is moved in turn at a few generic poses with generic constants; rows that change depend on it.
    """
    found = np.zeros((len(kind.rows), _count(kind, dim)), dtype=bool)
    for rows, x in _probes(kind, dim, 8):
        at = rows(x)
        for k in range(len(x)):
            found[:, k] |= np.abs(rows(_moved(x, k)) - at) > 1e-12
    return found


Pairs = tuple[tuple[int, int], ...]


@functools.cache
def curvature(kind: Kind, dim: int, moving: tuple[int, ...]) -> tuple[Pairs | None, ...]:
    """How the rows of an instance curve in some of its variables, whatever the others are.

    Args:
        kind: the kind.
        dim: 2 in the plane, 3 in space.
        moving: places of the variables.

    Returns:
        Per row the ordered pairs of them whose second derivative can differ from zero, where all second derivatives are
        constant; None for a row of higher degree.
    """
    size = len(moving)
    found = np.zeros((len(kind.rows), size, size), dtype=bool)
    constant = np.ones(len(kind.rows), dtype=bool)
    rng = np.random.default_rng(20250102)
    for rows, x in _probes(kind, dim, 3):
        y = x.copy()
        y[list(moving)] += rng.uniform(-0.9, 0.9, size)
        first, second = (_differences(rows, z, moving) for z in (x, y))
        largest = np.maximum(np.abs(first), np.abs(second)).max(axis=(1, 2), initial=1.0)[:, None, None]
        found |= (np.abs(first) > 1e-10 * largest) | (np.abs(second) > 1e-10 * largest)
        constant &= np.all(np.abs(first - second) <= 1e-9 * largest, axis=(1, 2))
    return tuple(
        tuple((moving[i], moving[j]) for i, j in np.argwhere(found[r])) if constant[r] else None
        for r in range(len(kind.rows))
    )


def _differences(rows: Callable, x: np.ndarray, moving: tuple[int, ...]) -> np.ndarray:
    """Mixed second differences of the rows, ``(rows, moving, moving)``."""
    at = rows(x)
    once = [rows(_moved(x, k)) for k in moving]
    out = np.zeros((len(at), len(moving), len(moving)))
    for i, k in enumerate(moving):
        for j, m in enumerate(moving[: i + 1]):
            out[:, i, j] = out[:, j, i] = rows(_moved(_moved(x, k), m)) - once[i] - once[j] + at
    return out


def _moved(x: np.ndarray, k: int) -> np.ndarray:
    moved = x.copy()
    moved[k] += 0.137
    return moved


def _count(kind: Kind, dim: int) -> int:
    return (kind.points + kind.vectors) * dim + kind.scalars


def _probes(kind: Kind, dim: int, number: int):
    """Generic poses with generic constants: the rows as a function of the variables, and where to begin."""
    if not kind.rows:
        return
    rng = np.random.default_rng(20250101)
    a, b = kind.points * dim, (kind.points + kind.vectors) * dim
    with numbers(WIDE), jax.ensure_compile_time_eval():
        for _ in range(number):
            x, c = rng.uniform(-1.7, 1.7, _count(kind, dim)), rng.uniform(0.4, 1.6, len(kind.constants))

            def rows(x: np.ndarray, c: np.ndarray = c) -> np.ndarray:
                p, v = x[:a].reshape(kind.points, dim), x[a:b].reshape(kind.vectors, dim)
                return np.array([float(r) for r in kind.residual(p, v, x[b:], c)])  # pyright: ignore[reportArgumentType]

            yield rows, x
