from jaxnc.vehicle.report import SuspensionReport as SuspensionReport
from jaxnc.vehicle.report import SuspensionRow as SuspensionRow
from jaxnc.vehicle.report import suspension_report as suspension_report
from jaxnc.vehicle.suspension import Suspension as Suspension
