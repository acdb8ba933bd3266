"""Eccentric and flat follower: by a constraint of one's own, the face stays one radius above the centre.

Try: another law in the kind, any pure JAX function of its points, scalars and constants.
"""

import numpy as np

import jaxnc as nc


def above(p, v, s, c):
    """The face F is as far above the centre C as it is drawn."""
    return (p[1][1] - p[0][1] - c[0],)


def drawn(p, v, s, c):
    """The radius, as drawn."""
    return (p[1][1] - p[0][1],)


FLAT_FACE = nc.constraints.Kind("flat face", above, points=2, constants=("radius",), drawn=drawn)

m = nc.Mechanism("eccentric and flat follower")
m.ground("O", (0, 0))
m.point("C", (0.02, 0))
m.point("F", (0, 0.05), fixed="x")
m.body("eccentric", ["O", "C"])
m.constrain("flat_face", FLAT_FACE, points=("C", "F"))
m.angle("phi", at="O", to="C")

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 121)}, rates={"phi": 10.0})
trace = ["C", "F"]
