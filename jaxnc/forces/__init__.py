"""Kinds of forces: springs, dampers, stops and loads, each one pure function of its own points and coordinates."""

from jaxnc.forces.catalogue import CATALOGUE
from jaxnc.forces.kind import ForceKind
from jaxnc.forces.loads import COUPLE, EFFORT, FORCE, FORCE_IN_SPACE
from jaxnc.forces.springs import (
    COORDINATE_DAMPER,
    COORDINATE_SPRING,
    COORDINATE_STOP,
    DAMPER,
    SPRING,
    STOP,
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
