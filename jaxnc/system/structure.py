"""Which variables a row of a kind depends on, found by probing the kind with numbers."""

import functools

import jax
import numpy as np

from jaxnc.constraints import Kind


@functools.cache
def pattern(kind: Kind, dim: int) -> np.ndarray:
    """Structural non-zeros of one instance's Jacobian, ``(rows, variables)`` of booleans.

    Every variable is moved in turn at a few generic poses with generic constants; rows that change depend on it.
    """
    rng = np.random.default_rng(20250101)
    sizes = (kind.points * dim, kind.vectors * dim, kind.scalars)
    count = sum(sizes)
    found = np.zeros((len(kind.rows), count), dtype=bool)
    if not kind.rows:
        return found

    def rows(x: np.ndarray, c: np.ndarray) -> np.ndarray:
        p = x[: sizes[0]].reshape(kind.points, dim)
        v = x[sizes[0] : sizes[0] + sizes[1]].reshape(kind.vectors, dim)
        return np.array([float(r) for r in kind.residual(p, v, x[sizes[0] + sizes[1] :], c)])  # pyright: ignore[reportArgumentType]

    with jax.ensure_compile_time_eval():
        for _ in range(8):
            x, c = rng.uniform(-1.7, 1.7, count), rng.uniform(0.4, 1.6, len(kind.constants))
            at = rows(x, c)
            for k in range(count):
                moved = x.copy()
                moved[k] += 0.137
                found[:, k] |= np.abs(rows(moved, c) - at) > 1e-12
    return found
