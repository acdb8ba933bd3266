"""Parts as SVG drawings in millimetres."""

from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

import numpy as np

from jaxnc.io.workshop.contours import rounded
from jaxnc.io.workshop.lists import beside, label, plain
from jaxnc.io.workshop.stock import Part
from jaxnc.viz.svg import element

if TYPE_CHECKING:
    from jaxnc.io.workshop.assembly import Assembly

_MARGIN = 5.0  # mm
_STROKE = 0.1
_WIDE = 0.62  # of a letter, heights


def written(assembly: "Assembly", placed: list[tuple[Part, complex, complex]], title: str, named: bool) -> bytes:
    """A drawing at true scale: one unit of it is a millimetre; y points up in the parts, and down in the file."""
    shop = assembly.shop
    groups, corners, words = [], [], 0.0
    for part, origin, direction in sorted(placed, key=lambda p: assembly.levels[assembly.parts.index(p[0])]):
        corners.append(origin + part.corners * direction)
        lines = [_contour(corners[-1], 0.5 * shop.width, "outline")]
        lines += [_contour(np.array([origin + h.at * direction]), 0.5 * shop.hole, "hole") for h in part.holes]
        lines += [_contour(origin + np.array(s.ends) * direction, 0.5 * shop.hole, "slot") for s in part.slots]
        level = assembly.levels[assembly.parts.index(part)]
        text = label(part, level)
        if named:
            at, height = beside(assembly, part, origin, direction)
            words = max(words, at.real + _WIDE * height * len(text))
            place = {"x": _n(at.real), "y": _n(0.35 * height - at.imag), "font_size": _n(height)}
            look = {"font_family": "sans-serif", "fill": "blue", "stroke": "none"}
            lines.append(element("text", escape(text), class_="name", **place, **look))
        lines.insert(0, element("title", escape(text)))
        groups.append(element("g", "\n", "\n".join(lines), "\n", data_layer=level, data_part=plain(part.name)))
    z, edge = np.concatenate(corners), 0.5 * shop.width + _MARGIN
    x, y = np.real(z), -np.imag(z)
    left, top = x.min() - edge, y.min() - edge
    wide, high = max(float(np.ptp(x)) + 2 * edge, words + _MARGIN - left), float(np.ptp(y)) + 2 * edge
    drawing = element(
        "svg", "\n", element("title", escape(plain(title))), "\n", "\n".join(groups), "\n",
        xmlns="http://www.w3.org/2000/svg", width=f"{_n(wide)}mm", height=f"{_n(high)}mm",
        viewBox=f"{_n(left)} {_n(top)} {_n(wide)} {_n(high)}", fill="none", stroke="black", stroke_width=_STROKE,
    )  # fmt: skip
    return f"{drawing}\n".encode("utf-8", "replace")


def _contour(corners: np.ndarray, radius: float, kind: str) -> str:
    if len(corners) == 1:
        (w,) = corners
        return element("circle", class_=kind, cx=_n(w.real), cy=_n(-w.imag), r=_n(radius))
    ends = rounded(corners, radius)
    words = [f"M{_n(ends[0][0].real)} {_n(-ends[0][0].imag)}"]
    for (_, bulge), (w, _) in zip(ends, [*ends[1:], ends[0]], strict=True):
        to = f"{_n(w.real)} {_n(-w.imag)}"
        words.append(f"A{_n(radius)} {_n(radius)} 0 0 0 {to}" if bulge else f"L{to}")
    return element("path", class_=kind, d=f"{' '.join(words)} Z")


def _n(value: float) -> str:
    return f"{value + 0.0:.12g}"
