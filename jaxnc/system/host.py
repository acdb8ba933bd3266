"""The constraint equations of one design in NumPy: the kinds' programs on lanes, nothing compiled.

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
from jaxnc.reading import function, partials
from jaxnc.system.bar_length import bar_length
from jaxnc.system.drawn import drawn
from jaxnc.system.equations import Equations, pure_numbers
from jaxnc.system.host_kinds import Function, carried_rows, function_of, host_kind
from jaxnc.system.structure import program, quadratic, size
from jaxnc.system.system import System, characteristic_length
from jaxnc.system.topology import Block, Topology


@dataclass(frozen=True, eq=False)
class HostEquations:
    """The constraint equations of one design on the host; the fields of `Equations`, of NumPy arrays."""

    topology: Topology
    home: np.ndarray
    length: float
    constants: tuple[np.ndarray, ...]
    scales: tuple[np.ndarray, ...]
    markers: np.ndarray
    misfit: float

    @property
    def dtype(self) -> np.dtype:
        """Type of the numbers."""
        return self.home.dtype

    @functools.cached_property
    def weights(self) -> np.ndarray:
        """Factors that turn coordinates into lengths, ``(N,)``."""
        return np.where(pure_numbers(self.topology), self.length, 1.0).astype(self.dtype)

    def _local(self, b: int, q: np.ndarray) -> list[Any]:
        """Variables and constants of a block's instances, each ``(instances, lanes)`` or ``(instances, 1)``."""
        c = self.constants[b]
        return [*q[self.topology.layout[b].variables.T], *c.T[:, :, None]]

    def residual(self, q: np.ndarray) -> np.ndarray:
        """All rows as lengths, ``(rows, lanes)``."""
        top = self.topology
        out = np.empty((len(top.rows), q.shape[1]), self.dtype)
        for b, block in enumerate(top.blocks):
            if not block.kind.rows:
                continue
            at = top.layout[b].rows.T
            for r, value in enumerate(host_kind(block.kind, top.dim).rows(self._local(b, q))):
                out[at[r]] = value * self.scales[b][:, r, None]
        return out

    def entries(self, q: np.ndarray) -> np.ndarray:
        """Derivatives of every row with respect to its own instance's variables, ``(entries, lanes)``.

        In the order of `jaxnc.system.equations.entries`.
        """
        top, parts = self.topology, []
        for b, block in enumerate(top.blocks):
            kind, variables = host_kind(block.kind, top.dim), top.layout[b].variables
            out = np.zeros((block.count, len(block.kind.rows), variables.shape[1], q.shape[1]), self.dtype)
            for (r, v), value in zip(kind.places, kind.slopes(self._local(b, q)), strict=True):
                out[:, r, v] = value * self.scales[b][:, r, None]
            parts.append(out.reshape(math.prod(out.shape[:3]), q.shape[1]))
        return np.concatenate(parts) if parts else np.zeros((0, q.shape[1]), self.dtype)

    def rates(self, q: np.ndarray, terms: Sequence[np.ndarray]) -> np.ndarray:
        """The time derivative of all rows whose order is the number of the coordinates' derivatives given."""
        top = self.topology
        out = np.empty((len(top.rows), q.shape[1]), self.dtype)
        for b, block in enumerate(top.blocks):
            if not block.kind.rows:
                continue
            layout, run = top.layout[b], host_kind(block.kind, top.dim).rates(len(terms))
            more = [x for term in terms for x in term[layout.variables.T]]
            for r, value in enumerate(run([*self._local(b, q), *more])):
                out[layout.rows.T[r]] = value * self.scales[b][:, r, None]
        return out

    def changes(self, q: np.ndarray, terms: Sequence[np.ndarray], constants: Sequence[np.ndarray]) -> np.ndarray:
        """Changes of all rows, or of a time derivative of them, with those of everything that they contain.

        Args:
            q: poses with their changes, ``(N, lanes, 1 + changes)``.
            terms: so many of their time derivatives, as `rates` has them, each with its changes.
            constants: per block, with their changes, ``(instances, constants, 1 + changes)``.

        Returns:
            The changes, ``(rows, lanes, changes)``; those of the scales, which no solution depends on, are left out.
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
            guard = host_kind(block.kind, top.dim).guard
            if guard is None:
                continue
            for value in guard(self._local(b, q)):
                good = np.broadcast_to(value > 0.0, (block.count, q.shape[1])).all(axis=0)
                upright &= good
                if block.kind.mirror:
                    mirrored |= np.broadcast_to(value <= 0.0, (block.count, q.shape[1])).any(axis=0)
        return upright, mirrored

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
            g, h = _coefficients(block, top.dim, self.constants[b])
            linear.append(g * self.scales[b][:, :, None])
            second.append(h * self.scales[b][:, :, None, None])
        like: Callable[[Any], Any] = functools.partial(np.asarray, dtype=self.dtype)
        make: Any = Equations  # NumPy arrays will do for its leaves
        return make(
            top, self.home, like(self.length), self.constants, self.scales, tuple(linear), tuple(second),
            self.markers, like(self.misfit),
        )  # fmt: skip


@functools.cache
def _second(kind: Kind, dim: int) -> tuple[Function, tuple[tuple[int, int], ...], Function, tuple]:
    """Derivatives of a quadratic kind's rows, and the derivatives of these."""
    found = program(kind, "residual", dim)
    assert found is not None
    count = size(kind, dim)
    first, places = partials(found, range(count))
    second, pairs = partials(first, range(count))
    return function(first), places, function(second), tuple((*places[k], v) for k, v in pairs)


def _coefficients(block: Block, dim: int, constants: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Jacobian at the origin ``(instances, rows, variables)``, and second derivatives, of a quadratic kind."""
    kind, count = block.kind, size(block.kind, dim)
    first, places, second, triples = _second(kind, dim)
    g = np.zeros((block.count, len(kind.rows), count), constants.dtype)
    h = np.zeros((block.count, len(kind.rows), count, count), constants.dtype)
    x = [*(np.zeros(block.count, constants.dtype),) * count, *constants.T]
    for (r, v), value in zip(places, first(x), strict=True):
        g[:, r, v] = value
    for (r, v, w), value in zip(triples, second(x), strict=True):
        h[:, r, v, w] = value
    return g, h


def from_jax(eq: Equations) -> HostEquations:
    """The equations of a design on the host, from those for JAX (not traced)."""
    home, *rest = (np.asarray(x) for x in (eq.home, eq.length, eq.markers, eq.misfit))
    length, markers, misfit = rest
    constants, scales = (tuple(np.asarray(x) for x in y) for y in (eq.constants, eq.scales))
    return HostEquations(eq.topology, home, float(length), constants, scales, markers, float(misfit))


def host_equations(system: System) -> HostEquations:
    """Derive the equations of a system whose parameters are numbers (not traced); compiles nothing."""
    top, par = system.topology, system.parameters
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
            np.abs(_coefficients(block, top.dim, constants)[0][:, r]) * np.where(turns, 1.0, length), axis=1
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
