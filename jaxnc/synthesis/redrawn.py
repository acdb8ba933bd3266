"""A design as a description: the mechanism it came from, with the numbers of the design."""

import copy

import numpy as np

from jaxnc.errors import InputError
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.system.system import System


def redrawn(mechanism: Mechanism, system: System) -> Mechanism:
    """The mechanism drawn with the numbers of a design, ready to be saved as a model file.

    Args:
        mechanism: the description that the system's topology was compiled from.
        system: the design.

    Returns:
        A new mechanism; ``redrawn(m, s).compile()`` is the design again.

    Raises:
        InputError: the system was not compiled from this mechanism.
    """
    top, par = system.topology, system.parameters
    out = copy.copy(mechanism)
    out.model = copy.deepcopy(mechanism.model)
    model = out.model
    if set(top.points) != {*model.ground, *model.points} or [m.name for m in top.markers] != list(model.markers):
        raise InputError(f"{top.name!r} was not compiled from {mechanism!r}")
    for name, at in zip(top.points, np.asarray(par.points), strict=True):
        place = tuple(float(v) for v in at)
        if name in model.ground:
            model.ground[name] = place
        else:
            old = model.points[name]
            model.points[name] = record.Point(place, old.fixed) if isinstance(old, record.Point) else place
    for name, at in zip(top.vectors, np.asarray(par.vectors), strict=True):
        place = tuple(float(v) for v in at)
        (model.ground_vectors if name in model.ground_vectors else model.vectors)[name] = place
    for marker, at in zip(top.markers, np.asarray(par.markers), strict=True):
        place = tuple(float(v) for v in at)
        old = model.markers[marker.name]
        model.markers[marker.name] = (
            record.Marker(old.on, direction=place) if marker.direction else record.Marker(old.on, at=place)
        )
    for name, value in zip(top.dimensions, np.asarray(par.dimensions), strict=True):
        _set(model, name, float(value))
    return out


def _set(model: record.Model, name: str, value: float) -> None:
    """Put an explicit dimension where the description has it."""
    for owner, body in model.bodies.items():
        if not name.startswith(owner + ".") or not isinstance(body, record.Body):
            continue
        key = name[len(owner) + 1 :]
        if key in body.lengths:
            body.lengths[key] = value
            return
        point, _, axis = key.rpartition(".")
        if point in body.local:
            place = list(body.local[point])
            place[("along", "across", "normal").index(axis)] = value
            body.local[point] = tuple(place)
            return
    owner, _, what = name.rpartition(".")
    if owner in model.joints:
        joint = model.joints[owner]
        if what.startswith("radius") and what[6:]:
            radii = list(joint.radii)  # pyright: ignore[reportAttributeAccessIssue, reportArgumentType]
            radii[int(what[6:]) - 1] = value
            joint.radii = tuple(radii)  # pyright: ignore[reportAttributeAccessIssue]
        else:
            setattr(joint, what, value)
    elif owner in model.relations:
        if what == "constant":
            model.relations[owner].constant = value
        else:
            model.relations[owner].terms[what] = value
    elif owner in model.constraints:
        model.constraints[owner].constants[what] = value
    else:
        raise InputError(f"dimension {name!r} has no place in the description")
