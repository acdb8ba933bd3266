"""What is said of a mechanism that is a suspension by the names of its parts."""

import functools

import numpy as np

from jaxnc.kinematics.hardpoints import RACK, usual
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position
from jaxnc.kinematics.sizes import METRES
from jaxnc.kinematics.wheel_report import SuspensionReport, suspension_report
from jaxnc.reporting.verdict import Wheel, WheelNumber, number
from jaxnc.solvers.assembly import derive

_RACK, _POSES = 60e-3, 41  # how far the rack is moved either way, metres, and in how many poses


def suspension_reports(motion: Motion) -> list[SuspensionReport]:
    """Reports over a sweep, and over the steering where a rack is held; none if it is no suspension."""
    top = motion.system.topology
    names = usual(motion.names)
    told = top.dim == 3 and not top.large and names is not None and names.contact in motion.names
    if not told or names is None or int(np.sum(motion.converged)) < 2:
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
        middle = float(np.asarray(derive(motion.system).home)[top.position[rack]])
        far = _RACK / METRES.get(top.length_unit, 1.0)
        hold = [*motion.driven, *(name for name in motion.held if name != rack)]
        asked = {rack: middle + far * np.linspace(-1.0, 1.0, _POSES)}
        steered = solve_position(motion.system, asked, hold=hold, throw=False)
        if int(np.sum(steered.converged)) > 1:
            found.append(report(steered))
    return found


def wheel(found: SuspensionReport) -> Wheel:
    """A report on a suspension as a part of a verdict."""
    numbers = [
        WheelNumber(
            name=row.name,
            unit=row.unit,
            static=number(row.static),
            gradient=number(row.gradient),
            gradient_unit=row.gradient_unit,
            smallest=number(row.smallest),
            largest=number(row.largest),
        )
        for row in found.rows
    ]
    return Wheel(over=found.over, unit=found.unit, side=found.side, axle=found.axle, numbers=numbers)
