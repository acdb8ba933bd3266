"""Natural coordinates without, and with, angles and distances (source text §2.3, §3.3)."""

import copy
from collections.abc import Sequence

import jax
import numpy as np

from jaxnc.compiling import jit
from jaxnc.errors import InputError
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.solvers.assembly import derive
from jaxnc.system.equations import Equations
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import Array


def natural(mechanism: Mechanism, keep: tuple[str, ...]) -> Mechanism:
    """The description without its angles and distances, but for some."""
    m = mechanism.model
    for name in keep:
        if name not in mechanism.scalar_names:
            raise InputError(f"keep={name!r}: {m.name!r} has no angle or distance of that name")
    gone = {*m.angles, *m.distances} - set(keep)

    def refuse(what: str, names: list[str]) -> None:
        raise InputError(
            f"{what} is an equation between {' and '.join(names)}, and natural coordinates have no angles and "
            f"distances; use family='mixed', or keep={names!r}"
        )

    for name, joint in m.joints.items():
        if isinstance(joint, record.Gear | record.BevelGear) and set(joint.angles) & gone:
            refuse(f"the gear pair {name!r}", list(joint.angles))
        if isinstance(joint, record.Rolling | record.Screw):
            made = [joint.angle, joint.distance]
            if not set(made) <= set(keep):
                refuse(f"the {type(joint).__name__.lower()} joint {name!r}", made)
        if isinstance(joint, record.RackAndPinion) and {joint.angle, joint.distance} & gone:
            refuse(f"the rack and pinion {name!r}", [joint.angle, joint.distance])
    for name, relation in m.relations.items():
        if set(relation.terms) & gone:
            refuse(f"the relation {name!r}", [s for s in relation.terms if s in gone])
    for what, table in (("constraint", m.constraints), ("force", m.forces)):
        for name, data in table.items():
            if set(data.scalars) & gone:
                refuse(f"the {what} {name!r}", [s for s in data.scalars if s in gone])
    other = copy.copy(mechanism)
    other.model = copy.deepcopy(m)
    other.model.angles = {n: a for n, a in m.angles.items() if n not in gone}
    other.model.distances = {n: d for n, d in m.distances.items() if n not in gone}
    return other


def carried_along(system: System, q: np.ndarray) -> Array:
    """Poses ``(B, N)`` with their angles and distances measured anew from their points."""
    eq = derive(system)
    return jit(jax.vmap(lambda x: measured(system.topology, eq, x, system.topology.scalars)))(q)


def measured(top: Topology, eq: Equations, q: Array, names: Sequence[str]) -> Array:
    """A pose ``(N,)`` with some of its angles and distances measured from its points."""
    for name in names:
        b, i = top.measures[top.scalars.index(name)]
        block, layout = top.blocks[b], top.layout[b]
        x, dim = q[layout.variables[i]], top.dim
        a, e = block.kind.points * dim, (block.kind.points + block.kind.vectors) * dim
        assert block.kind.measure is not None
        value = block.kind.measure(x[:a].reshape(-1, dim), x[a:e].reshape(-1, dim), eq.constants[b][i])
        q = q.at[top.position[name]].set(value)
    return q
