"""Outlines of bodies in space, and what the rows of joints act on."""

import itertools
from dataclasses import dataclass

import numpy as np

from jaxnc.solvers.assembly import derive
from jaxnc.system.identity import Owner
from jaxnc.system.system import System
from jaxnc.system.topology import Block, Topology
from jaxnc.viz.bodies import FLAT, hull
from jaxnc.viz.spatial.scene import Way


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


# -- what rows act on ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RowReading:
    """Points and directions that an instance of a kind acts on."""

    block: Block  # where it is
    instance: int  # which one
    points: tuple[int, ...]  # its own points, without those of its directions
    ways: tuple[Way, ...]  # its directions
    vectors: tuple[int, ...]  # for each direction, the index of its unit vector; -1 for a segment

    def constants(self, system: System, start: str) -> list[float]:
        """List the values of those constants whose names start so."""
        top, kind = system.topology, self.block.kind
        values = np.asarray(derive(system).constants[top.blocks.index(self.block)])[self.instance]
        return [float(values[i]) for i, name in enumerate(kind.constants) if name.startswith(start)]


def read_rows(block: Block, instance: int, first: int) -> RowReading:
    """Read one instance; `first` is the column of the first unit vector."""
    words = block.kind.name.replace(",", " ").split()
    forms = next((word for word in reversed(words) if set(word) <= {"p", "v"}), "")
    points, vectors = list(block.points[instance]), list(block.vectors[instance])
    leading = len(points) - 2 * forms.count("p")
    rest = points[leading:]
    ways, own = [], []
    for form in forms:
        if form == "v":
            own.append(vectors.pop(0))
            ways.append(Way((first + own[-1],)))
        else:
            ways.append(Way((rest.pop(0), rest.pop(0))))
            own.append(-1)
    return RowReading(block, instance, tuple(points[:leading]), tuple(ways), tuple(own))


def owned_rows(top: Topology, owner: Owner, first: int) -> list[RowReading]:
    """Read all instances that belong to a joint or coordinate."""
    return [
        read_rows(block, i, first) for block in top.blocks for i, owners in enumerate(block.owners) if owner in owners
    ]
