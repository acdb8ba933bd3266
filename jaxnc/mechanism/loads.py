"""Masses and forces, as builder methods: numbers become design variables, functions stay functions."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NoReturn, get_args

import msgspec
import numpy as np

from jaxnc.errors import CallError, MechanismError, brief, nearest
from jaxnc.mechanism import model as record
from jaxnc.mechanism.place import Place
from jaxnc.mechanism.restitution import loss
from jaxnc.mechanism.spatial_joints import SpatialJointBuilder
from jaxnc.pickling import Remade

if TYPE_CHECKING:
    from jaxnc.forces import ForceKind

    Functions = dict[str, tuple["Acting", Any]]

_SIZES = {  # of a shape, in the plane and in space
    "rod": ((), ()),
    "plate": ((), ()),
    "box": (("a", "b"), ("a", "b", "c")),
    "cylinder": (("radius",), ("radius", "length")),
    "sphere": (("radius",), ("radius",)),
}
_ORDER = (0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)  # xx, yy, zz, xy, xz, yz


@dataclass(frozen=True)
class Acting(Remade):
    """A function that is a force."""

    noun = "force"
    name: str
    function: Callable[..., Any]


class Fall(tuple):
    """Acceleration of free fall, empty for none; whoever calls it is told that it is set."""

    __slots__ = ()

    def __call__(self, *given: Any, **named: Any) -> NoReturn:
        """Refuse, in words."""
        raise CallError(
            "gravity is set, not called: m.gravity = (0, -9.81), or (0, 0, -9.81) in space; its length unit is that of "
            "the drawing"
        )


class LoadBuilder(SpatialJointBuilder):
    """The part of `Mechanism` that adds masses and forces."""

    force_kinds: "dict[str, ForceKind]"
    functions: "Functions"

    # -- masses -------------------------------------------------------------------------------------------------

    @property
    def gravity(self) -> tuple[float, ...]:
        """Acceleration of free fall, such as ``(0, -9.81)``; empty for none. A design variable by components."""
        return Fall(self.model.gravity or ())

    @gravity.setter
    def gravity(self, value: Place | None) -> None:
        none = value is None or (isinstance(value, Fall) and not value)
        self.model.gravity = None if none else self._place(value, "gravity")

    def point_mass(self, name: str, point: str, mass: float) -> str:
        """Add a mass concentrated in a point.

        Args:
            name: its name.
            point: the point.
            mass: kg.

        Raises:
            MechanismError: unknown point, name already taken, negative mass.
        """
        what = f"point mass {name!r}"
        self._new_name(name, self.model.masses, "point mass")
        self._known_point(point, what)
        self.model.masses[name] = record.PointMass(point, self._not_negative(mass, f"{what}: mass"))
        return name

    def mass(
        self,
        body: str,
        mass: float,
        com: Place | None = None,
        inertia: Any = None,
        shape: str | None = None,
        size: Sequence[float] = (),
    ) -> str:
        """Give a body that is already there its mass; the arguments are those of `body`.

        Returns:
            The name of the body.

        Raises:
            MechanismError: unknown body, or an inertia that it cannot have.
        """
        if body not in self.model.bodies:
            raise MechanismError(f"mass: unknown body {body!r}; {nearest(body, self.model.bodies)}")
        spec = self.model.bodies[body]
        spec = spec if isinstance(spec, record.Body) else record.Body(spec)
        plain = {"mass": None, "com": None, "inertia": None, "shape": None, "size": ()}
        spec = msgspec.structs.replace(spec, **plain)
        self._inertia(spec, f"body {body!r}", mass, com, inertia, shape, size)
        self.model.bodies[body] = spec
        return body

    def _not_negative(self, value: Any, what: str) -> float:
        number = self._finite(value, what)
        if number < 0:
            raise MechanismError(f"{what} cannot be negative, got {value!r}")
        return number

    def _inertia(self, spec: record.Body, what: str, mass, com, inertia, shape, size) -> None:
        """Write what is said about a body's inertia into its record."""
        size = self._numbers(size, f"{what}: size")
        given = {"com": com, "inertia": inertia, "shape": shape, "size": size or None}
        if mass is None:
            if extra := [k for k, v in given.items() if v is not None]:
                raise MechanismError(f"{what}: {extra[0]}= without a mass; give mass= as well")
            return
        spec.mass = self._not_negative(mass, f"{what}: mass")
        if com is not None:
            spec.com = self._place(com, f"{what}: centre of mass")
        if shape is not None:
            if shape not in get_args(record.BodyShape):
                raise MechanismError(f"{what}: shape={shape!r}; {nearest(str(shape), get_args(record.BodyShape))}")
            if inertia is not None:
                raise MechanismError(f"{what}: both inertia= and shape= are given; give one of them")
            wanted = _SIZES[shape][self.model.dim - 2]
            if len(size) != len(wanted):
                form = f"size=({', '.join(wanted)})" if wanted else "no size, it is read off its points"
                raise MechanismError(f"{what}: a {shape} has {form}; got {len(size)} numbers")
            spec.size = tuple(self._positive(s, f"{what}: size {n}") for s, n in zip(size, wanted, strict=True))
            least = {"rod": 2, "plate": 3}.get(shape, 1)
            if len(spec.points) < least:
                raise MechanismError(f"{what}: a {shape} needs {least} points, it has {len(spec.points)}")
            spec.shape = shape
            return
        if size:
            raise MechanismError(f"{what}: size= without a shape; give shape='box', 'cylinder' or 'sphere'")
        if inertia is not None:
            spec.inertia = self._tensor(inertia, what)
            return
        if len(spec.points) == 2 and not spec.vectors and com is None:
            spec.shape = "rod"
        elif len(spec.points) + len(spec.vectors) > 1 and spec.mass:
            raise MechanismError(
                f"{what} has a mass but no inertia, and only a body of two points is a rod by default; give "
                f"inertia= (and com=), or shape= one of {', '.join(get_args(record.BodyShape))}"
            )

    def _numbers(self, values: Any, what: str) -> tuple[float, ...]:
        """A number, or several."""
        several = isinstance(values, list | tuple) or np.ndim(values) == 1
        return tuple(self._finite(x, what) for x in (values if several else (values,)))

    def _tensor(self, inertia: Any, what: str) -> float | tuple[float, ...]:
        try:
            values = np.asarray(inertia, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise MechanismError(f"{what}: inertia must be numbers, got {inertia!r}") from None
        if not np.all(np.isfinite(values)):
            raise MechanismError(f"{what}: inertia must be finite, got {inertia!r}")
        if self.model.dim == 2:
            if values.shape != ():
                raise MechanismError(f"{what}: in the plane inertia is one number, got shape {values.shape}")
            return self._not_negative(values, f"{what}: inertia")
        if values.shape == (3,):
            values = np.diag(values)
        elif values.shape == (6,):
            full = np.zeros((3, 3))
            for (i, j), value in zip(_ORDER, values, strict=True):
                full[i, j] = full[j, i] = value
            values = full
        if values.shape != (3, 3):
            raise MechanismError(
                f"{what}: in space inertia is a matrix (3, 3), its diagonal, or (xx, yy, zz, xy, xz, yz); got shape "
                f"{values.shape}"
            )
        size = float(np.abs(values).max()) or 1.0
        if np.abs(values - values.T).max() > 1e-9 * size:
            raise MechanismError(f"{what}: its inertia tensor is not symmetric; give a symmetric one")
        principal = np.linalg.eigvalsh(values)
        shown = ", ".join(f"{p:.6g}" for p in principal)
        if principal[0] < -1e-9 * size or principal[2] > principal[0] + principal[1] + 1e-9 * size:
            raise MechanismError(
                f"{what}: no body has this inertia tensor: its principal moments {shown} must be positive, and none "
                f"larger than the sum of the others; check the signs of the products of inertia, and that it is about "
                f"the centre of mass"
            )
        return tuple(float(values[i, j]) for i, j in _ORDER)

    # -- forces -------------------------------------------------------------------------------------------------

    def spring(
        self,
        name: str,
        start: str,
        to: str | None = None,
        *,
        stiffness: float,
        free: float | None = None,
        preload: float = 0.0,
        cubic: float = 0.0,
    ) -> str:
        """Add a spring between two points, or on a coordinate (torsional on an angle).

        Its force against lengthening by x beyond its free length is ``preload + stiffness x + cubic x³``.

        Args:
            name: its name.
            start: a point; or the coordinate it acts on, an angle or distance.
            to: the other point.
            stiffness: N/m, on an angle N m/rad.
            free: free length (angle); as drawn if not given.
            preload: force (moment) at the free length.
            cubic: N/m³.

        Returns:
            The name. Its parameters are design variables, ``<name>.stiffness``, …

        Raises:
            MechanismError: unknown point or coordinate, name already taken, numbers that no spring has.
        """
        return self._pair_or_scalar(
            "spring",
            name,
            start,
            to,
            {"stiffness": stiffness, "free": free, "preload": preload, "cubic": cubic},
            ("free",),
        )

    def damper(self, name: str, start: str, to: str | None = None, *, damping: float, quadratic: float = 0.0) -> str:
        """Add a damper between two points, or on a coordinate; its force is ``damping u + quadratic u|u|``.

        Args:
            name: its name.
            start: a point; or the coordinate it acts on.
            to: the other point.
            damping: N s/m, on an angle N m s/rad.
            quadratic: N s²/m².
        """
        return self._pair_or_scalar("damper", name, start, to, {"damping": damping, "quadratic": quadratic})

    def stop(
        self,
        name: str,
        start: str,
        to: str | None = None,
        *,
        stiffness: float,
        lower: float | None = None,
        upper: float | None = None,
        damping: float = 0.0,
        restitution: float | None = None,
        speed: float | None = None,
    ) -> str:
        """Add elastic stops of the distance of two points, or of a coordinate: end stops, bumpers.

        Pressed in by x they push back with ``stiffness x + damping x ẋ``, without a jump where they are touched.

        Args:
            name: its name.
            start: a point; or the coordinate.
            to: the other point.
            stiffness: N/m (N m/rad) beyond a stop.
            lower: where the lower stop is; none if not given.
            upper: where the upper stop is.
            damping: N s/m for each metre that the stop is pressed in.
            restitution: instead of damping: which part of its speed is left to what comes in with `speed`, whatever
                its mass; above 0, at most 1.
            speed: the speed (m/s, rad/s) at which `restitution` holds; slower ones keep more.

        Raises:
            MechanismError: neither stop is given, a restitution out of range or without its speed.

        Source: K. H. Hunt and F. R. E. Crossley, Coefficient of restitution interpreted as damping in vibroimpact, J.
        Appl. Mech. 42 (1975).
        """
        if lower is None and upper is None:
            raise MechanismError(f"stop {name!r}: give lower=, upper= or both")
        if lower is not None and upper is not None:
            low, high = self._finite(lower, f"stop {name!r}: lower"), self._finite(upper, f"stop {name!r}: upper")
            if low >= high:
                raise MechanismError(f"stop {name!r}: lower = {low:g} must be below upper = {high:g}")
        if (restitution is None) != (speed is None) or (restitution is not None and damping):
            raise MechanismError(
                f"stop {name!r}: give damping=, or restitution= together with the speed= at which it holds"
            )
        if restitution is not None and speed is not None:
            part = self._positive(restitution, f"stop {name!r}: restitution")
            if part > 1:
                raise MechanismError(f"stop {name!r}: restitution = {part:g} would make energy; at most 1")
            rate = self._positive(speed, f"stop {name!r}: speed")
            damping = loss(part) * self._positive(stiffness, f"stop {name!r}: stiffness") / rate
        values = {"stiffness": stiffness, "lower": lower, "upper": upper, "damping": damping}
        return self._pair_or_scalar("stop", name, start, to, values, ("lower", "upper"))

    def _pair_or_scalar(
        self, kind: str, name: str, start: str, to: str | None, values: Mapping[str, Any], optional: Sequence[str] = ()
    ) -> str:
        from jaxnc.forces import CATALOGUE

        given: dict[str, Any] = {k: v for k, v in values.items() if v is not None or k not in optional}
        if to is None:
            return self.apply(name, CATALOGUE[f"coordinate {kind}"], scalars=[start], parameters=given)
        return self.apply(name, CATALOGUE[kind], points=[start, to], parameters=given)

    def force(self, name: str, point: str, value: Any, parameters: Any = None) -> str:
        """Add a force on a point.

        Args:
            name: its name.
            point: the point.
            value: components in the ground's axes, N; or a function ``f(t, state, parameters)`` that returns them (see
                `jaxnc.dynamics.model.State`).
            parameters: what the function gets: any pytree of float arrays, design variables all.
        """
        self._new_name(name, self.model.forces, "force")
        self._known_point(point, f"force {name!r}")
        if callable(value):
            return self._function(name, "force", [point], [], value, parameters)
        from jaxnc.forces import FORCE, FORCE_IN_SPACE

        place = self._place(value, f"force {name!r}")
        kind = FORCE if self.model.dim == 2 else FORCE_IN_SPACE
        return self.apply(name, kind, points=[point], parameters=dict(zip(self.axes, place, strict=True)))

    def torque(self, name: str, coordinate: str, value: Any, parameters: Any = None) -> str:
        """Add an effort on a coordinate: a torque on an angle, a force along a distance (an actuator).

        Args:
            name: its name.
            coordinate: the angle or distance, or a single coordinate such as ``"P.x"``.
            value: N m or N; or a function ``f(t, state, parameters)`` that returns it.
            parameters: what the function gets: any pytree of float arrays.
        """
        self._new_name(name, self.model.forces, "force")
        self._known_scalar(coordinate, f"torque {name!r}")
        if callable(value):
            return self._function(name, "effort", [], [coordinate], value, parameters)
        from jaxnc.forces import EFFORT

        return self.apply(name, EFFORT, scalars=[coordinate], parameters={"value": value})

    def load(self, name: str, function: Callable[..., Any], parameters: Any = None) -> str:
        """Add a generalised force of one's own on all coordinates.

        Args:
            name: its name, for reports and messages.
            function: pure, ``(t, q, v, parameters) -> (N,)``, in the order of ``system.topology.coordinates``.
            parameters: any pytree of float arrays, design variables all.
        """
        return self._function(name, "load", [], [], function, parameters)

    def apply(
        self,
        name: str,
        kind: "ForceKind",
        points: Sequence[str] = (),
        vectors: Sequence[str] = (),
        scalars: Sequence[str] = (),
        parameters: Mapping[str, float] | None = None,
    ) -> str:
        """Add a force of any kind, the catalogue's or the user's own (see `jaxnc.forces.ForceKind`).

        Args:
            name: its name.
            kind: the kind.
            points: names of its points, as many as the kind takes.
            vectors: names of its unit vectors.
            scalars: names of its scalar coordinates.
            parameters: values by name; the rest is as drawn.

        Raises:
            MechanismError: wrong number of points, unknown names, parameters missing, negative or not finite.
        """
        self._new_name(name, self.model.forces, "force")
        if not hasattr(kind, "potential"):
            raise MechanismError(f"force {name!r}: after its name comes a kind of force, a ForceKind; got {kind!r}")
        what = f"{kind.name} {name!r}"
        points = self._listed(points, self.all_points, what)
        vectors = self._listed(vectors, self.all_vectors, what, "vector")
        scalars = self._listed(scalars, self.scalar_names, what, "scalar")
        if (len(points), len(vectors), len(scalars)) != (kind.points, kind.vectors, kind.scalars):
            raise MechanismError(
                f"{what}: takes {kind.points} points, {kind.vectors} vectors and {kind.scalars} coordinates, got "
                f"{len(points)}, {len(vectors)} and {len(scalars)}"
            )
        for p in points:
            self._known_point(p, what)
        if len(set(points)) != len(points):
            raise MechanismError(f"{what} needs different points, got {', '.join(points)}")
        for u in vectors:
            self._known_vector(u, what)
        for s in scalars:
            self._known_scalar(s, what)
        values = {}
        for key, value in (parameters or {}).items():
            if key not in kind.parameters:
                raise MechanismError(f"{what}: unknown parameter {key!r}; {nearest(key, kind.parameters)}")
            check = self._not_negative if key in kind.positive else self._finite
            values[key] = check(value, f"{what}: {key}")
        if self.force_kinds.setdefault(kind.name, kind) != kind:
            raise MechanismError(f"{what}: another kind is already called {kind.name!r}; give yours its own name")
        self.model.forces[name] = record.Force(kind.name, list(points), list(vectors), list(scalars), values)
        return name

    def _function(self, name, kind, points, scalars, function, parameters) -> str:
        if not callable(function):
            raise MechanismError(f"force {name!r}: expected a function of (t, …, parameters), got {function!r}")
        self._new_name(name, self.model.forces, "force")
        self.model.forces[name] = record.Force(f"function: {kind}", points, [], scalars)
        self.functions[name] = (Acting(name, function), () if parameters is None else parameters)
        return name

    def friction(
        self,
        name: str,
        *,
        coefficient: float,
        bodies: tuple[str, str] | None = None,
        at: str | None = None,
        radius: float | None = None,
        joint: str | None = None,
        speed: float = 1e-3,
    ) -> str:
        """Add Coulomb friction, proportional to the reaction of a joint.

        Args:
            name: its name.
            coefficient: coefficient of friction.
            bodies: two bodies pinned to each other at the point `at`, in space by a hinge or a ball; ``"ground"`` for
                the ground.
            at: the point that the bodies share; alone, a point that slides with a fixed coordinate.
            radius: radius of the pin or ball, a length.
            joint: instead of `bodies`: a slot, prismatic or cylindrical joint (which rubs along its line); or a point
                that slides with a fixed coordinate, where no joint has its name.
            speed: sliding speed (m/s) within which the force is smoothed: ``tanh(v / speed)``.
        """
        what = f"friction {name!r}"
        self._new_name(name, self.model.friction, "friction")
        values: dict[str, Any] = {
            "coefficient": self._not_negative(coefficient, f"{what}: coefficient"),
            "speed": self._positive(speed, f"{what}: speed"),
        }
        sliding = [n for n, j in self.model.joints.items() if isinstance(j, _SLIDING)]
        guided = [n for n, p in self.model.points.items() if isinstance(p, record.Point) and p.fixed]
        if joint is not None:
            if joint not in (*sliding, *guided):
                raise MechanismError(f"{what}: no slot, prismatic or cylindrical joint or guided point {joint!r}; "
                                     f"{nearest(joint, [*sliding, *guided])}")  # fmt: skip
            # A joint and a point may have one name: what is meant is written down where it is said.
            values["joint" if joint in sliding else "point"] = joint
            self.model.friction[name] = record.Friction(**values)
            return name
        if bodies is None and radius is None and at in guided:
            self.model.friction[name] = record.Friction(**values, point=at)
            return name
        if bodies is None or at is None or radius is None:
            raise MechanismError(
                f"{what}: give bodies=, at= and radius= of a pin, joint= of a slider, or at= of a point with a fixed "
                f"coordinate"
            )
        self._known_point(at, what)
        pair = self._listed(bodies, self.model.bodies, what, "body")
        if len(pair) != 2:
            raise MechanismError(f"{what}: bodies= are two, such as ('crank', 'ground'); got {brief(bodies)}")
        for body in pair:
            if body == "ground":
                if at not in self.model.ground:
                    raise MechanismError(f"{what}: {at!r} is no point of the ground")
            elif body not in self.model.bodies:
                raise MechanismError(f"{what}: unknown body {body!r}; {nearest(body, self.model.bodies)}")
            elif at not in _points(self.model.bodies[body]):
                raise MechanismError(f"{what}: body {body!r} has no point {at!r}; name a point that both bodies share")
        radius = self._positive(radius, f"{what}: radius")
        self.model.friction[name] = record.Friction(**values, bodies=(pair[0], pair[1]), point=at, radius=radius)
        return name


_SLIDING = record.Slot | record.Prismatic | record.Cylindrical


def _points(body: Any) -> list[str]:
    return body.points if isinstance(body, record.Body) else body
