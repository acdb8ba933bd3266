"""All solutions of a generic member of a family of equations: by loops through other members, or by total degree.

Source: T. Duff, C. Hill, A. Jensen, K. Lee, A. Leykin and J. Sommars, Solving polynomial systems via homotopy
continuation and monodromy, IMA J. Numer. Anal. 39 (2019) 1421-1446.

The trace test says whether solutions of one member of a family are all that hang together with them.

Over a line of members, s being the place on it, solutions x are a curve. It meets ``(s - a) l(x) = t``, with a linear
l, in points whose sum is linear in t if, and only if, no point of the curve is missing. At t = 0 these are the
solutions of the member at s = a, and points at which l vanishes; so both are collected together, by loops of a, l and
t.

Source: A. Leykin, J. I. Rodriguez and F. Sottile, Trace test, Arnold Mathematical Journal 4 (2018) 113-125; J. D.
Hauenstein and J. I. Rodriguez, Multiprojective witness sets and a trace test, Advances in Geometry 20 (2020) 297-318.
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable

import numpy as np

from jaxnc.continuation.tracker import BOLD, USUAL, PathEnds, QuadraticPaths, follow, inverses

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

    With `patience` the search ends when so many paths have gone to infinity, or few came back from many loops: the legs
    then leave the family. A search that goes on has `begun` with the loops of a `Found`, and how many of them were
    quiet. What there is after each loop is given to `keep`.
    """
    loops, still = begun
    paths = diverged = lost = 0
    found = Found(w, loops, still, 0, np.inf)
    while still < (2 if sure else _QUIET) and loops < _LOOPS:
        legs, done, before = loop(), 0, w.shape[1]
        whole, again = still < _WHOLE or before <= _FEW, 0  # of those known before, whose ends were known too
        some = slice(None) if whole else np.random.default_rng(loops).choice(before, _FEW, replace=False)
        followed = back = 0
        while done < w.shape[1]:
            here, first, done = w[:, done:], not done, w.shape[1]
            here = here[:, some] if first else here
            followed += here.shape[1]
            for leg in legs:
                ends = leg.follow(here, BOLD)
                paths, diverged = paths + len(ends.arrived), diverged + int(ends.at_infinity.sum())
                here = ends.w[:, ends.arrived]
            back += here.shape[1]
            new = is_new(w, here)
            again = int(np.sum(~new)) if first else again
            w = np.concatenate([w, here[:, new]], axis=1)
        loops += 1
        astray = 2 * back < followed  # a loop from which few paths come back says nothing
        lost += astray
        still = 0 if w.shape[1] > before else still if astray else still + 1
        expected = before**2 / again if whole and again else found.estimate
        found = Found(w, loops, still, paths, expected)
        if patience is not None and (diverged > patience + 0.005 * paths or lost > _QUIET):
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


# -- the trace test ----------------------------------------------------------------------------------------------------


_ORDER = 5  # of the power series
_ROUND = 1e-15  # relative rounding of a point
_NOISE = 3.0  # times the rounding of all points: what is no part of a linear sum
_TRIES = 60
_THERE = 1e-6  # s of a solution of the member that the line begins at


class Sections:
    """Paths of the points in which a curve meets ``(s - a) l(x) = t``, from one such section to another.

    The curve is that of the solutions of `line`, paths of one target. A section is ``(a, t, l)``, l of 1 and x.
    """

    def __init__(self, line: QuadraticPaths, begin: np.ndarray, end: np.ndarray):
        self.line, self.begin, self.step = line, begin, end - begin

    def follow(self, w: np.ndarray) -> PathEnds:
        """Follow points ``(x, s)``, ``(n + 1, paths)``."""
        y = np.concatenate([np.ones((1, w.shape[1])), w[:-1]])
        with np.errstate(all="ignore"):
            ends = follow(self, np.concatenate([y / (self.line.patch @ y), w[-1:]]), USUAL)
            w, lanes = ends.w, np.arange(w.shape[1])
            for _ in range(2):
                w, _, _ = self.correct(w, np.ones(len(lanes)), lanes)
            return dataclasses.replace(ends, w=np.concatenate([w[1:-1] / w[0], w[-1:]]))

    def _products(self, powers: list[np.ndarray], y: list[np.ndarray], order: int) -> np.ndarray:
        """The term of an order of Q(s) Y, ``(lanes, n, 1 + n)``."""
        power, place = self.line.power, self.line.place
        parts = (powers[order - k][:, power] * y[k][:, place] for k in range(order + 1) if k < len(y))
        return self.line._apply(functools.reduce(np.add, parts), np.zeros(len(y[0]), int))

    def correct(
        self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray, keep: bool = True
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Take one of Newton's steps; see `jaxnc.continuation.tracker.Problem`."""
        del lanes, keep
        y, s, section = w[:-1].T, w[-1], self.begin + at[:, None] * self.step
        powers, slopes = np.swapaxes(self.line._weights(s, 1), 1, 2)
        g, slope = self._products([powers], [y], 0), self._products([slopes], [y], 0)
        off, value = s - section[:, 0], np.sum(section[:, 2:] * y, axis=1)
        n = self.line.n
        f = np.empty((len(y), n + 2), complex)
        f[:, :n] = np.matmul(g, y[:, :, None])[:, :, 0]
        f[:, n] = y @ self.line.patch - 1.0
        f[:, n + 1] = off * value - section[:, 1] * y[:, 0]
        matrix = np.zeros((len(y), n + 2, n + 2), complex)
        matrix[:, :n, : n + 1], matrix[:, :n, n + 1] = 2.0 * g, np.matmul(slope, y[:, :, None])[:, :, 0]
        matrix[:, n, : n + 1] = self.line.patch
        matrix[:, n + 1, : n + 1], matrix[:, n + 1, n + 1] = off[:, None] * section[:, 2:], value
        matrix[:, n + 1, 0] -= section[:, 1]
        linear = inverses(matrix)
        step = -np.matmul(linear, f[:, :, None])[:, :, 0].T
        size = np.abs(step).max(axis=0) / np.abs(w).max(axis=0)
        return w + step, linear, np.where(np.isfinite(size), size, np.inf)

    def series(self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray, linear: np.ndarray) -> list[np.ndarray]:
        """Find the power series; see `jaxnc.continuation.tracker.Problem`."""
        del lanes
        section, n = self.begin + at[:, None] * self.step, self.line.n
        y, s, out = [w[:-1].T], [w[-1]], []
        for m in range(1, _ORDER + 1):
            y.append(np.zeros_like(y[0]))
            s.append(np.zeros_like(s[0]))
            powers = self._power_series(s)
            g = [self._products(powers, y, order) for order in range(m + 1)]
            off = [s[0] - section[:, 0], s[1] - self.step[0], *s[2:]]
            value = [
                np.sum(section[:, 2:] * y[k], axis=1) + (y[k - 1] @ self.step[2:] if k else 0) for k in range(m + 1)
            ]
            rest = np.zeros((len(at), n + 2), complex)
            for k in range(m):
                rest[:, :n] += np.matmul(g[m - k], y[k][:, :, None])[:, :, 0]
            rest[:, n + 1] = sum(off[k] * value[m - k] for k in range(m + 1)) - self.step[1] * y[m - 1][:, 0]
            found = -np.matmul(linear, rest[:, :, None])[:, :, 0]
            y[m], s[m] = found[:, :-1], found[:, -1]
            out.append(found.T)
        return out

    def _power_series(self, s: list[np.ndarray]) -> list[np.ndarray]:
        """Terms of all powers of s, order by order, each ``(lanes, powers)``."""
        one = [np.ones_like(s[0]), *(np.zeros_like(s[0]) for _ in s[1:])]
        every = [one]
        for _ in range(self.line.degree - 1):
            last = every[-1]
            every.append([np.sum([last[i] * s[m - i] for i in range(m + 1)], axis=0) for m in range(len(s))])
        return [np.stack([power[m] for power in every], axis=1) for m in range(len(s))]

    def size(self, w: np.ndarray) -> np.ndarray:
        """Largest unknown of each path."""
        return np.maximum(np.abs(w[1:-1]).max(axis=0, initial=0.0) / np.abs(w[0]), np.abs(w[-1]))

    def growth(self, w: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """How fast each path goes to infinity, in parts of its size."""
        return np.abs(rate[0] / w[0])


def trace_solutions(
    line: QuadraticPaths, w: np.ndarray, rng: np.random.Generator, most: int = 2000
) -> tuple[np.ndarray, bool]:
    """Collect all solutions of the member at the beginning of a line that hang together with some, and test the sum.

    Args:
        line: paths of one target, to any other member.
        w: solutions at its beginning, ``(n, solutions)``.
        rng: for the sections.
        most: of points that may be collected; there are several times as many as solutions.

    Returns:
        The solutions, those that are given first, and whether the test has shown that none is missing.
    """

    def section() -> np.ndarray:
        drawn = rng.normal(size=line.n + 3) + 1j * rng.normal(size=line.n + 3)
        drawn[1] *= 10.0 ** rng.uniform(-2.0, 2.0)  # points far out are reached by sections far out
        return drawn

    home = section()
    plain = np.concatenate([[0.0, 0.0], home[2:]])
    ends = Sections(line, plain, home).follow(np.concatenate([w, np.zeros((1, w.shape[1]))]))
    points = ends.w[:, ends.arrived]
    points = points[:, is_new(points[:, :0], points)]
    for _ in range(_TRIES):
        done, around = 0, (home, section(), section(), home)
        while done < points.shape[1]:
            here, done = points[:, done:], points.shape[1]
            for begin, end in itertools.pairwise(around):
                ends = Sections(line, begin, end).follow(here)
                here = ends.w[:, ends.arrived]
            points = np.concatenate([points, here[:, is_new(points, here)]], axis=1)
        if points.shape[1] > most:
            break
        if _is_linear(line, home, points):
            ends = Sections(line, home, plain).follow(points)
            found = ends.w[:-1, ends.arrived & (np.abs(ends.w[-1]) < _THERE)]
            return np.concatenate([w, found[:, is_new(w, found)]], axis=1), True
    return w, False


def _is_linear(line: QuadraticPaths, home: np.ndarray, points: np.ndarray) -> bool:
    """Tell whether the sum of points is linear in t but for rounding: at t, and at t times the cube roots of one."""
    bent, noise, root = np.zeros(len(points), complex), np.zeros(len(points)), np.exp(2j * np.pi / 3)
    for turn in (1.0, root, root**2):
        there = np.concatenate([home[:1], home[1:2] * turn, home[2:]])
        ends = Sections(line, home, there).follow(points)
        again = Sections(line, there, there).follow(ends.w)  # how far rounding moves them
        if not (ends.arrived & again.arrived).all():
            return False
        bent += turn * ends.w.sum(axis=1)
        noise += np.abs(again.w - ends.w).sum(axis=1) + _ROUND * np.abs(ends.w).sum(axis=1)
    return bool((np.abs(bent) < _NOISE * noise).all())
