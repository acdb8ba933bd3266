"""The length that a large mechanism is measured by: a typical bar's, since its extent says nothing of its parts."""

import jax
import jax.numpy as jnp

from jaxnc.system.topology import Topology
from jaxnc.types import Array, Float


def bar_length(topology: Topology, drawing: Float[Array, "points dim"]) -> Array:
    """Median extent of the constraints that tie points together.

    A tolerance relative to the whole drawing would let every bar of a chain of thousands be wrong by thousands of
    times as much.

    Args:
        topology: the mechanism.
        drawing: its points as drawn, those of redrawn bodies behind them, lengths.

    Returns:
        The length, not differentiated; 1 where no constraint ties two points at different places.
    """
    extents = [jnp.zeros(0)]
    for layout in topology.layout:
        if layout.drawn.shape[1] > 1:
            spread = drawing[layout.drawn[:, 1:]] - drawing[layout.drawn[:, :1]]
            extents.append(jnp.sqrt(jnp.max(jnp.sum(spread * spread, axis=2), axis=1)))
    found = jnp.concatenate(extents)
    if not found.shape[0]:
        return jnp.ones(())
    middle = jnp.median(found)
    return jax.lax.stop_gradient(jnp.where(middle > 0, middle, 1.0))
