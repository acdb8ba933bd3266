"""Poses of a large batch, coordinate by coordinate, as they are solved; put together when somebody asks."""

from typing import Any

import jax
import jax.numpy as jnp

from jaxnc.calls import public
from jaxnc.compiling import jit
from jaxnc.records import record, static
from jaxnc.types import Array, Coordinates, Float


@public
@record
class Columns:
    """Coordinates of many poses of one design, or of several.

    Attributes:
        rest: a pose with the coordinates that do not change, ``(N,)``; with the first of the poses' axes, ``(..., N)``,
            where they are of several designs.
        lanes: those that were solved for, an array ``(...,)`` each.
        driven: those that were driven, ``(..., driven)``.
        places: which coordinates these are, first the lanes.
    """

    rest: Coordinates
    lanes: tuple[Array, ...]
    driven: Float[Array, "... driven"]
    places: tuple[int, ...] = static()

    def column(self, coordinate: int) -> Array:
        """One coordinate of all poses."""
        if coordinate not in self.places:
            return jnp.broadcast_to(self._rest()[..., coordinate], self.driven.shape[:-1])
        k = self.places.index(coordinate)
        return self.lanes[k] if k < len(self.lanes) else self.driven[..., k - len(self.lanes)]

    def _rest(self) -> Float[Array, "... N"]:
        """What does not change, to be broadcast to all poses."""
        lead, more = self.rest.shape[:-1], self.driven.ndim - self.rest.ndim
        return self.rest.reshape(*lead, *[1] * more, self.rest.shape[-1]) if lead else self.rest

    def whole(self) -> Float[Array, "... N"]:
        """All coordinates of all poses."""
        return _whole(self)

    def reshaped(self, shape: tuple[int, ...]) -> "Columns":
        """The same poses with other leading axes."""
        if shape == self.driven.shape[:-1]:
            return self
        lanes = tuple(x.reshape(shape) for x in self.lanes)
        return Columns(self.rest, lanes, self.driven.reshape(*shape, self.driven.shape[-1]), self.places)

    def __getitem__(self, index: Any) -> "Columns":
        """Some of the poses: any index of the leading axes."""
        lanes, driven = jax.tree.map(lambda x: x[index], (self.lanes, self.driven))
        rest = self.rest
        if rest.ndim > 1:
            rest = jnp.broadcast_to(self._rest(), (*self.driven.shape[:-1], rest.shape[-1]))[index]
        return Columns(rest, lanes, driven, self.places)


@jit
def _whole(columns: Columns) -> Array:
    return jnp.stack([columns.column(c) for c in range(columns.rest.shape[-1])], axis=-1)
