"""Parts as DXF drawings."""

import io
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.errors import JaxncError
from jaxnc.io.workshop.contours import rounded
from jaxnc.io.workshop.lists import beside, label, plain
from jaxnc.io.workshop.stock import Part

if TYPE_CHECKING:
    from jaxnc.io.workshop.assembly import Assembly

_MILLIMETRES = 4  # $INSUNITS
_COLOURS = (7, 3, 4, 6, 2, 30)  # of outlines by their level, in AutoCAD's index
_HOLES, _NAMES = 1, 8


def written(assembly: "Assembly", placed: list[tuple[Part, complex, complex]], title: str, named: bool) -> bytes:
    """A drawing in mm, at true scale: outlines as polylines with arcs, holes as circles, on layers of their own."""
    try:
        import ezdxf  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise JaxncError(
            'DXF needs ezdxf: pip install "jaxnc[dxf]" (or pip install ezdxf); formats="svg" does without, as does '
            "--format svg on the command line"
        ) from None
    shop = assembly.shop
    document = ezdxf.new("R2010", units=_MILLIMETRES)
    document.header["$MEASUREMENT"] = 1
    document.header.custom_vars.append("title", plain(title).encode("ascii", "replace").decode())
    space: Any = document.modelspace()
    apart = len({id(part) for part, *_ in placed}) > 1
    for k, (part, origin, direction) in enumerate(placed):
        level = assembly.levels[assembly.parts.index(part)]
        prefix = f"{level}-{k}-" if apart else ""
        outer = _COLOURS[level % len(_COLOURS)] if apart else _COLOURS[0]
        for layer, colour in (("OUTLINE", outer), ("HOLES", _HOLES), *((("NAMES", _NAMES),) if named else ())):
            document.layers.add(f"{prefix}{layer}", color=colour)
        if named:
            at, height = beside(assembly, part, origin, direction)
            look = {"layer": f"{prefix}NAMES", "insert": (at.real, at.imag - 0.5 * height)}
            space.add_text(label(part, level), height=height, dxfattribs=look)

        def contour(corners, radius: float, layer: str, prefix=prefix, origin=origin, direction=direction) -> None:
            here = [origin + complex(w) * direction for w in corners]
            look = {"layer": f"{prefix}{layer}"}
            if len(here) == 1:
                space.add_circle((here[0].real, here[0].imag), radius, dxfattribs=look)
                return
            ends = [(w.real, w.imag, bulge) for w, bulge in rounded(np.array(here), radius)]
            space.add_lwpolyline(ends, format="xyb", close=True, dxfattribs=look)

        contour(part.corners, 0.5 * shop.width, "OUTLINE")
        for hole in part.holes:
            contour([hole.at], 0.5 * shop.hole, "HOLES")
        for slot in part.slots:
            contour(slot.ends, 0.5 * shop.hole, "HOLES")
    text = io.StringIO()
    document.write(text)
    return text.getvalue().encode("utf-8", "replace")
