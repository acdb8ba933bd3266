"""Which bodies there are, what they hold, and the solid that is drawn for each."""

import numpy as np

from jaxnc.viz.hull import hull
from jaxnc.viz.poses import Poses
from jaxnc.viz.style import INK

FLAT = 0.02
"""Of a body's size: points nearer than this to a line or plane are drawn as lying on it."""


class Bodies:
    """Points, directions and bodies of a spatial mechanism as index sets.

    Args:
        poses: the motion.
    """

    def __init__(self, poses: Poses):
        top = self.top = poses.topology
        n, v = len(top.points), len(top.vectors)
        fixed = np.array(top.fixed[: 3 * (n + v)], dtype=bool).reshape(n + v, 3)
        self.fixed = fixed[:n]
        self.ground: np.ndarray = np.all(fixed[:n], axis=1)
        self.half: np.ndarray = np.any(fixed[:n], axis=1) & ~self.ground
        self.still: np.ndarray = np.all(fixed[n:], axis=1)
        """Which vectors belong to the ground."""
        self.points = [set(b.points) for b in top.bodies]
        self.vectors: list[set[int]] = [set(b.vectors) for b in top.bodies]
        self.moving = [self._moves(k) for k in range(len(top.bodies))]
        groups = self._groups()
        numbers: dict[int, int] = {}
        self.colours = [
            numbers.setdefault(groups[k], len(numbers)) if self.moving[k] else INK for k in range(len(top.bodies))
        ]
        self.groups = groups

    def _moves(self, k: int) -> bool:
        still = all(self.ground[p] for p in self.points[k])
        return not (still and all(self.still[v] for v in self.vectors[k]) and len(self.points[k]) > 1)

    def _groups(self) -> list[int]:
        """Number of the rigid group of each body: welded bodies are one."""
        group = list(range(len(self.points)))
        for joint in self.top.joints:
            if joint.bodies:
                first, second = (group[k] for k in joint.bodies)
                group = [first if g == second else g for g in group]
        return group

    def holding(self, *points: int, vectors: tuple[int, ...] = ()) -> int | None:
        """The moving body that holds all of these."""
        for k, moves in enumerate(self.moving):
            if moves and set(points) <= self.points[k] and set(vectors) <= self.vectors[k]:
                return k
        return None

    def colour(self, *points: int, vectors: tuple[int, ...] = ()) -> int:
        """Its colour, or that of no body."""
        k = self.holding(*points, vectors=vectors)
        return INK if k is None else self.colours[k]

    def meeting(self, p: int) -> list[tuple[set[int], set[int], int]]:
        """What meets at a point: points, vectors and group (-1 for the ground) of each."""
        found = [
            (self.points[k], self.vectors[k], self.groups[k])
            for k, moves in enumerate(self.moving)
            if moves and p in self.points[k]
        ]
        if self.ground[p]:
            everything = set(np.flatnonzero(self.ground).tolist()), set(np.flatnonzero(self.still).tolist())
            found.append((*everything, -1))
        return found


def rank(x: np.ndarray) -> int:
    """Dimension that points ``(n, 3)`` spread over: 0, 1, 2 or 3."""
    d = x - x.mean(axis=0)
    size = np.linalg.svd(d, compute_uv=False) if len(x) > 1 else np.zeros(1)
    return int(np.sum(size > FLAT * size[0])) if size[0] > 0 else 0


def outline(x: np.ndarray) -> tuple[list[tuple[int, ...]], list[tuple[int, int]]]:
    """Faces and edges of the convex hull of points ``(n, 3)`` that do not lie on a line, as indices."""
    if rank(x) == 2:
        _, _, axes = np.linalg.svd(x - x.mean(axis=0))
        order = hull((x - x.mean(axis=0)) @ axes[:2].T)
        return [tuple(order)], [(order[k - 1], order[k]) for k in range(len(order))]
    from scipy.spatial import ConvexHull, QhullError  # takes longer to import than most bodies to draw

    try:
        found = ConvexHull(x)
    except QhullError:
        order = list(range(len(x)))
        return [tuple(order)], [(order[k - 1], order[k]) for k in range(len(order))]
    normals = found.equations[:, :3]
    faces = [tuple(int(i) for i in face) for face in found.simplices]
    edges = {}
    for k, face in enumerate(faces):
        for a, b in ((face[0], face[1]), (face[1], face[2]), (face[2], face[0])):
            edges.setdefault((min(a, b), max(a, b)), []).append(k)
    sharp = [edge for edge, sides in edges.items() if len(sides) < 2 or normals[sides[0]] @ normals[sides[1]] < 0.999]
    return faces, sorted(sharp)


def inline(x: np.ndarray) -> list[int]:
    """Order of points ``(n, 3)`` along the line they lie on."""
    d = x[:, None] - x[None]
    i, j = np.unravel_index(int((d**2).sum(axis=-1).argmax()), d.shape[:2])
    return np.argsort((x - x[i]) @ (x[j] - x[i]), kind="stable").tolist()
