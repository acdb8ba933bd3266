"""A robot as a file describes it: links with frames, joints, what closes loops. All places are of the ground, at home.

At home every joint has its reference value, zero if the file does not say otherwise. MJCF and URDF are read into this.
"""

from dataclasses import dataclass, field

import numpy as np

from jaxnc.io.robots.tree import Inertia, Vec


@dataclass
class FileJoint:
    """One elementary joint: ``"hinge"``, ``"slide"``, ``"ball"``, or ``"free"`` (which is always held).

    Attributes:
        name: its name.
        kind: what it is.
        at: a place on its axis.
        axis: its direction.
        reference: its value at home.
        stiffness: of its spring; 0 for none.
        rest: value at which the spring is without force.
        damping: of its damper.
        turned: of a ball, its quaternion at home.
        held: the numbers at which it is held and is no joint of the mechanism; none where it moves.
    """

    name: str
    kind: str
    at: Vec
    axis: Vec
    reference: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    held: tuple[float, ...] = ()
    turned: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)

    @property
    def width(self) -> int:
        """How many numbers say where it is."""
        return {"ball": 4, "free": 7}.get(self.kind, 1)


@dataclass
class FileLink:
    """A link: number 0 is the ground. Links without joints belong to their parent.

    Attributes:
        name: its name.
        parent: number of its parent, which comes before it; -1 for the ground.
        origin: place of its frame.
        turn: axes of its frame as columns ``(3, 3)``.
        joints: between it and its parent, one after the other.
        sites: places by name.
        inertia: None without mass.
    """

    name: str
    parent: int
    origin: Vec
    turn: np.ndarray
    joints: list[FileJoint] = field(default_factory=list)
    sites: dict[str, Vec] = field(default_factory=dict)
    inertia: Inertia | None = None


@dataclass
class FileLoop:
    """Two links held together at a place of each (``"connect"``), or wholly as they are at home (``"weld"``)."""

    name: str
    kind: str
    first: int
    second: int
    at: tuple[Vec, Vec]


@dataclass
class FileTie:
    """Joints in a relation: the change of the first from home is a polynomial of the change of the second."""

    name: str
    first: str
    second: str | None
    factors: tuple[float, ...]


@dataclass
class FileSum:
    """A sum of joint values, times factors, that stays as it is at home."""

    name: str
    terms: dict[str, float]


@dataclass
class Described:
    """A whole file.

    Attributes:
        name: of the robot.
        links: the ground first, parents before their children.
        loops: what closes loops.
        ties: relations of two joints.
        sums: of more of them.
        actuated: names of the joints that motors drive.
        gravity: acceleration of free fall; None for none.
        left_out: what was not taken over, each in a phrase.
        notes: what was chosen.
    """

    name: str
    links: list[FileLink]
    loops: list[FileLoop] = field(default_factory=list)
    ties: list[FileTie] = field(default_factory=list)
    sums: list[FileSum] = field(default_factory=list)
    actuated: list[str] = field(default_factory=list)
    gravity: tuple[float, ...] | None = None
    left_out: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def joints(self) -> dict[str, FileJoint]:
        """Every joint by name, in the order of the file."""
        return {j.name: j for link in self.links for j in link.joints}
