"""Readings of pure JAX functions of a few numbers: values on NumPy lanes, derivatives, degree and sparsity."""

from jaxnc.reading.calculus import partials as partials
from jaxnc.reading.calculus import rate as rate
from jaxnc.reading.degree import Polynomial as Polynomial
from jaxnc.reading.degree import polynomials as polynomials
from jaxnc.reading.operations import OutOfRange as OutOfRange
from jaxnc.reading.operations import Unreadable as Unreadable
from jaxnc.reading.program import Builder as Builder
from jaxnc.reading.program import Node as Node
from jaxnc.reading.program import Program as Program
from jaxnc.reading.source import function as function
from jaxnc.reading.trace import trace as trace
from jaxnc.reading.written import Number as Number
from jaxnc.reading.written import write as write
