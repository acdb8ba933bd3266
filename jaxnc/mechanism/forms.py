"""A description with other equations for the same bodies, joints and coordinates."""

import copy
from typing import Any, get_args

import numpy as np

from jaxnc.errors import MechanismError
from jaxnc.mechanism import model as record


def angle_forms(dim: int) -> list[str]:
    """The forms of an angle in the plane, or in space."""
    missing = ("sum", "difference") if dim == 3 else ("sine x", "sine y", "sine z", "sines")
    return [f for f in get_args(record.AngleForm) if f not in missing]


def distance_forms(dim: int) -> list[str]:
    """The forms of a distance along a line in the plane, or in space."""
    missing = ("sum", "difference") if dim == 3 else ("z",)
    return [f for f in get_args(record.DistanceForm) if f not in missing]


def reformed(model: record.Model, form: Any, angle: Any, distance: Any) -> record.Model:
    """The model with every body, joint, angle and distance in a form; see `Mechanism.in_form`."""
    for what, given, forms in (
        ("form", form, list(get_args(record.TextForm))),
        ("angle", angle, [None, *angle_forms(model.dim)]),
        ("distance", distance, [None, *distance_forms(model.dim)]),
    ):
        if given not in forms:
            raise MechanismError(f"in_form: {what}={given!r}; use one of {', '.join(filter(None, forms))}")
    text = form == "text"
    out = copy.deepcopy(model)
    for name, body in out.bodies.items():
        if not isinstance(body, record.Body):
            body = out.bodies[name] = record.Body(list(body))
        body.form = form
    for joint in out.joints.values():
        if isinstance(joint, record.Prismatic) or (isinstance(joint, record.Rolling) and out.dim == 2):
            joint.form = form
    for data in out.angles.values():
        # In space an angle that is counted from the drawing has no form of the text.
        if out.dim == 2 or data.start is not None:
            data.form = angle or ("cosine" if text else "exact")
    for data in out.distances.values():
        if data.along is not None:
            chosen: Any = _axis(out, data) if text else "exact"
            data.form = distance or chosen
    return out


def _axis(model: record.Model, data: record.Distance) -> str:
    """The coordinate along which a distance's line is drawn most, as the text chooses among (41)-(42), (147)-(149)."""
    vectors = {**model.ground_vectors, **model.vectors}
    if isinstance(data.along, str) and data.along in vectors:
        d = np.array(vectors[data.along])
    else:
        assert data.along is not None
        first, second = (data.start, data.along) if isinstance(data.along, str) else data.along
        d = _drawn(model, second) - _drawn(model, first)
    return "xyz"[int(np.argmax(np.abs(d)))]


def _drawn(model: record.Model, point: str) -> np.ndarray:
    at = model.ground[point] if point in model.ground else model.points[point]
    return np.array(at.at if isinstance(at, record.Point) else at)
