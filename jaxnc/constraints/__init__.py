"""Kinds of constraints: bodies, joints and mixed coordinates in the plane and in space."""

from jaxnc.constraints import catalogue as catalogue  # kinds are pickled by their names there
from jaxnc.exports import on_demand

__getattr__, __dir__ = on_demand(__name__)
