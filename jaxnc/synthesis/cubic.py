"""Points of a circle-point curve: a cubic, met twice more by every line through a point of it."""

import numpy as np

from jaxnc.types import Float

_DIRECTIONS = 4001


def _matrix(forms: np.ndarray, b: np.ndarray | complex) -> np.ndarray:
    x, y = np.real(b), np.imag(b)
    return np.einsum("jkl,...l->...jk", forms, np.stack([x, y, np.ones(np.shape(b))], axis=-1))


def value(forms: Float[np.ndarray, "3 3 3"], b: np.ndarray | complex) -> np.ndarray:
    """The cubic at points b, complex: the determinant of the three equations of the centre."""
    return np.linalg.det(_matrix(forms, b))


def slope(forms: np.ndarray, b: complex) -> complex:
    """Gradient of the cubic at a point, as a complex number."""
    h = 1.0  # a cubic: central differences and a third-order correction are exact
    parts = []
    for e in (1.0, 1j):
        f = [complex(value(forms, b + k * h * e)).real for k in (-2, -1, 1, 2)]
        parts.append((f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * h))
    return complex(*parts)


def onto(forms: np.ndarray, near: complex) -> complex:
    """The point of the curve that Newton's steps along the gradient lead to from a place."""
    b = near
    for _ in range(60):
        g = slope(forms, b)
        step = complex(value(forms, b)).real * g / max(abs(g) ** 2, 1e-300)
        step *= min(1.0, 0.5 / max(abs(step), 1e-300))
        b -= step
        if abs(step) < 1e-16 * max(1.0, abs(b)):
            break
    return b


def _crossings(forms: np.ndarray, start: complex, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients of the quadratic that gives the other two points of the lines ``start + s e^{iα}``."""
    s = np.array([-2.0, -1.0, 1.0, 2.0])
    f = value(forms, start + s[:, None] * np.exp(1j * angles))
    odd2, odd1 = 0.5 * (f[3] - f[0]), 0.5 * (f[2] - f[1])  # f = c1 s + c2 s² + c3 s³, since start is on the curve
    even2, even1 = 0.5 * (f[3] + f[0]), 0.5 * (f[2] + f[1])
    c3 = (odd2 - 2.0 * odd1) / 6.0
    return c3, (even2 - even1) / 3.0, odd1 - c3


def trace(forms: np.ndarray, start: complex, points: int, extent: float) -> np.ndarray:
    """The real curve as polylines, complex, with NaN between pieces.

    A piece has about so many points; the curve, of three bilinear equations ``(3, 3, 3)``, is followed as far as
    `extent` from the origin.
    """
    angles = np.linspace(0.0, np.pi, _DIRECTIONS)

    def inside(angle: np.ndarray) -> np.ndarray:
        c3, c2, c1 = _crossings(forms, start, angle)
        return c2 * c2 - 4.0 * c3 * c1

    found = inside(angles)
    ends = []
    for k in np.flatnonzero((found[:-1] >= 0) != (found[1:] >= 0)):
        low, high = angles[k], angles[k + 1]
        for _ in range(60):
            middle = 0.5 * (low + high)
            same = (inside(np.array([middle]))[0] >= 0) == (found[k] >= 0)
            low, high = (middle, high) if same else (low, middle)
        ends.append(0.5 * (low + high))
    if not ends:
        spans = [(0.0, np.pi)] if found[0] >= 0 else []
    else:
        first = 0 if found[0] < 0 else 1  # the first end opens or closes a span
        turned = [*ends[first:], *(e + np.pi for e in ends[:first])]
        spans = list(zip(turned[::2], turned[1::2], strict=True))
    pieces = []
    for low, high in spans:
        # Evenly in the angle of a circle over the span: the two points of a line meet at its ends like a square root.
        around = np.linspace(0.0, np.pi, points // 2)
        angle = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(around)
        if not ends:
            angle = np.linspace(low, high, points // 2)
        c3, c2, c1 = _crossings(forms, start, angle)
        root = np.sqrt(np.maximum(c2 * c2 - 4.0 * c3 * c1, 0.0))
        for sign in (1.0, -1.0):
            # Of s = 2 c1 / (-c2 ∓ root) and (-c2 ± root) / 2 c3 take the one that does not cancel.
            big = -c2 + np.where(c2 > 0, -root, root)
            takes = (c2 > 0) == (sign < 0)
            with np.errstate(divide="ignore", invalid="ignore"):
                s = np.where(takes, big / (2.0 * c3), 2.0 * c1 / big)
            b = start + s * np.exp(1j * angle)
            b = np.where(np.abs(b) < extent, b, np.nan)
            pieces += [b[:: int(sign)], np.array([np.nan + 0j])]
    return np.concatenate(pieces) if pieces else np.zeros(0, complex)
