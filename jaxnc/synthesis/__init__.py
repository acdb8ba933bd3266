"""Design by gradient: what a mechanism should do, and the best designs found for it. Loaded on first use."""

from jaxnc.exports import on_demand

__getattr__, __dir__ = on_demand(__name__)
