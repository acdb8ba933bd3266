"""Items of a drawing in space, the same for figures and pages: solids in frames, plates, balls, arrows of angles.

A *column* is a place or a direction in a pose: points and markers first, then unit vectors, then the tips of arrows.
Lengths are those of the mechanism; symbols are sized in units (one unit is the radius of a joint).
"""

import math
from dataclasses import dataclass

import numpy as np

from jaxnc.viz.poses import evenly
from jaxnc.viz.scene import Item, Scene, shown_angle
from jaxnc.viz.spatial.mesh import Mesh, Shell
from jaxnc.viz.style import INK, Style


@dataclass(frozen=True)
class Way:
    """A direction: of the segment between two columns, of one column that is a direction, or a fixed one."""

    columns: tuple[int, ...] = ()
    fixed: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def vector(self, pose: np.ndarray) -> np.ndarray:
        """Find the direction in poses ``(..., columns, 3)``, not normalised, ``(..., 3)``."""
        if not self.columns:
            return np.broadcast_to(np.array(self.fixed), (*pose.shape[:-2], 3))
        if len(self.columns) == 1:
            return pose[..., self.columns[0], :]
        return pose[..., self.columns[1], :] - pose[..., self.columns[0], :]


@dataclass(frozen=True)
class SpaceFrame:
    """Where a solid stands."""

    at: int | tuple[float, float, float]  # a column, or a fixed place
    along: Way  # its axis; of a segment, vertices may be given as shares of it
    side: Way | None = None  # the direction that its second axis leans to; any, if not given

    def stand(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Find origin ``(3,)``, axes as rows ``(3, 3)`` and length of the segment, in a pose ``(columns, 3)``."""
        origin = pose[self.at] if isinstance(self.at, int) else np.array(self.at)
        d = self.along.vector(pose)
        span = float(np.linalg.norm(d))
        e = d / span if span > 0 else np.array([1.0, 0.0, 0.0])
        n = np.zeros(3)
        if self.side is not None:
            n = self.side.vector(pose)
            n = n - (n @ e) * e
        size = float(np.linalg.norm(n))
        if not size > 1e-6:
            n = np.eye(3)[int(np.argmin(np.abs(e)))]
            n = n - (n @ e) * e
            size = float(np.linalg.norm(n))
        n = n / size
        return origin, np.stack([e, n, np.cross(e, n)]), span


@dataclass(frozen=True)
class SpaceItem(Item):
    """A thing in a drawing: its role gives the style, `body` the colour."""

    @property
    def style(self) -> Style:
        """Look of its role."""
        return SOLIDS[self.role]


@dataclass(frozen=True)
class Solid(SpaceItem):
    """A mesh in a frame."""

    frame: SpaceFrame
    mesh: Mesh

    def vertices(self, pose: np.ndarray, unit: float) -> np.ndarray:
        """Find the vertices in a pose, ``(vertices, 3)``; NaN for a segment that has no length."""
        origin, axes, span = self.frame.stand(pose)
        v = self.mesh.vertices
        if span <= 0 and v[:, 0].any():
            return np.full((len(v), 3), np.nan)
        local = v[:, 1:4] + unit * v[:, 4:7]
        local[:, 0] += span * v[:, 0]
        return origin + local @ axes


def segment(role: str, a: int, b: int, mesh: Mesh, body: int = INK) -> Solid:
    """Put a mesh along the segment between two columns."""
    return Solid(role, SpaceFrame(a, Way((a, b))), mesh, body=body)


@dataclass(frozen=True)
class Plate(SpaceItem):
    """Translucent faces between columns."""

    faces: tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class Ball(SpaceItem):
    """A sphere at a column, its radius in units."""

    at: int
    units: float


@dataclass(frozen=True)
class Turn(SpaceItem):
    """The arrow of a driven angle about an axis."""

    at: int  # column of the vertex
    axis: Way  # the axis
    to: Way  # the direction it goes to
    scalar: int  # index of the angle
    units: float  # radius, units
    text: str  # its name
    low: float = 0.0  # the least angle that is drawn, radians, see `least_angle`
    dx: float = 0.0  # from where its name belongs to the right, units
    dy: float = 0.0  # and upwards

    def _around(self, pose: np.ndarray, turn: np.ndarray, radius: float) -> np.ndarray:
        _, axes, _ = SpaceFrame(self.at, self.axis, self.to).stand(pose)
        return pose[self.at] + radius * (np.cos(turn)[:, None] * axes[1] + np.sin(turn)[:, None] * axes[2])

    def curve(self, pose: np.ndarray, value: float, unit: float, count: int = 33) -> np.ndarray:
        """Find the places along the arrow, ``(count, 3)``: it ends at the direction, and begins the angle before it."""
        return self._around(pose, np.linspace(-shown_angle(value, self.low), 0.0, count), self.units * unit)

    def spot(self, pose: np.ndarray, value: float, unit: float) -> np.ndarray:
        """Find where its name belongs, ``(3,)``: in the middle of the angle, beside it if that is small."""
        shown = shown_angle(value, self.low)
        aside = math.copysign(0.5 * max(0.0, 1.0 - abs(shown) / 0.9), shown)
        return self._around(pose, np.array([-0.5 * shown - aside]), (self.units + 1.9) * unit)[0]


@dataclass(frozen=True)
class SpaceScene(Scene):
    """A whole drawing, for any pose; its items are sorted by depth."""

    links: tuple[tuple[int, int], ...]  # pairs of columns between which there is something, for choosing a view
    arrows: tuple[tuple[int, ...], ...]  # the point and the direction of every unit vector that is shown, likewise

    def outlines(self, places: np.ndarray) -> list[np.ndarray]:
        """Find places of what has a size of its own, a length, in some of the poses: the columns are there in all."""
        solids = [item for item in self.items if isinstance(item, Solid) and item.mesh.vertices[:, 1:4].any()]
        some = evenly(places, 32)
        return [
            item.vertices(x, 0.0)[:: 5 if isinstance(item.mesh.pieces[0], Shell) else 1]
            for item in solids
            for x in some
        ]


SOLIDS = {
    "hatch": Style("soft", 0.16, fixed=True),
    "support": Style("ink", 0.2, "paper", fixed=True),
    "guide": Style("ink", 0.3, fixed=True),
    "rail": Style("ink", 0.18, "soft", fixed=True),
    "centre line": Style("soft", 0.2),
    "reference": Style("soft", 0.16),
    "distance": Style("soft", 0.2),
    "spring": Style("ink", 0.42, layer=1),
    "dashpot": Style("ink", 0.36, layer=1),
    "torque": Style("applied", 0.4, "applied", layer=1),
    "mass": Style("", 0.0, "paper", layer=3),
    "dark mass": Style("", 0.0, "ink", layer=3),
    "arc": Style("soft", 0.24, "soft"),
    "cable": Style("ink", 0.24),
    "trace": Style("body", 0.26, layer=-2),  # behind what it touches
    "screw": Style("body", 0.4),
    "ruling": Style("tint", 0.16),
    "rim": Style("body", 0.2),
    "wheel": Style("shade", 0.2, "body", 0.5),
    "tyre": Style("soft", 0.14, "soft", 0.18),
    "road": Style("soft", 0.12, "soft", 0.12),
    "plate": Style("", 0.0, "body", 0.26),
    "web": Style("shade", 0.1, "body", 0.26),
    "edge": Style("shade", 0.1, "body"),
    "bar": Style("shade", 0.14, "body"),
    "rod": Style("ink", 0.16, "soft"),
    "block": Style("ink", 0.22, "tint", layer=1),
    "hinge": Style("ink", 0.22, "paper", layer=1),
    "ground hinge": Style("ink", 0.22, "paper", layer=1, fixed=True),
    "cross": Style("ink", 0.2, "tint", layer=1),
    "ball": Style("ink", 0.24, "paper", layer=1),
    "ground ball": Style("ink", 0.24, "paper", layer=1, fixed=True),
    "dot": Style("shade", 0.16, "body", layer=1),
    "axis": Style("shade", 0.1, "body"),
    "ground axis": Style("", 0.1, "ink", fixed=True),
    "marker": Style("ink", 0.24, layer=1),
    **{noun: Style("", 0.0, noun) for noun in ("velocity", "acceleration", "weight", "applied", "reaction")},
}
"""Style of every role. The layer brings it nearer to the viewer when things are sorted, units; the stroke ``"shade"``
is the fill, darker."""
