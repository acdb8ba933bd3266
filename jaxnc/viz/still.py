"""A planar pose as a small SVG, written without a plotting library: for notebooks, and pages where no script runs."""

import html
from collections.abc import Callable, Sequence

import numpy as np

from jaxnc.viz.labels import placed
from jaxnc.viz.poses import Poses
from jaxnc.viz.scene import Arc, Casing, Circle, Hatch, Item, Line, Span, Stamp
from jaxnc.viz.sketch import sketch
from jaxnc.viz.style import LIGHT, colour_of

_WIDTH, _NARROW = 640.0, 480.0  # pixels, in pages and in notebooks
_UNIT = 5.5  # pixels
_TRACE = 300  # points of a path, or a few more

Paint = Callable[[str, int], str]


def still(data: Poses, paper: bool = False, traces: Sequence[int] = (), shown: int | None = None) -> str:
    """A pose of a planar motion, as an SVG element; empty if it is nowhere.

    Colours on white `paper` stand in it; otherwise a page's style has them. The first right pose is shown if none is
    given.
    """
    pose = int(data.shown[0]) if shown is None else shown
    x = data.places[pose]
    if not np.isfinite(x).all():
        return ""
    scene = sketch(data)
    lower, upper = scene.box(data.places[data.shown])
    size = np.maximum(upper - lower, 1e-9 * float(np.max(upper - lower, initial=0.0)) + 1e-300)
    room = (_NARROW if paper else _WIDTH) * np.array([1.0, 0.8]) - 16 * _UNIT
    scale = float(np.min(room / size)) if np.any(upper > lower) else 1.0
    svg = _Svg(x, _UNIT / scale, scale, lower, upper, _on_paper if paper else _in_page)
    scene = placed(scene, x[None], svg.unit)
    parts = [svg.trace(data.path(column)[0], scene.bodies[column]) for column in traces]
    parts += [svg.item(item) for item in scene.items]
    for label in scene.labels:
        parts.append(svg.text(label.foot(x) + svg.unit * np.array([label.dx, label.dy]), label.text, "ink"))
    width, height = (svg.high - svg.low) * scale
    ground = f'<rect width="100%" height="100%" fill="{LIGHT["paper"]}"/>' if paper else ""
    begin = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" role="img">'
    return f"{begin}{ground}{''.join(parts)}</svg>"


class _Svg:
    def __init__(self, x: np.ndarray, unit: float, scale: float, lower: np.ndarray, upper: np.ndarray, paint: Paint):
        self.x, self.unit, self.scale, self.paint = x, unit, scale, paint
        self.low, self.high = lower - 8 * unit, upper + 8 * unit

    def at(self, p: np.ndarray) -> str:
        return f"{(p[0] - self.low[0]) * self.scale:.1f} {(self.high[1] - p[1]) * self.scale:.1f}"

    def path(self, points: np.ndarray, closed: bool) -> str:
        return "M" + "L".join(self.at(p) for p in points) + ("Z" if closed else "")

    def trace(self, points: np.ndarray, body: int) -> str:
        points = points[:: max(1, len(points) // _TRACE)]
        pieces = np.split(points, np.flatnonzero(~np.isfinite(points).all(axis=1)))
        paths = "".join(self.path(p[np.isfinite(p).all(axis=1)], False) for p in pieces if np.isfinite(p).any())
        look = f'fill="none" stroke="{self.paint("body", body)}" stroke-opacity="0.6" stroke-linejoin="round"'
        return f'<path d="{paths}" {look} stroke-width="{0.3 * _UNIT:.2f}"/>'

    def text(self, place: np.ndarray, text: str, colour: str) -> str:
        x, y = self.at(place).split()
        look = f'text-anchor="middle" dominant-baseline="central" fill="{self.paint(colour, 0)}" font-style="italic"'
        return f'<text x="{x}" y="{y}" {look} font-size="{2.1 * _UNIT:.1f}">{html.escape(text)}</text>'

    def item(self, item: Item) -> str:
        style, x = item.style, self.x
        fill, stroke = (self.paint(name, item.body) if name else "none" for name in (style.fill, style.stroke))
        thick = f'stroke-width="{style.width * _UNIT:.2f}"'
        look = f'fill="{fill}" stroke="{stroke}" fill-opacity="{style.opacity:g}" {thick} stroke-linejoin="round"'
        if style.dash:
            look += f' stroke-dasharray="{" ".join(f"{d * _UNIT:.1f}" for d in style.dash)}"'
        if isinstance(item, Circle):
            cx, cy = self.at(x[item.at]).split()
            return f'<circle cx="{cx}" cy="{cy}" r="{(item.radius + item.units * self.unit) * self.scale:.1f}" {look}/>'
        if isinstance(item, (Line, Stamp, Span)):
            return f'<path d="{self.path(item.outline(x, self.unit), item.closed)}" {look}/>'
        if isinstance(item, (Hatch, Casing)):
            return f'<path d="{"".join(self.path(s, False) for s in item.strokes(x, self.unit))}" {look}/>'
        if isinstance(item, Arc):
            first, extent = item.angles(x)
            turn = first + extent * np.linspace(0.0, 1.0, 25)
            rim = x[item.at] + item.units * self.unit * np.stack([np.cos(turn), np.sin(turn)], axis=1)
            arc = f'<path d="{self.path(rim, False)}" fill="none" stroke="{self.paint("soft", 0)}" {thick}/>'
            return arc + self.text(item.spot(x, self.unit), item.text, "soft")
        return ""


def _on_paper(name: str, body: int) -> str:
    return colour_of(name, body)


def _in_page(name: str, body: int) -> str:
    return f"var(--{name}-{'ink' if body < 0 else body % 10})" if name in ("body", "tint") else f"var(--{name})"
