"""Forces at the points of a mechanism over a motion, to be drawn: weights, what is applied, and reactions."""

import jax.numpy as jnp
import numpy as np

from jaxnc.dynamics.model import forces
from jaxnc.dynamics.reactions import Reactions, _flat, reactions
from jaxnc.kinematics.motion import Motion
from jaxnc.system.frames import spread
from jaxnc.types import Array

KINDS = ("weight", "applied", "reaction")
"""What is told apart: gravity; springs, dampers, stops and loads; what joints and the ground do."""


def nodal_forces(motion: Motion) -> dict[str, Array]:
    """Forces at all points in the poses of a motion with rates, N.

    Args:
        motion: a simulation, or a motion in time that its inputs drive.

    Returns:
        By kind, each ``(T, points, dim)``. A weight is shared out to the points of its body in the proportion that
        gives the same force and moment. A reaction is that of the ground on a fixed point, and where bodies share a
        point, what the first of them feels; joints that write rows of their own, and efforts on angles, have none.
    """
    found = reactions(motion)
    dyn, t, q, v, _ = found._states()
    top = dyn.topology
    count = len(motion.system.topology.points)
    weight = jnp.broadcast_to(dyn.gravity @ dyn.moments, q.shape)
    whole = _flat(lambda t, q, v: forces(dyn, t[0], q, v), t[..., None], q, v)
    held = jnp.zeros((*q.shape[:-1], count, top.dim))
    for point, on in _shared(found).items():
        pull = found.support(top.points[point]) if on is None else spread(top, found._body_force(on))[0][..., point, :]
        held = held.at[..., point, :].set(pull)
    return {
        "weight": spread(top, weight)[0][..., :count, :],
        "applied": spread(top, whole - weight)[0][..., :count, :],
        "reaction": held,
    }


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
