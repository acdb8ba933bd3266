"""Seeing a mechanism: drawings, plots, animations and pages. Loaded on first use; matplotlib is needed only here."""

from jaxnc.exports import on_demand

__getattr__, __dir__ = on_demand(__name__)
