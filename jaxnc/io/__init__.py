"""Files: models in TOML and JSON, tables in CSV and npz, outlines in SVG."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.io.stream import Streamed as Streamed
    from jaxnc.io.svg import Outline as Outline
    from jaxnc.io.svg import outline as outline
    from jaxnc.io.tables import Table as Table
    from jaxnc.io.tables import load_csv as load_csv
    from jaxnc.io.tables import load_npz as load_npz


__getattr__, __dir__ = on_demand(__name__)
