"""The constraint equations in NumPy: the kinds' programs on lanes, of one design or of a design for each lane.

What `jaxnc.system.equations` states for JAX, read from the same functions (see `jaxnc.system.structure`). Lanes are the
last axis of everything: poses ``(N, lanes)``, rows ``(rows, lanes)``.
"""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.constraints import Kind
from jaxnc.system.equations import places, pure_numbers
from jaxnc.system.structure import Function, HostKind, formula, host_kind, row_derivatives, size
from jaxnc.system.topology import Topology

if TYPE_CHECKING:
    from jaxnc.system.equations import Equations

Slot = tuple[int, int, int] | int  # a constant (block, instance, constant), or a coordinate of the ground


@dataclass(frozen=True, eq=False)
class HostEquations:
    """The constraint equations on the host; the fields of `Equations`, of NumPy arrays.

    Of one design for all lanes, or with a design in every lane: then numbers that differ have lanes as their last axis.
    """

    topology: Topology
    home: np.ndarray
    length: Any
    constants: tuple[np.ndarray, ...]
    scales: tuple[np.ndarray, ...]
    markers: np.ndarray
    misfit: Any
    rounded: bool = False

    @property
    def dtype(self) -> np.dtype:
        """Type of the numbers."""
        return self.home.dtype

    @functools.cached_property
    def designs(self) -> int | None:
        """How many designs these are; None for one that all lanes share."""
        return next((x.shape[-1] for x, axes in self._numbers() if np.ndim(x) > axes), None)

    def _numbers(self) -> list[tuple[Any, int]]:
        """All numbers, and how many axes they have of one design."""
        one = [(self.home, 1), (self.length, 0), (self.markers, 2), (self.misfit, 0)]
        return [*one, *((x, 2) for x in (*self.constants, *self.scales))]

    def select(self, which: np.ndarray) -> "HostEquations":
        """Choose lanes, by their places or by truth values; one shared design stays."""
        if self.designs is None:
            return self
        return _each(self, lambda x, axes: x[..., which] if np.ndim(x) > axes else x)

    @functools.cached_property
    def weights(self) -> np.ndarray:
        """Factors that turn coordinates into lengths, ``(N,)``, or ``(N, lanes)`` of as many designs."""
        pure = pure_numbers(self.topology)
        pure = pure[:, None] if np.ndim(self.length) else pure
        return np.where(pure, self.length, 1.0).astype(self.dtype)

    @functools.cached_property
    def _given(self) -> list[tuple[list[np.ndarray], list[np.ndarray]]]:
        """Per block its constants and its rows' scales, each ``(instances, lanes)`` or ``(instances, 1)``."""

        def columns(x: np.ndarray) -> list[np.ndarray]:
            return list(np.moveaxis(x if x.ndim == 3 else x[:, :, None], 1, 0))

        return [(columns(c), columns(scale)) for c, scale in zip(self.constants, self.scales, strict=True)]

    @functools.cached_property
    def numbers(self) -> list[Any]:
        """Per block and instance its constants and scales: numbers, or lanes of designs."""

        def of(x: np.ndarray, instance: int) -> list[Any]:
            if not x.size:
                return []
            return x[instance].tolist() if x.ndim == 2 else list(x[instance])

        out: list[Any] = []
        for block, constants, scales in zip(self.topology.blocks, self.constants, self.scales, strict=True):
            for k in range(block.count):
                out += of(constants, k) + of(scales, k)
        return out

    @functools.cached_property
    def _kinds(self) -> list[HostKind]:
        """The functions of each block's kind."""
        return [host_kind(block.kind, self.topology.dim) for block in self.topology.blocks]

    def _local(self, b: int, q: np.ndarray) -> list[np.ndarray]:
        """Variables and constants of a block's instances, each ``(instances, lanes)`` or ``(instances, 1)``."""
        return [*q[self.topology.layout[b].variables.T], *self._given[b][0]]

    def residual(self, q: np.ndarray) -> np.ndarray:
        """All rows as lengths, ``(rows, lanes)``."""
        return self.rates(q, ())

    def entries(self, q: np.ndarray) -> np.ndarray:
        """Derivatives of every row with respect to its own instance's variables, ``(entries, lanes)``.

        In the order of `jaxnc.system.equations.entries`.
        """
        top, parts = self.topology, []
        for b, block in enumerate(top.blocks):
            kind, variables = self._kinds[b], top.layout[b].variables
            out = np.zeros((block.count, len(block.kind.rows), variables.shape[1], q.shape[1]), self.dtype)
            for (r, v), value in zip(kind.places, kind.slopes(self._local(b, q)), strict=True):
                out[:, r, v] = value * self._given[b][1][r]
            parts.append(out.reshape(math.prod(out.shape[:3]), q.shape[1]))
        return np.concatenate(parts) if parts else np.zeros((0, q.shape[1]), self.dtype)

    def rates(self, q: np.ndarray, terms: Sequence[np.ndarray]) -> np.ndarray:
        """The time derivative of all rows whose order is the number of the coordinates' derivatives given."""
        top = self.topology
        out = np.empty((len(top.rows), q.shape[1]), self.dtype)
        for b, block in enumerate(top.blocks):
            if not block.kind.rows:
                continue
            layout, kind = top.layout[b], self._kinds[b]
            run = kind.rates(len(terms)) if terms else kind.rows
            more = [x for term in terms for x in term[layout.variables.T]]
            for r, value in enumerate(run([*self._local(b, q), *more])):
                out[layout.rows.T[r]] = value * self._given[b][1][r]
        return out

    def changes(self, q: np.ndarray, terms: Sequence[np.ndarray], constants: Sequence[np.ndarray]) -> np.ndarray:
        """Changes ``(rows, lanes, changes)`` of all rows, or of a time derivative of them, but for those of the scales.

        Poses ``(N, lanes, 1 + changes)``, so many of their time derivatives, as `rates` has them, and constants of each
        block ``(instances, constants, 1 + changes)`` come with their changes.
        """
        top = self.topology
        out = np.zeros((len(top.rows), q.shape[1], q.shape[2] - 1), self.dtype)
        for b, block in enumerate(top.blocks):
            if not block.kind.rows:
                continue
            layout = top.layout[b]
            x = list(q[layout.variables.T])
            x += list(np.moveaxis(constants[b], 1, 0)[:, :, None])
            x += [column for term in terms for column in term[layout.variables.T]]
            for r, value in enumerate(formula(block.kind, "residual", top.dim, len(terms)).carrying(x)):
                out[layout.rows.T[r]] = value[..., 1:] * self.scales[b][:, r, None, None]
        return out

    def guards(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Tell whether no row and no body is met by a mirror image, and whether a body is, ``(lanes,)``."""
        top = self.topology
        upright, mirrored = np.ones(q.shape[1], bool), np.zeros(q.shape[1], bool)
        for b, block in enumerate(top.blocks):
            guard = self._kinds[b].guard
            if guard is None:
                continue
            for value in guard(self._local(b, q)):
                good = np.broadcast_to(value > 0.0, (block.count, q.shape[1])).all(axis=0)
                upright &= good
                if block.kind.mirror:
                    mirrored |= np.broadcast_to(value <= 0.0, (block.count, q.shape[1])).any(axis=0)
        return upright, mirrored

    def measured(self, q: np.ndarray) -> np.ndarray:
        """Angles and distances as the points and vectors of poses ``(N, lanes)`` have them, ``(scalars, lanes)``."""
        top = self.topology
        out = np.zeros((len(top.scalars), q.shape[1]), self.dtype)
        for k, (b, instance) in enumerate(top.measures):
            run = formula(top.blocks[b].kind, "measure", top.dim).on_lanes
            constants = [c[instance] for c in self._given[b][0]]
            out[k] = run([*q[top.layout[b].variables[instance]], *constants])[0]
        return out

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Dense Jacobian of all rows with respect to all coordinates, ``(lanes, rows, N)``."""
        r, c, _ = places(self.topology)
        out = np.zeros((len(self.topology.rows), len(self.home), q.shape[1]), self.dtype)
        np.add.at(out, (r, c), self.entries(q))
        return np.moveaxis(out, 2, 0)


def from_jax(eq: "Equations") -> HostEquations:
    """The equations on the host, from those for JAX (not traced), or from a record with the same fields.

    Numbers may have a leading axis of designs, those that the designs share need not.
    """

    def like(x: Any, axes: int) -> Any:
        x = np.asarray(x)
        if x.ndim > axes:
            return np.ascontiguousarray(np.moveaxis(x, 0, -1))
        return x if axes else float(x)

    return _each(eq, like)


def _each(eq: "Equations | HostEquations", of: Callable) -> HostEquations:
    """Make equations of numbers, each from that of others and how many axes it has of one design."""
    constants, scales = (tuple(of(x, 2) for x in y) for y in (eq.constants, eq.scales))
    rest = of(eq.markers, 2), of(eq.misfit, 0), eq.rounded
    return HostEquations(eq.topology, of(eq.home, 1), of(eq.length, 0), constants, scales, *rest)


@functools.lru_cache(maxsize=1024)
def _expanded_rows(kind: Kind, dim: int, asked: tuple[int, ...]) -> tuple[Function, np.ndarray, Function, np.ndarray]:
    """First and second derivatives of a kind's rows by some variables and constants, and their rows and places."""
    slopes, pairs = row_derivatives(kind, dim, asked, 1)
    bends, triples = row_derivatives(kind, dim, asked, 2)
    return slopes, np.array(pairs, int).reshape(-1, 2), bends, np.array(triples, int).reshape(-1, 3)


class Expansion:
    """Rows of one design with their first and second derivatives by the coordinates and by a dimension, in NumPy.

    Lanes are dimensions: in each another one is changed.
    """

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
            found = _expanded_rows(block.kind, top.dim, asked)
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
