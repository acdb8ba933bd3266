"""From a description to a compiled system: check with names, choose forms, group constraints by kind."""

import copy
import dataclasses
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from jaxnc.doors import door
from jaxnc.mechanism import model as record
from jaxnc.system.assembler import Assembler
from jaxnc.system.planar import PlanarAssembler
from jaxnc.system.precision import WIDE, at_once, chosen, numbers
from jaxnc.system.spatial import SpatialAssembler
from jaxnc.system.system import System
from jaxnc.system.topology import Topology

if TYPE_CHECKING:
    from jaxnc.mechanism import Mechanism


def compile_mechanism(mechanism: "Mechanism", sparse: bool | None, dtype: Any) -> System:
    """Turn a description into a system whose freedoms are counted; see `Mechanism.compile`."""
    wanted = chosen(dtype)
    with numbers(WIDE), at_once():
        system = door("System.degrees_of_freedom")(assemble(mechanism, sparse))
        if system.topology.extended is not None:
            system = door("System.extended")(system)
        return system.astype(wanted)


def assemble(mechanism: "Mechanism", sparse: bool | None = None) -> System:
    """Compile a description; its ``degrees_of_freedom`` are still zero."""
    forms = PlanarAssembler if mechanism.model.dim == 2 else SpatialAssembler
    assembler = forms(mechanism, sparse)
    system = assembler.system()
    if assembler.lacking:
        topology = dataclasses.replace(system.topology, extended=_extended(mechanism, assembler, sparse))
        return System(topology, system.parameters)
    return system


def _extended(mechanism: "Mechanism", assembler: Assembler, sparse: bool | None) -> Topology:
    """The same mechanism, its bodies without a full base given a vector across the segments that they have."""
    model, frames = copy.deepcopy(mechanism.model), {b.name: b.segments for b in assembler.bodies}
    hidden = []
    for name in assembler.lacking:
        first, second = (assembler.drawn(s) for s in frames[name])  # pyright: ignore[reportAttributeAccessIssue]
        across = f"{name} across"
        model.vectors[across] = tuple(map(float, np.cross(first, second)))
        body = model.bodies[name]
        body = body if isinstance(body, record.Body) else record.Body(body)
        model.bodies[name] = msgspec.structs.replace(body, vectors=[*body.vectors, across])
        hidden.append(across)
    other = copy.copy(mechanism)
    other.model = model
    return SpatialAssembler(other, sparse, hidden).system().topology
