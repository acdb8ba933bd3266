"""Stewart platform: six legs, six freedoms; here it runs a circle and tilts.

Try: drive the legs by functions of time with `nc.motion`.
"""

import numpy as np

import jaxnc as nc

t = np.linspace(0, 2 * np.pi, 121)
m = nc.library.stewart_platform()

motion = nc.sweep(m.compile(), {f"s{k}": 0.61 + 0.03 * np.sin(t + k * np.pi / 3) for k in range(1, 7)})
trace = ["P"]
