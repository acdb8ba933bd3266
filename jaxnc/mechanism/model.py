"""What a mechanism is made of, as plain records: the one schema shared by the builder and the model files."""

from typing import Literal

import msgspec

Pair = tuple[str, str]
Direction = str | Pair  # a unit vector by name, or the direction from one point to another
AngleForm = Literal[
    "exact", "cosine", "sine", "sine x", "sine y", "sine z", "sines", "switched", "redundant", "sum", "difference"
]
DistanceForm = Literal["exact", "x", "y", "z", "switched", "redundant", "sum", "difference"]
TextForm = Literal["exact", "text"]
BodyShape = Literal["rod", "plate", "box", "cylinder", "sphere"]


class _Record(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    pass


class Point(_Record):
    """A point as drawn; `fixed` names the coordinates that never change (``"xy"`` is a ground point)."""

    at: tuple[float, ...]
    fixed: str = ""


class Body(_Record):
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


class Marker(_Record):
    """A point (`at`) or a unit vector (`direction`) that rides on a body and adds no unknowns."""

    on: str
    at: tuple[float, ...] | None = None
    direction: tuple[float, ...] | None = None


class Angle(_Record):
    """The angle from `start` to `to` as a coordinate: anticlockwise, in space `about` an axis by the right hand."""

    to: Direction
    at: str | None = None
    start: Direction | None = None
    form: AngleForm = "exact"
    about: Direction | None = None


class Distance(_Record):
    """The distance between two points, or its signed projection `along` a line or vector, as a coordinate."""

    start: str
    to: str
    along: str | Pair | None = None
    form: DistanceForm = "exact"


class Revolute(_Record, tag_field="joint", tag="revolute"):
    """Two bodies pinned where each has a point of its own; in space `axes` are the hinge's axis in each."""

    points: Pair | None = None
    axes: tuple[Direction, Direction] | None = None


class Prismatic(_Record, tag_field="joint", tag="prismatic"):
    """`on` slides along `line` and does not turn.

    In the plane the angle of `line` and `on` stays, in space the angle about the line between the `directions`.
    """

    line: Pair
    on: str | Pair
    directions: tuple[Direction, Direction] | None = None
    form: TextForm = "exact"


class Slot(_Record, tag_field="joint", tag="slot"):
    """A pin that slides along a line."""

    point: str
    line: Pair


class Gear(_Record, tag_field="joint", tag="gear"):
    """Two wheels in mesh, by the angles that measure their rotation from the line of centres."""

    angles: Pair
    radii: tuple[float, float] | None = None
    internal: bool = False
    pressure_angle: float | None = None


class Rolling(_Record, tag_field="joint", tag="rolling"):
    """A disc that rolls along a line, fixed or moving, without slip."""

    centre: str
    rim: str
    contact: str
    line: Pair
    angle: str
    distance: str
    radius: float | None = None
    form: TextForm = "exact"
    axis: Direction | None = None


class Cable(_Record, tag_field="joint", tag="cable"):
    """An inextensible cable through points."""

    points: list[str]
    length: float | None = None


class Weld(_Record, tag_field="joint", tag="weld"):
    """Two bodies that move as one."""

    bodies: Pair


class Spherical(_Record, tag_field="joint", tag="spherical"):
    """A ball joint where each body has a point of its own."""

    points: Pair


class Cylindrical(_Record, tag_field="joint", tag="cylindrical"):
    """`on`, a point (and the axis) of one body, slides along and turns about the `line` of another."""

    line: Pair
    on: str | Pair


class Universal(_Record, tag_field="joint", tag="universal"):
    """A cross whose two arms are the `axes`, one in each body; `points` where the bodies don't share its centre."""

    axes: tuple[Direction, Direction]
    points: Pair | None = None


class Screw(_Record, tag_field="joint", tag="screw"):
    """A cylindrical joint that advances by `lead` per turn, or `pitch` per radian; names two new coordinates."""

    line: Pair
    on: str | Pair
    directions: tuple[Direction, Direction]
    angle: str
    distance: str
    lead: float | None = None
    pitch: float | None = None


class Planar(_Record, tag_field="joint", tag="planar"):
    """A point of one body stays in the plane of another (a point and the normal), and the normals stay parallel."""

    plane: Pair
    on: str | Pair


class BevelGear(_Record, tag_field="joint", tag="bevel gear"):
    """Two wheels in mesh on axes at any angle, by the angles that measure their rotation."""

    angles: Pair
    radii: tuple[float, float] | None = None
    internal: bool = False
    pressure_angle: float | None = None


class RackAndPinion(_Record, tag_field="joint", tag="rack and pinion"):
    """A pinion that rolls on a rack, by the pinion's angle and the rack's distance."""

    angle: str
    distance: str
    radius: float | None = None
    pressure_angle: float | None = None


class ConstantVelocity(_Record, tag_field="joint", tag="constant velocity"):
    """Two shafts whose angles of rotation stay equal: their axes and a mark across each."""

    axes: tuple[Direction, Direction]
    marks: tuple[Direction, Direction]
    points: Pair | None = None


class Skate(_Record, tag_field="joint", tag="skate"):
    """A point that moves along a heading, from one point to another, and never across it."""

    point: str
    heading: Pair


class RollingDisc(_Record, tag_field="joint", tag="rolling disc"):
    """A disc that rolls on a plane of the ground, a point and its normal, without slip in any direction."""

    centre: str
    axis: str
    mark: str
    plane: Pair
    radius: float | None = None


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


class Relation(_Record):
    """A linear relation between scalar coordinates; the constant is read off the drawing if not given."""

    terms: dict[str, float]
    constant: float | None = None


class Constraint(_Record):
    """A constraint of the user's own kind."""

    kind: str
    points: list[str] = []
    vectors: list[str] = []
    scalars: list[str] = []
    constants: dict[str, float] = {}


class PointMass(_Record):
    """A mass concentrated in a point, kg."""

    point: str
    mass: float


class Force(_Record):
    """A force of a kind of the catalogue or of the user's own; what is not given of its parameters is as drawn."""

    kind: str
    points: list[str] = []
    vectors: list[str] = []
    scalars: list[str] = []
    parameters: dict[str, float] = {}


class Friction(_Record):
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


class Simulation(_Record):
    """What `jaxnc simulate` does with a model file: how long, how many times are kept, start values and rates."""

    duration: float | None = None
    times: int = 201
    method: str = "dopri8"
    step: float | None = None
    rtol: float = 1e-9
    start: dict[str, float] = {}
    rates: dict[str, float] = {}


class Units(_Record):
    """What the numbers of a model mean: a label for lengths, and the unit of the angles in its run section."""

    length: str = "m"
    angle: Literal["rad", "deg"] = "rad"


class Drive(_Record, rename={"start": "from", "end": "to"}):
    """How `jaxnc run` moves one input: from, to, the number of poses and its constant rate per second.

    For an input that is an angle all three are in the model's angle unit; they are converted when they are used (see
    `jaxnc.io.drives.sweep_arguments`).
    """

    start: float
    end: float
    poses: int = 361
    rate: float | None = None


class Run(_Record):
    """What `jaxnc run` does with a model file, and by which function of jaxnc."""

    inputs: dict[str, Drive] = {}
    hold: list[str] = []
    analysis: Literal["sweep", "solve_position", "circuit"] = "sweep"
    outputs: list[str] = []


class Model(_Record):
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
