"""Kinematics: positions, sweeps, rates, and what a mechanism can do. The functions themselves are jaxnc's own."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.kinematics.arc import DeadPoint, Interval, Travel
    from jaxnc.kinematics.columns import Columns
    from jaxnc.kinematics.diagnosis import Diagnosis, Violation
    from jaxnc.kinematics.instant import (
        Centrodes,
        InstantMotion,
        PathCurvature,
        centrodes,
        instant_centres,
        instant_motion,
        path_curvature,
    )
    from jaxnc.kinematics.mobility import Mobility
    from jaxnc.kinematics.motion import Motion
    from jaxnc.kinematics.planar import Grashof, grashof_type
    from jaxnc.kinematics.remedies import Remedy
    from jaxnc.kinematics.screw import Axodes, ScrewAxis, axodes
    from jaxnc.kinematics.sensitivity import Sensitivity
    from jaxnc.kinematics.suspension import Suspension
    from jaxnc.kinematics.wheel_report import SuspensionReport, SuspensionRow, suspension_report

__all__ = [
    "Axodes",
    "Centrodes",
    "Columns",
    "DeadPoint",
    "Diagnosis",
    "Grashof",
    "InstantMotion",
    "Interval",
    "Mobility",
    "Motion",
    "PathCurvature",
    "Remedy",
    "ScrewAxis",
    "Sensitivity",
    "Suspension",
    "SuspensionReport",
    "SuspensionRow",
    "Travel",
    "Violation",
    "axodes",
    "centrodes",
    "grashof_type",
    "instant_centres",
    "instant_motion",
    "path_curvature",
    "suspension_report",
]

__getattr__, __dir__ = on_demand(__name__)
