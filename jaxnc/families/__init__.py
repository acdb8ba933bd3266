"""Families of coordinates: independent, relative, reference-point, natural and mixed, from one description."""

from jaxnc.exports import on_demand

__getattr__, __dir__ = on_demand(__name__)
