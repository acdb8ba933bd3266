"""A rigid body with many points and vectors: the general case of the source text."""

from collections.abc import Mapping

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import MechanismError
from jaxnc.library.drawing import TURN, choice, drive
from jaxnc.library.space import apart, hardpoints, off_axis, unit
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism.model import Place

_BODY = {  # a housing
    "P1": (0.0, 0.0, 0.0),
    "P2": (0.0, 0.0, 0.30),
    "P3": (0.20, 0.02, 0.05),
    "P4": (0.22, 0.12, 0.25),
    "P5": (-0.05, 0.18, 0.10),
    "P6": (0.10, 0.20, 0.32),
    "P7": (0.12, -0.06, 0.18),
    "v1": (1.0, 0.2, 0.1),
    "v2": (0.0, 1.0, 0.4),
    "v3": (0.3, -0.5, 0.8),
}


@public
def general_body(places: Mapping[str, Place] | None = None, form: str = "exact", hinged: bool = True) -> Mechanism:
    """A rigid body of seven points and three vectors, on a hinge or free.

    On the hinge through its points P1 and P2: n = 25, rows = 24, rank 24, g = 1; input ``phi``, its rotation about
    P1-P2 from the drawing, and a full turn as the default drive. Free: n = 30, rows = 24, rank 24, g = 6; the default
    drive moves six single coordinates of P1, P2 and P3.

    Args:
        places: hardpoints other than the default ones: points P1 to P7 (lengths) and directions v1 to v3.
        form: ``"exact"``: a base of two segments and the direction across them; ``"text"``: a base of three segments,
            (116)-(127).
        hinged: hold P1 and P2.

    Raises:
        MechanismError: for an unknown name or form, a place that is not three numbers, a zero direction, P3 on the line
            P1-P2.

    Source: source text, §4.1.5, (116)-(127) with erratum 4.
    """
    what = "general_body"
    p = hardpoints(what, _BODY, places)
    choice(what, "form", form, ("exact", "text"))
    apart(what, p, ("P1", "P2"))
    axis = unit(p["P2"] - p["P1"])
    off_axis(what, {**p, "P1-P2": axis}, "P3", "P1", "P1-P2")
    if not isinstance(hinged, bool):
        raise MechanismError(f"{what}: hinged must be True or False, got {hinged!r}")
    m = Mechanism("general body", dim=3, description="A rigid body of seven points and three vectors.")
    for name, place in p.items():
        if name.startswith("v"):
            m.vector(name, place)
        elif hinged and name in ("P1", "P2"):
            m.ground(name, place)
        else:
            m.point(name, place)
    m.body("body", [n for n in p if n.startswith("P")], vectors=[n for n in p if n.startswith("v")], form=form)
    if hinged:
        m.angle("phi", at="P1", to="P3", about=("P1", "P2"))
        return drive(m, ["P4", "P6"], {"phi": (0.0, TURN)})
    # P1 moves straight; the two coordinates of P2 that change least along P1-P2, and one of P3, turn the body.
    size = 0.3 * float(max(abs(p["P2"] - p["P1"])))
    first, second, along = sorted(range(3), key=lambda i: abs(axis[i]))
    inputs = {f"P1.{a}": (float(p["P1"][i]), float(p["P1"][i]) + size) for i, a in enumerate("xyz")}
    for i in (first, second):
        inputs[f"P2.{'xyz'[i]}"] = (float(p["P2"][i]), float(p["P2"][i]) + 1.5 * size)
    swing = [abs(x) for x in np.cross(axis, p["P3"] - p["P1"])]
    last = max((first, second, along), key=lambda i: swing[i])
    inputs[f"P3.{'xyz'[last]}"] = (float(p["P3"][last]), float(p["P3"][last]) + 1.2 * size)
    return drive(m, ["P4", "P6"], inputs)
