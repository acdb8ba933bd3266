"""Files: models in TOML and JSON, tables in CSV and npz, outlines in SVG, parts for a workshop in DXF and SVG."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.io.headed import load_csv
    from jaxnc.io.robots.export import Exported
    from jaxnc.io.robots.robot import Robot
    from jaxnc.io.stream import Streamed
    from jaxnc.io.svg import Outline, outline
    from jaxnc.io.tables import Table, load_npz
    from jaxnc.io.workshop.assembly import Assembly, Passing, Spacer
    from jaxnc.io.workshop.shop import Shop
    from jaxnc.io.workshop.stock import Frame, Hole, Part, Pin, Slot

__all__ = [
    "Assembly",
    "Exported",
    "Frame",
    "Hole",
    "Outline",
    "Part",
    "Passing",
    "Pin",
    "Robot",
    "Shop",
    "Slot",
    "Spacer",
    "Streamed",
    "Table",
    "load_csv",
    "load_npz",
    "outline",
]

__getattr__, __dir__ = on_demand(__name__)
