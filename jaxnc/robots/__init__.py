"""Files of robot simulators: mechanisms as trees of links whose loops are closed by constraints."""

from jaxnc.exports import on_demand

__getattr__, __dir__ = on_demand(__name__)
