"""Files: models in TOML and JSON, tables in CSV and npz, outlines in SVG."""

from jaxnc.exports import on_demand

__getattr__, __dir__ = on_demand(__name__)
