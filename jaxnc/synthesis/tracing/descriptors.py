"""What curves are like, whatever their place, size, turn and start: Fourier coefficients by arc length."""

from typing import Any

import numpy as np

HARMONICS = 10  # of closed curves, either way round
WAVES = 14  # of open ones
_SHIFTS = 64  # starts that are tried when closed curves are laid on one another
_ORDER = np.r_[-HARMONICS:0, 1 : HARMONICS + 1]


def closed_coefficients(points: Any, of: Any = np) -> Any:
    """Fourier coefficients of closed curves by arc length.

    Args:
        points: corners, ``(…, T, 2)``; the last one is joined to the first.
        of: the array module.

    Returns:
        Real and imaginary parts for the harmonics -K … -1, 1 … K, ``(…, 2 K, 2)``, in units of the curve.
    """
    step = of.roll(points, -1, axis=-2) - points
    middle, length = points + 0.5 * step, of.sqrt(of.sum(step * step, axis=-1))
    total = of.sum(length, axis=-1)[..., None]
    weight = length / of.where(total > 0, total, 1.0)
    angle = 2.0 * np.pi * (of.cumsum(weight, axis=-1) - 0.5 * weight)
    phase = angle[..., None, :] * _ORDER[:, None]
    cos, sin = of.cos(phase) * weight[..., None, :], of.sin(phase) * weight[..., None, :]
    x, y = middle[..., 0][..., None], middle[..., 1][..., None]
    return of.concatenate([cos @ x + sin @ y, cos @ y - sin @ x], axis=-1)


def open_coefficients(points: Any, of: Any = np, share: Any = 1.0) -> Any:
    """Cosine coefficients of open curves by arc length.

    Args:
        points: corners, ``(…, T, 2)``.
        of: the array module.
        share: 1 where the piece from a corner to the next belongs to the curve, else 0, ``(…, T - 1)``.

    Returns:
        x and y for 1 … W half waves, ``(…, W, 2)``, in units of the curve.
    """
    step = points[..., 1:, :] - points[..., :-1, :]
    length = of.sqrt(of.sum(step * step, axis=-1)) * share
    before = of.cumsum(length, axis=-1) - 0.5 * length
    total = of.sum(length, axis=-1)[..., None]
    angle = np.pi * before / of.where(total > 0, total, 1.0)
    weight = length / of.where(total > 0, total, 1.0)
    middle = points[..., :-1, :] + 0.5 * step
    middle = middle - of.sum(middle * weight[..., None], axis=-2)[..., None, :]
    waves = of.cos(angle[..., None, :] * np.arange(1, WAVES + 1)[:, None]) * weight[..., None, :]
    return 2.0 * waves @ middle


def normalise(coefficients: Any, of: Any = np) -> Any:
    """Divide by their size, ``(…, n, 2)``."""
    size = of.sqrt(of.sum(coefficients**2, axis=(-1, -2)))[..., None, None]
    return coefficients / of.where(size > 0, size, 1.0)


def upright(coefficients: Any, of: Any = np) -> Any:
    """Turn open curves so that their first wave lies along x, ``(…, W, 2)``."""
    x, y = coefficients[..., 0], coefficients[..., 1]
    size = of.sqrt(x[..., :1] ** 2 + y[..., :1] ** 2)
    c, s = x[..., :1] / of.where(size > 0, size, 1.0), y[..., :1] / of.where(size > 0, size, 1.0)
    return of.stack([x * c + y * s, y * c - x * s], axis=-1)


def magnitudes(coefficients: Any) -> np.ndarray:
    """Sizes of harmonics, which no turn and no start changes, ``(…, n)``."""
    return np.sqrt(np.sum(np.asarray(coefficients, np.float32) ** 2, axis=-1))


def _complex(coefficients: np.ndarray) -> np.ndarray:
    return coefficients[..., 0].astype(np.float32) + 1j * coefficients[..., 1].astype(np.float32)


def lay_closed(target: np.ndarray, found: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lay closed curves on a target as well as turning, starting and mirroring can.

    Args:
        target: its coefficients, of size 1, ``(2 K, 2)``.
        found: those of the curves, ``(N, 2 K, 2)``.

    Returns:
        The mean square that is left, by which angle each is turned, and whether it is mirrored first, ``(N,)`` each.
    """
    goal, own = _complex(target), _complex(found)
    wave = np.exp(2j * np.pi * _ORDER[:, None] * np.arange(_SHIFTS) / _SHIFTS).astype(np.complex64)
    ways = (own, own[:, ::-1], np.conj(own[:, ::-1]), np.conj(own))  # as it is, backwards, mirrored, both
    return _lay_best([((goal * np.conj(way)) @ wave).T for way in ways])


def lay_open(target: np.ndarray, found: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lay open curves on a target as well as turning and mirroring can; arguments and results as of `lay_closed`."""
    goal, own = _complex(target), _complex(found)
    back = (-1.0) ** np.arange(1, WAVES + 1)
    ways = (own, own * back, np.conj(own), np.conj(own) * back)
    return _lay_best([np.sum(goal * np.conj(way), axis=1)[None] for way in ways])


def _lay_best(fits: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Choose for each curve the best of four ways, the last two mirrored, and starts, ``(starts, N)`` of each way."""
    every = np.concatenate(fits)
    which = np.abs(every).argmax(axis=0)
    chosen = every[which, np.arange(every.shape[1])]
    return 1.0 - np.abs(chosen) ** 2, np.angle(chosen), which >= 2 * len(fits[0])
