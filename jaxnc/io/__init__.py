"""Files: models in TOML and JSON, tables in CSV and npz, outlines in SVG, parts for a workshop in DXF and SVG."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.io.headed import load_csv as load_csv
    from jaxnc.io.stream import Streamed as Streamed
    from jaxnc.io.svg import Outline as Outline
    from jaxnc.io.svg import outline as outline
    from jaxnc.io.tables import Table as Table
    from jaxnc.io.tables import load_npz as load_npz
    from jaxnc.io.workshop.assembly import Assembly as Assembly
    from jaxnc.io.workshop.assembly import Passing as Passing
    from jaxnc.io.workshop.assembly import Spacer as Spacer
    from jaxnc.io.workshop.shop import Shop as Shop
    from jaxnc.io.workshop.stock import Frame as Frame
    from jaxnc.io.workshop.stock import Hole as Hole
    from jaxnc.io.workshop.stock import Part as Part
    from jaxnc.io.workshop.stock import Pin as Pin
    from jaxnc.io.workshop.stock import Slot as Slot


__getattr__, __dir__ = on_demand(__name__)
