"""The length that a large mechanism is measured by: a typical bar's, since its extent says nothing of its parts."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxnc.system.topology import Topology


def bar_length(topology: Topology, drawing: Any) -> Any:
    """Median extent of the constraints that tie points together.

    A tolerance relative to the whole drawing would let every bar of a chain of thousands be wrong by thousands of
    times as much.

    It is 1 where no constraint ties two points at different places. The drawing has points as drawn, those of redrawn
    bodies behind them, of NumPy or JAX.
    """
    numeric = np if isinstance(drawing, np.ndarray) else jnp
    extents: list[Any] = [np.zeros(0)]
    for layout in topology.layout:
        if layout.drawn.shape[1] > 1:
            spread = drawing[layout.drawn[:, 1:]] - drawing[layout.drawn[:, :1]]
            square = numeric.max(numeric.sum(spread * spread, axis=2), axis=1)
            extents.append(numeric.where(square > 0, numeric.sqrt(numeric.where(square > 0, square, 1.0)), 0.0))
    found = numeric.concatenate(extents)
    if not found.shape[0]:
        return numeric.ones(())
    middle = numeric.median(found)
    return numeric.where(middle > 0, middle, 1.0)
