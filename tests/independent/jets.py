"""Values with their first and second time derivatives, carried exactly through sums, products and square roots.

A jet is the Taylor series of a quantity in time, cut after the second order: (x, ẋ, ẍ). Every operation below is the
chain rule of the two derivatives written out, so velocities and accelerations cost no differences and no step.
Arrays have any leading axes (poses, hardpoints); a vector keeps its components in the last axis.
"""

from __future__ import annotations

import numpy as np

_NEXT, _LAST = [1, 2, 0], [2, 0, 1]  # cyclic orders of the components in a vector product


class Jet:
    """A quantity, its velocity and its acceleration: arrays of one shape.

    Args:
        x: Value, any shape; lengths in the unit of the hardpoints, angles in radians.
        v: First time derivative, broadcast to the shape of `x`.
        a: Second time derivative, broadcast to the shape of `x`.
    """

    __slots__ = ("a", "v", "x")
    __array_ufunc__ = None  # numpy arrays hand mixed operations over to the methods below

    def __init__(self, x, v=0.0, a=0.0):
        x, v, a = np.asarray(x, float), np.asarray(v, float), np.asarray(a, float)
        if not x.shape == v.shape == a.shape:
            x, v, a = np.broadcast_arrays(x, v, a)
        self.x, self.v, self.a = x, v, a

    def __iter__(self):
        return iter((self.x, self.v, self.a))

    def __repr__(self):
        return f"Jet({self.x!r}, {self.v!r}, {self.a!r})"

    @property
    def shape(self):
        return self.x.shape

    def __getitem__(self, index):
        return Jet(self.x[index], self.v[index], self.a[index])

    def __neg__(self):
        return Jet(-self.x, -self.v, -self.a)

    def __add__(self, other):  # what is not a jet is a constant
        if not isinstance(other, Jet):
            return Jet(self.x + other, self.v, self.a)
        return Jet(self.x + other.x, self.v + other.v, self.a + other.a)

    __radd__ = __add__

    def __sub__(self, other):
        return self + -other

    def __rsub__(self, other):
        return -self + other

    def __mul__(self, other):
        if not isinstance(other, Jet):
            return Jet(self.x * other, self.v * other, self.a * other)
        return Jet(
            self.x * other.x,
            self.v * other.x + self.x * other.v,
            self.a * other.x + 2.0 * self.v * other.v + self.x * other.a,
        )

    __rmul__ = __mul__

    def __truediv__(self, other):
        other = jet(other)
        x = self.x / other.x
        v = (self.v - x * other.v) / other.x
        return Jet(x, v, (self.a - 2.0 * v * other.v - x * other.a) / other.x)

    def __rtruediv__(self, other):
        return jet(other) / self


def jet(value) -> Jet:
    """A jet as it is; anything else as a constant."""
    if isinstance(value, Jet):
        return value
    value = np.asarray(value, float)
    still = np.zeros_like(value)
    return Jet(value, still, still)


def sin(q) -> Jet:
    """Sine of an angle in radians."""
    q = jet(q)
    s, c = np.sin(q.x), np.cos(q.x)
    return Jet(s, c * q.v, c * q.a - s * q.v**2)


def cos(q) -> Jet:
    """Cosine of an angle in radians."""
    q = jet(q)
    s, c = np.sin(q.x), np.cos(q.x)
    return Jet(c, -s * q.v, -s * q.a - c * q.v**2)


def sqrt(q) -> Jet:
    """Square root; nan where the argument is negative: the mechanism does not reach that input."""
    q = jet(q)
    with np.errstate(invalid="ignore", divide="ignore"):
        x = np.sqrt(q.x)
        v = q.v / (2.0 * x)
        return Jet(x, v, (q.a - 2.0 * v**2) / (2.0 * x))


def atan2(y, x) -> Jet:
    """Angle of the point (x, y), in (−π, π]."""
    y, x = jet(y), jet(x)
    square = x.x**2 + y.x**2
    v = (x.x * y.v - y.x * x.v) / square
    a = (x.x * y.a - y.x * x.a - 2.0 * v * (x.x * x.v + y.x * y.v)) / square
    return Jet(np.arctan2(y.x, x.x), v, a)


def asin(q) -> Jet:
    """Arc sine, by the arc tangent: full digits at small angles."""
    q = jet(q)
    return atan2(q, sqrt(1.0 - q * q))


def stack(parts) -> Jet:
    """Scalars, shape (…), as the components of vectors, shape (…, n)."""
    parts = [jet(part) for part in parts]
    shape = np.broadcast_shapes(*(part.shape for part in parts))
    return Jet(
        *(np.stack([np.broadcast_to(part, shape) for part in column], -1) for column in zip(*parts, strict=True))
    )


def dot(p, q) -> Jet:
    """Scalar product over the last axis."""
    product = p * q if isinstance(p, Jet) else jet(q) * p
    return Jet(product.x.sum(-1), product.v.sum(-1), product.a.sum(-1))


def cross(p, q) -> Jet:
    """Vector product over the last axis."""
    p, q = jet(p), jet(q)
    return p[..., _NEXT] * q[..., _LAST] - p[..., _LAST] * q[..., _NEXT]


def scaled(s, p) -> Jet:
    """Vector `p`, shape (…, n), times scalar `s`, shape (…)."""
    return jet(s)[..., None] * p


def norm(p) -> Jet:
    """Length of a vector."""
    return sqrt(dot(p, p))


def unit(p) -> Jet:
    """Direction of a vector."""
    return jet(p) / norm(p)[..., None]


def across(p, axis) -> Jet:
    """Part of a vector across a unit axis."""
    return p - scaled(dot(p, axis), axis)


def turned(p, axis, angle) -> Jet:
    """Vector turned about a unit axis by an angle, right-handed (Rodrigues' formula)."""
    along = scaled(dot(p, axis), axis)
    return along + scaled(cos(angle), p - along) + scaled(sin(angle), cross(axis, p))


def angle_about(axis, start, end) -> Jet:
    """Right-handed angle about a unit axis from one direction to another, both projected across the axis."""
    start = across(start, axis)
    return atan2(dot(axis, cross(start, end)), dot(start, end))


def triad(first, second) -> tuple[Jet, Jet, Jet]:
    """Right-handed orthonormal frame: e1 along `first`, e3 across both, e2 = e3 × e1."""
    e1 = unit(first)
    e3 = unit(cross(e1, second))
    return e1, cross(e3, e1), e3


def carried(p, frame, other) -> Jet:
    """Vector fixed in a triad, moved with the triad to where it is now: the rotation matrix `other` · `frame`ᵀ."""
    return sum((scaled(dot(p, e), f) for e, f in zip(frame, other, strict=True)), start=Jet(0.0))
