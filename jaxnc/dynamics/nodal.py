"""Forces of a mechanism over a motion, to be drawn where they act: weights, what is applied, and reactions."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import filter_jit
from jaxnc.dynamics.extended import extended
from jaxnc.dynamics.inertia import inertias
from jaxnc.dynamics.model import Dynamics, forces
from jaxnc.dynamics.reactions import Reactions
from jaxnc.system.frames import spread
from jaxnc.types import Array

KINDS = ("weight", "applied", "reaction")
"""What is told apart: gravity; springs, dampers, stops and loads; what joints and the ground do."""


def nodal_forces(found: Reactions) -> dict[str, tuple[Array, Array]]:
    """Where forces act in the poses of a motion with rates, and how large they are, N.

    Args:
        found: the reactions of a simulation, or of a motion that carries rates.

    Returns:
        By kind, places and forces, each ``(..., arrows, dim)``. A weight acts at the centre of mass, what is applied at
        the points. A reaction is that of the ground on a fixed point, and where bodies share a point, what the first of
        them feels; joints that write rows of their own, and efforts on angles, have none.
    """
    motion = found.motion
    dyn, t, q, v, _ = found._states()
    top = dyn.topology
    count = len(motion.system.topology.points)
    places = spread(top, q)[0][..., :count, :]
    applied = _applied(dyn, t.reshape(-1), *(x.reshape(-1, q.shape[-1]) for x in (q, v))).reshape(q.shape)
    centres, weights = [], []
    for at, _, first, masses in inertias(extended(motion.system)):
        moments = jnp.einsum("...bk,bdk->...bd", q[..., at], first)
        heavy = masses > 0
        centres.append(jnp.where(heavy[:, None], moments / jnp.where(heavy, masses, 1.0)[:, None], 0.0))
        weights.append(jnp.broadcast_to(masses[:, None] * dyn.gravity, centres[-1].shape))
    shared = _shared(found)
    held = [
        found.support(top.points[point]) if on is None else found.at(top.points[point], on).force
        for point, on in shared.items()
    ]
    return {
        "weight": (jnp.concatenate(centres, axis=-2), jnp.concatenate(weights, axis=-2)),
        "applied": (places, spread(top, applied)[0][..., :count, :]),
        "reaction": (places[..., list(shared), :], jnp.stack([*held, places[..., 0, :] * 0.0], axis=-2)[..., :-1, :]),
    }


@filter_jit
def _applied(dyn: Dynamics, t: Array, q: Array, v: Array) -> Array:
    """What springs, dampers, stops and loads put on all coordinates of poses ``(P, N)``."""
    return jax.vmap(lambda t, q, v: forces(dyn, t, q, v) - dyn.gravity @ dyn.moments)(t, q, v)


def _shared(found: Reactions) -> dict[int, str | None]:
    """Points that bodies share, with the first of them, and fixed points that a body holds, with None."""
    top = found.motion.system.topology
    out: dict[int, str | None] = {}
    for p in range(len(top.points)):
        holders = [b.name for b in top.bodies if p in b.points]
        fixed = np.array(top.fixed[p * top.dim : (p + 1) * top.dim])
        if holders and fixed.any():
            out[p] = None
        elif len(holders) > 1:
            out[p] = holders[0]
    return out
