"""The static half of a compiled mechanism: names, index maps and blocks of constraints, hashable, no arrays."""

import dataclasses
import functools
import weakref
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jaxnc.calls import public
from jaxnc.constraints import Kind
from jaxnc.errors import counted
from jaxnc.pickling import fields_of
from jaxnc.system.identity import Dimension, Names, Owner, Thing, called
from jaxnc.system.loads import Loads

LARGE = 200
"""With more unknowns than this, matrices are kept and factorised sparse."""

INDEX = np.int32
"""Type of static indices. It is the same whether JAX has 64-bit numbers on or off: JAX remembers what it has made of an
array with the other setting, and arrays of int64 would serve one of the two only."""

Index = tuple[int, ...]
Segment = tuple[int, ...]
"""A direction of a body: two points ``(i, j)``, or the unit vector k as ``(~k,)``."""


@dataclass(frozen=True)
class Block:
    """All instances of one kind, as a structure of index arrays.

    Args:
        kind: the constraint kind.
        points: per instance, indices of its points.
        vectors: per instance, indices of its unit vectors.
        scalars: per instance, indices of its scalars into the vector of all coordinates.
        drawn: per instance, the points its constants are read from (drawing, or the redrawn shape of a body).
        lengths: ``(instance, constant, point, point)``: constants that are the distance between two such points.
        given: ``(instance, constant, dimension)``: constants the user gave explicitly.
        owners: per instance, what it belongs to: several where they share it, the first to write it first.
    """

    kind: Kind
    points: tuple[Index, ...]
    vectors: tuple[Index, ...]
    scalars: tuple[Index, ...]
    drawn: tuple[Index, ...]
    lengths: tuple[tuple[int, int, int, int], ...]
    given: tuple[tuple[int, int, int], ...]
    owners: tuple[tuple[Owner, ...], ...]

    @property
    def count(self) -> int:
        """Number of instances."""
        return len(self.owners)


@dataclass(frozen=True)
class Shape:
    """Bodies with explicit dimensions that are redrawn by the same recipe (see `jaxnc.system.design.redraw`)."""

    recipe: tuple
    members: tuple[Index, ...]
    dimensions: tuple[Index, ...]


@dataclass(frozen=True)
class BodyIndex:
    """A body: its points and vectors, and the segments that give its orientation.

    In the plane one segment (none for a body of one point that keeps the ground's orientation); in space two, or one
    for a bar, whose rotation about itself is not modelled.
    """

    name: str
    points: Index
    segments: tuple[Segment, ...]
    vectors: Index = ()

    @property
    def base(self) -> tuple[int, int] | None:
        """The pair of points that carries a planar body; None if there is none."""
        pairs = [s for s in self.segments if len(s) == 2]
        return (pairs[0][0], pairs[0][1]) if pairs else None


@dataclass(frozen=True)
class MarkerIndex:
    """A marker: origin point, the segments that carry it, and the same segments where lengths are read.

    `direction` marks a unit vector rather than a point.
    """

    name: str
    body: str
    origin: int
    segments: tuple[Segment, ...]
    drawn: tuple[Segment, ...]
    direction: bool = False

    @property
    def base(self) -> tuple[int, int]:
        """The pair of points that carries a planar marker."""
        return (self.segments[0][0], self.segments[0][1])


@dataclass(frozen=True)
class JointIndex:
    """A joint, relation or constraint that writes rows: its type, points and vectors (for reports and drawings).

    `type` is that of a joint, or the name of a constraint's kind, which is the user's: what is drawn by its type has an
    owner that is a joint. `bodies` are those that a weld joins, by number.

    `sides` are the points and ~vectors by which it holds each of its bodies; then of a rolling disc the contact, of a
    mesh (where they are the centre and axis of each wheel) the segments that its angles go to. `pressure` is the
    dimension that is a mesh's pressure angle, or -1.
    """

    owner: Owner
    name: str
    type: str
    points: Index
    freedoms_removed: int
    vectors: Index = ()
    bodies: Index = ()
    sides: tuple[Index, ...] = ()
    pressure: int = -1

    @property
    def drawn(self) -> bool:
        """Tell whether the joint's type says how it is drawn."""
        return self.owner.thing is Thing.JOINT


@dataclass(frozen=True)
class Special:
    """Properties of a design that do not follow from its structure."""

    rows: tuple[int, ...] | None  # independent rows, where not all of them are; None where they are
    sufficient: bool  # whether the other rows follow from these in designs of other dimensions too
    # Row and coordinate of derivatives that the structure has and that hardly differ from zero in its drawing or
    # nearby: no elimination divides by them.
    small: tuple[tuple[int, int], ...]


@public
@dataclass(frozen=True)
class Topology:
    """Everything about a mechanism that is not a number a designer may change.

    `dimensions` are the addresses of its explicit dimensions, `given` what they are. `names` are those of the things
    that own rows and numbers. `loads` are its masses and forces; `rates` are the constraints on velocities that
    positions do not see (blocks of `RateKind`), whose rows are counted by themselves; `extended` is the same mechanism
    with the hidden vectors that some spatial bodies need for their dynamics (see `jaxnc.dynamics.extended`); `special`
    is what the design it was compiled from has of its own, None before it was looked at.

    Nothing that is calculated belongs to a topology itself, but to its `structure`.
    """

    name: str
    dim: int
    points: tuple[str, ...]
    vectors: tuple[str, ...]
    scalars: tuple[str, ...]
    angles: tuple[bool, ...]
    periodic: tuple[bool, ...]
    measures: tuple[tuple[int, int], ...]
    fixed: tuple[bool, ...]
    blocks: tuple[Block, ...]
    shapes: tuple[Shape, ...]
    bodies: tuple[BodyIndex, ...]
    markers: tuple[MarkerIndex, ...]
    joints: tuple[JointIndex, ...]
    dimensions: tuple[str, ...]
    given: tuple[Dimension, ...]
    names: Names
    length_unit: str = "m"
    angle_unit: str = "rad"
    sparse: bool | None = None
    loads: Loads = field(default_factory=Loads)
    rates: tuple[Block, ...] = ()
    extended: "Topology | None" = field(default=None, repr=False)
    special: Special | None = None

    def __hash__(self):
        """Hash computed once: topologies key every cache and every trace."""
        return self._hash

    @functools.cached_property
    def _hash(self) -> int:
        return hash(tuple(fields_of(self).values()))

    def __reduce__(self):
        # Hashes of text differ from process to process, and what was derived is derived again.
        return Topology, tuple(fields_of(self).values())

    def __repr__(self) -> str:
        """Stand for all of it in a line: JAX prints a topology with every tree that it complains of.

        The number at the end tells one from another within a process.
        """
        counts = (self.points, "point"), (self.bodies, "body", "bodies"), (self.row_owners, "row")
        told = ", ".join(counted(len(things), *noun) for things, *noun in counts)
        return f"Topology({self.name!r}: {told}, #{self._hash & 0xFFFF:04x})"

    def __copy__(self) -> "Topology":
        return self

    def __deepcopy__(self, memo: dict) -> "Topology":
        return self

    @functools.cached_property
    def structure(self) -> "Topology":
        """The topology without names and loads, to which plans, equations and traces belong.

        Its points, vectors, scalars and dimensions are numbered. It is one object for all mechanisms that have it.
        """

        def numbered(letter: str, names: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(f"{letter}{k}" for k in range(len(names)))

        return interned(
            Topology(
                "",
                self.dim,
                numbered("p", self.points),
                numbered("v", self.vectors),
                numbered("s", self.scalars),
                self.angles,
                self.periodic,
                self.measures,
                self.fixed,
                tuple(dataclasses.replace(b, owners=((),) * b.count) for b in self.blocks),
                self.shapes,
                tuple(dataclasses.replace(b, name="") for b in self.bodies),
                tuple(dataclasses.replace(m, name="", body="") for m in self.markers),
                (),
                numbered("d", self.dimensions),
                (),
                ((),) * len(self.names),
                sparse=self.large,
                special=self.special,
            )
        )

    @functools.cached_property
    def coordinates(self) -> tuple[str, ...]:
        """Names of all coordinates, in the order of q: ``A.x, A.y, …``, vectors, then angles and distances."""
        axes = "xyz"[: self.dim]
        spread = [f"{name}.{axis}" for name in (*self.points, *self.vectors) for axis in axes]
        return (*spread, *self.scalars)

    @functools.cached_property
    def position(self) -> dict[str, int]:
        """Index into q of every coordinate name."""
        return {name: i for i, name in enumerate(self.coordinates)}

    def mark(self, scalars: Sequence[bool]) -> np.ndarray:
        """Marks of all coordinates ``(N,)`` from those of the angles and distances."""
        return np.append(np.zeros(len(self.coordinates) - len(scalars), bool), np.array(scalars, bool))

    def is_angle(self, name: str) -> bool:
        """Tell whether a coordinate is an angle."""
        return name in self.scalars and self.angles[self.scalars.index(name)]

    def write_value(self, name: str, value: float, digits: int = 6) -> str:
        """Write a coordinate's value as reports do: radians and lengths bare, ``30°`` where degrees are shown."""
        degrees = self.angle_unit == "deg" and self.is_angle(name)
        return f"{np.degrees(value):.{digits}g}°" if degrees else f"{value:.{digits}g}"

    def write_values(self, values: Mapping[str, Any]) -> str:
        """Write the single values of coordinates as reports do: ``phi = 30°, s = 0.2``."""
        return ", ".join(f"{n} = {self.write_value(n, float(np.ravel(v)[0]))}" for n, v in values.items())

    def is_direction(self, name: str) -> bool:
        """Tell whether a name is that of a unit vector, or of one of its components."""
        return name.partition(".")[0] in (*self.vectors, *(m.name for m in self.markers if m.direction))

    def unit(self, name: str) -> str:
        """Unit of a coordinate or a place: ``"rad"``, ``"1"`` of directions, or the unit of length."""
        return "rad" if self.is_angle(name) else "1" if self.is_direction(name) else self.length_unit

    def load_unit(self, dimension: str) -> str:
        """Name the unit of a force, moment, energy or power, of the set of units that has the unit of length.

        Metric sets have newtons and seconds: with metres the mass is in kg, with millimetres in tonnes.
        """
        length = self.length_unit
        if length == "m":
            return {"force": "N", "moment": "N m", "energy": "J", "power": "W"}[dimension]
        force = "N" if length in ("dm", "cm", "mm") else "force"
        work = f"{force} {length}".rstrip()
        return {"force": force, "moment": work, "energy": work, "power": f"{work}/s"}[dimension]

    def named(self, at: Iterable[int]) -> tuple[str, ...]:
        """Names of coordinates, by their indices."""
        return tuple(self.coordinates[k] for k in at)

    def called(self, *owners: Owner) -> str:
        """Name a thing that some owners share."""
        return called(self.names, *owners)

    @functools.cached_property
    def row_owners(self) -> tuple[tuple[Owner, ...], ...]:
        """Owners of every row of the residual."""
        return tuple(owners for block in self.blocks for owners in block.owners for _ in block.kind.rows)

    @functools.cached_property
    def owners(self) -> frozenset[Owner]:
        """Everything that owns rows, those on velocities too."""
        return frozenset(o for block in (*self.blocks, *self.rates) for owners in block.owners for o in owners)

    def rows_of(self, owner: Owner) -> np.ndarray:
        """Numbers of the rows that belong to something, alone or with others."""
        return np.flatnonzero([owner in owners for owners in self.row_owners])

    @functools.cached_property
    def rows(self) -> tuple[str, ...]:
        """Names of all rows of the residual, to be read: ``owner: label (kind, instance points)``."""
        return self._row_names(self.blocks)

    @functools.cached_property
    def rate_rows(self) -> tuple[str, ...]:
        """Names of all rows on velocities."""
        return self._row_names(self.rates)

    def _row_names(self, blocks: tuple[Block, ...]) -> tuple[str, ...]:
        names = []
        for block in blocks:
            for owners, points, vectors in zip(block.owners, block.points, block.vectors, strict=True):
                at = (*(self.points[i] for i in points), *(self.vectors[i] for i in vectors))
                where = "-".join(dict.fromkeys(at))
                for label in block.kind.rows:  # a kind of the user's may leave its label empty
                    names.append(f"{self.called(*owners)}: {label or block.kind.name}" + (f" {where}" if where else ""))
        return tuple(names)

    @functools.cached_property
    def unknown(self) -> np.ndarray:
        """Indices of the coordinates that are not fixed."""
        return np.flatnonzero(~np.array(self.fixed, dtype=bool)).astype(INDEX)

    @property
    def large(self) -> bool:
        """Tell whether matrices of this mechanism are kept sparse: as it was compiled, otherwise by its unknowns."""
        return len(self.unknown) > LARGE if self.sparse is None else self.sparse

    @functools.cached_property
    def layout(self) -> tuple["BlockLayout", ...]:
        """Index arrays of each block."""
        return self._lay_out(self.blocks)

    @functools.cached_property
    def rate_layout(self) -> tuple["BlockLayout", ...]:
        """Index arrays of each block of rows on velocities."""
        return self._lay_out(self.rates)

    def _lay_out(self, blocks: tuple[Block, ...]) -> tuple["BlockLayout", ...]:
        first, out, axes = 0, [], np.arange(self.dim, dtype=INDEX)
        for block in blocks:
            count, kind = block.count, block.kind
            places = (block.points, kind.points), (block.vectors, kind.vectors), (block.scalars, kind.scalars)
            points, vectors, scalars, drawn = (
                np.array(at, dtype=INDEX).reshape(count, width) for at, width in (*places, (block.drawn, kind.points))
            )
            beyond = len(self.points) + vectors  # the vectors' components follow those of the points
            spread = [(at[:, :, None] * self.dim + axes).reshape(count, -1) for at in (points, beyond)]
            rows = first + np.arange(count * len(kind.rows), dtype=INDEX).reshape(count, len(kind.rows))
            out.append(BlockLayout(np.concatenate([*spread, scalars], axis=1), rows, drawn, vectors, scalars))
            first += count * len(kind.rows)
        return tuple(out)


_INTERNED: "weakref.WeakKeyDictionary[Topology, weakref.ref[Topology]]" = weakref.WeakKeyDictionary()


def interned(top: Topology) -> Topology:
    """Return the one object that stands for all topologies equal to this one, as long as anything uses it.

    The last ones are kept: a mechanism that is described again, in a notebook or a loop, finds what was worked out.
    """
    known = _INTERNED.get(top)
    found = known() if known is not None else None
    if found is None:
        found = top
        _INTERNED[top] = weakref.ref(top)
    return _recent(found)


@functools.lru_cache(maxsize=128)  # two for each mechanism that is compiled, three where it is simulated
def _recent(top: Topology) -> Topology:
    return top


@dataclass(frozen=True)
class BlockLayout:
    """Index arrays of one block into q: local variables of each instance, and the rows it fills."""

    variables: np.ndarray
    rows: np.ndarray
    drawn: np.ndarray
    vectors: np.ndarray
    scalars: np.ndarray
