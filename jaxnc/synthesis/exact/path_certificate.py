"""Certificates of linkages through precision points: the equations as quadratic ones with real coefficients.

Products such as x a' and x' a as unknowns of their own make the bars' equations quadratic in them, x and γ; the real
and imaginary parts of a number and of its primed one are what stands for the two.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxnc.continuation.certificate import are_disjoint, certify
from jaxnc.continuation.twofold import Twofold
from jaxnc.errors import counted
from jaxnc.synthesis.exact.bar_paths import Places

_ROUND = 2.0**-52
_TWICE = 2.0**-98  # of one product and sum with twice the digits; their rounding is below 2^-100


def certify_linkages(
    w: np.ndarray, d: np.ndarray, e: np.ndarray, matrix: np.ndarray, right: np.ndarray
) -> tuple[np.ndarray, bool]:
    """Find which real solutions are proved to exist and to be alone, and whether those are all proved different.

    Args:
        w: solutions and their turns, x, x', a, a' of two dyads each, γ and γ' of every point but the first.
        d: δ, places of the points seen from the first.
        e: δ'.
        matrix: conditions on the fixed pivots.
        right: their right-hand sides.

    The proof is of the equations with these very numbers: conditions of 1e9 leave none for others beside them.
    """
    z, turns = w[:8].reshape(4, 2, -1), w[8:].reshape(2, len(d), -1)
    one = np.concatenate([z[0], z[2], z[0] * z[3], turns[0]])
    primed = np.concatenate([z[1], z[3], z[1] * z[2], turns[1]])
    unknowns = np.real(np.concatenate([(one + primed) / 2, (one - primed) / 2j]))
    equations = _real_equations(d, e, matrix, right)
    # |δ|² is the only coefficient that rounding has touched.
    low = np.zeros(len(equations))
    bars = (np.arange(2)[:, None] * (2 + len(d)) + 2 + np.arange(len(d))).ravel()
    low[bars] = np.tile(np.real((Twofold(d) * e - d * e).rounded()), 2)
    balls = certify(equations, unknowns, _residuals(equations, low, unknowns))
    return balls.real, are_disjoint(unknowns, balls)


def _residuals(equations: np.ndarray, low: np.ndarray, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values of the equations with twice the digits, and a bound of their error, ``(solutions, n)`` both."""
    y = np.concatenate([np.ones((1, unknowns.shape[1])), unknowns])
    upper = np.triu(equations) + np.triu(equations, 1)
    most = int((upper != 0.0).sum(axis=(1, 2)).max())
    first, second, factor = np.zeros((3, most, len(equations)))
    for r, form in enumerate(upper):
        i, j = np.nonzero(form)
        first[: len(i), r], second[: len(i), r], factor[: len(i), r] = i, j, form[i, j]
    total, large = Twofold(np.broadcast_to(low[:, None], (len(low), y.shape[1]))), 0.0
    for i, j, c in zip(first.astype(int), second.astype(int), factor[:, :, None], strict=True):
        total = total + Twofold(y[i]) * y[j] * c
        large = large + np.abs(y[i] * y[j] * c)
    value = np.real(total.rounded())
    return value.T, (_TWICE * (most + 4) * large + _ROUND * np.abs(value)).T


def _real_equations(d: np.ndarray, e: np.ndarray, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Quadratic forms of all equations, ``(n, 1 + n, 1 + n)``, in real parts and then imaginary ones."""
    count = len(d)
    half = 6 + count  # x, a, x a' of two dyads each, γ
    rows: list[np.ndarray] = []

    def equation(*terms: tuple[complex, int, int]) -> np.ndarray:
        form = np.zeros((1 + 2 * half, 1 + 2 * half), complex)
        for value, p, q in terms:
            form[p, q] += value / 2
            form[q, p] += value / 2
        return form

    for j in range(2):
        x, a, n = 1 + j, 3 + j, 5 + j
        xx, aa, nn = (k + half for k in (x, a, n))
        product, mirrored = equation((1, n, 0), (-1, x, aa)), equation((1, nn, 0), (-1, xx, a))
        rows += [product + mirrored, (product - mirrored) / 1j]
        for k in range(count):
            g, dk, ek = 7 + k, d[k], e[k]
            gg = g + half
            rows.append(equation((1, n, g), (-ek, x, g), (1, nn, gg), (-dk, xx, gg), (dk * ek, 0, 0),
                                 (-dk, aa, 0), (-dk, xx, 0), (-ek, a, 0), (-ek, x, 0)))  # fmt: skip
    rows += [equation((1, g, g + half), (1, g, 0), (1, g + half, 0)) for g in range(7, 7 + count)]
    places = (3, 4, 3 + half, 4 + half)
    for row, value in zip(matrix, right, strict=True):
        rows.append(equation((-value, 0, 0), *((c, place, 0) for c, place in zip(row, places, strict=True))))
    return _as_real(np.array(rows))


def _as_real(forms: np.ndarray) -> np.ndarray:
    """Quadratic forms of numbers and then their primed ones as forms of their real and imaginary parts."""
    half = (forms.shape[1] - 1) // 2
    turn = np.zeros((1 + 2 * half, 1 + 2 * half), complex)
    turn[0, 0] = 1.0
    k = np.arange(half)
    turn[1 + k, 1 + k] = turn[1 + half + k, 1 + k] = 1.0
    turn[1 + k, 1 + half + k], turn[1 + half + k, 1 + half + k] = 1j, -1j
    return np.real(turn.T @ forms @ turn)


def certify_six_bars(
    w: np.ndarray, pairs: Sequence[tuple[int, int]], known: Places, which: tuple[int, int], square: Any
) -> tuple[np.ndarray, bool]:
    """Find which real solutions are proved to exist and to be alone, and whether those are all proved different.

    Args:
        w: solutions and their turns, see `jaxnc.synthesis.exact.bar_paths`.
        pairs: bars, and the vectors r that their places are sums of.
        known: what is known of the places.
        which: the vector whose length is given, and its primed one.
        square: the square of the length.

    The proof is of the equations with these very numbers.
    """
    count = known.c[0].shape[1]
    z, turns = w[:8].reshape(4, 2, -1), w[8:].reshape(2, count, -1)
    made = [np.stack([z[side][bar] * z[3 - side][k] for bar, k in pairs]) for side in (0, 1)]  # q r' and q' r
    one, primed = (np.concatenate([z[side], z[2 + side], made[side], turns[side]]) for side in (0, 1))
    unknowns = np.real(np.concatenate([(one + primed) / 2, (one - primed) / 2j]))
    half, first = len(one), 1 + 4 + len(pairs)  # where γ begins
    size = 1 + 2 * half
    units = np.eye(size, dtype=complex)
    q, r, n = units[1:3], units[3:5], units[5 : 5 + len(pairs)]

    def other(v: np.ndarray) -> np.ndarray:
        return np.concatenate([v[..., :1], v[..., 1 + half :], v[..., 1 : 1 + half]], axis=-1)

    def times(v: np.ndarray, u: np.ndarray) -> np.ndarray:
        return (np.outer(v, u) + np.outer(u, v)) / 2

    (b, bb), (c, cc), s = known.b, known.c, known.s
    assert s is not None
    rows = []
    for at, (bar, k) in enumerate(pairs):
        product = times(units[0], n[at]) - times(q[bar], other(r[k]))
        mirrored = times(units[0], other(n[at])) - times(other(q[bar]), r[k])
        rows += [product + mirrored, (product - mirrored) / 1j]
    for j in range(count):
        g = units[first + j]
        for bar in (0, 1):
            mine = [(at, k) for at, (which_bar, k) in enumerate(pairs) if which_bar == bar]
            p, pp = (v[bar, 0, 0] * units[0] for v in (b, bb))
            move, back = c[bar, j, 0] * units[0], cc[bar, j, 0] * units[0]
            there, barred = (p + move)[0] * other(q[bar]), (pp + back)[0] * q[bar]  # q' (p + Δ) and q (p' + Δ')
            for at, k in mine:
                p, pp = p + r[k], pp + other(r[k])
                move, back = move + s[0][k, j, 0] * r[k], back + s[1][k, j, 0] * other(r[k])
                there = there + (1.0 + s[0][k, j, 0]) * other(n[at])
                barred = barred + (1.0 + s[1][k, j, 0]) * n[at]
            bars = times(barred, g) + times(there, other(g))
            rows.append(bars + times(q[bar] + p, back) + times(other(q[bar]) + pp + back, move))
        rows.append(times(g, other(g)) + times(units[0], g + other(g)))
    one = r[which[0] - 4]
    rows.append(times(one, other(one)) - complex(square) * times(units[0], units[0]))
    forms = _as_real(np.array(rows))
    balls = certify(forms, unknowns, _residuals(forms, np.zeros(len(forms)), unknowns))
    return balls.real, are_disjoint(unknowns, balls)


def state_solutions(
    found: int, expected: int, missing: int, routes: int, proved: Sequence[bool], disjoint: bool
) -> str:
    """Say in sentences what is proved of all solutions and what was observed."""
    if found == expected:
        ends = "none is missing"
    elif not missing:
        ends = "the other paths ended at infinity, in singular solutions or where a bar has no length"
    else:
        ends = f"at most {missing} more are regular and were missed, in {counted(routes, 'route')}"
    told = f"all {len(proved)}" if all(proved) else f"{sum(proved)} of {len(proved)}"
    return (
        f"Observed: {found} of {expected} solutions, real and complex; {ends}. "
        f"Proved: {told} real ones exist and are alone{', no two of them one' * disjoint}."
    )
