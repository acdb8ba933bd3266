"""Drawings of parts in DXF and SVG, in mm at true scale."""

import io
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.sax.saxutils import escape

import numpy as np

from jaxnc.errors import JaxncError
from jaxnc.viz.svg import element
from jaxnc.workshop.stock import Contour, Part

if TYPE_CHECKING:
    from jaxnc.workshop.assembly import Assembly

_MILLIMETRES = 4  # $INSUNITS
_COLOURS = (7, 3, 4, 6, 2, 30)  # of outlines by their level, in AutoCAD's index
_HOLES, _NAMES = 1, 8
_MARGIN = 5.0  # mm
_STROKE = 0.1
_WIDE = 0.62  # of a letter, heights


class Placed(NamedTuple):
    """A part in a drawing: a place w of it is at ``origin + w direction``."""

    part: Part
    origin: complex
    direction: complex


class Drawing(NamedTuple):
    """A drawing of an assembly."""

    name: str  # of the file
    title: str
    parts: list[Placed]
    labelled: bool = False  # whether names stand beside the parts

    def dxf(self, assembly: "Assembly") -> bytes:
        """Draw outlines as polylines with arcs, holes as circles, on layers of their own."""
        try:
            import ezdxf  # pyright: ignore[reportMissingImports]
        except ImportError:
            raise JaxncError(
                'DXF needs ezdxf: pip install "jaxnc[dxf]" (or pip install ezdxf); formats="svg" does without, as does '
                "--format svg on the command line"
            ) from None
        document = ezdxf.new("R2010", units=_MILLIMETRES)
        document.header["$MEASUREMENT"] = 1
        document.header.custom_vars.append("title", one_line(self.title).encode("ascii", "replace").decode())
        space: Any = document.modelspace()
        several = len(self.parts) > 1
        for k, placed in enumerate(self.parts):
            level = assembly.level(placed.part)
            prefix = f"{level}-{k}-" if several else ""
            outer = _COLOURS[level % len(_COLOURS)] if several else _COLOURS[0]
            layers = {"OUTLINE": outer, "HOLES": _HOLES} | ({"NAMES": _NAMES} if self.labelled else {})
            for layer, colour in layers.items():
                document.layers.add(f"{prefix}{layer}", color=colour)
            if self.labelled:
                at, height, text = _label(assembly, placed)
                look = {"layer": f"{prefix}NAMES", "insert": (at.real, at.imag - 0.5 * height)}
                space.add_text(text, height=height, dxfattribs=look)
            for contour in _contours(assembly, placed):
                look = {"layer": f"{prefix}{'OUTLINE' if contour.kind == 'outline' else 'HOLES'}"}
                if len(contour.corners) == 1:
                    (w,) = contour.corners
                    space.add_circle((w.real, w.imag), contour.radius, dxfattribs=look)
                else:
                    ends = [(w.real, w.imag, bulge) for w, bulge in contour.bulges()]
                    space.add_lwpolyline(ends, format="xyb", close=True, dxfattribs=look)
        text = io.StringIO()
        document.write(text)
        return text.getvalue().encode("utf-8", "replace")

    def svg(self, assembly: "Assembly") -> bytes:
        """Draw with a millimetre as the unit; y points up in the parts, and down in the file."""
        groups, corners, words = [], [], 0.0
        for placed in sorted(self.parts, key=lambda p: assembly.level(p.part)):
            contours = _contours(assembly, placed)
            corners.append(contours[0].corners)
            at, height, text = _label(assembly, placed)
            lines = [element("title", escape(text)), *map(_path, contours)]
            if self.labelled:
                words = max(words, at.real + _WIDE * height * len(text))
                place = {"x": _n(at.real), "y": _n(0.35 * height - at.imag), "font_size": _n(height)}
                look = {"font_family": "sans-serif", "fill": "blue", "stroke": "none"}
                lines.append(element("text", escape(text), class_="name", **place, **look))
            data = {"data_layer": assembly.level(placed.part), "data_part": one_line(placed.part.name)}
            groups.append(element("g", "\n", "\n".join(lines), "\n", **data))
        z, edge = np.concatenate(corners), 0.5 * assembly.shop.width + _MARGIN
        x, y = np.real(z), -np.imag(z)
        left, top = x.min() - edge, y.min() - edge
        wide, high = max(float(np.ptp(x)) + 2 * edge, words + _MARGIN - left), float(np.ptp(y)) + 2 * edge
        drawing = element(
            "svg", "\n", element("title", escape(one_line(self.title))), "\n", "\n".join(groups), "\n",
            xmlns="http://www.w3.org/2000/svg", width=f"{_n(wide)}mm", height=f"{_n(high)}mm",
            viewBox=f"{_n(left)} {_n(top)} {_n(wide)} {_n(high)}", fill="none", stroke="black", stroke_width=_STROKE,
        )  # fmt: skip
        return f"{drawing}\n".encode("utf-8", "replace")


def _contours(assembly: "Assembly", placed: Placed) -> list[Contour]:
    return [c.moved(placed.origin, placed.direction) for c in placed.part.contours(assembly.shop)]


def _label(assembly: "Assembly", placed: Placed) -> tuple[complex, float, str]:
    """Place the name of a part at half its height, right of the part; where it begins, its height in mm, its text."""
    z, width = placed.origin + placed.part.corners * placed.direction, assembly.shop.width
    low, high = float(np.imag(z).min()), float(np.imag(z).max())
    text = f"{one_line(placed.part.name)}, layer {assembly.level(placed.part)}"
    return complex(float(np.real(z).max()) + width, 0.5 * (low + high)), 0.4 * width, text


def _path(contour: Contour) -> str:
    radius = _n(contour.radius)
    if len(contour.corners) == 1:
        (w,) = contour.corners
        return element("circle", class_=contour.kind, cx=_n(w.real), cy=_n(-w.imag), r=radius)
    ends = contour.bulges()
    words = [f"M{_n(ends[0][0].real)} {_n(-ends[0][0].imag)}"]
    for (_, bulge), (w, _) in zip(ends, [*ends[1:], ends[0]], strict=True):
        to = f"{_n(w.real)} {_n(-w.imag)}"
        words.append(f"A{radius} {radius} 0 0 0 {to}" if bulge else f"L{to}")
    return element("path", class_=contour.kind, d=f"{' '.join(words)} Z")


def _n(value: float) -> str:
    return f"{value + 0.0:.12g}"


def one_line(text: str) -> str:
    """Write a name in one line, without signs that files do not hold."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())
