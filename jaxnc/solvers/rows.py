"""Rows of a mechanism as one straight-line program, which NumPy and JAX read alike.

A lane is one pose of one design. Lanes are the last axes of everything, so that what is done to all of them is plain
arithmetic on long vectors. Nothing is gathered or scattered: the topology says which numbers meet.

The program of a plan has its rows, their slopes, and the step of Newton where its blocks are small. Where the diagonal
blocks of the Jacobian have one or two rows, everything from the coordinates to the step is a few hundred operations on
whole lanes; a single lane goes through them as plain numbers.
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.constraints import Kind
from jaxnc.constraints.elementary import cos, sin
from jaxnc.constraints.kind import cross3
from jaxnc.reading import Builder, Number, Program, function, partials, polynomials, rate
from jaxnc.records import with_owner
from jaxnc.solvers.plan import TURN, Plan
from jaxnc.system.host import HostEquations
from jaxnc.system.structure import arrays, host_kind, pattern, program, readable
from jaxnc.system.topology import Topology
from jaxnc.types import AnyArray, Array, Numbers, Scalar

if TYPE_CHECKING:
    from jaxnc.system.equations import Equations
    from jaxnc.system.host import HostEquations


Lanes = Sequence[AnyArray] | np.ndarray
"""All coordinates of a mechanism, each a number or an array of lanes."""
Instance = tuple[int, int]
"""An instance of a kind: its block in the topology, and its number there."""
Place = tuple[int, int, int]
"""A constant of an instance: its block in the topology, the instance's number there, and its own."""
FEW = 3  # columns of a block whose linear equations are solved by determinants


class _TracedNumerics:
    """`jax.numpy` with sine and cosine in plain arithmetic, which XLA vectorises with what stands around them."""

    sin, cos = staticmethod(sin), staticmethod(cos)

    def __getattr__(self, name: str) -> Callable:
        return getattr(jnp, name)


TRACED = _TracedNumerics()
Numerics = ModuleType | _TracedNumerics
"""Functions of arrays by their names in NumPy."""


class RowNumbers(NamedTuple):
    """The numbers of a design that rows need."""

    constants: Sequence[AnyArray]  # of each block ``(instances, constants, *lanes)``
    scales: Sequence[Numbers]  # of each block's rows ``(instances, rows, *lanes)``; they make rows lengths


Numbered: TypeAlias = "RowNumbers | Equations | HostEquations"
"""Whatever has these two fields."""


class Functions:
    """Functions of some instances of constraints: of all coordinates, of constants and of scales.

    Args:
        top: the structure.
        wanted: of each instance some of its outputs, and the places that these have among the results.
        which: ``"residual"`` or ``"guard"``.
        columns: coordinates that come first among the program's inputs.
        scaled: whether the outputs are multiplied by the scales of the rows.
    """

    def __init__(
        self,
        top: Topology,
        wanted: Mapping[Instance, Sequence[tuple[int, int]]],
        which: str,
        columns: Sequence[int] = (),
        scaled: bool = False,
    ):
        self.top, self.columns, self._which, self._scaled = top, tuple(int(c) for c in columns), which, scaled
        self.count = sum(map(len, wanted.values()))
        self._variables = {(b, i): tuple(int(v) for v in top.layout[b].variables[i]) for b, i in wanted}
        found = {b: program(top.blocks[b].kind, which, top.dim) for b, _ in wanted}
        read = {at: outputs for at, outputs in wanted.items() if found[at[0]] is not None}
        self._foreign = {at: outputs for at, outputs in wanted.items() if at not in read}
        self.readable = not self._foreign  # whether the program has all that is wanted; else some kinds are JAX's alone
        self.needed = {v for variables in self._variables.values() for v in variables}  # coordinates, and constants:
        self.needed_constants = [(b, i, k) for b, i in wanted for k in range(len(top.blocks[b].kind.constants))]
        self.coordinates = tuple(dict.fromkeys([*self.columns, *(v for at in read for v in self._variables[at])]))
        self.constants = [(b, i, k) for b, i in read for k in range(len(top.blocks[b].kind.constants))]
        self.scales = [(*at, k) for at, outputs in read.items() for k, _ in outputs] if scaled else []
        inputs = [*self.coordinates, *self.constants, *self.scales]
        builder = Builder(len(inputs))
        node = dict(zip(self.coordinates, builder.first, strict=False))
        constant = dict(zip(self.constants, builder.first[len(node) :], strict=False))
        scale = dict(zip(self.scales, builder.first[len(node) + len(constant) :], strict=True))
        results = {}
        for (b, i), outputs in read.items():
            one = found[b]
            assert one is not None
            own = [node[v] for v in self._variables[b, i]]
            own += [constant[b, i, k] for k in range(len(top.blocks[b].kind.constants))]
            at = builder.append(one, own)
            for k, place in outputs:
                value = at[one.outputs[k]]
                results[place] = builder.op("mul", value, scale[b, i, k]) if scaled else value
        self._places = tuple(sorted(results))
        self.program: Program = builder.program([results[place] for place in self._places])

    def collect(self, x: Lanes, numbers: Numbered) -> list[AnyArray]:
        """Collect inputs of the program, from coordinates and `Numbers`."""
        constants = (entry(numbers.constants[b], i, k) for b, i, k in self.constants)
        scales = (entry(numbers.scales[b], i, k) for b, i, k in self.scales)
        return [*(x[c] for c in self.coordinates), *constants, *scales]

    @with_owner
    def run(self, xp: Numerics) -> Callable[[Sequence], tuple]:
        """Return the program as a function of NumPy's or of JAX's lanes."""
        return function(self.program, xp)

    def values(self, numbers: Numbered, x: Lanes, xp: Numerics = TRACED) -> list[AnyArray]:
        """Evaluate the functions."""
        out: list[AnyArray] = [None] * self.count
        for place, value in zip(self._places, self.run(xp)(self.collect(x, numbers)), strict=True):
            out[place] = value
        for at, outputs in self._foreign.items():
            found = self._call_kind(at, numbers, [x[v] for v in self._variables[at]])
            for k, place in outputs:
                out[place] = found[k]
        return out

    def _call_kind(self, at: Instance, numbers: Numbered, local: Sequence[Array]) -> tuple[Array, ...]:
        """Evaluate the function of an instance that no program has."""
        (b, i), kind = at, self.top.blocks[at[0]].kind
        constants = [entry(numbers.constants[b], i, k) for k in range(len(kind.constants))]
        found = _evaluate_kind(kind, getattr(kind, self._which), self.top.dim, *map(jnp.asarray, (*local, *constants)))
        if not self._scaled:
            return found
        return tuple(r * entry(numbers.scales[b], i, k) for k, r in enumerate(found))


class Rows(Functions):
    """Some rows of a topology, as lengths, and how some coordinates are found from them.

    Args:
        top: the structure.
        rows: indices of the rows.
        columns: indices of the coordinates that are solved for.
    """

    def __init__(self, top: Topology, rows: Sequence[int], columns: Sequence[int] = ()):
        self.rows = tuple(int(r) for r in rows)
        place = {r: k for k, r in enumerate(self.rows)}
        wanted: dict[Instance, list[tuple[int, int]]] = {}
        for b, layout in enumerate(top.layout):
            for i, own in enumerate(layout.rows.tolist()):
                if mine := [(k, place[r]) for k, r in enumerate(own) if r in place]:
                    wanted[b, i] = mine
        super().__init__(top, wanted, "residual", columns, scaled=True)

    def slopes(self, numbers: Numbered, x: Lanes, xp: Numerics = TRACED) -> dict[tuple[int, int], Array]:
        """Differentiate by the columns: slopes that can differ from zero, by row and place of the column."""
        found = dict(zip(self.partials[1], self.run_slopes(xp)(self.collect(x, numbers)), strict=True))
        column = {c: k for k, c in enumerate(self.columns)}
        for at, outputs in self._foreign.items():
            variables, structure = self._variables[at], pattern(self.top.blocks[at[0]].kind, self.top.dim)
            local = [x[v] for v in variables]
            for v, c in enumerate(variables):
                wanted = [(k, place) for k, place in outputs if structure[k, v]]
                if c not in column or not wanted:
                    continue

                def along(value: Array, at: Instance = at, v: int = v, local: list = local) -> tuple[Array, ...]:
                    return self._call_kind(at, numbers, [*local[:v], value, *local[v + 1 :]])

                changes = jax.jvp(along, (jnp.asarray(local[v]),), (jnp.ones_like(local[v]),))[1]
                for k, place in wanted:
                    key = place, column[c]
                    found[key] = found[key] + changes[k] if key in found else changes[k]
        return found

    @functools.cached_property
    def partials(self) -> tuple[Program, tuple[tuple[int, int], ...]]:
        """The program of the derivatives by the columns, of the same inputs, and the row and column of each."""
        found, places = partials(self.program, range(len(self.columns)))
        return found, tuple((self._places[r], c) for r, c in places)

    @with_owner
    def run_slopes(self, xp: Numerics) -> Callable[[Sequence], tuple]:
        """Return the derivatives of `partials` as a function of the program's inputs."""
        return function(self.partials[0], xp)

    @functools.cached_property
    def run_changes(self) -> Callable[[Sequence], tuple]:
        """Changes of the rows, as a function of the inputs and of the changes of what is `moving`."""
        return function(rate(self.program, range(len(self.columns), self.program.inputs - len(self.scales)), 1))

    def moving(self, x: Lanes, constants: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Numbers that change the rows beside the columns: other coordinates, and constants of each block."""
        rest = self.coordinates[len(self.columns) :]
        return [*(x[c] for c in rest), *(constants[b][i, k] for b, i, k in self.constants)]

    @functools.cached_property
    def form(self) -> str:
        """How the columns are found: ``"affine"``, ``"round"``, ``"angle"``, or ``"iterated"`` by Newton.

        Round are rows that have circles or spheres (of one, two or three columns) or, the same curve, whatever is
        quadratic in a single column; the others are affine.
        """
        n = len(self.columns)
        if not self.readable or self.count != n:
            return "iterated"
        if self._in_sines is not None:
            return "angle"
        bent = self._squares
        if bent is None:
            return "iterated"
        if not any(bent):
            return "affine"
        return "round" if n <= FEW and all(not s or (len(s) == n and _is_round(s)) for s in bent) else "iterated"

    @functools.cached_property
    def _squares(self) -> list[dict] | None:
        """Squares of the columns in each row and their coefficients; None if a row has a higher power."""
        terms = [p.terms for p in polynomials(self.program, range(len(self.columns)))]
        if any(t is None or max(map(len, t), default=0) > 2 for t in terms):
            return None
        return [{m: c for m, c in t.items() if len(m) == 2} for t in terms if t is not None]

    @functools.cached_property
    def _in_sines(self) -> Program | None:
        """The row as a program of the cosine and sine of the only column, which come last, if it is affine in these."""
        if len(self.columns) != 1:
            return None
        b = Builder(self.program.inputs + 2)
        ways, at = dict(zip(("cos", "sin"), b.first[-2:], strict=True)), []
        for node in self.program.nodes:
            if node.op == "input":
                at.append(b.first[node.value])
            elif node.op == "number":
                at.append(b.number(node.value[1]))
            elif node.op in ways and at[node.of[0]] == b.first[0]:
                at.append(ways[node.op])
            else:
                at.append(b.op(node.op, *(at[i] for i in node.of), value=node.value))
        made = b.program([at[k] for k in self.program.outputs])
        (row,) = polynomials(made, (0, made.inputs - 2, made.inputs - 1))
        affine = row.terms is not None and all(len(m) <= 1 for m in row.terms)
        return made if affine and row.depends and 0 not in row.depends else None

    @with_owner
    def run_solution(self, xp: Numerics) -> Callable[[Sequence], tuple]:
        """Return the columns where all rows vanish, as a function of the inputs and of an orientation's sign.

        The sign is that of the determinant of the rows' derivatives. Angles are those nearest to where they begin.
        Forms that are iterated have none, and of affine ones those of few columns.
        """
        return function(self._solution, xp)

    @with_owner
    def run_square(self, xp: Numerics) -> Callable[[Sequence], tuple]:
        """Return the square of the determinant where round rows vanish, but for a factor, as a function of the inputs.

        It is the same wherever the columns are, and negative where the rows vanish nowhere.
        """
        b = Builder(self.program.inputs)
        square = self._write_line(b, *self._write_slopes(b), 1.0)[-1]
        return function(b.program([_node(b, square)]), xp)

    @functools.cached_property
    def _solution(self) -> Program:
        b = Builder(self.program.inputs + 1)
        x, sign = [Number(b, at) for at in b.first[: len(self.columns)]], Number(b, b.first[-1])
        if self.form == "angle":
            found = [self._write_angle(b, x[0], sign)]
        else:
            rows, slopes = self._write_slopes(b)
            if self.form == "affine":
                found = [v - d for v, d in zip(x, cramer(slopes, rows), strict=True)]
            else:
                found = [v + d for v, d in zip(x, self._write_round(b, rows, slopes, sign), strict=True)]
        return b.program([_node(b, v) for v in found])

    @functools.cached_property
    def run_step(self) -> Callable[[Sequence], tuple]:
        """Newton's step of few columns by Cramer's rule, as a function of NumPy's lanes."""
        b = Builder(self.program.inputs)
        rows, slopes = self._write_slopes(b)
        return function(b.program([_node(b, v) for v in cramer(slopes, rows)]))

    def _write_slopes(self, b: Builder) -> tuple[list[Number], list[list[Number | float]]]:
        """Write the rows and all their derivatives, structural zeros as numbers."""
        at = b.append(self.program, b.first)
        rows = [Number(b, at[k]) for k in self.program.outputs]
        derived, places = self.partials
        at = b.append(derived, b.first)
        slopes: list[list[Number | float]] = [[0.0] * len(self.columns) for _ in rows]
        for (r, c), k in zip(places, derived.outputs, strict=True):
            slopes[r][c] = Number(b, at[k])
        return rows, slopes

    def _write_round(self, b: Builder, rows: list[Any], slopes: list[list[Any]], sign: Any) -> list[Any]:
        """Meet circles, spheres, lines and planes where the determinant has a sign, by steps of the columns."""
        foot, along, side, rise, twice, square = self._write_line(b, rows, slopes, sign)
        root = square.apply("max", 0.0).apply("sqrt")
        t = (side * root - rise) / twice
        return [f + t * d for f, d in zip(foot, along, strict=True)]

    def _write_line(self, b: Builder, rows: list[Any], slopes: list[list[Any]], sign: Any) -> tuple:
        """Write the line in which rows meet, if one round row is kept: what is left of the others is affine.

        On the line through the foot of the perpendicular the round row is a quadratic equation. The derivative along
        the line is there the determinant, so that its sign chooses the root.

        Returns:
            The steps to the foot and along the line; the side of the foot, along the line, on which the determinant has
            the sign; the equation's slope at the foot, its second derivative, and the square of its slope at the roots.
        """
        n, bends = len(rows), self._write_bends(b)
        base = next(r for r in range(n) if bends[r] is not None)
        value, slope, bend, side = rows[base], slopes[base], bends[base], sign
        if (n - 1 - base) % 2:
            side = -side
        flat, offsets = [], []
        for r in range(n):
            if r == base:
                continue
            if bends[r] is None:
                flat.append(slopes[r])
                offsets.append(rows[r])
                continue
            flat.append([bend * p - bends[r] * q for p, q in zip(slopes[r], slope, strict=True)])
            offsets.append(bend * rows[r] - bends[r] * value)
            side = side * bend.apply("sign")
        along = _free_line(flat)
        length = _scalar_product(along, along)
        foot = _foot_step(flat, offsets, along, length)
        # value + slope · (foot + t along) + bend/2 |foot + t along|² = 0
        rise, twice = _scalar_product(slope, along), bend * length
        rest = value + _scalar_product(slope, foot) + 0.5 * bend * _scalar_product(foot, foot)
        return foot, along, side, rise, twice, rise * rise - 2.0 * twice * rest

    def _write_bends(self, b: Builder) -> list[Any]:
        """Write the second derivatives of the rows by the first column; None of a row that has none."""
        derived, places = self.partials
        second, at = partials(derived, (0,))
        nodes = b.append(second, b.first)
        found: list[Number | None] = [None] * self.count
        for k, (n, _) in enumerate(at):
            row, column = places[n]
            if column == 0:
                found[row] = Number(b, nodes[second.outputs[k]])
        return found

    def _write_angle(self, b: Builder, start: Number, sign: Number) -> Number:
        """Solve ``rest + x cos φ + y sin φ = 0``, its derivative of a sign, for the angle nearest to the start."""
        made = self._in_sines
        assert made is not None

        def row(cosine: float, sine: float) -> Number:
            at = b.append(made, [*b.first[: self.program.inputs], b.number(cosine), b.number(sine)])
            return Number(b, at[made.outputs[0]])

        rest = row(0.0, 0.0)
        x, y = row(1.0, 0.0) - rest, row(0.0, 1.0) - rest
        off = sign * (x * x + y * y - rest * rest).apply("max", 0.0).apply("sqrt")
        angle = Number(b, b.op("atan2", _node(b, -(rest * y) - off * x), _node(b, off * y - rest * x)))
        turns = ((start - angle) / (2.0 * np.pi)).apply("round")
        return angle + turns * TURN[0] + turns * TURN[1]


def _node(b: Builder, value: Any) -> int:
    return value.at if isinstance(value, Number) else b.number(float(value))


def _is_round(squares: dict) -> bool:
    first = next(iter(squares.values()))
    return all(m[0] == m[1] and c == first for m, c in squares.items())


def _scalar_product(a: Sequence[Scalar], b: Sequence[Scalar]) -> Any:
    return functools.reduce(lambda x, y: x + y, [p * q for p, q in zip(a, b, strict=True)])


def cramer(a: Sequence[Sequence[Scalar]], right: Sequence[Scalar]) -> list[Scalar]:
    """Solve few linear equations by determinants; elements are lanes or numbers, and 0.0 where there is none."""
    n, whole = len(right), _determinant(a)
    each = ([[right[r] if k == c else a[r][k] for k in range(n)] for r in range(n)] for c in range(n))
    return [_determinant(m) / whole for m in each]


def _determinant(a: Sequence[Sequence[Scalar]]) -> Scalar:
    """Expand a determinant by the first row."""
    if len(a) == 1:
        return a[0][0]
    out: Scalar = 0.0
    for c, element in enumerate(a[0]):
        minor = _determinant([[*row[:c], *row[c + 1 :]] for row in a[1:]])
        if _is_zero(element) or _is_zero(minor):
            continue
        term = -element * minor if c % 2 else element * minor
        out = term if _is_zero(out) else out + term
    return out


def _is_zero(element: object) -> bool:
    return isinstance(element, float) and element == 0.0


def _free_line(flat: list[list[Scalar]]) -> list[Scalar]:
    """Write the direction that all rows leave free: its product with a further row is the determinant with it last."""
    n = len(flat) + 1
    if n == 1:
        return [1.0]
    cofactors = [_determinant([row[:c] + row[c + 1 :] for row in flat]) for c in range(n)]
    return [-m if (n - 1 - c) % 2 else m for c, m in enumerate(cofactors)]


def _foot_step(flat: list[list[Scalar]], offsets: list[Scalar], along: list[Scalar], square: Scalar) -> list[Scalar]:
    """Write the shortest step to where all affine rows vanish."""
    if not flat:
        return [0.0]
    if len(flat) == 1:
        return [-(offsets[0] / square) * a for a in flat[0]]
    first, second = cross3(flat[1], along), cross3(along, flat[0])
    p, q = (-(offset / square) for offset in offsets)
    return [p * u + q * v for u, v in zip(first, second, strict=True)]


def guard_functions(top: Topology, bodies: bool | None = None) -> Functions:
    """Quantities that are positive unless a row, or a body, is met by a mirror image; of `bodies` alone, or of rows."""
    wanted: dict[Instance, list[tuple[int, int]]] = {}
    count = 0
    for b, block in enumerate(top.blocks):
        if block.kind.guard is None or bodies not in (None, block.kind.mirror):
            continue
        outputs = _guard_count(block.kind, top.dim)
        for i in range(block.count):
            wanted[b, i] = [(k, count + k) for k in range(outputs)]
            count += outputs
    return Functions(top, wanted, "guard")


def _guard_count(kind: Kind, dim: int) -> int:
    found = program(kind, "guard", dim)
    if found is not None:
        return len(found.outputs)
    number = jax.ShapeDtypeStruct((), jnp.result_type(float))
    count = (kind.points + kind.vectors) * dim + kind.scalars + len(kind.constants)
    return len(jax.eval_shape(functools.partial(_evaluate_kind, kind, kind.guard, dim), *[number] * count))


def replace_constants(numbers: "RowNumbers | Equations", constants: Mapping[Place, Array]) -> RowNumbers:
    """Put other constants in the places of some."""
    found = list(numbers.constants)
    for b in {b for b, _, _ in constants}:
        instances, count = found[b].shape[:2]
        found[b] = np.empty((instances, count), object)
        for i, k in np.ndindex(instances, count):
            at = b, i, k
            found[b][i, k] = constants[at] if at in constants else entry(numbers.constants[b], i, k)
    return RowNumbers(found, numbers.scales)


def entry(numbers: Numbers, *at: int) -> AnyArray:
    """Take one number, or its lanes, out of an array; `lax.slice` is traced in a fraction of the time of an index."""
    if isinstance(numbers, np.ndarray):
        return numbers[at]
    rest = numbers.shape[len(at) :]
    part = lax.slice(numbers, (*at, *(0 for _ in rest)), (*(k + 1 for k in at), *rest))
    return lax.squeeze(part, tuple(range(len(at))))


@functools.partial(jax.jit, static_argnums=(0, 1, 2), inline=True)
def _evaluate_kind(kind: Kind, f: Callable, dim: int, *numbers: Array) -> tuple[Array, ...]:
    """Evaluate a function of a kind for JAX, of an instance's variables and constants, or of lanes of them."""

    def one(*x: Array) -> tuple[Array, ...]:
        y = jnp.stack(x)
        return tuple(jnp.asarray(r, y.dtype) for r in f(*arrays(kind, dim, y)))

    for axes in range(1, 1 + max((x.ndim for x in numbers), default=0)):  # the last one first
        one = jax.vmap(one, in_axes=tuple(0 if x.ndim >= axes else None for x in numbers))
    return one(*numbers)


def any_lane(lanes: Array) -> Array:
    """Say whether any lane is true, by a product of vectors, which is a call and no kernel, and soon compiled."""
    flat = lanes.reshape(-1).astype(np.float32)
    return jnp.dot(flat, np.ones(len(flat), np.float32)) > 0.0


# -- the program of a plan ---------------------------------------------------------------------------------------------


_UNKNOWNS = 40  # of a plan
_WIDE = np.dtype(np.float64)


class PlanNodes(NamedTuple):
    """Nodes of a program that a plan's rows are written into."""

    rows: list[int]  # the plan's rows
    # Their derivatives by the unknowns that can differ from zero, by row and column.
    matrix: dict[tuple[int, int], int]
    by_known: dict[tuple[int, int], int]  # the same by the driven coordinates
    guards: list[int]  # what is positive where nothing is met by a mirror image


def count_numbers(top: Topology) -> int:
    """Count the constants and scales of all instances, which are in the order of `HostEquations.numbers`."""
    return sum(block.count * (len(block.kind.constants) + len(block.kind.rows)) for block in top.blocks)


def write_rows(plan: Plan, b: Builder) -> PlanNodes:
    """Write a plan's rows and their derivatives into a program; the kinds must be readable.

    The first inputs of the program are all coordinates, then all constants and scales.
    """
    top, unknowns = plan.topology, len(plan.unknown)
    columns = [*plan.unknown.tolist(), *plan.known[: len(plan.driven)].tolist()]
    place, count = {}, len(top.coordinates)
    for k, block in enumerate(top.blocks):
        constants, scales = len(block.kind.constants), len(block.kind.rows)
        for i in range(block.count):
            place |= {("constant", k, i, j): count + j for j in range(constants)}
            place |= {("scale", k, i, j): count + constants + j for j in range(scales)}
            count += constants + scales

    def append(part: Functions, program: Program) -> list[int]:
        inputs = [*part.coordinates, *(place["constant", *c] for c in part.constants)]
        inputs += [place["scale", *s] for s in part.scales]
        at = b.append(program, [b.first[k] for k in inputs])
        return [at[k] for k in program.outputs]

    rows, guard = Rows(top, plan.rows.tolist(), columns), guard_functions(top)
    derived, places = rows.partials
    found = dict(zip(places, append(rows, derived), strict=True))
    return PlanNodes(
        append(rows, rows.program),
        {(r, c): k for (r, c), k in found.items() if c < unknowns},
        {(r, c - unknowns): k for (r, c), k in found.items() if c >= unknowns},
        append(guard, guard.program),
    )


class PlanProgram:
    """The programs of a plan, each written when it is asked for. Make it with `plan_program`, or `slope_program`.

    Attributes:
        parts: what there is to ask for, and how many numbers it is: ``"residual"`` of the rows, ``"step"`` of Newton,
            ``"slopes"`` of the unknowns by the driven coordinates, ``"determinants"`` of the blocks, ``"entries"`` of
            the matrix at `places` and ``"by_driven"`` at `driven`; ``"guards"``, which are positive where nothing is
            met by a mirror image; ``"solved"`` for other rows.
        places, driven: rows and columns of the entries of the matrix, and of the derivatives by the driven coordinates.
        whole: whether all rows are solved for, and no body can be mirrored.
    """

    def __init__(self, plan: Plan, solved: bool = True):
        top, self.plan = plan.topology, plan
        b = self._builder = Builder(len(top.coordinates) + count_numbers(top) + len(plan.rows))
        right = b.first[len(b.first) - len(plan.rows) :]
        rows, matrix, by_known, guards = write_rows(plan, b)
        self._matrix, driven = matrix, len(plan.driven)
        self.places, self.driven = (np.array([*x], int).reshape(-1, 2).T for x in (matrix, by_known))
        zero = b.number(0.0)
        self.parts: dict[str, list[int]] = {"residual": rows, "guards": guards}
        self.parts |= {"entries": [*matrix.values()], "by_driven": [*by_known.values()]}
        if not solved:
            return
        tangents = [self._solve(b, [by_known.get((r, k), zero) for r in range(len(rows))]) for k in range(driven)]
        self.parts |= {
            "step": self._solve(b, rows),
            "slopes": [b.op("neg", tangents[k][c]) for c in range(len(plan.unknown)) for k in range(driven)],
            "determinants": [self._determinant(b, r, c) for r, c in plan.sequence],
            "solved": self._solve(b, right),
        }
        self.whole = len(rows) == len(top.rows) and not any(block.kind.mirror for block in top.blocks)

    def _determinant(self, b: Builder, rows: np.ndarray, columns: np.ndarray) -> int:
        a = [self._matrix.get((int(r), int(c)), b.number(0.0)) for r in rows for c in columns]
        return a[0] if len(a) == 1 else b.op("sub", b.op("mul", a[0], a[3]), b.op("mul", a[1], a[2]))

    def _solve(self, b: Builder, right: Sequence[int]) -> list[int]:
        """Write the solution for right sides, block by block."""
        x: dict[int, int] = {}
        for rows, columns in self.plan.sequence:
            rest = [right[int(r)] for r in rows]
            for k, r in enumerate(int(r) for r in rows):
                for (i, c), slope in self._matrix.items():
                    if i == r and c in x:
                        rest[k] = b.op("sub", rest[k], b.op("mul", slope, x[c]))
            determinant = self._determinant(b, rows, columns)
            if len(rows) == 1:
                x[int(columns[0])] = b.op("div", rest[0], determinant)
                continue
            p, q, r, s = (self._matrix.get((int(i), int(c)), b.number(0.0)) for i in rows for c in columns)
            above = b.op("sub", b.op("mul", s, rest[0]), b.op("mul", q, rest[1]))
            below = b.op("sub", b.op("mul", p, rest[1]), b.op("mul", r, rest[0]))
            x[int(columns[0])], x[int(columns[1])] = (b.op("div", y, determinant) for y in (above, below))
        return [x[c] for c in range(len(self.plan.unknown))]

    @with_owner
    def _function(self, parts: tuple[str, ...], numbers: bool) -> Callable[[Sequence], tuple]:
        return function(self._builder.program([k for part in parts for k in self.parts[part]]), math if numbers else np)

    def run(self, parts: tuple[str, ...], eq: HostEquations, q: np.ndarray, right: Any = ()) -> list[np.ndarray]:
        """Evaluate some of the `parts`, each ``(numbers, lanes)``.

        Poses are ``(N, lanes)``; `right` are the rows that ``"solved"`` is asked for, ``(m, lanes)``.
        """
        values = None
        if _is_plain(eq, q):
            try:
                x = [*q[:, 0].tolist(), *eq.numbers, *(np.asarray(right).reshape(-1).tolist())]
                values = np.array(self._function(parts, True)(x))[:, None]
            except (ZeroDivisionError, ValueError, OverflowError):
                values = None  # what is not finite is told by arrays
        if values is None:
            found = self._function(parts, False)([*q, *eq.numbers, *right])
            values = np.empty((len(found), q.shape[1]), q.dtype)
            for k, value in enumerate(found):
                values[k] = value
        out, first = [], 0
        for part in parts:
            out.append(values[first : first + len(self.parts[part])])
            first += len(self.parts[part])
        return out

    def correct(
        self, eq: HostEquations, q: np.ndarray, weights: np.ndarray, fine: float, most: int
    ) -> np.ndarray | None:
        """Correct one pose ``(N, 1)`` by Newton in plain numbers, until a step is fine; None if that is for arrays.

        `weights` are factors that turn the unknowns into lengths, ``(n, 1)``; a step that is shorter than `fine`, of
        the mechanism's size, is the last.
        """
        if not _is_plain(eq, q):
            return None
        x, n, enough = [*q[:, 0].tolist(), *eq.numbers], len(q), fine * eq.length
        run, unknown = (
            self._function(("step",), True),
            [*zip(self.plan.unknown.tolist(), weights[:, 0].tolist(), strict=True)],
        )
        try:
            for _ in range(most):
                far = 0.0
                for (k, weight), change in zip(unknown, run(x), strict=True):
                    x[k] -= change
                    far = max(far, abs(change) * weight)
                if far <= enough:
                    break
        except (ZeroDivisionError, ValueError, OverflowError):
            return None
        found = np.array(x[:n])[:, None]
        return found if np.isfinite(found).all() else None


def _is_plain(eq: HostEquations, q: np.ndarray) -> bool:
    """Say whether poses are one of one design, which goes through a program as plain numbers."""
    return q.shape[1] == 1 and eq.designs is None and q.dtype == _WIDE


@with_owner
def plan_program(plan: Plan) -> PlanProgram | None:
    """Write the programs of a plan once; None if it has larger blocks, or kinds that cannot be read."""
    top = plan.topology
    if plan.large or not plan.square or not plan.sequence or len(plan.unknown) > _UNKNOWNS:
        return None
    if any(len(rows) > 2 for rows, _ in plan.sequence):  # rows of a block
        return None
    if not readable(top, ("residual", "guard")):
        return None
    return PlanProgram(plan)


@with_owner
def slope_program(plan: Plan) -> PlanProgram | None:
    """Write the program of a plan's rows and slopes alone, whatever its blocks are; None where it would be long."""
    if plan.large or len(plan.unknown) > _UNKNOWNS or not readable(plan.topology, ("residual", "guard")):
        return None
    return PlanProgram(plan, solved=False)


@with_owner
def read_kinds(plan: Plan) -> bool:
    """Read all that the host needs of a plan's kinds, so that it touches no JAX later; say whether that is possible."""
    if not readable(plan.topology, ("residual", "guard")):
        return False
    for kind in {block.kind for block in plan.topology.blocks}:
        for order in (1, 2, 3):
            host_kind(kind, plan.topology.dim).rates(order)
    plan_program(plan)
    return True
