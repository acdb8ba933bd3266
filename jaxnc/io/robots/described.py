"""A robot as a file describes it: links with frames, joints, what closes loops. All places are of the ground, at home.

At home every joint has its reference value, zero if the file does not say otherwise. MJCF and URDF are read into this.
"""

from dataclasses import dataclass, field

import numpy as np

from jaxnc.io.robots.tree import Inertia, Tie, Vec


@dataclass
class FileJoint:
    """One elementary joint: ``"hinge"``, ``"slide"``, ``"ball"``, or ``"free"`` (which is always held)."""

    name: str
    kind: str  # what it is
    at: Vec  # a place on its axis
    axis: Vec  # its direction
    reference: float = 0.0  # its value at home
    stiffness: float = 0.0  # of its spring; 0 for none
    rest: float = 0.0  # value at which the spring is without force
    damping: float = 0.0  # of its damper
    # The numbers at which it is held and is no joint of the mechanism; none where it moves.
    held: tuple[float, ...] = ()
    turned: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)  # of a ball, its quaternion at home

    @property
    def width(self) -> int:
        """How many numbers say where it is."""
        return {"ball": 4, "free": 7}.get(self.kind, 1)


@dataclass
class FileLink:
    """A link: number 0 is the ground. Links without joints belong to their parent."""

    name: str
    parent: int  # number of its parent, which comes before it; -1 for the ground
    origin: Vec  # place of its frame
    turn: np.ndarray  # axes of its frame as columns (3, 3)
    joints: list[FileJoint] = field(default_factory=list)  # between it and its parent, one after the other
    sites: dict[str, Vec] = field(default_factory=dict)  # places by name
    inertia: Inertia | None = None  # None without mass


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
class Described:
    """A whole file."""

    name: str  # of the robot
    links: list[FileLink]  # the ground first, parents before their children
    loops: list[FileLoop] = field(default_factory=list)  # what closes loops
    ties: list[FileTie] = field(default_factory=list)  # relations of two joints
    sums: list[Tie] = field(default_factory=list)  # of more of them
    actuated: list[str] = field(default_factory=list)  # names of the joints that motors drive
    gravity: tuple[float, ...] | None = None  # acceleration of free fall; None for none
    left_out: list[str] = field(default_factory=list)  # what was not taken over, each in a phrase
    notes: list[str] = field(default_factory=list)  # what was chosen

    @property
    def joints(self) -> dict[str, FileJoint]:
        """Every joint by name, in the order of the file."""
        return {j.name: j for link in self.links for j in link.joints}
