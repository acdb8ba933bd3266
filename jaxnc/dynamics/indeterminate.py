"""Motions without inertia: found on the null space of the constraints, not coordinate by coordinate."""

import numpy as np

from jaxnc.compiling import jit
from jaxnc.dynamics.flow import Flow
from jaxnc.errors import InputError
from jaxnc.solvers.assembly import rank_of
from jaxnc.system.equations import weights
from jaxnc.types import Array

_NONE = 1e-13  # of the largest inertia of an admissible motion: below, it has none


def check_inertia(flow: Flow, q: Array) -> None:
    """Refuse a mechanism of which some admissible motion has no inertia, so that its acceleration is not determined.

    Raises:
        InputError: naming the points and coordinates that move, and the bodies that lack a mass.
    """
    j, mass = (np.asarray(x) for x in _matrices(flow, q))
    _, null = rank_of(j)
    if not len(null):
        return
    reduced = null @ mass @ null.T
    values, vectors = np.linalg.eigh(0.5 * (reduced + reduced.T))
    if values[0] > _NONE * max(float(np.abs(mass).max()), 1e-300):
        return
    top, view = flow.dyn.topology, flow.view
    motion = np.abs(vectors[:, 0] @ null)
    names = [top.coordinates[view.unknown[k]] for k in np.argsort(-motion)[:4] if motion[k] > 0.05 * motion.max()]
    points = {n.partition(".")[0] for n in names}
    massless = []
    for body in top.bodies:
        at = {top.points[p] for p in body.points}
        index = next((i for group in top.loads.inertias for i in group if i.body == body.name), None)
        if at & points and (index is None or not float(np.asarray(flow.dyn.total)) or _zero(flow, body.name)):
            massless.append(body.name)
    bodies = f"; of what moves there, {', '.join(map(repr, massless))} has no mass" if massless else ""
    raise InputError(
        f"{top.name!r}: a motion that the constraints admit has no inertia, so forces do not determine it: it moves "
        f"{', '.join(names)}{bodies}. Give it mass, or drive it with inputs="
    )


def _zero(flow: Flow, body: str) -> bool:
    top = flow.dyn.topology
    found = next(b for b in top.bodies if b.name == body)
    at = [p * top.dim for p in found.points]
    return not np.asarray(flow.dyn.mass)[np.ix_(at, at)].any()


@jit
def _matrices(flow: Flow, q: Array):
    view = flow.view
    weight = weights(flow.dyn.eq)[view.unknown]
    _, j, _ = view.linearise(flow.dyn.eq, q)
    mass = flow.dyn.mass[view.unknown[:, None], view.unknown[None]] / (weight[:, None] * weight[None])
    return j / weight, mass
