"""Readings of pure JAX functions of a few numbers: values on NumPy lanes, derivatives, degree and sparsity."""

from jaxnc.reading.calculus import Polynomial as Polynomial
from jaxnc.reading.calculus import partials as partials
from jaxnc.reading.calculus import polynomials as polynomials
from jaxnc.reading.calculus import rate as rate
from jaxnc.reading.operations import OutOfRange as OutOfRange
from jaxnc.reading.operations import Unreadable as Unreadable
from jaxnc.reading.program import Builder as Builder
from jaxnc.reading.program import Node as Node
from jaxnc.reading.program import Number as Number
from jaxnc.reading.program import Program as Program
from jaxnc.reading.program import function as function
from jaxnc.reading.program import write as write
from jaxnc.reading.trace import trace as trace
