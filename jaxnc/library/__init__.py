"""Ready mechanisms, planar and spatial: those of the source text and the classics, built with `jaxnc.Mechanism` only.

Every function returns a mechanism that is not compiled yet, so that more can be added to it. It is drawn in a pose in
which it assembles, and carries a default drive in ``model.run``. Lengths are in metres unless scaled otherwise,
angles in radians.
"""

from jaxnc.library import benchmarks
from jaxnc.library.bars import (
    five_bar,
    four_bar,
    four_bar_chain,
    geared_five_bar,
    parallelogram,
    stephenson_six_bar,
    watt_six_bar,
)
from jaxnc.library.catalogue import CATALOGUE
from jaxnc.library.gears import (
    bevel_gears,
    cardan_joint,
    cardan_shafts,
    gear_pair,
    generic_mechanism,
    rolling_disc,
    steering_column,
)
from jaxnc.library.robots import delta_robot, jansen_leg, klann_leg, pantograph, planar_3r, stewart_platform
from jaxnc.library.sliders import crank_slider_on_bar, quick_return, scotch_yoke, shaper, slider_crank, whitworth
from jaxnc.library.spatial_loops import (
    bennett,
    bricard,
    double_hinged_door,
    four_bar_in_space,
    general_body,
    rccc,
    rscr,
    rssp,
    rssr,
    spherical_four_bar,
    wobble_plate,
)
from jaxnc.library.straight_lines import chebyshev, hart, hoeken, peaucellier_lipkin, roberts, watt_straight_line
from jaxnc.library.suspensions import double_wishbone, five_link, macpherson

__all__ = [
    "CATALOGUE",
    "benchmarks",
    "bennett",
    "bevel_gears",
    "bricard",
    "cardan_joint",
    "cardan_shafts",
    "chebyshev",
    "crank_slider_on_bar",
    "delta_robot",
    "double_hinged_door",
    "double_wishbone",
    "five_bar",
    "five_link",
    "four_bar",
    "four_bar_chain",
    "four_bar_in_space",
    "gear_pair",
    "geared_five_bar",
    "general_body",
    "generic_mechanism",
    "hart",
    "hoeken",
    "jansen_leg",
    "klann_leg",
    "macpherson",
    "pantograph",
    "parallelogram",
    "peaucellier_lipkin",
    "planar_3r",
    "quick_return",
    "rccc",
    "roberts",
    "rolling_disc",
    "rscr",
    "rssp",
    "rssr",
    "scotch_yoke",
    "shaper",
    "slider_crank",
    "spherical_four_bar",
    "steering_column",
    "stephenson_six_bar",
    "stewart_platform",
    "watt_six_bar",
    "watt_straight_line",
    "whitworth",
    "wobble_plate",
]
