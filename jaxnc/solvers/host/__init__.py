"""The solve path on the host: NumPy on lanes, nothing compiled."""

from jaxnc.solvers.host.follow import Closest as Closest
from jaxnc.solvers.host.follow import assemble_closest as assemble_closest
from jaxnc.solvers.host.follow import changes as changes
from jaxnc.solvers.host.follow import closest as closest
from jaxnc.solvers.host.follow import correct_poses as correct_poses
from jaxnc.solvers.host.follow import pose_rates as pose_rates
from jaxnc.solvers.host.follow import start_changes as start_changes
from jaxnc.solvers.host.follow import unabsorbed_changes as unabsorbed_changes
from jaxnc.solvers.host.poses import solve_scattered as solve_scattered
from jaxnc.solvers.host.poses import solve_sequences as solve_sequences
from jaxnc.solvers.host.sparse import view_of as view_of
from jaxnc.solvers.host.view import HostView as HostView
from jaxnc.solvers.rows import read_kinds as read_kinds
