"""Poses as SVG, written without a plotting library: for notebooks, pages where no script runs, and reports.

A notebook shows things so: a drawing and a few lines of text, quickly; pages as they are.
"""

import base64
import html
import io
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.io.target import file_name, writing
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.system.system import System
from jaxnc.viz.annotations import place_labels
from jaxnc.viz.poses import Poses, caption, is_simulation, poses
from jaxnc.viz.scene import Arc, Casing, Circle, Hatch, Item, Line, Span, Stamp
from jaxnc.viz.sketch import sketch_plane
from jaxnc.viz.style import LIGHT, colour_of

if TYPE_CHECKING:
    from jaxnc.dynamics.simulation import Simulation


_WIDTH, _NARROW = 640.0, 480.0  # pixels, in pages and in notebooks
_UNIT = 5.5  # pixels
_LARGEST = 400_000, 40_000  # letters of a drawing in pages and in notebooks; larger ones are pixels
_SIZE, _DPI = (6.4, 4.8), 150.0  # inches and dots per inch of a drawing in a page
_SMALL, _COARSE, _SHADES = (4.8, 3.6), 100.0, 96  # those in a notebook, and its colours


# -- the writer -------------------------------------------------------------------------------------------------------


def element(tag: str, *inner: str, **attributes: object) -> str:
    """Write an element of SVG or HTML. `inner` is text that is escaped already.

    Underscores in names of attributes become dashes, ``class_`` is ``class``; attributes that are None are left out.
    """
    given = (
        f' {name.rstrip("_").replace("_", "-")}="{html.escape(str(value))}"'
        for name, value in attributes.items()
        if value is not None
    )
    head = f"<{tag}{''.join(given)}"
    return f"{head}>{''.join(inner)}</{tag}>" if inner else f"{head}/>"


def path_data(points: Iterable[Sequence[float] | np.ndarray], closed: bool = False) -> str:
    """Write straight lines through places of a drawing; the pen is lifted where a place is not finite."""
    out, pen = [], "M"
    for x, y in points:
        if not (np.isfinite(x) and np.isfinite(y)):
            pen = "M"
            continue
        out.append(f"{pen}{x:.1f} {y:.1f}")
        pen = "L"
    return "".join(out) + ("Z" if closed else "")


# -- a planar pose ----------------------------------------------------------------------------------------------------


def draw_still(data: Poses, paper: bool = False, traces: Sequence[int] = (), pose: int | None = None) -> str:
    """Draw a pose of a planar motion as an SVG element; empty if it is nowhere.

    Colours on white `paper` stand in it; otherwise a page's style has them. The first right pose is drawn if none is
    given.
    """
    x = data.places[int(data.extent_poses[0]) if pose is None else pose]
    if not np.isfinite(x).all():
        return ""
    scene = sketch_plane(data)
    lower, upper = scene.box(data.places[data.extent_poses])
    size = np.maximum(upper - lower, 1e-9 * float(np.max(upper - lower, initial=0.0)) + 1e-300)
    room = (_NARROW if paper else _WIDTH) * np.array([1.0, 0.8]) - 16 * _UNIT
    scale = float(np.min(room / size)) if np.any(upper > lower) else 1.0
    low, high = lower - 8 * _UNIT / scale, upper + 8 * _UNIT / scale
    drawing = _Still(x, _UNIT / scale, scale, (low[0], high[1]), colour_of if paper else page_colour)
    scene = place_labels(scene, x[None], drawing.unit)
    parts = [drawing.trace(data.path(column)[0], scene.bodies[column]) for column in traces]
    parts += [drawing.item(item) for item in scene.items]
    for label in scene.labels:
        parts.append(drawing.text(label.foot(x) + drawing.unit * np.array([label.dx, label.dy]), label.text, "ink"))
    width, height = (high - low) * scale
    if paper:
        parts.insert(0, element("rect", width="100%", height="100%", fill=LIGHT["paper"]))
    box = f"0 0 {width:.0f} {height:.0f}"
    return element("svg", *parts, xmlns="http://www.w3.org/2000/svg", viewBox=box, role="img")


def page_colour(name: str, body: int) -> str:
    """Name the property of a page's style that holds a colour."""
    return f"var(--{name}-{'ink' if body < 0 else body % 10})" if name in ("body", "tint") else f"var(--{name})"


@dataclass(frozen=True)
class _Still:
    """Items of a planar scene in a pose, as elements."""

    x: np.ndarray  # the pose, (columns, 2)
    unit: float  # length of a unit
    scale: float  # pixels per length
    corner: tuple[float, float]  # the upper left one of the drawing
    paint: Callable[[str, int], str]  # finds the colour of a name, for a body

    def at(self, places: np.ndarray) -> np.ndarray:
        """Find the places in the drawing, pixels."""
        return (places - self.corner) * (self.scale, -self.scale)

    def path(self, points: np.ndarray, closed: bool = False) -> str:
        return path_data(self.at(points), closed)

    def trace(self, points: np.ndarray, body: int) -> str:
        points = points[:: max(1, len(points) // 300)]  # 300 points of a path, or a few more
        return element(
            "path", d=self.path(points), fill="none", stroke=self.paint("body", body), stroke_opacity="0.6",
            stroke_linejoin="round", stroke_width=f"{0.3 * _UNIT:.2f}",
        )  # fmt: skip

    def text(self, place: np.ndarray, text: str, colour: str) -> str:
        x, y = self.at(place)
        return element(
            "text", html.escape(text), x=f"{x:.1f}", y=f"{y:.1f}", text_anchor="middle", dominant_baseline="central",
            fill=self.paint(colour, 0), font_style="italic", font_size=f"{2.1 * _UNIT:.1f}",
        )  # fmt: skip

    def item(self, item: Item) -> str:
        style, x = item.style, self.x
        fill, stroke = (self.paint(name, item.body) if name else "none" for name in (style.fill, style.stroke))
        thick = f"{style.width * _UNIT:.2f}"
        look = {
            "fill": fill, "stroke": stroke, "fill_opacity": f"{style.opacity:g}", "stroke_width": thick,
            "stroke_linejoin": "round",
            "stroke_dasharray": " ".join(f"{d * _UNIT:.1f}" for d in style.dash) if style.dash else None,
        }  # fmt: skip
        if isinstance(item, Circle):
            cx, cy = self.at(x[item.at])
            radius = (item.radius + item.units * self.unit) * self.scale
            return element("circle", cx=f"{cx:.1f}", cy=f"{cy:.1f}", r=f"{radius:.1f}", **look)
        if isinstance(item, (Line, Stamp, Span)):
            return element("path", d=self.path(item.outline(x, self.unit), item.closed), **look)
        if isinstance(item, (Hatch, Casing)):
            return element("path", d="".join(self.path(s) for s in item.strokes(x, self.unit)), **look)
        if isinstance(item, Arc):
            d = self.path(item.rim(x, self.unit, 25))
            arc = element("path", d=d, fill="none", stroke=self.paint("soft", 0), stroke_width=thick)
            return arc + self.text(item.spot(x, self.unit), item.text, "soft")
        return ""


# -- any pose ---------------------------------------------------------------------------------------------------------


def inline_pose(data: Poses, pose: int | None = None, traces: Sequence[int] = (), paper: bool = False) -> str:
    """Draw a pose as an element of HTML, of a page that has the colours of `page_colours`, or on white `paper`.

    In the plane it is SVG. In space a page has lines and letters in its own colours with what is shaded as pixels
    between them, and paper has pixels. Large drawings are pixels too.

    Args:
        data: the motion.
        pose: number of the pose; the first right one if not given.
        traces: columns whose paths are drawn; that of the last that moves, if none.
        paper: whether it stands on paper, as in a notebook.
    """
    if not traces and data.count > 2:
        traces = [k for k in range(len(data.names)) if np.ptp(data.places[data.extent_poses, k], axis=0).any()][-1:]
    if data.dim == 2 or not paper:
        drawn = draw_still(data, paper, traces, pose) if data.dim == 2 else _draw_in_space(data, pose or 0, traces)
        if len(drawn) <= _LARGEST[paper]:
            return drawn
    k = int(data.extent_poses[0]) if pose is None else pose
    if paper:
        pixels = draw_pixels(data.motion, k)
    else:
        from jaxnc.viz.drawing import draw

        raw = io.BytesIO()
        draw(data.motion, pose=k, title="", size=_SIZE).savefig(raw, format="png", dpi=_DPI)
        pixels = base64.b64encode(raw.getvalue()).decode()
    return f'<img alt="{"" if paper else "the mechanism"}" src="data:image/png;base64,{pixels}">'


def _draw_in_space(data: Poses, pose: int, traces: Sequence[int]) -> str:
    """Draw lines and letters in the page's colours, and what is shaded as pixels between them."""
    from matplotlib import rc_context
    from matplotlib.collections import PolyCollection

    from jaxnc.viz.drawing import draw

    figure: Any = draw(data.motion, pose=pose, trace=[data.names[k] for k in traces], title="", size=_SIZE)
    figure.patch.set_visible(False)
    for ax in figure.axes:
        ax.patch.set_visible(False)
        for artist in ax.get_children():
            if isinstance(artist, PolyCollection):
                artist.set_rasterized(True)
    text = io.StringIO()
    settings: Any = {"svg.hashsalt": "jaxnc", "svg.fonttype": "none"}
    with rc_context(settings):
        figure.savefig(text, format="svg", dpi=_DPI, metadata={"Date": None})
    drawn = re.sub(r"<metadata>.*?</metadata>", "", text.getvalue()[text.getvalue().index("<svg") :], flags=re.S)
    drawn = re.sub(r"font-family: [^;\"]*;", "", drawn)
    drawn = re.sub(r'(<svg [^>]*?)width="[^"]*" height="[^"]*" ', r"\1", drawn, count=1)
    for name in ("ink", "soft", "paper"):
        drawn = drawn.replace(LIGHT[name], f"var(--{name})")
    return drawn


def draw_pixels(drawn: Mechanism | System | Motion, pose: int = 0, trace: Sequence[str] = ()) -> str:
    """Draw a pose as a small PNG of few colours, in the letters of base64."""
    from PIL import Image

    from jaxnc.viz.drawing import draw

    figure: Any = draw(drawn, pose=pose, trace=trace, size=_SMALL, title="")
    figure.set_dpi(_COARSE)
    figure.canvas.draw()
    data, image = io.BytesIO(), Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3])
    image.quantize(_SHADES, dither=Image.Dither.NONE).save(data, "PNG")
    return base64.b64encode(data.getvalue()).decode()


# -- as a notebook shows things ----------------------------------------------------------------------------------------


_TEXT = "font:13px/1.5 system-ui,sans-serif;white-space:pre-wrap;margin:2px 0 0"
_ROWS = "font:12px/1.45 ui-monospace,monospace;white-space:{};overflow-x:auto;margin:4px 0 0"
_TABLE = "font:12px/1.5 system-ui,sans-serif;border-collapse:collapse;margin:4px 0 0"
_CELL = "text-align:left;padding:1px 12px 1px 0;font-weight:{};white-space:nowrap"
_LINES = 16  # of a report

Rows = Sequence[Sequence[str]]


def show_html(thing: object) -> str:
    """Show a drawing and a description of a thing as HTML. Nothing is raised.

    The thing may be a mechanism, a system, a motion, a report on one, or the result of a search. What cannot be drawn
    is described in words only, with the reason.
    """
    try:
        words, rows, report = _describe(thing)
    except Exception as error:
        words, rows, report = f"{type(thing).__name__}: {error}", (), ""
    try:
        drawn = _subject(thing)
        picture = "" if drawn is None else inline_pose(poses(drawn), paper=True)
    except Exception as error:
        picture, words = "", f"{words}\n(not drawn: {error})"
    parts = [picture and f'<div style="max-width:480px">{picture}</div>']
    parts += [f'<div style="{_TEXT}">{html.escape(words)}</div>' if words else "", _table(rows) if rows else ""]
    look = _ROWS.format("pre" if "\n" in report else "pre-wrap")  # sentences are wrapped, tables are not
    parts += [f'<pre style="{look}">{html.escape(report)}</pre>' if report else ""]
    return f"<div>{''.join(parts)}</div>"


def _describe(thing: Any) -> tuple[str, Rows, str]:
    """Describe a thing: a sentence, rows of a table, lines of a report."""
    if isinstance(thing, Mechanism):
        return f"{thing!r}\n{caption(thing)}", (), ""
    if is_simulation(thing) and thing.status.ndim == 1:
        return str(thing), _run_rows(thing), ""
    if isinstance(thing, (System, Motion)):
        return str(thing), (), ""
    if hasattr(thing, "rows") and hasattr(thing, "sentences"):  # of a search
        rows = thing.rows() if thing.designs else ()
        return "\n".join(thing.sentences), rows[:_LINES], ""
    if hasattr(thing, "optimiser"):
        return f"{type(thing).__name__}: {thing.problem.name}, {len(thing.problem.names)} unknowns", (), ""
    report = thing.table(rows=_LINES - 2) if hasattr(thing, "wheel_travel") and thing.converged.ndim else str(thing)
    lines = report.splitlines()
    more = [f"… ({len(lines)} lines: print() it)"] if len(lines) > _LINES else []
    return "", (), "\n".join([*lines[: _LINES - len(more)], *more])


def _run_rows(run: "Simulation") -> Rows:
    """List what is known of a simulation without compiling: its times, steps, energies and constraints."""
    t, e, good = (np.asarray(x) for x in (run.time, run.energy, run.converged))
    last = int(np.flatnonzero(good)[-1]) if good.any() else 0
    made, rejected = map(int, run.steps)
    first, second = map(float, run.violation)
    unit = run.system.topology.load_unit("energy")
    return (
        ("time", f"{t[0]:g} s to {float(run.end):.6g} s"),
        ("steps", f"{made}" + (f" and {rejected} rejected" if rejected else "")),
        ("energy", f"{e[0]:.6g} {unit} at the start, {e[last]:.6g} {unit} at the end"),
        ("constraints", f"met to {first:.2g}, their rates to {second:.2g}"),
    )


def _table(rows: Rows) -> str:
    """Write rows as a table; the first is a heading if its first word is empty."""
    lines = []
    for k, row in enumerate(rows):
        heading = k == 0 and not row[0]
        cells = (
            f'<td style="{_CELL.format(600 if heading or (i == 0 and not rows[0][0]) else 400)}">{html.escape(x)}</td>'
            for i, x in enumerate(row)
        )
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return f'<div style="overflow-x:auto"><table style="{_TABLE}"><tbody>{"".join(lines)}</tbody></table></div>'


def _subject(thing: Any) -> Mechanism | System | Motion | None:
    """Find what there is to be drawn."""
    if isinstance(thing, (Mechanism, System, Motion)):
        return thing
    if getattr(thing, "designs", ()):
        return thing.designs[getattr(thing, "knee", 0)].turn
    return thing.problem.system if hasattr(thing, "problem") else getattr(thing, "system", None)


def save_page(path: str | Path, text: str) -> Path:
    """Write a page to a file; returns its path, which a notebook shows as the page."""
    with writing(path, (".html", ".htm"), "a page") as new:
        new.write_text(text, encoding="utf-8", newline="\n")
    return ShownPath(file_name(path))


class ShownPath(type(Path())):
    """The path of a page or an animation, which a notebook shows as what is in it; as text where it cannot be read."""

    def _repr_html_(self) -> str:
        try:
            content = self.read_bytes()
        except OSError:
            return html.escape(str(self))
        if self.suffix.lower() == ".gif":
            data = base64.b64encode(content).decode()
            return f'<img alt="{html.escape(self.name)}" src="data:image/gif;base64,{data}">'
        look, page = "width:100%;height:760px;border:0", html.escape(content.decode("utf-8"))
        return f'<iframe style="{look}" sandbox="allow-scripts allow-downloads" srcdoc="{page}"></iframe>'
