"""Reports on a mechanism: a page for people, a verdict for machines. Loaded on first use."""

from jaxnc.exports import on_demand

__getattr__, __dir__ = on_demand(__name__)
