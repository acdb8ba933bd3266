"""The constraint equations in NumPy: the kinds' programs on lanes, of one design or of a design for each lane.

What `jaxnc.system.equations` states for JAX, read from the same functions (see `jaxnc.system.structure`). Lanes are the
last axis of everything: poses ``(N, lanes)``, rows ``(rows, lanes)``.
"""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxnc.constraints import Kind
from jaxnc.reading import Program, function, partials
from jaxnc.system.bar_length import bar_length
from jaxnc.system.drawn import drawn
from jaxnc.system.equations import Equations, pure_numbers
from jaxnc.system.host_kinds import HostKind, carried_rows, function_of, host_kind
from jaxnc.system.structure import program, quadratic, size
from jaxnc.system.system import System, characteristic_length
from jaxnc.system.topology import Block, Topology


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

    def taken(self, which: np.ndarray) -> "HostEquations":
        """The same with other lanes: places of theirs among these, or which of these; one shared design stays."""
        if self.designs is None:
            return self

        def of(x: Any, axes: int) -> Any:
            return x[..., which] if np.ndim(x) > axes else x

        constants, scales = (tuple(of(x, 2) for x in y) for y in (self.constants, self.scales))
        rest = of(self.markers, 2), of(self.misfit, 0)
        return HostEquations(self.topology, of(self.home, 1), of(self.length, 0), constants, scales, *rest)

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

    def _local(self, b: int, q: np.ndarray) -> list[Any]:
        """Variables and constants of a block's instances, each ``(instances, lanes)`` or ``(instances, 1)``."""
        return [*q[self.topology.layout[b].variables.T], *self._given[b][0]]

    def residual(self, q: np.ndarray) -> np.ndarray:
        """All rows as lengths, ``(rows, lanes)``."""
        top = self.topology
        out = np.empty((len(top.rows), q.shape[1]), self.dtype)
        for b, block in enumerate(top.blocks):
            if not block.kind.rows:
                continue
            at = top.layout[b].rows.T
            for r, value in enumerate(self._kinds[b].rows(self._local(b, q))):
                out[at[r]] = value * self._given[b][1][r]
        return out

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
            layout, run = top.layout[b], self._kinds[b].rates(len(terms))
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
            for r, value in enumerate(carried_rows(block.kind, top.dim, len(terms))(x)):
                out[layout.rows.T[r]] = value[..., 1:] * self.scales[b][:, r, None, None]
        return out

    def guards(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whether no row and no body is met by a mirror image, and whether a body is, ``(lanes,)``."""
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
            run = function_of(top.blocks[b].kind, "measure", top.dim)
            assert run is not None
            constants = [c[instance] for c in self._given[b][0]]
            out[k] = run([*q[top.layout[b].variables[instance]], *constants])[0]
        return out

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Dense Jacobian of all rows with respect to all coordinates, ``(lanes, rows, N)``."""
        from jaxnc.system.equations import places

        r, c, _ = places(self.topology)
        out = np.zeros((len(self.topology.rows), len(self.home), q.shape[1]), self.dtype)
        np.add.at(out, (r, c), self.entries(q))  # pyright: ignore[reportArgumentType]
        return np.moveaxis(out, 2, 0)

    def for_jax(self) -> Equations:
        """The same for JAX, with the coefficients of quadratic kinds."""
        top, linear, second = self.topology, [], []
        for b, block in enumerate(top.blocks):
            if not quadratic(block.kind, top.dim):
                linear.append(None)
                second.append(None)
                continue
            g, h = coefficients(block, top.dim, self.constants[b])
            linear.append(g * self.scales[b][:, :, None])
            second.append(h * self.scales[b][:, :, None, None])
        like: Callable[[Any], Any] = functools.partial(np.asarray, dtype=self.dtype)
        make: Any = Equations  # NumPy arrays will do for its leaves
        return make(
            top, self.home, like(self.length), self.constants, self.scales, tuple(linear), tuple(second),
            self.markers, like(self.misfit),
        )  # fmt: skip


@functools.lru_cache(maxsize=1024)
def _second(kind: Kind, dim: int, read: Callable[[Program], Any]) -> tuple[Any, tuple, Any, tuple]:
    """Derivatives of a quadratic kind's rows, and the derivatives of these."""
    found, count = program(kind, "residual", dim), size(kind, dim)
    assert found is not None
    first, places = partials(found, range(count))
    second, pairs = partials(first, range(count))
    return read(first), places, read(second), tuple((*places[k], v) for k, v in pairs)


def coefficients(
    block: Block, dim: int, constants: np.ndarray, read: Callable[[Program], Any] = function
) -> tuple[np.ndarray, np.ndarray]:
    """Jacobian at the origin ``(instances, rows, variables)``, and second derivatives, of a quadratic kind.

    Constants that carry changes have them last, and are `read` by `jaxnc.system.on_lanes.carrying`.
    """
    kind, count, tail = block.kind, size(block.kind, dim), constants.shape[2:]
    first, places, second, triples = _second(kind, dim, read)
    g = np.zeros((block.count, len(kind.rows), count, *tail), constants.dtype)
    h = np.zeros((block.count, len(kind.rows), count, count, *tail), constants.dtype)
    x = [*(np.zeros((block.count, *tail), constants.dtype),) * count, *np.moveaxis(constants, 1, 0)]
    for (r, v), value in zip(places, first(x), strict=True):
        g[:, r, v] = value
    for (r, v, w), value in zip(triples, second(x), strict=True):
        h[:, r, v, w] = value
    return g, h


def from_jax(eq: Any) -> HostEquations:
    """The equations on the host, from those for JAX (not traced), or from a record with the same fields.

    Numbers may have a leading axis of designs, those that the designs share need not.
    """

    def like(x: Any, axes: int) -> Any:
        x = np.asarray(x)
        if x.ndim > axes:
            return np.ascontiguousarray(np.moveaxis(x, 0, -1))
        return x if axes else float(x)

    constants, scales = (tuple(like(x, 2) for x in y) for y in (eq.constants, eq.scales))
    rest = like(eq.markers, 2), like(eq.misfit, 0)
    return HostEquations(eq.topology, like(eq.home, 1), like(eq.length, 0), constants, scales, *rest)


def host_equations(system: System) -> HostEquations:
    """Derive the equations of a system whose parameters are numbers (not traced); compiles nothing."""
    top, par = system.topology.structure, system.parameters
    leaves: list[Any] = [np.asarray(x) for x in (par.points, par.vectors, par.markers, par.dimensions)]
    with np.errstate(all="ignore"):
        found = drawn(top, *(x[..., None] for x in leaves))
        drawing, vectors = found.drawing[..., 0], found.vectors[..., 0]
        constants = tuple(c[..., 0] for c in found.constants)
        given: Any = drawing
        length = float(bar_length(top, given) if top.large else characteristic_length(leaves[0]))
        scales = tuple(_scales(top, b, constants[b], length) for b in range(len(top.blocks)))
        misfit = _misfit(top, drawing, vectors, constants)
        return HostEquations(top, found.home[..., 0], length, constants, scales, found.markers[..., 0], misfit)


def _safe(x: np.ndarray) -> np.ndarray:
    return np.where(x > 0, x, 1.0)


def _scales(top: Topology, b: int, constants: np.ndarray, length: float) -> np.ndarray:
    """Factors that turn rows into lengths, ``(instances, rows)``."""
    block, layout = top.blocks[b], top.layout[b]
    out = np.zeros((block.count, len(block.kind.rows)), constants.dtype)
    for r, power in enumerate(block.kind.powers):
        if power is not None:
            out[:, r] = length ** (1 - power)
            continue
        turns = pure_numbers(top)[layout.variables]
        largest = np.max(
            np.abs(coefficients(block, top.dim, constants)[0][:, r]) * np.where(turns, 1.0, length), axis=1
        )
        out[:, r] = length / _safe(largest)
    return out


def _misfit(top: Topology, drawing: np.ndarray, vectors: np.ndarray, constants: Sequence[np.ndarray]) -> float:
    worst = 0.0
    for b, block in enumerate(top.blocks):
        misfit = function_of(block.kind, "misfit", top.dim)
        if misfit is None:
            continue
        layout, count = top.layout[b], block.count
        x = [*drawing[layout.drawn].reshape(count, -1).T, *vectors[layout.vectors].reshape(count, -1).T]
        x += [np.zeros(count, drawing.dtype)] * block.kind.scalars
        worst = max(worst, float(np.max(misfit([*x, *constants[b].T])[0])))
    return worst
