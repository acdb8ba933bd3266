"""What a user's force sees: the time, and positions and velocities by name."""

from typing import Any

import jax

from jaxnc.calls import public
from jaxnc.errors import InputError, nearest
from jaxnc.system.topology import Topology
from jaxnc.types import Array


@public
class State:
    """Position and velocity of a mechanism at one time, by name; what forces given as functions are handed.

    Args:
        topology: the mechanism.
        t: the time, s.
        q: all coordinates, ``(N,)``.
        v: their rates, ``(N,)``.
    """

    def __init__(self, topology: Topology, t: Any, q: Array, v: Array):
        self.topology, self.t, self.q, self.v = topology, t, q, v

    def __getitem__(self, name: str) -> Array:
        """A point ``(dim,)``, a vector ``(3,)``, a coordinate, or a single component such as ``"P.x"``."""
        return self._pick(self.q, name)

    def velocity(self, name: str) -> Array:
        """The rate of the same."""
        return self._pick(self.v, name)

    def _pick(self, x: Array, name: str) -> Array:
        top = self.topology
        spread = (*top.points, *top.vectors)
        if name in spread:
            i = spread.index(name) * top.dim
            return x[i : i + top.dim]
        if name in top.position:
            return x[top.position[name]]
        raise InputError(f"{top.name!r} has no point or coordinate {name!r}; {nearest(name, (*spread, *top.scalars))}")


jax.tree_util.register_pytree_node(
    State, lambda s: ((s.t, s.q, s.v), s.topology), lambda top, parts: State(top, *parts)
)
