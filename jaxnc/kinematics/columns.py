"""Poses of a large batch, coordinate by coordinate, as they are solved; put together when somebody asks."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxnc.types import Array, Coordinates, Float


class Columns(eqx.Module):
    """Coordinates of many poses of one design.

    Attributes:
        rest: a pose with the coordinates that do not change, ``(N,)``.
        lanes: those that do, an array ``(...,)`` each.
        places: which coordinates these are.
    """

    rest: Coordinates
    lanes: tuple[Array, ...]
    places: tuple[int, ...] = eqx.field(static=True)

    def column(self, coordinate: int) -> Array:
        """One coordinate of all poses."""
        if coordinate in self.places:
            return self.lanes[self.places.index(coordinate)]
        return jnp.broadcast_to(self.rest[coordinate], self.lanes[0].shape)

    def whole(self) -> Float[Array, "... N"]:
        """All coordinates of all poses."""
        return _whole(self)

    def __getitem__(self, index: Any) -> "Columns":
        """Some of the poses: any index of the leading axes."""
        return Columns(self.rest, jax.tree.map(lambda x: x[index], self.lanes), self.places)


@jax.jit
def _whole(columns: Columns) -> Array:
    return jnp.stack([columns.column(c) for c in range(columns.rest.shape[0])], axis=-1)
