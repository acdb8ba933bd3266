"""Linear algebra of the matrices of many poses, and what is known of every few of them says of those between.

Inverses are what takes a sweep's time, and from pose to pose they hardly change: those of every few lanes are made,
the others interpolated (cubics through four of them). They are never believed: whoever uses them refines what they
give, and lanes for which they do not do have their own.
"""

import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

_LANES = (4, 24)  # the fewest for which that pays, and the most
_HALF = 10.0  # times the root of the last digit: off by no more, one refinement makes it good
_FOUR = np.arange(4)


@dataclass(frozen=True, eq=False)
class Near:
    """Lanes that stand for those around them."""

    at: np.ndarray  # these lanes, in order
    nearest: np.ndarray  # for every lane, which of them is the nearest by number, (lanes,)
    # `matrix`, `inverse`: of these lanes, (len(at), m, n) and (len(at), n, m)
    matrix: np.ndarray
    inverse: np.ndarray
    first: np.ndarray  # of each so many lanes, the first of the four that these are interpolated between, and
    weights: np.ndarray  # the weights of the four, (len(first), lanes, 4)

    @functools.cached_property
    def interpolated(self) -> np.ndarray:
        """Inverses of all lanes, nearly, ``(lanes, n, m)``."""
        four = self.inverse[self.first[:, None] + _FOUR].reshape(len(self.first), 4, -1)
        return (self.weights @ four).reshape(-1, *self.inverse.shape[1:])[: len(self.nearest)]

    def proper(self, matrix: np.ndarray) -> np.ndarray:
        """Say which lanes' matrices differ from their neighbour's by less than could make that one singular."""
        apart = self.matrix[self.nearest]
        apart -= matrix
        reach = np.sum(self.inverse**2, axis=(1, 2))[self.nearest]
        return np.einsum("lmn,lmn->l", apart, apart) * reach < 1.0


def near(q: np.ndarray, length: float, matrices: Callable[[np.ndarray], np.ndarray]) -> Near | None:
    """Choose lanes that stand for others; None where they are too few for that.

    The poses are in the order of a motion, coordinates as lengths, ``(N, lanes)``; `matrices` gives those of some of
    the lanes, ``(…, m, n)``.
    """
    lanes, step = q.shape[1], np.diff(q, axis=1)
    way = np.concatenate([[0.0], np.cumsum(np.sqrt(np.einsum("nl,nl->l", step, step)))])
    # 0.15 sizes of the mechanism: so far go all coordinates together from one known lane to the next
    apart = min(0.15 * length * lanes / way[-1], _LANES[1], lanes // 4) if way[-1] > 0.0 else 0
    if not apart >= _LANES[0]:
        return None
    apart = int(apart)
    at, groups = np.append(np.arange(0, lanes - 1, apart), lanes - 1), -(-lanes // apart)
    first = np.clip(np.arange(groups) - 1, 0, len(at) - 4)
    x = way[at][first[:, None] + _FOUR]
    t = way[np.minimum(np.arange(groups * apart), lanes - 1)].reshape(groups, apart)
    away, between = t[:, :, None] - x[:, None], x[:, :, None] - x[:, None]
    weights = np.ones_like(away)
    for k, other in itertools.permutations(range(4), 2):
        weights[..., k] *= away[..., other] / between[:, k, other, None]
    nearest = np.minimum((np.arange(lanes) + apart // 2) // apart, len(at) - 1)
    matrix = matrices(at)
    return Near(at, nearest, matrix, inverse_of(matrix), first, weights)


def make_solver(matrix: np.ndarray, close: Near | None) -> Callable[[np.ndarray], np.ndarray]:
    """Make the function that solves with the matrices of poses ``(lanes, m, n)``, refined.

    It gives solutions ``(lanes, n, c)`` for right-hand sides ``(lanes, m, c)``. `close` is what is known of the lanes
    between others, if anything.
    """
    inverse, times = inverse_of(matrix) if close is None else close.interpolated, 1
    if close is not None:
        off, eps = _error_of(matrix, inverse), np.finfo(matrix.dtype).eps
        poor = ~(off <= 1e-3)  # off by more, an interpolated inverse is not refined
        if poor.any():
            inverse = np.array(inverse)
            inverse[poor], off[poor] = inverse_of(matrix[poor]), _HALF * eps**0.5
        # Every refinement leaves one factor of what is off.
        times = max(math.ceil(math.log(eps) / math.log(max(np.max(off), eps))) - 1, 1)

    def solve(right: np.ndarray) -> np.ndarray:
        x = inverse @ right
        for _ in range(times):
            x += inverse @ (right - matrix @ x)
        return x

    return solve


def _error_of(matrix: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Measure how far inverses are off, relative, ``(lanes,)``."""
    probe = np.cos(np.arange(matrix.shape[2], dtype=matrix.dtype))[:, None]  # in no direction that means anything
    return np.max(np.abs(inverse @ (matrix @ probe) - probe), axis=(1, 2), initial=0.0)


def least_squares(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve for ``(lanes, n, c)``, in the least-squares sense if there are more rows; not finite if singular."""
    if matrix.shape[1] > matrix.shape[2]:
        basis, triangle = np.linalg.qr(matrix)
        return solve_exactly(triangle, np.swapaxes(basis, 1, 2) @ right)
    return solve_exactly(matrix, right)


def inverse_of(matrix: np.ndarray) -> np.ndarray:
    """Return inverses ``(lanes, n, m)`` whose products are to be refined once; not finite if singular.

    Of more rows than unknowns it is that of the normal equations, in a third of the time of orthogonal columns, which
    are taken where one refinement would not make it good.
    """
    m, n = matrix.shape[1:]
    unit = np.eye(n, dtype=matrix.dtype)
    if m == n:
        return solve_exactly(matrix, np.broadcast_to(unit, matrix.shape))
    back = np.swapaxes(matrix, 1, 2)
    normal = back @ matrix
    out = solve_exactly(normal, np.broadcast_to(unit, normal.shape)) @ back
    poor = ~(_error_of(matrix, out) <= _HALF * np.finfo(matrix.dtype).eps ** 0.5)
    if poor.any():
        basis, triangle = np.linalg.qr(matrix[poor])
        out[poor] = solve_exactly(triangle, np.swapaxes(basis, 1, 2))
    return out


def solve_exactly(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve for right-hand sides ``(lanes, n, c)``; not finite if singular."""
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:  # one of them is singular to the last bit
        out = np.full((len(matrix), matrix.shape[2], right.shape[2]), np.nan, matrix.dtype)
        regular = np.linalg.slogdet(matrix)[0] != 0.0
        out[regular] = np.linalg.solve(matrix[regular], right[regular])
        return out
