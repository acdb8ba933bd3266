"""All that is to be said of a mechanism: a page for people, a verdict for machines. Loaded on first use."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.reporting.forces import Forces, Peak
    from jaxnc.reporting.quantity import Quantity
    from jaxnc.reporting.study import Report, report
    from jaxnc.reporting.transmission import Transmission
    from jaxnc.reporting.verdict import (
        Change,
        Counts,
        Derivative,
        Design,
        Drive,
        Entry,
        Expectation,
        Extreme,
        Family,
        File,
        Finding,
        Poses,
        Reach,
        Search,
        Simulated,
        Verdict,
        Wheel,
        WheelNumber,
        schema,
    )

__all__ = [
    "Change",
    "Counts",
    "Derivative",
    "Design",
    "Drive",
    "Entry",
    "Expectation",
    "Extreme",
    "Family",
    "File",
    "Finding",
    "Forces",
    "Peak",
    "Poses",
    "Quantity",
    "Reach",
    "Report",
    "Search",
    "Simulated",
    "Transmission",
    "Verdict",
    "Wheel",
    "WheelNumber",
    "report",
    "schema",
]

__getattr__, __dir__ = on_demand(__name__)
