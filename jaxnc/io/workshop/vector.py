"""Parts as SVG drawings in millimetres."""

from typing import TYPE_CHECKING
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from jaxnc.io.workshop.contours import rounded
from jaxnc.io.workshop.stock import Part

if TYPE_CHECKING:
    from jaxnc.io.workshop.assembly import Assembly

_MARGIN = 5.0  # mm
_STROKE = 0.1


def written(assembly: "Assembly", placed: list[tuple[Part, complex, complex]], title: str) -> bytes:
    """A drawing at true scale: one unit of it is a millimetre; y points up in the parts, and down in the file.

    Args:
        assembly: whose parts they are.
        placed: parts with their origins and directions.
        title: what the drawing is called.

    Returns:
        The file.
    """
    shop = assembly.shop
    groups, corners = [], []
    for part, origin, direction in sorted(placed, key=lambda p: assembly.levels[assembly.parts.index(p[0])]):
        corners.append(origin + part.corners * direction)
        lines = [_contour(corners[-1], 0.5 * shop.width, "outline")]
        lines += [_contour(np.array([origin + h.at * direction]), 0.5 * shop.hole, "hole") for h in part.holes]
        lines += [_contour(origin + np.array(s.ends) * direction, 0.5 * shop.hole, "slot") for s in part.slots]
        level = assembly.levels[assembly.parts.index(part)]
        groups.append(f'<g data-layer="{level}" data-part={quoteattr(part.name)}>\n' + "\n".join(lines) + "\n</g>")
    z, edge = np.concatenate(corners), 0.5 * shop.width + _MARGIN
    x, y = np.real(z), -np.imag(z)
    left, top = x.min() - edge, y.min() - edge
    wide, high = float(np.ptp(x)) + 2 * edge, float(np.ptp(y)) + 2 * edge
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_n(wide)}mm" height="{_n(high)}mm" '
        f'viewBox="{_n(left)} {_n(top)} {_n(wide)} {_n(high)}" fill="none" stroke="black" stroke-width="{_STROKE}">\n'
        f"<title>{escape(title)}</title>\n" + "\n".join(groups) + "\n</svg>\n"
    ).encode("utf-8", "replace")


def _contour(corners: np.ndarray, radius: float, kind: str) -> str:
    if len(corners) == 1:
        (w,) = corners
        return f'<circle class="{kind}" cx="{_n(w.real)}" cy="{_n(-w.imag)}" r="{_n(radius)}"/>'
    ends = rounded(corners, radius)
    words = [f"M{_n(ends[0][0].real)} {_n(-ends[0][0].imag)}"]
    for (_, bulge), (w, _) in zip(ends, [*ends[1:], ends[0]], strict=True):
        to = f"{_n(w.real)} {_n(-w.imag)}"
        words.append(f"A{_n(radius)} {_n(radius)} 0 0 0 {to}" if bulge else f"L{to}")
    return f'<path class="{kind}" d="{" ".join(words)} Z"/>'


def _n(value: float) -> str:
    return f"{value + 0.0:.12g}"
