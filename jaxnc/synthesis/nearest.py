"""Targets without order: at which value of the input the curve of a design is nearest to each of them.

A search moves these values with the design, as those of a given order; each is then where the curve is perpendicular to
the way to its target, which need not be the nearest such place. Here the whole curve is looked at.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxnc.synthesis.path import PathGeneration
from jaxnc.synthesis.poses import curves, marker
from jaxnc.synthesis.problem import Problem, moving

_POSES = 361  # of the curve
_CHUNK = 64  # designs at once
_NEARER = 1 - 1e-6  # of a distance: a place is another one only if it is nearer by that
_APART = 2.0  # steps of the curve: what is nearer to a place is that place


def reseated(problem: Problem, rows: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Designs with each target at the nearest place of the whole curve; as they are in problems with an order."""
    if not (isinstance(problem, PathGeneration) and not problem.ordered and len(rows)):
        return list(rows)
    every = np.stack(rows)
    out = [_reseated(problem, every[k : k + _CHUNK]) for k in range(0, len(every), _CHUNK)]
    return list(np.concatenate(out))


def _reseated(problem: PathGeneration, rows: np.ndarray) -> np.ndarray:
    n, count = len(problem.variables.names), len(problem.target)
    x = rows[:, : problem.count]
    q, good, begin = curves(problem, x[:, :n], _POSES, "close")
    curve = _traced(problem, x, q)
    low, high = problem.travel
    step = (high - low) / (_POSES - 1)
    now = np.cumsum(x[:, n : n + count], axis=1)
    new, square = np.empty_like(now), np.empty_like(now)
    with np.errstate(all="ignore"):
        for k, target in enumerate(problem.target):
            part, far = _nearest(curve - target, good)
            at = np.argmin(far, axis=1)
            lanes = np.arange(len(x))
            new[:, k], square[:, k] = begin + step * (at + part[lanes, at]), far[lanes, at]
            if problem.whole:  # within half a turn of the first target
                first = new[:, 0] if k else now[:, 0]
                new[:, k] += 2 * np.pi * np.round((first - new[:, k]) / (2 * np.pi))
        apart = now - new
        if problem.whole:
            apart -= 2 * np.pi * np.round(apart / (2 * np.pi))
        here = _squares(problem, x, curve, begin, step, now)
        stay = (np.abs(apart) <= _APART * step) | ~(square < _NEARER * here)
    new = np.where(stay & np.isfinite(apart), new + apart, new)
    out = rows.copy()
    fresh = ~stay.all(axis=1) & np.isfinite(new).all(axis=1)
    out[fresh, n : n + count] = np.concatenate([new[:, :1], np.diff(new, axis=1)], axis=1)[fresh]
    return out


def _nearest(way: np.ndarray, good: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """On each chord of curves ``(designs, poses, dim)`` about a target, the nearest part and its squared distance."""
    chord, a = np.diff(way, axis=1), way[:, :-1]
    part = -np.sum(a * chord, axis=2) / np.maximum(np.sum(chord**2, axis=2), 1e-300)
    part = np.clip(part, 0.0, 1.0)
    square = np.sum((a + part[..., None] * chord) ** 2, axis=2)
    return part, np.where(good[:, :-1] & good[:, 1:] & np.isfinite(square), square, np.inf)


def _squares(
    problem: PathGeneration, x: np.ndarray, curve: np.ndarray, begin: np.ndarray, step: float, now: np.ndarray
) -> np.ndarray:
    """Squared distances of the targets from where they are on the curve, ``(designs, targets)``."""
    s = (now - begin[:, None]) / step
    s = np.mod(s, _POSES - 1) if problem.whole else np.clip(s, 0.0, _POSES - 1)
    i = np.clip(np.floor(s), 0, _POSES - 2).astype(int)
    part, lanes = (s - i)[..., None], np.arange(len(x))[:, None]
    place = curve[lanes, i] + part * (curve[lanes, i + 1] - curve[lanes, i])
    square = np.sum((place - problem.target) ** 2, axis=2)
    return np.where(np.isfinite(square), square, np.inf)


def _traced(problem: PathGeneration, x: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The tracer's places in poses ``(designs, poses, N)``, ``(designs, poses, dim)``."""
    top = problem.system.topology
    if problem.point in top.points:
        k = top.points.index(problem.point)
        return q[..., k * top.dim : (k + 1) * top.dim]
    if top.dim == 2:
        number = [m.name for m in top.markers].index(problem.point)
        place: Any = marker(problem, x[:, : len(problem.variables.names)], q, number)
        return np.stack([place.real, place.imag], axis=-1)
    none, zero = np.zeros(q.shape[1], int), np.zeros(q.shape[1])
    ways = [
        moving(problem.design(one), problem.driven, problem.hold, p, none, zero, zero, zero)
        for one, p in zip(x, q, strict=True)
    ]
    return np.stack([np.asarray(way[problem.point]) for way in ways])
