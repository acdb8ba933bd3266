"""The one record of solved poses: on the host, in traced code, and of whole analyses."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jaxnc.types import AnyArray


class PoseBatch(NamedTuple):
    """Solved poses and what is known of them, arrays of NumPy or JAX; what is not known is None.

    Everything but `q`, `known` and `rates` has the axes of the poses. They are ``(S, T)`` where S sequences of T inputs
    are solved by XLA, and lanes, the last axis of everything, inside of `jaxnc.solvers.host`.
    """

    # Coordinates: all of them in one array, (..., N) or on the host (N, lanes); or, where they are solved for in
    # columns, a tuple of arrays. Where a pose was not found, those of the last one on the branch, or the closest.
    q: Any
    size: AnyArray = None  # largest residual, a length
    conditioning: AnyArray = None  # estimate of the reciprocal condition number
    good: AnyArray = None  # whether the pose is right and on the branch
    ended: AnyArray = None  # whether the branch ends before the pose, which is then the last one
    known: AnyArray = ()  # known coordinates of the poses, an array each, where they are not those asked for
    status: AnyArray = None  # `jaxnc.Status` as an integer
    rates: AnyArray = ()  # time derivatives of the coordinates: velocity, acceleration, jerk
    # Of the host:
    limit: AnyArray = None  # whether the branch ends there, an input at the limit of its travel
    crossed: AnyArray = None  # whether branches cross there
    exhausted: AnyArray = None  # whether following it was given up, which might go on
    upright: AnyArray = None  # whether nothing is met by a mirror image
    mirrored: AnyArray = None  # whether a body is
    doubted: AnyArray = None  # in which steps a determinant changes too much to say that the branch was kept

    @property
    def answered(self) -> AnyArray:
        """True where there is nothing more to find out of a pose."""
        return self.good if self.ended is None else self.good | self.ended

    def known_of(self, values: AnyArray) -> tuple[AnyArray, ...]:
        """Known coordinates of the poses, of the values that were asked for ``(..., k)``."""
        return *self.known, *(values[..., k] for k in range(len(self.known), values.shape[-1]))

    def each(self, f: Callable[..., np.ndarray], *others: "PoseBatch") -> "PoseBatch":
        """Apply a function to all arrays of NumPy, and to those of other batches beside them; JAX is not called."""
        every = zip(self, *others, strict=True)
        return PoseBatch(*(f(*some) if isinstance(some[0], np.ndarray) else some[0] for some in every))

    def put(self, index: np.ndarray | tuple, other: "PoseBatch") -> None:
        """Write what is known of another batch in the place of some of these."""
        for mine, new in zip(self, other, strict=True):
            if isinstance(mine, np.ndarray):
                mine[index] = new
