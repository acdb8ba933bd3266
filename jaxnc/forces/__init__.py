"""Kinds of forces: springs, dampers, stops and loads, each one pure function of its own points and coordinates."""

from jaxnc.exports import on_demand

__getattr__, __dir__ = on_demand(__name__)
