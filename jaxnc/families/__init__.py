"""Families of coordinates: independent, relative, reference-point, natural and mixed, from one description."""

from jaxnc.families.formulate import FAMILIES, formulate
from jaxnc.families.formulation import Formulation

__all__ = ["FAMILIES", "Formulation", "formulate"]
