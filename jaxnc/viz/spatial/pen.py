"""Drawing a painted scene in matplotlib's axes of three dimensions: one collection, sorted anew for every view."""

import numpy as np
from matplotlib.artist import allow_rasterization
from matplotlib.collections import PolyCollection
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from mpl_toolkits.mplot3d import Axes3D

from jaxnc.viz.labels import TEXT
from jaxnc.viz.scene import Label
from jaxnc.viz.spatial.painter import Painter
from jaxnc.viz.spatial.scene import Turn
from jaxnc.viz.style import colour_of


class Projection:
    """The projection of axes, for a painter.

    The axes' matrix is that of the last drawing, or of now.
    """

    def __init__(self, axes: Axes3D):
        m = axes.get_proj()
        middle = [sum(axis.get_view_interval()) / 2 for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
        self.m = m / (m[3] @ [*middle, 1.0])
        rows = self.m[:3, :3]
        self.size = np.linalg.norm(rows, axis=1)
        self.axes = rows / self.size[:, None]
        self.axes[2] = np.cross(self.axes[0], self.axes[1])  # towards the viewer, whatever the sign of the depth
        self.scale = 1.0 / self.size[0]

    def __call__(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """Find the places in the picture, nearness as a length, axes of the picture, and lengths per its unit."""
        h = np.concatenate([x, np.ones((len(x), 1))], axis=1) @ self.m.T
        return h[:, :2] / h[:, 3:4], -h[:, 2] / h[:, 3] / self.size[2], self.axes, self.scale


class Solids(PolyCollection):
    """A painted scene as an artist.

    A unit is so many `points` on paper.
    """

    def __init__(self, painter: Painter, unit: float, points: float, opacity: float = 1.0):
        super().__init__([], closed=True, capstyle="round", joinstyle="round")
        self.painter, self.unit, self.points, self.opacity = painter, unit, points, opacity
        self.faded = 1.0
        self.pose = self.places = np.zeros((0, 3))
        self.set_clip_on(False)

    def move(self, pose: np.ndarray, scalars: np.ndarray, faded: bool) -> None:
        """Bring it to a pose ``(columns, 3)``, as a ghost if that is not right."""
        self.pose, self.faded = pose, 0.14 if faded else 1.0
        self.places = self.painter.vertices(pose, scalars, self.unit)
        self.stale = True

    def do_3d_projection(self) -> float:
        """Paint the pose as it is seen now; matplotlib calls this before it draws."""
        assert isinstance(self.axes, Axes3D)
        sheet = self.painter.paint(self.places, self.pose, Projection(self.axes), self.unit, self.faded)
        faces, edges = sheet.faces.copy(), sheet.edges.copy()
        faces[:, 3] *= self.opacity
        edges[:, 3] *= self.opacity
        self.set(verts=sheet.corners, facecolor=faces, edgecolor=edges, linewidth=sheet.widths * self.points)
        return 0.0

    @allow_rasterization
    def draw(self, renderer) -> None:
        """Draw it; frames of an animation ask for this alone."""
        if self.get_visible() and self.get_animated():
            self.do_3d_projection()
        super().draw(renderer)


class Name(Text):
    """A name that keeps beside its place while the view turns.

    The shift is from its place, points.
    """

    def __init__(self, text: str, shift: tuple[float, float], **look):
        super().__init__(0.0, 0.0, text, ha="center", va="center", parse_math=False, **look)
        self.shift, self.place = shift, np.zeros(3)
        self.set_clip_on(False)
        halo = withStroke(linewidth=0.25 * float(self.get_fontsize()), foreground=(1.0, 1.0, 1.0, 0.8))
        self.set_path_effects([halo])

    def spot(self) -> np.ndarray:
        """Find where its middle is, pixels."""
        axes = self.axes
        assert isinstance(axes, Axes3D)
        flat, *_ = Projection(axes)(self.place[None])
        per_point = axes.figure.dpi / 72.0
        return axes.transData.transform(flat[0]) + per_point * np.array(self.shift)

    def _put_in_place(self) -> bool:
        if self.axes is None or not np.isfinite(self.place).all():
            return False
        self.set_transform(None)
        self.set_position(tuple(self.spot()))
        return True

    def draw(self, renderer) -> None:
        """Draw it where its place is now."""
        if self._put_in_place():
            super().draw(renderer)

    def get_window_extent(self, renderer=None, dpi=None):
        """Find its box in pixels, where its place is now."""
        self._put_in_place()
        return super().get_window_extent(renderer, dpi)


class SpacePen:
    """A scene as artists in axes.

    A unit is so many `points` on paper.
    """

    def __init__(self, axes: Axes3D, painter: Painter, labels: tuple[Label, ...], unit: float, points: float):
        self.unit = unit
        self.solids = Solids(painter, unit, points)
        self.solids.set_gid("mechanism")
        self.solids.set_zorder(10.0)
        axes.add_collection(self.solids, autolim=False)
        self.labels: list[tuple[Label, Name]] = []
        self.inputs: list[tuple[Turn, Name]] = []
        for label in labels:
            look = {"fontstyle": "italic", "fontweight": "bold"} if label.way else {"fontstyle": "italic"}
            self.labels.append(
                (label, self._name(axes, label, points, "ink" if label.to is None else "soft", "label", look))
            )
        for turn in painter.turns:
            self.inputs.append((turn, self._name(axes, turn, points, "soft", "input", {})))

    def _name(self, axes: Axes3D, of: Label | Turn, points: float, ink: str, gid: str, look: dict[str, str]) -> Name:
        name = Name(
            of.text, (of.dx * points, of.dy * points), color=colour_of(ink, -1), fontsize=TEXT * points, gid=gid,
            zorder=12.0, **look,
        )  # fmt: skip
        axes.add_artist(name)
        return name

    @property
    def moving(self) -> list:
        """Artists that move, from the ground up."""
        return [self.solids, *(name for _, name in self.labels), *(name for _, name in self.inputs)]

    def move(self, pose: np.ndarray, scalars: np.ndarray, faded: bool) -> None:
        """Bring every artist to another pose ``(columns, 3)``, as a ghost if that is not right."""
        self.solids.move(pose, scalars, faded)
        for label, name in self.labels:
            name.place = label.foot(pose, self.unit)
            name.set_alpha(0.25 if faded else 1.0)
        for turn, name in self.inputs:
            name.place = turn.spot(pose, float(scalars[turn.scalar]), self.unit)
            name.set_alpha(0.25 if faded else 1.0)
