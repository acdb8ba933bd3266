"""Kinematics: positions, sweeps, rates, and what a mechanism can do. The functions themselves are jaxnc's own."""

from jaxnc.exports import on_demand

__getattr__, __dir__ = on_demand(__name__)
