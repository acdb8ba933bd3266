"""A design as a description: the mechanism it came from, with the numbers of the design."""

import copy
from typing import Any

import numpy as np

from jaxnc.errors import InputError
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.system.identity import Owner, Thing
from jaxnc.system.system import System


def redrawn(mechanism: Mechanism, system: System) -> Mechanism:
    """The mechanism drawn with the numbers of a design, ready to be saved as a model file."""
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
    for dimension, value in zip(top.given, np.asarray(par.dimensions), strict=True):
        _set(model, dimension.owner, dimension.key, float(value))
    return out


def _set(model: record.Model, owner: Owner, key: str, value: float) -> None:
    """Put an explicit dimension where the description has it."""
    if owner.thing is Thing.BODY:
        body = list(model.bodies.values())[owner.number]
        assert isinstance(body, record.Body)
        if key in body.lengths:
            body.lengths[key] = value
            return
        point, _, axis = key.rpartition(".")
        place = list(body.local[point])
        place[("along", "across", "normal").index(axis)] = value
        body.local[point] = tuple(place)
    elif owner.thing is Thing.JOINT:
        joint: Any = list(model.joints.values())[owner.number]
        if key in ("radius1", "radius2"):
            radii = list(joint.radii)
            radii[int(key[-1]) - 1] = value
            joint.radii = tuple(radii)
        else:
            setattr(joint, key, value)
    elif owner.thing is Thing.RELATION:
        relation = list(model.relations.values())[owner.number]
        if key in relation.terms:
            relation.terms[key] = value
        else:
            relation.constant = value
    else:
        list(model.constraints.values())[owner.number].constants[key] = value
