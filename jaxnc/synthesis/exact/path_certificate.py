"""Certificates of four-bars through precision points: the equations as quadratic ones with real coefficients.

x a' and x' a as unknowns of their own make the bars' equations quadratic in them, x and γ; the real and imaginary parts
of a number and of its primed one are what stands for the two.
"""

import numpy as np

from jaxnc.continuation.certificate import are_disjoint, certify
from jaxnc.continuation.twofold import Twofold

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
    turn = np.zeros((1 + 2 * half, 1 + 2 * half), complex)
    turn[0, 0] = 1.0
    k = np.arange(half)
    turn[1 + k, 1 + k] = turn[1 + half + k, 1 + k] = 1.0
    turn[1 + k, 1 + half + k], turn[1 + half + k, 1 + half + k] = 1j, -1j
    return np.real(turn.T @ np.array(rows) @ turn)
