"""Ready mechanisms by the names they have on the command line."""

from collections.abc import Callable

from jaxnc.library.bodies import general_body
from jaxnc.library.chains import four_bar_chain
from jaxnc.library.five_bars import five_bar, geared_five_bar
from jaxnc.library.four_bars import four_bar, parallelogram
from jaxnc.library.gears import gear_pair
from jaxnc.library.inversors import hart, peaucellier_lipkin
from jaxnc.library.legs import jansen_leg, klann_leg
from jaxnc.library.overconstrained import bennett, bricard, double_hinged_door, four_bar_in_space
from jaxnc.library.platforms import delta_robot, stewart_platform
from jaxnc.library.quick_returns import quick_return, shaper, whitworth
from jaxnc.library.robots import pantograph, planar_3r
from jaxnc.library.rolling import generic_mechanism, rolling_disc
from jaxnc.library.shafts import bevel_gears, cardan_joint, cardan_shafts, steering_column
from jaxnc.library.six_bars import stephenson_six_bar, watt_six_bar
from jaxnc.library.sliders import crank_slider_on_bar, scotch_yoke, slider_crank
from jaxnc.library.spatial_loops import rccc, rscr, rssp, rssr
from jaxnc.library.spherical import spherical_four_bar, wobble_plate
from jaxnc.library.straight_lines import chebyshev, hoeken, roberts, watt_straight_line
from jaxnc.library.suspensions import double_wishbone, five_link, macpherson
from jaxnc.mechanism import Mechanism

CATALOGUE: dict[str, Callable[..., Mechanism]] = {
    function.__name__.replace("_", "-"): function
    for function in (
        four_bar,
        parallelogram,
        four_bar_chain,
        slider_crank,
        crank_slider_on_bar,
        scotch_yoke,
        quick_return,
        shaper,
        whitworth,
        gear_pair,
        rolling_disc,
        generic_mechanism,
        five_bar,
        geared_five_bar,
        watt_six_bar,
        stephenson_six_bar,
        chebyshev,
        hoeken,
        roberts,
        watt_straight_line,
        peaucellier_lipkin,
        hart,
        pantograph,
        planar_3r,
        jansen_leg,
        klann_leg,
        rscr,
        bevel_gears,
        macpherson,
        double_wishbone,
        five_link,
        steering_column,
        cardan_joint,
        cardan_shafts,
        rssr,
        rssp,
        rccc,
        spherical_four_bar,
        wobble_plate,
        bennett,
        bricard,
        four_bar_in_space,
        double_hinged_door,
        stewart_platform,
        delta_robot,
        general_body,
    )
}
"""Every function of the library by its name with dashes. Called without arguments, each returns a mechanism whose
``model.run`` holds a default drive."""
