"""Rigid bodies by Newton and Euler: inertia of uniform solids by sampling, energies and momenta from v and ω.

Nothing here knows of natural coordinates.
"""

import numpy as np


def rotation(rng) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def tensor(second: np.ndarray) -> np.ndarray:
    """Inertia tensor from second moments ∫ r rᵀ dm."""
    return np.trace(second) * np.eye(3) - second


def box(m: float, a: float, b: float, c: float) -> np.ndarray:
    return m / 12 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b])


def cylinder(m: float, r: float, h: float) -> np.ndarray:
    """Axis along x."""
    across = m * (3 * r * r + h * h) / 12
    return np.diag([m * r * r / 2, across, across])


def sphere(m: float, r: float) -> np.ndarray:
    return 0.4 * m * r * r * np.eye(3)


def polygon(corners: np.ndarray, m: float) -> tuple[np.ndarray, float]:
    """Centre and polar moment about it of a uniform plane polygon, by the shoelace sums."""
    x, y = corners.T
    x2, y2 = np.roll(x, -1), np.roll(y, -1)
    cross = x * y2 - x2 * y
    area = cross.sum() / 2
    centre = np.array([((x + x2) * cross).sum(), ((y + y2) * cross).sum()]) / (6 * area)
    polar = ((x * x + x * x2 + x2 * x2 + y * y + y * y2 + y2 * y2) * cross).sum() / 12
    return centre, m * polar / area - m * centre @ centre


def energy(m: float, inertia: np.ndarray, v: np.ndarray, w: np.ndarray) -> float:
    return 0.5 * m * v @ v + 0.5 * w @ inertia @ w
