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
_QUIET = 16  # loops in a row without a new solution
_WHOLE = 4  # of them, those that follow all solutions, if there are more than a few
_FEW = 10


@dataclasses.dataclass(frozen=True)
class Found:
    """Solutions of a member, and how they were found."""

    w: np.ndarray  # (n, solutions)
    loops: int  # how many loops there were
    quiet: int  # how many of them, at the end, without a new solution
    paths: int  # paths of all loops
    estimate: float  # how many solutions there may be, from how many ends of a loop were known: capture and recapture


def is_new(known: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Tell which columns are none of those known, nor of those before them."""
    n, before = known.shape
    every, new = np.concatenate([known, w], axis=1), np.ones(before + w.shape[1], bool)
    scale = SAME * np.maximum(1.0, np.abs(w).max(axis=0, initial=0.0))
    # Columns that are the same have nearly the same of any number that depends on them.
    number = np.real(np.exp(1j * np.arange(n)) @ every)
    order = np.argsort(number)
    low, high = (np.searchsorted(number[order], number[before:] + sign * n * scale) for sign in (-1.0, 1.0))
    for k, (first, last) in enumerate(zip(low, high, strict=True)):
        others = order[first:last]
        others = others[new[others] & (others < before + k)]
        new[before + k] = not (np.abs(every[:, others] - w[:, k : k + 1]).max(axis=0, initial=0.0) < scale[k]).any()
    return new[before:]


def run_loops(
    w: np.ndarray,
    loop: Callable[[], list[QuadraticPaths]],
    patience: int | None = None,
    sure: bool = False,
    begun: tuple[int, int] = (0, 0),
    keep: Callable[[Found], None] = lambda found: None,
) -> Found:
    """Find solutions ``(n, …)`` by loops from a member back to itself, until many in a row bring none.

    A single solution that is missing is found by nearly every loop in which all known ones are followed. Where
    solutions change places in blocks, a block that is missing is found by every other loop only, but by any of its
    ways. So a few loops follow all, and many more a few of them. `loop` makes the legs of another one. Two will do
    where the solutions are `sure` to be all.

    With `patience` the search ends when so many paths have gone to infinity: the legs then leave the family. A search
    that goes on has `begun` with the loops of a `Found`, and how many of them were quiet. What there is after each loop
    is given to `keep`.
    """
    loops, still = begun
    paths = diverged = 0
    found = Found(w, loops, still, 0, np.inf)
    while still < (2 if sure else _QUIET) and loops < _LOOPS:
        legs, done, before = loop(), 0, w.shape[1]
        whole, again = still < _WHOLE or before <= _FEW, 0  # of those known before, whose ends were known too
        some = slice(None) if whole else np.random.default_rng(loops).choice(before, _FEW, replace=False)
        while done < w.shape[1]:
            here, first, done = w[:, done:], not done, w.shape[1]
            here = here[:, some] if first else here
            for leg in legs:
                ends = leg.follow(here, BOLD)
                paths, diverged = paths + len(ends.arrived), diverged + int(ends.at_infinity.sum())
                here = ends.w[:, ends.arrived]
            new = is_new(w, here)
            again = int(np.sum(~new)) if first else again
            w = np.concatenate([w, here[:, new]], axis=1)
        loops += 1
        still = 0 if w.shape[1] > before else still + 1
        expected = before**2 / again if whole and again else found.estimate
        found = Found(w, loops, still, paths, expected)
        if patience is not None and diverged > patience + 0.005 * paths:
            return dataclasses.replace(found, quiet=0)
        keep(found)
    return found


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
