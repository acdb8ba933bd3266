"""The solve path on the host: NumPy on lanes, nothing compiled."""

from jaxnc.solvers.host.assembly import closest
from jaxnc.solvers.host.changes import changes, taken_up
from jaxnc.solvers.host.follow import corrected
from jaxnc.solvers.host.poses import Poses, scattered, sequences
from jaxnc.solvers.host.rates import rates
from jaxnc.solvers.host.sparse import view_of
from jaxnc.solvers.host.view import HostView
from jaxnc.solvers.host.written import ready

__all__ = [
    "HostView",
    "Poses",
    "changes",
    "closest",
    "corrected",
    "rates",
    "ready",
    "scattered",
    "sequences",
    "taken_up",
    "view_of",
]
