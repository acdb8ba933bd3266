"""Families of coordinates: independent, relative, reference-point, natural and mixed, from one description."""

from jaxnc.families.compare import Comparison, compare
from jaxnc.families.formulate import FAMILIES, formulate
from jaxnc.families.formulation import Formulation
from jaxnc.families.motion import accelerations, mass_matrix, simulate
from jaxnc.families.recursion import Chain

__all__ = [
    "FAMILIES",
    "Chain",
    "Comparison",
    "Formulation",
    "accelerations",
    "compare",
    "formulate",
    "mass_matrix",
    "simulate",
]
