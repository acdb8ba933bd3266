"""Kinds of forces: springs, dampers, stops and loads, each one pure function of its own points and coordinates."""

from jaxnc.forces.kind import (
    CATALOGUE,
    COORDINATE_DAMPER,
    COORDINATE_SPRING,
    COORDINATE_STOP,
    COUPLE,
    DAMPER,
    EFFORT,
    FORCE,
    FORCE_IN_SPACE,
    SPRING,
    STOP,
    ForceKind,
)

__all__ = [
    "CATALOGUE",
    "COORDINATE_DAMPER",
    "COORDINATE_SPRING",
    "COORDINATE_STOP",
    "COUPLE",
    "DAMPER",
    "EFFORT",
    "FORCE",
    "FORCE_IN_SPACE",
    "SPRING",
    "STOP",
    "ForceKind",
]
