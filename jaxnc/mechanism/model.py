"""What a mechanism is made of, as plain records: the one schema shared by the builder and the model files."""

from typing import Literal

import msgspec

Pair = tuple[str, str]
AngleForm = Literal["exact", "cosine", "sine", "switched", "redundant", "sum", "difference"]
DistanceForm = Literal["exact", "x", "y", "switched", "redundant", "sum", "difference"]
TextForm = Literal["exact", "text"]


class _Record(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    pass


class Point(_Record):
    """A point as drawn; `fixed` names the coordinates that never change (``"xy"`` is a ground point)."""

    at: tuple[float, ...]
    fixed: str = ""


class Body(_Record):
    """A rigid body. Lengths (keys ``"B-C"``) and local coordinates win over the drawing."""

    points: list[str]
    lengths: dict[str, float] = {}
    local: dict[str, tuple[float, ...]] = {}
    form: TextForm = "exact"
    along: Pair | None = None


class Marker(_Record):
    """A point that rides on a body and adds no unknowns."""

    on: str
    at: tuple[float, ...]


class Angle(_Record):
    """The angle from `start` (x axis if none) to `to`, anticlockwise, as a coordinate."""

    to: str | Pair
    at: str | None = None
    start: str | Pair | None = None
    form: AngleForm = "exact"


class Distance(_Record):
    """The distance between two points, or its signed projection `along` a line, as a coordinate."""

    start: str
    to: str
    along: str | Pair | None = None
    form: DistanceForm = "exact"


class Revolute(_Record, tag_field="joint", tag="revolute"):
    """Two bodies pinned where each has a point of its own."""

    points: Pair


class Prismatic(_Record, tag_field="joint", tag="prismatic"):
    """`on[0]` slides along `line`, and the angle between `line` and `on` stays."""

    line: Pair
    on: Pair
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


class Cable(_Record, tag_field="joint", tag="cable"):
    """An inextensible cable through points."""

    points: list[str]
    length: float | None = None


class Weld(_Record, tag_field="joint", tag="weld"):
    """Two bodies that move as one."""

    bodies: Pair


Joint = Revolute | Prismatic | Slot | Gear | Rolling | Cable | Weld


class Relation(_Record):
    """A linear relation between scalar coordinates; the constant is read off the drawing if not given."""

    terms: dict[str, float]
    constant: float | None = None


class Constraint(_Record):
    """A constraint of the user's own kind."""

    kind: str
    points: list[str] = []
    scalars: list[str] = []
    constants: dict[str, float] = {}


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
    """What `jaxnc run` does with a model file."""

    inputs: dict[str, Drive] = {}
    hold: list[str] = []
    method: Literal["continuation", "lanes", "arc"] = "continuation"
    outputs: list[str] = []


class Model(_Record):
    """A whole mechanism."""

    name: str = "mechanism"
    dim: Literal[2] = 2
    description: str = ""
    units: Units = msgspec.field(default_factory=Units)
    ground: dict[str, tuple[float, ...]] = {}
    points: dict[str, tuple[float, ...] | Point] = {}
    bodies: dict[str, list[str] | Body] = {}
    markers: dict[str, Marker] = {}
    angles: dict[str, Angle] = {}
    distances: dict[str, Distance] = {}
    joints: dict[str, Joint] = {}
    relations: dict[str, Relation] = {}
    constraints: dict[str, Constraint] = {}
    run: Run = msgspec.field(default_factory=Run)
