"""Two dyads that carry a point through precision points: their equations, and paths of solutions, many at once.

Seen from the first point a dyad stands at a, and x leads from its moving pivot to the point. At another point, at δ,
the coupler has turned by 1 + γ, and the bar has its length if

    x (a' - δ') γ + x' (a - δ) γ' + δ (δ' - a' - x') - δ' (a + x) = 0,    γ γ' + γ + γ' = 0.

The primed numbers are conjugates where a solution is real; as unknowns of their own they make these equations
polynomials, whose complex solutions can be followed from one problem to another. γ and γ' are eliminated from the
linear systems only: as unknowns they keep steps long.

Source: C. W. Wampler, A. P. Morgan and A. J. Sommese, Complete solution of the nine-point path synthesis problem for
four-bar linkages, J. Mech. Des. 114 (1992) 153-159.
"""

import dataclasses

import numpy as np

from jaxnc.types import Any

FAR = 1e7
"""Beside points of size one: a solution beyond is at infinity."""

_FLOOR = 1e-8  # relative size of a second correction that counts as rounding
_LEAST = 1e-10  # shortest step
_LONGEST = 0.2


@dataclasses.dataclass(frozen=True)
class Task:
    """Precision points and what is known of the base, with conjugates as numbers of their own."""

    d: np.ndarray  # δ, (points - 1,)
    e: np.ndarray  # δ'
    matrix: np.ndarray  # conditions on the fixed pivots (a, b, a', b'), (9 - points, 4)
    right: np.ndarray  # their right-hand sides

    def parts(self) -> tuple[np.ndarray, ...]:
        """The four arrays, with an axis for lanes."""
        return tuple(part[..., None] for part in (self.d, self.e, self.matrix, self.right))


@dataclasses.dataclass(frozen=True)
class Followed:
    """Ends of paths."""

    z: np.ndarray  # x, y, x', y', a, b, a', b' at the end of each, (8, lanes)
    arrived: np.ndarray  # which ones got there
    at: np.ndarray  # how far the others got, 0 … 1


def turns(z: np.ndarray, d: Any, e: Any) -> np.ndarray:
    """γ and γ' of every point but the first, ``(2, points - 1, lanes)``, from both bars."""
    x, xx, a, aa = z.reshape(4, 2, 1, -1)
    (u, v), (uu, vv) = x * (aa - e), xx * (a - d)
    w, r = d * (e - aa - xx) - e * (a + x)
    return np.stack([r * uu - w * vv, v * w - u * r]) / (u * vv - uu * v)


def inverses(lanes: np.ndarray) -> np.ndarray:
    """Inverse matrices, ``(lanes, 8, 8)``: of those that are singular to the last bit of neighbours, or no numbers."""
    try:
        return np.linalg.inv(lanes)
    except np.linalg.LinAlgError:
        nudge = 1e-15 * np.abs(lanes).max(axis=(1, 2), keepdims=True) * np.vander(np.linspace(-1.0, 1.0, 8))
        lanes = np.where(np.linalg.det(lanes)[:, None, None] == 0.0, lanes + nudge, lanes)
        some, found = np.linalg.det(lanes) != 0.0, np.full_like(lanes, np.nan)
        found[some] = np.linalg.inv(lanes[some])
        return found


class _Linear:
    """The equations' derivative at a solution, and the step that takes away what they leave."""

    def __init__(self, z: np.ndarray, g: np.ndarray, d: Any, e: Any, matrix: np.ndarray):
        x, xx, a, aa = z.reshape(4, 2, 1, -1)
        n = len(d)
        self.q = g[::-1] + 1.0
        self.u, self.uu = x * (aa - e), xx * (a - d)
        # What is orthogonal to both columns (u, v, q) and (u', v', q'): rows of the equations without γ and γ'.
        minor = self.q[0] * self.uu - self.q[1] * self.u
        self.minors = np.stack([minor[1], -minor[0], self.u[0] * self.uu[1] - self.uu[0] * self.u[1]])
        self.slopes = np.stack([(aa - e) * g[0] - e, (a - d) * g[1] - d, xx * g[1] - e, x * g[0] - d])
        rows = np.zeros((8, 8, z.shape[1]), complex)
        rows[:n] = np.moveaxis(self.minors[:2] * self.slopes, 2, 0).reshape(n, 8, -1)
        rows[n:, 4:] = matrix
        lanes = np.moveaxis(rows, 2, 0)
        lanes[~np.isfinite(lanes).all(axis=(1, 2))] = np.eye(8)
        self.inverse = inverses(lanes)

    def step(self, bars: np.ndarray, turn: np.ndarray, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Changes of z and γ that take away what the equations of bars, turns and base leave."""
        rest = self.minors[2] * turn - (self.minors[:2] * bars).sum(axis=0)
        dz = np.matmul(self.inverse, np.concatenate([rest, -base]).T[:, :, None])[:, :, 0].T
        left, right = bars + (self.slopes * dz.reshape(4, 2, 1, -1)).sum(axis=0)
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

    def of(self, lanes: np.ndarray) -> "_Linear":
        """The same for some of the lanes."""
        out = object.__new__(_Linear)
        for name in ("q", "u", "uu", "minors", "slopes"):
            setattr(out, name, getattr(self, name)[..., lanes])
        out.inverse = self.inverse[lanes]
        return out


def _left(z: np.ndarray, g: np.ndarray, d: Any, e: Any, matrix: np.ndarray, right: np.ndarray) -> tuple:
    """What the equations of bars, turns and base leave."""
    x, xx, a, aa = z.reshape(4, 2, 1, -1)
    bars = x * (aa - e) * g[0] + xx * (a - d) * g[1] + d * (e - aa - xx) - e * (a + x)
    return bars, g[0] * g[1] + g[0] + g[1], (matrix * z[4:]).sum(axis=1) - right


def _product(p: list, q: list, k: int, first: int = 0) -> Any:
    """Coefficient k of a product of power series, without the outer ``first`` terms of either."""
    return sum((p[i] * q[k - i] for i in range(first, k + 1 - first)), start=np.zeros_like(p[0]))


def _series(z: np.ndarray, g: np.ndarray, parts: tuple, rates: tuple, linear: _Linear) -> list[np.ndarray]:
    """Coefficients one to three of a path's power series, those of z before those of γ: products are convolutions."""
    (d, e, _, _), (dd, de, dm, dr) = parts, rates
    zs, gs = [z], [list(g)[:1], list(g)[1:]]
    pieces: list[list] = [[] for _ in range(8)]

    def push(k: int, z: np.ndarray) -> None:
        x, xx, a, aa = z.reshape(4, 2, 1, -1)
        at = ((d, e), (dd, de))[k] if k < 2 else (0.0, 0.0)
        for series, value in zip(pieces, (x, xx, aa - at[1], a - at[0], at[1] - aa - xx, a + x), strict=False):
            del series[k:]
            series.append(value)
        for series, one, two in ((pieces[6], 0, 2), (pieces[7], 1, 3)):
            del series[k:]
            series.append(_product(pieces[one], pieces[two], k))

    push(0, z)
    out = []
    for k in (1, 2, 3):
        push(k, np.zeros_like(z))
        u, uu, w, r = pieces[6], pieces[7], pieces[4], pieces[5]
        bars = u[k] * g[0] + uu[k] * g[1] + d * w[k] + dd * w[k - 1] - e * r[k] - de * r[k - 1]
        for i in range(1, k):
            bars = bars + u[i] * gs[0][k - i] + uu[i] * gs[1][k - i]
        base = (dm * zs[k - 1][4:]).sum(axis=1) - (dr if k == 1 else 0.0)
        dz, dg = linear.step(bars, _product(gs[0], gs[1], k, first=1), np.broadcast_to(base, (len(dm), z.shape[1])))
        zs.append(dz)
        for series, value in zip(gs, dg, strict=True):
            series.append(value)
        out.append(np.concatenate([dz, *dg]))
        if k < 3:
            push(k, dz)
    return out


def _corrected(w: np.ndarray, parts: tuple) -> tuple[np.ndarray, _Linear, np.ndarray]:
    """One of Newton's steps: what comes out, the derivative used, the step's size beside the unknowns."""
    n = len(parts[0])
    z, g = w[:8], w[8:].reshape(2, n, -1)
    linear = _Linear(z, g, *parts[:3])
    dz, dg = linear.step(*_left(z, g, *parts))
    size = np.abs(dz).max(axis=0) / np.abs(z).max(axis=0)
    size = np.maximum(size, np.abs(dg).max(axis=(0, 1)) / np.abs(g).max(axis=(0, 1)))
    return w + np.concatenate([dz, *dg]), linear, np.where(np.isfinite(size), size, np.inf)


def polished(z: np.ndarray, task: Task, steps: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Solutions of a task after Newton's steps, and the size of the last step beside them, ``(lanes,)``."""
    parts = task.parts()
    with np.errstate(all="ignore"):
        w = np.concatenate([z, *turns(z, *parts[:2])])
        last = np.full(z.shape[1], np.inf)
        for _ in range(steps):
            w, _, last = _corrected(w, parts)
    return w[:8], last


def follow(z: np.ndarray, start: Task, end: Task, accuracy: float = 5e-5, most: int = 3000) -> Followed:
    """Follow solutions of one task to those of another, in a straight line between the two.

    Predicted by Padé approximants of power series, corrected by two of Newton's steps, each lane with its own step.

    Source: P. Breiding and S. Timme, HomotopyContinuation.jl (2018), for Padé predictors; the elimination is own.

    A smaller `accuracy`, the relative error of a prediction to aim for, is safer and slower. What is under way after
    the `most` rounds is given up.
    """
    lanes = z.shape[1]
    here, there = start.parts(), end.parts()
    rates = tuple(b - a for a, b in zip(here, there, strict=True))
    out = Followed(np.array(z), np.zeros(lanes, bool), np.zeros(lanes))
    alive, at, h = np.arange(lanes), np.zeros(lanes), np.full(lanes, 0.02)
    with np.errstate(all="ignore"):
        g = turns(z, *here[:2])
        w = np.concatenate([z, *g])
        one, two, three = _series(z, g, here, rates, _Linear(z, g, *here[:3]))
        for _ in range(most):
            if not len(alive):
                break
            last = h >= (1.0 - at) * (1.0 - 1e-12)
            h = np.minimum(h, 1.0 - at)
            then = np.where(last, 1.0, at + h)
            parts = tuple(a * (1.0 - then) + b * then for a, b in zip(here, there, strict=True))
            down = 1.0 - np.where(np.isfinite(three / two), three / two, 0.0) * h
            bend = np.where(np.abs(down) > 0.2, two / down, two + three * h)
            trial, _, first = _corrected(w + (one + bend * h) * h, parts)
            trial, linear, second = _corrected(trial, parts)
            good = (first < 10 * accuracy) & ((second <= 0.02 * first) & (second < 1e-7) | (second < _FLOOR))
            factor = np.clip((accuracy / np.maximum(first, 1e-16)) ** 0.25, 0.2, 2.0)
            shrink = np.clip((0.002 * first / np.maximum(second, 1e-300)) ** 0.25, 0.2, 2.0)
            factor = np.where(second > _FLOOR, np.minimum(factor, shrink), factor)
            h = np.minimum(h * np.where(good, factor, np.minimum(0.5, factor)), _LONGEST)
            if good.any():
                w[:, good], at[good] = trial[:, good], then[good]
                z, g = w[:8, good], w[8:, good].reshape(2, len(start.d), -1)
                new = _series(z, g, tuple(part[..., good] for part in parts), rates, linear.of(good))
                for series, value in zip((one, two, three), new, strict=True):
                    series[:, good] = value
            done = good & last
            over = done | (h < _LEAST) | ~(np.abs(w[:8]).max(axis=0) < 10 * FAR)
            if over.any():
                out.z[:, alive[over]], out.at[alive[over]] = w[:8, over], at[over]
                out.arrived[alive[done]] = True
                stay = ~over
                alive, at, h = alive[stay], at[stay], h[stay]
                w, one, two, three = (value[:, stay] for value in (w, one, two, three))
    out.z[:, alive], out.at[alive] = w[:8], at
    return out
