"""Rows of one design with their first and second derivatives by the coordinates and by a dimension, in NumPy.

Lanes are dimensions: in each another one is changed.
"""

import functools
from collections.abc import Sequence

import numpy as np

from jaxnc.constraints import Kind
from jaxnc.system.host import HostEquations
from jaxnc.system.host_kinds import Function, host_kind, row_derivatives
from jaxnc.system.structure import size

Slot = tuple[int, int, int] | int  # a constant (block, instance, constant), or a coordinate of the ground


@functools.lru_cache(maxsize=1024)
def _derivatives(kind: Kind, dim: int, asked: tuple[int, ...]) -> tuple[Function, np.ndarray, Function, np.ndarray]:
    """First and second derivatives of a kind's rows by some variables and constants, and which: row and places."""
    slopes, pairs = row_derivatives(kind, dim, asked, 1)
    bends, triples = row_derivatives(kind, dim, asked, 2)
    return slopes, np.array(pairs, int).reshape(-1, 2), bends, np.array(triples, int).reshape(-1, 3)


class Expansion:
    """Rows and their derivatives, each lane with a dimension of its own."""

    def __init__(self, eq: HostEquations, slots: Sequence[Slot]):
        self.eq, self.slots = eq, slots
        top, count = eq.topology, len(slots)
        self.coordinates = len(top.coordinates)
        lanes, wide = np.arange(count), self.coordinates + 2  # the dimension, and what is changed by no lane
        self.of_ground = np.array([k for k, slot in enumerate(slots) if isinstance(slot, int)], int)
        self.ground = np.array([slot for slot in slots if isinstance(slot, int)], int)
        self.changed = [(k, *slot) for k, slot in enumerate(slots) if not isinstance(slot, int)]
        self.functions: list[tuple[Function, np.ndarray, Function, np.ndarray]] = []
        first, second = [np.zeros(0, int)], [np.zeros(0, int)]
        for b, block in enumerate(top.blocks):
            variables, rows = top.layout[b].variables, top.layout[b].rows
            places = np.full((variables.shape[1] + len(block.kind.constants), block.count, count), wide - 1)
            places[: variables.shape[1]] = variables.T[:, :, None]
            for lane, which, i, k in self.changed:
                if which == b:
                    places[variables.shape[1] + k, i, lane] = wide - 2
            constants = sorted({k for _, which, _, k in self.changed if which == b})
            count_of = size(block.kind, top.dim)
            asked = (*range(count_of), *(count_of + k for k in constants))
            found = _derivatives(block.kind, top.dim, asked)
            self.functions.append(found)
            (r, v), (_, x, y) = found[1].T, found[3].T
            first.append(((lanes * len(top.rows) + rows.T[r][:, :, None]) * wide + places[v]).ravel())
            second.append(((lanes * wide + places[x]) * wide + places[y]).ravel())
        self.first, self.second = np.concatenate(first), np.concatenate(second)

    def __call__(
        self, q: np.ndarray, change: np.ndarray, factors: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows and derivatives at a pose in each lane.

        Args:
            q: the poses, ``(N, lanes)``.
            change: what each dimension is changed by, ``(lanes,)``.
            factors: what each row counts in the second derivatives, ``(rows, lanes)``.

        Returns:
            Rows ``(rows, lanes)``; their derivatives by the coordinates and, in the last place, by the dimension
            ``(lanes, rows, N + 1)``; second derivatives of their weighted sum ``(lanes, N + 1, N + 1)``.
        """
        top, (_, count), n = self.eq.topology, q.shape, self.coordinates
        q, out = q.copy(), np.zeros((len(top.rows), q.shape[1]))
        q[self.ground, self.of_ground] += change[self.of_ground]
        first, second = [np.zeros(0)], [np.zeros(0)]
        for b, block in enumerate(top.blocks):
            if not block.kind.rows:
                continue
            rows, scales = top.layout[b].rows.T, self.eq.scales[b].T[:, :, None]
            constants = np.repeat(self.eq.constants[b].T[:, :, None], count, axis=2)
            for lane, which, i, k in self.changed:
                if which == b:
                    constants[k, i, lane] += change[lane]
            x = [*q[top.layout[b].variables.T], *constants]
            for r, value in enumerate(host_kind(block.kind, top.dim).rows(x)):
                out[rows[r]] = value * scales[r]
            slopes, at, bends, of = self.functions[b]
            shape = (block.count, count)
            for (r, _), value in zip(at, slopes(x), strict=True):
                first.append(np.broadcast_to(value * scales[r], shape).ravel())
            for (r, _, _), value in zip(of, bends(x), strict=True):
                second.append(np.broadcast_to(value * scales[r] * factors[rows[r]], shape).ravel())
        wide = n + 2
        slope = np.bincount(self.first, np.concatenate(first), count * len(top.rows) * wide)
        curve = np.bincount(self.second, np.concatenate(second), count * wide * wide)
        slope, curve = slope.reshape(count, -1, wide)[:, :, :-1], curve.reshape(count, wide, wide)[:, :-1, :-1]
        lane, at = self.of_ground, self.ground
        slope[lane, :, n] = slope[lane, :, at]
        curve[lane, n] = curve[lane, at]
        curve[lane, :, n] = curve[lane, :, at]
        return out, slope, curve
