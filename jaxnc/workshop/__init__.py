"""Parts of planar mechanisms for a workshop: plates in layers, with pins and spacers between them."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.workshop.assembly import Assembly as Assembly
    from jaxnc.workshop.assembly import PartDrawing as PartDrawing
    from jaxnc.workshop.assembly import Passing as Passing
    from jaxnc.workshop.assembly import PlacedPart as PlacedPart
    from jaxnc.workshop.assembly import Spacer as Spacer
    from jaxnc.workshop.shop import Shop as Shop
    from jaxnc.workshop.stacking import to_parts as to_parts
    from jaxnc.workshop.stock import Contour as Contour
    from jaxnc.workshop.stock import Frame as Frame
    from jaxnc.workshop.stock import Hole as Hole
    from jaxnc.workshop.stock import Part as Part
    from jaxnc.workshop.stock import Pin as Pin
    from jaxnc.workshop.stock import Slot as Slot


__getattr__, __dir__ = on_demand(__name__)
