"""Drawing a painted scene in matplotlib's axes of three dimensions: one collection, sorted anew for every view."""

from typing import Any

import numpy as np
from matplotlib.artist import allow_rasterization
from matplotlib.collections import PolyCollection
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation
from matplotlib.transforms import Affine2D
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


class Name(Annotation):
    """A name that keeps beside its place while the view turns; the shift is from there, points."""

    def __init__(self, text: str, shift: tuple[float, float], **look: Any):
        self.place = np.zeros(3)
        look |= {"ha": "center", "va": "center", "parse_math": False, "clip_on": False, "annotation_clip": False}
        super().__init__(text, (0.0, 0.0), shift, xycoords=self._at_place, textcoords="offset points", **look)
        halo = withStroke(linewidth=0.25 * float(self.get_fontsize()), foreground=(1.0, 1.0, 1.0, 0.8))
        self.set_path_effects([halo])

    def _at_place(self, renderer: object) -> Affine2D:
        """Bring the origin to where its place is now, pixels."""
        axes = self.axes
        assert isinstance(axes, Axes3D)
        flat, *_ = Projection(axes)(self.place[None])
        return Affine2D().translate(*axes.transData.transform(flat[0]))


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
        self.names: list[tuple[Label | Turn, Name]] = []
        for of in (*labels, *painter.turns):
            look: dict[str, str] = {"gid": "input"}
            if isinstance(of, Label):
                look = {"gid": "label", "fontstyle": "italic", "fontweight": "bold" if of.way else "normal"}
            colour = colour_of("ink" if isinstance(of, Label) and of.to is None else "soft", -1)
            shift = of.dx * points, of.dy * points
            name = Name(of.text, shift, color=colour, fontsize=TEXT * points, zorder=12.0, **look)
            axes.add_artist(name)
            self.names.append((of, name))

    @property
    def moving(self) -> list:
        """Artists that move, from the ground up."""
        return [self.solids, *(name for _, name in self.names)]

    def move(self, pose: np.ndarray, scalars: np.ndarray, faded: bool) -> None:
        """Bring every artist to another pose ``(columns, 3)``, as a ghost if that is not right."""
        self.solids.move(pose, scalars, faded)
        for of, name in self.names:
            if isinstance(of, Label):
                name.place = of.foot(pose, self.unit)
            else:
                name.place = of.spot(pose, float(scalars[of.scalar]), self.unit)
            name.set_visible(bool(np.isfinite(name.place).all()))
            name.set_alpha(0.25 if faded else 1.0)
