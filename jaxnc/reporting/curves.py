"""Curves as small SVGs in the colours of the page: sharp on paper, light and dark on screens."""

import html
import math
import re
from collections.abc import Mapping, Sequence

import numpy as np

from jaxnc.types import ArrayLike
from jaxnc.viz.poses import true_runs
from jaxnc.viz.style import short, symbol
from jaxnc.viz.svg import element, path_data

_WIDTH, _HEIGHT = 460.0, 190.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 54.0, 10.0, 22.0, 34.0
_DASHES = ("", "6 3", "2 2.5", "8 2 2 2")


def chart(x: np.ndarray, name: str, unit: str, curves: Mapping[str, np.ndarray], level: float | None = None) -> str:
    """Draw curves of one unit over an abscissa, as an SVG element.

    Curves are values by label, with gaps where they are NaN; each has its own colour and dash, named above. A `level`
    is drawn as a line.
    """
    every = np.concatenate([values[np.isfinite(values)] for values in curves.values()])
    if not len(every) or not np.ptp(x) > 0:
        return ""
    low, high = _room(every, level)
    across = (_WIDTH - _LEFT - _RIGHT) / float(np.ptp(x))
    up = (_HEIGHT - _TOP - _BOTTOM) / (high - low)

    def place(u: ArrayLike, v: ArrayLike) -> np.ndarray:
        places = _LEFT + (u - x.min()) * across, _HEIGHT - _BOTTOM - (v - low) * up
        return np.stack(np.broadcast_arrays(*places), axis=-1)

    parts = []

    def stroke(look: str, d: str, **more: str) -> None:
        parts.append(element("path", class_=look, **more, d=d))

    def write(at: float, y: float, text: str, anchor: str | None = None, look: str | None = None) -> None:
        place = {"x": f"{at:.1f}", "y": f"{y:.1f}"}
        parts.append(element("text", html.escape(text), class_=look, **place, text_anchor=anchor))

    right, ground = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM
    for v in ticks(low, high):
        _, y = place(x.min(), v)
        stroke("rule", f"M{_LEFT} {y:.1f}H{right}")
        write(_LEFT - 5, y + 3.5, short(v), "end")
    for u in ticks(float(x.min()), float(x.max()), turns=name.endswith("[deg]")):
        at, _ = place(u, low)
        stroke("tick", f"M{at:.1f} {ground:.1f}v4")
        write(at, ground + 15, short(u), "middle")
    for start, end in true_runs(np.all([~np.isfinite(values) for values in curves.values()], axis=0)):
        ends = place(x[[max(start - 1, 0), min(end, len(x) - 1)]], low)[:, 0]
        at, width = f"{ends.min():.1f}", f"{max(np.ptp(ends), 1.0):.1f}"
        parts.append(element("rect", class_="failed", x=at, y=_TOP, width=width, height=ground - _TOP))
    if level is not None:
        stroke("level", f"M{_LEFT} {place(x.min(), level)[1]:.1f}H{right}")
    keep = np.unique(np.linspace(0, len(x) - 1, min(len(x), 400)).astype(int))  # 400 points of a curve, at most
    at = _LEFT
    for k, (label, values) in enumerate(curves.items()):
        look = {"stroke": f"var(--body-{k % 10})", "stroke_dasharray": _DASHES[k % 4]}
        stroke("curve", path_data(place(x, values)[keep]), **look)
        stroke("curve", f"M{at:.0f} 11h22", **look)
        write(at + 27, 15, with_symbols(label), look="name")
        at += 27 + 6.7 * len(label) + 16
    write(right, 15, f"[{unit}]" if unit else "", "end")
    write((_LEFT + right) / 2, _HEIGHT - 4, with_symbols(name), "middle")
    box, text = f"0 0 {_WIDTH:.0f} {_HEIGHT:.0f}", f"{', '.join(curves)} over {name}"
    return element("svg", *parts, class_="chart", viewBox=box, role="img", aria_label=text)


def bars(rows: Sequence[tuple[str, float, str]]) -> str:
    """Write a table whose numbers have bars: name, signed value, and what stands behind it."""
    most = max((abs(v) for _, v, _ in rows), default=1.0) or 1.0
    cells = (
        f'<tr><td>{html.escape(name)}</td><td class="bar"><i style="width:{100 * abs(value) / most:.1f}%" '
        f'class="{"minus" if value < 0 else "plus"}"></i></td><td>{html.escape(text)}</td></tr>'
        for name, value, text in rows
    )
    return f'<table class="bars"><tbody>{"".join(cells)}</tbody></table>'


def ticks(low: float, high: float, turns: bool = False) -> list[float]:
    """Choose round numbers in a range; of degrees parts of a turn."""
    span = high - low
    steps = [
        m * 10.0**e for e in range(math.floor(math.log10(span)) - 2, math.ceil(math.log10(span)) + 1) for m in (1, 2, 5)
    ]
    if turns and span > 60:
        steps = [15.0, 30.0, 45.0, 60.0, 90.0, 180.0, 360.0, 720.0, 1440.0, *(s for s in steps if s > 1440)]
    step = next((s for s in steps if span / s <= 6.01), steps[-1])
    first = math.ceil(low / step - 1e-9)
    return [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]


def with_symbols(label: str) -> str:
    """Write a label as in a picture: names of Greek letters within it as letters."""
    return re.sub(r"[A-Za-z]\w*", lambda word: symbol(word[0]), label)


def _room(values: np.ndarray, level: float | None) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    if level is not None:
        low, high = min(low, level), max(high, level)
    least = 1e-9 * max(abs(low), abs(high)) or 1.0
    if high - low <= least:
        low, high = low - 0.5 * max(abs(low), least), high + 0.5 * max(abs(high), least)
    spare = 0.06 * (high - low)
    return low - spare, high + spare
