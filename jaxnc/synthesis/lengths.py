"""Link lengths of a mechanism: distances of points that keep them."""

import itertools

import numpy as np

from jaxnc.kinematics.motion import Motion
from jaxnc.synthesis.loops import ground

_SMALL = 3  # points of a body of which every pair is told


def lengths(motion: Motion) -> dict[str, float]:
    """Distances between points of each body, and between fixed pivots that follow each other, by ``"B-C"``.

    Of a body of more than three points, those from its first two to all others.
    """
    top, out = motion.system.topology, {}
    q = np.asarray(motion.q)[0, : len(top.points) * top.dim].reshape(-1, top.dim)

    def add(i: int, j: int) -> None:
        out.setdefault(f"{top.points[i]}-{top.points[j]}", float(np.linalg.norm(q[i] - q[j])))

    fixed, used = ground(motion.system), set()
    for body in top.bodies:
        some = body.points
        used.update(some)
        for k, i in enumerate(some):
            for j in some[k + 1 :]:
                if (len(some) <= _SMALL or k < 2) and not (i in fixed and j in fixed):
                    add(i, j)
    pivots = sorted(fixed & used)
    for i, j in itertools.pairwise(pivots):
        add(i, j)
    return out
