"""Least squares of mechanisms in space: place, size and turn, and what rides on a body; from sums over the targets.

With the way a of a body's point and the body's turns F the tracer is at t + R (s a + F k), and a frame on it is turned
by R F Q. For a given R the rest is linear, by sums that are the same for all R; for a given rest the best R and Q are
those of Kabsch. Both are found in turn.

Source: S. Umeyama, IEEE Trans. PAMI 13 (1991) 376-380; M. Shah, J. Mechanisms Robotics 5 (2013) 031007 (R F Q = T).
"""

from typing import Any, NamedTuple

import numpy as np

_RIDGE = 1e-10  # of each unknown's own weight: what nothing depends on stays as it is
_HELD = 1e8  # the same for a size at its bound
_SQUARED = 5  # times that a matrix is squared, until its largest eigenvalue is alone
_ROUNDS = 4  # times that the turn and the rest are fitted in turn


class Sums(NamedTuple):
    """Sums over the targets of designs; weights w, a and F of the mechanism, places p and turns T of the targets."""

    normal: np.ndarray  # of the normal equations for t, s and k, (L, 7, 7)
    target: np.ndarray  # Σ w p, (L, 3)
    square: np.ndarray  # Σ w p²
    way: np.ndarray  # Σ w p aᵀ, (L, 3, 3)
    rides: np.ndarray  # Σ w p_i F_jk, (L, 3, 3, 3)
    turns: np.ndarray  # Σ w T_ij F_kl, (L, 3, 3, 3, 3), times half the square of the length that an angle counts as
    total: np.ndarray  # Σ w of these, times that square, (L,)

    @classmethod
    def of(
        cls, a: np.ndarray, f: np.ndarray, p: np.ndarray, w: np.ndarray, t: Any = None, reach: float = 0.0
    ) -> "Sums":
        """Those of ways ``(L, M, 3)``, turns ``(L, M, 3, 3)``, places, weights ``(…, M)`` and turns that are wanted."""
        count, targets = a.shape[:2]
        heavy, flat = a * w[..., None], (f * w[..., None, None]).reshape(count, targets, 9)
        normal = np.zeros((count, 7, 7))
        every = np.broadcast_to(np.sum(w, axis=-1), count)[:, None]
        normal[:, [0, 1, 2], [0, 1, 2]] = normal[:, [4, 5, 6], [4, 5, 6]] = every
        normal[:, :3, 3] = heavy.sum(axis=1)
        normal[:, 3, 3] = np.sum(heavy * a, axis=(1, 2))
        normal[:, :3, 4:] = flat.sum(axis=1).reshape(count, 3, 3)
        normal[:, 3, 4:] = (heavy.reshape(count, 1, -1) @ f.reshape(count, -1, 3))[:, 0]
        lower = np.tril_indices(7, -1)
        normal[:, lower[0], lower[1]] = normal[:, lower[1], lower[0]]
        weighted = np.broadcast_to(p * w[..., None], a.shape)
        across = np.swapaxes(p, -1, -2)
        turns = np.zeros((count, 3, 3, 3, 3))
        if t is not None:
            turns = (0.5 * reach**2 * t.reshape(-1, 9).T @ flat).reshape(turns.shape)
        return cls(
            normal,
            weighted.sum(axis=1),
            np.sum(weighted * p, axis=(1, 2)),
            across @ heavy,
            (across @ flat).reshape(count, 3, 3, 3),
            turns,
            np.full(count, 0.0 if t is None else reach**2 * np.sum(w)),
        )

    def some(self, lanes: np.ndarray) -> "Sums":
        """Those of some designs."""
        return Sums(*(part[lanes] for part in self))

    def joined(self, other: "Sums") -> "Sums":
        """Those of these targets and of others."""
        return Sums(*(a + b for a, b in zip(self, other, strict=True)))


class Fit(NamedTuple):
    """Designs as they are fitted, each ``(L, …)``."""

    place: np.ndarray  # t, (L, 3)
    grown: np.ndarray  # s, (L,)
    turn: np.ndarray  # R, (L, 3, 3)
    tracer: np.ndarray  # k, (L, 3)
    frame: np.ndarray  # Q, (L, 3, 3)


class Freedom(NamedTuple):
    """What may be fitted: t along axes (all, or no turn), s within bounds, also a negative one, R, k, and Q."""

    axes: tuple[bool, ...]
    scale: bool
    mirror: bool
    turn: bool
    tracer: bool
    frame: bool


def begun(free: Freedom, sums: Sums, tracer: np.ndarray) -> Fit:
    """Where a fit begins, with tracers as they are drawn ``(L, 3)``: with turns that suit what is known by itself."""
    count = len(tracer)
    one = np.repeat(np.eye(3)[None], count, axis=0)
    fit = Fit(np.zeros((count, 3)), np.ones(count), one, tracer, one)
    if free.frame and free.turn:
        return fit._replace(turn=_common(sums.turns))
    ways = [_turned(free, sums, fit)]
    if not (free.mirror and free.turn):
        return ways[0]
    ways.append(_turned(free, sums, fit._replace(grown=-fit.grown)))
    none = np.zeros(count)
    one, other = (_solved(free, sums, way, none, none + np.inf)[1] for way in ways)
    return Fit(*(_where(one <= other, a, b) for a, b in zip(*ways, strict=True)))


def _where(good: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The first of each design that is good, and the second of the others."""
    return np.where(good.reshape(-1, *[1] * (a.ndim - 1)), a, b)


def fitted(free: Freedom, sums: Sums, fit: Fit, least: np.ndarray, most: np.ndarray) -> tuple[Fit, np.ndarray]:
    """The fit of designs that grow by at least and at most so much, from where it begins, and the squares left."""
    for _ in range(_ROUNDS if free.turn else 1):
        if free.frame:
            fit = fit._replace(frame=aligned(np.einsum("nijkl,nik->nlj", sums.turns, fit.turn)))
        fit, _ = _solved(free, sums, fit, least, most)
        fit = _turned(free, sums, fit)
    if free.frame:
        fit = fit._replace(frame=aligned(np.einsum("nijkl,nik->nlj", sums.turns, fit.turn)))
    fit, left = _solved(free, sums, fit, least, most)
    if free.frame:
        like = np.einsum("nijkl,nik,nlj->n", sums.turns, fit.turn, fit.frame)
        left = left + 3.0 * sums.total - 2.0 * like
    return fit, left


def aligned(g: np.ndarray) -> np.ndarray:
    """The rotations R ``(L, 3, 3)`` with the largest Σ R_ij G_ij."""
    left, _, right = np.linalg.svd(np.nan_to_num(g, posinf=0.0, neginf=0.0))
    out = left @ right
    left = left.copy()
    left[:, :, 2] *= np.sign(np.linalg.det(out))[:, None]
    return left @ right


def _turned(free: Freedom, sums: Sums, fit: Fit) -> Fit:
    """The best turn of designs, all else as it is; of those that move freely, about where they are best then."""
    if not free.turn:
        return fit
    g = fit.grown[:, None, None] * sums.way
    if free.tracer:
        g = g + (sums.rides @ fit.tracer[:, None, :, None])[..., 0]
    if all(free.axes):
        inner = fit.grown[:, None] * sums.normal[:, :3, 3]
        if free.tracer:
            inner = inner + (sums.normal[:, :3, 4:] @ fit.tracer[:, :, None])[..., 0]
        g = g - sums.target[:, :, None] * inner[:, None, :] / sums.normal[:, :1, :1]
    if free.frame:
        g = g + np.einsum("nijkl,nlj->nik", sums.turns, fit.frame)
    return fit._replace(turn=aligned(g))


def _solved(free: Freedom, sums: Sums, fit: Fit, least: np.ndarray, most: np.ndarray) -> tuple[Fit, np.ndarray]:
    """The best place, size and tracer of designs turned as they are, and the squares that are left of the places."""
    r = fit.turn
    side = np.zeros((len(r), 7))
    side[:, :3] = (np.swapaxes(r, 1, 2) @ sums.target[:, :, None])[..., 0] if all(free.axes) else sums.target
    side[:, 3] = np.sum(r * sums.way, axis=(1, 2))
    side[:, 4:] = np.einsum("nij,nijl->nl", r, sums.rides)
    use = np.array([*free.axes, True, *[free.tracer] * 3])
    y = np.zeros((len(r), 7))
    y[:, 3] = 1.0
    if free.scale:
        y[:, use] = _linear(sums.normal, side, use, y[:, 3], _RIDGE)
    held = y[:, 3]
    if free.scale:
        held = np.where(free.mirror & (held < 0.0), -1.0, 1.0) * np.clip(
            np.abs(held) if free.mirror else held, least, most
        )
    again = (held != y[:, 3]) | (not free.scale)
    if again.any():
        y[np.ix_(again, use)] = _linear(sums.normal[again], side[again], use, held[again], _HELD)
        y[again, 3] = held[again]
    left = sums.square + np.einsum("ni,ni->n", y, (sums.normal @ y[:, :, None])[..., 0] - 2.0 * side)
    place = (r @ y[:, :3, None])[..., 0] if all(free.axes) else y[:, :3]
    return fit._replace(place=place, grown=y[:, 3], tracer=y[:, 4:]), np.where(left > 0.0, left, 0.0 * left)


def _linear(normal: np.ndarray, side: np.ndarray, use: np.ndarray, size: np.ndarray, weight: float) -> np.ndarray:
    """The unknowns in use, the size drawn to some value with a weight."""
    normal, side = normal[:, use][:, :, use], side[:, use]
    at = int(np.sum(use[:3]))
    sizes = np.maximum(np.sqrt(np.diagonal(normal, axis1=1, axis2=2)), 1e-12)
    normal = normal / (sizes[:, :, None] * sizes[:, None, :]) + _RIDGE * np.eye(sizes.shape[1])
    side = side / sizes
    normal[:, at, at] += weight
    side[:, at] += weight * size * sizes[:, at]
    good = np.isfinite(normal).all(axis=(1, 2)) & np.isfinite(side).all(axis=1)
    out = np.full(side.shape, np.nan)
    out[good] = np.linalg.solve(normal[good], side[good, :, None])[..., 0] / sizes[good]
    return out


def _common(turns: np.ndarray) -> np.ndarray:
    """The turns R that suit R F Q = T best for any Q, nearly: the first singular vector of Σ T F, made a rotation."""
    matrix = np.nan_to_num(turns.transpose(0, 1, 3, 4, 2).reshape(-1, 9, 9), posinf=0.0, neginf=0.0)
    square = matrix @ np.swapaxes(matrix, 1, 2)
    for _ in range(_SQUARED):
        square = square / np.maximum(np.trace(square, axis1=1, axis2=2), 1e-300)[:, None, None]
        square = square @ square
    largest = np.argmax(np.diagonal(square, axis1=1, axis2=2), axis=1)
    r = square[np.arange(len(square)), :, largest].reshape(-1, 3, 3)
    return aligned(np.sign(np.linalg.det(r))[:, None, None] * r)
