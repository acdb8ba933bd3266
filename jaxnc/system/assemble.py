"""From a description to a compiled system: check with names, choose forms, group constraints by kind.

An assembler writes bodies (§3.1, §4.1), joints (§3.2, §4.2) and mixed coordinates (§3.3, §4.3) as instances of kinds.

A segment is a pair of points ``(i, j)`` or, in space, a unit vector ``(~k,)``. Two bodies often share one (a hinge's
axis): its length is then written once. That works best if a body's base is made of the segments that it shares, so
these are preferred as long as they are well conditioned.
"""

import copy
import dataclasses
import functools
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from jaxnc import constraints as kinds
from jaxnc.compiling import on_device
from jaxnc.constraints import Kind, RateKind
from jaxnc.constraints.kind import cross
from jaxnc.doors import door
from jaxnc.errors import InputError, MechanismError, brief
from jaxnc.mechanism import model as record
from jaxnc.mechanism.checks import PARALLEL
from jaxnc.system.design import recipe_formula
from jaxnc.system.identity import Dimension, Owner, Quantity, Thing, addresses, called, names_of
from jaxnc.system.loads import LoadAssembler
from jaxnc.system.precision import WIDE, at_once, chosen, numbers
from jaxnc.system.system import Parameters, System, floats
from jaxnc.system.topology import Block, BodyIndex, JointIndex, MarkerIndex, Segment, Shape, Topology

if TYPE_CHECKING:
    from jaxnc.mechanism import Mechanism

_LENGTH_NAMES = re.compile(r"(length|radius)\d*")  # constants of kinds that are lengths
COINCIDENT = 1e-9  # of the drawing's size: closer points have no direction
_ACROSS = 1e-6  # cosine up to which two directions count as perpendicular
_NEARLY = 2e-3  # below which they are suspiciously nearly so, where a vector was typed in


def compile_mechanism(mechanism: "Mechanism", sparse: bool | None, dtype: str | None) -> System:
    """Turn a description into a system whose freedoms are counted; see `Mechanism.compile`."""
    if not isinstance(sparse, bool | np.bool_ | None):
        raise InputError(
            f"compile(): sparse must be True, False or None, got {brief(sparse)}; a type of numbers goes by name: "
            "compile(dtype='float32')"
        )
    wanted = chosen(dtype)
    with numbers(WIDE), at_once():
        system = door("System.degrees_of_freedom")(assemble(mechanism, sparse))
        if system.topology.extended is not None:
            system = door("System.extended")(system)
        return system.astype(wanted)


def assemble(mechanism: "Mechanism", sparse: bool | None = None) -> System:
    """Compile a description; its ``degrees_of_freedom`` are still zero."""
    forms = PlanarAssembler if mechanism.model.dim == 2 else SpatialAssembler
    assembler = forms(mechanism, sparse)
    system = assembler.system()
    if assembler.lacking:
        topology = dataclasses.replace(system.topology, extended=_extended_topology(mechanism, assembler, sparse))
        return System(topology, system.parameters)
    return system


def _extended_topology(mechanism: "Mechanism", assembler: "Assembler", sparse: bool | None) -> Topology:
    """Give bodies without a full base a vector across the segments that they have."""
    model, frames = copy.deepcopy(mechanism.model), {b.name: b.segments for b in assembler.bodies}
    hidden = []
    for name in assembler.lacking:
        first, second = (assembler.drawn(s) for s in frames[name])
        across = f"{name} across"
        model.vectors[across] = tuple(map(float, np.cross(first, second)))
        body = model.bodies[name]
        body = body if isinstance(body, record.Body) else record.Body(body)
        model.bodies[name] = msgspec.structs.replace(body, vectors=[*body.vectors, across])
        hidden.append(across)
    other = copy.copy(mechanism)
    other.model = model
    return SpatialAssembler(other, sparse, hidden).system().topology


@dataclass
class Instance:
    """A constraint as it is being written; see `jaxnc.system.topology.Block` for the fields."""

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
    noted: tuple[str, str]  # name and type of the joint that is written

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
        self.specs = {name: b if isinstance(b, record.Body) else record.Body(b) for name, b in m.bodies.items()}
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
        for name, body in self.specs.items():
            self.prepare_body(name, body)
        self.number_shapes()
        self.add_bodies()
        for name, angle in m.angles.items():
            self.owner = self.owning(Thing.COORDINATE, name)
            self.add_angle(name, angle)
        for name, distance in m.distances.items():
            self.owner = self.owning(Thing.COORDINATE, name)
            self.add_distance(name, distance)
        for name, joint in m.joints.items():
            self.owner, self.noted = self.owning(Thing.JOINT, name), (name, str(joint.__struct_config__.tag))
            getattr(self, "add_" + self.noted[1].replace(" ", "_"))(joint, f"{joint.noun} {name!r}")
        for name, relation in m.relations.items():
            self.owner, self.noted = self.owning(Thing.RELATION, name), (name, "relation")
            self.add_relation(relation)
        for name, constraint in m.constraints.items():
            self.owner, self.noted = self.owning(Thing.CONSTRAINT, name), (name, constraint.kind)
            self.add_constraint(constraint)
        markers = tuple(self.marker(name, data) for name, data in m.markers.items())
        blocks, measures = self.blocks()
        numbers = LoadAssembler(self)
        loads, self.lacking = numbers.loads(), numbers.lacking
        dimensions, physical, named = self.give_addresses(numbers.entries)
        functions = tuple(dataclasses.replace(f, address=named[f.name]) for f in loads.functions)
        used = {s for i in self.instances if not i.kind.measure for s in i.scalars}
        angles = set(m.angle_names)
        # Where anything counts turns (a gear, a relation, a rolling disc), no angle may be taken modulo a turn.
        counted = any(self.scalar(s) in used for s in angles)
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
                *self.fixed.reshape(-1).tolist(),
                *np.repeat(self.fixed_vectors, self.dim).tolist(),
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
    def add_bodies(self) -> None:
        """Write the rows of all bodies."""

    @abstractmethod
    def add_angle(self, name: str, data: record.Angle) -> None:
        """Write an angle."""

    @abstractmethod
    def advance(self, name: str, ends: tuple[int, int], along: Segment, form: str = "exact") -> None:
        """Write a distance along a direction."""

    @abstractmethod
    def rigid(self, segment: Segment) -> bool:
        """Tell whether a segment belongs to one body, or the ground."""

    @abstractmethod
    def marker(self, name: str, data: record.Marker) -> MarkerIndex:
        """Say what carries a marker."""

    # -- small tools --------------------------------------------------------------------------------------------

    def owning(self, thing: Thing, name: str) -> Owner:
        """The id of something that owns rows."""
        return Owner(thing, self.owners[thing].index(name))

    def text(self, *owners: Owner) -> str:
        """Name a thing that some owners share."""
        return called(self.owners, *owners)

    def body(self, name: str) -> BodyIndex:
        """A body that is written."""
        return next(body for body in self.bodies if body.name == name)

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

    def give_addresses(
        self, physical: Sequence[tuple[Owner | None, str]]
    ) -> tuple[tuple[str, ...], tuple[str, ...], dict[str, str]]:
        """Give explicit dimensions, physical parameters and functions their addresses, no two of them alike."""
        spots = (*self.names, *self.vector_names, *self.model.markers)
        own = [(None, name) for name in (*spots, *(f"{spot}.{axis}" for spot in spots for axis in "xyz"[: self.dim]))]
        given = [(d.owner, d.key) for d in self.explicit]
        functions = {name: (self.owning(Thing.FORCE, name), "") for name in self.mechanism.functions}
        found = iter(addresses(self.owners, (*own, *functions.values(), *given, *physical))[len(own) :])
        named = {name: next(found) for name in functions}
        return tuple(next(found) for _ in given), tuple(found), named

    def segment(self, direction: record.Direction) -> Segment:
        """The segment of a direction given by names."""
        if isinstance(direction, str):
            return (~self.vector_index[direction],)
        return self.pair(direction)

    def drawn(self, segment: Segment) -> np.ndarray:
        """The drawn direction of a segment."""
        if len(segment) == 1:
            return self.vectors[~segment[0]]
        return self.home[segment[1]] - self.home[segment[0]]

    def unit(self, segment: Segment) -> np.ndarray:
        """The drawn direction of a segment, of length one; zero where its points coincide."""
        d = self.drawn(segment)
        return d / (np.linalg.norm(d) or 1.0)

    def called(self, segment: Segment) -> str:
        """Name a segment in messages."""
        if len(segment) == 1:
            return f"vector {self.vector_names[~segment[0]]!r}"
        return f"line {self.names[segment[0]]}-{self.names[segment[1]]}"

    def check_direction(self, direction: record.Direction, what: str) -> Segment:
        """The segment of a direction, refused where its points coincide."""
        segment = self.segment(direction)
        if len(segment) == 2:
            self.direction(segment, what)
        return segment

    def end(self, at: str | None, end: record.Direction, what: str) -> Segment:
        """Where an angle starts or goes to: a point seen from `at`, a pair of points, or a vector."""
        if isinstance(end, str) and end in self.index:
            assert at is not None
            return self.check_direction((at, end), what)
        return self.check_direction(end, what)

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
        removed: int,
        points: Sequence[int] = (),
        vectors: Sequence[int] = (),
        bodies: Sequence[str] = (),
        sides: Sequence[Sequence[int]] = (),
        pressure: int = -1,
        prefix: str = "",
    ) -> None:
        """Note a joint for reports and drawings, and what it holds on each side (see `JointIndex`)."""
        bodies_ = tuple(self.owning(Thing.BODY, body).number for body in bodies)
        held = tuple(tuple(side) for side in sides)
        name, noun = self.noted
        at = tuple(points), removed, tuple(vectors)
        self.joints.append(JointIndex(self.owner, name, prefix + noun, *at, bodies_, held, pressure))

    def radius(self, joint: record.Rolling | record.RackAndPinion | record.RollingDisc) -> dict[str, int]:
        """Note a joint's radius as a dimension, where it is given."""
        return {} if joint.radius is None else {"radius": self.dimension("radius", joint.radius)}

    def radii(self, joint: record.Wheels) -> dict[str, int]:
        """Note the radii of two wheels as dimensions, where they are given."""
        return {f"radius{k + 1}": self.dimension(f"radius{k + 1}", r) for k, r in enumerate(joint.radii or ())}

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
        steps, values = _recipe(name, body, index, self.home[list(points)])
        self.owner = self.owning(Thing.BODY, name)
        of = {key: Quantity.LENGTH for key in body.lengths}
        numbers = tuple(self.dimension(key, value, of.get(key, Quantity.PLACE)) for key, value in values)
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

    def add_distance(self, name: str, data: record.Distance) -> None:
        ends = self.pair((data.start, data.to))
        if data.along is None:
            self.measure(name, kinds.DISTANCE_BETWEEN, ends)
        else:
            self.advance(name, ends, self.end(data.start, data.along, f"distance {name!r}"), data.form)

    def add_cable(self, j: record.Cable, what: str) -> None:
        points = self.at(*j.points)
        given = {} if j.length is None else {"length": self.dimension("length", j.length)}
        self.add(kinds.cable(len(points)), points, given=given)
        self.joint(1, points)

    def add_relation(self, data: record.Relation) -> None:
        kind = kinds.relation(len(data.terms))
        given = {f"factor{k + 1}": self.dimension(s, f, Quantity.FACTOR) for k, (s, f) in enumerate(data.terms.items())}
        if data.constant is not None:
            given["constant"] = self.dimension("constant", data.constant, Quantity.NUMBER)
        self.add(kind, (), [self.scalar(s) for s in data.terms], given=given)
        self.joint(1)

    def add_constraint(self, data: record.Constraint) -> None:
        kind = self.mechanism.kinds[data.kind]
        lengths = {c: Quantity.LENGTH for c in data.constants if _LENGTH_NAMES.fullmatch(c)}
        given = {c: self.dimension(c, v, lengths.get(c, Quantity.NUMBER)) for c, v in data.constants.items()}
        points, vectors = self.at(*data.points), tuple(self.vector_index[u] for u in data.vectors)
        scalars = [self.scalar(s) for s in data.scalars]
        if isinstance(kind, RateKind):
            self.slip(kind, points, scalars, vectors, given=given)
            self.joint(0, points, vectors)
            return
        self.add(kind, points, scalars, vectors, given=given)
        self.joint(len(kind.rows), points, vectors)

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
        alike = "points", "vectors", "scalars", "drawn", "owners"
        fields = {name: tuple(getattr(d, name) for d in members) for name in alike}
        at, every = kind.constants.index, list(enumerate(members))
        lengths = tuple((i, at(c), *pair) for i, d in every for c, pair in d.lengths.items())
        given = tuple((i, at(c), k) for i, d in every for c, k in d.given.items())
        out.append(Block(kind, lengths=lengths, given=given, **fields))
        for i, d in enumerate(members):
            where[id(d)] = (b, i)
    return tuple(out), where


# -- bodies with explicit dimensions -----------------------------------------------------------------------------------


def _recipe(
    name: str, body: record.Body, index: dict[str, int], home: np.ndarray
) -> tuple[tuple, list[tuple[str, float]]]:
    """How a body's points are placed (see `jaxnc.system.design.redraw`), and the named dimensions used, in order."""
    what = f"body {name!r}"
    values: list[tuple[str, float]] = []
    lengths = {}
    for key, value in body.lengths.items():
        p, q = _length_ends(key, index, what)
        if frozenset((p, q)) in lengths:
            raise MechanismError(f"{what}: the length {key} is given twice")
        lengths[frozenset((p, q))] = len(values)
        values.append((key, value))

    base = (0, 1, lengths.pop(frozenset((0, 1)), None))
    if not np.linalg.norm(home[1] - home[0]):
        names = list(index)
        raise MechanismError(
            f"{what}: points {names[0]!r} and {names[1]!r} are drawn at the same place, so they give no direction; "
            f"move one of them"
        )
    steps: list[tuple] = []
    rest, placed = {k: p for p, k in index.items() if k > 1}, {0, 1}
    for p, place in body.local.items():
        k = index[p]
        if any(k in pair for pair in lengths):
            raise MechanismError(f"{what}: point {p!r} has both a local place and a length; give one of them")
        values += [(f"{p}.along", place[0]), (f"{p}.across", place[1])]
        steps.append((k, "local", len(values) - 2, len(values) - 1))
        placed.add(k)
        del rest[k]
    while rest:
        ties = {k: [next(iter(pair - {k})) for pair in lengths if k in pair and (pair - {k}) <= placed] for k in rest}
        k = max(rest, key=lambda k: (len(ties[k]), -k))
        to = sorted(ties[k])
        if len(to) > 2:
            names = list(index)
            raise MechanismError(
                f"{what}: the place of point {rest[k]!r} is fixed by more than two lengths, to "
                f"{', '.join(names[i] for i in to)}; give two"
            )
        numbers = [lengths.pop(frozenset((k, i))) for i in to]
        if len(to) == 1 and not np.linalg.norm(home[k] - home[to[0]]):
            raise MechanismError(f"{what}: length {values[numbers[0]][0]} is given, but its points are drawn together")
        how = ("drawn", "polar", "two")[len(to)]
        steps.append((k, how, *(x for pair in zip(to, numbers, strict=True) for x in pair)))
        placed.add(k)
        del rest[k]
    if lengths:
        key = values[next(iter(lengths.values()))][0]
        raise MechanismError(f"{what}: length {key} is between points whose places are already given; remove it")
    _check_triangles(what, (base, tuple(steps)), values, home)
    return (base, tuple(steps)), values


def _length_ends(key: str, index: dict[str, int], what: str) -> tuple[int, int]:
    p, _, q = key.partition("-")
    if p not in index or q not in index or p == q:
        raise MechanismError(f"{what}: length {key!r} is not between two of its points {list(index)}; write 'B-C'")
    return index[p], index[q]


def _check_triangles(what: str, steps: tuple, values: list[tuple[str, float]], home: np.ndarray) -> None:
    """Refuse lengths with which a body cannot be redrawn, and points whose side is not drawn."""
    if not any(how == "two" for _, how, *_ in steps[1]):
        return
    sizes = [value for _, value in values]
    with np.errstate(all="ignore"):
        at = recipe_formula(steps, *home.shape, len(sizes)).on_lanes([*home.reshape(-1), *map(np.float64, sizes)])
    placed = np.array(at, float).reshape(home.shape)
    for k, how, *data in steps[1]:
        if how != "two":
            continue
        i, a, j, b = data
        d, (ra, rb) = placed[j] - placed[i], (sizes[a], sizes[b])
        span = float(np.linalg.norm(d))
        if not abs(ra - rb) <= span * (1 + 1e-12) <= (ra + rb) * (1 + 2e-12):
            raise MechanismError(
                f"{what}: lengths {values[a][0]} = {ra:g} and {values[b][0]} = {rb:g} violate the triangle inequality, "
                f"the third side is {span:g}; it must lie between {abs(ra - rb):g} and {ra + rb:g}"
            )
        w = home[k] - home[i]
        if len(w) == 3 and np.linalg.norm(w - (w @ d) / span**2 * d) <= 1e-9 * np.linalg.norm(w):
            raise MechanismError(
                f"{what}: a point with two lengths is drawn on the line between the points they start from, so its "
                f"side is not known; draw it on one side"
            )


# -- the plane ---------------------------------------------------------------------------------------------------------


class PlanarAssembler(Assembler):
    """Writes planar bodies, joints and coordinates."""

    def rigid(self, segment: Segment) -> bool:
        ends = set(segment)
        return bool(self.fixed[list(segment)].all()) or any(ends <= set(body.points) for body in self.bodies)

    def add_bodies(self) -> None:
        for name, body in self.specs.items():
            self.add_body(name, body)

    # -- bodies -------------------------------------------------------------------------------------------------

    def base(self, points: tuple[int, ...]) -> tuple[int, int]:
        """The segment that carries a body: its first two points, or the two farthest where those nearly coincide."""
        home = self.home[list(points)]
        gaps = np.linalg.norm(home[:, None] - home[None], axis=-1)
        if gaps[0, 1] >= 0.05 * gaps.max():
            return points[0], points[1]
        i, j = np.unravel_index(int(gaps.argmax()), gaps.shape)
        return points[min(i, j)], points[max(i, j)]

    def add_body(self, name: str, body: record.Body) -> None:
        self.owner = self.owning(Thing.BODY, name)
        points = self.at(*body.points)
        if len(points) == 1:
            line = self.orientation(name, body)
            self.bodies.append(BodyIndex(name, points, () if line is None else (line,)))
            return
        shape = self.redrawn.get(name, {p: p for p in points})
        base = self.pair(body.points[:2]) if name in self.redrawn else self.base(points)
        self.direction(base, f"body {name!r}")
        self.bodies.append(BodyIndex(name, points, (base,)))

        def add(kind: Kind, *at: int) -> None:
            self.add(kind, at, drawn=tuple(shape[p] for p in at))

        add(kinds.DISTANCE, *base)
        rest = [p for p in points if p not in base]
        if body.form == "exact":
            for p in rest:
                add(kinds.ATTACHED, *base, p)
            return
        i, j = base
        off = [abs(cross(self.home[j] - self.home[i], self.home[p] - self.home[i])) for p in rest]
        if not rest or max(off) <= 1e-9 * self.size**2:
            for p in rest:
                add(kinds.PROPORTIONAL, i, j, p)
            return
        third = rest[int(np.argmax(off))]
        add(kinds.DISTANCE, i, third)
        add(kinds.DISTANCE, j, third)
        for p in rest:
            if p != third:
                add(kinds.COMBINATION, i, j, third, p)

    def orientation(self, name: str, body: record.Body) -> tuple[int, int] | None:
        """The line that a body of one point keeps its direction to; None where its point moves along an axis."""
        point = body.points[0]
        if body.along is not None:
            return self.pair(body.along)
        at = self.index[point]
        if self.fixed[at].all():
            raise MechanismError(
                f"body {name!r} has only the ground point {point!r}, so nothing of it moves and its orientation is not "
                f"known: give it a second point, or leave the body out (the ground is no body)"
            )
        if self.fixed[at].any():
            return None
        sliding = [j for j in self.model.joints.values() if isinstance(j, (record.Slot, record.Prismatic))]
        lines = [j.line for j in sliding if (j.point if isinstance(j, record.Slot) else j.on[0]) == point]
        if lines:
            still = (line for line in lines if self.fixed[list(self.at(*line))].all())
            return self.pair(next(still, lines[0]))
        raise MechanismError(
            f"body {name!r} has only the point {point!r}, so its orientation is not known: give it a second point, "
            f"let {point!r} slide in a slot, fix one of its coordinates, or say which line it follows with along="
        )

    def marker(self, name: str, data: record.Marker) -> MarkerIndex:
        body = self.body(data.on)
        base = body.base
        if base is None:
            raise MechanismError(
                f"marker {name!r}: body {data.on!r} has one point and no line to carry a marker; give the body "
                f"along=, or a second point"
            )
        shape = self.redrawn.get(data.on, {})
        drawn = (shape.get(base[0], base[0]), shape.get(base[1], base[1]))
        return MarkerIndex(name, data.on, body.points[0] if len(body.points) == 1 else base[0], (base,), (drawn,))

    # -- coordinates --------------------------------------------------------------------------------------------

    def add_angle(self, name: str, data: record.Angle) -> None:
        what = f"angle {name!r}"
        to = self.end(data.at, data.to, what)
        if data.start is None:
            kind, points = kinds.ANGLE_FROM_X[data.form], to
        else:
            kind, points = kinds.ANGLE[data.form], self.end(data.at, data.start, what) + to
        pairs = [points[i : i + 2] for i in range(0, len(points), 2)]
        lengths = {c: self.length_of(*p) for c, p in zip(kind.constants, pairs, strict=False)}
        if kind.constants:
            for p in pairs:
                self.must_be_rigid(p, f"{what}, form {data.form!r}")
        self.measure(name, kind, points, lengths)

    def advance(self, name: str, ends: tuple[int, int], along: Segment, form: str = "exact") -> None:
        if self.rigid(along):
            self.measure(name, kinds.DISTANCE_ALONG[form], ends + along, {"line": self.length_of(*along)})
            return
        if form != "exact":
            self.must_be_rigid(along, f"distance {name!r}, form {form!r}")
        self.measure(name, kinds.DISTANCE_ALONG_FREE, ends + along, {})

    def must_be_rigid(self, pair: Segment, what: str) -> None:
        """Refuse two points that no body holds together."""
        if not self.rigid(pair):
            a, b = (self.names[i] for i in pair)
            raise MechanismError(
                f"{what}: needs the constant length {a}-{b}, but no body holds both points; use form='exact'"
            )

    # -- joints -------------------------------------------------------------------------------------------------

    def add_revolute(self, j: record.Revolute, what: str) -> None:
        assert j.points is not None
        points = self.at(*j.points)
        self.add(kinds.COINCIDENT, points)
        self.joint(2, points, sides=(points[:1], points[1:]))

    def add_prismatic(self, j: record.Prismatic, what: str) -> None:
        line, on = (self.check_direction(d, what) for d in (j.line, j.on))
        if on[0] not in line:
            self.add(kinds.ALIGNED, (*line, on[0]))
        self.add(kinds.FIXED_ANGLE if j.form == "exact" else kinds.SCALAR_PRODUCT, line + on)
        self.joint(2, line + on, sides=(line, on))

    def add_slot(self, j: record.Slot, what: str) -> None:
        line = self.check_direction(j.line, what)
        points = (*line, self.index[j.point])
        self.add(kinds.ALIGNED, points)
        self.joint(1, points, sides=(line, points[2:]))

    def add_gear(self, j: record.Gear, what: str) -> None:
        ends = [self.measured[angle].points[-2:] for angle in j.angles]
        given = self.radii(j)
        lengths = {} if given else {f"radius{k + 1}": self.length_of(*to) for k, to in enumerate(ends)}
        points = (*ends[0], *ends[1])
        kind = kinds.INTERNAL_GEAR if j.internal else kinds.EXTERNAL_GEAR
        self.add(kind, points, [self.scalar(a) for a in j.angles], lengths=lengths, given=given)
        held, prefix = (points[:1], points[2:3], *ends), "internal " * j.internal
        self.joint(1, points, sides=held, pressure=self.pressure(j.pressure_angle), prefix=prefix)

    def add_rolling(self, j: record.Rolling, what: str) -> None:
        line = self.check_direction(j.line, what)
        start, to = (self.check_direction((j.centre, name), what) for name in (j.contact, j.rim))
        (centre, contact), rim = start, to[1]
        given = self.radius(j)
        if abs(cross(self.home[line[1]] - self.home[line[0]], self.home[centre] - self.home[line[0]])) <= (
            COINCIDENT * self.size**2
        ):
            raise MechanismError(
                f"{what}: centre {j.centre!r} is drawn on the line {j.line[0]}-{j.line[1]}, so the side it rolls on is "
                f"not known; draw it on one side"
            )
        where = (*line, centre, contact)
        if j.form == "exact":
            self.must_be_rigid(line, f"{what}, form 'exact'")
            self.add(kinds.CONTACT, where, lengths={"line": self.length_of(*line)}, given=given)
        else:
            radius = {"length": given["radius"]} if given else {}
            self.add(kinds.DISTANCE, (centre, contact), given=radius)
            self.add(kinds.PERPENDICULAR, (*line, contact, centre))
        self.add(kinds.ALIGNED, (*line, contact))
        if j.form == "exact":
            self.measure(j.angle, kinds.ANGLE["exact"], start + to, {})
            self.advance(j.distance, (line[0], contact), line)
        else:
            self.must_be_rigid(to, f"{what}, form 'text'")
            radii = {"length2": self.length_of(*to)} | ({} if given else {"length1": self.length_of(*start)})
            radius = {"length1": given["radius"]} if given else {}
            self.measure(j.angle, kinds.ANGLE["cosine"], start + to, radii, given=radius)
            across, up = np.abs(self.home[line[1]] - self.home[line[0]])
            self.advance(j.distance, (line[0], contact), line, "x" if across >= up else "y")
        scalars = (self.scalar(j.distance), self.scalar(j.angle))
        self.add(kinds.ROLLING, where, scalars, given=given)
        self.joint(4, (*where, rim), sides=(line, to, (contact,)))

    def add_skate(self, j: record.Skate, what: str) -> None:
        points = (self.index[j.point], *self.check_direction(j.heading, what))
        self.slip(kinds.SKATE, points)
        self.joint(0, points)

    def add_weld(self, j: record.Weld, what: str) -> None:
        first, second = map(self.body, j.bodies)
        for body in (first, second):
            if len(body.points) < 2:
                raise MechanismError(f"{what}: body {body.name!r} has one point; welded bodies need two")
        a, b = first.base, second.base
        assert a is not None and b is not None
        shared = [p for p in second.points if p in first.points]
        if len(shared) > 1:
            return
        if not shared:
            self.add(kinds.ATTACHED, (*a, b[0]))
        self.add(kinds.FIXED_ANGLE, a + b)
        self.joint(1 if shared else 3, a + b, bodies=j.bodies, sides=(first.points, second.points))


# -- space -------------------------------------------------------------------------------------------------------------


class SpatialAssembler(Assembler):
    """Writes spatial bodies, joints and coordinates; knows which distances and angles rows make constant."""

    def __init__(self, mechanism, sparse=None, hidden=()):
        super().__init__(mechanism, sparse, hidden)
        ground = {i for i, fixed in enumerate(self.fixed) if fixed.all()}
        ground |= {~k for k, fixed in enumerate(self.fixed_vectors) if fixed}
        self.rigid_sets: list[frozenset[int]] = [frozenset(ground)]
        self.members: dict[str, frozenset[int]] = {}

    # -- segments -----------------------------------------------------------------------------------------------

    def write(self, make, segments, first: tuple[int, ...] = (), **more):
        """Write an instance of a kind over directions, whose own points come first."""
        forms = "".join("v" if len(s) == 1 else "p" for s in segments)
        points = (*first, *(i for s in segments if len(s) == 2 for i in s))
        vectors = tuple(~s[0] for s in segments if len(s) == 1)
        drawn = (*first, *(i for s in segments if len(s) == 2 for i in self.length_of(*s)))
        kind = make(forms)
        if kind.scalars and "scalars" not in more:
            raise AssertionError(f"kind {kind.name!r} wants scalars")
        return self.add(kind, points, vectors=vectors, drawn=drawn, **more)

    def constant(self, *segments: Segment) -> bool:
        """Tell whether rows written before make the lengths and the angle of these segments constant."""
        items = {i for s in segments for i in s}
        return any(items <= known for known in self.rigid_sets)

    def rigid(self, segment: Segment) -> bool:
        return self.constant(segment) or any(set(segment) <= body for body in self.members.values())

    def across_constant(self, axis: Segment, direction: Segment) -> bool:
        """Tell whether a body (or the ground) holds a direction together with the axis, or a line drawn along it."""
        known = self.rigid_sets[0], *self.members.values()
        return any(set(direction) <= body and (set(axis) <= body or self.spans(body, axis)) for body in known)

    def spans(self, items: Iterable[int], axis: Segment, whole: bool = False) -> bool:
        """Tell whether some items have a vector or two points along a drawn axis; with `whole`, whether they fix it."""
        vectors: list[Segment] = [(i,) for i in items if i < 0]
        found = [self.drawn(s) for s in (*vectors, *combinations([i for i in items if i >= 0], 2))]
        units = [d / np.linalg.norm(d) for d in found if np.linalg.norm(d) > COINCIDENT * self.size]
        along = self.unit(axis)
        if whole and np.linalg.matrix_rank(np.array(units).reshape(-1, 3), tol=_NEARLY) > 1:
            return True
        return any(np.linalg.norm(np.cross(d, along)) < _NEARLY for d in units)

    # -- bodies -------------------------------------------------------------------------------------------------

    def add_bodies(self) -> None:
        for name, body in self.specs.items():
            items = (*self.at(*body.points), *(~self.vector_index[u] for u in body.vectors))
            self.members[name] = frozenset(items)

        def beyond_base(name: str) -> int:
            others = [s for n, s in self.members.items() if n != name] + [self.rigid_sets[0]]
            shared = sum(item < 0 and any(item in other for other in others) for item in self.members[name])
            return -max(shared - 2, 0)

        # Bodies that share more axes than their base can hold come first: what they fix need not be written again.
        found = {name: self.add_body(name, self.specs[name]) for name in sorted(self.specs, key=beyond_base)}
        self.bodies.extend(found[name] for name in self.specs)
        held = frozenset().union(self.rigid_sets[0], *self.members.values())
        for k in range(len(self.vector_names)):
            if ~k not in held:  # of no body: no other row gives it its length
                self.add(kinds.UNIT, (), vectors=(k,), owner=Owner(Thing.VECTOR, k))

    def add_body(self, name: str, body: record.Body) -> BodyIndex:
        self.owner = self.owning(Thing.BODY, name)
        points = self.at(*body.points)
        vectors = tuple(self.vector_index[u] for u in body.vectors)
        base = self.base(name, points, vectors, body.form)
        for segment in base:
            if not self.constant(segment):
                if len(segment) == 1:
                    self.add(kinds.UNIT, (), vectors=(~segment[0],))
                else:
                    self.add(kinds.DISTANCE, segment, drawn=self.length_of(*segment))
        third = self.third(points, vectors, base) if body.form == "text" else None
        if third is not None and not self.constant(third):
            self.add(kinds.DISTANCE, third, drawn=self.length_of(*third))  # (99) instead of a scalar product
            self.rigid_sets.append(frozenset(points))
        for pair in combinations(base, 2):
            if not self.constant(*pair):
                # Segments before vectors, and in order: the same product in two bodies is written once.
                self.write(kinds.product, sorted(pair, key=lambda s: (-len(s), s)))
        if len(base) == 3:
            self.write(kinds.handed, base)
        make = {1: kinds.collinear, 2: kinds.carried, 3: kinds.combined}[len(base)]
        if len(base) == 2 and body.form == "text" and len(points) + len(vectors) > 2:
            make = kinds.coplanar
        for segment in self.rest(points, vectors, base):
            if not self.constant(segment, *base):
                across = len(segment) == 1 and self.vector_names[~segment[0]] in self.hidden
                self.write(kinds.carried if across and len(base) == 2 else make, (*base, segment))
        self.rigid_sets.append(self.members[name])
        return BodyIndex(name, points, base[:2], vectors)

    def third(self, points: tuple[int, ...], vectors: tuple[int, ...], base: tuple[Segment, ...]) -> Segment | None:
        """The side of a triangle of points that its base leaves out; None for every other body."""
        if len(points) != 3 or len(base) != 2 or any(self.vector_names[k] not in self.hidden for k in vectors):
            return None
        return next(s for s in combinations(points, 2) if s not in base and s[::-1] not in base)

    def rest(self, points: tuple[int, ...], vectors: tuple[int, ...], base: tuple[Segment, ...]) -> list[Segment]:
        """Segments that tie what the base does not hold to it: one for each point and vector."""
        group = {p: p for p in points}

        def root(p: int) -> int:
            while group[p] != p:
                p = group[p]
            return p

        for segment in base:
            if len(segment) == 2:
                group[root(segment[1])] = root(segment[0])
        tied: list[Segment] = []
        for p in points[1:]:
            if root(p) != root(points[0]):
                tied.append((points[0], p))
                group[root(p)] = root(points[0])
        return tied + [(~k,) for k in vectors if (~k,) not in base]

    def base(
        self, name: str, points: tuple[int, ...], vectors: tuple[int, ...], form: str = "exact"
    ) -> tuple[Segment, ...]:
        """The segments that carry a body: as many as it has independent directions, at most two, three in text form."""
        pairs = [(i, j) for i, j in combinations(points, 2)]
        span = max((float(np.linalg.norm(self.drawn(s))) for s in pairs), default=0.0)
        pairs = [s for s in pairs if np.linalg.norm(self.drawn(s)) > COINCIDENT * self.size]
        candidates: list[Segment] = [(~k,) for k in vectors if self.vector_names[k] not in self.hidden] + pairs
        if not candidates:
            names = ", ".join(self.names[i] for i in points)
            raise MechanismError(f"body {name!r}: its points {names} are drawn at the same place; move one of them")
        sizes = [1.0 if len(s) == 1 else float(np.linalg.norm(self.drawn(s))) / span for s in candidates]
        units = np.array([self.unit(s) for s in candidates])
        shared = [self.count_shared(name, s) for s in candidates]
        area = np.linalg.norm(np.cross(units[:, None], units[None]), axis=-1)
        if area.max() <= PARALLEL:
            best = max(range(len(candidates)), key=lambda i: (len(candidates[i]) == 1, shared[i], sizes[i]))
            return (candidates[best],)
        quality = area * np.outer(sizes, sizes)
        limit = _NEARLY if vectors else 1e-5  # of points no less is suspicious
        if quality.max() < limit:
            i, j = np.unravel_index(int(area.argmax()), area.shape)
            degrees = np.degrees(np.arcsin(min(float(area[i, j]), 1.0)))
            raise MechanismError(
                f"body {name!r}: all its points and vectors are drawn nearly in one line ({self.called(candidates[i])} "
                f"and {self.called(candidates[j])} at {degrees:.2g}°), so its rotation about it is badly determined. "
                f"Draw them exactly in line if it is a bar that need not know it, or give it a point or vector "
                f"across the line"
            )
        # Two segments without a common point count half: all others are carried by four points then, not by three.
        apart = [[len({*s, *t}) == 4 for t in candidates] for s in candidates]
        chosen = self.best(2, quality * np.where(apart, 0.5, 1.0), shared)
        if form == "text":
            volume = np.abs(np.einsum("ia,jka->ijk", units, np.cross(units[:, None], units[None])))
            volume = volume * np.einsum("i,j,k->ijk", sizes, sizes, sizes)
            if volume.max() > PARALLEL:
                if volume.max() < 1e-3:  # a smaller volume makes the text's form badly conditioned
                    raise MechanismError(
                        f"body {name!r}: its points and vectors are drawn nearly in one plane, where the base of three "
                        f"segments of form='text' is badly conditioned; draw them in the plane, or use form='exact'"
                    )
                chosen = self.best(3, volume, shared)
        return tuple(candidates[i] for i in chosen)

    def count_shared(self, name: str, segment: Segment) -> int:
        """Count 1 for a segment that belongs to another body or the ground as well, else 0."""
        others = (s for n, s in self.members.items() if n != name)
        return int(self.constant(segment) or any(set(segment) <= other for other in others))

    @staticmethod
    def best(count: int, quality: np.ndarray, shared: list[int]) -> tuple[int, ...]:
        """The well-conditioned choice with most shared segments; the best-conditioned one if there is none."""
        enough = 0.2  # from which a base counts as well conditioned
        good = enough if count == 2 else enough / 2

        def score(chosen: tuple[int, ...]):
            q = float(quality[chosen])
            return (q >= good, sum(shared[i] for i in chosen) if q >= good else 0, round(q, 9))

        return max(combinations(range(len(shared)), count), key=score)

    # -- markers ------------------------------------------------------------------------------------------------

    def marker(self, name: str, data: record.Marker) -> MarkerIndex:
        body = self.body(data.on)
        origin = body.points[0]
        given = np.array(data.direction if data.at is None else data.at, dtype=float)
        if data.at is not None:
            given = given - self.home[origin]
        if len(body.segments) == 1:
            off = np.linalg.norm(np.cross(given, self.unit(body.segments[0])))
            if off > 1e-9 * max(self.size, 1.0):
                raise MechanismError(
                    f"marker {name!r}: body {data.on!r} is a bar that does not know its rotation about its own line, "
                    f"and the marker is off that line; give the body a point or vector across it"
                )
        where = tuple(s if len(s) == 1 else self.length_of(*s) for s in body.segments)
        return MarkerIndex(name, data.on, origin, body.segments, where, data.at is None)

    # -- checks -------------------------------------------------------------------------------------------------

    def sine(self, a: Segment, b: Segment) -> float:
        """Sine of the drawn angle between two segments."""
        d, e = self.drawn(a), self.drawn(b)
        return float(np.linalg.norm(np.cross(d, e)) / (np.linalg.norm(d) * np.linalg.norm(e)))

    def refuse_along(self, axis: Segment, direction: Segment, what: str) -> None:
        """Refuse a direction along an axis, about which it shows no angle."""
        if self.sine(axis, direction) < 1e-6:  # such a direction has no projection across the axis
            raise MechanismError(
                f"{what}: the {self.called(direction)} is drawn along the axis, the {self.called(axis)}, so it shows "
                f"no rotation about it; choose a direction across the axis"
            )

    def line(self, line: record.Pair, what: str) -> tuple[int, Segment]:
        """Point and direction of a line given as point and vector, or as two points."""
        point = self.index[line[0]]
        if line[1] in self.vector_index:
            return point, (~self.vector_index[line[1]],)
        return point, self.check_direction(line, what)

    def note(self, removed: int, points: Sequence[int], segments: Sequence[Segment], sides=(), **more: Any) -> None:
        """Note a joint over directions for reports and drawings."""
        at = (*points, *(i for s in segments if len(s) == 2 for i in s))
        vectors = tuple(~s[0] for s in segments if len(s) == 1)
        self.joint(removed, tuple(dict.fromkeys(at)), vectors, sides=sides, **more)

    # -- coordinates --------------------------------------------------------------------------------------------

    def add_angle(self, name: str, data: record.Angle) -> None:
        what = f"angle {name!r}"
        assert data.about is not None
        axis, to = self.check_direction(data.about, what), self.end(data.at, data.to, what)
        self.refuse_along(axis, to, what)
        if data.start is not None:
            start = self.end(data.at, data.start, what)
            self.refuse_along(axis, start, what)
            self.turn(name, axis, start, to, data.form)
            return
        if not set(axis) <= self.rigid_sets[0]:
            raise MechanismError(
                f"{what}: its axis moves, so say from which direction it counts: start=, a vector, a point or two "
                f"points"
            )
        if data.form != "exact":
            raise MechanismError(f"{what}: form={data.form!r} needs a direction to start from; give start=")
        self.measured_write(kinds.angle_from_drawing, name, (axis, to))

    def turn(self, name: str, axis: Segment, start: Segment, to: Segment, form: str = "exact") -> None:
        """Write an angle about an axis."""
        if form != "exact":
            for segment in (start, to):
                if not self.rigid(segment):
                    raise MechanismError(
                        f"angle {name!r}, form {form!r}: needs a constant length of the {self.called(segment)}, but no "
                        f"body holds both points; use form='exact'"
                    )
                if not self.across_constant(axis, segment):
                    raise MechanismError(
                        f"angle {name!r}, form {form!r}: needs a constant angle between the {self.called(segment)} and "
                        f"the axis, the {self.called(axis)}, but no body holds both; use form='exact'"
                    )
        self.measured_write(functools.partial(kinds.angle_about, form), name, (axis, start, to))

    def measured_write(self, make, name: str, segments) -> None:
        """Write the row of a mixed coordinate over directions."""
        data = self.write(make, segments, scalars=(self.scalar(name),))
        assert data is not None
        self.measured[name] = data

    def advance(self, name: str, ends: tuple[int, int], along: Segment, form: str = "exact") -> None:
        vectors = (~along[0],) if len(along) == 1 else ()
        points = ends if vectors else (*ends, *along)
        kind = kinds.distance_along(form, "v" if vectors else "p")
        self.measure(name, kind, points, owner=self.owner, vectors=vectors)

    # -- joints -------------------------------------------------------------------------------------------------

    def together(self, points: record.Pair | None) -> int:
        """Write that two points coincide; how many freedoms that removes."""
        if points is None:
            return 0
        self.add(kinds.COINCIDENT_IN_SPACE, self.at(*points))
        return 3

    def parallel(self, a: Segment, b: Segment) -> int:
        """Write that two directions stay parallel; how many freedoms that removes."""
        if a == b:
            return 0
        for segment in (a, b):
            self.refuse_loose(segment, f"joint {self.noted[0]!r}")
        self.write(kinds.parallel, (a, b))
        return 2

    def refuse_loose(self, segment: Segment, what: str) -> None:
        """Refuse a direction between points of different bodies."""
        if len(segment) == 2 and not self.rigid(segment):
            raise MechanismError(
                f"{what}: no body holds both points of the {self.called(segment)}, so it is not a direction of a body; "
                f"name a vector, or two points of one body"
            )

    def shares(self, what: str, on: str, axis: Segment, noun: str) -> None:
        """Refuse a point whose body does not share the axis that it slides along."""
        p, known = self.index[on], (self.rigid_sets[0], *self.members.values())
        mine = [body for body in known if p in body]
        others = [body for body in known if set(axis) <= body]
        if mine and not any(
            set(axis) <= body or self.spans(body & other, axis, whole=True) for body in mine for other in others
        ):
            example = self.vector_names[~axis[0]] if len(axis) == 1 else "u"
            only = "use slot()" if noun == "axis" else f"give the plane's own normal, on=({on!r}, {example!r})"
            raise MechanismError(
                f"{what}: the body of point {on!r} does not share the {noun}, the {self.called(axis)}; give the body "
                f"that vector, or say which direction of its own is along it, on=({on!r}, {example + '2'!r}); if the "
                f"point alone stays there and its body may tilt, {only}"
            )

    def slide(self, what: str, line: record.Pair, on: str | record.Pair) -> tuple[int, Segment, int, int]:
        """Write that a point or line slides along a line: its point and direction, what slides, freedoms removed."""
        point, axis = self.line(line, what)
        removed = 0
        other, second = (self.index[on], None) if isinstance(on, str) else self.line(on, what)
        if second is None and self.noted[1] != "slot":
            self.shares(what, str(on), axis, "axis")
        ends = (point, *(axis if len(axis) == 2 else ()))
        sliding = [other]
        if second is not None and len(second) == 2 and len(axis) == 2:
            sliding.append(second[1])
        for p in sliding:
            if p not in ends:
                self.write(_aligned_segment, ((point, p), axis))
                removed += 2
        if second is not None and len(sliding) == 1:
            removed += self.parallel(second, axis)
        return point, axis, other, removed

    def sliding(self, on: str | record.Pair, axis: Segment) -> tuple[int, ...]:
        """List what holds a sliding body: its point, and its own line or the axis that it shares."""
        if isinstance(on, str):
            return (self.index[on], *axis)
        point, own = self.line(on, "")
        return (point, *own)

    def hinge_sides(self, points: Sequence[str] | None, one: Segment, other: Segment) -> tuple[tuple[int, ...], ...]:
        """List what holds either body of a joint about axes: an axis may be a neighbour's, too, so its point counts.

        Points may be named in the other order than axes.
        """
        at, held = self.at(*(points or ())), [self.rigid_sets[0], *self.members.values()]
        for first, last in ((at[:1], at[-1:]), (at[-1:], at[:1])):
            sides = (*first, *one), (*last, *other)
            if all(any({*side} <= items for items in held) for side in sides):
                return sides
        return one, other

    def add_spherical(self, j: record.Spherical, what: str) -> None:
        points = self.at(*j.points)
        self.note(self.together(j.points), points, (), (points[:1], points[1:]))

    def add_revolute(self, j: record.Revolute, what: str) -> None:
        assert j.axes is not None
        a, b = (self.check_direction(axis, what) for axis in j.axes)
        removed = self.together(j.points) + self.parallel(a, b)
        self.note(removed, self.at(*(j.points or ())), (a, b), self.hinge_sides(j.points, a, b))

    def add_cylindrical(self, j: record.Cylindrical, what: str) -> None:
        point, axis, other, removed = self.slide(what, j.line, j.on)
        self.note(removed, (point, other), (axis,), ((point, *axis), self.sliding(j.on, axis)))

    def add_prismatic(self, j: record.Prismatic, what: str) -> None:
        point, axis, other, removed = self.slide(what, j.line, j.on)
        assert j.directions is not None
        a, b = (self.check_direction(d, what) for d in j.directions)
        for d in (a, b):
            self.refuse_along(axis, d, what)
        if j.form == "exact":
            self.write(kinds.no_turn, (axis, a, b))
        else:
            if self.sine(a, b) < 1e-3:
                raise MechanismError(
                    f"{what}: the {self.called(a)} and the {self.called(b)} are drawn parallel, where the scalar "
                    f"product of form='text' does not hold them (erratum 9); use form='exact', or directions at an "
                    f"angle"
                )
            for d in (a, b):
                self.refuse_loose(d, what)
            self.write(kinds.product, (a, b))
        held = (point, *axis, *a), (*self.sliding(j.on, axis), *b)
        self.note(removed + 1, (point, other), (axis, a, b), held)

    def add_slot(self, j: record.Slot, what: str) -> None:
        point, axis, other, removed = self.slide(what, j.line, j.point)
        self.note(removed, (point, other), (axis,), ((point, *axis), (other,)))

    def add_universal(self, j: record.Universal, what: str) -> None:
        a, b = (self.check_direction(axis, what) for axis in j.axes)
        if self.sine(a, b) < 0.1:
            raise MechanismError(
                f"{what}: the arms of its cross, the {self.called(a)} and the {self.called(b)}, are drawn nearly "
                f"parallel; draw them across each other (a Cardan joint has them perpendicular)"
            )
        for arm in (a, b):
            self.refuse_loose(arm, what)
        removed = self.together(j.points)
        self.write(kinds.product, (a, b))
        self.note(removed + 1, self.at(*(j.points or ())), (a, b), self.hinge_sides(j.points, a, b))

    def add_screw(self, j: record.Screw, what: str) -> None:
        point, axis, other, removed = self.slide(what, j.line, j.on)
        a, b = (self.check_direction(d, what) for d in j.directions)
        for d in (a, b):
            self.refuse_along(axis, d, what)
        self.turn(j.angle, axis, a, b)
        self.advance(j.distance, (point, other), axis)
        per, value = ("pitch", j.pitch) if j.lead is None else ("lead", j.lead)
        assert value is not None
        given = {per: self.dimension(per, value, Quantity.PLACE)}
        self.add(kinds.SCREW[per], (), (self.scalar(j.distance), self.scalar(j.angle)), given=given)
        held = (point, *axis, *a), (*self.sliding(j.on, axis), *b)
        self.note(removed + 1, (point, other), (axis, a, b), held)

    def add_planar(self, j: record.Planar, what: str) -> None:
        point, normal = self.line(j.plane, what)
        other, second = (self.index[j.on], normal) if isinstance(j.on, str) else self.line(j.on, what)
        if isinstance(j.on, str):
            self.shares(what, j.on, normal, "normal")
        self.write(kinds.product, ((point, other), normal))
        removed = 1 + self.parallel(second, normal)
        self.note(removed, (point, other), (normal,), ((point, *normal), (other, *second)))

    def add_bevel_gear(self, j: record.BevelGear, what: str) -> None:
        axes, centres, rims, ends = [], [], [], []
        for k, angle in enumerate(j.angles):
            data = self.model.angles[angle]
            assert data.about is not None
            axes.append(self.segment(data.about))
            to = self.end(data.at, data.to, what)
            if data.at is None and len(to) == 1:
                raise MechanismError(
                    f"{what}: angle {angle!r} goes to a vector and has no at=, so the wheel's centre is not known; "
                    f"give the angle at=, a point of the wheel's axis"
                )
            ends.append(to)
            centre = to[0] if data.at is None else self.index[data.at]
            rim = to[1] if len(to) == 2 else centre
            if rim == centre and j.radii is None:
                raise MechanismError(f"{what}: wheel {k + 1} has no rim point to read its radius from; give radii=")
            centres.append(centre)
            rims += [centre, rim]
        given = self.radii(j)
        scalars = [self.scalar(a) for a in j.angles]
        self.write(lambda forms: kinds.bevel(forms, j.internal), axes, (*centres, *rims), scalars=scalars, given=given)
        held = (*((centre, *axis) for centre, axis in zip(centres, axes, strict=True)), *ends)
        self.note(1, rims, axes, held, pressure=self.pressure(j.pressure_angle), prefix="internal " * j.internal)

    def add_rack_and_pinion(self, j: record.RackAndPinion, what: str) -> None:
        angle, distance = self.model.angles[j.angle], self.model.distances[j.distance]
        if distance.along is None:
            raise MechanismError(f"{what}: distance {j.distance!r} has no direction; give it along=, the rack's line")
        assert angle.about is not None
        axis, to = self.segment(angle.about), self.end(angle.at, angle.to, what)
        centre = self.index[angle.at] if angle.at is not None else to[0] if len(to) == 2 else None
        if centre is None:
            raise MechanismError(f"{what}: angle {j.angle!r} has no at=, so the pinion's centre is not known; give it")
        start, end = self.index[distance.start], self.index[distance.to]
        along = self.end(distance.start, distance.along, what)
        self.perpendicular(axis, along, what, "the pinion's axis", "the rack's line")
        # The distance may be counted from anywhere, also from the pinion's centre: its end is on the rack.
        ways = ((p, self.home[p] - self.home[centre]) for p in (end, start))
        off = [p for p, w in ways if np.linalg.norm(w - (w @ self.unit(along)) * self.unit(along)) > 1e-6 * self.size]
        if j.radius is None and not off:
            raise MechanismError(
                f"{what}: the pinion's centre is drawn on the rack's line, so its radius is not known; give radius="
            )
        places, given = (centre, *off[:1], end)[:2], self.radius(j)
        scalars = (self.scalar(j.distance), self.scalar(j.angle))
        self.write(lambda forms: kinds.rack(forms, False), (axis, along), places, scalars=scalars, given=given)
        held, pressure = ((centre, *axis), (start, *along), to), self.pressure(j.pressure_angle)
        self.note(1, (centre, start), (axis, along), held, pressure=pressure)

    def perpendicular(self, a: Segment, b: Segment, what: str, noun: str, other: str) -> None:
        """Refuse two directions that are not drawn perpendicular."""
        d, e = self.drawn(a), self.drawn(b)
        cosine = float(d @ e / (np.linalg.norm(d) * np.linalg.norm(e)))
        if abs(cosine) > _ACROSS:
            degrees = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
            raise MechanismError(
                f"{what}: {noun}, the {self.called(a)}, must be perpendicular to {other}, the {self.called(b)}, but is "
                f"drawn at {degrees:.4g}° to it; draw it across"
            )

    def add_constant_velocity(self, j: record.ConstantVelocity, what: str) -> None:
        axes = [self.check_direction(a, what) for a in j.axes]
        marks = [self.check_direction(a, what) for a in j.marks]
        for axis, mark in zip(axes, marks, strict=True):
            self.refuse_along(axis, mark, what)
        if float(self.drawn(axes[0]) @ self.drawn(axes[1])) <= 0.0:
            raise MechanismError(
                f"{what}: its axes, the {self.called(axes[0])} and the {self.called(axes[1])}, are drawn at 90° or "
                f"more; let both point the same way along the drive line"
            )
        removed = self.together(j.points)
        self.write(kinds.constant_velocity, (axes[0], marks[0], axes[1], marks[1]))
        held = self.hinge_sides(j.points, *((*axis, *mark) for axis, mark in zip(axes, marks, strict=True)))
        self.note(removed + 1, self.at(*(j.points or ())), (*axes, *marks), held)

    def add_rolling(self, j: record.Rolling, what: str) -> None:
        start, line = self.line(j.line, what)
        centre, rim, contact = self.at(j.centre, j.rim, j.contact)
        assert j.axis is not None
        axis = self.check_direction(j.axis, what)
        self.perpendicular(axis, line, what, "the disc's axis", "the line")
        for pair in ((centre, contact), (centre, rim)):
            self.direction(pair, what)
            self.refuse_along(axis, pair, what)
        given = self.radius(j)
        self.write(kinds.contact, (line, axis), (centre, contact), given=given)
        if contact not in (start, *line):
            self.write(_aligned_segment, ((start, contact), line))
        self.turn(j.angle, axis, (centre, contact), (centre, rim))
        self.advance(j.distance, (start, contact), line)
        scalars = (self.scalar(j.distance), self.scalar(j.angle))
        self.write(lambda forms: kinds.rack(forms, True), (axis, line), (centre, contact), scalars=scalars, given=given)
        held = (start, *line), (centre, rim), (contact,)
        self.note(6, (start, centre, contact, rim), (line, axis), held)

    def add_rolling_disc(self, j: record.RollingDisc, what: str) -> None:
        points = (self.index[j.centre], self.index[j.plane[0]])
        axis, mark, normal = (self.vector_index[u] for u in (j.axis, j.mark, j.plane[1]))
        if not any({axis, mark} <= set(b.vectors) and points[0] in b.points for b in self.bodies):
            raise MechanismError(
                f"{what}: no body has the point {j.centre!r} and the vectors {j.axis!r} and {j.mark!r} together; give "
                f"them to the disc's body"
            )
        self.refuse_along((~axis,), (~mark,), what)
        n = self.vectors[normal]
        height = float((self.home[points[0]] - self.home[points[1]]) @ n)
        if height <= COINCIDENT * self.size:
            raise MechanismError(
                f"{what}: its centre {j.centre!r} is drawn {-height:.4g} below the plane; draw it on the side that the "
                f"normal {j.plane[1]!r} points to"
            )
        if np.linalg.norm(np.cross(self.vectors[axis], n)) < _ACROSS:
            raise MechanismError(f"{what} is drawn flat on the plane, so it has no point of contact; draw it upright")
        given = self.radius(j)
        self.add(kinds.TOUCHING, points, vectors=(axis, normal), given=given)
        self.slip(kinds.ROLLING_DISC, points, (), (axis, mark, normal), given=given)
        self.note(1, points, ((~axis,), (~normal,)))

    def add_weld(self, j: record.Weld, what: str) -> None:
        first, second = map(self.body, j.bodies)
        for body in (first, second):
            if len(body.segments) < 2:
                raise MechanismError(
                    f"{what}: body {body.name!r} is a bar that does not know its rotation about its own line; "
                    f"give it a point or vector across it"
                )
        held = self.members[first.name]
        needed = dict.fromkeys(i for s in second.segments for i in s)
        points = [i for i in needed if i >= 0] or [second.points[0]]
        shared = [i for i in second.points if i in held]
        anchor = shared[0] if shared else points[0]
        free = [i for i in dict.fromkeys((anchor, *points)) if i not in held]
        for segment in (*((first.points[0], p) for p in free), *((k,) for k in needed if k < 0 and k not in held)):
            self.write(kinds.carried, (*first.segments, segment))
        held = self.members[first.name], self.members[second.name]
        ends = *first.segments, *second.segments
        self.note(3 if shared else 6, (first.points[0], anchor), ends, held, bodies=j.bodies)


def _aligned_segment(forms: str) -> Kind:
    """The kind for a segment (always two points) along a direction."""
    return kinds.aligned(forms[1])
