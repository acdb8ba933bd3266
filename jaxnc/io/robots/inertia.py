"""Masses of links from the masses of the bodies that they are, by the bodies' own mass matrices."""

from typing import TYPE_CHECKING

import numpy as np

from jaxnc.dynamics.extended import extended, lift
from jaxnc.dynamics.mass import inertias
from jaxnc.io.robots.pose import cross_matrix
from jaxnc.io.robots.tree import Inertia, Vec

if TYPE_CHECKING:
    from jaxnc.io.robots.grown import Grown

_LIGHT = 1e-6  # of the mean mass: what links get that have none, where others do
_FLAT = 1e-9  # of the largest moment: below this a link has no inertia about an axis
_ROUND = 1e-10
_SPIN = 1e-2  # of the largest moment: what a bar gets about its own line


def add_inertia(grown: "Grown") -> None:
    """Give the links the masses of the mechanism; those without stay None."""
    tree, parts = grown.tree, grown.parts
    grown.inertias = inertias(extended(grown.system))
    for k, number in grown.link_of.items():
        pieces = [body_parts(grown, body) for body in parts.parts[k].bodies]
        pieces += [_point(grown, p, m) for p, m in _points(grown, k)]
        link = tree.links[number]
        link.inertia = joined([p for p in pieces if p is not None and p.mass > 0])
    moving = [link for link in tree.links[1:] if not link.auxiliary]
    known = [link.inertia for link in moving if link.inertia is not None]
    if not known:
        if moving:
            said = f"{density(grown.size):.4g} kg a cubic unit of length"
            tree.notes.append(f"no body has a mass: links have that of their capsules, {said}")
        return
    mean = float(np.mean([i.mass for i in known]))
    for link in tree.links[1:]:
        if link.inertia is None:
            light = _LIGHT * mean
            link.inertia = Inertia(light, link.origin, light * (0.1 * grown.size) ** 2 * np.eye(3))
            tree.notes.append(f"link {link.name!r} has no mass: it is given {light:.3g}, since no link may be without")
        else:
            _filled(link.name, link.inertia, tree.notes, grown)


def density(size: float) -> float:
    """Density of capsules where no body has a mass: so much that MuJoCo takes their inertias, whatever their unit."""
    return max(1000.0, 2e-3 / size**5)


def body_parts(grown: "Grown", body: str) -> Inertia | None:
    """Mass, centre of mass and inertia of a body in the home pose."""
    inner = extended(grown.system)
    dim, top = grown.parts.dim, inner.topology
    places = [(g, i) for g, group in enumerate(top.loads.inertias) for i, x in enumerate(group) if x.body == body]
    if not places:
        return None
    (group, i), *_ = places
    at, local, first, m = (np.asarray(x)[i] for x in grown.inertias[group])
    if not float(m):
        return None
    q = np.asarray(lift(grown.system.topology, grown.home.q))[at]
    com = np.zeros(3)
    com[:dim] = first @ q / float(m)
    # A turn about the centre of mass moves the nodes, and their mass matrix knows the energy of that.
    turns = np.zeros((len(at), 3))
    for n in range(0, len(at), dim):
        arm = np.zeros(3)
        arm[:dim] = q[n : n + dim]
        if at[n] < dim * len(top.points):
            arm = arm - com
        turns[n : n + dim] = -cross_matrix(arm)[:dim]
    tensor = turns.T @ local @ turns
    if dim == 2:  # what is flat turns about z only: what it has about the other axes is never felt
        tensor = np.diag([0.6, 0.6, 1.0]) * tensor[2, 2]
    return Inertia(float(m), com, tensor)


def _points(grown: "Grown", k: int) -> list[tuple[int, float]]:
    """Point masses that a part carries: of a point that several hold, the first."""
    physical, out = np.asarray(grown.system.parameters.physical), []
    for group in grown.system.topology.loads.inertias:
        for index in group:
            holders = [h for h in grown.parts.of_point[index.origin] if h]
            if not index.body and holders and holders[0] == k:
                out.append((index.origin, float(physical[index.mass])))
    return out


def _point(grown: "Grown", p: int, mass: float) -> Inertia:
    return Inertia(mass, grown.home.points[p], np.zeros((3, 3)))


def joined(pieces: list[Inertia]) -> Inertia | None:
    """Several rigid pieces as one."""
    if not pieces:
        return None
    mass = sum(p.mass for p in pieces)
    com: Vec = sum((p.mass * p.com for p in pieces), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for p in pieces:
        x = cross_matrix(p.com - com)
        tensor = tensor + p.tensor - p.mass * (x @ x)
    return Inertia(mass, com, tensor)


def _filled(name: str, inertia: Inertia, notes: list[str], grown: "Grown") -> None:
    """Make an inertia one that a simulator takes: positive about every axis."""
    values, axes = np.linalg.eigh(inertia.tensor)
    largest = values[-1]
    if 0.0 < largest < (values[0] + values[1]) * (1.0 + _ROUND) and values[0] + values[1] < largest * (1.0 + _ROUND):
        values[:2] *= 1.0 + 2.0 * _ROUND  # what is flat: rounding must not make one moment larger than the others
        inertia.tensor = (axes * values) @ axes.T
    if largest <= 0.0:
        inertia.tensor = inertia.mass * (1e-3 * grown.size) ** 2 * np.eye(3)
        notes.append(
            f"link {name!r} is a point mass: it is given the inertia of a small ball, since no link may be without"
        )
    elif values[0] < _FLAT * largest:
        inertia.tensor = (axes * np.maximum(values, _SPIN * largest)) @ axes.T
        notes.append(f"link {name!r} has no inertia about its own line: it is given {_SPIN:g} of that across it")
