"""A robot as a file describes it: a tree of links with joints, what closes its loops, what ties its joints.

MJCF and URDF are read into this description, and a mechanism that is exported becomes one too. All places and
directions are those of the ground in one pose, the home pose. A planar mechanism lies in the plane z = 0.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from jaxnc.errors import list_first

Vec = np.ndarray


@dataclass
class ElementaryJoint:
    """An elementary joint of a link: ``"hinge"``, ``"slide"``, ``"ball"`` or ``"free"``."""

    name: str
    kind: str
    axis: Vec = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))  # direction of a hinge or slide
    at: Vec = field(default_factory=lambda: np.zeros(3))  # a place on the axis
    reference: float = 0.0  # value at home
    stiffness: float = 0.0  # of the joint's spring; 0 for none
    rest: float = 0.0  # value at which the spring is without force
    damping: float = 0.0  # of the joint's damper
    # Numbers at which the joint is held, so that it is none of the mechanism; empty where it moves.
    held: tuple[float, ...] = ()
    quaternion: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)  # of a ball at home

    @property
    def width(self) -> int:
        """Count the numbers that say where the joint is."""
        return {"ball": 4, "free": 7}.get(self.kind, 1)


@dataclass
class Inertia:
    """Mass, centre of mass ``(3,)`` and inertia about it ``(3, 3)``."""

    mass: float
    com: Vec
    tensor: np.ndarray


@dataclass
class Link:
    """A rigid link; number 0 is the ground, and a link without joints belongs to its parent.

    Joints act one after the other: those before the first rotation along axes of the parent, slides after it along axes
    of the link.
    """

    name: str
    parent: int  # number of the parent, which comes before the link; -1 for the ground
    origin: Vec  # place of the frame
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))  # axes of the frame as columns
    joints: list[ElementaryJoint] = field(default_factory=list)  # between the parent and the link
    sites: dict[str, Vec] = field(default_factory=dict)  # places by name
    inertia: Inertia | None = None  # None without mass
    # Of an exported mechanism, whose links have frames parallel to the ground's at home, and all joints at zero there:
    # the part of the mechanism that the link is; of a link that only closes a loop the part that it moves with.
    part: int = -1
    reference: int = -1  # of a link that moves with a point and keeps its parent's orientation, that point; else -1
    lines: list[tuple[Vec, Vec]] = field(default_factory=list)  # pairs of places, to be shown
    auxiliary: bool = False  # whether the link is no part of the mechanism but a piece of a joint
    spinless: bool = False  # whether the link is a bar that slides or turns about its own line, as its parent is turned


@dataclass
class LoopClosure:
    """Two links held together at a place of each (``"connect"``), or wholly as they are at home (``"weld"``)."""

    name: str
    kind: str
    first: int
    second: int
    at: tuple[Vec, Vec]


@dataclass
class Tie:
    """Factors of changes of hinges and slides from home, whose sum is zero."""

    name: str
    terms: dict[str, float]


@dataclass
class Follower:
    """A joint whose change from home is a polynomial of the change of another; without another it stands still."""

    name: str
    first: str
    second: str | None
    factors: tuple[float, ...]


@dataclass
class Description:
    """A whole robot."""

    name: str
    links: list[Link] = field(default_factory=list)  # the ground first, parents before their children
    loops: list[LoopClosure] = field(default_factory=list)
    followers: list[Follower] = field(default_factory=list)
    ties: list[Tie] = field(default_factory=list)
    actuated: list[str] = field(default_factory=list)  # names of the joints that motors drive
    gravity: tuple[float, ...] | None = None  # acceleration of free fall; None for none
    left_out: list[str] = field(default_factory=list)  # what was not taken over, each in a phrase
    notes: list[str] = field(default_factory=list)  # what was chosen

    @property
    def joints(self) -> dict[str, ElementaryJoint]:
        """All joints by name, in the order of the file."""
        return {j.name: j for link in self.links for j in link.joints}

    def leave_out(self, what: str, names: list[str]) -> None:
        """Say that things of one sort were not taken over, if there are any."""
        if names:
            self.left_out.append(f"{what}: {list_first(names, 8)}")

    def drive(self, name: str) -> bool:
        """Note that a motor drives a joint, if that is a hinge or slide that moves; return whether it is."""
        joint = self.joints[name]
        if joint.kind not in ("hinge", "slide") or joint.held:
            return False
        if name not in self.actuated:
            self.actuated.append(name)
        return True


def free_name(name: str, taken: Collection[str], between: str = " ") -> str:
    """Return a name as it is, or with a number behind it if it is taken."""
    k, out = 1, name
    while out in taken:
        k += 1
        out = f"{name}{between}{k}"
    return out


def join_inertias(pieces: list[Inertia]) -> Inertia | None:
    """Combine rigid pieces to one; None if there is none."""
    if not pieces:
        return None
    mass = sum(p.mass for p in pieces)
    com: Vec = sum((p.mass * p.com for p in pieces), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for p in pieces:
        x = cross_matrix(p.com - com)
        tensor = tensor + p.tensor - p.mass * (x @ x)
    return Inertia(mass, com, tensor)


def cross_matrix(v: Vec) -> np.ndarray:
    """Return the matrix of ``v ×``."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def rotate_about(axis: Vec, angle: float) -> np.ndarray:
    """Return the rotation by an angle about a unit axis."""
    x = cross_matrix(axis)
    return np.eye(3) + math.sin(angle) * x + (1.0 - math.cos(angle)) * (x @ x)


def perpendicular(axis: Vec) -> Vec:
    """Return a unit vector across another vector."""
    u = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    return u / np.linalg.norm(u)
