"""From a description to a compiled system: check with names, choose forms, group constraints by kind."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc import constraints as kinds
from jaxnc.constraints import Kind
from jaxnc.errors import JaxncError, MechanismError
from jaxnc.mechanism import model as record
from jaxnc.system.recipe import recipe
from jaxnc.system.system import Parameters, System
from jaxnc.system.topology import Block, BodyIndex, JointIndex, MarkerIndex, Shape, Topology

if TYPE_CHECKING:
    from jaxnc.mechanism import Mechanism

_COINCIDENT = 1e-9  # of the drawing's size: closer points have no direction


@dataclass
class _Instance:
    kind: Kind
    points: tuple[int, ...]
    scalars: tuple[int, ...]
    owner: str
    drawn: tuple[int, ...]
    lengths: dict[str, tuple[int, int]] = field(default_factory=dict)
    given: dict[str, int] = field(default_factory=dict)


def assemble(mechanism: "Mechanism") -> System:
    """Compile a description, all but its degrees of freedom.

    Args:
        mechanism: the description.

    Returns:
        A system whose ``degrees_of_freedom`` is still zero.

    Raises:
        MechanismError: see `Mechanism.compile`.
        JaxncError: when 64-bit numbers are off.
    """
    if not jax.config.read("jax_enable_x64"):
        raise JaxncError(
            "jaxnc needs 64-bit numbers, and JAX has them switched off: write "
            'jax.config.update("jax_enable_x64", True) before the first computation, or set JAX_ENABLE_X64=1'
        )
    return _Assembler(mechanism).system()


class _Assembler:
    def __init__(self, mechanism: "Mechanism"):
        self.mechanism, self.model = mechanism, mechanism.model
        m = self.model
        self.names = mechanism.all_points
        if not self.names:
            raise MechanismError(f"{m.name!r} has no points; add some with ground() and point()")
        self.index = {name: i for i, name in enumerate(self.names)}
        specs = [p if isinstance(p, record.Point) else record.Point(p) for p in m.points.values()]
        self.home = np.array([*m.ground.values(), *(p.at for p in specs)], dtype=float)
        fixed = ["xy"] * len(m.ground) + [p.fixed for p in specs]
        self.fixed = np.array([[axis in f for axis in "xy"] for f in fixed])
        self.size = float(np.linalg.norm(np.ptp(self.home, axis=0))) or 1.0
        self.scalars = mechanism.scalar_names
        self.first_scalar = 2 * len(self.names)
        self.instances: list[_Instance] = []
        self.seen: dict[tuple, _Instance] = {}
        self.measured: dict[str, _Instance] = {}
        self.dimensions: dict[str, float] = {}
        self.redrawn: dict[str, dict[int, int]] = {}
        self.shapes: list[Shape] = []
        self.bodies: list[BodyIndex] = []
        self.joints: list[JointIndex] = []
        self.recipes: dict[tuple, list[tuple[str, tuple[int, ...], tuple[int, ...]]]] = {}

    def system(self) -> System:
        m = self.model
        specs = {name: b if isinstance(b, record.Body) else record.Body(b) for name, b in m.bodies.items()}
        for name, body in specs.items():
            self.prepare_body(name, body)
        self.number_shapes()
        for name, body in specs.items():
            self.add_body(name, body)
        for name, angle in m.angles.items():
            self.add_angle(name, angle)
        for name, distance in m.distances.items():
            self.add_distance(name, distance)
        for name, joint in m.joints.items():
            getattr(self, "add_" + type(joint).__name__.lower())(name, joint)
        for name, relation in m.relations.items():
            self.add_relation(name, relation)
        for name, constraint in m.constraints.items():
            self.add_constraint(name, constraint)
        markers = tuple(self.marker(name, data, specs) for name, data in m.markers.items())
        blocks, measures = self.blocks()
        used = {s for i in self.instances if not i.kind.measure for s in i.scalars}
        angles = {*m.angles, *(j.angle for j in m.joints.values() if isinstance(j, record.Rolling))}
        # Where anything counts turns (a gear, a relation, a rolling disc), no angle may be taken modulo a turn.
        counted = any(
            i in used for s, i in zip(self.scalars, range(self.first_scalar, 10**9), strict=False) if s in angles
        )
        topology = Topology(
            name=m.name,
            dim=2,
            points=self.names,
            vectors=(),
            scalars=self.scalars,
            angles=tuple(s in angles for s in self.scalars),
            periodic=tuple(s in angles and not counted for s in self.scalars),
            measures=measures,
            fixed=(*map(bool, self.fixed.reshape(-1)), *(False for _ in self.scalars)),
            blocks=blocks,
            shapes=tuple(self.shapes),
            bodies=tuple(self.bodies),
            markers=markers,
            joints=tuple(self.joints),
            dimensions=tuple(self.dimensions),
            length_unit=m.units.length,
            angle_unit=m.units.angle,
        )
        places = np.array([data.at for data in m.markers.values()], dtype=float).reshape(-1, 2)
        dimensions = np.array(list(self.dimensions.values()), dtype=float)
        return System(topology, Parameters(jnp.array(self.home), jnp.array(places), jnp.array(dimensions)))

    # -- small tools --------------------------------------------------------------------------------------------

    def at(self, *names: str) -> tuple[int, ...]:
        return tuple(self.index[n] for n in names)

    def pair(self, names: Sequence[str]) -> tuple[int, int]:
        first, second = names
        return self.index[first], self.index[second]

    def scalar(self, name: str) -> int:
        if name in self.scalars:
            return self.first_scalar + self.scalars.index(name)
        point, axis = name.split(".")
        return 2 * self.index[point] + "xy".index(axis)

    def dimension(self, name: str, value: float) -> int:
        self.dimensions[name] = float(value)
        return len(self.dimensions) - 1

    def direction(self, pair: Sequence[int], what: str) -> None:
        a, b = pair
        if np.linalg.norm(self.home[a] - self.home[b]) <= _COINCIDENT * self.size:
            raise MechanismError(
                f"{what}: points {self.names[a]!r} and {self.names[b]!r} are drawn at the same place, so they give no "
                f"direction; move one of them"
            )

    def add(
        self, kind: Kind, points: Sequence[int], owner: str, scalars: Sequence[int] = (), **more
    ) -> _Instance | None:
        """Write one instance. The same one twice is written once, with both owners; one between ground points never."""
        points, scalars = tuple(points), tuple(scalars)
        if not scalars and self.fixed[list(points)].all():
            return None
        data = _Instance(kind, points, scalars, owner, more.pop("drawn", points), **more)
        key = (kind, points if kind is not kinds.DISTANCE else tuple(sorted(points)), scalars)
        twin = self.seen.get(key)
        if twin is not None and not data.given and not twin.given and twin.drawn == data.drawn:
            twin.owner += f" and {owner}"
            return twin
        self.seen[key] = data
        self.instances.append(data)
        return data

    def length_of(self, a: int, b: int) -> tuple[int, int]:
        """Where the distance between two points is read: in a redrawn body that has both, or in the drawing."""
        for where in self.redrawn.values():
            if a in where and b in where:
                return where[a], where[b]
        return a, b

    def joint(self, name: str, kind: str, points: Sequence[int], removed: int) -> None:
        self.joints.append(JointIndex(name, kind, tuple(points), removed))

    def rigid(self, a: int, b: int) -> bool:
        """Whether the distance between two points is constant."""
        both = {a, b}
        return bool(self.fixed[[a, b]].all()) or any(both <= set(body.points) for body in self.bodies)

    # -- bodies -------------------------------------------------------------------------------------------------

    def base(self, points: tuple[int, ...]) -> tuple[int, int]:
        """The segment that carries a body: its first two points, or the two farthest where those nearly coincide."""
        home = self.home[list(points)]
        gaps = np.linalg.norm(home[:, None] - home[None], axis=-1)
        if gaps[0, 1] >= 0.05 * gaps.max():
            return points[0], points[1]
        i, j = np.unravel_index(int(gaps.argmax()), gaps.shape)
        return points[min(i, j)], points[max(i, j)]

    def prepare_body(self, name: str, body: record.Body) -> None:
        points = self.at(*body.points)
        if len(points) == 1:
            if body.lengths or body.local:
                raise MechanismError(f"body {name!r} has one point, so it has no lengths or local places")
            return
        if not body.lengths and not body.local:
            return
        index = {p: k for k, p in enumerate(body.points)}
        steps, values = recipe(name, body, index, self.home[list(points)])
        numbers = tuple(self.dimension(f"{name}.{key}", value) for key, value in values)
        self.recipes.setdefault(steps, []).append((name, points, numbers))

    def number_shapes(self) -> None:
        offset = len(self.names)
        for steps, members in self.recipes.items():
            for name, points, _ in members:
                self.redrawn[name] = {p: offset + k for k, p in enumerate(points)}
                offset += len(points)
            self.shapes.append(Shape(steps, tuple(p for _, p, _ in members), tuple(d for _, _, d in members)))

    def add_body(self, name: str, body: record.Body) -> None:
        points = self.at(*body.points)
        if len(points) == 1:
            self.bodies.append(BodyIndex(name, points, self.orientation(name, body)))
            return
        shape = self.redrawn.get(name, {p: p for p in points})
        base = self.pair(body.points[:2]) if name in self.redrawn else self.base(points)
        self.direction(base, f"body {name!r}")
        self.bodies.append(BodyIndex(name, points, base))

        def add(kind: Kind, *at: int) -> None:
            self.add(kind, at, name, drawn=tuple(shape[p] for p in at))

        add(kinds.DISTANCE, *base)
        rest = [p for p in points if p not in base]
        if body.form == "exact":
            for p in rest:
                add(kinds.ATTACHED, *base, p)
            return
        i, j = base
        off = [abs(_cross(self.home[j] - self.home[i], self.home[p] - self.home[i])) for p in rest]
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
        """The line that a body of one point keeps its direction to; None for the ground."""
        point = body.points[0]
        if body.along is not None:
            return self.pair(body.along)
        at = self.index[point]
        if self.fixed[at].any():
            return None
        lines = []
        for joint in self.model.joints.values():
            if isinstance(joint, record.Slot) and joint.point == point:
                lines.append(joint.line)
            if isinstance(joint, record.Prismatic) and joint.on[0] == point:
                lines.append(joint.line)
        for line in lines:
            if self.fixed[list(self.at(*line))].all():
                return self.pair(line)
        if lines:
            return self.pair(lines[0])
        raise MechanismError(
            f"body {name!r} has only the point {point!r}, so its orientation is not known: give it a second point, "
            f"let {point!r} slide in a slot, fix one of its coordinates, or say which line it follows with along="
        )

    def marker(self, name: str, data: record.Marker, specs: dict[str, record.Body]) -> MarkerIndex:
        body = next(b for b in self.bodies if b.name == data.on)
        base = body.base
        if base is None:
            raise MechanismError(
                f"marker {name!r}: body {data.on!r} has one point and no line to carry a marker; give the body "
                f"along=, or a second point"
            )
        shape = self.redrawn.get(data.on, {})
        drawn = (shape.get(base[0], base[0]), shape.get(base[1], base[1]))
        return MarkerIndex(name, data.on, body.points[0] if len(body.points) == 1 else base[0], base, drawn)

    # -- coordinates --------------------------------------------------------------------------------------------

    def add_angle(self, name: str, data: record.Angle) -> None:
        def pair(end: str | record.Pair) -> tuple[int, ...]:
            return self.at(data.at, end) if isinstance(end, str) and data.at is not None else self.at(*end)

        to = pair(data.to)
        what = f"angle {name!r}"
        self.direction(to, what)
        if data.start is None:
            kind, points = kinds.ANGLE_FROM_X[data.form], to
        else:
            start = pair(data.start)
            self.direction(start, what)
            kind, points = kinds.ANGLE[data.form], start + to
        pairs = [points[i : i + 2] for i in range(0, len(points), 2)]
        lengths = {c: self.length_of(p[0], p[1]) for c, p in zip(kind.constants, pairs, strict=False)}
        if kind.constants:
            for p in pairs:
                self.must_be_rigid(p, f"{what}, form {data.form!r}")
        self.measure(name, kind, points, lengths)

    def add_distance(self, name: str, data: record.Distance) -> None:
        ends = self.at(data.start, data.to)
        if data.along is None:
            self.measure(name, kinds.DISTANCE_BETWEEN, ends, {})
            return
        line = self.at(data.start, data.along) if isinstance(data.along, str) else self.at(*data.along)
        self.along(name, ends, line, data.form)

    def along(self, name: str, ends: tuple[int, ...], line: tuple[int, ...], form: str) -> None:
        self.direction(line, f"distance {name!r}")
        if self.rigid(*line):
            self.measure(name, kinds.DISTANCE_ALONG[form], ends + line, {"line": self.length_of(*line)})
            return
        if form != "exact":
            self.must_be_rigid(line, f"distance {name!r}, form {form!r}")
        self.measure(name, kinds.DISTANCE_ALONG_FREE, ends + line, {})

    def must_be_rigid(self, pair: Sequence[int], what: str) -> None:
        if not self.rigid(*pair):
            a, b = (self.names[i] for i in pair)
            raise MechanismError(
                f"{what}: needs the constant length {a}-{b}, but no body holds both points; use form='exact'"
            )

    def measure(self, name: str, kind: Kind, points: tuple[int, ...], lengths: dict[str, tuple[int, int]]) -> None:
        data = self.add(kind, points, name, (self.scalar(name),), lengths=lengths)
        assert data is not None
        self.measured[name] = data

    # -- joints -------------------------------------------------------------------------------------------------

    def add_revolute(self, name: str, j: record.Revolute) -> None:
        points = self.at(*j.points)
        self.add(kinds.COINCIDENT, points, name)
        self.joint(name, "revolute", points, 2)

    def add_prismatic(self, name: str, j: record.Prismatic) -> None:
        line, on = self.at(*j.line), self.at(*j.on)
        self.direction(line, f"prismatic joint {name!r}")
        self.direction(on, f"prismatic joint {name!r}")
        if on[0] not in line:
            self.add(kinds.ALIGNED, (*line, on[0]), name)
        self.add(kinds.FIXED_ANGLE if j.form == "exact" else kinds.SCALAR_PRODUCT, line + on, name)
        self.joint(name, "prismatic", line + on, 2)

    def add_slot(self, name: str, j: record.Slot) -> None:
        line = self.at(*j.line)
        self.direction(line, f"slot {name!r}")
        points = (*line, self.index[j.point])
        self.add(kinds.ALIGNED, points, name)
        self.joint(name, "slot", points, 1)

    def add_gear(self, name: str, j: record.Gear) -> None:
        points, lengths = [], {}
        for k, angle in enumerate(j.angles):
            to = self.measured[angle].points[-2:]
            points.extend(to)
            lengths[f"radius{k + 1}"] = self.length_of(*to)
        kind = kinds.INTERNAL_GEAR if j.internal else kinds.EXTERNAL_GEAR
        given = {}
        if j.radii is not None:
            given = {f"radius{k + 1}": self.dimension(f"{name}.radius{k + 1}", r) for k, r in enumerate(j.radii)}
            lengths = {}
        self.add(kind, points, name, [self.scalar(a) for a in j.angles], lengths=lengths, given=given)
        self.joint(name, "internal gear" if j.internal else "gear", points, 1)

    def add_rolling(self, name: str, j: record.Rolling) -> None:
        what = f"rolling joint {name!r}"
        line = self.at(*j.line)
        centre, rim, contact = self.at(j.centre, j.rim, j.contact)
        self.direction(line, what)
        self.direction((centre, contact), what)
        self.direction((centre, rim), what)
        given = {} if j.radius is None else {"radius": self.dimension(f"{name}.radius", j.radius)}
        if abs(_cross(self.home[line[1]] - self.home[line[0]], self.home[centre] - self.home[line[0]])) <= (
            _COINCIDENT * self.size**2
        ):
            raise MechanismError(
                f"{what}: centre {j.centre!r} is drawn on the line {j.line[0]}-{j.line[1]}, so the side it rolls on is "
                f"not known; draw it on one side"
            )
        where = (*line, centre, contact)
        if j.form == "exact":
            self.must_be_rigid(line, f"{what}, form 'exact'")
            self.add(kinds.CONTACT, where, name, lengths={"line": self.length_of(*line)}, given=dict(given))
        else:
            radius = {"length": given["radius"]} if given else {}
            self.add(kinds.DISTANCE, (centre, contact), name, given=radius)
            self.add(kinds.PERPENDICULAR, (*line, contact, centre), name)
        self.add(kinds.ALIGNED, (*line, contact), name)
        to, start = (centre, rim), (centre, contact)
        self.measure(j.angle, kinds.ANGLE["exact"], start + to, {})
        self.along(j.distance, (line[0], contact), line, "exact")
        scalars = (self.scalar(j.distance), self.scalar(j.angle))
        self.add(kinds.ROLLING, where, name, scalars, given=dict(given))
        self.joint(name, "rolling", (*where, rim), 4)

    def add_cable(self, name: str, j: record.Cable) -> None:
        points = self.at(*j.points)
        given = {} if j.length is None else {"length": self.dimension(f"{name}.length", j.length)}
        self.add(kinds.cable(len(points)), points, name, given=given)
        self.joint(name, "cable", points, 1)

    def add_weld(self, name: str, j: record.Weld) -> None:
        first, second = (next(b for b in self.bodies if b.name == n) for n in j.bodies)
        for body in (first, second):
            if len(body.points) < 2:
                raise MechanismError(f"weld {name!r}: body {body.name!r} has one point; welded bodies need two")
        a, b = first.base, second.base
        assert a is not None and b is not None
        shared = [p for p in second.points if p in first.points]
        if len(shared) > 1:
            return
        if not shared:
            self.add(kinds.ATTACHED, (*a, b[0]), name)
        self.add(kinds.FIXED_ANGLE, a + b, name)
        self.joint(name, "weld", a + b, 1 if shared else 3)

    def add_relation(self, name: str, data: record.Relation) -> None:
        kind = kinds.relation(len(data.terms))
        given = {f"factor{k + 1}": self.dimension(f"{name}.{s}", f) for k, (s, f) in enumerate(data.terms.items())}
        if data.constant is not None:
            given["constant"] = self.dimension(f"{name}.constant", data.constant)
        self.add(kind, (), name, [self.scalar(s) for s in data.terms], given=given)
        self.joint(name, "relation", (), 1)

    def add_constraint(self, name: str, data: record.Constraint) -> None:
        kind = self.mechanism.kinds[data.kind]
        given = {c: self.dimension(f"{name}.{c}", v) for c, v in data.constants.items()}
        points = self.at(*data.points)
        self.add(kind, points, name, [self.scalar(s) for s in data.scalars], given=given)
        self.joint(name, kind.name, points, len(kind.rows))

    # -- grouping -----------------------------------------------------------------------------------------------

    def blocks(self) -> tuple[tuple[Block, ...], tuple[tuple[int, int], ...]]:
        groups: dict[Kind, list[_Instance]] = {}
        for data in self.instances:
            groups.setdefault(data.kind, []).append(data)
        out, where = [], {}
        for b, (kind, members) in enumerate(groups.items()):
            names = kind.constants
            out.append(
                Block(
                    kind=kind,
                    points=tuple(d.points for d in members),
                    vectors=tuple(() for _ in members),
                    scalars=tuple(d.scalars for d in members),
                    drawn=tuple(d.drawn for d in members),
                    lengths=tuple(
                        (i, names.index(c), *pair) for i, d in enumerate(members) for c, pair in d.lengths.items()
                    ),
                    given=tuple((i, names.index(c), k) for i, d in enumerate(members) for c, k in d.given.items()),
                    owners=tuple(d.owner for d in members),
                )
            )
            for i, d in enumerate(members):
                where[id(d)] = (b, i)
        return tuple(out), tuple(where[id(self.measured[s])] for s in self.scalars)


def _cross(a: np.ndarray, b: np.ndarray) -> float:
    return float(a[0] * b[1] - a[1] * b[0])
