"""All solutions of a generic member of a family of equations: by loops through other members, or by total degree.

Source: T. Duff, C. Hill, A. Jensen, K. Lee, A. Leykin and J. Sommars, Solving polynomial systems via homotopy
continuation and monodromy, IMA J. Numer. Anal. 39 (2019) 1421-1446.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from jaxnc.continuation.quadratic import QuadraticPaths
from jaxnc.continuation.tracker import BOLD

SAME = 1e-6
"""Relative difference of two ends that are one solution."""

_LOOPS = 400
_QUIET = ((3, 16), (9, 8), (10**9, 4))  # loops in a row without a new solution, by how many are known


@dataclasses.dataclass(frozen=True)
class Found:
    """Solutions of a member, and how they were found."""

    w: np.ndarray  # (n, solutions)
    loops: int  # how many loops there were
    quiet: int  # how many of them, at the end, without a new solution
    lost: int  # paths that did not arrive, of all loops
    paths: int  # paths of all loops
    diverged: int  # lost ones that went to infinity, which paths between generic members of a family do not


def is_new(known: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Tell which columns are none of those known, nor of those before them."""
    new = np.ones(w.shape[1], bool)
    for k in range(w.shape[1]):
        scale = SAME * max(1.0, np.abs(w[:, k]).max(initial=0.0))
        others = np.concatenate([known, w[:, :k][:, new[:k]]], axis=1)
        new[k] = not (np.abs(others - w[:, k : k + 1]).max(axis=0, initial=0.0) < scale).any()
    return new


def run_loops(
    w: np.ndarray, loop: Callable[[], list[QuadraticPaths]], patience: int | None = None, sure: bool = False
) -> Found:
    """Find solutions ``(n, …)`` by loops from a member back to itself, until many in a row bring none.

    Of few solutions half of the loops change nothing; of many hardly any misses the last one. `loop` makes the legs of
    another one. Two will do where the solutions are `sure` to be all. With `patience` the search ends when so many
    paths have gone to infinity: the legs then leave the family.
    """
    still = loops = lost = paths = diverged = 0
    while still < (2 if sure else _enough(w.shape[1])) and loops < _LOOPS:
        legs, done, before = loop(), 0, w.shape[1]
        while done < w.shape[1]:
            here, done = w[:, done:], w.shape[1]
            for leg in legs:
                ends = leg.follow(here, BOLD)
                paths, lost = paths + len(ends.arrived), lost + int(np.sum(~ends.arrived))
                diverged += int(ends.at_infinity.sum())
                here = ends.w[:, ends.arrived]
            w = np.concatenate([w, here[:, is_new(w, here)]], axis=1)
        loops += 1
        still = 0 if w.shape[1] > before else still + 1
        if patience is not None and diverged > patience + 0.005 * paths:
            return Found(w, loops, 0, lost, paths, diverged)
    return Found(w, loops, still, lost, paths, diverged)


def _enough(count: int) -> int:
    """How many loops in a row without a new solution are enough, by how many are known."""
    return next(loops for most, loops in _QUIET if count <= most)


def solve_by_degree(t: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, bool]:
    """All solutions ``(n, …)`` of a system ``(equations, 1 + n, 1 + n)`` by its total degree.

    Returns:
        The finite regular solutions, and whether every other path went to infinity, so that there are no more.
    """
    n = len(t)
    t = t / np.abs(t).max(axis=(1, 2), keepdims=True)
    start = np.zeros_like(t, complex)
    root = np.exp(2j * np.pi * rng.random(n))
    start[np.arange(n), np.arange(1, n + 1), np.arange(1, n + 1)] = 1.0
    start[:, 0, 0] = -(root**2)
    turn = np.exp(2j * np.pi * rng.random(n))[:, None, None]
    signs = 1.0 - 2.0 * ((np.arange(2**n)[None] >> np.arange(n)[:, None]) & 1)
    paths = QuadraticPaths(np.stack([turn * start, t - turn * start])[None])
    ends = paths.follow(root[:, None] * signs, BOLD)
    size = np.abs(ends.w).max(axis=0)
    finite = ends.arrived & (size < 1e6)
    w = ends.w[:, finite]
    # Of a singular end nothing is known: a path beside it may have jumped, or a solution is a multiple one.
    here = QuadraticPaths(t[None, None])
    jacobian = here.evaluate(w, np.zeros(w.shape[1]), np.arange(w.shape[1]))[1]
    regular = np.array([1.0 / max(np.linalg.cond(j), 1.0) for j in jacobian]) > 1e-10
    new = is_new(np.zeros((n, 0)), w)
    far = ends.at_infinity | ends.arrived & ~finite
    return w[:, new & regular], bool((finite | far).all() and regular.all() and new.all())
