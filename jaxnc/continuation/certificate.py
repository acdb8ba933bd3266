"""Certificates: solutions of quadratic equations proved to exist and to be alone in a ball, rounding counted.

Newton's map ``d - A F(y + d)`` takes a ball of radius r into itself and contracts it if ``β + η r + γ r² < r`` and
``η + 2 γ r < 1``, where β is the size of A F(y), η that of 1 - A F'(y), and γ bounds the second derivatives, which are
the same everywhere. Rounding of all three is bounded, and the coefficients count as known but for their last digits.

Source: R. Krawczyk, Newton-Algorithmen zur Bestimmung von Nullstellen mit Fehlerschranken, Computing 4 (1969) 187-201;
P. Breiding, K. Rose and S. Timme, Certifying zeros of polynomial systems using interval arithmetic, ACM Trans. Math.
Softw. 49 (2023), for the argument by which a certified solution is real.

Residuals are made in complex numbers of twice the digits, each the sum of two, where doubles leave nothing but
rounding. Newton's steps with such residuals give a solution to the last digit of a double as long as its condition
number is below 1e15; with residuals in doubles they give it to the condition number times a double's rounding.

Source: T. J. Dekker, A floating-point technique for extending the available precision, Numer. Math. 18 (1971) 224-242.
"""

import dataclasses

import numpy as np

from jaxnc.types import Any

_SPLIT = 2.0**27 + 1.0


def _two_sum(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A sum and its rounding, of real or complex numbers."""
    s = a + b
    v = s - a
    return s, (a - (s - v)) + (b - v)


def _two_product(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A product and its rounding, of real numbers."""
    p = a * b
    c, d = _SPLIT * a, _SPLIT * b
    a1, b1 = c - (c - a), d - (d - b)
    a2, b2 = a - a1, b - b1
    return p, ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2


class Twofold:
    """Arrays of complex numbers, each high + low; sums, differences and products are exact to some 30 digits."""

    __array_ufunc__ = None  # NumPy leaves array + Twofold to us

    def __init__(self, high: Any, low: Any = 0.0):
        self.high, self.low = np.asarray(high, complex), low

    def __add__(self, other: Any) -> "Twofold":
        other = other if isinstance(other, Twofold) else Twofold(other)
        s, e = _two_sum(self.high, other.high)
        return Twofold(*_two_sum(s, e + (self.low + other.low)))

    __radd__ = __add__

    def __neg__(self) -> "Twofold":
        return Twofold(-self.high, -self.low)

    def __sub__(self, other: Any) -> "Twofold":
        return self + -other

    def __rsub__(self, other: Any) -> "Twofold":
        return -self + other

    def __mul__(self, other: Any) -> "Twofold":
        other = other if isinstance(other, Twofold) else Twofold(other)
        x, y = self.high, other.high
        (p, q), (r, s) = ((np.real(v), np.imag(v)) for v in (x, y))
        (rr, a), (ii, b), (ri, c), (ir, d) = (
            _two_product(p, r),
            _two_product(q, s),
            _two_product(p, s),
            _two_product(q, r),
        )
        (real, e), (imag, f) = _two_sum(rr, -ii), _two_sum(ri, ir)
        low = (e + (a - b)) + 1j * (f + (c + d)) + (x * other.low + self.low * y)
        return Twofold(*_two_sum(real + 1j * imag, low))

    __rmul__ = __mul__

    def rounded(self) -> np.ndarray:
        """The nearest doubles."""
        return self.high + self.low


# -- certificates ------------------------------------------------------------------------------------------------------


_ROUND = 2.0**-52
COEFFICIENTS = 64 * _ROUND
"""Relative uncertainty of the coefficients for which a certificate holds."""


@dataclasses.dataclass(frozen=True)
class Balls:
    """A ball about each solution, in the largest of its unknowns, each in parts of its size (at least one).

    All arrays are ``(solutions,)``.
    """

    radius: np.ndarray  # there is a solution within; infinite where nothing is proved
    alone: np.ndarray  # and only one within this larger one
    condition: np.ndarray  # reciprocal condition number of the Jacobian
    real: np.ndarray  # proved to be real
    complex: np.ndarray  # proved not to be real

    @property
    def proved(self) -> np.ndarray:
        """Where there is a proof."""
        return np.isfinite(self.radius)


def certify(t: np.ndarray, w: np.ndarray, residual: tuple[np.ndarray, np.ndarray] | None = None) -> Balls:
    """Certify approximate solutions ``(n, solutions)`` of a real system ``(n, 1 + n, 1 + n)``, or of one each.

    The equations' values and bounds of their errors, ``(solutions, n)`` both, may be given from a computation with more
    digits; the certificate then holds for these very coefficients.
    """
    n, count = w.shape
    if not count or not n:
        ones = np.ones(count)
        return Balls(0.0 * ones, np.inf * ones, ones, ones > 0, ones < 0)
    size = np.abs(t)
    t, large = (np.broadcast_to(x, (count, n, n + 1, n + 1)) for x in (t, size))
    y = np.concatenate([np.ones((1, count)), w]).T
    with np.errstate(all="ignore"):
        g = np.matmul(t, y[:, None, :, None])[..., 0]
        f, jacobian = np.einsum("sri,si->sr", g, y), 2.0 * g[:, :, 1:]
        large = np.matmul(large, np.abs(y)[:, None, :, None])[..., 0]
        slack = COEFFICIENTS + 4 * (n + 4) * _ROUND
        f_slack = slack * np.einsum("sri,si->sr", large, np.abs(y))
        if residual is not None:
            f, f_slack = residual
        j_slack = 2.0 * slack * large[:, :, 1:]
        finite = np.isfinite(jacobian).all(axis=(1, 2))
        jacobian = np.where(finite[:, None, None], jacobian, 0.0)
        singular = np.abs(np.linalg.det(jacobian)) == 0.0
        inverse = np.linalg.inv(np.where(singular[:, None, None], np.eye(n), jacobian))
        a = np.abs(inverse)
        scale = 1.0 / _scales(w).T  # of unknowns
        beta = np.abs(np.einsum("sir,sr->si", inverse, f)) + np.einsum("sir,sr->si", a, f_slack)
        beta = (beta * scale).max(axis=1)
        off = np.abs(np.eye(n) - inverse @ jacobian) + a @ (j_slack + slack * np.abs(jacobian))
        eta = (np.matmul(off, 1.0 / scale[:, :, None])[:, :, 0] * scale).max(axis=1)
        bend = np.einsum("srij,si,sj->sr", np.abs(t[:, :, 1:, 1:]), 1.0 / scale, 1.0 / scale) * (1.0 + slack)
        gamma = (np.einsum("sir,sr->si", a, bend) * scale).max(axis=1)
        half = 0.5 * (1.0 - eta)
        root = np.sqrt(half**2 - beta * gamma)
        proved = finite & ~singular & (half > 0.0) & (half**2 > 1.01 * beta * gamma)
        radius = np.where(proved, 1.01 * beta / (half + root), np.inf)
        # Two solutions in one ball would be as far apart as the map contracts: it does within half / γ.
        alone = np.where(proved, 0.99 * np.minimum(half / gamma, (half + root) / gamma), 0.0)
        proved &= radius < alone
        radius, alone = np.where(proved, radius, np.inf), np.where(proved, alone, 0.0)
        condition = np.where(
            singular, 0.0, 1.0 / (np.abs(jacobian).sum(axis=2).max(axis=1) * a.sum(axis=2).max(axis=1))
        )
    imaginary = np.abs(np.imag(w) / _scales(w)).max(axis=0)
    real = proved & (2.0 * imaginary < alone - radius)
    return Balls(radius, alone, condition, real, proved & (imaginary > radius))


def are_disjoint(w: np.ndarray, balls: Balls) -> bool:
    """Tell whether no two of the certified solutions can be one: their balls have no point in common."""
    w, scale = w[:, balls.proved], _scales(w[:, balls.proved])
    reach = balls.radius[balls.proved] * scale
    apart = (np.abs(w[:, :, None] - w[:, None, :]) > reach[:, :, None] + reach[:, None, :]).any(axis=0)
    return bool(np.all(apart | np.eye(w.shape[1], dtype=bool)))


def _scales(w: np.ndarray) -> np.ndarray:
    """Size of every unknown, at least one."""
    return np.maximum(1.0, np.abs(w))
