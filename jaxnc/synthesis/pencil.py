"""The common points of two conics, all four of them."""

import numpy as np

from jaxnc.types import Float

_SEED = 20  # of the change of coordinates that keeps solutions away from infinity


def common_points(p: Float[np.ndarray, "3 3"], q: Float[np.ndarray, "3 3"]) -> list[np.ndarray]:
    """Intersect two conics x·P·x = 0 and x·Q·x = 0 in the projective plane.

    In general coordinates (1, s, t) Sylvester's resultant with respect to t is a quartic in s.

    There are up to four points ``(3,)``, complex, of unit size; real points have the phase of real ones.

    Source: any text on elimination, e.g. D. Cox, J. Little, D. O'Shea, Ideals, Varieties, and Algorithms, chapter 3.
    """
    turn = np.linalg.qr(np.random.default_rng(_SEED).normal(size=(3, 3)))[0]
    p, q = (m / np.abs(m).max() for m in (turn.T @ p @ turn, turn.T @ q @ turn))

    def in_t(m: np.ndarray, s: complex) -> tuple[complex, complex, complex]:
        return m[2, 2], 2.0 * (m[0, 2] + m[1, 2] * s), m[0, 0] + 2.0 * m[0, 1] * s + m[1, 1] * s * s

    def resultant(s: complex) -> complex:
        (a, b, c), (d, e, f) = in_t(p, s), in_t(q, s)
        return (a * f - c * d) ** 2 - (a * e - b * d) * (b * f - c * e)

    roots_of_unity = np.exp(2j * np.pi * np.arange(5) / 5)
    quartic = np.fft.fft([resultant(s) for s in roots_of_unity]).real / 5  # ascending powers
    found = []
    for s in np.roots(quartic[::-1]):
        (a, b, c), (d, e, f) = in_t(p, s), in_t(q, s)
        t = -(a * f - c * d) / (a * e - b * d)
        x = np.array([1.0, s, t], complex)
        for _ in range(6):  # Newton's steps on the conics themselves
            rest = np.array([x @ p @ x, x @ q @ x])
            slope = 2.0 * np.stack([p @ x, q @ x])[:, 1:]
            step = np.linalg.lstsq(slope, rest, rcond=1e-15)[0]
            if not np.isfinite(step).all() or np.abs(step).max() > 0.1 * np.abs(x).max():
                break
            x[1:] -= step
        found.append(turn @ (x / np.linalg.norm(x)))
    return found
