"""Reports on a mechanism: a page for people, a verdict for machines. Loaded on first use."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.reporting.quantity import Forces as Forces
    from jaxnc.reporting.quantity import Peak as Peak
    from jaxnc.reporting.quantity import Quantity as Quantity
    from jaxnc.reporting.study import Report as Report
    from jaxnc.reporting.study import report as report
    from jaxnc.reporting.transmission import Transmission as Transmission
    from jaxnc.reporting.verdict import Change as Change
    from jaxnc.reporting.verdict import Counts as Counts
    from jaxnc.reporting.verdict import Derivative as Derivative
    from jaxnc.reporting.verdict import Design as Design
    from jaxnc.reporting.verdict import Drive as Drive
    from jaxnc.reporting.verdict import Entry as Entry
    from jaxnc.reporting.verdict import Expectation as Expectation
    from jaxnc.reporting.verdict import Extreme as Extreme
    from jaxnc.reporting.verdict import Family as Family
    from jaxnc.reporting.verdict import File as File
    from jaxnc.reporting.verdict import Finding as Finding
    from jaxnc.reporting.verdict import Poses as Poses
    from jaxnc.reporting.verdict import Reach as Reach
    from jaxnc.reporting.verdict import Search as Search
    from jaxnc.reporting.verdict import Simulated as Simulated
    from jaxnc.reporting.verdict import Verdict as Verdict
    from jaxnc.reporting.verdict import Wheel as Wheel
    from jaxnc.reporting.verdict import WheelNumber as WheelNumber
    from jaxnc.reporting.verdict import schema as schema


__getattr__, __dir__ = on_demand(__name__)
