"""A mechanism as robots are written: a tree of rigid links with joints, what closes its loops, what ties its joints.

All places and directions are those of the ground in one pose, the home pose, in space (a planar mechanism lies in the
plane z = 0 and turns about z). Frames of links are parallel to the ground's there, so that every joint is at zero.
"""

from dataclasses import dataclass, field

import numpy as np

Vec = np.ndarray


@dataclass
class Joint:
    """One elementary joint of a link: a ``"hinge"`` or ``"slide"`` with its axis, a ``"ball"``, or ``"free"``."""

    name: str
    kind: str
    axis: Vec = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    @property
    def width(self) -> int:
        """How many numbers say where it is."""
        return {"ball": 4, "free": 7}.get(self.kind, 1)


@dataclass
class Inertia:
    """Mass, centre of mass ``(3,)`` and inertia about it ``(3, 3)``, in the home pose."""

    mass: float
    com: Vec
    tensor: Vec


@dataclass
class Link:
    """A rigid link, number 0 the ground.

    Its joints act one after the other: those before the first rotation along axes of its parent, slides after it along
    its own.
    """

    name: str
    parent: int  # number of the link before it; -1 for the ground
    origin: Vec  # the place of its frame, where its joints are
    joints: list[Joint] = field(default_factory=list)  # between it and its parent
    # The part of the mechanism that it is; of a link that only closes a loop the part that it moves with.
    part: int = -1
    reference: int = -1  # of a link that moves with a point and keeps its parent's orientation, that point; else -1
    sites: dict[str, Vec] = field(default_factory=dict)  # places by name
    lines: list[tuple[Vec, Vec]] = field(default_factory=list)  # pairs of places, to be shown
    inertia: Inertia | None = None  # None where it has no mass of its own
    auxiliary: bool = False  # whether it is no part of the mechanism but a piece of a joint
    spinless: bool = False  # whether it is a bar that slides or turns about its own line, with its parent's orientation


@dataclass
class Loop:
    """Two links that stay together at a place (``"connect"``), or wholly (``"weld"``)."""

    name: str
    kind: str
    first: int
    second: int
    at: Vec


@dataclass
class Tie:
    """Factors of joint values, of hinges and slides, whose sum is zero as in the home pose."""

    name: str
    terms: dict[str, float]


@dataclass
class Reading:
    """A coordinate of the mechanism as a sum of joint values, or as the distance of two sites."""

    terms: dict[str, float]  # factors by joint; the coordinate is their sum and `home`
    home: float  # its value in the home pose
    ends: tuple[str, str] | None = None  # names of the two sites, of a distance


@dataclass
class Tree:
    """The whole: links in an order in which parents come first, loops, ties, and how coordinates are read."""

    name: str  # of the mechanism
    links: list[Link]  # the ground first
    loops: list[Loop] = field(default_factory=list)  # what closes them
    ties: list[Tie] = field(default_factory=list)  # linear relations between joints (gears, racks, screws)
    cables: dict[str, list[str]] = field(default_factory=dict)  # sites along each cable, by its name
    readings: dict[str, Reading] = field(default_factory=dict)  # the mechanism's coordinates
    left_out: list[str] = field(default_factory=list)  # what of the mechanism is not in it, each in a phrase
    notes: list[str] = field(default_factory=list)  # what was chosen where the mechanism does not say

    @property
    def joints(self) -> dict[str, tuple[int, Joint]]:
        """Every joint by its name, with the number of its link."""
        return {j.name: (k, j) for k, link in enumerate(self.links) for j in link.joints}

    def way(self, k: int) -> list[int]:
        """Links from the ground to a link, the ground left out."""
        out = []
        while k > 0:
            out.append(k)
            k = self.links[k].parent
        return out[::-1]
