"""Two bars between a link and places that move in a known way: equations of many poses, and paths of their solutions.

At every pose but the first the link has turned by 1 + γ. A bar leads from q on the link to a place p, which moves by Δ.
The bar keeps its length if

    q (p' + Δ') γ + q' (p + Δ) γ' + (q + p) Δ' + (q' + p' + Δ') Δ = 0,    γ γ' + γ + γ' = 0.

The primed numbers are conjugates where a solution is real; as unknowns of their own they make these equations
polynomials, whose complex solutions can be followed from one problem to another, many at once. γ and γ' are eliminated
from the linear systems only: as unknowns they keep steps long.

p and Δ are sums of two more vectors r, so that z has eight numbers: q of both bars, q', r, r'.

Source: C. W. Wampler, A. P. Morgan and A. J. Sommese, Complete solution of the nine-point path synthesis problem for
four-bar linkages, J. Mech. Des. 114 (1992) 153-159.
"""

import abc
import dataclasses
import functools
import operator
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jaxnc import progress
from jaxnc.continuation.certificate import Twofold
from jaxnc.continuation.monodromy import is_new
from jaxnc.continuation.tracker import FAR, USUAL, Pace, PathEnds, follow, inverses
from jaxnc.synthesis.evaluate import map_threads

ORDER = 5
"""Terms of power series after the first."""

BLOCK = 384
"""Paths that are followed together."""


@dataclasses.dataclass(frozen=True)
class Places:
    """A term of the power series of what is known of the bars' places: p = b + Σ r, Δ = c + Σ s r.

    Each is a pair of arrays, of numbers and of their primed ones.
    """

    b: tuple[Any, Any]  # (bars, 1, lanes)
    c: tuple[Any, Any]  # (bars, poses - 1, lanes)
    s: tuple[Any, Any] | None = None  # of each vector r, (vectors, poses - 1, lanes); none where nothing turns


SINGULAR = 1e-7
"""Last step of Newton's, beside the solution: above, the end is singular."""

MIRRORED = [2, 3, 0, 1, 6, 7, 4, 5]
"""Places in z of primed numbers and of those without a prime."""

_REAL = 1e-4  # imaginary part, beside the solution, from which Newton's steps find out whether it is real


def _product(p: list, q: list, k: int) -> Any:
    """Coefficient k of a product of power series, whose terms may end early."""
    terms = [p[i] * q[k - i] for i in range(max(0, k - len(q) + 1), min(k, len(p) - 1) + 1)]
    return functools.reduce(operator.add, terms) if terms else 0.0


class BarPaths(abc.ABC):
    """Paths from one task to another, for `jaxnc.continuation.tracker`; each kind of task says what it knows.

    The unknowns of a path are z, then γ and γ' of every pose but the first.
    """

    pairs: tuple[tuple[int, int], ...]
    """A bar and a vector r that its place is a sum of, each."""

    def __init__(self, turns: int, wide: bool = False):
        self.turns, self.wide = turns, wide  # how many poses there are but the first; residuals of twice the digits
        entries = [(bar, bar + 2 * side) for side in (0, 1) for bar in (0, 1)]
        entries += [(bar, 4 + 2 * side + k) for side in (0, 1) for bar, k in self.pairs]
        bars, unknowns = zip(*entries, strict=True)
        self.bars, self.unknowns = np.array(bars), np.array(unknowns)  # of the derivative's entries
        self.of_bar = [np.flatnonzero(self.bars == bar) for bar in (0, 1)]

    @abc.abstractmethod
    def places(self, at: np.ndarray, order: int) -> list[Places]:
        """Power series of places about `at`, so many terms after the first; terms that are left out are zero."""

    @abc.abstractmethod
    def base(self, z: list[np.ndarray], at: np.ndarray) -> np.ndarray:
        """The last term of the series of the other equations, z being known so far, ``(8 - turns, lanes)``."""

    @abc.abstractmethod
    def base_slopes(self, z: np.ndarray, at: np.ndarray) -> Any:
        """Derivatives of the other equations to z, ``(8 - turns, 8, lanes)``, or what broadcasts to it."""

    def gather(self, r: Any) -> Any:
        """Sum up vectors for each bar."""
        if self.pairs == ((0, 0), (1, 1)):
            return r
        return np.stack([sum(r[k] for at, k in self.pairs if at == bar) for bar in (0, 1)])

    def turned(self, z: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Complete z to unknowns of paths: γ and γ' follow from both bars, unless they are known already.

        They do not follow where a linkage reaches a pose with two turns of its link.
        """
        if len(z) > 8:
            return z
        ends = BarEnds(self, self.places(at, 0), z)
        (u, v), (uu, vv), (w, r) = ends.u[0], ends.uu[0], ends.rest(0)
        return np.concatenate([z, *(np.stack([r * uu - w * vv, v * w - u * r]) / (u * vv - uu * v))])

    def correct(
        self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray, keep: bool = True
    ) -> tuple[np.ndarray, "Linearised", np.ndarray]:
        """Take one of Newton's steps; see `jaxnc.continuation.tracker.Problem`."""
        z, g = w[:8], w[8:].reshape(2, self.turns, -1)
        ends = BarEnds(self, self.places(at, 0), z)
        linear = linearise_bars(self, ends, g, self.base_slopes(z, at))
        dz, dg = linear.step(*self.residuals(z, g, ends), self.base([z], at))
        scale = np.abs(z).max(axis=0)
        size = np.abs(dz).max(axis=0) / scale
        # A link that only translates has γ = 0 at every pose: the moves of the bars' places measure its turns.
        moved = np.max([np.abs(part[0]).max(axis=(0, 1)) for part in ends.parts[6:]], axis=0) / scale
        size = np.maximum(size, np.abs(dg).max(axis=(0, 1)) / np.maximum(np.abs(g).max(axis=(0, 1)), moved))
        return w + np.concatenate([dz, *dg]), linear, np.where(np.isfinite(size), size, np.inf)

    def residuals(self, z: np.ndarray, g: np.ndarray, ends: "BarEnds") -> tuple[np.ndarray, np.ndarray]:
        """Residuals of bars and turns."""
        if not self.wide:
            return ends.u[0] * g[0] + ends.uu[0] * g[1] + ends.rest(0), g[0] * g[1] + g[0] + g[1]
        one, two, known = Twofold(g[0]), Twofold(g[1]), ends.known[0]
        x, xx, *rs = z.reshape(4, 2, 1, -1)
        out = []
        for bar in (0, 1):
            parts = []
            for side, r in enumerate(rs):
                p, move = Twofold(known.b[side][bar]), Twofold(known.c[side][bar])
                for k in (k for at, k in self.pairs if at == bar):
                    p = p + r[k]
                    move = move if known.s is None else move + Twofold(known.s[side][k]) * r[k]
                parts += [p, move]
            p, move, pp, back = parts
            to = pp + back
            value = to * x[bar] * one + (p + move) * xx[bar] * two + (p + x[bar]) * back + (to + xx[bar]) * move
            out.append(value.rounded())
        return np.stack(out), (one * two + one + two).rounded()

    def series(self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray, linear: "Linearised") -> list[np.ndarray]:
        """First coefficients of the paths' power series, those of z before those of γ: products are convolutions."""
        g = w[8:].reshape(2, self.turns, -1)
        zs, gs, out = [w[:8]], [[g[0]], [g[1]]], []
        ends = BarEnds(self, self.places(at, ORDER), w[:8])
        for k in range(1, ORDER + 1):
            zs.append(np.zeros_like(zs[0]))
            ends.push(zs)
            bars = ends.u[k] * g[0] + ends.uu[k] * g[1] + ends.rest(k)
            for i in range(1, k):
                bars = bars + ends.u[i] * gs[0][k - i] + ends.uu[i] * gs[1][k - i]
            turn: Any = sum((gs[0][i] * gs[1][k - i] for i in range(1, k)), start=np.zeros_like(g[0]))
            dz, dg = linear.step(bars, turn, self.base(zs, at))
            zs[k] = dz
            for series, value in zip(gs, dg, strict=True):
                series.append(value)
            out.append(np.concatenate([dz, *dg]))
            if k < ORDER:
                ends.push(zs)
        return out

    def size(self, w: np.ndarray) -> np.ndarray:
        """Largest unknown of each path, but for its turns."""
        return np.abs(w[:8]).max(axis=0, initial=0.0)

    def growth(self, w: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """How fast each path grows, in parts of its size."""
        return self.size(rate) / self.size(w)

    def follow(self, z: np.ndarray, pace: Pace = USUAL) -> PathEnds:
        """Follow solutions, with or without their turns, from the beginning to the end."""
        with np.errstate(all="ignore"):
            return follow(self, self.turned(z, np.zeros(z.shape[1])), pace)

    def polish(self, z: np.ndarray, steps: int = 4) -> tuple[np.ndarray, np.ndarray]:
        """Take some of Newton's steps at the end: solutions with their turns, and the last step's size beside them."""
        at, lanes = np.ones(z.shape[1]), np.arange(z.shape[1])
        with np.errstate(all="ignore"):
            w = self.turned(z, at)
            last = np.full(z.shape[1], np.inf)
            for _ in range(steps):
                w, _, last = self.correct(w, at, lanes, keep=False)
        return w, last

    def find_real(self, w: np.ndarray) -> np.ndarray:
        """The real ones of solutions with their turns at the end, exactly so.

        Newton's steps from the mean of two conjugates stay real.
        """
        mirrored = np.conj(w[[*MIRRORED, *np.roll(np.arange(8, len(w)), self.turns)]])
        scale = np.abs(w).max(axis=0, initial=0.0)
        near = np.abs(w - mirrored).max(axis=0, initial=0.0) < _REAL * scale
        tried, last = self.polish(0.5 * (w + mirrored)[:, near])
        same = np.abs(tried - w[:, near]).max(axis=0, initial=0.0) < _REAL * scale[near]
        return tried[:, same & (last < SINGULAR)]


def end_elsewhere(out: PathEnds, met: np.ndarray, none: np.ndarray, last: bool) -> np.ndarray:
    """Tell which paths end in no regular finite linkage, whose residuals have twice the digits.

    Args:
        out: their ends.
        met: which ones have met a regular solution.
        none: which of these are no linkages.
        last: whether they are not followed again: one that nearly meets another stops short of a regular end too.
    """
    # Steps come to nothing next to ends that are singular or at infinity. Growth on the way to infinity is some 1 / k;
    # what grows faster beside it may end far away.
    next_to = (1.0 - out.at < 1e-8) | ((out.size > FAR) & (out.growth < 1.2))
    there = (met & none) | out.at_infinity & next_to
    return there | (out.arrived & ~met) | out.singular & next_to if last else there


@dataclasses.dataclass(frozen=True)
class Attempt:
    """How those paths are followed that were lost before."""

    pace: Pace
    wide: bool = True
    cognate: int = 0  # which of the three members of a class of nine points goes
    bend: complex = 0.0  # where the way bends next to its end, as a part of all of it: about what is singular there


Follow = Callable[[Attempt, np.ndarray], PathEnds]
"""Follows the paths of some numbers by an attempt."""

Read = Callable[[np.ndarray], np.ndarray]
"""Reads numbers, or marks, off solutions."""


def follow_all(
    z: np.ndarray,
    attempts: Sequence[Attempt],
    follow: Follow,
    here: BarPaths,
    are_none: Read,
    expected: int,
    keys: Read = np.asarray,
    label: str = "",
) -> tuple[np.ndarray, int]:
    """Follow all paths from solutions, and those that are lost again, by one attempt after another.

    It ends with as many solutions as are `expected`, for paths that are left have none to end in. Returns the regular
    finite ends `here` with their turns, told apart by their `keys`, and how many paths are lost: they ended neither
    there nor at infinity, nor in a singular solution or a linkage that is none. With a label a bar shows how far an
    attempt is.
    """
    every = np.arange(z.shape[1])
    ends, good, elsewhere = np.zeros((8 + 2 * here.turns, len(every)), complex), every < 0, every < 0

    def alone(order: np.ndarray) -> np.ndarray:
        """Mark the good ends that are none of those before them."""
        out, lanes = np.zeros(len(good), bool), order[good[order]]
        out[lanes] = mark_distinct(ends[:, lanes], keys)
        return out

    for attempt in attempts:
        rest = np.flatnonzero(~good & ~elsewhere)
        if not len(rest) or good.sum() >= expected:
            break
        blocks = np.array_split(rest, max(1, len(rest) // BLOCK))
        with progress.bar(len(rest), label, "path", None if label else False, leave=False) as shown:
            found = map_threads(functools.partial(_follow_and_show, follow, attempt, shown.update), blocks)
        for lanes, out in zip(blocks, found, strict=True):
            w, last = here.polish(out.w)
            with np.errstate(all="ignore"):
                none = are_none(w[:8])
            met = out.arrived & (last < SINGULAR)
            ends[:, lanes], good[lanes] = w, met & ~none
            if attempt.wide:  # else rounding passes for growth
                elsewhere[lanes] = end_elsewhere(out, met, none, attempt is attempts[-1])
        if attempt.wide:  # what is known stays, and what is met again was lost
            good = alone(np.concatenate([np.setdiff1d(every, rest), rest]))
        else:  # of two paths that met in one end either may have left its own
            good = alone(every) & alone(every[::-1])
    return ends[:, good], int((~good & ~elsewhere).sum())


def _follow_and_show(follow: Follow, attempt: Attempt, show: Callable, lanes: np.ndarray) -> PathEnds:
    out = follow(attempt, lanes)
    show(len(lanes))
    return out


def mark_distinct(z: np.ndarray, keys: Read = np.asarray) -> np.ndarray:
    """Mark the solutions that are none of those before them, by numbers that tell them apart."""
    known = keys(z)
    return is_new(known[:, :0], known)


def follow_routes(
    route: Callable[[int], tuple[np.ndarray, int]], most: int, expected: int, keys: Read = np.asarray
) -> tuple[np.ndarray, int, int]:
    """Follow all paths on ways of their own until none is lost: the ends, how many ways, how many ends are missing."""
    ends, lost = route(0)
    routes, expected = 1, min(expected, ends.shape[1] + lost)
    while routes < most and ends.shape[1] < expected:
        found, lost = route(routes)
        ends = np.concatenate([ends, found], axis=1)
        ends = ends[:, mark_distinct(ends, keys)]
        routes, expected = routes + 1, min(expected, found.shape[1] + lost)
    return ends, routes, max(expected - ends.shape[1], 0)


class BarEnds:
    """Power series of the ends of both bars, and of the parts of their equations, from the first term of z's on."""

    def __init__(self, paths: BarPaths, known: list[Places], z: np.ndarray):
        self.paths, self.known = paths, known
        self.u: list = []
        self.uu: list = []
        # q, q', q + p, p' + Δ', p + Δ, q' + p' + Δ', Δ, Δ'
        self.parts: list[list] = [[] for _ in range(8)]
        self.rs: list[list] = [[], []]
        self.turns = [[term.s[side] for term in known if term.s is not None] for side in (0, 1)]
        self.push([z])

    def push(self, zs: list[np.ndarray]) -> None:
        """Take the last term of z's series, anew if it was there before."""
        k, known = len(zs) - 1, self.known
        q, qq, *rs = zs[k].reshape(4, 2, 1, -1)
        ends: list[Any] = []
        for side, r in enumerate(rs):
            del self.rs[side][k:]
            self.rs[side].append(r)
            p, move = self.paths.gather(r), None
            if k < len(known):
                p, move = p + known[k].b[side], known[k].c[side]
            if self.turns[side]:
                turned = self.paths.gather(_product(self.turns[side], self.rs[side], k))
                move = turned if move is None else move + turned
            ends += [p, move]
        p, move, pp, back = ends
        to, fro = (pp, p) if back is None else (pp + back, p + move)
        for series, value in zip(self.parts, (q, qq, q + p, to, fro, qq + to, move, back), strict=True):
            del series[k:]
            if value is not None:
                series.append(value)
        for series, one, two in ((self.u, 0, 3), (self.uu, 1, 4)):
            del series[k:]
            series.append(_product(self.parts[one], self.parts[two], k))

    def rest(self, k: int) -> Any:
        """Coefficient k of what γ and γ' are not in."""
        return _product(self.parts[2], self.parts[7], k) + _product(self.parts[5], self.parts[6], k)


@dataclasses.dataclass(frozen=True)
class Linearised:
    """The equations' derivative at a solution, and the step that takes away what they leave; see `linearise_bars`."""

    paths: BarPaths
    inverse: np.ndarray  # of the equations of z without γ and γ', (lanes, 8, 8)
    q: np.ndarray  # what multiplies γ and γ' in their own equation
    u: np.ndarray  # what multiplies γ in those of the bars
    uu: np.ndarray  # and γ'
    minors: np.ndarray  # of these three columns
    slopes: np.ndarray  # of the bars' equations to z

    def step(self, bars: np.ndarray, turn: np.ndarray, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Changes of z and γ that take away what the equations of bars, turns and base leave."""
        rest = self.minors[2] * turn - (self.minors[:2] * bars).sum(axis=0)
        dz = np.matmul(self.inverse, np.concatenate([rest, -base]).T[:, :, None])[:, :, 0].T
        moved = self.slopes * dz[self.paths.unknowns][:, None]
        left, right = (bars[bar] + moved[self.paths.of_bar[bar]].sum(axis=0) for bar in (0, 1))
        (u, v), (uu, vv), (q, qq) = self.u, self.uu, self.q
        one, two, three = self.minors
        # Two of three equations give γ, γ': those whose determinant is largest.
        sizes = np.abs(self.minors)
        by_turn = np.maximum(sizes[0], sizes[1]) > sizes[2]
        first = sizes[1] > sizes[0]
        bar, barred, rest = np.where(first, u, v), np.where(first, uu, vv), np.where(first, left, right)
        det = np.where(first, two, -one)
        dg = np.where(by_turn, (barred * turn - qq * rest) / det, (uu * right - vv * left) / three)
        dgg = np.where(by_turn, (q * rest - bar * turn) / det, (v * left - u * right) / three)
        return dz, np.stack([dg, dgg])

    def __getitem__(self, lanes: np.ndarray) -> "Linearised":
        """Select some lanes."""
        parts = (part[..., lanes] for part in (self.q, self.u, self.uu, self.minors, self.slopes))
        return Linearised(self.paths, self.inverse[lanes], *parts)


def linearise_bars(paths: BarPaths, ends: BarEnds, g: np.ndarray, base: Any) -> Linearised:
    """Derive the equations at a solution, of which `base` are the rows of those without turns."""
    q, u, uu, n = g[::-1] + 1.0, ends.u[0], ends.uu[0], paths.turns
    bar, mirrored, _, barred, there, _, move, back = (part[0] for part in ends.parts)
    s = ends.known[0].s
    # What is orthogonal to both columns (u, v, q) and (u', v', q'): rows of the equations without γ and γ'.
    minor = q[0] * uu - q[1] * u
    minors = np.stack([minor[1], -minor[0], u[0] * uu[1] - uu[0] * u[1]])
    of_q = barred * g[0] + back, there * g[1] + move
    of_r = mirrored * g[1] + back, bar * g[0] + move
    of_move = () if s is None else (mirrored * q[0] + barred, bar * q[1] + there)
    parts = [side[at] for side in of_q for at in (0, 1)]
    for side in (0, 1):
        for at, k in paths.pairs:
            slope = of_r[side][at]
            parts.append(slope if s is None else slope + s[side][k] * of_move[side][at])
    slopes = np.stack(parts)
    weighted = minors[paths.bars] * slopes
    rows = np.zeros((8, 8, g.shape[2]), complex)
    for slope, unknown in zip(weighted, paths.unknowns, strict=True):
        rows[:n, unknown] += slope
    rows[n:] = base
    inverse = inverses(np.moveaxis(rows, 2, 0))
    return Linearised(paths, inverse, q, u, uu, minors, slopes)
