"""The wrenches on every body, each under the name of what exerts it; together they are the body's own inertia.

Every body obeys ``M_b q̈ + Φ_bᵀ λ = f_b`` on its own coordinates, with its own rows. Rows of joints, loads and efforts
are virtual powers of what they name: their generalised forces are forces on points and couples on vectors, and each
counts for the body whose point or vector it is. What f_b then has left on what the body shares is what passes through
there: a joint, though no row stands for it. Reduced to a wrench, none of it depends on how rows inside of a body share
their load.

A relation between coordinates transmits couples. Where it is a mesh they are those of the tooth force about the
wheels' axes, which acts at the pitch point and so on the bearings: `jaxnc.dynamics.meshes` puts it there.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import filter_jit
from jaxnc.dynamics import sides
from jaxnc.dynamics.inertia import coordinates_of, inertias
from jaxnc.dynamics.meshes import MESHES, mesh
from jaxnc.dynamics.model import Dynamics, force_values
from jaxnc.dynamics.moments import cross, library
from jaxnc.dynamics.sides import NOBODY, Key, key_of
from jaxnc.forces import COUPLE
from jaxnc.system.equations import Equations, coefficients, entries, places
from jaxnc.system.frames import spread
from jaxnc.system.identity import GROUND, Owner
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import Array


class Parts(NamedTuple):
    """What the wrenches of poses are made of, everything with a leading axis of poses."""

    q: Any  # poses, (P, N)
    entries: Any  # derivatives of all rows
    multipliers: Any  # of all rows, (P, rows)
    inertia: Any  # per group of bodies of one form, M q̈ on their nodes, (P, bodies, width)
    weight: Any  # the same of their weights
    moments: Any  # per group, first moments (P, bodies, dim, width) and masses (P, bodies)
    slips: Any  # forces of the rows on velocities on all coordinates, (P, rows, N)
    loads: Any  # per block of forces, (P, forces, variables)
    functions: Any  # per force that is a function, on all coordinates (P, N)
    friction: Any  # per friction, what it puts on its two bodies, each (P, N)
    constants: Any  # of the constraints of each block
    pressure: Any  # pressure angles of the meshes, by joint


Masses = list[tuple[Any, Any, Any]]
"""Per group of bodies of one form: mass matrices, first moments and masses."""


def _masses(system: System) -> Masses:
    return [found[1:] for found in inertias(system)]


def _parts(system: System, dyn: Dynamics, masses: Masses, t: Array, q: Array, v: Array, a: Array, lam: Array) -> Parts:
    top = system.topology
    at = [coordinates_of(top, group) for group in top.loads.inertias]
    loads, functions = force_values(dyn, t, q, v)
    return Parts(
        q=q,
        entries=entries(dyn.eq, q),
        multipliers=lam,
        inertia=tuple(jnp.einsum("bij,bj->bi", local, a[c]) for c, (local, _, _) in zip(at, masses, strict=True)),
        weight=tuple(jnp.einsum("d,bdi->bi", dyn.gravity, first) for _, first, _ in masses),
        moments=tuple((first, m) for _, first, m in masses),
        slips=-lam[len(top.rows) :, None] * coefficients(top, dyn.rates, q) if top.rates else jnp.zeros((0, len(q))),
        loads=loads,
        functions=functions,
        friction=(),
        constants=dyn.eq.constants,
        pressure={
            j: system.parameters.dimensions[joint.pressure] for j, joint in enumerate(top.joints) if joint.pressure >= 0
        },
    )


def parts(system: System, dyn: Dynamics, t: Array, q: Array, v: Array, a: Array, lam: Array) -> Parts:
    """Everything of one pose that the wrenches are made of, with a leading axis of one; without friction."""
    return jax.tree.map(lambda x: x[None], _parts(system, dyn, _masses(system), t, q, v, a, lam))


def all_parts(system: System, dyn: Dynamics, t: Array, q: Array, v: Array, a: Array, lam: Array) -> Parts:
    """The same of poses ``(P, …)``, with the frictions that belong to their multipliers."""
    return _all_parts(system, dyn, _masses(system), t, q, v, a, lam)


@filter_jit
def _all_parts(
    system: System, dyn: Dynamics, masses: Masses, t: Array, q: Array, v: Array, a: Array, lam: Array
) -> Parts:
    from jaxnc.dynamics.friction import frictions

    def one(t, q, v, a, lam):
        found = _parts(system, dyn, masses, t, q, v, a, lam)
        return found._replace(friction=tuple(frictions(dyn, q, v, a, lam, None, t)))

    return jax.vmap(one)(t, q, v, a, lam)


class Ledger:
    """All wrenches of some poses, about the origin, by body and by what exerts them.

    `efforts` are those of driven and held coordinates, by their index. If one body alone is asked for, and there are no
    meshes, it is `only` that.
    """

    def __init__(self, top: Topology, found: Parts, efforts: dict[int, Any], only: int | None = None):
        self.top, self.parts = top, found
        self.only = None if any(joint.type in MESHES for joint in top.joints) else only
        self.points, self.vectors = spread(top, found.q)
        # Per body, force (P, dim) and moment about the origin (P,) or (P, 3) by key.
        self.wrenches: list[dict[Key, tuple[Any, Any]]] = [{} for _ in top.bodies]
        self.taken: dict[tuple[int, int], Any] = {}
        # Per fixed point, forces that its coordinates hold by virtual power, but the ground holds elsewhere.
        self.grounded: dict[int, Any] = {}
        self.pressing: dict[tuple[int, int], list[tuple[Key, Any]]] = {}
        # Joints whose rows say only together what passes; a cable pulls at each of its points.
        self.held_whole = {key_of(joint) for joint in top.joints if joint.drawn and joint.type != "cable"}
        self.first_scalar = len(top.coordinates) - len(top.scalars)
        self.rows = self._local_rows()
        self._own()
        self._measures()
        self._joints()
        self._loads()
        self._frictions()
        for c, effort in efforts.items():
            if c < self.first_scalar:  # those of angles and distances are what their rows transmit
                self.coordinate(("coordinate", top.coordinates[c]), c, effort)
        self._pins()
        for j in range(len(top.joints)):
            mesh(self, j)

    # -- entries ------------------------------------------------------------------------------------------------

    def arm(self, item: int) -> Any:
        """Place of a point, or a vector."""
        return self.points[..., item, :] if item >= 0 else self.vectors[..., ~item, :]

    def wanted(self, body: int) -> bool:
        """Whether a body's wrenches are kept."""
        return body >= 0 and self.only in (None, body)

    def add(self, body: int, key: Key, force: Any, moment: Any) -> None:
        """Add to a body's wrench."""
        if self.wanted(body):
            before = self.wrenches[body].get(key)
            now = (force, moment) if before is None else (before[0] + force, before[1] + moment)
            self.wrenches[body][key] = now

    def put(self, body: int, key: Key, item: int, force: Any, there: bool = True) -> None:
        """A force on a point, or a couple on a vector, of a body; what is open stays with those who share the item.

        Not `there` are forces that only stand for a couple.
        """
        if self.wanted(body):
            moment = cross(self.arm(item), force)
            self.add(body, key, force if item >= 0 else force * 0.0, moment)
            self.taken[body, item] = self.taken.get((body, item), 0.0) + force
            if there and key[0] not in ("weight", "point"):
                self.pressing.setdefault((body, item), []).append((key, force))
        elif body == NOBODY and item in sides.contacts(self.top):
            # Where a disc touches is no place of a body: it goes with the centre, and turns with the line.
            centre, disc, line = sides.contacts(self.top)[item]
            self.put(disc, key, centre, force, there)
            moment = cross(self.arm(item) - self.arm(centre), force)
            self.add(line, key, force * 0.0, moment)

    def coordinate(self, key: Key, c: int, force: Any) -> None:
        """A generalised force on one coordinate, by what the coordinate measures."""
        top, dim = self.top, self.top.dim
        if c < self.first_scalar:
            item, axis = divmod(c, dim)
            item = item if item < len(top.points) else ~(item - len(top.points))
            self.put(sides.whose(top, item), key, item, force[..., None] * np.eye(dim)[axis])
            return
        b, i = top.measures[c - self.first_scalar]
        rows = self.rows[b][:, i]
        last = rows[..., -1]
        # δs = -Σ Φ_s Φ_q δq / Σ Φ_s², of one row or of several that agree.
        share = force / (last * last).sum(-1)
        straight = not top.angles[c - self.first_scalar]  # a distance, which forces act along; an angle takes couples
        self.instance(key, b, i, -(rows * (last * share[..., None])[..., None]).sum(-2), straight)

    def ground(self, item: int, force: Any) -> None:
        """Note a force on a fixed point that is none of its support."""
        if item >= 0:
            self.grounded[item] = self.grounded.get(item, 0.0) + force

    def instance(self, key: Key, b: int, i: int, force: Any, there: bool = True) -> None:
        """Forces on the points and vectors of an instance of a kind, ``(P, variables)``."""
        block, dim = self.top.blocks[b], self.top.dim
        at = (*block.points[i], *(~u for u in block.vectors[i]))
        for k, (item, body) in enumerate(zip(at, sides.slots(self.top)[b][i], strict=True)):
            self.put(int(body), key, item, force[..., k * dim : (k + 1) * dim], there)

    # -- what there is ------------------------------------------------------------------------------------------

    def _local_rows(self) -> list[Any]:
        """Per block, derivatives ``(P, instances, rows, variables)``."""
        out, first = [], 0
        for block, layout in zip(self.top.blocks, self.top.layout, strict=True):
            shape = (block.count, len(block.kind.rows), layout.variables.shape[1])
            size = int(np.prod(shape))
            out.append(self.parts.entries[:, first : first + size].reshape(len(self.parts.q), *shape))
            first += size
        return out

    def pull(self, b: int, i: int) -> Any:
        """What an instance's multipliers put on its variables, ``(P, variables)``: -Φ_qᵀ λ."""
        lam = self.parts.multipliers[:, self.top.layout[b].rows[i]]
        return -(self.rows[b][:, i] * lam[..., None]).sum(-2)

    def _own(self) -> None:
        """What each body's own balance leaves to others on its items: ``M q̈ + Φ_bᵀ λ``; its weight; point masses."""
        top, dim = self.top, self.top.dim
        self.left: dict[tuple[int, int], Any] = {}
        number = {body.name: b for b, body in enumerate(top.bodies)}
        for group, inertia, weight in zip(top.loads.inertias, self.parts.inertia, self.parts.weight, strict=True):
            for k, index in enumerate(group):
                nodes = [index.origin, *(i for s in index.segments for i in s)]
                for n, item in enumerate(nodes):
                    at = slice(n * dim, (n + 1) * dim)
                    f, w = inertia[:, k, at], weight[:, k, at]
                    if not index.body:
                        body = sides.whose(top, item)
                        self.put(body, ("load", f"mass at {top.points[item]}"), item, w - f)
                        continue
                    b = number[index.body]
                    self.left[b, item] = self.left.get((b, item), 0.0) + f
                    self.put(b, ("weight", ""), item, w)
        for b in range(len(top.bodies)) if self.only is None else [self.only]:
            mine = set(sides.body_rows(top, b).tolist())
            for n, layout in enumerate(top.layout):
                for i in range(len(layout.rows)):
                    if mine & set(layout.rows[i].tolist()):
                        block, pull = top.blocks[n], self.pull(n, i)
                        for k, item in enumerate((*block.points[i], *(~u for u in block.vectors[i]))):
                            f = pull[:, k * dim : (k + 1) * dim]
                            self.left[b, item] = self.left.get((b, item), 0.0) - f

    def _measures(self) -> None:
        """What the rows of angles and distances transmit: efforts, and what others put on them, taken out below."""
        dim = self.top.dim
        for s, (b, i) in enumerate(self.top.measures):
            pull = self.pull(b, i)
            self.instance(("coordinate", self.top.scalars[s]), b, i, pull, not self.top.angles[s])
            for k, item in enumerate(self.top.blocks[b].points[i]):
                if sides.slots(self.top)[b][i][k] == GROUND:
                    self.ground(item, -pull[..., k * dim : (k + 1) * dim])

    def on_scalar(self, key: Key, c: int, force: Any) -> None:
        """What something puts on a coordinate is its own, and no effort."""
        self.coordinate(key, c, force)
        if c >= self.first_scalar:
            self.coordinate(("coordinate", self.top.coordinates[c]), c, -force)

    def _joints(self) -> None:
        top = self.top
        for j, joint in enumerate(top.joints):
            for b, i in sides.instances(top, j):
                pull = self.pull(b, i)
                self.instance(key_of(joint), b, i, pull)
                for k, c in enumerate(top.blocks[b].scalars[i]):
                    self.on_scalar(key_of(joint), c, pull[:, k - len(top.blocks[b].scalars[i])])

        for block, layout in zip(top.rates, top.rate_layout, strict=True):
            for i, owners in enumerate(block.owners):
                key = owners[0].thing.noun, top.called(owners[0])
                force = self.parts.slips[:, layout.rows[i]][..., layout.variables[i]].sum(1)
                at = (*block.points[i], *(~u for u in block.vectors[i]))
                for item in dict.fromkeys(at):  # a point named twice has the whole of its coordinates' forces already
                    k = at.index(item)
                    self.put(sides.whose(top, item), key, item, force[:, k * top.dim : (k + 1) * top.dim])
                for k, c in enumerate(block.scalars[i]):
                    self.on_scalar(key, c, force[:, k - len(block.scalars[i])])

    def _loads(self) -> None:
        top, dim = self.top, self.top.dim
        for block, local in zip(top.loads.forces, self.parts.loads, strict=True):
            for i, name in enumerate(block.names):
                key = ("load", name)
                at = (*block.points[i], *(~u for u in block.vectors[i]))
                bodies = [sides.whose(top, item) for item in at]
                if block.kind == COUPLE:
                    bodies = [sides.whose_segment(top, at)] * 2
                for k, (item, body) in enumerate(zip(at, bodies, strict=True)):
                    self.put(body, key, item, local[:, i, k * dim : (k + 1) * dim], block.kind != COUPLE)
                for k, c in enumerate(block.scalars[i]):
                    self.on_scalar(key, c, local[:, i, len(at) * dim + k])
        for f, out in zip(top.loads.functions, self.parts.functions, strict=True):
            for c in range(len(top.coordinates)) if f.acts == "load" else self._places(f):
                self.on_scalar(("load", f.name), c, out[:, c])

    def _frictions(self) -> None:
        for index, force in zip(self.top.loads.friction, self.parts.friction, strict=False):
            for body, f in zip(sides.rubbing(self.top, index), force, strict=True):
                on = spread(self.top, f)
                for item in sides.items(self.top, body) if body >= 0 else ():
                    self.put(
                        body, ("load", index.name), item, on[item < 0][..., item if item >= 0 else ~item, :], False
                    )

    def _places(self, f: Any) -> range:
        first = f.at * self.top.dim if f.acts == "force" else f.at
        return range(first, first + (self.top.dim if f.acts == "force" else 1))

    def _pins(self) -> None:
        """What is left on what bodies share, under the joint if there is one between them, else under the point."""
        top = self.top
        for b, line in sides.rides(top).items():
            self._ridden(b, line)
        for b in range(len(top.bodies)) if self.only is None else [self.only]:
            for group in sides.groups(top, b):
                key = self.key(b, group)
                for item in group.items:
                    force = self.left.get((b, item), 0.0) - self.taken.get((b, item), 0.0)
                    self.put(b, key, item, force + self.points[..., 0, :] * 0.0)

    def _ridden(self, b: int, line: tuple[int, int]) -> None:
        """A body of one point is turned by a line of another one: a couple, which no row carries."""
        top, other = self.top, sides.whose_segment(self.top, line)
        found = sides.between(top, b, other)
        key = key_of(top.joints[found[0]]) if found else ("body", top.bodies[b].name)
        for item in line:
            if (b, item) in self.left:
                force = self.left[b, item] - self.taken.get((b, item), 0.0)
                self.put(b, key, item, force)
                self.put(other, key, item, -force)

    def pressed(self, b: int, owner: Owner) -> tuple[Any, Any]:
        """What a joint's own rows put on all that a body holds, also where others hold it too."""
        top, dim = self.top, self.top.dim
        force = self.points[..., 0, :] * 0.0
        total = force, cross(force, force)
        number = next((j for j, joint in enumerate(top.joints) if joint.owner == owner), None)
        for n, i in sides.instances(top, number) if number is not None else ():
            pull = self.pull(n, i)
            for k, item in enumerate((*top.blocks[n].points[i], *(~u for u in top.blocks[n].vectors[i]))):
                if item in sides.items(top, b):
                    f = pull[..., k * dim : (k + 1) * dim]
                    total = total[0] + f * (item >= 0), total[1] + cross(self.arm(item), f)
        return total

    def at(self, b: int, p: int) -> tuple[Any, Any]:
        """What acts on a body where it holds a point: what passes there, loads and masses; on its own also joints.

        A joint counts as a whole: of what its rows put on single points only the sum is a wrench. A cable, relation or
        constraint is a force on the point itself.
        """
        found = self.through(b, p)
        zero = self.points[..., 0, :] * 0.0
        force, moment = self.wrenches[b][found[0]] if found is not None else (zero, cross(zero, zero))
        whole = set()
        for key, more in self.pressing.get((b, p), []):
            if found is not None and (key[0] != "load" or key == found[0]):
                continue
            if key not in self.held_whole:
                force, moment = force + more, moment + cross(self.arm(p), more)
            elif key not in whole:
                whole.add(key)
                force, moment = force + self.wrenches[b][key][0], moment + self.wrenches[b][key][1]
        return force, moment

    def centre(self, b: int) -> Any:
        """Centre of mass of a body; its first point if it has no mass."""
        top = self.top
        for group, (first, masses) in zip(top.loads.inertias, self.parts.moments, strict=True):
            for k, index in enumerate(group):
                if index.body == top.bodies[b].name:
                    nodes = [index.origin, *(i for s in index.segments for i in s)]
                    x = library(self.points).concatenate([self.arm(i) for i in nodes], -1)
                    return (first[:, k] * x[:, None]).sum(-1) / masses[:, k, None]
        return self.points[..., top.bodies[b].points[0], :]

    def through(self, b: int, item: int) -> tuple[Key, sides.Group] | None:
        """The name and the group under which a body shares an item."""
        for group in sides.groups(self.top, b):
            if item in group.items:
                return self.key(b, group), group
        return None

    def key(self, b: int, group: sides.Group) -> Key:
        """What a group of shared items is called: by the joint between the two bodies, or by its first point."""
        for near in group.neighbours:
            if len(group.neighbours) == 1 and (found := sides.between(self.top, b, near)):
                return key_of(self.top.joints[found[0]])
        item = group.items[0]
        return "point", self.top.points[item] if item >= 0 else self.top.vectors[~item]


def row_forces(eq: Equations, at: np.ndarray, q: Array, lam: Array) -> Array:
    """Σ Φ_qᵀ λ over some rows, ``(N,)``."""
    top = eq.topology
    rows, columns, _ = places(top)
    chosen = np.isin(rows, at)
    return jnp.zeros(len(top.coordinates)).at[columns].add(jnp.where(chosen, entries(eq, q) * lam[rows], 0.0))
