"""Vehicles: wheel suspensions read off a motion, and reports on them. `jaxnc.suspension` is jaxnc's own."""

from jaxnc.exports import on_demand

__getattr__, __dir__ = on_demand(__name__)
