"""The program of a drawing: lengths, frames, constants, angles as drawn, coefficients of markers.

The numbers of a design stand in one row: a zero, then points, vectors, markers and dimensions as they are given, and
angles near which those of the drawing are measured. Each step of the program gathers numbers of the row, calculates
with them for several instances at once, and puts its results behind. The readings are NumPy (with changes along the
last axis, if wanted), JAX, and the nodes of a larger program.
"""

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.constraints.elementary import Small, ratio, root, stacked, where
from jaxnc.constraints.kind import cross, dot, norm, unit
from jaxnc.reading import write
from jaxnc.records import with_owner
from jaxnc.system.frames import carried
from jaxnc.system.structure import Formula, formula
from jaxnc.system.system import Parameters
from jaxnc.system.topology import INDEX, Block, BlockLayout, Segment, Topology
from jaxnc.types import AnyArray, Array, Components, Float, Numbers

if TYPE_CHECKING:
    from jaxnc.system.topology import Shape

Places = np.ndarray
"""Where numbers stand in the row of a design."""


class Step(NamedTuple):
    """A function that is done for several instances."""

    finds: str  # "shape", "unit", "length", "marker", "constants", "measure", "turn" or "misfit"
    formula: Formula  # the function
    given: Places  # what it takes of each instance, (numbers, instances)
    at: tuple[int, ...]  # its coordinates, of a "measure": which angles and distances they are


class Design:
    """The program of a topology, and where its results stand."""

    def __init__(self, top: Topology):
        self.top, dim = top, top.dim
        self.blocks, self.layouts = (*top.blocks, *top.rates), (*top.layout, *top.rate_layout)
        self.levels: list[list[Step]] = [[]]  # steps that do not need each other are of one level
        self.size = 1
        shapes = (len(top.points), dim), (len(top.vectors), dim), (len(top.markers), dim), (len(top.dimensions),)
        # Points, vectors, markers and dimensions as given.
        self.parameters = self.points, vectors, self.given_markers, self.dimensions = tuple(map(self._new, shapes))
        near = self._new((len(top.scalars),))

        # Points, those of redrawn bodies behind them, (points, dim); unit vectors, (vectors, dim).
        self.drawing: Places = np.concatenate([self.points, *map(self._shape, top.shapes)])
        self.vectors = self.step("unit", unit_formula(dim), [vectors], dim) if top.vectors else vectors

        self.levels.append([])
        lengths = self._lengths()
        self.markers = self._markers()  # their coefficients, (markers, dim)
        # Angles and distances are measured with constants that do not depend on them.
        spread, scalars = [self.points.reshape(-1), self.vectors.reshape(-1)], np.zeros(len(top.scalars), INDEX)
        self.home = np.concatenate([*spread, scalars])  # all coordinates, (N,)
        measuring = sorted({b for b, _ in top.measures})
        self.levels.append([])
        found = {b: self._constants(b, lengths) for b in measuring}
        self.levels.append([])
        for b in measuring:
            at = [(k, i) for k, (block, i) in enumerate(top.measures) if block == b]
            which, instances = [k for k, _ in at], [i for _, i in at]
            given = [self.home[self.layouts[b].variables[instances]], found[b][0][instances]]
            scalars[which] = self.step("measure", formula(top.blocks[b].kind, "measure", dim), given, 1, which)[:, 0]
        self.levels.append([])
        if any(top.angles):
            at = np.flatnonzero(top.angles)
            scalars[at] = self.step("turn", _turn_formula(), [scalars[at], near[at]], 1)[:, 0]
        self.home = np.concatenate([*spread, scalars])
        self.levels.append([])
        every = [found[b] if b in found else self._constants(b, lengths) for b in range(len(self.blocks))]
        # Constants of each block (instances, constants), those of rows on velocities behind the others: as they are
        # given, and as the drawing has them, whatever is given.
        self.constants, self.read = [own for own, _ in every], [read for _, read in every]
        self.levels.append([])
        # How far blocks are from the class that their kinds are for.
        misfit = [self._misfit(b) for b, block in enumerate(top.blocks) if block.kind.misfit]
        self.misfit = np.concatenate([np.zeros(1, INDEX), *misfit])

    def _new(self, shape: tuple[int, ...]) -> Places:
        count = int(np.prod(shape, dtype=int))
        self.size += count
        return np.arange(self.size - count, self.size, dtype=INDEX).reshape(shape)

    def step(self, finds: str, what: Formula, given: Sequence[Places], results: int, at: Sequence[int] = ()) -> Places:
        """Add a step to the last level, from arrays of places ``(instances, ...)``; its results ``(instances, …)``."""
        count = len(given[0])
        columns = np.concatenate([x.reshape(count, -1) for x in given], axis=1).T
        self.levels[-1].append(Step(finds, what, columns, tuple(at)))
        return self._new((results, count)).T

    def _shape(self, shape: "Shape") -> Places:
        """Redraw bodies with explicit dimensions."""
        members = np.array(shape.members, int)
        wanted = np.array(shape.dimensions, int).reshape(len(members), -1)
        what = recipe_formula(shape.recipe, members.shape[1], self.top.dim, wanted.shape[1])
        given = [self.points[members], self.dimensions[wanted]]
        return self.step("shape", what, given, members.shape[1] * self.top.dim).reshape(-1, self.top.dim)

    def _lengths(self) -> dict[tuple[int, int, int], int]:
        """Constants that are distances, by block, instance and constant."""
        every = [(b, *one) for b, block in enumerate(self.blocks) for one in block.lengths]
        if not every:
            return {}
        b, i, k, p, q = np.array(every).T
        found = self.step("length", _distance_formula(self.top.dim), [self.drawing[p], self.drawing[q]], 1)[:, 0]
        return dict(zip(zip(b.tolist(), i.tolist(), k.tolist(), strict=True), found.tolist(), strict=True))

    def _markers(self) -> Places:
        top, dim = self.top, self.top.dim
        out, alike = np.zeros((len(top.markers), dim), INDEX), {}
        for k, marker in enumerate(top.markers):
            forms = "".join("v" if len(s) == 1 else "p" for s in (*marker.segments, marker.drawn[0]))
            arm = [] if marker.direction else [self.points[marker.origin]]
            spans = [self._ends(segment, self.points) for segment in marker.segments]
            spans.append(self._ends(marker.drawn[0], self.drawing))
            given = np.concatenate([*spans, *arm, self.given_markers[k]])
            alike.setdefault((forms, marker.direction), []).append((k, given))
        for (forms, direction), some in alike.items():
            given = np.stack([places for _, places in some])
            out[[k for k, _ in some]] = self.step("marker", _marker_formula(dim, forms, direction), [given], dim)
        return out

    def _ends(self, segment: Segment, points: Places) -> Places:
        return self.vectors[~segment[0]] if len(segment) == 1 else points[list(segment)].reshape(-1)

    def _constants(self, b: int, lengths: dict[tuple[int, int, int], int]) -> tuple[Places, Places]:
        """Constants of a block's instances, as given and as drawn, and all of them as drawn."""
        block, layout = self.blocks[b], self.layouts[b]
        kind, count = block.kind, block.count
        explicit = np.zeros((count, len(kind.constants)), INDEX)
        if not kind.constants:
            return explicit, explicit
        for i, k, *_ in block.lengths:
            explicit[i, k] = lengths[b, i, k]
        for i, k, d in block.given:
            explicit[i, k] = self.dimensions[d]
        given = [*self._operands(block, layout), self.home[layout.scalars], explicit]
        read = self.step("constants", formula(kind, "drawn", self.top.dim), given, len(kind.constants))
        return np.where(explicit > 0, explicit, read), read

    def _operands(self, block: Block, layout: BlockLayout) -> list[Places]:
        """Points and vectors that the constants of a block's instances are read from."""
        return [self.drawing[layout.drawn].reshape(block.count, -1), self.vectors[layout.vectors]]

    def _misfit(self, b: int) -> Places:
        block, scalars = self.blocks[b], np.zeros((self.blocks[b].count, self.blocks[b].kind.scalars), INDEX)
        given = [*self._operands(block, self.layouts[b]), scalars, self.constants[b]]
        return self.step("misfit", formula(block.kind, "misfit", self.top.dim), given, 1)[:, 0]


@with_owner
def design(top: Topology) -> Design:
    """Write the program of a topology."""
    return Design(top)


# -- small functions ------------------------------------------------------------------------------------------------


@functools.lru_cache(maxsize=4)
def unit_formula(dim: int) -> Formula:
    """A direction divided by its length."""
    return Formula(write(lambda *x: unit(Small(x)), dim))


@functools.lru_cache(maxsize=1)
def _turn_formula() -> Formula:
    """An angle in the turn that is nearest to another one."""
    turn = 2.0 * math.pi
    return Formula(write(lambda angle, near: angle + ((near - angle) / turn).apply("round") * turn, 2))


@functools.lru_cache(maxsize=4)
def _distance_formula(dim: int) -> Formula:
    return Formula(write(lambda *x: norm(Small(x[dim:]) - Small(x[:dim])), 2 * dim))


@functools.lru_cache(maxsize=1024)
def recipe_formula(recipe: tuple, count: int, dim: int, values: int) -> Formula:
    """A body's points as its recipe places them, from those drawn ``(count, dim)`` and its explicit dimensions."""

    def place(*x: object) -> AnyArray:
        home: Any = Small(Small(x[k * dim : (k + 1) * dim]) for k in range(count))
        return redraw(recipe, home, cast(Any, Small(x[count * dim :])))

    return Formula(write(place, count * dim + values))


@functools.lru_cache(maxsize=1024)
def _marker_formula(dim: int, forms: str, direction: bool) -> Formula:
    """A marker's coefficients from its body's segments, the first of them where lengths are read, and the marker."""
    wide = [dim * (2 if form == "p" else 1) for form in (*forms, "v" if direction else "p")]
    ends = np.cumsum([0, *wide])

    def coefficients(*x: object) -> Components:
        parts = [x[a:b] for a, b in itertools.pairwise(ends.tolist())]
        *spans, drawn, arm = [Small(p) if len(p) == dim else Small(p[dim:]) - Small(p[:dim]) for p in parts]
        return carried(cast(Any, spans), cast(Any, arm), cast(Any, drawn), direction)

    return Formula(write(coefficients, int(ends[-1])))


# -- bodies with explicit dimensions --------------------------------------------------------------------------------


def redraw(recipe: tuple, home: Float[Array, "k dim"], values: Float[Array, " d"]) -> Float[Array, "k dim"]:
    """Place the points of a body with explicit dimensions: in its own frame, in space around its first point as drawn.

    A recipe is a static tuple ``(base, steps)``. ``base = (i, j, d)``: the body's x axis runs from its point i to its
    point j, at the drawn distance (d is None) or at dimension number d. Each step places one more point k:

    ``(k, "drawn")``            where it is drawn relative to point i and the axis;
    ``(k, "local", d, e)``      at the local coordinates given as dimensions d and e;
    ``(k, "polar", i, d)``      in the drawn direction from point i, at distance d;
    ``(k, "two", i, d, j, e)``  at distances d and e from points i and j, on the drawn side.

    Constants of constraints are then read off the redrawn body exactly as they are read off the drawing.
    """
    (i, j, given), steps = recipe
    axis, flat = home[j] - home[i], home.shape[1] == 2
    length = norm(axis)
    drawn: Sequence[Array] | Array
    placed: dict[int, Array]
    if flat:
        e = _divide_vector(axis, length)
        drawn = [stacked([dot(e, w), cross(e, w)]) for w in (home[k] - home[i] for k in range(home.shape[0]))]
        placed = {i: 0.0 * axis, j: stacked([length if given is None else values[given], 0.0])}
    else:
        stretch = 1.0 if given is None else values[given] * ratio(1.0, length)
        drawn, placed = home, {i: home[i], j: home[i] + stretch * axis}
    for k, how, *data in steps:
        if how == "drawn":
            placed[k] = drawn[k]
        elif how == "local":
            placed[k] = stacked([values[data[0]], values[data[1]]])
        elif how == "polar":
            origin, d = data
            w = drawn[k] - drawn[origin]
            placed[k] = placed[origin] + values[d] * _divide_vector(w, norm(w))
        else:
            a, d, b, f = data
            w = drawn[k] - drawn[a]
            meet, side = (_two_distances, cross(drawn[b] - drawn[a], w)) if flat else (_two_spheres, w)
            placed[k] = meet(placed[a], values[d], placed[b], values[f], side)
    return stacked([placed[k] for k in range(home.shape[0])])


def _divide_vector(w, length):
    return stacked([ratio(w[k], length) for k in range(w.shape[0])])


def _two_spheres(a, ra, b, rb, drawn):
    """The point at two distances that lies on the drawn side of the line of centres."""
    d = b - a
    span = dot(d, d)
    along = ratio(span + ra * ra - rb * rb, 2.0 * span)
    height = root(ra * ra - along * along * span)
    across = drawn - ratio(dot(drawn, d), span) * d
    return a + along * d + height * ratio(1.0, norm(across)) * across


def _two_distances(a, ra, b, rb, side):
    """Intersection of two circles on the drawn side; on the line of centres if they do not meet."""
    d = b - a
    span = dot(d, d)
    along = ratio(span + ra * ra - rb * rb, 2.0 * span)
    height = root(ratio(ra * ra, span) - along * along)
    height = where(side < 0, -height, height)
    return a + along * d + height * stacked([-d[1], d[0]])


# -- readings -------------------------------------------------------------------------------------------------------


def run_steps(
    found: Design, x: Numbers, run: Callable[[Step, Any], Sequence[Any]], join: Callable, levels: int = 7
) -> AnyArray:
    """The row of a design's numbers ``(numbers, ...)`` after so many levels, from those that are given.

    `run` says what the results of a step are, one after the other ``(instances, ...)``, from what it takes.
    """
    for level in found.levels[:levels]:
        if level:
            x = join([x, *(y for step in level for y in run(step, x[step.given]))])
    return x


def design_numbers(top: Topology, parameters: Parameters, levels: int = 7) -> AnyArray:
    """The row of a design's numbers: NumPy's of NumPy arrays, otherwise JAX's.

    The first level knows points of redrawn bodies and unit vectors.
    """
    par = parameters.points, parameters.vectors, parameters.markers, parameters.dimensions
    return _run_design(top, par[0], (a.reshape(-1) for a in par), parameters.near, levels)


def _run_design(
    top: Topology, like: Numbers, given: Iterable[Numbers], near: Numbers | None, levels: int, carries: bool = False
) -> AnyArray:
    xp: Any = np if isinstance(like, np.ndarray) else jnp
    dtype = like.dtype
    tail = like.shape[1:] if carries else ()
    turns = xp.zeros((len(top.scalars), *tail), dtype)
    if near is not None:
        alone = np.arange(like.shape[-1]) == 0 if carries else 1.0  # it has no changes
        turns = turns + alone * xp.asarray(near, dtype).reshape(-1, *[1] * len(tail))
    x = xp.concatenate([xp.zeros((1, *tail), dtype), *given, turns])

    def run(step: Step, given: Numbers) -> list[AnyArray]:
        values = step.formula.reading(given, carries)(list(given))
        return [xp.broadcast_to(xp.asarray(v, dtype), given.shape[1:]) for v in values]

    return run_steps(design(top), x, run, xp.concatenate, levels)


GEOMETRY = "points", "vectors", "markers", "dimensions"
"""The parameters that a drawing is made of, in the order in which they stand in the row of a design."""


def find_traced(parameters: Parameters, names: tuple[str, ...] = GEOMETRY) -> tuple[tuple[Array, ...], np.ndarray]:
    """Find the arrays of the geometry that are traced, and the places of their numbers among all of the geometry.

    Of other parameters than the geometry, if `names` has them.
    """
    leaves = [getattr(parameters, name) for name in names]
    traced = [isinstance(leaf, Tracer) for leaf in leaves]
    at = np.flatnonzero(np.repeat(traced, [leaf.size for leaf in leaves]))
    return tuple(leaf for leaf, one in zip(leaves, traced, strict=True) if one), at


def with_unit_changes(geometry: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Give the numbers of a geometry changes, in each another of those at some places: ``(numbers, 1 + changes)``."""
    changes = np.zeros((len(geometry), len(at)), geometry.dtype)
    changes[at, np.arange(len(at))] = 1.0
    return np.concatenate([geometry[:, None], changes], axis=1)


class Drawn(NamedTuple):
    """Numbers that follow from a drawing, each with its changes along the last axis (see `carrying`).

    Of many designs there are axes of theirs before the last.
    """

    drawing: np.ndarray  # points, those of redrawn bodies behind them, (points, dim, 1 + changes)
    vectors: np.ndarray  # unit vectors, (vectors, dim, 1 + changes)
    home: np.ndarray  # all coordinates, (N, 1 + changes)
    constants: tuple[np.ndarray, ...]  # per block, (instances, constants, 1 + changes)
    markers: np.ndarray  # their coefficients, (markers, dim, 1 + changes)


def carry_design(top: Topology, geometry: np.ndarray, near: Numbers | None = None) -> Drawn:
    """Derive constants and coordinates from the geometry of designs, which carries changes or none.

    That is points, vectors, markers and dimensions behind each other, ``(numbers, ..., 1 + changes)``. All have the
    same angles to be `near`, see `Parameters`.
    """
    found, x = design(top), _run_design(top, geometry, [geometry], near, 6, carries=True)
    constants = tuple(x[places] for places in found.constants[: len(top.blocks)])
    return Drawn(x[found.drawing], x[found.vectors], x[found.home], constants, x[found.markers])
