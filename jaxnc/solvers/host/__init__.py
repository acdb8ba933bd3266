"""The solve path on the host: NumPy on lanes, nothing compiled."""

from jaxnc.solvers.host.assembly import Closest as Closest
from jaxnc.solvers.host.assembly import closest as closest
from jaxnc.solvers.host.follow import corrected as corrected
from jaxnc.solvers.host.poses import scattered as scattered
from jaxnc.solvers.host.poses import sequences as sequences
from jaxnc.solvers.host.rates import changes as changes
from jaxnc.solvers.host.rates import rates as rates
from jaxnc.solvers.host.rates import taken_up as taken_up
from jaxnc.solvers.host.sparse import view_of as view_of
from jaxnc.solvers.host.view import HostView as HostView
from jaxnc.solvers.host.written import ready as ready
