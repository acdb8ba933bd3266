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

from jaxnc.constraints import Kind
from jaxnc.constraints.elementary import Small, cos, sin
from jaxnc.constraints.symbols import Expression
from jaxnc.families import shapes
from jaxnc.families.between import Between
from jaxnc.families.shapes import Recipe
from jaxnc.families.turns import HOME, parameters, turned
from jaxnc.pickling import factory
from jaxnc.system.frames import body_axes

Linear = tuple[tuple[float, str, int], ...]
"""A sum ``factor · what[index]``: ``"s"`` a variable, ``"c"`` a constant, ``"1"`` one, ``"x"``, ``"y"``, ``"z"`` a
coordinate of a drawn point. Empty is zero."""


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


@dataclass(frozen=True)
class Vector:
    """A drawn unit vector that stands still."""

    index: int


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
    directions: tuple["Arm | Vector", ...] = ()
    constants: tuple[Linear, ...] = ()


def scaled(value: Linear, factor: float) -> Linear:
    """A linear form times a number."""
    return tuple((factor * f, what, i) for f, what, i in value)


class Numbers:
    """Evaluates pieces, with the numbers of one instance."""

    def __init__(self, p: Any, v: Any, s: Any, c: Any):
        self.p, self.v, self.s, self.c = p, v, s, c
        self.turns: dict[Turn, Any] = {}

    def linear(self, value: Linear) -> Any:
        """A linear form; None for an empty one."""
        out: Any = None
        for factor, what, i in value:
            if what == "1":
                term = _pi(factor, self.s)
            else:
                x = self.s[i] if what == "s" else self.c[i] if what == "c" else self.p[i]["xyz".index(what)]
                term = x if factor == 1.0 else -x if factor == -1.0 else factor * x
            out = term if out is None else out + term
        return out

    def turn(self, turn: Turn) -> Any:
        """The rotation as rows of a matrix."""
        if turn not in self.turns:
            of = [self.linear(x) for x in turn.of]
            axis = [self.linear(x) for x in turn.axis]
            if turn.how == "angle":
                co, si = cos(of[0]), sin(of[0])
                found = ((co, -si), (si, co))
            else:
                found = turned(turn.how, of, axis)
            if turn.before is not None:
                first = self.turn(turn.before)
                found = tuple(tuple(_sum(r[k] * found[k][j] for k in range(3)) for j in range(3)) for r in first)
            self.turns[turn] = found
        return self.turns[turn]

    def arm(self, arm: "Arm | Vector") -> list[Any]:
        """Components along the axes of the ground."""
        if isinstance(arm, Vector):
            return list(self.v[arm.index])
        at = [self.linear(x) for x in arm.at]
        if arm.turn is None:
            return at
        rows = self.turn(arm.turn)
        return [_sum(r[k] * x for k, x in enumerate(at) if x is not None) for r in rows]

    def place(self, place: Place) -> list[Any]:
        """Coordinates of a point."""
        parts = [self.arm(arm) for arm in place]
        return [_filled(_sum(x for x in column if x is not None), self) for column in zip(*parts, strict=True)]

    def scalar(self, scalar: "Linear | Measured") -> Any:
        """A linear form, or a measure."""
        if not isinstance(scalar, Measured):
            return _filled(self.linear(scalar), self)
        assert scalar.kind.measure is not None
        p, v = self.together([self.place(x) for x in scalar.places], [self.arm(d) for d in scalar.directions])
        return scalar.kind.measure(p, v, [self.linear(c) for c in scalar.constants])  # pyright: ignore[reportArgumentType]

    def together(self, places: Sequence[list], directions: Sequence[list]) -> tuple[Any, Any]:
        """Points and vectors in the form in which a kind takes them."""
        return self._stack(places), self._stack([[_filled(x, self) for x in d] for d in directions])

    def _stack(self, rows: Sequence[list]) -> Any:
        if not rows:
            return Small(())
        first = rows[0][0]
        if isinstance(self.s, Small) or isinstance(first, Expression):
            return Small(Small(row) for row in rows)
        if isinstance(first, float):
            return np.array(rows)
        return jnp.stack([jnp.stack([jnp.asarray(x) for x in row]) for row in rows])

    def scalars(self, values: Sequence[Any]) -> Any:
        """Scalars in the form in which a kind takes them."""
        if not values:
            return Small(())
        if isinstance(self.s, Small) or isinstance(values[0], Expression):
            return Small(values)
        return np.array(values) if isinstance(values[0], float) else jnp.stack([jnp.asarray(x) for x in values])


def _sum(values) -> Any:
    out = None
    for x in values:
        out = x if out is None else out + x
    return out


def _filled(value: Any, numbers: Numbers) -> Any:
    """Zero, of the type that is calculated with, for what has no pieces."""
    if value is not None:
        return value
    some = numbers.s[0] if len(numbers.s) else numbers.p[0][0]
    return 0.0 * some


def _pi(factor: float, s: Any) -> Any:
    """A fixed number; a multiple of π where symbols are written."""
    if len(s) and isinstance(s[0], Expression):
        from jaxnc.constraints.symbols import PI

        return Expression.of(PI) * (factor / np.pi)
    return float(factor)


@dataclass(frozen=True)
class Program:
    """The residual of a constraint written over places."""

    kind: Kind  # the kind of the constraint, whose points are these places
    places: tuple[Place, ...]  # its points
    directions: tuple[Arm | Vector, ...]
    scalars: tuple["Linear | Measured", ...]
    recipes: tuple[Recipe, ...]  # how the constants of places are read off the drawing
    own: tuple[int, ...]  # its own points among those of the instance, from which its own constants are read
    own_vectors: tuple[int, ...]  # its own vectors likewise

    @property
    def first(self) -> int:
        """Where the kind's own constants begin."""
        return sum(r.count for r in self.recipes)

    def arguments(self, p: Any, v: Any, s: Any, c: Any) -> tuple[Any, Any, Any]:
        """The kind's points, vectors and scalars."""
        numbers = Numbers(p, v, s, c)
        points, vectors = numbers.together(
            [numbers.place(x) for x in self.places], [numbers.arm(d) for d in self.directions]
        )
        return points, vectors, numbers.scalars([numbers.scalar(x) for x in self.scalars])

    def __call__(self, p: Any, v: Any, s: Any, c: Any) -> Any:
        """The rows."""
        return self.kind.residual(*self.arguments(p, v, s, c), c[self.first :])

    def guard(self, p: Any, v: Any, s: Any, c: Any) -> Any:
        """The kind's guard."""
        assert self.kind.guard is not None
        return self.kind.guard(*self.arguments(p, v, s, c), c[self.first :])

    def drawn(self, p: Any, v: Any, s: Any, c: Any) -> Any:
        """Constants of the places, then the kind's own."""
        constants = [x for r in self.recipes for x in shapes.values(r, p, v)]
        if self.kind.drawn is None or not self.kind.constants:
            return constants
        given = Numbers(p, v, s, constants)
        scalars = given.scalars([given.scalar(x) for x in self.scalars]) if self.scalars else s
        own = self.kind.drawn(
            p[jnp.array(self.own, int)], v[jnp.array(self.own_vectors, int)], scalars, c[self.first :]
        )
        return (*constants, *own)

    def measure(self, p: Any, v: Any, c: Any) -> Any:
        """The kind's measure of the drawing itself."""
        assert self.kind.measure is not None
        return self.kind.measure(p[jnp.array(self.own, int)], v[jnp.array(self.own_vectors, int)], c[self.first :])


@factory
def composed(program: Program, points: int, vectors: int, scalars: int, measured: bool) -> Kind:
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


@dataclass(frozen=True)
class Reading:
    """What a variable is in a pose of the natural coordinates: one of the values of a recipe."""

    recipe: Recipe
    part: int = 0

    def __call__(self, p: Any, v: Any, c: Any) -> Any:
        """The variable's value."""
        return shapes.values(self.recipe, p, v)[self.part]


@dataclass(frozen=True)
class Oriented:
    """An orientation parameter of a body in a pose of the natural coordinates, from the segments of its frame."""

    how: str  # which parameters
    part: int  # which of them
    segments: tuple[tuple[int, ...], ...]  # pairs of points (i, j), or vectors (~k,), of the instance

    @property
    def home(self) -> float:
        """Its value in the drawing."""
        return HOME[self.how][self.part]

    def drawn(self, p: Any, v: Any) -> Any:
        """The frame as drawn, row by row."""
        return tuple(body_axes(self.segments, p, v).reshape(-1))

    def __call__(self, p: Any, v: Any, c: Any) -> Any:
        """The parameter's value."""
        frame = jnp.stack(list(c)).reshape(3, 3)
        return parameters(self.how, body_axes(self.segments, p, v).T @ frame)[self.part]


@factory
def variable(reading: "Reading | Oriented | Between", points: int, vectors: int) -> Kind:
    """A kind without rows, that says what a variable is in the drawing.

    What is counted from the drawing is known there, and nothing of it need be compiled.
    """
    counted = not isinstance(reading, Reading)
    return Kind(
        "variable, " + (f"counted from {reading.home:g}" if counted else f"{reading.recipe.how} {reading.part}"),
        _nothing,
        rows=(),
        powers=(),
        points=0 if counted else points,
        vectors=0 if counted else vectors,
        scalars=1,
        measure=_known(reading.home) if counted else reading,
    )


@functools.cache
def _known(value: float):
    return lambda p, v, c: jnp.asarray(value)


@factory
def silent(kind: Kind) -> Kind:
    """A kind that measures, and writes no row."""
    return dataclasses.replace(kind, name=f"{kind.name}, measured", residual=_nothing, rows=(), powers=(), guard=None)


def _nothing(p, v, s, c):
    return ()
