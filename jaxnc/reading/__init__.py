"""Readings of pure JAX functions of a few numbers: values on NumPy lanes, derivatives, degree and sparsity."""

from jaxnc.reading.calculus import partials, rate
from jaxnc.reading.degree import Polynomial, polynomials
from jaxnc.reading.program import Builder, Node, Program
from jaxnc.reading.source import function
from jaxnc.reading.trace import Unreadable, trace
from jaxnc.reading.written import Number, write

__all__ = [
    "Builder",
    "Node",
    "Number",
    "Polynomial",
    "Program",
    "Unreadable",
    "function",
    "partials",
    "polynomials",
    "rate",
    "trace",
    "write",
]
