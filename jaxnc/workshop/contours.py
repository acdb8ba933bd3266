"""Contours of parts as lines and arcs, at true scale."""

import math

import numpy as np

Bulged = list[tuple[complex, float]]
"""Corners of a closed contour, each with the bulge of the way to the next: tan of a quarter of its arc, 0 straight."""


def rounded(corners: np.ndarray, radius: float) -> Bulged:
    """What lies within a radius of a convex shape, anticlockwise."""
    edges = np.roll(corners, -1) - corners
    edges = edges / np.abs(edges)
    out: Bulged = []
    for k, corner in enumerate(corners):
        before, after = edges[k - 1], edges[k]
        turn = math.atan2((after * np.conj(before)).imag, (after * np.conj(before)).real)
        turn = (
            turn if turn > -1e-9 else turn + 2 * math.pi
        )  # half a turn at the end of a bar may come out as minus half
        out.append((complex(corner - 1j * radius * before), math.tan(0.25 * max(turn, 0.0))))
        out.append((complex(corner - 1j * radius * after), 0.0))
    return out
