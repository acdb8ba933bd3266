"""Ready mechanisms: the planar ones of the source text and the classics, built with `jaxnc.Mechanism` only.

Every function returns a mechanism that is not compiled yet, so that more can be added to it. It is drawn in a pose in
which it assembles, and carries a default drive in ``model.run``. Lengths are in metres unless scaled otherwise,
angles in radians.
"""

from jaxnc.library.catalogue import CATALOGUE
from jaxnc.library.five_bars import five_bar, geared_five_bar
from jaxnc.library.four_bars import four_bar, parallelogram
from jaxnc.library.gears import gear_pair
from jaxnc.library.inversors import hart, peaucellier_lipkin
from jaxnc.library.legs import jansen_leg, klann_leg
from jaxnc.library.quick_returns import quick_return, shaper, whitworth
from jaxnc.library.robots import pantograph, planar_3r
from jaxnc.library.rolling import generic_mechanism, rolling_disc
from jaxnc.library.six_bars import stephenson_six_bar, watt_six_bar
from jaxnc.library.sliders import crank_slider_on_bar, scotch_yoke, slider_crank
from jaxnc.library.straight_lines import chebyshev, hoeken, roberts, watt_straight_line

__all__ = [
    "CATALOGUE",
    "chebyshev",
    "crank_slider_on_bar",
    "five_bar",
    "four_bar",
    "gear_pair",
    "geared_five_bar",
    "generic_mechanism",
    "hart",
    "hoeken",
    "jansen_leg",
    "klann_leg",
    "pantograph",
    "parallelogram",
    "peaucellier_lipkin",
    "planar_3r",
    "quick_return",
    "roberts",
    "rolling_disc",
    "scotch_yoke",
    "shaper",
    "slider_crank",
    "stephenson_six_bar",
    "watt_six_bar",
    "watt_straight_line",
    "whitworth",
]
