"""The records of a mechanism: the one schema shared by the builder and the model files."""

import copy
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias, get_args

import msgspec
import numpy as np

from jaxnc.errors import MechanismError

if TYPE_CHECKING:
    from jaxnc.mechanism.checks import Checks

Place: TypeAlias = Sequence[float] | np.ndarray
"""A position or direction given by the user, `dim` numbers."""

Pair = tuple[str, str]
Direction = str | Pair  # a unit vector by name, or the direction from one point to another
AngleForm = Literal[
    "exact", "cosine", "sine", "sine x", "sine y", "sine z", "sines", "switched", "redundant", "sum", "difference"
]
DistanceForm = Literal["exact", "x", "y", "z", "switched", "redundant", "sum", "difference"]
TextForm = Literal["exact", "text"]
BodyShape = Literal["rod", "plate", "box", "cylinder", "sphere"]


class _ModelRecord(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    pass


class Point(_ModelRecord):
    """A point as drawn; `fixed` names the coordinates that never change (``"xy"`` is a ground point)."""

    at: tuple[float, ...]
    fixed: str = ""


class Body(_ModelRecord):
    """A rigid body. Lengths (keys ``"B-C"``) and local coordinates win over the drawing."""

    points: list[str]
    vectors: list[str] = []
    lengths: dict[str, float] = {}
    local: dict[str, tuple[float, ...]] = {}
    form: TextForm = "exact"
    along: Pair | None = None
    mass: float | None = None
    com: tuple[float, ...] | None = None
    inertia: float | tuple[float, ...] | None = None
    shape: BodyShape | None = None
    size: tuple[float, ...] = ()


def whole(body: Body | list[str]) -> Body:
    """The record of a body, also of one that is written as a list of its points."""
    return body if isinstance(body, Body) else Body(body)


class Marker(_ModelRecord):
    """A point (`at`) or a unit vector (`direction`) that rides on a body and adds no unknowns."""

    on: str
    at: tuple[float, ...] | None = None
    direction: tuple[float, ...] | None = None


class Angle(_ModelRecord):
    """The angle from `start` to `to` as a coordinate: anticlockwise, in space `about` an axis by the right hand."""

    to: Direction
    at: str | None = None
    start: Direction | None = None
    form: AngleForm = "exact"
    about: Direction | None = None


class Distance(_ModelRecord):
    """The distance between two points, or its signed projection `along` a line or vector, as a coordinate."""

    start: str
    to: str
    along: str | Pair | None = None
    form: DistanceForm = "exact"


class JointRecord(_ModelRecord):
    """A joint, of which a subclass says what it holds together.

    A joint is its record here, a method of the builder, and ``add_<record>`` of the assemblers in `jaxnc.system`.
    """

    noun: ClassVar[str]  # what messages call it
    in_plane: ClassVar[str | None] = None  # of a joint in space only: what to use in the plane, or ""
    makes: ClassVar[bool] = False  # whether its angle and its distance are coordinates that it makes

    @property
    def coordinates(self: Any) -> tuple[str, ...]:
        """Names of the angle and the distance that the joint makes, or none."""
        return (self.angle, self.distance) if self.makes else ()

    def check(self: Any, check: "Checks", what: str) -> "Joint":
        """Check what was given; the record that is written down.

        Here what joints have alike, by the names of their fields: the point of each body, a line and what slides along
        it, a direction of each body.
        """
        fields = self.__struct_fields__
        if "points" in fields and self.points is not None:
            if any(point is None for point in self.points):
                raise MechanismError(f"{what}: give the point of each body, or neither if the bodies share it")
            check.distinct(self.points, what)
        if "on" in fields:
            self.line, self.on = check.slide(self.line, self.on, what)
        for name in ("axes", "marks", "directions"):
            if name in fields:
                setattr(self, name, check.directions(getattr(self, name), what))
        return self


class Revolute(JointRecord, tag_field="joint", tag="revolute"):
    """Two bodies pinned where each has a point of its own; in space `axes` are the hinge's axis in each."""

    noun: ClassVar[str] = "revolute joint"
    points: Pair | None = None
    axes: tuple[Direction, Direction] | None = None

    def check(self, check: "Checks", what: str) -> "Joint":
        if check.model.dim == 2:
            check.distinct(self.points or (None, None), what)
            self.axes = None
            return self
        if self.axes is None:
            raise MechanismError(
                f"{what}: in space it needs its axis in each body, axes=('u', 'v'); bodies that share a point and a "
                f"vector (or two points) need no joint, and a ball joint is spherical()"
            )
        return super().check(check, what)


class Prismatic(JointRecord, tag_field="joint", tag="prismatic"):
    """`on` slides along `line` and does not turn.

    In the plane the angle of `line` and `on` stays, in space the angle about the line between the `directions`.
    """

    noun: ClassVar[str] = "prismatic joint"
    line: Pair
    on: str | Pair
    directions: tuple[Direction, Direction] | None = None
    form: TextForm = "exact"

    def check(self, check: "Checks", what: str) -> "Joint":
        if self.form not in ("exact", "text"):
            raise MechanismError(f"{what}: form={self.form!r}; use 'exact' or 'text'")
        if check.model.dim == 2:
            if self.directions is not None:
                check.in_space(f"{what}: directions=")
            if isinstance(self.on, str):
                raise MechanismError(
                    f"{what}: on= is two points of the sliding body; one, as {self.on!r}, is for slot()"
                )
            self.line, self.on = check.line(self.line, what), check.line(self.on, what)
            return self
        if self.directions is None:
            raise MechanismError(
                f"{what}: in space it also keeps the bodies from turning about the line; give a direction of each "
                f"body that is not along it, directions=('u', 'v')"
            )
        return super().check(check, what)


class Slot(JointRecord, tag_field="joint", tag="slot"):
    """A pin that slides along a line."""

    noun: ClassVar[str] = "slot"
    point: str
    line: Pair

    def check(self, check: "Checks", what: str) -> "Joint":
        check.point(self.point, what)
        self.line, _ = check.slide(self.line, self.point, what)
        return self


class Wheels(JointRecord):
    """Two wheels in mesh, by the angles that measure their rotation."""

    angles: Pair
    radii: tuple[float, float] | None = None
    internal: bool = False
    pressure_angle: float | None = None

    def check(self: Any, check: "Checks", what: str) -> "Joint":
        self.internal, self.pressure_angle = bool(self.internal), check.pressure(self.pressure_angle, what)
        for angle in self.angles:
            check.refuse_unknown(angle, check.model.angles, "angle", what)
        if self.angles[0] == self.angles[1]:
            raise MechanismError(f"{what}: both wheels use the angle {self.angles[0]!r}; give each its own")
        if self.radii is not None:
            try:
                first, second = self.radii
            except (TypeError, ValueError, OverflowError):
                raise MechanismError(f"{what}: radii= are two, one of each wheel; got {self.radii!r}") from None
            self.radii = (check.positive(first, f"{what}: radius 1"), check.positive(second, f"{what}: radius 2"))
        return self


class Gear(Wheels, tag_field="joint", tag="gear"):
    """Two wheels in mesh in the plane, by the angles that measure their rotation from the line of centres."""

    noun: ClassVar[str] = "gear pair"

    def check(self, check: "Checks", what: str) -> "Joint":
        super().check(check, what)
        if check.model.dim == 2:
            return self
        return BevelGear(self.angles, self.radii, self.internal, self.pressure_angle)


class Rolling(JointRecord, tag_field="joint", tag="rolling"):
    """A disc that rolls along a line, fixed or moving, without slip."""

    noun: ClassVar[str] = "rolling joint"
    makes: ClassVar[bool] = True
    centre: str
    rim: str
    contact: str
    line: Pair
    angle: str
    distance: str
    radius: float | None = None
    form: TextForm = "exact"
    axis: Direction | None = None

    def check(self, check: "Checks", what: str) -> "Joint":
        for point in (self.centre, self.rim, self.contact):
            check.point(point, what)
        check.distinct((self.centre, self.rim), what)
        check.distinct((self.centre, self.contact), what)
        self.line = check.axis_line(self.line, what)
        check.new_coordinates(self.angle, self.distance, what)
        if check.model.dim == 3:
            if self.axis is None:
                raise MechanismError(f"{what}: in space the disc needs its axis, axis='u' or two points")
            self.axis = check.direction(self.axis, what)
        elif self.axis is not None:
            check.in_space(f"{what}: axis=")
        if self.form not in (("exact", "text") if check.model.dim == 2 else ("exact",)):
            raise MechanismError(f"{what}: form={self.form!r}; use 'exact' or 'text'")
        self.radius = check.radius(self.radius, what)
        return self


class Cable(JointRecord, tag_field="joint", tag="cable"):
    """An inextensible cable through points."""

    noun: ClassVar[str] = "cable"
    points: list[str]
    length: float | None = None

    def check(self, check: "Checks", what: str) -> "Joint":
        self.points = check.names(self.points, check.model.all_points, what)
        if len(self.points) < 2:
            raise MechanismError(f"{what} needs at least two points, got {self.points}")
        for pair in pairwise(self.points):
            check.distinct(pair, what)
        if self.length is not None:
            self.length = check.positive(self.length, f"{what}: length")
        return self


class Weld(JointRecord, tag_field="joint", tag="weld"):
    """Two bodies that move as one."""

    noun: ClassVar[str] = "weld"
    bodies: Pair

    def check(self, check: "Checks", what: str) -> "Joint":
        for body in self.bodies:
            check.refuse_unknown(body, check.model.bodies, "body", what)
        if self.bodies[0] == self.bodies[1]:
            raise MechanismError(f"{what}: a body cannot be welded to itself ({self.bodies[0]!r})")
        return self


class Spherical(JointRecord, tag_field="joint", tag="spherical"):
    """A ball joint where each body has a point of its own."""

    noun: ClassVar[str] = "spherical joint"
    in_plane: ClassVar[str | None] = "use revolute()"
    points: Pair

    def check(self, check: "Checks", what: str) -> "Joint":
        check.distinct(self.points, what)
        return self


class Cylindrical(JointRecord, tag_field="joint", tag="cylindrical"):
    """`on`, a point (and the axis) of one body, slides along and turns about the `line` of another."""

    noun: ClassVar[str] = "cylindrical joint"
    in_plane: ClassVar[str | None] = ""
    line: Pair
    on: str | Pair


class Universal(JointRecord, tag_field="joint", tag="universal"):
    """A cross whose two arms are the `axes`, one in each body; `points` where the bodies don't share its centre."""

    noun: ClassVar[str] = "universal joint"
    in_plane: ClassVar[str | None] = ""
    axes: tuple[Direction, Direction]
    points: Pair | None = None


class Screw(JointRecord, tag_field="joint", tag="screw"):
    """A cylindrical joint that advances by `lead` per turn, or `pitch` per radian; names two new coordinates."""

    noun: ClassVar[str] = "screw joint"
    in_plane: ClassVar[str | None] = ""
    makes: ClassVar[bool] = True
    line: Pair
    on: str | Pair
    directions: tuple[Direction, Direction]
    angle: str
    distance: str
    lead: float | None = None
    pitch: float | None = None

    def check(self, check: "Checks", what: str) -> "Joint":
        super().check(check, what)
        check.new_coordinates(self.angle, self.distance, what)
        if (self.lead is None) == (self.pitch is None):
            raise MechanismError(f"{what}: give its lead (advance per turn) or its pitch (advance per radian)")
        advances = (self.lead, self.pitch)
        self.lead, self.pitch = (None if x is None else check.finite(x, f"{what}: lead or pitch") for x in advances)
        return self


class Planar(JointRecord, tag_field="joint", tag="planar"):
    """A point of one body stays in the plane of another (a point and the normal), and the normals stay parallel."""

    noun: ClassVar[str] = "planar joint"
    in_plane: ClassVar[str | None] = "in the plane every body has these freedoms"
    plane: Pair
    on: str | Pair

    def check(self, check: "Checks", what: str) -> "Joint":
        vectors = check.model.all_vectors
        for spec in (self.plane, self.on):
            if spec is self.on and isinstance(spec, str):
                continue
            if not isinstance(spec, (tuple, list)) or len(spec) != 2 or spec[1] not in vectors:
                raise MechanismError(f"{what}: a plane is a point and its normal vector, ('P', 'n'); got {spec!r}")
        self.plane, self.on = check.slide(self.plane, self.on, what)
        return self


class BevelGear(Wheels, tag_field="joint", tag="bevel gear"):
    """Two wheels in mesh on axes at any angle, by the angles that measure their rotation."""

    noun: ClassVar[str] = "bevel gear"
    in_plane: ClassVar[str | None] = "use gear()"


class RackAndPinion(JointRecord, tag_field="joint", tag="rack and pinion"):
    """A pinion that rolls on a rack, by the pinion's angle and the rack's distance."""

    noun: ClassVar[str] = "rack and pinion"
    in_plane: ClassVar[str | None] = "use rolling(), or relation({distance: 1, angle: -radius})"
    angle: str
    distance: str
    radius: float | None = None
    pressure_angle: float | None = None

    def check(self, check: "Checks", what: str) -> "Joint":
        check.refuse_unknown(self.angle, check.model.angles, "angle", what)
        check.refuse_unknown(self.distance, check.model.distances, "distance", what)
        self.radius = check.radius(self.radius, what)
        self.pressure_angle = check.pressure(self.pressure_angle, what)
        return self


class ConstantVelocity(JointRecord, tag_field="joint", tag="constant velocity"):
    """Two shafts whose angles of rotation stay equal: their axes and a mark across each."""

    noun: ClassVar[str] = "constant-velocity joint"
    in_plane: ClassVar[str | None] = ""
    axes: tuple[Direction, Direction]
    marks: tuple[Direction, Direction]
    points: Pair | None = None


class Skate(JointRecord, tag_field="joint", tag="skate"):
    """A point that moves along a heading, from one point to another, and never across it."""

    noun: ClassVar[str] = "skate"
    point: str
    heading: Pair

    def check(self, check: "Checks", what: str) -> "Joint":
        if check.model.dim == 3:
            raise MechanismError(f"{what}: in space use rolling_disc(), or constrain() with a RateKind")
        check.point(self.point, what)
        self.heading = check.line(self.heading, what)
        return self


class RollingDisc(JointRecord, tag_field="joint", tag="rolling disc"):
    """A disc that rolls on a plane of the ground, a point and its normal, without slip in any direction."""

    noun: ClassVar[str] = "rolling disc"
    in_plane: ClassVar[str | None] = "use rolling() or skate()"
    centre: str
    axis: str
    mark: str
    plane: Pair
    radius: float | None = None

    def check(self, check: "Checks", what: str) -> "Joint":
        check.point(self.centre, what)
        for vector in (self.axis, self.mark):
            check.vector(vector, what)
        if self.axis == self.mark:
            raise MechanismError(
                f"{what}: axis and mark are both {self.axis!r}; give another vector of the disc as mark="
            )
        if not isinstance(self.plane, (tuple, list)) or len(self.plane) != 2:
            raise MechanismError(f"{what}: a plane is a point and its normal vector, ('O', 'n'); got {self.plane!r}")
        point, normal = self.plane
        if point not in check.model.ground or normal not in check.model.ground_vectors:
            raise MechanismError(
                f"{what}: its plane must be of the ground: a point of ground() and a ground_vector(); got "
                f"{self.plane!r}"
            )
        self.plane, self.radius = (point, normal), check.radius(self.radius, what)
        return self


Joint = (
    Revolute
    | Prismatic
    | Slot
    | Gear
    | Rolling
    | Cable
    | Weld
    | Spherical
    | Cylindrical
    | Universal
    | Screw
    | Planar
    | BevelGear
    | RackAndPinion
    | ConstantVelocity
    | Skate
    | RollingDisc
)


class Relation(_ModelRecord):
    """A linear relation between scalar coordinates; the constant is read off the drawing if not given."""

    terms: dict[str, float]
    constant: float | None = None


class Constraint(_ModelRecord):
    """A constraint of the user's own kind."""

    kind: str
    points: list[str] = []
    vectors: list[str] = []
    scalars: list[str] = []
    constants: dict[str, float] = {}


class PointMass(_ModelRecord):
    """A mass concentrated in a point, kg."""

    point: str
    mass: float


class Force(_ModelRecord):
    """A force of a kind of the catalogue or of the user's own; what is not given of its parameters is as drawn."""

    kind: str
    points: list[str] = []
    vectors: list[str] = []
    scalars: list[str] = []
    parameters: dict[str, float] = {}


class Friction(_ModelRecord):
    """Coulomb friction proportional to a joint's reaction.

    Between two `bodies` pinned at a shared `point`, with the pin's `radius`; or at a sliding `joint`; or at a `point`
    alone, which slides with a fixed coordinate.
    """

    coefficient: float
    bodies: Pair | None = None
    point: str | None = None
    radius: float | None = None
    joint: str | None = None
    speed: float = 1e-3


class Simulation(_ModelRecord):
    """A simulation, as `jaxnc simulate` does it: how long, how many times are kept, start values and rates."""

    duration: float | None = None
    times: int = 201
    method: str = "dopri8"
    step: float | None = None
    rtol: float | None = None
    start: dict[str, float] = {}
    rates: dict[str, float] = {}


class Units(_ModelRecord):
    """Units of a model's numbers: a label for lengths, and the unit of the angles in its run section."""

    length: str = "m"
    angle: Literal["rad", "deg"] = "rad"


class Drive(_ModelRecord, rename={"start": "from", "end": "to"}):
    """How `jaxnc run` moves one input: from, to, the number of poses and its constant rate per second.

    For an input that is an angle all three are in the model's angle unit; they are converted when they are used (see
    `jaxnc.io.drives.sweep_arguments`).
    """

    start: float
    end: float
    poses: int = 361
    rate: float | None = None


class Run(_ModelRecord):
    """An analysis, as `jaxnc run` does it, and the function of jaxnc that does it."""

    inputs: dict[str, Drive] = {}
    hold: list[str] = []
    analysis: Literal["sweep", "solve_position", "circuit"] = "sweep"
    outputs: list[str] = []


class Model(_ModelRecord):
    """A whole mechanism."""

    name: str = "mechanism"
    dim: Literal[2, 3] = 2
    description: str = ""
    units: Units = msgspec.field(default_factory=Units)
    ground: dict[str, tuple[float, ...]] = {}
    points: dict[str, tuple[float, ...] | Point] = {}
    ground_vectors: dict[str, tuple[float, ...]] = {}
    vectors: dict[str, tuple[float, ...]] = {}
    bodies: dict[str, list[str] | Body] = {}
    markers: dict[str, Marker] = {}
    angles: dict[str, Angle] = {}
    distances: dict[str, Distance] = {}
    joints: dict[str, Joint] = {}
    relations: dict[str, Relation] = {}
    constraints: dict[str, Constraint] = {}
    gravity: tuple[float, ...] | None = None
    masses: dict[str, PointMass] = {}
    forces: dict[str, Force] = {}
    friction: dict[str, Friction] = {}
    simulate: Simulation = msgspec.field(default_factory=Simulation)
    run: Run = msgspec.field(default_factory=Run)

    @property
    def all_points(self) -> tuple[str, ...]:
        """Names of ground points and points, in order."""
        return (*self.ground, *self.points)

    @property
    def all_vectors(self) -> tuple[str, ...]:
        """Names of ground vectors and vectors, in order."""
        return (*self.ground_vectors, *self.vectors)

    @property
    def axes(self) -> str:
        """The axes of the mechanism's space, ``"xy"`` or ``"xyz"``."""
        return "xyz"[: self.dim]

    @property
    def scalar_names(self) -> tuple[str, ...]:
        """Names of the mixed coordinates, in order: angles, distances, then those that joints make."""
        return (*self.angles, *self.distances, *(s for j in self.joints.values() for s in j.coordinates))

    @property
    def angle_names(self) -> tuple[str, ...]:
        """Names of all angles, those that joints make too."""
        return (*self.angles, *(j.coordinates[0] for j in self.joints.values() if j.coordinates))


# -- other forms of the same ---------------------------------------------------------------------------------------


def angle_forms(dim: int) -> list[str]:
    """The forms of an angle in the plane, or in space."""
    missing = ("sum", "difference") if dim == 3 else ("sine x", "sine y", "sine z", "sines")
    return [f for f in get_args(AngleForm) if f not in missing]


def distance_forms(dim: int) -> list[str]:
    """The forms of a distance along a line in the plane, or in space."""
    missing = ("sum", "difference") if dim == 3 else ("z",)
    return [f for f in get_args(DistanceForm) if f not in missing]


def in_form(model: Model, form: Any, angle: Any, distance: Any) -> Model:
    """Write every body, joint, angle and distance of a model in one form; see `Mechanism.in_form`."""
    for what, given, forms in (
        ("form", form, list(get_args(TextForm))),
        ("angle", angle, [None, *angle_forms(model.dim)]),
        ("distance", distance, [None, *distance_forms(model.dim)]),
    ):
        if given not in forms:
            raise MechanismError(f"in_form: {what}={given!r}; use one of {', '.join(filter(None, forms))}")
    text = form == "text"
    out = copy.deepcopy(model)
    for name, body in out.bodies.items():
        body = out.bodies[name] = whole(body)
        body.form = form
    for joint in out.joints.values():
        if isinstance(joint, Prismatic) or (isinstance(joint, Rolling) and out.dim == 2):
            joint.form = form
    for data in out.angles.values():
        # In space an angle that is counted from the drawing has no form of the text.
        if out.dim == 2 or data.start is not None:
            data.form = angle or ("cosine" if text else "exact")
    for data in out.distances.values():
        if data.along is not None:
            chosen: Any = _steepest_axis(out, data) if text else "exact"
            data.form = distance or chosen
    return out


def _steepest_axis(model: Model, data: Distance) -> str:
    """The coordinate along which a distance's line is drawn most, as the text chooses among (41)-(42), (147)-(149)."""
    vectors = {**model.ground_vectors, **model.vectors}
    if isinstance(data.along, str) and data.along in vectors:
        d = np.array(vectors[data.along])
    else:
        assert data.along is not None
        first, second = (data.start, data.along) if isinstance(data.along, str) else data.along
        d = _drawn_point(model, second) - _drawn_point(model, first)
    return "xyz"[int(np.argmax(np.abs(d)))]


def _drawn_point(model: Model, point: str) -> np.ndarray:
    at = model.ground[point] if point in model.ground else model.points[point]
    return np.array(at.at if isinstance(at, Point) else at)
