"""A planar pose as a small SVG, written without a plotting library: what a page shows where no script runs."""

import html

import numpy as np

from jaxnc.viz.labels import placed
from jaxnc.viz.poses import Poses
from jaxnc.viz.scene import Arc, Casing, Circle, Hatch, Item, Line, Span, Stamp
from jaxnc.viz.sketch import sketch

_WIDTH = 640.0  # pixels
_UNIT = 5.5  # pixels


def still(data: Poses) -> str:
    """The first right pose of a planar motion, as an SVG element that takes its colours from the page's style."""
    pose = int(data.shown[0])
    scene = sketch(data)
    if not np.isfinite(data.places[pose]).all():
        return ""
    lower, upper = scene.box(data.places[data.shown])
    size = np.maximum(upper - lower, 1e-9 * float(np.max(upper - lower, initial=1.0)))
    scale = float(np.min((np.array([_WIDTH, 0.8 * _WIDTH]) - 16 * _UNIT) / size))
    unit, x = _UNIT / scale, data.places[pose]
    scene = placed(scene, x[None], unit)
    low, high = lower - 8 * unit, upper + 8 * unit

    def at(p: np.ndarray) -> str:
        return f"{(p[0] - low[0]) * scale:.1f} {(high[1] - p[1]) * scale:.1f}"

    def path(points: np.ndarray, closed: bool) -> str:
        return "M" + "L".join(at(p) for p in points) + ("Z" if closed else "")

    parts = [_drawn(item, x, unit, scale, at, path) for item in scene.items]
    for label in scene.labels:
        px, py = at(x[label.at] + unit * np.array([label.dx, label.dy])).split()
        parts.append(
            f'<text x="{px}" y="{py}" text-anchor="middle" dominant-baseline="central" fill="var(--ink)" '
            f'font-style="italic" font-size="{2.1 * _UNIT:.1f}">{html.escape(label.text)}</text>'
        )
    width, height = (high - low) * scale
    return f'<svg viewBox="0 0 {width:.0f} {height:.0f}" role="img">{"".join(parts)}</svg>'


def _drawn(item: Item, x: np.ndarray, unit: float, scale: float, at, path) -> str:
    style = item.style
    look = f'fill="{_paint(style.fill, item.body)}" stroke="{_paint(style.stroke, item.body)}"'
    look += f' fill-opacity="{style.opacity:g}" stroke-width="{style.width * _UNIT:.2f}" stroke-linejoin="round"'
    if style.dash:
        look += f' stroke-dasharray="{" ".join(f"{d * _UNIT:.1f}" for d in style.dash)}"'
    if isinstance(item, Circle):
        cx, cy = at(x[item.at]).split()
        return f'<circle cx="{cx}" cy="{cy}" r="{(item.radius + item.units * unit) * scale:.1f}" {look}/>'
    if isinstance(item, (Line, Stamp, Span)):
        return f'<path d="{path(item.outline(x, unit), item.closed)}" {look}/>'
    if isinstance(item, (Hatch, Casing)):
        return f'<path d="{"".join(path(stroke, False) for stroke in item.strokes(x, unit))}" {look}/>'
    if isinstance(item, Arc):
        first, extent = item.angles(x)
        turn = first + extent * np.linspace(0.0, 1.0, 25)
        rim = x[item.at] + item.units * unit * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        return (
            f'<path d="{path(rim, False)}" fill="none" stroke="var(--soft)" stroke-width="{style.width * _UNIT:.2f}"/>'
        )
    return ""


def _paint(name: str | None, body: int) -> str:
    if not name:
        return "none"
    if name in ("body", "tint"):
        return f"var(--{name}-{'ink' if body < 0 else body % 10})"
    return f"var(--{name})"
