"""Parts as DXF drawings."""

import io
from typing import TYPE_CHECKING, Any

from jaxnc.errors import JaxncError
from jaxnc.io.workshop.contours import rounded
from jaxnc.io.workshop.stock import Part

if TYPE_CHECKING:
    from jaxnc.io.workshop.assembly import Assembly

_MILLIMETRES = 4  # $INSUNITS


def written(assembly: "Assembly", placed: list[tuple[Part, complex, complex]], title: str) -> bytes:
    """A drawing in mm, at true scale: outlines as polylines with arcs, holes as circles, on layers of their own.

    Args:
        assembly: whose parts they are.
        placed: parts with their origins and directions.
        title: what the drawing is called.

    Returns:
        The file.

    Raises:
        JaxncError: ezdxf is not installed.
    """
    try:
        import ezdxf  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise JaxncError(
            'DXF needs ezdxf: pip install "jaxnc[dxf]" (or pip install ezdxf); formats="svg" does without'
        ) from None
    shop = assembly.shop
    document = ezdxf.new("R2010", units=_MILLIMETRES)
    document.header["$MEASUREMENT"] = 1
    document.header.custom_vars.append("title", title.encode("ascii", "replace").decode())
    space: Any = document.modelspace()
    apart = len({id(part) for part, *_ in placed}) > 1
    for k, (part, origin, direction) in enumerate(placed):
        prefix = f"{assembly.levels[assembly.parts.index(part)]}-{k}-" if apart else ""
        for layer, colour in (("OUTLINE", 7), ("HOLES", 1)):
            document.layers.add(f"{prefix}{layer}", color=colour)

        def contour(corners, radius: float, layer: str, prefix=prefix, origin=origin, direction=direction) -> None:
            here = [origin + complex(w) * direction for w in corners]
            look = {"layer": f"{prefix}{layer}"}
            if len(here) == 1:
                space.add_circle((here[0].real, here[0].imag), radius, dxfattribs=look)
                return
            import numpy as np

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
