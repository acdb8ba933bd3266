"""Ready mechanisms, planar and spatial: those of the source text and the classics, built with `jaxnc.Mechanism` only.

Every function returns a mechanism that is not compiled yet, so that more can be added to it. It is drawn in a pose in
which it assembles, and carries a default drive in ``model.run``. Lengths are in metres unless scaled otherwise,
angles in radians.
"""

from jaxnc.exports import on_demand

__getattr__, __dir__ = on_demand(__name__)
