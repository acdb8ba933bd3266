"""Complex numbers of twice the digits, each the sum of two: residuals where doubles leave nothing but rounding.

Newton's steps with such residuals give a solution to the last digit of a double as long as its condition number is
below 1e15; with residuals in doubles they give it to the condition number times a double's rounding.

Source: T. J. Dekker, A floating-point technique for extending the available precision, Numer. Math. 18 (1971) 224-242.
"""

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
