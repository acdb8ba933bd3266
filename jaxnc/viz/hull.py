"""The outline of a plate: the convex hull of its points."""

import numpy as np


def hull(x: np.ndarray) -> list[int]:
    """Convex hull of points ``(n, 2)``, anticlockwise, as indices."""
    order = sorted(range(len(x)), key=lambda i: (x[i, 0], x[i, 1]))

    def chain(indices: list[int]) -> list[int]:
        out: list[int] = []
        for i in indices:
            while len(out) > 1 and _turn(x[out[-2]], x[out[-1]], x[i]) <= 0:
                out.pop()
            out.append(i)
        return out[:-1]

    return chain(order) + chain(order[::-1])


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
