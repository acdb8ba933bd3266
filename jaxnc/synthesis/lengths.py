"""Link lengths of a mechanism: distances of points that keep them."""

import itertools

import numpy as np

from jaxnc.kinematics.motion import Motion
from jaxnc.synthesis.loops import ground
from jaxnc.system.system import System

_SMALL = 3  # points of a body of which every pair is told


def lengths(motion: Motion) -> dict[str, float]:
    """Distances between points of each body, and between fixed pivots that follow each other, by ``"B-C"``.

    Of a body of more than three points, those from its first two to all others.
    """
    top = motion.system.topology
    q = np.asarray(motion.q)[0, : len(top.points) * top.dim].reshape(-1, top.dim)
    return {f"{top.points[i]}-{top.points[j]}": float(np.linalg.norm(q[i] - q[j])) for i, j in links(motion.system)}


def links(system: System) -> list[tuple[int, int]]:
    """Pairs of points, by number, whose distances are the lengths of a mechanism; see `lengths`."""
    out: dict[tuple[int, int], None] = {}
    fixed, used = ground(system), set()
    for body in system.topology.bodies:
        some = body.points
        used.update(some)
        for k, i in enumerate(some):
            for j in some[k + 1 :]:
                if (len(some) <= _SMALL or k < 2) and not (i in fixed and j in fixed):
                    out[i, j] = None
    return [*out, *itertools.pairwise(sorted(fixed & used))]
