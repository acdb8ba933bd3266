"""pylinkage's search over topologies and lengths by an evolutionary algorithm, for a closed curve; needs pymoo."""

import importlib.util
import time
from typing import Any

import numpy as np

_TURNS = np.exp(2j * np.pi * np.arange(24) / 24)  # in which a locus is laid on the curve
_POPULATION = 100  # linkages, as it is by default


class _TimeIsOver(BaseException):
    """What the search, which goes on after any error of an aim, is ended by."""


def is_there() -> bool:
    """Tell whether what it needs is installed."""
    return all(importlib.util.find_spec(name) for name in ("pylinkage", "pymoo"))


def trace_by_evolution(points: np.ndarray, seconds: float, seed: int = 0) -> float:
    """Search for so many seconds of processor time.

    The aim is kinder than the library's own, which wants the curve in its place: of every joint the locus is put where
    the curve is, in its size, in the best of some turns, or mirrored.

    Args:
        points: corners of a closed curve, ``(N, 2)``.
        seconds: how long.
        seed: of the random numbers.

    Returns:
        The distance CD of the best locus, in sizes of the curve.
    """
    from pylinkage.exceptions import UnbuildableError
    from pylinkage.optimization.co_optimization_types import CoOptimizationConfig
    from pylinkage.optimization.mixed_variable import co_optimize

    goal = _normalise(points @ [1.0, 1j])
    end = time.process_time() + seconds
    best = [np.inf, goal]

    def aim(linkage: Any) -> float:
        if time.process_time() > end:
            raise _TimeIsOver
        try:
            poses = np.array([[complex(*place) for place in pose] for pose in linkage.step()])
        except (UnbuildableError, TypeError):  # it stops on its way, or never begins
            return np.inf
        least = np.inf
        for locus in poses.T if len(poses) > 8 and np.isfinite(poses).all() else ():
            if np.abs(locus - locus[0]).max() > 1e-9:
                own = _normalise(locus)
                for way in (own, own.conj()):
                    for turn in _TURNS:
                        near = _distance(way * turn, goal, 40)
                        if near < best[0]:
                            best[:] = near, way * turn
                        least = min(least, near)
        return least

    try:
        while True:
            co_optimize([aim], config=CoOptimizationConfig(pop_size=_POPULATION, seed=seed, verbose=False))
            seed += 1
    except _TimeIsOver:
        return _distance(best[1], goal, 400)


def _normalise(locus: np.ndarray) -> np.ndarray:
    locus = locus - locus.mean()
    return locus / np.sqrt(np.mean(np.abs(locus) ** 2))


def _distance(one: np.ndarray, other: np.ndarray, count: int) -> float:
    """Mean distance of so many points, evenly along the curves, both ways added."""
    a, b = (_space(z, count) for z in (one, other))
    apart = np.abs(a[:, None] - b)
    return float(apart.min(axis=0).mean() + apart.min(axis=1).mean())


def _space(z: np.ndarray, count: int) -> np.ndarray:
    line = np.append(z, z[0])
    along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(line)))])
    at = np.linspace(0.0, along[-1], count, endpoint=False)
    return np.interp(at, along, line.real) + 1j * np.interp(at, along, line.imag)
