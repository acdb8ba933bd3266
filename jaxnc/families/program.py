"""Places of points as functions of a family's variables, and the constraint kinds that are written over them.

A point of a body is a sum of pieces: where its frame is, and arms that turn with it. A program is static and counts
what it takes (drawn points, vectors, variables, constants) from zero, so that two joints of one form have one program
and one kind, and are computed together. The moving points of the drawing stay in a family's system as fixed points:
they are what its constants are read off.
"""

import dataclasses
import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxnc.constraints.elementary import Small, cos, sin
from jaxnc.constraints.kind import Kind, dot
from jaxnc.constraints.symbols import PI, Expression
from jaxnc.families import shapes
from jaxnc.families.bodies import Part
from jaxnc.families.shapes import Between, Reading, Recipe, rotation_rows
from jaxnc.pickling import factory, register_by_name
from jaxnc.types import Array, Components, Scalar

Linear = tuple[tuple[float, str, int], ...]
"""A sum ``factor · what[index]``: ``"s"`` a variable, ``"c"`` a constant, ``"1"`` one, ``"x"``, ``"y"``, ``"z"`` a
coordinate of a drawn point, ``"X"``, ``"Y"``, ``"Z"`` a component of a drawn unit vector. Empty is zero."""


@dataclass(frozen=True)
class Turn:
    """The rotation of a frame, from its parent's."""

    how: str  # "angle" in the plane; in space "about" an axis, or the name of orientation parameters
    of: tuple[Linear, ...]  # the angle, or each of the parameters
    axis: tuple[Linear, ...] = ()  # components of the axis in the frame before, for "about"
    before: "Turn | None" = None  # the rotation that this one follows


@dataclass(frozen=True)
class Arm:
    """Components in a turned frame; in the axes of the ground without a turn."""

    turn: Turn | None
    at: tuple[Linear, ...]


Place = tuple[Arm, ...]
"""A point, the sum of its pieces."""


@dataclass(frozen=True)
class Frame:
    """A body's frame: its origin and its rotation."""

    origin: Place
    turn: Turn | None


@dataclass(frozen=True)
class Measured:
    """A scalar that is the measure of a kind at places, such as a distance."""

    kind: Kind
    places: tuple[Place, ...]
    directions: tuple[Arm, ...] = ()
    constants: tuple[Linear, ...] = ()


@dataclass(frozen=True)
class Coordinate:
    """A scalar that is a coordinate of a point, or a component of an arm by itself."""

    of: Place
    axis: int


def scale(value: Linear, factor: float) -> Linear:
    """A linear form times a number."""
    return tuple((factor * f, what, i) for f, what, i in value)


class Evaluator:
    """Evaluates pieces, with the numbers of one instance."""

    def __init__(self, p: Components, v: Components, s: Components, c: Components):
        self.p, self.v, self.s, self.c = p, v, s, c
        self.turns: dict[Turn, tuple] = {}

    def linear(self, value: Linear) -> Any:
        """A linear form; None for an empty one."""
        out: Any = None
        for factor, what, i in value:
            if what == "1":  # an angle; a multiple of π where symbols are written
                written = len(self.s) and isinstance(self.s[0], Expression)
                term = Expression.of(PI) * (factor / np.pi) if written else float(factor)
            else:
                drawn = self.v if what.isupper() else self.p
                x = self.s[i] if what == "s" else self.c[i] if what == "c" else drawn[i]["xyz".index(what.lower())]
                term = x if factor == 1.0 else -x if factor == -1.0 else factor * x
            out = term if out is None else out + term
        return out

    def turn(self, turn: Turn) -> tuple:
        """The rotation as rows of a matrix."""
        if turn not in self.turns:
            of = [self.linear(x) for x in turn.of]
            axis = [self.linear(x) for x in turn.axis]
            if turn.how == "angle":
                co, si = cos(of[0]), sin(of[0])
                found = ((co, -si), (si, co))
            else:
                found = rotation_rows(turn.how, of, axis)
            if turn.before is not None:
                first = self.turn(turn.before)
                found = tuple(tuple(_add_up(r[k] * found[k][j] for k in range(3)) for j in range(3)) for r in first)
            self.turns[turn] = found
        return self.turns[turn]

    def arm(self, arm: Arm) -> list:
        """Components along the axes of the ground."""
        at = [self.linear(x) for x in arm.at]
        if arm.turn is None:
            return at
        rows = self.turn(arm.turn)
        return [_add_up(r[k] * x for k, x in enumerate(at) if x is not None) for r in rows]

    def place(self, place: Place) -> list:
        """Coordinates of a point."""
        parts = [self.arm(arm) for arm in place]
        return [_fill_zero(_add_up(x for x in column if x is not None), self) for column in zip(*parts, strict=True)]

    def scalar(self, scalar: "Linear | Measured | Coordinate") -> Scalar:
        """A linear form, a measure, or a coordinate."""
        if isinstance(scalar, Coordinate):
            return self.place(scalar.of)[scalar.axis]
        if not isinstance(scalar, Measured):
            return _fill_zero(self.linear(scalar), self)
        assert scalar.kind.measure is not None
        p, v = self.together([self.place(x) for x in scalar.places], [self.arm(d) for d in scalar.directions])
        return scalar.kind.measure(p, v, [self.linear(c) for c in scalar.constants])

    def together(self, places: Sequence[list], directions: Sequence[list]) -> tuple[Components, Components]:
        """Points and vectors in the form in which a kind takes them."""
        return self.gather(places), self.gather([[_fill_zero(x, self) for x in d] for d in directions])

    def gather(self, values: Sequence) -> Any:
        """Numbers, or rows of numbers, in the form in which a kind takes them."""
        nested = bool(values) and isinstance(values[0], list)
        first = values[0][0] if nested else values[0] if values else None
        if not values or isinstance(self.s, Small) or isinstance(first, Expression):
            return Small(map(Small, values) if nested else values)
        if isinstance(first, float):
            return np.array(values)
        return jnp.stack([self.gather(x) if nested else jnp.asarray(x) for x in values])


def _add_up(values) -> Scalar | None:
    out = None
    for x in values:
        out = x if out is None else out + x
    return out


def _fill_zero(value: Scalar | None, numbers: Evaluator) -> Scalar:
    """Zero, of the type that is calculated with, for what has no pieces."""
    if value is not None:
        return value
    some = numbers.s[0] if len(numbers.s) else numbers.p[0][0]
    return 0.0 * some


@dataclass(frozen=True)
class Program:
    """The residual of a constraint written over places."""

    kind: Kind  # the kind of the constraint, whose points are these places
    places: tuple[Place, ...]  # its points
    directions: tuple[Arm, ...]
    scalars: tuple[Linear | Measured | Coordinate, ...]
    recipes: tuple[Recipe, ...]  # how the constants of places are read off the drawing
    own: tuple[int, ...]  # its own points among those of the instance, from which its own constants are read
    own_vectors: tuple[int, ...]  # its own vectors likewise

    @property
    def first(self) -> int:
        """Where the kind's own constants begin."""
        return sum(r.count for r in self.recipes)

    def arguments(self, p: Components, v: Components, s: Components, c: Components) -> tuple[Any, Any, Any]:
        """The kind's points, vectors and scalars."""
        numbers = Evaluator(p, v, s, c)
        points, vectors = numbers.together(
            [numbers.place(x) for x in self.places], [numbers.arm(d) for d in self.directions]
        )
        return points, vectors, numbers.gather([numbers.scalar(x) for x in self.scalars])

    def __call__(self, p: Components, v: Components, s: Components, c: Components) -> Sequence[Scalar]:
        """The rows."""
        return self.kind.residual(*self.arguments(p, v, s, c), c[self.first :])

    def guard(self, p: Components, v: Components, s: Components, c: Components) -> Sequence[Scalar]:
        """The kind's guard."""
        assert self.kind.guard is not None
        return self.kind.guard(*self.arguments(p, v, s, c), c[self.first :])

    def drawn(self, p: Components, v: Components, s: Components, c: Components) -> Any:
        """Constants of the places, then the kind's own."""
        constants = [x for r in self.recipes for x in shapes.values(r, p, v)]
        if self.kind.drawn is None or not self.kind.constants:
            return constants
        given = Evaluator(p, v, s, constants)
        scalars = given.gather([given.scalar(x) for x in self.scalars]) if self.scalars else s
        own = self.kind.drawn(
            p[jnp.array(self.own, int)], v[jnp.array(self.own_vectors, int)], scalars, c[self.first :]
        )
        return (*constants, *own)

    def measure(self, p: Components, v: Components, c: Components) -> Array | None:
        """The kind's measure of the drawing itself."""
        assert self.kind.measure is not None
        return self.kind.measure(p[jnp.array(self.own, int)], v[jnp.array(self.own_vectors, int)], c[self.first :])


@factory
def compose_kind(program: Program, points: int, vectors: int, scalars: int, measured: bool) -> Kind:
    """The kind of a program: the same rows, of a family's variables."""
    kind = program.kind
    names = tuple(f"{name} {k}" for k, r in enumerate(program.recipes) for name in r.names)
    constants = (*names, *kind.constants)
    return Kind(
        f"{kind.name}, of variables",
        program,
        rows=kind.rows,
        powers=kind.powers,
        points=points,
        vectors=vectors,
        scalars=scalars,
        constants=constants,
        drawn=program.drawn if constants else None,
        measure=program.measure if measured else None,
        guard=None if kind.guard is None else program.guard,
        source=kind.source,
    )


@factory
def variable_kind(reading: Reading | Between, points: int, vectors: int) -> Kind:
    """A kind without rows, that says what a variable is in the drawing.

    What is counted from the drawing is known there, and nothing of it need be compiled.
    """
    if isinstance(reading, Reading):
        how, measure = f"{reading.recipe.how} {reading.part}", lambda p, v, c: reading.evaluate(p, v)
    else:
        how, measure, points, vectors = f"counted from {reading.home:g}", _constant_measure(reading.home), 0, 0
    return Kind(f"variable, {how}", _no_rows, (), (), points=points, vectors=vectors, scalars=1, measure=measure)


@functools.cache
def _constant_measure(value: float):
    return lambda p, v, c: jnp.asarray(value)


@factory
def silence(kind: Kind) -> Kind:
    """A kind that measures, and writes no row."""
    return dataclasses.replace(kind, name=f"{kind.name}, measured", residual=_no_rows, rows=(), powers=(), guard=None)


def _no_rows(p, v, s, c):
    return ()


class Scribe:
    """Collects the points, vectors, variables and readings of one instance."""

    def __init__(self):
        self.points: list[tuple[int, int]] = []  # pairs (point, where it is read)
        self.vectors: list[int] = []  # unit vectors
        self.scalars: list[str] = []  # names of variables
        self.recipes: list[Recipe] = []  # readings of constants
        self.frames: dict[int, Frame] = {}  # frames of parts that are made

    def p(self, point: int, part: Part | None = None) -> int:
        """A point as drawn, or of the (redrawn) shape of a part."""
        return self.pair(point, part.drawn.get(point, point) if part else point)

    def pair(self, point: int, drawn: int) -> int:
        """A point, and where in the drawing it is read."""
        return _index_of(self.points, (point, drawn))

    def at(self, points: tuple[int, ...], part: Part | None = None) -> tuple[int, ...]:
        """Several points."""
        return tuple(self.p(p, part) for p in points)

    def v(self, vector: int) -> int:
        """A unit vector."""
        return _index_of(self.vectors, vector)

    def s(self, name: str) -> Linear:
        """A variable."""
        return ((1.0, "s", _index_of(self.scalars, name)),)

    def c(self, how: str, points: tuple[int, ...], vectors: tuple[int, ...] = (), extra: tuple = ()) -> list[Linear]:
        """Constants read off the drawing."""
        recipe = Recipe(how, points, vectors, extra)
        before = sum(r.count for r in self.recipes[: _index_of(self.recipes, recipe)])
        return [((1.0, "c", before + k),) for k in range(recipe.count)]


def _index_of(found: list, item) -> int:
    if item not in found:
        found.append(item)
    return found.index(item)


def fixed(value: float) -> Linear:
    """A number."""
    return ((value, "1", 0),) if value else ()


# -- kinds of rows that are the families' own -------------------------------------------------------------------

PROJECTION = Kind(
    "projection",
    lambda p, v, s, c: ((p[0][0] - p[1][0]) * cos(s[0]) + (p[0][1] - p[1][1]) * sin(s[0]) - s[1],),
    rows=("distance",),
    points=2,
    scalars=2,
    source="(10): the projection of a vector on a direction of a body is constant",
)

EQUAL = Kind(
    "equal",
    lambda p, v, s, c: (s[0] - s[1],),
    rows=("angle",),
    powers=(0,),
    scalars=2,
    source="(9)",
)

PAIR = Kind(
    "parallel in two rows",
    lambda p, v, s, c: (
        v[0][0] * v[1][0] + v[0][1] * v[1][1] + v[0][2] * v[1][2],
        v[0][0] * v[2][0] + v[0][1] * v[2][1] + v[0][2] * v[2][2],
    ),
    rows=("across 1", "across 2"),
    powers=(0, 0),
    vectors=3,
    source="§4.2.2: a direction of one body stays across two directions of the other",
)


SAME_TURN = Kind(
    "same orientation",
    lambda p, v, s, c: (dot(v[1], v[5]), dot(v[2], v[3]), dot(v[0], v[4])),
    rows=("about x", "about y", "about z"),
    powers=(0, 0, 0),
    vectors=6,
    # Half turns and the cyclic third of a turn meet the rows too; their matrices have a trace below one.
    guard=lambda p, v, s, c: (dot(v[0], v[3]) + dot(v[1], v[4]) + dot(v[2], v[5]) - 1.0,),
    source="the paper: a loop that is closed by six equations, three of them about its orientation",
)


@factory
def _at_kind(axis: int) -> Kind:
    return Kind(
        f"at {'xyz'[axis]}",
        lambda p, v, s, c: (p[0][axis] - s[0],),
        rows=("xyz"[axis],),
        points=1,
        scalars=1,
        source="a coordinate of a point that is a variable, or does not change",
    )


AT = tuple(map(_at_kind, range(3)))


def _unit_kind(name: str, count: int, source: str) -> Kind:
    return Kind(
        name,
        lambda p, v, s, c: (sum(s[i] * s[i] for i in range(count)) - 1.0,),
        rows=("unit length",),
        powers=(0,),
        scalars=count,
        source=source,
    )


NORM = _unit_kind("Euler parameters", 4, "normalisation of Euler parameters")
DIRECTION = _unit_kind("direction of a bar", 3, "§4: a unit vector")


def _orthonormal(p, v, s, c):
    rows = [s[0:3], s[3:6], s[6:9]]
    return tuple(dot(rows[i], rows[j]) - (1.0 if i == j else 0.0) for i in range(3) for j in range(i + 1))


ORTHONORMAL = Kind(
    "rotation matrix",
    _orthonormal,
    rows=("xx", "yx", "yy", "zx", "zy", "zz"),
    powers=(0,) * 6,
    scalars=9,
    source="the rows of a rotation matrix are unit vectors at right angles",
)

NORMALISED = {"euler parameters": NORM, "rotation matrix": ORTHONORMAL}

register_by_name(__name__, (PROJECTION, EQUAL, PAIR, SAME_TURN, NORM, DIRECTION, ORTHONORMAL))
