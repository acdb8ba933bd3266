"""The static half of masses and forces: which coordinates each of them lives on, and which numbers it takes."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.errors import MechanismError, nearest
from jaxnc.forces import CATALOGUE, ForceKind
from jaxnc.mechanism import model as record
from jaxnc.pickling import Remade
from jaxnc.system.identity import GROUND, Owner, Thing

if TYPE_CHECKING:
    from jaxnc.system.assemble import Assembler
    from jaxnc.system.topology import BodyIndex, Segment

Index = tuple[int, ...]

_FLAT = 0.02  # volume of three unit segments below which they are no base: the body gets a hidden third one


@dataclass(frozen=True)
class InertiaIndex:
    """Where a body's inertia lives."""

    body: str  # its name; "" for a point mass
    origin: int  # the point that its places are measured from
    # The segments that span it: one in the plane (none for a body that does not turn), three in space, one for a bar.
    segments: "tuple[Segment, ...]"
    frame: "tuple[Segment, ...]"  # the segments of its frame in the drawing (two in space)
    home: tuple  # origin and segments in the drawing, (origin, segments, frame)
    drawn: tuple  # the same where lengths are read (a redrawn body)
    shape: str  # "given", "point", or the name of a uniform shape
    corners: Index  # points of a uniform shape, where lengths are read
    mass: int  # which physical parameter its mass is
    com: Index = ()  # those of its centre of mass, or none
    inertia: Index = ()  # those of its inertia, or none
    size: Index = ()  # those of its shape's size
    singular: bool = False  # whether its mass matrix is, or all but, as compiled: no mass, or a bar's point mass

    @property
    def form(self) -> tuple:
        """The features that two bodies must share to be computed in one call."""
        forms = tuple(len(s) for s in self.segments), tuple(len(s) for s in self.frame)
        return (*forms, self.shape, len(self.corners), len(self.com), len(self.inertia), len(self.size))


@dataclass(frozen=True)
class ForceBlock:
    """All forces of one kind: names, indices of what each takes, and which of its parameters are given."""

    kind: ForceKind
    names: tuple[str, ...]
    points: tuple[Index, ...]
    vectors: tuple[Index, ...]
    scalars: tuple[Index, ...]
    given: tuple[tuple[int, int, int], ...]


@dataclass(frozen=True)
class FunctionIndex(Remade):
    """A force that the user gives as a function: what it acts on (``"force"``, ``"effort"``, ``"load"``), and where.

    `address` is by what its parameters are called as a design variable.
    """

    noun = "force"
    name: str
    acts: str
    at: int
    function: Callable[..., Any]
    address: str = ""


@dataclass(frozen=True)
class FrictionIndex:
    """Friction of a pin (`bodies`, `point`) or a slider (a joint, or a fixed coordinate of a point).

    `bodies` are numbers, `GROUND` for the ground. `line` of a slider in space: the line's point, its further point (or
    ~vector), and the points that slide on it.
    """

    name: str
    bodies: tuple[int, int] | None
    point: int
    joint: Owner | None
    numbers: Index  # coefficient, speed, radius (of a pin)
    line: Index = ()


@dataclass(frozen=True)
class Loads:
    """Masses and forces of a mechanism."""

    physical: tuple[str, ...] = ()  # names of the physical parameters
    gravity: Index = ()  # which of them are gravity's components, or none
    inertias: tuple[tuple[InertiaIndex, ...], ...] = ()  # the bodies and points with mass, those of one form together
    forces: tuple[ForceBlock, ...] = ()  # the forces of the catalogue's and the user's kinds, grouped by kind
    functions: tuple[FunctionIndex, ...] = ()  # the forces that are functions
    friction: tuple[FrictionIndex, ...] = ()  # frictions of joints
    hidden: tuple[str, ...] = ()  # names of vectors that bodies have for their dynamics only

    @property
    def any(self) -> bool:
        """Tell whether anything has a mass."""
        return bool(self.inertias)


class LoadAssembler:
    """Writes the loads of a description.

    The assembler of the mechanism has written its bodies.
    """

    def __init__(self, assembler: "Assembler"):
        self.a, self.model = assembler, assembler.model
        self.entries: list[tuple[Owner | None, str]] = []
        self.values: list[float] = []
        self.lacking: list[str] = []

    def number(self, owner: Owner | None, key: str, value: float) -> int:
        """Note a physical parameter: of what, and its key there."""
        self.entries.append((owner, key))
        self.values.append(float(value))
        return len(self.values) - 1

    def several(self, owner: Owner | None, keys: Iterable[str], values: Iterable[float] | None) -> Index:
        """Note physical parameters, if they are given; there may be keys for more."""
        return tuple(self.number(owner, *one) for one in zip(keys, values or (), strict=False))

    def loads(self) -> Loads:
        """All loads but for addresses; bodies that lack a third segment are noted in `lacking`."""
        m, axes = self.model, "xyz"[: self.a.dim]
        gravity = self.several(None, (f"gravity.{x}" for x in axes), m.gravity)
        inertias: dict[tuple, list[InertiaIndex]] = {}
        for body in self.a.bodies:
            if self.a.specs[body.name].mass is not None:
                index = self.inertia(body, self.a.specs[body.name])
                inertias.setdefault(index.form, []).append(index)
        for name, mass in m.masses.items():
            p = self.a.index[mass.point]
            of = self.a.owning(Thing.MASS, name)
            where = (p, (), ())
            index = InertiaIndex(
                "", p, (), (), where, where, "point", (p,), self.number(of, "mass", mass.mass), singular=not mass.mass
            )
            inertias.setdefault(index.form, []).append(index)
        forces, functions = self.forces()
        friction = tuple(self.friction(name, f) for name, f in m.friction.items())
        hidden = tuple(self.a.hidden)
        groups = tuple(tuple(group) for group in inertias.values())
        return Loads((), gravity, groups, forces, functions, friction, hidden)

    # -- inertia ------------------------------------------------------------------------------------------------

    def inertia(self, body: "BodyIndex", spec: record.Body) -> InertiaIndex:
        """Where one body's inertia lives."""
        a, name, what = self.a, body.name, f"body {body.name!r}"
        shape = spec.shape or ("given" if spec.inertia is not None else "point")
        redrawn = a.redrawn.get(name, {})
        if a.dim == 2:
            segments = body.segments
            if len(body.points) == 1 and segments and not a.rigid(segments[0]):
                if spec.inertia or spec.com or spec.shape:
                    raise MechanismError(
                        f"{what} turns with a line whose length is not constant, so its inertia has no constant mass "
                        f"matrix; give it a second point, or a mass alone"
                    )
                segments = ()
            frame = segments
            if not segments and (spec.com is not None or spec.shape in ("rod", "plate")):
                raise MechanismError(f"{what} has one point and does not turn; leave com= and shape= out")
            base = body.base
            origin = base[0] if base is not None and len(body.points) > 1 else body.points[0]  # pyright: ignore[reportGeneralTypeIssues]
        else:
            frame, origin = self.frame(body), body.points[0]
            segments = self.three(body, spec)

        def where(at: Mapping[int, int]) -> tuple:
            def of(segment):
                return segment if len(segment) == 1 else tuple(at.get(p, p) for p in segment)

            return at.get(origin, origin), tuple(map(of, segments)), tuple(map(of, frame))

        corners = tuple(redrawn.get(p, p) for p in body.points)
        if shape == "rod":
            corners = corners[:2]
        me = a.owning(Thing.BODY, name)
        mass = self.number(me, "mass", spec.mass or 0.0)
        com = self.several(me, (f"com.{x}" for x in "xyz"[: a.dim]), spec.com)
        if spec.inertia is None or isinstance(spec.inertia, tuple):
            inertia = self.several(me, (f"inertia.{k}" for k in ("xx", "yy", "zz", "xy", "xz", "yz")), spec.inertia)
        else:
            inertia = (self.number(me, "inertia", spec.inertia),)
        keys = {"box": "abc", "cylinder": ("radius", "length"), "sphere": ("radius",)}.get(spec.shape or "", ())
        size = self.several(me, keys, spec.size)
        singular = not spec.mass or bool(segments and not (spec.inertia or spec.shape))
        for segment in segments if a.dim == 2 else ():
            if len(segment) == 2 and spec.mass and isinstance(spec.inertia, float):
                span = a.home[segment[1]] - a.home[segment[0]]
                singular = singular or spec.inertia < 1e-3 * spec.mass * float(span @ span)
        return InertiaIndex(
            name, origin, segments, frame, where({}), where(redrawn), shape, corners, mass, com, inertia, size, singular
        )

    def frame(self, body: "BodyIndex") -> "tuple[Segment, ...]":
        """The segments that a spatial body's shape lies along: as its points and then its vectors are listed.

        Not those of its base, which are chosen for what they share with other bodies.
        """
        if len(body.segments) == 1:
            return body.segments
        start = body.points[0]
        listed: list[Segment] = [(start, p) for p in body.points[1:]] + [(~k,) for k in body.vectors]
        units = {s: self.a.unit(s) for s in listed}
        first = next(s for s in listed if np.any(units[s]))
        sines = {s: float(np.linalg.norm(np.cross(units[first], units[s]))) for s in listed}
        return first, next((s for s in listed if sines[s] > _FLAT), max(sines, key=lambda s: sines[s]))

    def three(self, body: "BodyIndex", spec: record.Body) -> "tuple[Segment, ...]":
        """Three independent segments of a spatial body; the first only for a bar."""
        a = self.a
        if len(body.segments) == 1:
            self.check_bar(body, spec)
            return body.segments
        pairs: list[Segment] = [(i, j) for i, j in combinations(body.points, 2)]
        candidates = [s for s in (*((~k,) for k in body.vectors), *pairs) if s not in body.segments]
        base = [a.unit(s) for s in body.segments[:2]]
        across = np.cross(base[0], base[1])
        area = float(np.linalg.norm(across))
        volumes = [abs(float(a.unit(s) @ across)) / area for s in candidates]
        hidden = {~a.vector_index[n] for n in a.hidden}
        shown = [k for k, s in enumerate(candidates) if s[0] not in hidden]
        best = max(shown, key=lambda k: volumes[k], default=None)
        if best is not None and volumes[best] > _FLAT:
            return (*body.segments[:2], candidates[best])
        own = [k for k, s in enumerate(candidates) if s[0] in hidden]
        if own:
            return (*body.segments[:2], candidates[own[0]])
        self.lacking.append(body.name)
        return body.segments[:2]

    def check_bar(self, body: "BodyIndex", spec: record.Body) -> None:
        """A bar of five freedoms does not know its rotation about its line: it can have no inertia about it."""
        what = f"body {body.name!r}"
        e = self.a.unit(body.segments[0])
        remedy = (
            "give it a point or vector across its line, or no inertia about the line (inertia=… with zero about it, "
            "or shape='rod')"
        )
        if spec.shape in ("plate", "box", "cylinder", "sphere"):
            raise MechanismError(
                f"{what} is a bar of five freedoms, which does not know its rotation about its own line, so it cannot "
                f"be a {spec.shape}; {remedy}"
            )
        if isinstance(spec.inertia, tuple):
            xx, yy, zz, xy, xz, yz = spec.inertia
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            # 1e-9 of the largest moment may be the axial inertia of a bar
            if np.linalg.norm(tensor @ e) > 1e-9 * max(np.abs(tensor).max(), 1e-300):
                raise MechanismError(
                    f"{what} is a bar of five freedoms, which does not know its rotation about its own line, but it is "
                    f"given the inertia {float(e @ tensor @ e):.6g} about it; {remedy}"
                )
        if spec.com is not None:
            w = np.array(spec.com) - self.a.home[body.points[0]]
            if np.linalg.norm(np.cross(w, e)) > 1e-9 * max(self.a.size, 1.0):
                raise MechanismError(f"{what} is a bar, and its centre of mass is drawn off its line; {remedy}")

    # -- forces -------------------------------------------------------------------------------------------------

    def forces(self) -> tuple[tuple[ForceBlock, ...], tuple[FunctionIndex, ...]]:
        """Forces grouped by kind, and functions."""
        a, groups, functions = self.a, {}, []
        for name, f in self.model.forces.items():
            if f.kind.startswith("function: "):
                acts = f.kind.removeprefix("function: ")
                at = a.index[f.points[0]] if f.points else a.scalar(f.scalars[0]) if f.scalars else -1
                functions.append(FunctionIndex(name, acts, at, a.mechanism.functions[name][0].function))
                continue
            kind = a.mechanism.force_kinds.get(f.kind) or CATALOGUE.get(f.kind)
            if kind is None:
                raise MechanismError(f"force {name!r}: unknown kind {f.kind!r}; {nearest(f.kind, CATALOGUE)}")
            of = a.owning(Thing.FORCE, name)
            given = {p: self.number(of, p, v) for p, v in f.parameters.items()}
            groups.setdefault(kind, []).append((name, f, given))
            if kind.drawn is None and (missing := [p for p in kind.parameters if p not in given]):
                raise MechanismError(
                    f"{kind.name} {name!r}: {missing[0]} is not given; it cannot be read off the drawing"
                )
        blocks = []
        for kind, members in groups.items():
            names, forces, numbers = zip(*members, strict=True)
            points = tuple(a.at(*f.points) for f in forces)
            vectors = tuple(tuple(a.vector_index[u] for u in f.vectors) for f in forces)
            scalars = tuple(tuple(map(a.scalar, f.scalars)) for f in forces)
            given = ((i, kind.parameters.index(p), k) for i, some in enumerate(numbers) for p, k in some.items())
            blocks.append(ForceBlock(kind, names, points, vectors, scalars, tuple(given)))
        return tuple(blocks), tuple(functions)

    def friction(self, name: str, f: record.Friction) -> FrictionIndex:
        """Friction of a joint."""
        of = self.a.owning(Thing.FRICTION, name)
        values = [f.coefficient, f.speed, *([] if f.radius is None else [f.radius])]
        numbers = self.several(of, ("coefficient", "speed", "radius"), values)
        a, line = self.a, ()
        if f.bodies is not None:
            assert f.point is not None
            names = [body.name for body in a.bodies]
            first, second = (GROUND if body == "ground" else names.index(body) for body in f.bodies)
            return FrictionIndex(name, (first, second), a.index[f.point], None, numbers)
        if f.joint not in self.model.joints:  # a point that slides with a fixed coordinate
            return FrictionIndex(name, None, a.index[f.point or f.joint or ""], None, numbers)
        if a.dim == 3:
            joint = self.model.joints[f.joint]
            assert isinstance(joint, record.Slot | record.Prismatic | record.Cylindrical)  # no other has friction
            on = joint.point if isinstance(joint, record.Slot) else joint.on
            start, end = joint.line
            places = [n for n in ((on,) if isinstance(on, str) else on) if n in a.index]
            far = a.index[end] if end in a.index else ~a.vector_index[end]
            line = (a.index[start], far, *(a.index[n] for n in places))
        return FrictionIndex(name, None, -1, a.owning(Thing.JOINT, f.joint), numbers, line)
