"""Parts of planar mechanisms for a workshop: plates in layers, with pins and spacers between them."""

from jaxnc.exports import on_demand

__getattr__, __dir__ = on_demand(__name__)
