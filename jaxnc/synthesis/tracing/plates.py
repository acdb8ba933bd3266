"""Links of chains of dyads as plates, and how far they stay from regions: over arrays of chains."""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxnc.errors import InputError, nearest
from jaxnc.synthesis.clearance import ClearOf, all_pairs, ring, select_least, signed_distance, swept_distance
from jaxnc.synthesis.tracing.chains import CRANK, KINDS, ChainArrays, dyadic_chains
from jaxnc.synthesis.tracing.curves import Traced
from jaxnc.types import Array

_RPR = KINDS.index("RPR")
_BODIES = 8  # of a linkage, the ground among them
_FREE = 1e6  # in place of the distance of a link that need not keep clear


class Walls(NamedTuple):
    """A region that links have to keep clear of."""

    pieces: Any  # convex ones, (m, 2, pieces)
    room: Any  # distance of the lines between a link's joints
    which: Any  # whether each body has to keep clear, (bodies,)

    def in_units(self, centre: np.ndarray, size: float) -> "Walls":
        """Write the region in units of a size about a centre."""
        return Walls((self.pieces - centre[:, None]) / size, self.room / size, self.which)


def to_walls(condition: ClearOf, bars: Sequence[int]) -> Walls:
    """Read a condition whose links are those of linkages that are not known yet."""
    names = ["crank", *(f"link {k}" for k in range(2, max(bars)))]
    for name in condition.links or ():
        if name not in names:
            raise InputError(f"trace: clear_of(links=…) has {name!r}; {nearest(name, names)}")
    which = np.array([k > 0 and k <= len(names) and (condition.links is None or names[k - 1] in condition.links)
                      for k in range(_BODIES)])  # fmt: skip
    return Walls(condition.pieces, condition.room, which)


def _carries(chain: ChainArrays, of: Any) -> Any:
    """Which bodies but the ground carry which places: the crank's pivot, joints of dyads, the tracing point.

    Returns:
        Marks, ``(…, bodies - 1, 3 dyads + 2)``; the places of a dyad are its outer joints and the inner one.
    """
    dyads = chain.kind.shape[-1]
    body = np.arange(CRANK, 2 + 2 * dyads)
    columns = [of.broadcast_to(of.asarray(body == CRANK), (*chain.tracer.shape, len(body)))]
    for d in range(dyads):
        kind, first, second = (a[..., d, None] for a in (chain.kind, chain.first, chain.second))
        one, two, rod = (
            body == 2 + 2 * d,
            body == 3 + 2 * d,
            kind == _RPR,
        )  # what slides through a pivot goes through it
        columns.append((body == first) | (one & (kind <= _RPR)))
        columns.append((body == second) | (two & (rod | (kind == 0))) | (one & rod))
        columns.append((one | two) & ~rod)
    columns.append(body == chain.tracer[..., None])
    return of.stack(columns, axis=-1)


@functools.cache
def _most_places(dyads: int) -> int:
    """Count the places of the link that carries most of them, over all chains."""
    return int(_carries(ChainArrays.of(dyadic_chains(2 + 2 * dyads)), np).sum(axis=-1).max())


def link_corners(chain: ChainArrays, traced: Traced) -> Array:
    """Places of the joints of all links but the ground, ``(k, 2, bodies - 1, T)``, some of them more than once."""
    dyads, count = chain.kind.shape[-1], traced.point.shape[-1]
    places = jnp.concatenate([jnp.zeros((1, 2, count)), traced.joints.reshape(-1, 2, count), traced.point[None]])
    on = _carries(chain, jnp)
    order = jnp.argsort(~on, axis=1, stable=True)[:, : _most_places(dyads)]
    order = jnp.where(jnp.take_along_axis(on, order, axis=1), order, order[:, :1])
    return jnp.moveaxis(places[order], 0, 2)


def gaps(links: Array, walls: Walls, swept: bool = False) -> Array:
    """Distances of links from a region beyond the room that they need, ``(links, T)``.

    Args:
        links: corners, ``(k, 2, links, T)``.
        walls: the region.
        swept: bounds between each pose and the next, ``(links, T - 1)``, instead of distances in the poses.
    """
    pieces = jnp.asarray(walls.pieces)[:, :, :, None, None]
    shape = pieces.shape[2], *links.shape[2:]
    links, pieces = (jnp.broadcast_to(a, (*a.shape[:2], *shape)) for a in (links[:, :, None], pieces))
    measure = swept_distance if swept else signed_distance
    found = select_least(measure(links, pieces, all_pairs(len(links)), ring(len(pieces)))) - walls.room
    return jnp.where(jnp.asarray(walls.which)[CRANK : CRANK + found.shape[0], None], found, _FREE)
