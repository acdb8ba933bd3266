"""Files: models in TOML and JSON, tables in CSV and npz, outlines in SVG."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.io.headed import load_csv
    from jaxnc.io.robots.export import Exported
    from jaxnc.io.robots.robot import Robot
    from jaxnc.io.stream import Streamed
    from jaxnc.io.svg import Outline, outline
    from jaxnc.io.tables import Table, load_npz

__all__ = ["Exported", "Outline", "Robot", "Streamed", "Table", "load_csv", "load_npz", "outline"]

__getattr__, __dir__ = on_demand(
    __name__,
    {
        "jaxnc.io.headed": ("load_csv",),
        "jaxnc.io.robots.export": ("Exported",),
        "jaxnc.io.robots.robot": ("Robot",),
        "jaxnc.io.stream": ("Streamed",),
        "jaxnc.io.svg": ("Outline", "outline"),
        "jaxnc.io.tables": ("Table", "load_npz"),
    },
)
