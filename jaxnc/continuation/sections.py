"""The trace test: whether solutions of one member of a family are all that hang together with them.

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

import numpy as np

from jaxnc.continuation.monodromy import is_new
from jaxnc.continuation.quadratic import QuadraticPaths, inverses
from jaxnc.continuation.tracker import USUAL, PathEnds, follow

_ORDER = 5  # of the power series
_ROUND = 1e-15  # relative rounding of a point
_NOISE = 3.0  # times the rounding of all points: what is no part of a linear sum
_LOOPS = 60
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
        powers, slopes = self.line._weights(s, 1)
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
    for _ in range(_LOOPS):
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
