"""Motions that nothing determines: those without inertia, and inputs that leave no motion to be prescribed."""

from collections.abc import Sequence

import numpy as np

from jaxnc.compiling import filter_jit
from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.inertia import body_inertia
from jaxnc.errors import InputError
from jaxnc.solvers.assembly import hosted, rank_of
from jaxnc.system.equations import coefficients
from jaxnc.system.topology import Topology
from jaxnc.types import Array

_NONE = 1e-13  # of the largest inertia of an admissible motion: below, it has none


def check_inertia(flow: Flow, q: Array) -> None:
    """Refuse a mechanism of which some admissible motion has no inertia, so that its acceleration is not determined."""
    _possible(flow)
    u, (j, _), weight = flow.view.unknown, _columns(flow, q), hosted(flow.dyn.eq).weights
    mass = np.asarray(flow.dyn.mass)[np.ix_(u, u)] / np.outer(weight[u], weight[u])
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
    masses = _masses(flow)
    massless = [b.name for b in top.bodies if {top.points[p] for p in b.points} & points and not masses.get(b.name)]
    have = "has" if len(massless) == 1 else "have"
    bodies = f"; of what moves there, {', '.join(map(repr, massless))} {have} no mass" if massless else ""
    raise InputError(
        f"{top.name!r}: a motion that the constraints admit has no inertia, so forces do not determine it: it moves "
        f"{', '.join(names)}{bodies}. Give it mass, or drive it with inputs="
    )


def check_count(top: Topology, freedom: int, names: Sequence[str]) -> None:
    """Refuse more inputs than freedoms."""
    if len(names) > freedom:
        degrees = f"{freedom} degree{'s' * (freedom != 1)} of freedom"
        raise InputError(
            f"too many inputs: {top.name!r} has {degrees}, {len(names)} inputs were given ({', '.join(names)}). Leave "
            f"{len(names) - freedom} of them out"
        )


def check_inputs(flow: Flow, q: Array) -> None:
    """Refuse inputs that cannot all be prescribed at the start."""
    if not flow.drives:
        return
    what, said = repr(flow.dyn.topology.name), ", ".join(name for name, _ in flow.drives)
    j, known = _columns(flow, q)
    if rank_of(np.concatenate([j, known], axis=1))[0] > rank_of(j)[0]:
        raise InputError(
            f"{what}: the inputs {said} cannot be prescribed where the motion begins: they depend on each other there, "
            f"or it is a dead point of them. Leave one out, or begin elsewhere with state="
        )


def _possible(flow: Flow) -> None:
    top = flow.dyn.topology
    whole = np.asarray(flow.dyn.mass)
    if np.linalg.eigvalsh(whole)[0] >= -_NONE * np.abs(whole).max():
        return
    for body in top.bodies:
        own = np.asarray(body_inertia(flow.dyn.system, body.name)[1])
        if own.size and np.linalg.eigvalsh(own)[0] < -_NONE * np.abs(own).max():
            raise InputError(
                f"{top.name!r}: no body has the inertia of {body.name!r}: it could move with negative energy"
            )


def _masses(flow: Flow) -> dict[str, float]:
    """Masses of bodies and point masses by name."""
    physical = np.asarray(flow.dyn.system.parameters.physical)
    return {i.body: float(physical[i.mass]) for group in flow.dyn.topology.loads.inertias for i in group}


def _columns(flow: Flow, q: Array) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the rows by the unknown and by the driven coordinates, every coordinate a length."""
    view, eq, at = flow.view, hosted(flow.dyn.eq), np.asarray(q)
    j = eq.jacobian(at[:, None])[0][view.rows]
    if flow.dyn.topology.rates:
        j = np.concatenate([j, np.asarray(_rates(flow.dyn.topology, flow.dyn.rates, at))])
    j = j / eq.weights
    return j[:, view.unknown], j[:, view.known]


@filter_jit
def _rates(top: Topology, constants: tuple[Array, ...], q: Array) -> Array:
    return coefficients(top, constants, q)
