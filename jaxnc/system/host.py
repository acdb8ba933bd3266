"""The constraint equations of one design in NumPy: the kinds' programs on lanes, nothing compiled.

What `jaxnc.system.equations` states for JAX, read from the same functions (see `jaxnc.system.structure`). Lanes are the
last axis of everything: poses ``(N, lanes)``, rows ``(rows, lanes)``.
"""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from jaxnc.constraints import Kind
from jaxnc.reading import function, partials, rate, trace
from jaxnc.system.bar_length import bar_length
from jaxnc.system.equations import Equations, pure_numbers
from jaxnc.system.frames import carried
from jaxnc.system.precision import WIDE, numbers
from jaxnc.system.shape import redraw
from jaxnc.system.structure import arrays, pattern, program, quadratic, size
from jaxnc.system.system import System, characteristic_length
from jaxnc.system.topology import Block, Topology

Function = Callable[[Sequence[Any]], tuple[Any, ...]]


@dataclass(frozen=True, eq=False)
class HostKind:
    """The functions of a kind on lanes; each takes its variables and constants (`rates` their derivatives too).

    Attributes:
        rows: the residual, unscaled.
        slopes: its derivatives that can differ from zero.
        places: row and variable of each of them.
        guard: what must stay positive; None if nothing.
        rates: its time derivatives of first, second and third order, made when asked for.
    """

    rows: Function
    slopes: Function
    places: tuple[tuple[int, int], ...]
    guard: Function | None
    rates: Callable[[int], Function]


@functools.cache
def host_kind(kind: Kind, dim: int) -> HostKind:
    """The functions of a kind, read once a process; through JAX where they cannot be read."""
    found = program(kind, "residual", dim)
    count = size(kind, dim)
    if found is None or (kind.guard is not None and program(kind, "guard", dim) is None):
        return _through_jax(kind, dim)
    slopes, places = partials(found, range(count))

    @functools.cache
    def rates(order: int) -> Function:
        return function(rate(found, range(count), order))

    return HostKind(function(found), function(slopes), places, _function(kind, "guard", dim), rates)


@functools.cache
def _function(kind: Kind, which: str, dim: int) -> Function | None:
    """One of a kind's functions on lanes; None if it has none."""
    if getattr(kind, which) is None:
        return None
    found = program(kind, which, dim)
    return _mapped(kind, which, dim) if found is None else function(found)


def _mapped(kind: Kind, which: str, dim: int, order: int = 0) -> Function:
    """A function of a kind, or its rate, that is evaluated by JAX because it cannot be read."""
    f, single = getattr(kind, which), which in ("measure", "misfit")
    count = size(kind, dim)

    def one(x: Any) -> Any:
        p, v, s, c = arrays(kind, dim, x)
        return jax.numpy.stack([jax.numpy.asarray(r) for r in ((f(p, v, c),) if single else f(p, v, s, c))])

    def along(x: Any) -> Any:
        whole, parts = x[: count + len(kind.constants)], x[count + len(kind.constants) :].reshape(order, count)

        def curve(t: Any) -> Any:
            factor, y = 1.0, whole
            for k in range(order):
                factor = factor * t / (k + 1)
                y = y.at[:count].add(factor * parts[k])
            return one(y)

        for _ in range(order):
            curve = functools.partial(lambda t, g: jax.jvp(g, (t,), (jax.numpy.ones_like(t),))[1], g=curve)
        return curve(jax.numpy.zeros((), x.dtype))

    return by_jax(along if order else one)


def by_jax(f: Callable[[Any], Any]) -> Function:
    """A function from an array to an array on lanes, evaluated by JAX because it cannot be read."""
    mapped = jax.jit(jax.vmap(f))

    def run(x: Sequence[Any]) -> tuple[Any, ...]:
        x = np.broadcast_arrays(*x)
        with numbers(x[0].dtype):
            out = np.asarray(mapped(np.stack(x, axis=-1).reshape(-1, len(x))))
        return tuple(out[:, k].reshape(x[0].shape) for k in range(out.shape[1]))

    return run


def unread_rows(kind: Kind, dim: int) -> Callable[[Any], Any]:
    """A kind's rows as a JAX function of its variables and constants."""
    return lambda x: jax.numpy.stack([jax.numpy.asarray(r) for r in kind.residual(*arrays(kind, dim, x))])


def _through_jax(kind: Kind, dim: int) -> HostKind:
    places = tuple((int(r), int(v)) for r, v in np.argwhere(pattern(kind, dim)))

    rows = unread_rows(kind, dim)

    def wanted(x: Any) -> Any:
        found = jax.jacfwd(rows)(x)
        return jax.numpy.stack([found[r, v] for r, v in places])

    slopes = by_jax(wanted)
    rates = functools.cache(lambda order: _mapped(kind, "residual", dim, order))
    return HostKind(_mapped(kind, "residual", dim), slopes, places, _function(kind, "guard", dim), rates)


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
    points, vectors, markers, dimensions = leaves
    with np.errstate(all="ignore"):
        drawing: Any = _redrawn(top, points, dimensions)
        length = float(bar_length(top, drawing) if top.large else characteristic_length(points))
        if len(vectors):
            vectors = vectors / _safe(np.linalg.norm(vectors, axis=1, keepdims=True))
        spread = np.concatenate([points.reshape(-1), vectors.reshape(-1)])
        constants: list[np.ndarray] = [np.zeros((0, 0))] * len(top.blocks)
        measuring = sorted({block for block, _ in top.measures})
        scalars = np.zeros(len(top.scalars), points.dtype)
        home = np.concatenate([spread, scalars])
        for b in measuring:
            constants[b] = _constants(top, b, drawing, vectors, None, dimensions)
            at = [(k, i) for k, (block, i) in enumerate(top.measures) if block == b]
            which, instances = [k for k, _ in at], [i for _, i in at]
            measure = _function(top.blocks[b].kind, "measure", top.dim)
            assert measure is not None
            x = home[top.layout[b].variables[instances].T]
            scalars[which] = measure([*x, *constants[b][instances].T])[0]
        home = np.concatenate([spread, scalars])
        for b in range(len(top.blocks)):
            if b not in measuring:
                constants[b] = _constants(top, b, drawing, vectors, home, dimensions)
        scales = tuple(_scales(top, b, constants[b], length) for b in range(len(top.blocks)))
        return HostEquations(
            top,
            home,
            length,
            tuple(constants),
            scales,
            _markers(top, points, vectors, markers, drawing),
            _misfit(top, drawing, vectors, constants),
        )


def _safe(x: np.ndarray) -> np.ndarray:
    return np.where(x > 0, x, 1.0)


@functools.cache
def _recipe(recipe: tuple, count: int, dim: int, values: int) -> Function:
    with numbers(WIDE):
        return function(trace(lambda h, v: (redraw(recipe, h, v),), (count, dim), (values,)))


def _redrawn(top: Topology, points: np.ndarray, dimensions: np.ndarray) -> np.ndarray:
    """The drawing followed by the redrawn points of every body with explicit dimensions."""
    parts = [points]
    for shape in top.shapes:
        members = np.array(shape.members)
        wanted = np.array(shape.dimensions, dtype=int).reshape(len(members), -1)
        run = _recipe(shape.recipe, members.shape[1], top.dim, wanted.shape[1])
        home = points[members].reshape(len(members), -1)
        out = run([*home.T, *dimensions[wanted].T])
        full = [np.broadcast_to(x, (len(members),)) for x in out]
        parts.append(np.stack(full, axis=1).reshape(-1, top.dim).astype(points.dtype))
    return np.concatenate(parts)


def _constants(
    top: Topology, b: int, drawing: np.ndarray, vectors: np.ndarray, home: np.ndarray | None, dimensions: np.ndarray
) -> np.ndarray:
    """Constants of a block's instances ``(instances, constants)``, read off the drawing or given."""
    block, layout = top.blocks[b], top.layout[b]
    kind, count = block.kind, block.count
    explicit = np.zeros((count, len(kind.constants)), drawing.dtype)
    drawn = _function(kind, "drawn", top.dim)
    if drawn is None or not kind.constants:
        return explicit
    fixed = np.zeros(explicit.shape, bool)
    for i, k, p, q in block.lengths:
        explicit[i, k] = np.linalg.norm(drawing[q] - drawing[p])
        fixed[i, k] = True
    for i, k, d in block.given:
        explicit[i, k] = dimensions[d]
        fixed[i, k] = True
    x = [
        *drawing[layout.drawn].reshape(count, -1).T,
        *vectors[layout.vectors].reshape(count, -1).T,
        *(np.zeros((kind.scalars, count), drawing.dtype) if home is None else home[layout.scalars].T),
    ]
    values = drawn([*x, *explicit.T])
    read = np.stack([np.broadcast_to(value, (count,)) for value in values], axis=1)
    return np.where(fixed, explicit, read).astype(drawing.dtype)


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


@functools.cache
def _carrier(dim: int, segments: int, direction: bool) -> Function:
    with numbers(WIDE):
        f = functools.partial(carried, direction=direction)
        return function(trace(lambda *x: (f(*x),), (segments, dim), (dim,), (dim,)))


def _markers(
    top: Topology, points: np.ndarray, vectors: np.ndarray, markers: np.ndarray, drawing: np.ndarray
) -> np.ndarray:
    out = np.zeros((len(top.markers), top.dim), points.dtype)

    def span(segment: tuple[int, ...], at: np.ndarray) -> np.ndarray:
        return vectors[~segment[0]] if len(segment) == 1 else at[segment[1]] - at[segment[0]]

    for k, marker in enumerate(top.markers):
        spans = [span(s, points) for s in marker.segments]
        w = markers[k] if marker.direction else markers[k] - points[marker.origin]
        run = _carrier(top.dim, len(spans), marker.direction)
        out[k] = run([*np.concatenate(spans), *w, *span(marker.drawn[0], drawing)])
    return out


def _misfit(top: Topology, drawing: np.ndarray, vectors: np.ndarray, constants: Sequence[np.ndarray]) -> float:
    worst = 0.0
    for b, block in enumerate(top.blocks):
        misfit = _function(block.kind, "misfit", top.dim)
        if misfit is None:
            continue
        layout, count = top.layout[b], block.count
        x = [*drawing[layout.drawn].reshape(count, -1).T, *vectors[layout.vectors].reshape(count, -1).T]
        x += [np.zeros(count, drawing.dtype)] * block.kind.scalars
        worst = max(worst, float(np.max(misfit([*x, *constants[b].T])[0])))
    return worst
