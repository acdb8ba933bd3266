"""Closed form of the four-bar: two circles meet. The yardstick of every lane, in NumPy only."""

import dataclasses

import numpy as np

RELATIVE = 1e-9  # of the largest length: a pose that is farther off is wrong


@dataclasses.dataclass(frozen=True)
class FourBars:
    """Four-bars with ground pivots A = (0, 0) and D = (ground, 0); arrays ``(designs,)`` or numbers.

    Args:
        crank: length A-B.
        coupler: length B-C.
        rocker: length C-D.
        ground: length A-D.
        side: +1: C is to the left of the way from B to D, -1: to the right.
        home: crank angle of the drawing.
    """

    crank: np.ndarray
    coupler: np.ndarray
    rocker: np.ndarray
    ground: np.ndarray
    side: np.ndarray
    home: np.ndarray

    @classmethod
    def default(cls) -> "FourBars":
        """The crank-rocker of the single-design cases."""
        return cls(*(np.array(x) for x in (0.04, 0.12, 0.08, 0.10, 1.0, 1.0)))

    def column(self) -> "FourBars":
        """The same, shaped to go with angles ``(designs, angles)``."""
        return FourBars(*(np.reshape(getattr(self, f.name), (-1, 1)) for f in dataclasses.fields(self)))

    def poses(self, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places of B and C, each ``(..., 2)``; NaN where the circles do not meet."""
        b = self.crank[..., None] * np.stack([np.cos(phi), np.sin(phi)], axis=-1)
        way = np.stack([self.ground - b[..., 0], -b[..., 1]], axis=-1)
        square = np.sum(way * way, axis=-1)
        along = 0.5 * (square + self.coupler**2 - self.rocker**2) / square
        with np.errstate(invalid="ignore"):
            across = self.side * np.sqrt(self.coupler**2 / square - along**2)
        left = np.stack([-way[..., 1], way[..., 0]], axis=-1)
        return b, b + along[..., None] * way + across[..., None] * left

    def reachable(self, phi: np.ndarray) -> np.ndarray:
        """Whether the crank can be turned from home straight to an angle less than half a turn away."""

        def closes(angle):
            square = self.crank**2 + self.ground**2 - 2 * self.crank * self.ground * np.cos(angle)
            return (square < (self.coupler + self.rocker) ** 2) & (square > (self.coupler - self.rocker) ** 2)

        # B-D is monotonic between multiples of pi: what closes at the ends and at those in between closes all the way.
        ok = closes(self.home) & closes(phi)
        low, high = np.minimum(self.home, phi), np.maximum(self.home, phi)
        for k in range(-3, 4):
            between = (low < k * np.pi) & (k * np.pi < high)
            ok = ok & (~between | closes(np.full(np.shape(phi), k * np.pi)))
        return ok


def fraction(
    found: np.ndarray,
    wanted: np.ndarray,
    size: float | np.ndarray,
    accepted: np.ndarray | None = None,
    part: float = RELATIVE,
) -> float:
    """Fraction of lanes whose point is where it should be.

    Args:
        found: points, ``(..., 2)``.
        wanted: the closed form, ``(..., 2)``; NaN where there is no pose.
        size: length that the tolerance refers to.
        accepted: what the way itself says of its lanes; where there is no pose, a lane is right if it says so.
        part: tolerance.

    Returns:
        A number from 0 to 1.
    """
    exists = np.isfinite(wanted).all(axis=-1)
    with np.errstate(invalid="ignore"):
        close = np.linalg.norm(np.nan_to_num(found - wanted, nan=np.inf), axis=-1) <= part * size
    if accepted is None:
        return float(np.mean(close & exists))
    return float(np.mean(np.where(exists, close & accepted, ~accepted)))
