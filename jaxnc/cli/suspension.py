"""What is said of a mechanism that is a suspension by the names of its parts."""

import functools

import numpy as np

from jaxnc.cli.analysis import Analysis
from jaxnc.kinematics.hardpoints import RACK, usual
from jaxnc.kinematics.position import solve_position
from jaxnc.kinematics.sizes import METRES
from jaxnc.kinematics.wheel_report import SuspensionReport, suspension_report
from jaxnc.solvers.assembly import derive

_RACK, _POSES = 60e-3, 41  # how far the rack is moved either way, metres, and in how many poses


def suspension_reports(analysis: Analysis) -> list[SuspensionReport]:
    """Reports over the motion, and over the steering where a rack is held; none if it is no suspension."""
    motion, top = analysis.motion, analysis.system.topology
    names = usual(motion.names)
    told = top.dim == 3 and not top.large and names is not None and names.contact in motion.names
    if not told or names is None or analysis.run.analysis == "circuit" or int(np.sum(motion.converged)) < 2:
        return []
    if not any(float(np.ptp(np.asarray(values))) > 0 for values in motion.inputs.values()):
        return []
    good = np.asarray(motion.converged)
    side = "left" if np.asarray(motion[names.wheel_centre])[good][0, 1] >= 0 else "right"
    rack = RACK[names.wheel_centre]
    moving = rack in (*motion.driven, *motion.held) and not set(names.steering_axis or ()) <= set(motion.names)
    report = functools.partial(suspension_report, side=side, steer=rack if moving else None)  # an axis of no two points
    found = [report(motion)]
    if found[0].travels and rack in motion.held:
        middle = float(np.asarray(derive(analysis.system).home)[top.position[rack]])
        far = _RACK / METRES.get(top.length_unit, 1.0)
        hold = [*motion.driven, *(name for name in motion.held if name != rack)]
        asked = {rack: middle + far * np.linspace(-1.0, 1.0, _POSES)}
        steered = solve_position(analysis.system, asked, hold=hold, throw=False)
        if int(np.sum(steered.converged)) > 1:
            found.append(report(steered))
    return found
