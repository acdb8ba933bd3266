"""Slider-crank with an offset: the stroke forward takes longer than the stroke back.

Try: `nc.inverse_dynamics` with a force on the piston, and the reactions in all joints.
"""

import numpy as np

import jaxnc as nc

m = nc.library.slider_crank(crank=0.1, conrod=0.25, offset=0.06)

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 181)}, rates={"phi": 10.0})
trace = ["B", "C"]
