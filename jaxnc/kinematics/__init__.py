"""Kinematics: positions, sweeps, rates, and what a mechanism can do. The functions themselves are jaxnc's own."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.kinematics.arc import DeadPoint as DeadPoint
    from jaxnc.kinematics.arc import Interval as Interval
    from jaxnc.kinematics.arc import Travel as Travel
    from jaxnc.kinematics.circuits import Branch as Branch
    from jaxnc.kinematics.circuits import Circuits as Circuits
    from jaxnc.kinematics.closure import ClosedEquations as ClosedEquations
    from jaxnc.kinematics.diagnosis import Diagnosis as Diagnosis
    from jaxnc.kinematics.diagnosis import Remedy as Remedy
    from jaxnc.kinematics.diagnosis import Violation as Violation
    from jaxnc.kinematics.instant import Axodes as Axodes
    from jaxnc.kinematics.instant import Centrodes as Centrodes
    from jaxnc.kinematics.instant import InstantMotion as InstantMotion
    from jaxnc.kinematics.instant import PathCurvature as PathCurvature
    from jaxnc.kinematics.instant import ScrewAxis as ScrewAxis
    from jaxnc.kinematics.instant import axodes as axodes
    from jaxnc.kinematics.instant import centrodes as centrodes
    from jaxnc.kinematics.instant import instant_centres as instant_centres
    from jaxnc.kinematics.instant import instant_motion as instant_motion
    from jaxnc.kinematics.instant import path_curvature as path_curvature
    from jaxnc.kinematics.mobility import Grashof as Grashof
    from jaxnc.kinematics.mobility import Mobility as Mobility
    from jaxnc.kinematics.mobility import grashof_type as grashof_type
    from jaxnc.kinematics.modes import Certificate as Certificate
    from jaxnc.kinematics.modes import Modes as Modes
    from jaxnc.kinematics.motion import Columns as Columns
    from jaxnc.kinematics.motion import Motion as Motion
    from jaxnc.kinematics.sensitivity import Sensitivity as Sensitivity


__getattr__, __dir__ = on_demand(__name__)
