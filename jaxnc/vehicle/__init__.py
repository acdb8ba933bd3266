"""Vehicles: wheel suspensions read off a motion, and reports on them. `jaxnc.suspension` is jaxnc's own."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.vehicle.report import SuspensionReport as SuspensionReport
    from jaxnc.vehicle.report import SuspensionRow as SuspensionRow
    from jaxnc.vehicle.report import suspension_report as suspension_report
    from jaxnc.vehicle.suspension import Suspension as Suspension


__getattr__, __dir__ = on_demand(__name__)
