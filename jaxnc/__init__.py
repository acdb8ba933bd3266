"""jaxnc: mechanisms that can be designed by gradient, in natural coordinates on JAX.

``import jaxnc as nc``, describe a mechanism with `Mechanism`, compile it, and analyse it with `solve_position`,
`sweep`, `motion`, `mobility`, `travel`, `diagnose`, `simulate`, `inverse_dynamics`, `equilibrium`.
Everything is loaded on first use. What functions return, and what is asked for less often, is in the packages.
Numbers such as (128) in docstrings are equations of the source text, and "erratum 2" a place where it is wrong:
docs/sources.md.
"""

from jaxnc.exports import on_demand

__version__ = "0.1.0"

__getattr__, __dir__ = on_demand(__name__)
