"""What every family has in common: variables, rows over places, the system they are compiled to; reference points."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from jaxnc.constraints import ALIGNED, COINCIDENT, COINCIDENT_IN_SPACE, FIXED_ANGLE, SCALAR_PRODUCT
from jaxnc.constraints.kind import Kind
from jaxnc.dynamics.extended import extended, lift
from jaxnc.dynamics.model import body_inertia
from jaxnc.errors import InputError, nearest
from jaxnc.families.bodies import Joined, Origin, Part, Parts, apart, closures
from jaxnc.families.program import (
    AT,
    DIRECTION,
    EQUAL,
    NORMALISED,
    PAIR,
    PROJECTION,
    Arm,
    Coordinate,
    Frame,
    Linear,
    Measured,
    Place,
    Program,
    Scribe,
    Turn,
    compose_kind,
    fixed,
    scale,
    silence,
    variable_kind,
)
from jaxnc.families.shapes import ANGLES, HOME, PARAMETERS, Between, Reading, Recipe, Segments
from jaxnc.mechanism import model as record
from jaxnc.mechanism.model import Place as Spot
from jaxnc.solvers.assembly import derive, with_degrees_of_freedom
from jaxnc.system.assemble import Instance, grouped
from jaxnc.system.design import design, design_numbers
from jaxnc.system.identity import Owner, Thing
from jaxnc.system.system import Parameters, System
from jaxnc.system.topology import Loads, Topology


@dataclass(frozen=True)
class Variable:
    """One variable of a family."""

    name: str
    meaning: str  # what it is, in words
    angle: bool = False  # whether it is an angle
    pure: bool = False  # whether it is no length
    # How it is read off a pose, with its points and vectors; None for a coordinate of the user's.
    reading: tuple[Reading | Between, tuple[int, ...], tuple[int, ...]] | None = None


@dataclass(frozen=True)
class Atlas:
    """Where all points and vectors are, as programs of the variables."""

    places: tuple[Place, ...]
    directions: tuple[Arm, ...]
    scalars: tuple["Linear | Measured | None", ...]
    points: tuple[int, ...]
    drawn: tuple[int, ...]
    vectors: tuple[int, ...]
    variables: tuple[int, ...]
    recipes: tuple[Recipe, ...]


class Planner(ABC):
    """Writes a family's variables and rows.

    The user's angles and distances that are named in `keep` stay variables, each with its own equation.
    """

    family = ""

    def __init__(
        self, parts: Parts, natural: System, keep: tuple[str, ...] = (), orientation: str = "euler parameters"
    ):
        self.parts, self.a, self.natural, self.keep = parts, parts.a, natural, keep
        self.orientation = orientation
        home = np.asarray(derive(natural).home)
        self.drawn = {name: float(home[natural.topology.position[name]]) for name in natural.topology.scalars}
        self.variables: dict[str, Variable] = {}
        self.readings: dict[str, Instance] = {}
        self.angles: dict[str, float] = {}
        self.rows: list[Instance] = []
        self.used: set[Owner] = set()  # joints whose rows the variables meet
        self.held: set[int] = set()  # points in part fixed, whose free coordinates are variables
        for name in keep:
            if name not in self.a.scalars and self.component(name) is None:
                raise InputError(
                    f"keep={name!r}: {self.a.model.name!r} has no angle, distance or moving point of that name; "
                    f"{nearest(name, (*self.a.scalars, *(f'{p}.x' for p in self.a.model.points)))}"
                )

    def component(self, name: str) -> tuple[int, int] | None:
        """Point and axis of a single coordinate such as ``"P.x"``; None if it is none that moves."""
        point, _, axis = name.rpartition(".")
        if point not in self.a.index or axis not in tuple("xyz"[: self.parts.dim]):
            return None
        at = self.a.index[point], "xyz".index(axis)
        return None if self.a.fixed[at] else at

    # -- what a family says -------------------------------------------------------------------------------------

    def frame(self, scribe: Scribe, k: int) -> Frame:
        """The frame of a part, made once for each instance; the ground's is that of the drawing."""
        if k == 0:
            return Frame((), None)
        if k not in scribe.frames:
            scribe.frames[k] = self._frame(scribe, k)
        return scribe.frames[k]

    @abstractmethod
    def _frame(self, scribe: Scribe, k: int) -> Frame:
        """The frame of a part that is not the ground."""

    def origin_of(self, k: int) -> Origin:
        """The origin of a part's frame."""
        return self.parts.parts[k].origin

    def place(self, scribe: Scribe, k: int, point: int) -> Place:
        """A point of a part."""
        if k == 0:
            i = scribe.p(point)
            return (Arm(None, tuple(((1.0, x, i),) for x in "xyz"[: self.parts.dim])),)
        part, frame, origin = self.parts.parts[k], self.frame(scribe, k), self.origin_of(k)
        if part.turns == "no" or origin == Origin((point,)):
            return frame.origin
        if self.parts.dim == 2:
            return (*frame.origin, Arm(frame.turn, self.local(scribe, part, point, self.axis(k), origin)))
        if part.turns == "bar":
            return (*frame.origin, *self.out(scribe, k, point, origin))
        vectors = tuple(scribe.v(v) for v in origin.vectors)
        at = tuple(scribe.c("from", scribe.at((point, *origin.points), part), vectors, origin.how))
        return (*frame.origin, Arm(frame.turn, at))

    @abstractmethod
    def place_parts(self, points: Joined, vectors: Joined) -> None:
        """Note the variables of all parts, and join the points and vectors that the parts share by them."""

    def met(self, data: Instance) -> bool:
        """Say that the variables of a joint meet a row, or write it otherwise than over points and vectors."""
        return not self.used.isdisjoint(data.owners)

    def plan(self) -> None:
        """Write variables and rows."""
        points, vectors = apart(self.parts.of_point), apart(self.parts.of_vector)
        self.place_parts(points, vectors)
        for name in self.keep:
            self.keep_variable(name)
        self.share(points, vectors)
        self.hold()
        for data in self.a.instances:
            if data.kind.measure is None and data.kind.rows and not self.rigid(data) and not self.met(data):
                self.compose(data)

    # -- parts by a point and their orientation -----------------------------------------------------------------

    def names(self, k: int) -> tuple[str, ...]:
        """Names of the coordinates of a part's reference point, and of what says how it is turned."""
        part, dim = self.parts.parts[k], self.parts.dim
        names = tuple(f"{part.name}.{x}" for x in "xyz"[:dim])
        if part.turns == "no":
            return names
        if dim == 2:
            return (*names, part.angle or f"{part.name}.psi")
        return (*names, *(self.bar(k) if part.turns == "bar" else self.parameters(part.name)))

    def parameters(self, owner: str) -> tuple[str, ...]:
        """Names of orientation parameters."""
        return tuple(f"{owner}.{x}" for x in PARAMETERS[self.orientation])

    def free_frame(self, scribe: Scribe, k: int) -> Frame:
        """The frame of a part by its reference point and its orientation."""
        found, dim = [scribe.s(name) for name in self.names(k)], self.parts.dim
        how = "angle" if dim == 2 else self.orientation
        turn = Turn(how, tuple(found[dim:])) if self.parts.parts[k].turns == "fully" else None
        return Frame((Arm(None, tuple(found[:dim])),), turn)

    def free(self, k: int, point: str, what: str) -> None:
        """Note the variables of a part by its reference point and its orientation, and the rows that normalise these.

        Args:
            k: the part.
            point: what its reference point is called in words.
            what: what the part is called.
        """
        part, dim, names = self.parts.parts[k], self.parts.dim, self.names(k)
        if not part.points:
            for i, name in enumerate(names):  # a unit vector of no body
                reading = Reading(Recipe("unit", (), (0,)), i)
                self.add_variable(name, f"component of {part.name}", reading, (), part.vectors, pure=True)
            return
        origin = part.origin
        at = tuple(range(len(origin.points))), tuple(range(len(origin.vectors)))
        for i, name in enumerate(names[:dim]):
            reading = Reading(Recipe("mean", *at, origin.how), i)
            self.add_variable(name, f"{'xyz'[i]} of {point}", reading, origin.points, origin.vectors)
        if part.turns == "bar":
            self.direct(k)
        elif part.turns == "fully" and dim == 2:
            reading = Reading(Recipe("direction", (0, 1)))
            self.add_variable(names[2], f"angle of {what}", reading, part.axis, angle=True)
            self.angles[names[2]] = drawn_angle(self.a.home, part.axis)
        elif part.turns == "fully":
            scribe = Scribe()
            between = Between(self.orientation, 0, (), self.segments(scribe, k), ())
            self.orient(names[3:], between, scribe, f"{self.orientation} of {what}", part.owner)

    def segments(self, scribe: Scribe, k: int) -> Segments:
        """The segments of a part's frame, in the numbers of an instance; none for the ground."""
        if k == 0:
            return ()
        return tuple(scribe.at(s) if len(s) == 2 else (~scribe.v(~s[0]),) for s in self.parts.parts[k].segments)

    def orient(self, names: tuple[str, ...], between: Between, scribe: Scribe, meaning: str, owner: Owner) -> None:
        """Note orientation parameters, and write the rows that normalise them; angles need none."""
        how, points = self.orientation, tuple(p for p, _ in scribe.points)
        for i, name in enumerate(names):
            reading = replace(between, part=i)
            self.add_variable(name, meaning, reading, points, tuple(scribe.vectors), how in ANGLES, True)
            self.angles[name] = HOME[how][i]
        if how in NORMALISED:
            scribe = Scribe()
            self.write(NORMALISED[how], (owner,), scribe, scalars=tuple(scribe.s(n) for n in names))

    def direction(self, scribe: Scribe, k: int, vector: int) -> Arm:
        """A unit vector of a part."""
        part = self.parts.parts[k]
        if k == 0:
            return Arm(None, tuple(((1.0, x, scribe.v(vector)),) for x in "XYZ"))
        if part.turns == "no":
            return Arm(None, tuple(scribe.s(f"{part.name}.{x}") for x in "xyz"))
        if part.turns == "bar":
            return self.along(scribe, k, vector)
        return Arm(self.frame(scribe, k).turn, tuple(scribe.c("unit", (), (scribe.v(vector),))))

    def bar(self, k: int) -> tuple[str, ...]:
        """Names of the direction of a bar."""
        return tuple(f"{self.parts.parts[k].name}.u{x}" for x in "xyz")

    def ends(self, k: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """The two points, or the vector, that a bar lies along."""
        (first, *_) = self.parts.parts[k].segments
        return (first, ()) if len(first) == 2 else ((), (~first[0],))

    def out(self, scribe: Scribe, k: int, point: int, origin: Origin) -> Place:
        """A point of a bar from its reference: the direction of the bar by the drawn distance."""
        ends, vector = self.ends(k)
        vectors = tuple(scribe.v(v) for v in (*vector, *origin.vectors))
        at = scribe.at((point, *ends, *origin.points), self.parts.parts[k])
        (distance,) = scribe.c("signed", at, vectors, (len(ends), *origin.how))
        return (Arm(Turn("times", (distance,)), tuple(map(scribe.s, self.bar(k)))),)

    def direct(self, k: int) -> None:
        """Note the direction of a bar, and write that its length is one."""
        part, (points, vectors), scribe = self.parts.parts[k], self.ends(k), Scribe()
        for i, name in enumerate(self.bar(k)):
            reading = Reading(Recipe("unit", tuple(range(len(points))), tuple(range(len(vectors)))), i)
            self.add_variable(name, f"direction of body {part.name}", reading, points, vectors, pure=True)
        self.write(DIRECTION, (part.owner,), scribe, scalars=tuple(map(scribe.s, self.bar(k))))

    def along(self, scribe: Scribe, k: int, vector: int) -> Arm:
        """A unit vector of a bar: its direction, or against it."""
        part = self.parts.parts[k]
        u = tuple(map(scribe.s, self.bar(k)))
        points, vectors = self.ends(k)
        if vectors == (vector,):
            return Arm(None, u)
        (sign,) = scribe.c("agree", scribe.at(points, part), tuple(scribe.v(v) for v in (vector, *vectors)))
        return Arm(Turn("times", (sign,)), u)

    # -- tools --------------------------------------------------------------------------------------------------

    def add_variable(
        self,
        name: str,
        meaning: str,
        reading: Reading | Between,
        points: tuple[int, ...],
        vectors: tuple[int, ...] = (),
        angle: bool = False,
        pure: bool = False,
    ) -> None:
        """Note a variable, and how it is read off a pose."""
        if name in self.variables:
            raise InputError(f"two variables would be called {name!r}; rename the body or point of that name")
        self.variables[name] = Variable(name, meaning, angle, pure or angle, (reading, points, vectors))
        kind = variable_kind(reading, len(points), len(vectors))
        at, along = (points, vectors) if isinstance(reading, Reading) else ((), ())
        self.readings[name] = Instance(kind, at, (name,), (), at, along)  # pyright: ignore[reportArgumentType]

    def own(self, name: str, meaning: str) -> None:
        """Note a user's coordinate as a variable that needs no equation."""
        angle, data = self.is_angle(name), self.a.measured[name]
        self.variables[name] = Variable(name, meaning, angle, angle)
        self.angles[name] = self.drawn[name]
        self.readings[name] = replace(data, kind=silence(data.kind), scalars=(name,))

    def estimate(self, scribe: Scribe, value: Linear) -> float:
        """About what a sum of angles is in the drawing."""
        out = 0.0
        for factor, what, i in value:
            if what == "s":
                out += factor * self.angles[scribe.scalars[i]]
            elif what == "1":
                out += factor
            else:
                recipe = next(r for k, r in enumerate(scribe.recipes) if sum(x.count for x in scribe.recipes[:k]) == i)
                out += factor * drawn_angle(self.a.home, tuple(scribe.points[p][0] for p in recipe.points))
        return out

    def angle(self, scribe: Scribe, ends: tuple[int, int], k: int | None = None) -> Linear | None:
        """The angle of a segment from the x axis, if a part holds it (part `k`, where that is known)."""
        k = self.parts.holder(ends) if k is None else k
        if k is None:
            return None
        if k == 0:
            return scribe.c("direction", scribe.at(ends))[0]
        part, turn = self.parts.parts[k], self.frame(scribe, k).turn
        if turn is None or part.turns == "no":
            return None
        return self.segment_angle(scribe, part, ends, self.axis(k), turn.of[0])

    def segment_angle(
        self, scribe: Scribe, part: Part, ends: tuple[int, int], axis: tuple[int, int], angle: Linear
    ) -> Linear:
        """The angle of a segment of a part whose axis has an angle."""
        if ends == axis:
            return angle
        if ends == axis[::-1]:
            return angle + fixed(-np.pi)
        (turn,) = scribe.c("between", scribe.at((*axis, *ends), part))
        return angle + turn

    def local(
        self, scribe: Scribe, part: Part, point: int, axis: tuple[int, int], origin: Origin
    ) -> tuple[Linear, ...]:
        """Components of a point in the frame of a planar part with an axis."""
        if not origin.how:
            middle = set(origin.points) == set(axis)
            if point in axis and (middle or (origin.points[0] in axis and len(origin.points) == 1)):
                (length,) = scribe.c("length", scribe.at(axis, part))
                return scale(length, (1.0 if point == axis[1] else -1.0) * (0.5 if middle else 1.0)), ()
        along, across = scribe.c("local", scribe.at((point, *axis, *origin.points), part), (), origin.how)
        return along, across

    def axis(self, k: int) -> tuple[int, int]:
        """The two points whose direction is a planar part's angle."""
        return self.parts.parts[k].axis

    def scalar(self, scribe: Scribe, name: str) -> "Linear | Measured | None":
        """A user's angle or distance in terms of the variables; None where it has to be one itself."""
        if name in self.variables:
            return scribe.s(name)
        data = self.a.measured[name]
        if name in self.a.model.distances or not self.is_angle(name):
            # A length is read in the drawing, or between the places that points have in a redrawn shape.
            points = {drawn: p for places in self.a.redrawn.values() for p, drawn in places.items()}
            ends = [map(int, data.lengths[c]) for c in data.kind.constants]
            pairs = [tuple(scribe.pair(points.get(drawn, drawn), drawn) for drawn in two) for two in ends]
            constants = [scribe.c("length", pair)[0] for pair in pairs]
            return Measured(data.kind, *self.carry(scribe, data), tuple(constants))
        if self.parts.dim == 3:
            return None
        ends = data.points
        to = self.angle(scribe, (ends[-2], ends[-1]))
        start = () if len(ends) == 2 else self.angle(scribe, (ends[0], ends[1]))
        if to is None or start is None:
            return None
        value = to + scale(start, -1.0)
        turns = round((self.drawn[name] - self.estimate(scribe, value)) / (2 * np.pi))
        return value + fixed(2 * np.pi * turns)

    def is_angle(self, name: str) -> bool:
        """Say whether a user's coordinate is an angle."""
        return name in self.a.model.angle_names

    def carry(self, scribe: Scribe, data: Instance) -> tuple[tuple[Place, ...], tuple]:
        """The points and vectors of a natural constraint, each on the part that carries it."""
        holders = self.parts.best(data.points)
        places = tuple(self.place(scribe, k, p) for k, p in zip(holders, data.points, strict=True))
        directions = []
        for v in data.vectors:
            k = max(self.parts.of_vector[v], key=lambda k: (sum(k == h for h in holders), k == 0, -k))
            directions.append(self.direction(scribe, k, v))
        return places, tuple(directions)

    # -- rows ---------------------------------------------------------------------------------------------------

    def write(
        self,
        kind: Kind,
        owners: tuple[Owner, ...],
        scribe: Scribe,
        places: tuple[Place, ...] = (),
        scalars: tuple = (),
        directions: tuple = (),
        data: Instance | None = None,
        measured: bool = False,
    ) -> None:
        """Write an instance over places; `data` is the natural one whose constants it has."""
        own: tuple[int, ...] = ()
        own_vectors: tuple[int, ...] = ()
        if data is not None and (kind.constants or measured):
            own = tuple(scribe.pair(p, d) for p, d in zip(data.points, data.drawn, strict=True))
            own_vectors = tuple(scribe.v(v) for v in data.vectors)
        program = Program(kind, places, directions, scalars, tuple(scribe.recipes), own, own_vectors)
        made = compose_kind(program, len(scribe.points), len(scribe.vectors), len(scribe.scalars), measured)
        points, drawn = (tuple(x[i] for x in scribe.points) for i in (0, 1))
        row = Instance(made, points, tuple(scribe.scalars), owners, drawn, tuple(scribe.vectors))  # pyright: ignore[reportArgumentType]
        if data is not None:
            row.lengths, row.given = dict(data.lengths), dict(data.given)
        if measured:
            self.readings[scribe.scalars[-1]] = row
        self.rows.append(row)

    def compose(self, data: Instance, name: str | None = None) -> None:
        """Write a natural constraint over places; of a user's coordinate that is a variable, its equation."""
        scribe = Scribe()
        places, directions = self.carry(scribe, data)
        scalars = []
        for i in data.scalars:
            if i >= self.a.first_scalar:
                own = self.a.scalars[i - self.a.first_scalar]
                found = scribe.s(own) if own == name else self.scalar(scribe, own)
                if found is None:
                    self.keep_variable(own)
                    found = scribe.s(own)
                scalars.append(found)
                continue
            at, axis = divmod(i, self.parts.dim)
            v = at - len(self.a.names)
            if v >= 0:
                place: Place = (self.direction(scribe, self.parts.of_vector[v][0], v),)
            else:
                place = self.place(scribe, self.parts.best((at,))[0], at)
            scalars.append(Coordinate(place, axis))
        self.write(data.kind, data.owners, scribe, places, tuple(scalars), directions, data, name is not None)

    def keep_variable(self, name: str) -> None:
        """Make a user's coordinate a variable, with the equation that defines it."""
        if name in self.variables:
            return
        if name not in self.a.scalars:
            point, axis = self.spot(name)
            scribe = Scribe()
            place = self.place(scribe, self.parts.best((point,))[0], point)
            self.write(AT[axis], (Owner(Thing.POINT, point),), scribe, (place,), (scribe.s(name),))
            return
        angle = self.is_angle(name)
        self.variables[name] = Variable(name, f"the {'angle' if angle else 'distance'} {name}", angle, angle)
        data = self.a.measured[name]
        self.angles[name] = self.drawn[name]
        self.compose(data, name)

    def spot(self, name: str) -> tuple[int, int]:
        """Note a coordinate of a point as a variable: the point, and the axis."""
        found = self.component(name)
        assert found is not None
        reading = Reading(Recipe("mean", (0,)), found[1])
        self.add_variable(name, f"coordinate {name}", reading, found[:1])
        return found

    def choose(self, family: str) -> None:
        """Note the kept coordinates alone, without rows: everything else follows from the position problem."""
        self.family = family
        for name in self.keep:
            if name in self.a.scalars:
                self.own(name, f"the coordinate {name}")
            else:
                self.spot(name)

    def coincide(self, first: int, second: int, point: int) -> None:
        """Write that a point is the same on two parts."""
        scribe = Scribe()
        places = (self.place(scribe, first, point), self.place(scribe, second, point))
        kind = COINCIDENT if self.parts.dim == 2 else COINCIDENT_IN_SPACE
        self.write(kind, (Owner(Thing.POINT, point),), scribe, places)

    def share(self, points: Joined, vectors: Joined) -> None:
        """Write that parts share points and vectors, where they are not joined already.

        Of two parts that share several, the first is a point; the others are directions, of two equations each.
        """
        anchors: dict[tuple[int, int], int] = {}
        for p, first, second in closures(points):
            # The ground, and otherwise the later body, is what is subtracted, as in (5)-(8).
            one, other = (first, second) if first == 0 else (second, first)
            if self.parts.dim == 3 and (one, other) in anchors:
                self.parallel(Owner(Thing.POINT, p), one, other, (anchors[one, other], p), ())
                continue
            anchors.setdefault((one, other), p)
            self.coincide(one, other, p)
        for v, first, second in closures(vectors):
            self.parallel(Owner(Thing.VECTOR, v), first, second, (), (v,))

    def parallel(
        self, owner: Owner, first: int, second: int, points: tuple[int, ...], vectors: tuple[int, ...]
    ) -> None:
        """Write in two rows that a direction, two points or a vector, is the same on two parts."""
        if second and self.parts.parts[second].turns != "fully":
            first, second = second, first
        part = self.parts.parts[second]
        if second and part.turns != "fully":
            raise InputError(
                f"{self.a.text(owner)!r} is shared by {self.parts.parts[first].name!r} and {part.name!r}, which are "
                f"bars that do not know their rotation; give one of them a point or vector across its line"
            )
        scribe = Scribe()
        if vectors:
            one: Arm = self.direction(scribe, first, vectors[0])
        elif self.parts.parts[first].turns == "bar":
            one = Arm(None, tuple(map(scribe.s, self.bar(first))))
        else:
            shape = scribe.at(points, self.parts.parts[first])
            one = Arm(self.frame(scribe, first).turn, tuple(scribe.c("unit", shape)))
        d = self.a.vectors[vectors[0]] if vectors else self.a.home[points[1]] - self.a.home[points[0]]
        at = scribe.at(points, part), tuple(scribe.v(v) for v in vectors)
        across = scribe.c("across", *at, (int(np.argmin(np.abs(d))),))
        turn = self.frame(scribe, second).turn
        arms = (Arm(turn, tuple(across[:3])), Arm(turn, tuple(across[3:])))
        self.write(PAIR, (owner,), scribe, directions=(one, *arms))

    def hold(self) -> None:
        """Write the coordinates of points that do not change, but for those that variables hold."""
        for p, axes in enumerate(self.a.fixed):
            if axes.all() or p in self.held:
                continue
            for axis in np.flatnonzero(axes):
                scribe = Scribe()
                place = self.place(scribe, self.parts.best((p,))[0], p)
                still = Coordinate(self.place(scribe, 0, p), int(axis))
                self.write(AT[axis], (Owner(Thing.POINT, p),), scribe, (place,), (still,))

    def rigid(self, data: Instance) -> bool:
        """Say whether a natural constraint holds because its points are of one part, or concerns no variable."""
        return not data.scalars and self.parts.holder(data.points, data.vectors) is not None

    # -- out ----------------------------------------------------------------------------------------------------

    def atlas(self) -> Atlas:
        """Where every point and vector is."""
        scribe = Scribe()
        places = tuple(self.place(scribe, holders[0], p) for p, holders in self.parts.of_point.items())
        directions = tuple(self.direction(scribe, holders[0], v) for v, holders in self.parts.of_vector.items())
        scalars = tuple(self.scalar(scribe, name) for name in self.a.scalars)
        where = {name: i for i, name in enumerate(self.variables)}
        return Atlas(
            places, directions, scalars,
            tuple(p for p, _ in scribe.points), tuple(d for _, d in scribe.points), tuple(scribe.vectors),
            tuple(where[name] for name in scribe.scalars), tuple(scribe.recipes),
        )  # fmt: skip

    def system(self) -> System:
        """The system of the family, with the parameters of the natural one."""
        top, names = self.natural.topology, tuple(self.variables)
        first = top.dim * (len(top.points) + len(top.vectors))
        index = {name: first + k for k, name in enumerate(names)}
        spread = [(n, all(self.a.fixed[i])) for i, n in enumerate(top.points)]
        spread += [(n, bool(self.a.fixed_vectors[i])) for i, n in enumerate(top.vectors)]
        shown = [n if still else f"{n} drawn" for n, still in spread]
        taken = {f"{n}.{x}" for n in shown for x in "xyz"[: top.dim]} | set(shown)
        for name in names:
            if name in taken:
                raise InputError(f"the variable {name!r} and a ground point would share a name; rename the body")
        rows = {id(r): r for r in self.rows}
        listed = [*rows.values(), *(r for r in self.readings.values() if id(r) not in rows)]
        for data in listed:
            data.scalars = tuple(index[s] if isinstance(s, str) else s for s in data.scalars)
        blocks, where = grouped(listed)
        counted = any(
            i >= self.a.first_scalar for d in self.a.instances if not d.kind.measure for i in d.scalars
        ) or any(isinstance(d.kind.residual, Program) and d.kind.residual.kind is EQUAL for d in listed)
        topology = replace(
            top,
            name=f"{top.name}, {self.family}",
            points=tuple(shown[: len(top.points)]),
            vectors=tuple(shown[len(top.points) :]),
            scalars=names,
            angles=tuple(self.variables[n].pure for n in names),
            periodic=tuple(self.variables[n].angle and not counted for n in names),
            measures=tuple(where[id(self.readings[n])] for n in names),
            fixed=(True,) * first + (False,) * len(names),
            blocks=blocks,
            bodies=(),
            markers=(),
            joints=(),
            loads=Loads(),
            rates=(),
            extended=None,
            special=None,
        )
        return with_degrees_of_freedom(System(topology, fit_parameters(self.natural.parameters, topology)))


def drawn_angle(home: np.ndarray, ends: tuple[int, ...]) -> float:
    """The drawn angle of a segment from the x axis, or from another segment, as the recipes read it."""
    spans = [home[b] - home[a] for a, b in zip(ends[::2], ends[1::2], strict=True)]
    d, w = (np.array([1.0, 0.0]), spans[0]) if len(spans) == 1 else spans
    return float(np.arctan2(d[0] * w[1] - d[1] * w[0], d @ w))


def fit_parameters(parameters: Parameters, topology: Topology) -> Parameters:
    """The parameters of a mechanism for the system of a family, which may have no markers, and has its own angles."""
    return replace(parameters, markers=parameters.markers[: len(topology.markers)], near=None)


# -- reference-point coordinates ---------------------------------------------------------------------------------


class Reference(Planner):
    """Variables and rows of reference-point coordinates: every body as if it were free (source text §2.2).

    The reference points are in the middle until `refer` is called.
    """

    family = "reference point"

    def _frame(self, scribe: Scribe, k: int) -> Frame:
        return self.free_frame(scribe, k)

    def place_parts(self, points: Joined, vectors: Joined) -> None:
        """Note the variables of every part, and the rows that normalise its orientation."""
        for k, part in enumerate(self.parts.parts[1:], start=1):
            what = f"body {part.name}" if part.turns != "no" else f"point {part.name}"
            self.free(k, f"the reference point of {what}", what)

    def met(self, data: Instance) -> bool:
        """Write what the text writes otherwise than in points: the prismatic joint (9)-(10), the pin in a slot."""
        if self.parts.dim != 2 or data.kind not in (ALIGNED, FIXED_ANGLE, SCALAR_PRODUCT):
            return False
        joints = [j for owner in data.owners if (j := self.parts.joint(owner)) is not None]
        joint = joints[0] if joints else None
        if isinstance(joint, record.Prismatic):
            line, on = self.a.pair(joint.line), self.a.pair(joint.on)
            i, j = self.parts.holder(line), self.parts.holder(on)
            if not i or not j or on[0] in line:
                return False
            if data.kind is ALIGNED:
                self.slide(data.owners, i, j, line, on)
            else:
                self.together(data.owners, line, on)
            return True
        if isinstance(joint, record.Slot):
            line = self.a.at(*joint.line)
            i = self.parts.holder(line)
            if i:
                self.pin(data.owners, i, line, self.a.index[joint.point])
                return True
        return False

    def together(self, owners: tuple[Owner, ...], line: tuple[int, int], on: tuple[int, int]) -> None:
        """Two bodies turn together (9)."""
        scribe = Scribe()
        (kept,) = scribe.c("between", scribe.at((*line, *on)))
        one, other = self.angle(scribe, line), self.angle(scribe, on)
        assert one is not None and other is not None
        turns = round((self.estimate(scribe, other) - self.estimate(scribe, one + kept)) / (2 * np.pi))
        self.write(EQUAL, owners, scribe, scalars=(other, one + kept + fixed(2 * np.pi * turns)))

    def slide(self, owners: tuple[Owner, ...], i: int, j: int, line: tuple[int, ...], on: tuple[int, ...]) -> None:
        """A body slides along a line of another (10)."""
        scribe = Scribe()
        first, second = self.parts.parts[i], self.parts.parts[j]
        points = (
            *scribe.at((*second.axis, *on), second),
            *scribe.at(line, first),
            *scribe.at((*line, *on)),
            *scribe.at(second.origin.points, second),
            *scribe.at(first.origin.points, first),
        )
        extra = (len(second.origin.points), second.origin.how, first.origin.how)
        gamma, offset = scribe.c("prismatic", points, (), extra)
        one, other = self.frame(scribe, i), self.frame(scribe, j)
        assert other.turn is not None
        self.write(PROJECTION, owners, scribe, (one.origin, other.origin), (other.turn.of[0] + gamma, offset))

    def pin(self, owners: tuple[Owner, ...], i: int, line: tuple[int, ...], point: int) -> None:
        """A point slides along a line of a body (37), as its projection on the line's normal."""
        scribe = Scribe()
        part = self.parts.parts[i]
        origin = part.origin
        gamma, offset = scribe.c("normal", scribe.at((*line, *part.axis, *origin.points), part), (), origin.how)
        frame = self.frame(scribe, i)
        assert frame.turn is not None
        holder = next(k for k in self.parts.of_point[point] if k != i)
        place = self.place(scribe, holder, point)
        self.write(PROJECTION, owners, scribe, (place, frame.origin), (frame.turn.of[0] + gamma, offset))

    # -- reference points -----------------------------------------------------------------------------------------

    def refer(self, reference: str | Mapping[str, str | Spot]) -> None:
        """Set the reference points of all parts (source text §2.2).

        Args:
            reference: ``"mass"``, ``"middle"``, or the points of some bodies; see `formulate`.
        """
        parts, natural = self.parts, self.natural
        chosen = {} if isinstance(reference, str) else dict(reference)
        if isinstance(reference, str) and reference not in ("mass", "middle"):
            raise InputError(f"reference={reference!r}; use 'mass', 'middle', or points of bodies, {{body: point}}")
        of = {body: part for part in parts.parts[1:] for body in part.bodies}
        for body in chosen:
            if body not in of:
                raise InputError(f"reference={{{body!r}: …}}: no moving body has that name; {nearest(body, of)}")
        top, home = natural.topology, np.asarray(derive(natural).home)
        drawing = design_numbers(top, natural.parameters.in_numpy(), 1)[design(top).drawing]
        for part in parts.parts[1:]:
            if part.turns == "no" or not part.points:
                continue
            drawn = {p: parts.a.home[p] for p in part.points}
            given = next((chosen[b] for b in part.bodies if b in chosen), None)
            if given is not None:
                at = self.locate(part, given)
            elif reference == "middle":
                continue
            else:
                drawn = {p: drawing[i] for p, i in part.drawn.items()}
                at = _centre_of_mass(natural, part, home, drawn)
            if at is not None:
                part.origin = self.origin(part, at, drawn)

    def locate(self, part: Part, given: str | Spot) -> np.ndarray:
        """A point, a marker or a place of a part, as drawn."""
        if not isinstance(given, str):
            found = np.asarray(given, dtype=float)
            if found.shape != (self.parts.dim,) or not np.isfinite(found).all():
                raise InputError(
                    f"reference point {given!r} of body {part.name!r}: give a point's name or {self.parts.dim} numbers"
                )
            return found
        names = {self.parts.point(p): self.a.home[p] for p in part.points}
        for name, marker in self.a.model.markers.items():
            if marker.on in part.bodies and marker.at is not None:
                names[name] = np.asarray(marker.at, dtype=float)
        if given not in names:
            raise InputError(
                f"reference point {given!r}: body {part.name!r} has no such point; {nearest(given, names)}"
            )
        return names[given]

    def origin(self, part: Part, at: np.ndarray, drawn: Mapping[int, np.ndarray]) -> Origin:
        """A place of a part as an origin."""
        near = 1e-9 * self.a.size  # 1e-9 of the mechanism's size: places that are one
        for p, spot in drawn.items():
            if np.linalg.norm(spot - at) <= near:
                return Origin((p,))
        if np.linalg.norm(np.mean(list(drawn.values()), axis=0) - at) <= near:
            return Origin(part.points)
        segments = (part.axis,) if self.parts.dim == 2 else part.segments[:2]
        axes = [drawn[s[1]] - drawn[s[0]] if len(s) == 2 else self.a.vectors[~s[0]] for s in segments]
        if self.parts.dim == 2:
            axes.append(np.array([-axes[0][1], axes[0][0]]))
        elif len(axes) == 2:
            axes.append(np.cross(axes[0], axes[1]))
        first = segments[0][0] if len(segments[0]) == 2 else part.points[0]
        factors, *_ = np.linalg.lstsq(np.array(axes).T, at - drawn[first], rcond=None)
        off = np.linalg.norm(np.array(axes).T @ factors + drawn[first] - at)
        if off > near:
            raise InputError(
                f"the reference point of {part.name!r} is {off:.3g} beside its line, and a bar does not know its "
                f"rotation; put it on the line, or give the bar a point or vector across it"
            )
        points = (first, *(p for s in segments if len(s) == 2 for p in s))
        forms = "".join("p" if len(s) == 2 else "v" for s in segments)
        return Origin(points, tuple(~s[0] for s in segments if len(s) == 1), (forms, *map(float, factors)))


def _centre_of_mass(
    natural: System, part: Part, home: np.ndarray, drawn: Mapping[int, np.ndarray]
) -> np.ndarray | None:
    """The centre of mass of a part's bodies as drawn; None without mass."""
    q, dim = home.copy(), natural.topology.dim
    for p, at in drawn.items():
        q[dim * p : dim * p + dim] = at
    whole, q = extended(natural), np.asarray(lift(natural.topology, q))  # a body may have a third direction there
    moment, mass = np.zeros(dim), 0.0
    for body in part.bodies:
        at, _, first, m = body_inertia(whole, body)
        moment, mass = moment + np.asarray(first) @ q[at], mass + float(m)
    return moment / mass if mass else None
