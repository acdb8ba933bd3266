"""Bodies as pictures of the plane and of space show them: what they hold, which move, their colours and outlines."""

import itertools

import numpy as np

from jaxnc.system.topology import Topology
from jaxnc.viz.poses import Poses
from jaxnc.viz.style import INK

FLAT = 0.02
"""Of a body's size: points nearer than this to a line or plane are drawn as lying on it."""


class Bodies:
    """Points, directions and bodies of a mechanism as index sets, and the colours of those that move."""

    def __init__(self, poses: Poses):
        self.top = top = poses.topology
        dim = poses.dim
        n, v = len(top.points), len(top.vectors)
        fixed = np.array(top.fixed[: dim * (n + v)], dtype=bool).reshape(n + v, dim)
        self.fixed = fixed[:n]
        self.ground: np.ndarray = np.all(fixed[:n], axis=1)
        self.half: np.ndarray = np.any(fixed[:n], axis=1) & ~self.ground
        self.still: np.ndarray = np.all(fixed[n:], axis=1)
        """Which vectors belong to the ground."""
        self.points = [set(b.points) for b in top.bodies]
        self.vectors: list[set[int]] = [set(b.vectors) for b in top.bodies]
        self.least = 2 if dim == 2 else 1  # points of a body that holds what is drawn; in space there are vectors too
        self.moving = [self._moves(k) for k in range(len(top.bodies))]
        self.groups = _rigid_groups(top)
        numbers: dict[int, int] = {}
        self.colours = [
            numbers.setdefault(group, len(numbers)) if moves else INK
            for group, moves in zip(self.groups, self.moving, strict=True)
        ]
        self.colour_by_name = {
            b.name: colour for b, colour, moves in zip(top.bodies, self.colours, self.moving, strict=True) if moves
        }

    def _moves(self, k: int) -> bool:
        still = all(self.ground[p] for p in self.points[k]) and all(self.still[v] for v in self.vectors[k])
        return not still or (self.least == 1 and len(self.points[k]) < 2)

    def holding(self, *points: int, vectors: tuple[int, ...] = ()) -> int | None:
        """Find the moving body that holds all of these."""
        for k, moves in enumerate(self.moving):
            enough = len(self.points[k]) >= self.least
            if moves and enough and set(points) <= self.points[k] and set(vectors) <= self.vectors[k]:
                return k
        return None

    def colour(self, *points: int, vectors: tuple[int, ...] = ()) -> int:
        """Find the colour of the moving body that holds all of these, or that of no body."""
        k = self.holding(*points, vectors=vectors)
        return INK if k is None else self.colours[k]

    def column_colours(self) -> tuple[int, ...]:
        """List the colours of points, and of markers that are places."""
        markers = (m for m in self.top.markers if not m.direction)
        points = (self.colour(p) for p in range(len(self.top.points)))
        return (*points, *(self.colour_by_name.get(m.body, INK) for m in markers))

    def meeting(self, p: int) -> list[tuple[set[int], set[int], int]]:
        """List what meets at a point: points, vectors and group (-1 for the ground) of each."""
        found = [
            (self.points[k], self.vectors[k], self.groups[k])
            for k, moves in enumerate(self.moving)
            if moves and p in self.points[k]
        ]
        if self.ground[p]:
            everything = set(np.flatnonzero(self.ground).tolist()), set(np.flatnonzero(self.still).tolist())
            found.append((*everything, -1))
        return found


def _rigid_groups(top: Topology) -> list[int]:
    """Number the rigid group of each body: welded bodies are one."""
    group = list(range(len(top.bodies)))
    for joint in top.joints:
        if joint.bodies:
            first, second = (group[k] for k in joint.bodies)
            group = [first if g == second else g for g in group]
    return group


def hull(x: np.ndarray) -> list[int]:
    """Find the convex hull of points ``(n, 2)``, anticlockwise, as indices."""
    order = sorted(range(len(x)), key=lambda i: (x[i, 0], x[i, 1]))

    def chain(indices: list[int]) -> list[int]:
        out: list[int] = []
        for i in indices:
            while len(out) > 1 and _turn(x[out[-2]], x[out[-1]], x[i]) <= 0:
                out.pop()
            out.append(i)
        return out[:-1]

    return chain(order) + chain(order[::-1])


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def rank(x: np.ndarray) -> int:
    """Find the dimension that points ``(n, 3)`` spread over: 0, 1, 2 or 3."""
    d = x - x.mean(axis=0)
    size = np.linalg.svd(d, compute_uv=False) if len(x) > 1 else np.zeros(1)
    return int(np.sum(size > FLAT * size[0])) if size[0] > 0 else 0


def outline(x: np.ndarray) -> tuple[list[tuple[int, ...]], list[tuple[int, int]]]:
    """Find the faces and edges of the convex hull of points ``(n, 3)`` that do not lie on a line, as indices.

    A body has few points: every three of them are tried.
    """
    if rank(x) == 2:
        _, _, axes = np.linalg.svd(x - x.mean(axis=0))
        order = hull((x - x.mean(axis=0)) @ axes[:2].T)
        return [tuple(order)], _round(order)
    i, j, k = np.array(list(itertools.combinations(range(len(x)), 3))).T
    a, b = x[j] - x[i], x[k] - x[i]
    normals = np.cross(a, b)
    size = np.linalg.norm(normals, axis=1)
    wide = size > 1e-6 * np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    normals, i, j = normals[wide] / size[wide, None], i[wide], j[wide]
    height = normals @ x.T - np.sum(normals * x[i], axis=1)[:, None]
    near = 1e-7 * np.ptp(x, axis=0).max()
    outside = np.flatnonzero((height <= near).all(axis=1) | (height >= -near).all(axis=1))
    faces: dict[tuple[int, ...], np.ndarray] = {}  # with their normals, which point outwards
    for n in outside:
        on = np.flatnonzero(np.abs(height[n]) <= near)
        along = x[j[n]] - x[i[n]]
        flat = (x[on] - x[i[n]]) @ np.stack([along, np.cross(normals[n], along)], axis=1)
        order = on[hull(flat)].tolist()
        begin = order.index(min(order))
        face = (*order[begin:], *order[:begin])
        if not any(set(face) == set(other) for other in faces):
            faces[face] = normals[n] * (1.0 if height[n].min() < -near else -1.0)
    sides: dict[tuple[int, int], list[np.ndarray]] = {}
    for face, normal in faces.items():
        for a, b in _round(list(face)):
            sides.setdefault((min(a, b), max(a, b)), []).append(normal)
    return list(faces), sorted(edge for edge, n in sides.items() if len(n) < 2 or n[0] @ n[1] < 0.999)


def _round(order: list[int]) -> list[tuple[int, int]]:
    return [(order[k - 1], order[k]) for k in range(len(order))]


def inline(x: np.ndarray) -> list[int]:
    """Order of points ``(n, 3)`` along the line they lie on."""
    d = x[:, None] - x[None]
    i, j = np.unravel_index(int((d**2).sum(axis=-1).argmax()), d.shape[:2])
    return np.argsort((x - x[i]) @ (x[j] - x[i]), kind="stable").tolist()
