"""Curves as small SVGs in the colours of the page: sharp on paper, light and dark on screens."""

import html
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxnc.viz.style import symbol

_WIDTH, _HEIGHT = 460.0, 190.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 54.0, 10.0, 22.0, 34.0
_DASHES = ("", "6 3", "2 2.5", "8 2 2 2")
_TICKS = 6
_POINTS = 400  # of a curve, at most


@dataclass(frozen=True)
class Curve:
    """Values over the abscissa; gaps where they are NaN."""

    label: str
    values: np.ndarray


def chart(x: np.ndarray, name: str, unit: str, curves: Sequence[Curve], level: float | None = None) -> str:
    """Curves of one unit over an abscissa, as an SVG element.

    Each curve has its own colour and dash, named above; a `level` is drawn as a line.
    """
    every = np.concatenate([c.values[np.isfinite(c.values)] for c in curves])
    if not len(every) or not np.ptp(x) > 0:
        return ""
    low, high = _room(every, level)
    across = (_WIDTH - _LEFT - _RIGHT) / float(np.ptp(x))
    up = (_HEIGHT - _TOP - _BOTTOM) / (high - low)

    def place(u: float, v: float) -> tuple[float, float]:
        return _LEFT + (u - float(x.min())) * across, _HEIGHT - _BOTTOM - (v - low) * up

    parts = [
        f'<svg class="chart" viewBox="0 0 {_WIDTH:.0f} {_HEIGHT:.0f}" role="img" aria-label="{_said(curves, name)}">'
    ]
    for v in ticks(low, high):
        _, y = place(float(x.min()), v)
        parts.append(f'<path class="rule" d="M{_LEFT} {y:.1f}H{_WIDTH - _RIGHT}"/>')
        parts.append(f'<text x="{_LEFT - 5}" y="{y + 3.5:.1f}" text-anchor="end">{short(v)}</text>')
    for u in ticks(float(x.min()), float(x.max()), turns=name.endswith("[deg]")):
        a, y = place(u, low)
        parts.append(f'<path class="tick" d="M{a:.1f} {y:.1f}v4"/>')
        parts.append(f'<text x="{a:.1f}" y="{y + 15:.1f}" text-anchor="middle">{short(u)}</text>')
    for start, end in _gaps(curves, len(x)):
        ends = [place(float(x[k]), low)[0] for k in (max(start - 1, 0), min(end, len(x) - 1))]
        a, w = min(ends), max(abs(ends[1] - ends[0]), 1.0)
        parts.append(
            f'<rect class="failed" x="{a:.1f}" y="{_TOP}" width="{w:.1f}" height="{_HEIGHT - _TOP - _BOTTOM}"/>'
        )
    if level is not None:
        parts.append(f'<path class="level" d="M{_LEFT} {place(0.0, level)[1]:.1f}H{_WIDTH - _RIGHT}"/>')
    label, at = f"[{unit}]" if unit else "", _LEFT
    for k, curve in enumerate(curves):
        look = f'stroke="var(--body-{k % 10})" stroke-dasharray="{_DASHES[k % 4]}"'
        parts.append(f'<path class="curve" {look} d="{_path(x, curve.values, place)}"/>')
        parts.append(f'<path class="curve" {look} d="M{at:.0f} 11h22"/>')
        parts.append(f'<text class="name" x="{at + 27:.0f}" y="15">{html.escape(lettered(curve.label))}</text>')
        at += 27 + 6.7 * len(curve.label) + 16
    parts.append(f'<text x="{_WIDTH - _RIGHT}" y="15" text-anchor="end">{html.escape(label)}</text>')
    middle, said = (_LEFT + _WIDTH - _RIGHT) / 2, html.escape(lettered(name))
    parts.append(f'<text x="{middle}" y="{_HEIGHT - 4}" text-anchor="middle">{said}</text>')
    return "".join([*parts, "</svg>"])


def bars(rows: Sequence[tuple[str, float, str]]) -> str:
    """A table whose numbers have bars: name, signed value, and what stands behind it."""
    most = max((abs(v) for _, v, _ in rows), default=1.0) or 1.0
    cells = (
        f'<tr><td>{html.escape(name)}</td><td class="bar"><i style="width:{100 * abs(value) / most:.1f}%" '
        f'class="{"minus" if value < 0 else "plus"}"></i></td><td>{html.escape(said)}</td></tr>'
        for name, value, said in rows
    )
    return f'<table class="bars"><tbody>{"".join(cells)}</tbody></table>'


def ticks(low: float, high: float, turns: bool = False) -> list[float]:
    """Round numbers in a range; of degrees parts of a turn."""
    span = high - low
    steps = [
        m * 10.0**e for e in range(math.floor(math.log10(span)) - 2, math.ceil(math.log10(span)) + 1) for m in (1, 2, 5)
    ]
    if turns and span > 60:
        steps = [15.0, 30.0, 45.0, 60.0, 90.0, 180.0, 360.0, 720.0, 1440.0, *(s for s in steps if s > 1440)]
    step = next((s for s in steps if span / s <= _TICKS + 0.01), steps[-1])
    first = math.ceil(low / step - 1e-9)
    return [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]


def short(value: float, digits: int = 4) -> str:
    """A number in few digits, with a real minus; rounding is zero."""
    return f"{0.0 if abs(value) < 1e-12 else value:.{digits}g}".replace("-", "−")


def lettered(label: str) -> str:
    """A label as it is written in a picture: names of Greek letters within it as letters."""
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


def _path(x: np.ndarray, values: np.ndarray, place) -> str:
    out, pen = [], "M"
    keep = np.unique(np.linspace(0, len(x) - 1, min(len(x), _POINTS)).astype(int))
    for k in keep:
        if not np.isfinite(values[k]):
            pen = "M"
            continue
        a, b = place(float(x[k]), float(values[k]))
        out.append(f"{pen}{a:.1f} {b:.1f}")
        pen = "L"
    return "".join(out)


def _gaps(curves: Sequence[Curve], count: int) -> list[tuple[int, int]]:
    bad = np.all([~np.isfinite(c.values) for c in curves], axis=0)
    edges = np.diff(np.concatenate([[0], bad.astype(int), [0]]))
    return list(zip(np.flatnonzero(edges > 0).tolist(), np.flatnonzero(edges < 0).tolist(), strict=True))


def _said(curves: Sequence[Curve], name: str) -> str:
    return html.escape(f"{', '.join(c.label for c in curves)} over {name}")
