"""A motion as a moving picture, a GIF by Pillow. Artists are made once, then moved."""

import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image, ImageColor

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.io.target import writing
from jaxnc.kinematics.motion import Motion
from jaxnc.progress import bar
from jaxnc.viz.drawing import PlaneView, make_view
from jaxnc.viz.picture import Size, dots, inches
from jaxnc.viz.poses import Poses, evenly, poses
from jaxnc.viz.style import BODIES, INK, LIGHT, colour_of, mix
from jaxnc.viz.svg import ShownPath


@public
def animate(
    motion: Motion,
    path: str | Path,
    frames: int | Sequence[int] | None = None,
    fps: float = 25.0,
    trace: str | Iterable[str] = (),
    velocities: str | Iterable[str] = (),
    accelerations: str | Iterable[str] = (),
    forces: bool | str | Iterable[str] = (),
    labels: bool = True,
    title: str | None = None,
    frame: bool = True,
    size: Size = (6.4, 5.0),
    dpi: float = 100.0,
    view: tuple[float, float] | None = None,
) -> Path:
    """Write a GIF of a motion.

    Args:
        motion: a sequence of poses.
        path: file ending in ``.gif``.
        frames: how many, evenly spread over the poses, or which poses. Default: every pose, but at most 120; of a
            motion in time at most 240, each shown at its time (slower or faster by a power of ten, where the film
            would last less than a second or more than a minute). The last pose of a motion that closes is left out,
            since it is the first again.
        fps: frames per second; a GIF shows at most 50.
        trace: points and markers that leave a trace.
        velocities: points and markers whose velocity is drawn as an arrow; the motion must carry rates.
        accelerations: the same for accelerations.
        forces: whether forces on points are drawn: True, or some of ``"weight"``, ``"applied"`` (springs, dampers,
            loads) and ``"reaction"`` (see `jaxnc.dynamics.reactions.nodal_forces`); the motion must carry rates.
        labels: whether points and unit vectors are named.
        title: heading; the mechanism's name if not given, none if ``""``.
        frame: whether axes with coordinates are drawn.
        size: largest width and height, inches; or the width.
        dpi: dots per inch.
        view: from where a spatial mechanism is seen: elevation and azimuth, degrees; chosen to suit it if not given.

    Returns:
        The path. Poses that are not right are ghosts, with what became of them.

    Raises:
        InputError: unknown names, a single pose, a batch of several axes, no such frames, no rates for arrows, no such
            view.
        OutputError: unknown suffix, a file that cannot be written.
    """
    data = poses(motion)
    if data.single or data.count < 2:
        raise InputError(f"{data.topology.name!r}: one pose does not move; animate a sweep, or use draw()")
    if not isinstance(fps, (int, float)) or not 0 < fps <= 1000:
        raise InputError(f"fps={fps!r}: frames per second must be a positive number, at most 1000")
    chosen, pause = _choose_frames(data, frames, min(fps, 50.0))  # browsers slow down what is faster
    with writing(path, (".gif",), "an animation") as new:
        path = Path(path).expanduser()
        film = Film(data, trace, velocities, accelerations, labels, title, frame, inches(size), dots(dpi), view, forces)
        _write_gif(path, new, film, chosen, pause)
    return ShownPath(path)


def _choose_frames(data: Poses, frames: int | Sequence[int] | None, fps: float) -> tuple[list[int], float]:
    """Choose poses, and the seconds from one to the next."""
    time = np.zeros(1) if data.motion.time is None else np.asarray(data.motion.time, float)
    if frames is None and time[0] != time[-1]:
        lasts = abs(float(time[-1] - time[0])) / data.pace
        count = int(np.clip(int(fps * lasts + 1e-6) + (not data.closed), 2, 240))
        wanted = np.linspace(time[0], time[-1], count, endpoint=not data.closed)
        return np.abs(time[:, None] - wanted).argmin(axis=0).tolist(), lasts / (count - (not data.closed))
    if frames is None:
        frames = min(data.count - data.closed, 120)  # a page that is quick to read
    if isinstance(frames, (int, np.integer)):
        if frames < 1:
            raise InputError(f"frames={frames!r}: an animation needs at least one frame")
        chosen = np.linspace(0, data.count - 1, int(frames), endpoint=not data.closed)
        return np.rint(chosen).astype(int).tolist(), 1.0 / fps
    chosen = [data.pose(k) for k in frames]
    if not chosen:
        raise InputError("frames is empty: an animation needs at least one frame")
    return chosen, 1.0 / fps


class Film:
    """Frames of a motion: what stays is drawn once, what moves is drawn over it."""

    def __init__(
        self, data: Poses, trace, velocities, accelerations, labels, title, frame, size, dpi, seen=None, forces=()
    ):
        view = make_view(data, data.extent_poses.tolist(), trace, labels, seen)
        view.aim(velocities, accelerations, None, forces)
        view.open(None, size, frame, data.topology.name if title is None else title)
        shown = data.extent_poses
        view.film(int(shown[0]), evenly(shown))
        self.view = view
        figure = view.figure
        figure.set_dpi(dpi)
        self.canvas = FigureCanvasAgg(figure)
        self.time = None if data.motion.time is None else np.asarray(data.motion.time, float)
        self.clock = view.figure.text(0.012, 0.012, "", fontsize=9, color=LIGHT["soft"])
        self.moving = sorted([*view.moving, self.clock], key=lambda artist: artist.get_zorder())
        for artist in self.moving:
            artist.set_animated(True)
        self.canvas.draw()
        self.ground = self.canvas.copy_from_bbox(figure.bbox)

    def frame(self, k: int) -> np.ndarray:
        """Draw pose `k` as an image, ``(height, width, 4)`` of bytes."""
        self.canvas.restore_region(self.ground)
        self.view.show(k)
        if self.time is not None:
            self.clock.set_text(f"{self.time[k]:.3g} s")
        for artist in self.moving:
            self.view.ax.draw_artist(artist)
        return np.asarray(self.canvas.buffer_rgba())

    def palette(self) -> np.ndarray:
        """Choose the colours of all frames, ``(256, 3)`` of bytes: each that is drawn with, mixed with paper and ink.

        Solids have shades besides: those that a few frames have.
        """
        colours = [colour_of(name, INK) for name in ("ink", "soft", "failure", *(a.noun for a in self.view.arrow_sets))]
        colours += [colour_of("body", k) for k in sorted({item.body % len(BODIES) for item in self.view.scene.items
                                                          if item.body != INK})]  # fmt: skip
        colours = list(dict.fromkeys(colours))
        if isinstance(self.view, PlaneView):
            steps = 255 // len(colours) - 1
            mixes = [mix(c, LIGHT["paper"], (k + 1) / steps) for c in colours for k in range(steps)]
            found = [ImageColor.getrgb(c) for c in (*mixes, *(mix(c, LIGHT["ink"], 0.5) for c in colours))]
        else:
            mixes = [mix(c, LIGHT["paper"], share) for c in colours for share in (1.0, 0.75, 0.5, 0.3, 0.15)]
            own = [ImageColor.getrgb(c) for c in mixes[:120]]
            strip = np.concatenate([self.frame(int(k))[..., :3] for k in evenly(self.view.data.extent_poses, 6)])
            few = Image.fromarray(strip).quantize(255 - len(own), method=Image.Quantize.MEDIANCUT).getpalette() or []
            found = [*own, *np.reshape(few, (-1, 3))[: 255 - len(own)]]
        out = np.full((256, 3), 255, dtype=np.uint8)
        out[1 : len(found) + 1] = found
        out[out.min(axis=1) >= 244] = 255  # Pillow looks colours up in coarse boxes: white must have its own
        return out

    def frames(self, chosen: list[int], path: Path) -> Iterator[np.ndarray]:
        """Draw all frames, with a progress bar if there are many and someone watches."""
        shown = None if len(chosen) > 50 else False  # more than 50 frames show their progress
        with bar(len(chosen), path.name, "frame", shown, leave=False) as seen:
            for k in chosen:
                yield self.frame(k)
                seen.update()


def _write_gif(path: Path, new: Path, film: Film, chosen: list[int], pause: float) -> None:
    palette = Image.new("P", (1, 1))
    palette.putpalette(film.palette().reshape(-1).tolist())
    images = [
        Image.fromarray(image[..., :3]).quantize(palette=palette, dither=Image.Dither.NONE)
        for image in film.frames(chosen, path)
    ]
    data = io.BytesIO()
    # GIF counts hundredths of a second: what one frame is rounded by, the next makes up for.
    pauses = (10 * np.diff(np.rint(100.0 * pause * np.arange(len(images) + 1))).astype(int)).tolist()
    images[0].save(data, "GIF", save_all=True, append_images=images[1:], duration=pauses, loop=0, optimize=False)
    new.write_bytes(data.getvalue())
