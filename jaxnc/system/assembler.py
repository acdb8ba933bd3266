"""What compiling a planar and a spatial description have in common: instances of kinds, grouped into blocks."""

import dataclasses
import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc import constraints as kinds
from jaxnc.compiling import on_device
from jaxnc.constraints import Kind, RateKind
from jaxnc.errors import MechanismError
from jaxnc.mechanism import model as record
from jaxnc.system.identity import Dimension, Owner, Quantity, Thing, addresses, called, names_of
from jaxnc.system.loads import LoadAssembler
from jaxnc.system.recipe import recipe
from jaxnc.system.system import Parameters, System, floats
from jaxnc.system.topology import Block, BodyIndex, JointIndex, MarkerIndex, Segment, Shape, Topology

if TYPE_CHECKING:
    from jaxnc.mechanism import Mechanism

_LONG = re.compile(r"(length|radius)\d*")  # constants of kinds that are lengths
COINCIDENT = 1e-9  # of the drawing's size: closer points have no direction


@dataclass
class Instance:
    """One constraint as it is being written; see `jaxnc.system.topology.Block` for the fields."""

    kind: Any
    points: tuple[int, ...]
    scalars: tuple[int, ...]
    owners: tuple[Owner, ...]
    drawn: tuple[int, ...]
    vectors: tuple[int, ...] = ()
    lengths: dict[str, tuple[int, int]] = field(default_factory=dict)
    given: dict[str, int] = field(default_factory=dict)


class Assembler(ABC):
    """Turns a description into a system; its subclasses know the forms of the plane and of space.

    Whether matrices are kept `sparse` is decided by the number of unknowns if it is None. `hidden` are names of vectors
    that bodies have for their dynamics only: no base is made of them.
    """

    owner: Owner  # what rows are written for

    def __init__(self, mechanism: "Mechanism", sparse: bool | None = None, hidden: Sequence[str] = ()):
        self.mechanism, self.model, self.sparse, self.hidden = mechanism, mechanism.model, sparse, tuple(hidden)
        m = self.model
        self.dim = m.dim
        self.names, self.vector_names = mechanism.all_points, mechanism.all_vectors
        self.owners = names_of(mechanism)
        if not self.names:
            raise MechanismError(f"{m.name!r} has no points; add some with ground() and point()")
        self.index = {name: i for i, name in enumerate(self.names)}
        self.vector_index = {name: i for i, name in enumerate(self.vector_names)}
        specs = [p if isinstance(p, record.Point) else record.Point(p) for p in m.points.values()]
        self.home = np.array([*m.ground.values(), *(p.at for p in specs)], dtype=float)
        axes = mechanism.axes
        fixed = [axes] * len(m.ground) + [p.fixed for p in specs]
        self.fixed = np.array([[axis in f for axis in axes] for f in fixed])
        self.fixed_vectors = np.arange(len(self.vector_names)) < len(m.ground_vectors)
        vectors = np.array([*m.ground_vectors.values(), *m.vectors.values()], dtype=float).reshape(-1, m.dim)
        vectors = vectors / np.abs(vectors).max(axis=1, keepdims=True)  # their squares may not be numbers otherwise
        self.vectors = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
        self.size = float(np.linalg.norm(np.ptp(self.home, axis=0))) or 1.0
        self.scalars = mechanism.scalar_names
        self.first_scalar = self.dim * (len(self.names) + len(self.vector_names))
        self.instances: list[Instance] = []
        self.rates: list[Instance] = []
        self.seen: dict[tuple, Instance] = {}
        self.measured: dict[str, Instance] = {}
        self.explicit: list[Dimension] = []
        self.values: list[float] = []
        self.redrawn: dict[str, dict[int, int]] = {}
        self.redrawn_at: dict[int, list[dict[int, int]]] = {}
        self.shapes: list[Shape] = []
        self.bodies: list[BodyIndex] = []
        self.joints: list[JointIndex] = []
        self.recipes: dict[tuple, list[tuple[str, tuple[int, ...], tuple[int, ...]]]] = {}

    def system(self) -> System:
        """Write everything, in the order of the schema."""
        m = self.model
        specs = {name: b if isinstance(b, record.Body) else record.Body(b) for name, b in m.bodies.items()}
        for name, body in specs.items():
            self.prepare_body(name, body)
        self.number_shapes()
        self.add_bodies(specs)
        for name, angle in m.angles.items():
            self.owner = self.owning(Thing.COORDINATE, name)
            self.add_angle(name, angle)
        for name, distance in m.distances.items():
            self.owner = self.owning(Thing.COORDINATE, name)
            self.add_distance(name, distance)
        for name, joint in m.joints.items():
            self.owner = self.owning(Thing.JOINT, name)
            getattr(self, "add_" + type(joint).__name__.lower())(name, joint)
        for name, relation in m.relations.items():
            self.owner = self.owning(Thing.RELATION, name)
            self.add_relation(name, relation)
        for name, constraint in m.constraints.items():
            self.owner = self.owning(Thing.CONSTRAINT, name)
            self.add_constraint(name, constraint)
        markers = tuple(self.marker(name, data) for name, data in m.markers.items())
        blocks, measures = self.blocks()
        numbers = LoadAssembler(self)
        loads, self.lacking = numbers.loads(), numbers.lacking
        dimensions, physical, named = self.addressed(numbers.entries)
        functions = tuple(dataclasses.replace(f, address=named[f.name]) for f in loads.functions)
        used = {s for i in self.instances if not i.kind.measure for s in i.scalars}
        makers = (j for j in m.joints.values() if isinstance(j, record.Rolling | record.Screw))
        angles = {*m.angles, *(j.angle for j in makers)}
        # Where anything counts turns (a gear, a relation, a rolling disc), no angle may be taken modulo a turn.
        counted = any(
            i in used for s, i in zip(self.scalars, range(self.first_scalar, 10**9), strict=False) if s in angles
        )
        topology = Topology(
            name=m.name,
            dim=self.dim,
            points=self.names,
            vectors=self.vector_names,
            scalars=self.scalars,
            angles=tuple(s in angles for s in self.scalars),
            periodic=tuple(s in angles and not counted for s in self.scalars),
            measures=measures,
            fixed=(
                *map(bool, self.fixed.reshape(-1)),
                *map(bool, np.repeat(self.fixed_vectors, self.dim)),
                *(False for _ in self.scalars),
            ),
            blocks=blocks,
            shapes=tuple(self.shapes),
            bodies=tuple(self.bodies),
            markers=markers,
            joints=tuple(self.joints),
            dimensions=dimensions,
            given=tuple(self.explicit),
            names=self.owners,
            length_unit=m.units.length,
            angle_unit=m.units.angle,
            sparse=self.sparse,
            loads=dataclasses.replace(loads, physical=physical, functions=functions),
            rates=grouped(self.rates)[0],
        )
        places = [data.at if data.at is not None else data.direction for data in m.markers.values()]
        parameters = Parameters(
            points=on_device(self.home),
            vectors=on_device(self.vectors),
            markers=on_device(np.array(places, dtype=float).reshape(-1, self.dim)),
            dimensions=on_device(np.array(self.values, dtype=float)),
            physical=on_device(np.array(numbers.values, dtype=float)),
            own=tuple(floats(self.mechanism.functions[f.name][1], f.name) for f in loads.functions),
        )
        return System(topology, parameters)

    # What the subclasses write.

    @abstractmethod
    def add_bodies(self, specs: dict[str, record.Body]) -> None:
        """Write the rows of all bodies."""

    @abstractmethod
    def add_angle(self, name: str, data: record.Angle) -> None:
        """Write an angle."""

    @abstractmethod
    def add_distance(self, name: str, data: record.Distance) -> None:
        """Write a distance."""

    @abstractmethod
    def marker(self, name: str, data: record.Marker) -> MarkerIndex:
        """Say what carries a marker."""

    # -- small tools --------------------------------------------------------------------------------------------

    def owning(self, thing: Thing, name: str) -> Owner:
        """The id of something that owns rows."""
        return Owner(thing, self.owners[thing].index(name))

    def text(self, *owners: Owner) -> str:
        """What something is called that these own together."""
        return called(self.owners, *owners)

    def at(self, *names: str) -> tuple[int, ...]:
        """Indices of points."""
        return tuple(self.index[n] for n in names)

    def pair(self, names: Sequence[str]) -> tuple[int, int]:
        """Indices of two points."""
        first, second = names
        return self.index[first], self.index[second]

    def scalar(self, name: str) -> int:
        """Index into q of an angle, a distance or a single coordinate of a point or vector."""
        if name in self.scalars:
            return self.first_scalar + self.scalars.index(name)
        point, axis = name.split(".")
        at = self.index[point] if point in self.index else len(self.names) + self.vector_index[point]
        return self.dim * at + "xyz".index(axis)

    def dimension(self, key: str, value: float, quantity: Quantity = Quantity.LENGTH) -> int:
        """Note an explicit dimension of what is being written."""
        self.explicit.append(Dimension(self.owner, key, quantity))
        self.values.append(float(value))
        return len(self.values) - 1

    def addressed(
        self, physical: Sequence[tuple[Owner | None, str]]
    ) -> tuple[tuple[str, ...], tuple[str, ...], dict[str, str]]:
        """By what a user calls explicit dimensions, physical parameters and functions: no two of them alike."""
        spots = (*self.names, *self.vector_names, *self.model.markers)
        own = [(None, name) for name in (*spots, *(f"{spot}.{axis}" for spot in spots for axis in "xyz"[: self.dim]))]
        given = [(d.owner, d.key) for d in self.explicit]
        functions = {name: (self.owning(Thing.FORCE, name), "") for name in self.mechanism.functions}
        found = iter(addresses(self.owners, (*own, *functions.values(), *given, *physical))[len(own) :])
        named = {name: next(found) for name in functions}
        return tuple(next(found) for _ in given), tuple(found), named

    def direction(self, pair: Sequence[int], what: str) -> None:
        """Refuse two points that give no direction."""
        a, b = pair
        if np.linalg.norm(self.home[a] - self.home[b]) <= COINCIDENT * self.size:
            raise MechanismError(
                f"{what}: points {self.names[a]!r} and {self.names[b]!r} are drawn at the same place, so they give no "
                f"direction; move one of them"
            )

    def add(
        self,
        kind: Kind,
        points: Sequence[int],
        scalars: Sequence[int] = (),
        vectors: Sequence[int] = (),
        owner: Owner | None = None,
        **more,
    ) -> Instance | None:
        """Write one instance. The same one twice is written once, with both owners; one of the ground alone never."""
        owner = self.owner if owner is None else owner
        points, scalars, vectors = tuple(points), tuple(scalars), tuple(vectors)
        if not scalars and self.fixed[list(points)].all() and self.fixed_vectors[list(vectors)].all():
            return None
        data = Instance(kind, points, scalars, (owner,), more.pop("drawn", points), vectors, **more)
        key = (kind, points if kind is not kinds.DISTANCE else tuple(sorted(points)), scalars, vectors)
        twin = self.seen.get(key)
        if twin is not None and not data.given and not twin.given and twin.drawn == data.drawn:
            twin.owners = tuple(dict.fromkeys((*twin.owners, owner)))
            return twin
        self.seen[key] = data
        self.instances.append(data)
        return data

    def slip(
        self,
        kind: RateKind,
        points: Sequence[int],
        scalars: Sequence[int] = (),
        vectors: Sequence[int] = (),
        given: dict[str, int] | None = None,
    ) -> None:
        """Write one instance of a constraint on velocities."""
        points, vectors = tuple(points), tuple(vectors)
        self.rates.append(Instance(kind, points, tuple(scalars), (self.owner,), points, vectors, {}, given or {}))

    def length_of(self, a: int, b: int) -> tuple[int, int]:
        """Where the distance between two points is read: in a redrawn body that has both, or in the drawing."""
        for where in self.redrawn_at.get(a, ()):
            if b in where:
                return where[a], where[b]
        return a, b

    def joint(
        self,
        name: str,
        kind: str,
        points: Sequence[int],
        removed: int,
        vectors: Sequence[int] = (),
        bodies: Sequence[str] = (),
        sides: Sequence[Sequence[int]] = (),
        pressure: int = -1,
    ) -> None:
        """Note a joint for reports and drawings, and what it holds on each side (see `JointIndex`)."""
        numbers = tuple(self.owning(Thing.BODY, body).number for body in bodies)
        held = tuple(tuple(side) for side in sides)
        at = tuple(points), removed, tuple(vectors)
        self.joints.append(JointIndex(self.owner, name, kind, *at, numbers, held, pressure))

    def pressure(self, angle: float | None) -> int:
        """Note a mesh's pressure angle as a dimension."""
        return -1 if angle is None else self.dimension("pressure_angle", angle, Quantity.NUMBER)

    def measure(
        self,
        name: str,
        kind: Kind,
        points: tuple[int, ...],
        lengths: dict[str, tuple[int, int]] | None = None,
        owner: Owner | None = None,
        **more,
    ) -> None:
        """Write the row of a mixed coordinate, which belongs to it unless something else is said."""
        owner = self.owning(Thing.COORDINATE, name) if owner is None else owner
        data = self.add(kind, points, (self.scalar(name),), lengths=lengths or {}, owner=owner, **more)
        assert data is not None
        self.measured[name] = data

    # -- explicit dimensions ------------------------------------------------------------------------------------

    def prepare_body(self, name: str, body: record.Body) -> None:
        """Note the explicit dimensions of a body, and how it is redrawn with them."""
        points = self.at(*body.points)
        if len(points) == 1:
            if body.lengths or body.local:
                raise MechanismError(f"body {name!r} has one point, so it has no lengths or local places")
            return
        if not body.lengths and not body.local:
            return
        index = {p: k for k, p in enumerate(body.points)}
        steps, values = recipe(name, body, index, self.home[list(points)])
        self.owner = self.owning(Thing.BODY, name)
        kinds_ = [Quantity.LENGTH if key in body.lengths else Quantity.PLACE for key, _ in values]
        numbers = tuple(self.dimension(*item, kind) for item, kind in zip(values, kinds_, strict=True))
        self.recipes.setdefault(steps, []).append((name, points, numbers))

    def number_shapes(self) -> None:
        """Give every point of a redrawn body its place behind the points of the drawing."""
        offset = len(self.names)
        for steps, members in self.recipes.items():
            for name, points, _ in members:
                self.redrawn[name] = {p: offset + k for k, p in enumerate(points)}
                for p in points:
                    self.redrawn_at.setdefault(p, []).append(self.redrawn[name])
                offset += len(points)
            self.shapes.append(Shape(steps, tuple(p for _, p, _ in members), tuple(d for _, _, d in members)))

    # -- the same in the plane and in space ---------------------------------------------------------------------

    def add_cable(self, name: str, j: record.Cable) -> None:
        """Write a cable."""
        points = self.at(*j.points)
        given = {} if j.length is None else {"length": self.dimension("length", j.length)}
        self.add(kinds.cable(len(points)), points, given=given)
        self.joint(name, "cable", points, 1)

    def add_relation(self, name: str, data: record.Relation) -> None:
        """Write a linear relation."""
        kind = kinds.relation(len(data.terms))
        given = {f"factor{k + 1}": self.dimension(s, f, Quantity.FACTOR) for k, (s, f) in enumerate(data.terms.items())}
        if data.constant is not None:
            given["constant"] = self.dimension("constant", data.constant, Quantity.NUMBER)
        self.add(kind, (), [self.scalar(s) for s in data.terms], given=given)
        self.joint(name, "relation", (), 1)

    def add_constraint(self, name: str, data: record.Constraint) -> None:
        """Write a constraint of any kind."""
        kind = self.mechanism.kinds[data.kind]
        lengths = {c: Quantity.LENGTH for c in data.constants if _LONG.fullmatch(c)}
        given = {c: self.dimension(c, v, lengths.get(c, Quantity.NUMBER)) for c, v in data.constants.items()}
        points, vectors = self.at(*data.points), tuple(self.vector_index[u] for u in data.vectors)
        scalars = [self.scalar(s) for s in data.scalars]
        if isinstance(kind, RateKind):
            self.slip(kind, points, scalars, vectors, given=given)
            self.joint(name, kind.name, points, 0, vectors)
            return
        self.add(kind, points, scalars, vectors, given=given)
        self.joint(name, kind.name, points, len(kind.rows), vectors)

    def blocks(self) -> tuple[tuple[Block, ...], tuple[tuple[int, int], ...]]:
        """The instances by kind; also where the measure of every mixed coordinate is."""
        out, where = grouped(self.instances)
        return out, tuple(where[id(self.measured[s])] for s in self.scalars)


def grouped(instances: Sequence[Instance]) -> tuple[tuple[Block, ...], dict[int, tuple[int, int]]]:
    """Group instances by kind; also the block and number of every instance, by its identity."""
    groups: dict[Any, list[Instance]] = {}
    for data in instances:
        groups.setdefault(data.kind, []).append(data)
    out, where = [], {}
    for b, (kind, members) in enumerate(groups.items()):
        names = kind.constants
        out.append(
            Block(
                kind=kind,
                points=tuple(d.points for d in members),
                vectors=tuple(d.vectors for d in members),
                scalars=tuple(d.scalars for d in members),
                drawn=tuple(d.drawn for d in members),
                lengths=tuple(
                    (i, names.index(c), *pair) for i, d in enumerate(members) for c, pair in d.lengths.items()
                ),
                given=tuple((i, names.index(c), k) for i, d in enumerate(members) for c, k in d.given.items()),
                owners=tuple(d.owners for d in members),
            )
        )
        for i, d in enumerate(members):
            where[id(d)] = (b, i)
    return tuple(out), where


__all__ = ["COINCIDENT", "Assembler", "Instance", "Segment"]
