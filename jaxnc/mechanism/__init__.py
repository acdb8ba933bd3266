"""The builder: describe a mechanism by its points, bodies, joints and coordinates."""

from jaxnc.mechanism.builder import Mechanism

__all__ = ["Mechanism"]
