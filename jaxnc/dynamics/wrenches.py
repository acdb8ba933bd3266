"""The wrenches on every body, each under the name of what exerts it; together they are the body's own inertia.

Every body obeys ``M_b q̈ + Φ_bᵀ λ = f_b`` on its own coordinates, with its own rows. Rows of joints, loads and efforts
are virtual powers of what they name: their generalised forces are forces on points and couples on vectors, and each
counts for the body whose point or vector it is. What f_b then has left on what the body shares is what passes through
there: a joint, though no row stands for it. Reduced to a wrench, none of it depends on how rows inside of a body share
their load.

Items are points i and vectors k as ~k. A row or load names items; an item that one body alone holds is that body's. Of
an item that several hold, a joint's sides say whose it is (the line of a slot belongs to the rocker, though its pivot
is also the ground's). What stays open acts on the pin itself, and passes through it to each body that shares it.

A relation between coordinates transmits couples. Where it is a mesh (of gears, bevel gears, a rack) they are those of
the tooth force about the wheels' axes. The multiplier of the row alone puts a couple on each wheel and the opposite
ones on the body that carries their bearings. A single force at the pitch point has the same couples about both axes,
and does the same work. What it has more is held by the bearings, and passes through them to the carrier.

Coulomb friction in joints is proportional to the joint's reaction, which it changes itself. The reaction is that of
`jaxnc.dynamics.reactions`: what passes through the pin, also where the pin is a point that two bodies share.
Accelerations, reactions and friction are made consistent by Newton's method for one number of each friction, the force
that presses; where they cannot be, the joint locks. The sign of the sliding speed is smoothed, ``tanh(v / speed)``: a
joint that sticks creeps at a part of that speed.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.constraints.coordinates import axis_items
from jaxnc.dynamics.model import Dynamics, force_values, forces, inertia_coordinates, inertia_nodes, inertias
from jaxnc.forces import COUPLE
from jaxnc.records import with_owner
from jaxnc.solvers.dense import solver
from jaxnc.system.equations import Equations, coefficients, entries, places
from jaxnc.system.frames import spins, spread
from jaxnc.system.identity import GROUND, Owner, Thing
from jaxnc.system.loads import ForceBlock, FrictionIndex
from jaxnc.system.system import System
from jaxnc.system.topology import Block, JointIndex, Segment, Topology
from jaxnc.types import AnyArray, Array, Numbers, PyTree

# -- vectors of poses -------------------------------------------------------------------------------------------------


def array_library(*arrays: object) -> ModuleType:
    """Return NumPy where all is known, so that reading a wrench compiles nothing; else JAX."""
    return np if all(isinstance(a, np.ndarray) for a in arrays) else jnp


def cross(a: Numbers, b: Numbers) -> AnyArray:
    """Return the moment of a force b with the arm a: ``(...,)`` in the plane, ``(..., 3)`` in space."""
    if a.shape[-1] == 2:
        return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    parts = [a[..., i] * b[..., j] - a[..., j] * b[..., i] for i, j in ((1, 2), (2, 0), (0, 1))]
    return array_library(*parts).stack(parts, -1)


def magnitude(x: Numbers) -> AnyArray:
    """Return the length of vectors ``(..., dim)``; zero, with derivative zero, of none."""
    square = (x * x).sum(-1)
    where = array_library(square).where
    return where(square > 0, where(square > 0, square, 1.0) ** 0.5, 0.0)


def _unit(x: AnyArray) -> np.ndarray:
    return x / magnitude(x)[..., None]


# -- whose force it is: static, no numbers ----------------------------------------------------------------------------

NOBODY = -2
"""In place of a body's number: none alone."""

MESHES = ("gear", "internal gear", "bevel gear", "internal bevel gear", "rack and pinion")
_SEPARATE = (*MESHES, "cable", "relation")
"""Joints that are something else than what their bodies share."""


Key = tuple[str, str]
"""Source of a wrench: its sort (``"joint"``, ``"relation"``, ``"point"``, ``"load"``, ``"coordinate"``) and name."""


def key_of(joint: JointIndex) -> Key:
    """Name the wrenches of a joint, relation or constraint."""
    return joint.owner.thing.noun, joint.name


@dataclass(frozen=True)
class Group:
    """Items that a body shares with the same neighbours: a pin, a hinge's point and axis, a point that is fixed.

    `beyond` are, for each item, the bodies whose share of it comes through here; None if it is all of the body's own.
    """

    items: tuple[int, ...]
    neighbours: tuple[int, ...]
    beyond: tuple[frozenset[int] | None, ...]


def body_items(top: Topology, body: int) -> tuple[int, ...]:
    """List points and ~vectors of a body."""
    found = top.bodies[body]
    return (*found.points, *(~u for u in found.vectors))


def instance_items(block: Block | ForceBlock, i: int) -> tuple[int, ...]:
    """List points and ~vectors of an instance of a constraint or force."""
    return (*block.points[i], *(~u for u in block.vectors[i]))


def _fixed_axes(top: Topology, item: int) -> tuple[bool, ...]:
    first = (item if item >= 0 else len(top.points) + ~item) * top.dim
    return top.fixed[first : first + top.dim]


@with_owner
def item_holders(top: Topology) -> dict[int, tuple[int, ...]]:
    """Return the bodies that hold each item, and the ground where it is fixed."""
    out: dict[int, list[int]] = {}
    for b in range(len(top.bodies)):
        for i in body_items(top, b):
            out.setdefault(i, []).append(b)
    for i in (*range(len(top.points)), *(~u for u in range(len(top.vectors)))):
        if all(_fixed_axes(top, i)):
            out.setdefault(i, []).append(GROUND)
    return {i: tuple(found) for i, found in out.items()}


def owner_of(top: Topology, item: int, among: tuple[int, ...] = ()) -> int:
    """Return the body that an item acts for; NOBODY where that is open."""
    found = item_holders(top).get(item, ())
    if len(found) > 1:
        found = tuple(b for b in found if b in among)
    return found[0] if len(found) == 1 else NOBODY


def owner_of_segment(top: Topology, segment: tuple[int, ...], others: tuple[int, ...] = ()) -> int:
    """Return the body that a direction acts for; NOBODY where that is open.

    The ground comes before others. Of several that share the direction it is the one that holds most of the other
    items, as the axis it turns about; the first of several that share two points.
    """
    both = [set(item_holders(top).get(i, ())) for i in segment]
    common = set.intersection(*both)
    if GROUND in common:
        return GROUND
    near = {b: len({*body_items(top, b)} & {*others}) for b in common}
    best = [b for b in sorted(common) if near[b] == max(near.values())]
    return best[0] if len(best) == 1 or (best and len(segment) == 2) else NOBODY


@with_owner
def riding_bodies(top: Topology) -> dict[int, Segment]:
    """Return bodies of one point that keep the direction of a line of another, with that line."""
    return {
        b: body.segments[0]
        for b, body in enumerate(top.bodies)
        if top.dim == 2 and len(body.points) == 1 and body.segments and not set(body.segments[0]) <= {*body.points}
    }


@with_owner
def joint_sides(top: Topology) -> tuple[tuple[int, ...], ...]:
    """Return the bodies that each joint holds together, one for each of its sides; NOBODY where that is open."""
    out = []
    for joint in top.joints:
        found, open_ = [], {}
        for k, side in enumerate(joint.sides):
            both = [set(item_holders(top).get(i, ())) for i in side]
            common = set.intersection(*both) if both else set()
            riders = [b for b, line in riding_bodies(top).items() if b in common and set(line) <= set(joint.points)]
            if GROUND in common:
                found.append(GROUND)
            elif len(riders) == 1:
                found.append(riders[0])
            else:
                open_[k] = common
                found.append(common.pop() if len(common) == 1 else NOBODY)
        # An axis may be a neighbour's too: of those that hold it the one counts that meets the other side in a point.
        for k in (k for k, common in open_.items() if found[k] == NOBODY and len(found) == 2 and found[1 - k] >= 0):
            other = set(top.bodies[found[1 - k]].points)
            meeting = [b for b in open_[k] if b >= 0 and other & set(top.bodies[b].points)]
            found[k] = meeting[0] if len(meeting) == 1 else NOBODY
        out.append(tuple(found))
    return tuple(out)


@with_owner
def shared_groups(top: Topology, body: int) -> tuple[Group, ...]:
    """Part the items that a body shares by neighbours.

    A vector that many share belongs to every part by which `vector_tree` reaches others; any other one to the first
    part with a common neighbour.
    """
    held = item_holders(top)
    shared = {i: {*held[i]} - {body} for i in body_items(top, body) if len(held[i]) > 1 or any(_fixed_axes(top, i))}
    parts: list[tuple[dict[int, frozenset[int] | None], set[int]]] = []
    for i in (i for i in shared if i >= 0):
        joined = [part for part in parts if part[1] & shared[i]]
        one: dict[int, frozenset[int] | None] = dict.fromkeys([*(k for part in joined for k in part[0]), i])
        parts = [part for part in parts if part not in joined]
        parts.append((one, shared[i].union(*(part[1] for part in joined))))
    parts.sort(key=lambda part: min(top.bodies[body].points.index(i) for i in part[0]))
    for i in (i for i in shared if i < 0):
        tree, _ = vector_tree(top, i)
        ways = [({*link} - {body}, _bodies_beyond(tree, body, link)) for link in tree if body in link] or [
            (shared[i], None)
        ]
        for near, beyond in ways:
            part = next((p for p in parts if p[1] & near or (GROUND in near and _is_supported(top, p[0]))), None)
            if part is None:
                parts.append(({i: beyond}, near))
            else:
                part[0][i] = beyond if beyond is None else beyond | (part[0].get(i) or frozenset())
    return tuple(Group(tuple(found), tuple(sorted(near)), tuple(found.values())) for found, near in parts)


def _is_supported(top: Topology, items: Iterable[int]) -> bool:
    """Tell whether the ground holds a point along an axis."""
    return any(i >= 0 and any(_fixed_axes(top, i)) for i in items)


@with_owner
def vector_tree(top: Topology, item: int) -> tuple[tuple[frozenset[int], ...], bool]:
    """Return what joins the bodies that hold a vector, each a set of bodies, and whether that is all of it.

    Bodies are joined by points that they share and by joints, and those that nothing joins to others by the vector
    itself. Where these make a tree, equilibrium says which couple passes from one body to the next. In loops it does
    not, as the vector alone keeps each body in its direction: there a tree is chosen, and it is not all of it. None
    is needed where just two bodies hold a vector.
    """
    holders = {*item_holders(top)[item]}
    if len(holders) < 3:
        return (), True
    links = [holders & {*found} for i, found in item_holders(top).items() if i >= 0]
    links += [{b, GROUND} & holders for b in holders - {GROUND} if _is_supported(top, top.bodies[b].points)]
    links += [holders & {*joint_sides(top)[j][:2]} for j, joint in enumerate(top.joints) if joint.type not in _SEPARATE]
    joined: list[set[int]] = []
    for link in (link for link in links if len(link) > 1):  # two bodies that meet twice have one joint between them
        same = [other for other in joined if len(other & link) > 1]
        joined = [*(other for other in joined if other not in same), link.union(*same)]
    apart, tree, whole = [{b} for b in sorted(holders)], [], True
    for link in joined:
        near = [part for part in apart if part & link]
        whole &= len(near) == len(link)
        if len(near) > 1:
            tree.append(frozenset(min(part & link) for part in near))
            apart = [*(part for part in apart if part not in near), set[int]().union(*near)]
    if len(apart) > 1:
        whole &= max(map(len, apart)) == 1
        tree.append(frozenset(map(min, apart)))
    return tuple(tree), whole


def _bodies_beyond(tree: tuple[frozenset[int], ...], body: int, link: frozenset[int]) -> frozenset[int]:
    """Return the bodies that a tree reaches from a body by one of its links."""
    found, new = {body}, link
    while not new <= found:
        found |= new
        new = frozenset().union(*(other for other in tree if other & (found - {body}) and body not in other))
    return frozenset(found - {body})


@with_owner
def slot_owners(top: Topology) -> tuple[np.ndarray, ...]:
    """Return per block the body that each item of each instance acts for, ``(instances, points + vectors)``."""
    makers = _makers(top)
    out = []
    for b, block in enumerate(top.blocks):
        found = np.full((block.count, block.kind.points + block.kind.vectors), NOBODY)
        for i in range(block.count):
            joint = makers.get((b, i))
            at = instance_items(block, i)
            found[i] = [owner_of(top, item, () if joint is None else _sides_of(top, joint, item)) for item in at]
            if block.kind.measure is not None:
                for k in range(0, block.kind.points - 1, 2):
                    one = owner_of_segment(top, at[k : k + 2], at)
                    if one != NOBODY:
                        found[i, k : k + 2] = one
                for k in range(block.kind.points, len(at)):
                    found[i, k] = owner_of_segment(top, at[k : k + 1], at)
        out.append(found)
    return tuple(out)


def _sides_of(top: Topology, joint: int, item: int) -> tuple[int, ...]:
    """Return the bodies of a joint for which an item may act: the first whose side has it, or all if none has."""
    bodies, held = joint_sides(top)[joint], item_holders(top).get(item, ())
    own = (b for b, side in zip(bodies, top.joints[joint].sides, strict=True) if item in side and b in held)
    first = next(own, NOBODY)
    return bodies if first == NOBODY else (first,)


@with_owner
def _makers(top: Topology) -> dict[tuple[int, int], int]:
    """Return the joint that wrote each instance, those of the coordinates that it makes included."""
    number = {joint.owner: j for j, joint in enumerate(top.joints)}
    out = {
        (b, i): number[owners[0]]
        for b, block in enumerate(top.blocks)
        for i, owners in enumerate(block.owners)
        if owners[0] in number
    }
    first = len(top.coordinates) - len(top.scalars)
    for (b, i), j in list(out.items()):
        if top.joints[j].type in ("rolling", "screw"):
            out |= {top.measures[c - first]: j for c in top.blocks[b].scalars[i]}
    return out


def joint_instances(top: Topology, joint: int) -> list[tuple[int, int]]:
    """List blocks and instances of a joint's own rows, without those of the coordinates that it makes."""
    return [at for at, j in _makers(top).items() if j == joint and top.blocks[at[0]].kind.measure is None]


def joint_rows(top: Topology, joint: int) -> np.ndarray:
    """Return the rows that a joint writes, with those of the coordinates that it makes."""
    found = [top.layout[b].rows[i] for (b, i), j in _makers(top).items() if j == joint]
    return np.concatenate(found) if found else np.zeros(0, int)


@with_owner
def contact_points(top: Topology) -> dict[int, tuple[int, int, int]]:
    """Return contacts of rolling discs that no body holds: the disc's centre, the disc, the body it rolls on."""
    out = {}
    for joint, (first, *rest) in zip(top.joints, (s or (NOBODY,) for s in joint_sides(top)), strict=True):
        if joint.type == "rolling" and not item_holders(top).get(joint.sides[2][0]):
            out[joint.sides[2][0]] = joint.sides[1][0], rest[0], first
    return out


def joints_between(top: Topology, first: int, second: int) -> list[int]:
    """List joints that hold two bodies together, apart from meshes, cables and relations."""
    pair = {first, second}
    return [
        j for j, joint in enumerate(top.joints) if joint.type not in _SEPARATE and pair == set(joint_sides(top)[j][:2])
    ]


def friction_bodies(top: Topology, index: FrictionIndex) -> tuple[int, int]:
    """Return the two bodies that a friction acts between."""
    if index.bodies is not None:
        return index.bodies
    if index.point >= 0:
        return owner_of(top, index.point), GROUND
    found = next(joint_sides(top)[j] for j, joint in enumerate(top.joints) if joint.owner == index.joint)
    return found[1], found[0]


# -- what wrenches are made of ----------------------------------------------------------------------------------------


class Parts(NamedTuple):
    """Parts of the wrenches of poses, everything with a leading axis of poses."""

    q: AnyArray  # poses, (P, N)
    entries: AnyArray  # derivatives of all rows
    multipliers: AnyArray  # of all rows, (P, rows)
    inertia: tuple[Numbers, ...]  # per group of bodies of one form, M q̈ on their nodes, (P, bodies, width)
    weight: tuple[Numbers, ...]  # the same of their weights
    moments: AnyArray  # per group, first moments (P, bodies, dim, width) and masses (P, bodies)
    slips: Numbers  # forces of the rows on velocities on all coordinates, (P, rows, N)
    loads: tuple[Array, ...]  # per block of forces, (P, forces, variables)
    functions: tuple[Array, ...]  # per force that is a function, on all coordinates (P, N)
    friction: tuple[tuple[Array, Array], ...]  # per friction, what it puts on its two bodies, each (P, N)
    constants: AnyArray  # of the constraints of each block
    pressure: dict[int, Numbers]  # pressure angles of the meshes, by joint


Masses = list[tuple[AnyArray, AnyArray, AnyArray]]
"""Per group of bodies of one form: mass matrices, first moments and masses."""


def body_masses(system: System) -> Masses:
    """Return masses and their moments, which do not depend on the pose."""
    return [found[1:] for found in inertias(system)]


def pose_parts(
    system: System, dyn: Dynamics, t: Array, q: Array, v: Array, a: Array, lam: Array, masses: Masses | None = None
) -> Parts:
    """Evaluate `Parts` in one pose, without an axis of poses and without friction."""
    top = system.topology
    masses = body_masses(system) if masses is None else masses
    at = [inertia_coordinates(top, group) for group in top.loads.inertias]
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


def row_forces(eq: Equations, at: np.ndarray, q: Array, lam: Array) -> Array:
    """Return Σ Φ_qᵀ λ over some rows, ``(N,)``."""
    top = eq.topology
    rows, columns, _ = places(top)
    chosen = np.isin(rows, at)
    return jnp.zeros(len(top.coordinates)).at[columns].add(jnp.where(chosen, entries(eq, q) * lam[rows], 0.0))


# -- wrenches ---------------------------------------------------------------------------------------------------------


class Ledger:
    """All wrenches of some poses, about the origin, by body and by what exerts them.

    Args:
        top: the mechanism.
        found: what the wrenches are made of.
        efforts: on driven and held coordinates, by their index.
        only: the body whose wrenches are wanted, if there are no meshes; all if not given.
    """

    def __init__(self, top: Topology, found: Parts, efforts: dict[int, AnyArray], only: int | None = None):
        self.top, self.parts = top, found
        self.only = None if any(joint.type in MESHES for joint in top.joints) else only
        self.points, self.vectors = spread(top, found.q)
        # Per body, force (P, dim) and moment about the origin (P,) or (P, 3) by key.
        self.wrenches: list[dict[Key, tuple[AnyArray, AnyArray]]] = [{} for _ in top.bodies]
        self.taken: dict[tuple[int, int], AnyArray] = {}
        # Per fixed point, forces that its coordinates hold by virtual power, but the ground holds elsewhere.
        self.grounded: dict[int, AnyArray] = {}
        self.pressing: dict[tuple[int, int], list[tuple[Key, AnyArray]]] = {}
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
            _put_mesh(self, j)

    # -- entries --------------------------------------------------------------------------------------------------

    def arm(self, item: int) -> Numbers:
        """Return the place of a point, or a vector."""
        return self.points[..., item, :] if item >= 0 else self.vectors[..., ~item, :]

    def keeps(self, body: int) -> bool:
        """Tell whether a body's wrenches are kept."""
        return body >= 0 and self.only in (None, body)

    def add(self, body: int, key: Key, force: Numbers, moment: Numbers) -> None:
        """Add to a body's wrench."""
        if self.keeps(body):
            before = self.wrenches[body].get(key)
            now = (force, moment) if before is None else (before[0] + force, before[1] + moment)
            self.wrenches[body][key] = now

    def put(self, body: int, key: Key, item: int, force: Numbers, there: bool = True) -> None:
        """Put a force on a point, or a couple on a vector, of a body; an open one stays with those who share the item.

        Not `there` are forces that only stand for a couple.
        """
        if self.keeps(body):
            moment = cross(self.arm(item), force)
            self.add(body, key, force if item >= 0 else force * 0.0, moment)
            self.taken[body, item] = self.taken.get((body, item), 0.0) + force
            if there and key[0] not in ("weight", "point"):
                self.pressing.setdefault((body, item), []).append((key, force))
        elif body == NOBODY and item in contact_points(self.top):
            # Where a disc touches is no place of a body: it goes with the centre, and turns with the line.
            centre, disc, line = contact_points(self.top)[item]
            self.put(disc, key, centre, force, there)
            moment = cross(self.arm(item) - self.arm(centre), force)
            self.add(line, key, force * 0.0, moment)

    def coordinate(self, key: Key, c: int, force: Numbers) -> None:
        """Put a generalised force on one coordinate, by what the coordinate measures."""
        top, dim = self.top, self.top.dim
        if c < self.first_scalar:
            item, axis = divmod(c, dim)
            item = item if item < len(top.points) else ~(item - len(top.points))
            self.put(owner_of(top, item), key, item, force[..., None] * np.eye(dim)[axis])
            return
        straight = not top.angles[c - self.first_scalar]  # a distance, which forces act along; an angle takes couples
        self.instance(key, *top.measures[c - self.first_scalar], self._along(c, force), straight)

    def _along(self, c: int, force: Numbers) -> Numbers:
        """Return what a force on an angle or distance puts on the variables of its measure, ``(P, variables)``."""
        b, i = self.top.measures[c - self.first_scalar]
        rows = self.rows[b][:, i]
        last = rows[..., -1]
        # δs = -Σ Φ_s Φ_q δq / Σ Φ_s², of one row or of several that agree.
        share = force / (last * last).sum(-1)
        return -(rows * (last * share[..., None])[..., None]).sum(-2)

    def lift_off(self, c: int, force: Numbers) -> None:
        """Note that a force on a distance does not act on the ground that it ends at, but elsewhere."""
        b, i = self.top.measures[c - self.first_scalar]
        pushes = zip(self.split(self.top.blocks[b], i, self._along(c, force)), slot_owners(self.top)[b][i], strict=True)
        for (item, f), body in pushes:
            if body == GROUND and not self.top.angles[c - self.first_scalar]:
                self.ground(item, -f)

    def ground(self, item: int, force: Numbers) -> None:
        """Note a force on a fixed point that is none of its support."""
        if item >= 0:
            self.grounded[item] = self.grounded.get(item, 0.0) + force

    def instance(self, key: Key, b: int, i: int, force: Numbers, there: bool = True) -> None:
        """Put forces ``(P, variables)`` on the points and vectors of an instance of a constraint."""
        items, couples = self.split(self.top.blocks[b], i, force), {}
        for (item, f), body in zip(items, map(int, slot_owners(self.top)[b][i]), strict=True):
            self.put(body, key, item, f, there)
            couples[body] = couples.get(body, 0.0) + cross(self.arm(item), f)
        axis = [items[k][0] for k in axis_items(self.top.blocks[b].kind)]
        if not axis or any(not {*axis} <= {*body_items(self.top, body)} for body in couples if body >= 0):
            return  # where a body has no hold of the axis, nobody takes from it what is across
        # What turns about an axis gives no couple across it: that is the hinge's, where a direction is not across.
        way = _axis(self, axis)
        for body, couple in couples.items():
            if self.keeps(body):
                push = cross(way, couple - way * (couple * way).sum(-1)[..., None])
                if axis[1:]:
                    push = push / magnitude(self.points[..., axis[1], :] - self.points[..., axis[0], :])[..., None]
                    self.put(body, key, axis[0], -push, there)
                self.put(body, key, axis[-1], push, there)

    def split(self, block: Block | ForceBlock, i: int, force: Numbers) -> list[tuple[int, AnyArray]]:
        """Part forces on the variables of an instance ``(..., variables)`` by the items that they act on."""
        dim = self.top.dim
        return [(item, force[..., k * dim : (k + 1) * dim]) for k, item in enumerate(instance_items(block, i))]

    # -- what there is --------------------------------------------------------------------------------------------

    def _local_rows(self) -> list[Numbers]:
        """Return per block the derivatives of its rows ``(P, instances, rows, variables)``."""
        out, first = [], 0
        for block, layout in zip(self.top.blocks, self.top.layout, strict=True):
            shape = (block.count, len(block.kind.rows), layout.variables.shape[1])
            size = int(np.prod(shape))
            out.append(self.parts.entries[:, first : first + size].reshape(len(self.parts.q), *shape))
            first += size
        return out

    def pull(self, b: int, i: int) -> Numbers:
        """Return what an instance's multipliers put on its variables, ``(P, variables)``: -Φ_qᵀ λ."""
        lam = self.parts.multipliers[:, self.top.layout[b].rows[i]]
        return -(self.rows[b][:, i] * lam[..., None]).sum(-2)

    def _own(self) -> None:
        """Find what each body's balance leaves to others, ``M q̈ + Φ_bᵀ λ``; put weights and point masses."""
        top, dim = self.top, self.top.dim
        self.left: dict[tuple[int, int], AnyArray] = {}
        number = {body.name: b for b, body in enumerate(top.bodies)}
        for group, inertia, weight in zip(top.loads.inertias, self.parts.inertia, self.parts.weight, strict=True):
            for k, index in enumerate(group):
                for n, item in enumerate(inertia_nodes(index)):
                    at = slice(n * dim, (n + 1) * dim)
                    f, w = inertia[:, k, at], weight[:, k, at]
                    if not index.body:
                        body = owner_of(top, item)
                        self.put(body, ("load", f"mass at {top.points[item]}"), item, w - f)
                        continue
                    b = number[index.body]
                    self.left[b, item] = self.left.get((b, item), 0.0) + f
                    self.put(b, ("weight", ""), item, w)
        for b in range(len(top.bodies)) if self.only is None else [self.only]:
            me = Owner(Thing.BODY, b)
            mine = {r for r, owners in enumerate(top.row_owners) if owners[0] == me}  # they keep the body rigid
            for n, layout in enumerate(top.layout):
                for i in range(len(layout.rows)):
                    if mine & set(layout.rows[i].tolist()):
                        for item, f in self.split(top.blocks[n], i, self.pull(n, i)):
                            self.left[b, item] = self.left.get((b, item), 0.0) - f

    def _measures(self) -> None:
        """Put what the rows of angles and distances transmit: efforts, and others' shares, taken out by `on_scalar`."""
        for s, (b, i) in enumerate(self.top.measures):
            pull = self.pull(b, i)
            self.instance(("coordinate", self.top.scalars[s]), b, i, pull, not self.top.angles[s])
            for (item, f), body in zip(
                self.split(self.top.blocks[b], i, pull), slot_owners(self.top)[b][i], strict=True
            ):
                if body == GROUND and self.top.angles[s]:
                    self.ground(item, -f)  # it stands for a couple; a distance does push on the point it ends at

    def on_scalar(self, key: Key, c: int, force: Numbers) -> None:
        """Put a force on a coordinate that is what exerts it, and no effort."""
        self.coordinate(key, c, force)
        if c >= self.first_scalar:
            self.coordinate(("coordinate", self.top.coordinates[c]), c, -force)

    def on_scalars(self, key: Key, block: Block | ForceBlock, i: int, force: Numbers) -> None:
        """Put the last of the forces ``(P, variables)`` of an instance on the coordinates that it takes."""
        for k, c in enumerate(block.scalars[i]):
            self.on_scalar(key, c, force[:, k - len(block.scalars[i])])

    def _joints(self) -> None:
        """Put what the rows of joints transmit, and rows on velocities."""
        top = self.top
        for j, joint in enumerate(top.joints):
            for b, i in joint_instances(top, j):
                pull = self.pull(b, i)
                self.instance(key_of(joint), b, i, pull)
                self.on_scalars(key_of(joint), top.blocks[b], i, pull)
        for owner, block, i, force in self._slips():
            key = owner.thing.noun, top.called(owner)
            for item, f in dict(self.split(block, i, force)).items():
                self.put(owner_of(top, item), key, item, f)
            self.on_scalars(key, block, i, force)

    def _slips(self) -> Iterator[tuple[Owner, Block, int, Numbers]]:
        """Yield each instance of rows on velocities, whose it is, and its forces ``(P, variables)``.

        A point that is named twice has the whole of its coordinates' forces in both places.
        """
        for block, layout in zip(self.top.rates, self.top.rate_layout, strict=True):
            for i, owners in enumerate(block.owners):
                yield owners[0], block, i, self.parts.slips[:, layout.rows[i]][..., layout.variables[i]].sum(1)

    def _loads(self) -> None:
        """Put springs, dampers, stops, forces and functions."""
        top = self.top
        for block, local in zip(top.loads.forces, self.parts.loads, strict=True):
            for i, name in enumerate(block.names):
                key, couple = ("load", name), block.kind == COUPLE
                for item, f in self.split(block, i, local[:, i]):
                    body = owner_of_segment(top, instance_items(block, i)) if couple else owner_of(top, item)
                    self.put(body, key, item, f, not couple)
                self.on_scalars(key, block, i, local[:, i])
        for f, out in zip(top.loads.functions, self.parts.functions, strict=True):
            places = range(f.at * top.dim, (f.at + 1) * top.dim) if f.acts == "force" else [f.at]
            for c in range(len(top.coordinates)) if f.acts == "load" else places:
                self.on_scalar(("load", f.name), c, out[:, c])

    def _frictions(self) -> None:
        """Put what rubs on both of its bodies."""
        for index, force in zip(self.top.loads.friction, self.parts.friction, strict=False):
            for body, f in zip(friction_bodies(self.top, index), force, strict=True):
                points, vectors = spread(self.top, f)
                for item in body_items(self.top, body) if body >= 0 else ():
                    push = points[..., item, :] if item >= 0 else vectors[..., ~item, :]
                    self.put(body, ("load", index.name), item, push, False)

    def _pins(self) -> None:
        """Put what is left on shared items, under the joint if there is one between the bodies, else the point."""
        top = self.top
        for b, line in riding_bodies(top).items():
            self._ridden(b, line)
        zero = self.points[..., 0, :] * 0.0
        left = {at: f - self.taken.get(at, 0.0) for at, f in self.left.items()}

        def coming(item: int, beyond: frozenset[int]) -> AnyArray:
            """Sum what comes from bodies beyond; the ground or the first holder has what acts on the vector itself."""
            holders = {*item_holders(top)[item]}
            whole = holders - {GROUND} if min(holders) in beyond else set()
            return sum((left.get((k, item), 0.0) * ((k in whole) - (k in beyond)) for k in holders - {GROUND}), zero)

        for b in range(len(top.bodies)) if self.only is None else [self.only]:
            groups = shared_groups(top, b)
            last = {item: group for group in groups for item in group.items}
            for group in groups:
                for item, beyond in zip(group.items, group.beyond, strict=True):
                    if beyond is None or group is last[item] or self.only is not None:  # the forces need no moments
                        force = zero + self.left.get((b, item), 0.0) - self.taken.get((b, item), 0.0)
                    else:
                        force = coming(item, beyond)
                    self.put(b, self.key(b, group), item, force)

    def _ridden(self, b: int, line: Segment) -> None:
        """Put the couple by which a body of one point is turned by a line of another one, which no row carries."""
        top, other = self.top, owner_of_segment(self.top, line)
        found = joints_between(top, b, other)
        key = key_of(top.joints[found[0]]) if found else ("body", top.bodies[b].name)
        for item in line:
            if (b, item) in self.left:
                force = self.left[b, item] - self.taken.get((b, item), 0.0)
                self.put(b, key, item, force)
                self.put(other, key, item, -force)

    def press_on(self, b: int, owner: Owner) -> tuple[AnyArray, AnyArray]:
        """Return what a joint puts on a body, also where others hold the same point or vector."""
        top = self.top
        key = owner.thing.noun, top.called(owner)
        force = self.points[..., 0, :] * 0.0
        total = self.wrenches[b].get(key, (force, cross(force, force)))
        if any(self.key(b, group) == key for group in shared_groups(top, b)):
            return total  # all that the two bodies share passes under its name
        number = next((j for j, joint in enumerate(top.joints) if joint.owner == owner), None)
        shared: list[tuple[int, AnyArray]] = []
        for n, i in joint_instances(top, number) if number is not None else ():
            pushes = zip(self.split(top.blocks[n], i, self.pull(n, i)), slot_owners(top)[n][i], strict=True)
            shared += [push for push, body in pushes if body == NOBODY]
        for one, block, i, slip in self._slips():
            if one == owner:
                shared += [at for at in dict(self.split(block, i, slip)).items() if owner_of(top, at[0]) == NOBODY]
        for item, f in shared:
            if item in body_items(top, b):
                total = total[0] + f * (item >= 0), total[1] + cross(self.arm(item), f)
        return total

    def at(self, b: int, p: int) -> tuple[Numbers, Numbers]:
        """Return what acts on a body where it holds a point: what passes, loads and masses; on its own also joints.

        A joint counts as a whole: of what its rows put on single points only the sum is a wrench. A cable, relation or
        constraint is a force on the point itself. A weld, whose rows take any points of its bodies, has no place but
        the point that these share.
        """
        found = self.through(b, p)
        zero = self.points[..., 0, :] * 0.0
        force, moment = self.wrenches[b][found[0]] if found is not None else (zero, cross(zero, zero))
        whole = {key_of(joint) for joint in self.top.joints if joint.bodies}  # once, and never of a weld
        for key, more in self.pressing.get((b, p), []):
            if found is not None and (key[0] != "load" or key == found[0]):
                continue
            if key not in self.held_whole:
                force, moment = force + more, moment + cross(self.arm(p), more)
            elif key not in whole:
                whole.add(key)
                force, moment = force + self.wrenches[b][key][0], moment + self.wrenches[b][key][1]
        return force, moment

    def centre(self, b: int) -> Numbers:
        """Return the centre of mass of a body; its first point if it has no mass."""
        top = self.top
        for group, (first, masses) in zip(top.loads.inertias, self.parts.moments, strict=True):
            for k, index in enumerate(group):
                if index.body == top.bodies[b].name:
                    x = array_library(self.points).concatenate([self.arm(i) for i in inertia_nodes(index)], -1)
                    return (first[:, k] * x[:, None]).sum(-1) / masses[:, k, None]
        return self.points[..., top.bodies[b].points[0], :]

    def through(self, b: int, item: int) -> tuple[Key, Group] | None:
        """Return the name and the group under which a body shares an item."""
        for group in shared_groups(self.top, b):
            if item in group.items:
                return self.key(b, group), group
        return None

    def key(self, b: int, group: Group) -> Key:
        """Name a group of shared items: by the joint between the two bodies, or by its first point."""
        for near in group.neighbours:
            if len(group.neighbours) == 1 and (found := joints_between(self.top, b, near)):
                return key_of(self.top.joints[found[0]])
        item = group.items[0]
        return "point", self.top.points[item] if item >= 0 else self.top.vectors[~item]


# -- meshes -----------------------------------------------------------------------------------------------------------


def _put_mesh(ledger: Ledger, j: int) -> None:
    """Put the tooth force of a joint where it acts, if it is a mesh whose wheels one body carries."""
    top = ledger.top
    joint = top.joints[j]
    if joint.type not in MESHES:
        return
    (b, i) = joint_instances(top, j)[0]
    scalars = top.blocks[b].scalars[i]
    rack = joint.type == "rack and pinion"
    if rack:
        scalars = scalars[::-1]  # the pinion's angle first
    wheels, starts = zip(*(_turning_bodies(ledger, joint, k, c) for k, c in enumerate(scalars)), strict=True)
    carriers = {}  # of those that hold what both are counted from, the ones in which both turn
    for body in frozenset.intersection(*starts) - {NOBODY, *wheels} if NOBODY not in wheels else ():
        bearings = [(_bearing(ledger, w, body), _bearing(ledger, body, w)) for w in wheels]
        if None not in itertools.chain(*bearings):
            carriers[body] = bearings
    if not carriers or (len(carriers) > 1 and GROUND not in carriers):
        return
    carrier = GROUND if GROUND in carriers else next(iter(carriers))
    keys: list[tuple[Key, Key]] = carriers[carrier]
    place, force, known = (_on_rack if rack else _on_wheel)(ledger, j, b, i)

    def keep(x: Numbers) -> AnyArray:
        """Take a force for zero where its place is not known, so that couples alone stay."""
        return array_library(x, known).where(known if x.ndim > 1 else known[..., 0], x, 0.0)

    key = key_of(joint)
    given = [wrench[key] for wrench in ledger.wrenches if key in wrench]
    on_ground = tuple(-sum(parts) for parts in zip(*given, strict=True))
    befores = [on_ground if wheel == GROUND else ledger.wrenches[wheel][key] for wheel in wheels]
    for sign, wheel, before, (mine, theirs) in zip((1.0, -1.0), wheels, befores, keys, strict=True):
        more = keep(sign * force - before[0]), keep(sign * cross(place, force) - before[1])
        ledger.add(wheel, key, *more)
        ledger.add(wheel, mine, -more[0], -more[1])
        if carrier == GROUND:
            _bear(ledger, wheel, mine, *more)
        if wheel == GROUND:
            _bear(ledger, carrier, theirs, -more[0], -more[1])
        ledger.add(carrier, theirs, *more)
        ledger.add(carrier, key, -more[0], -more[1])
    pull = keep(ledger.pull(b, i))
    for k, c in enumerate(top.blocks[b].scalars[i]):
        ledger.lift_off(c, pull[:, k - len(scalars)])


def _turning_bodies(ledger: Ledger, joint: JointIndex, k: int, c: int) -> tuple[int, frozenset[int]]:
    """Return the body whose motion an angle or distance is, and those that have what it is counted from."""
    top = ledger.top
    b, i = top.measures[c - ledger.first_scalar]
    block = top.blocks[b]
    if not top.angles[c - ledger.first_scalar]:
        start, to = slot_owners(top)[b][i][:2]
        return int(to), frozenset({int(start)})
    points = block.points[i]
    rest = [points[n : n + 2] for n in range(0, len(points), 2)] + [(~u,) for u in block.vectors[i]]
    rest.remove(joint.sides[2 + k])
    if joint.sides[k][1:]:
        rest.remove(joint.sides[k][1:])
    at = (*points, *(~u for u in block.vectors[i]))
    both = [set(item_holders(top).get(i, ())) for i in rest[0]] if rest else [{GROUND}]
    return owner_of_segment(top, joint.sides[2 + k], at), frozenset(set.intersection(*both))


def _bearing(ledger: Ledger, body: int, other: int) -> Key | None:
    """Return the name of a body's wrench from another one; None if nothing joins them."""
    top = ledger.top
    if body == GROUND:
        return "point", ""
    for group in shared_groups(top, body):
        if other in group.neighbours or (other == GROUND and not group.neighbours):
            return ledger.key(body, group)
    found = joints_between(top, body, other)
    return key_of(top.joints[found[0]]) if found else None


def _bear(ledger: Ledger, wheel: int, key: Key, force: Numbers, moment: Numbers) -> None:
    """Let the ground's points under a bearing hold a wrench (about the origin): one, or two along a hinge."""
    top = ledger.top
    joint = next((joint for joint in top.joints if key == key_of(joint)), None)
    near = {i for group in shared_groups(top, wheel) if ledger.key(wheel, group) == key for i in group.items}
    near |= {i for side in (joint.sides[:2] if joint else ()) for i in side}
    points = sorted(i for i in near if i >= 0 and GROUND in item_holders(top).get(i, ()))[:2]
    if not points:
        return
    first = ledger.points[..., points[0], :]
    if len(points) == 2 and top.dim == 3:
        apart = ledger.points[..., points[1], :] - first
        held = cross(moment - cross(first, force), apart) / (apart * apart).sum(-1)[..., None]
        ledger.ground(points[1], held)
        force = force - held
    ledger.ground(points[0], force)


def _on_wheel(ledger: Ledger, j: int, b: int, i: int) -> tuple[Numbers, Numbers, AnyArray]:
    """Return pitch point and force on the first wheel of a gear pair, and where the axes meet or are parallel."""
    top, xp = ledger.top, array_library(ledger.points)
    constants = [c[:, None] for c in ledger.parts.constants[b][:, i].T]
    pull = ledger.pull(b, i)
    couple = pull[..., -2]
    centres = [ledger.points[..., side[0], :] for side in top.joints[j].sides[:2]]
    if top.dim == 2:  # as in space, about axes across the plane; the sign of the row, R1 φ1 ± R2 φ2, is its own
        centres = [xp.concatenate([x, x[..., :1] * 0.0], -1) for x in centres]
        axes = [np.array([0.0, 0.0, 1.0]) + x * 0.0 for x in centres]
        constants = [*constants[:2], 1.0 if top.joints[j].type == "gear" else -1.0]
    else:
        axes = [_axis(ledger, side[1:]) for side in top.joints[j].sides[:2]]
    place, arm, generator, ratio, known = _pitch(xp, centres, axes, constants)
    along = cross(axes[0], arm)
    force = along * (couple / (arm * arm).sum(-1))[..., None]
    pressure = ledger.parts.pressure.get(j)
    if pressure is not None:
        # Away from the other wheel, across the pitch line; inside a ring the other way round.
        across = arm - generator * (arm * generator).sum(-1)[..., None]
        ring = xp.where((ratio < 0.0) & (ratio > -1.0), -1.0, 1.0)[..., 0]
        force = force - _unit(across) * (ring * xp.tan(pressure) * magnitude(force))[..., None]
    return place[..., : top.dim], force[..., : top.dim], known


def _pitch(
    xp: ModuleType, centres: Sequence[Numbers], axes: Sequence[Numbers], constants: Sequence[Numbers | float]
) -> tuple[Numbers, Numbers, Numbers, Numbers, AnyArray]:
    """Return the pitch point in space, its arm from the first axis, the pitch line, and signed ratio of the radii.

    The last result tells where the axes meet or are parallel, and so have a pitch line.
    """
    (a, b), w = axes, centres[1] - centres[0]
    normal, length = cross(a, b), magnitude(w)[..., None]
    ab, wa = ((x * a).sum(-1)[..., None] for x in (b, w))
    square = (normal * normal).sum(-1)[..., None]
    parallel = square <= 1e-8  # the square of a sine: below 1e-4 it may be the drawing's rounding
    safe = xp.where(parallel, 1.0, square)
    t1, t2 = ((cross(w, x) * normal).sum(-1)[..., None] / safe for x in (b, a))
    # Axes that pass each other, as a worm's, have no pitch line: by 1e-4 of the wheels' distance and radius, or more.
    least = 1e-4 * (length + constants[0]) * magnitude(normal)[..., None]
    known = parallel | (xp.abs((w * normal).sum(-1)[..., None]) <= least)
    apex = centres[0] + t1 * a
    ratio = constants[1] / constants[0] * constants[2]
    # Axes that meet: seen from there, each towards its wheel.
    # closer centres stand where the axes meet, which then point to the wheels
    least = 1e-9 * (length + constants[0])
    side1, side2 = (xp.where(t > least, -1.0, 1.0) for t in (t1, t2))
    u1, u2, met = side1 * a, side2 * b, ratio * side1 * side2
    cosine = (u1 * u2).sum(-1)[..., None]
    n = u2 - cosine * u1
    sine = magnitude(n)[..., None]
    n = n / xp.where(parallel, 1.0, sine)
    h = xp.sqrt(sine**2 + (met + cosine) ** 2)
    s = xp.where(parallel, 1.0, sine / xp.where(h > 0, h, 1.0))
    c = (met + cosine) / xp.where(h > 0, h, 1.0)
    half = xp.where(met < 0.0, -1.0, 1.0)  # inside a ring the pitch line is beyond the other axis
    g = half * (c * u1 + s * n)
    crossed_arm = half * constants[0] * n
    # Parallel ones: half way between the wheels along the axes.
    side = xp.where(ab < 0.0, -1.0, 1.0) * ratio
    flat_arm = (w - wa * a) / (1.0 + side)
    arm = xp.where(parallel, flat_arm, crossed_arm)
    place = xp.where(parallel, centres[0] + 0.5 * wa * a + flat_arm, apex + constants[0] / s * g)
    return place, arm, xp.where(parallel, a, g), xp.where(parallel, side, met), known


def _on_rack(ledger: Ledger, j: int, b: int, i: int) -> tuple[Numbers, Numbers, AnyArray]:
    """Return pitch point and force on the pinion of a rack, and where the pinion is beside the rack's line."""
    top, xp = ledger.top, array_library(ledger.points)
    centre, at = top.blocks[b].points[i][:2]
    line = _unit(_axis(ledger, top.joints[j].sides[1][1:]))
    w = ledger.points[..., at, :] - ledger.points[..., centre, :]
    across = w - line * (w * line).sum(-1)[..., None]
    known = magnitude(across)[..., None] > 1e-6 * (magnitude(w)[..., None] + ledger.parts.constants[b][:, i, :1])
    out = _unit(xp.where(known, across, 1.0))
    force = -line * ledger.pull(b, i)[..., -2][..., None]
    place = ledger.points[..., centre, :] + out * ledger.parts.constants[b][:, i, :1]
    pressure = ledger.parts.pressure.get(j)
    if pressure is not None:
        force = force - out * (xp.tan(pressure) * magnitude(force))[..., None]
    return place, force, known


def _axis(ledger: Ledger, segment: Sequence[int]) -> Numbers:
    if len(segment) == 1:
        return ledger.vectors[..., ~segment[0], :]
    return _unit(ledger.points[..., segment[1], :] - ledger.points[..., segment[0], :])


# -- friction ---------------------------------------------------------------------------------------------------------


def has_friction(dyn: Dynamics) -> bool:
    """Tell whether there is any friction."""
    return bool(dyn.topology.loads.friction)


class _Instant(NamedTuple):
    """A state of a motion in which something rubs."""

    dyn: Dynamics
    t: Array
    q: Array
    v: Array
    a: Array
    lam: Array  # multipliers of all rows


class _Rubbing(NamedTuple):
    """A friction in a state of a motion."""

    one: Array  # what each unit of the force that presses puts on its two bodies, (N,)
    other: Array
    bodies: tuple[int, int]
    felt: Array  # forces in the joint, linear in accelerations and multipliers
    # the force that presses, by those and by what other frictions put on a body, (N,), or, of None, on all
    normal: Callable[[Array, Callable[[int | None], Array]], Array]


def friction_forces(dyn: Dynamics, q: Array, v: Array, a: Array, lam: Array, t: Array | float = 0.0) -> Array:
    """Sum the generalised forces of friction ``(N,)``."""
    return sum((f for pair in frictions(dyn, q, v, a, lam, t) for f in pair), jnp.zeros_like(q))


def balance_friction(
    dyn: Dynamics, t: Array | float, q: Array, v: Array, respond: Callable[[Array], tuple[Array, Array, PyTree]]
) -> tuple[Array, PyTree, Array]:
    """Find friction that is consistent with the reactions that it changes.

    Args:
        dyn: the equations of motion.
        t: time.
        q: pose ``(N,)``.
        v: rates.
        respond: of forces of friction ``(N,)``, accelerations, multipliers of all rows, and what else is wanted.

    Returns:
        The forces, what else was wanted, and whether the joints slide rather than lock.
    """
    still, rows = jnp.zeros_like(q), jnp.zeros(len(dyn.topology.rows) + len(dyn.topology.rate_rows))
    every = _list_rubbing(dyn, q, v, still, rows, t)
    ways = jnp.stack([rub.one + rub.other for rub in every])

    def answer(normals: Array) -> tuple[list[Array], PyTree]:
        a, lam, more = respond(normals @ ways)
        return [rub.felt for rub in _list_rubbing(dyn, q, v, a, lam, t)], more

    # All of it is linear in the forces that press: the equations of motion are solved once, and no step contains them.
    begin, push = jax.linearize(answer, jnp.zeros(len(ways)))
    slopes = jax.vmap(push)(jnp.eye(len(ways)))

    def at(normals: Array) -> tuple[list[Array], PyTree]:
        return jax.tree.map(lambda x, slope: x + jnp.tensordot(normals, slope, 1), begin, slopes)

    normals, slides = _solve_normals(lambda given: _press(every, at(given)[0], given), jnp.zeros(len(ways)))
    return normals @ ways, at(normals)[1], slides


def _solve_normals(press: Callable[[Array], Array], begin: Array) -> tuple[Array, Array]:
    """Find forces that press as their own friction makes them, and tell whether there are any."""
    count = len(begin)

    def closer(normals: Array, _: None) -> tuple[Array, Array]:
        found, push = jax.linearize(press, normals)
        slope = jax.vmap(push, out_axes=1)(jnp.eye(count))
        off = (jnp.max(jnp.abs(found - normals)) > 1e-4 * jnp.max(jnp.abs(found))) | jnp.any(found < 0.0)
        return normals + solver(jnp.eye(count) - slope)(found - normals), off

    # Of seven steps the first one begins without friction, and the last one has nothing left to gain.
    normals, off = jax.lax.scan(closer, begin, None, length=7)
    return normals, ~off[-1]


def frictions(dyn: Dynamics, q: Array, v: Array, a: Array, lam: Array, t: Array | float) -> list[tuple[Array, Array]]:
    """Evaluate each friction's forces on the two bodies of `jaxnc.dynamics.wrenches.friction_bodies`, ``(N,)`` each."""
    every = _list_rubbing(dyn, q, v, a, lam, t)
    if not every:
        return []
    felt = [rub.felt for rub in every]
    normals = _press(every, felt, jnp.zeros(len(every)))
    if len(every) > 1:
        normals = _solve_normals(lambda given: _press(every, felt, given), normals)[0]
    return [(n * rub.one, n * rub.other) for n, rub in zip(normals, every, strict=True)]


def _press(every: Sequence[_Rubbing], felt: Sequence[Array], normals: Array) -> Array:
    """Find the forces that press ``(frictions,)``: by what is felt in each joint, without what others put there."""

    def beside(k: int) -> Callable[[int | None], Array]:
        def total(body: int | None) -> Array:
            out = jnp.zeros_like(every[k].one)
            for n, rub in ((n, rub) for j, (n, rub) in enumerate(zip(normals, every, strict=True)) if j != k):
                for own, part in zip(rub.bodies, (rub.one, rub.other), strict=True):
                    if body is None or own == body:
                        out = out + n * part
            return out

        return total

    return jnp.stack([rub.normal(own, beside(k)) for k, (rub, own) in enumerate(zip(every, felt, strict=True))])


def _list_rubbing(dyn: Dynamics, q: Array, v: Array, a: Array, lam: Array, t: Array | float) -> list[_Rubbing]:
    """List all frictions in a state."""
    now, found = _Instant(dyn, jnp.asarray(t, float), q, v, a, lam), []
    for index, numbers in zip(dyn.topology.loads.friction, dyn.friction, strict=True):
        rub = _rub_hinge if index.bodies is not None else _rub_guide if index.point >= 0 else _rub_slider
        found.append(rub(now, index, numbers))
    return found


def _through(now: _Instant, body: int, point: int) -> tuple[Array, np.ndarray]:
    """Return the force that passes into a body where it holds a point, and the points of the joint there."""
    dyn, top = now.dyn, now.dyn.topology
    found = pose_parts(dyn.system, dyn, now.t, now.q, now.v, now.a, now.lam)
    ledger = Ledger(top, jax.tree.map(lambda x: x[None], found), {}, only=body)
    passing = ledger.through(body, point)
    assert passing is not None
    key, group = passing
    return ledger.wrenches[body][key][0][0], np.array([i for i in group.items if i >= 0])


def _oppose(rate: Array, speed: Array) -> Array:
    """Return the direction against a rate ``(k,)``, smoothed where it is slower than `speed`."""
    size = magnitude(rate)
    # At rest it is the slope that counts, of which JAX would find nothing in a direction without length.
    return -jnp.where(size > 0, jnp.tanh(size / speed) / jnp.where(size > 0, size, 1.0), 1.0 / speed) * rate


def _rub_hinge(now: _Instant, index: FrictionIndex, numbers: Array) -> _Rubbing:
    """Put a couple on both bodies of a pin, hinge or ball, against the relative rotation."""
    top = now.dyn.topology
    coefficient, speed, radius = numbers
    assert index.bodies is not None
    turns = [_spin_and_couple(top, body, now.q, now.v) for body in index.bodies]
    against = coefficient * radius * _oppose((turns[0][0] - turns[1][0]) * radius, speed)
    # Of a pin that more bodies share, the force into the first is meant.
    most = 1 if len(item_holders(top)[index.point]) > 2 else 2
    seen = [(k, body) for k, body in enumerate(index.bodies) if body != GROUND][:most]
    pulls, sides = [], list[tuple[int, np.ndarray, Array]]()
    for k, body in seen:
        pull, at = _through(now, body, index.point)
        pulls.append(pull)
        sides.append((body, at, jnp.sum(spread(top, turns[k][1](against if k == 0 else -against))[0][at], axis=0)))

    def normal(felt: Array, beside: Callable[[int | None], Array]) -> Array:
        each: list[tuple[Array, Array]] = []
        for (body, at, own), found in zip(sides, felt, strict=True):
            # What couples of friction put on the body where the joint holds it is taken out again. The own one is
            # proportional to the force n that is wanted, so both follow from one equation, n = |pull - n own|.
            pull = found - jnp.sum(spread(top, beside(body))[0][at], axis=0)
            size, square = magnitude(pull), jnp.sum(own * own)
            along = jnp.sum(pull * own) / jnp.where(size > 0, size, 1.0)
            inner = along**2 + 1.0 - square
            root = along + jnp.sqrt(jnp.where(inner > 0, inner, 1.0))
            # Below zero where there is none: the couple is larger than what the body can bear.
            each.append((square, jnp.where((inner > 0) & (root > 0), size / jnp.where(root > 0, root, 1.0), -size)))
        (square, force), *other = each
        # The first one counts where the pin bears a load of its own. Where its arm is so short that its own equation
        # may have two solutions or none, the longer arm tells it.
        for less, more in other:
            force = jnp.where((square >= 1.0) & (less < square), more, force)
        return force

    return _Rubbing(turns[0][1](against), -turns[1][1](against), index.bodies, jnp.stack(pulls), normal)


def _spin_and_couple(top: Topology, body: int, q: Array, v: Array) -> tuple[Array, Callable[[Array], Array]]:
    """Return a body's angular velocity, and the generalised force of a couple on it by virtual power.

    Both have one component in the plane, and three in space.
    """
    if body == GROUND:
        return jnp.zeros(2 * top.dim - 3), lambda couple: jnp.zeros_like(q)
    found = top.bodies[body]

    def spin(v: Array) -> Array:
        if top.dim == 3:
            return spins(top, found.segments, q, (v,))
        assert found.base is not None
        d, w = (x[found.base[1]] - x[found.base[0]] for x in (spread(top, q)[0], spread(top, v)[0]))
        return cross(d, w)[None] / jnp.dot(d, d)

    rate, back = jax.vjp(spin, v)
    return rate, lambda couple: back(couple)[0]


def _rub_guide(now: _Instant, index: FrictionIndex, numbers: Array) -> _Rubbing:
    """Rub at a point with a fixed coordinate, by what holds the coordinate."""
    dyn, top = now.dyn, now.dyn.topology
    at = np.arange(top.dim) + index.point * top.dim
    fixed = np.array([top.fixed[c] for c in at])
    whole = dyn.mass @ now.a + row_forces(dyn.eq, np.arange(len(top.rows)), now.q, now.lam)
    whole = whole - forces(dyn, now.t, now.q, now.v)
    push = jnp.zeros_like(now.q).at[at[~fixed]].set(numbers[0] * _oppose(now.v[at[~fixed]], numbers[1]))
    return _Rubbing(
        push,
        jnp.zeros_like(now.q),
        friction_bodies(top, index),
        whole[at[fixed]],
        lambda felt, beside: magnitude(felt - beside(None)[at[fixed]]),
    )


def _rub_slider(now: _Instant, index: FrictionIndex, numbers: Array) -> _Rubbing:
    """Rub along the line of a slot, prismatic or cylindrical joint, by what its rows press across it."""
    top = now.dyn.topology
    assert index.joint is not None
    joint = next(j for j in top.joints if j.owner == index.joint)
    start, far, at, *rest = index.line or joint.points
    on = [at, *rest] if index.line else sorted({at, *rest} - {start, far})
    (points, vectors), (rates, _) = spread(top, now.q), spread(top, now.v)
    along = vectors[~far] if far < 0 else points[far] - points[start]
    size = magnitude(along)
    u = along / size
    # What the line feels is put on both of its points in the plane, and on the first in space: the same if it is rigid.
    part = jnp.dot(points[at] - points[start], u) / size if top.dim == 2 else 0.0
    ends = {start: part - 1.0, far: -part} if top.dim == 2 else {start: -1.0}
    force, _ = spread(top, row_forces(now.dyn.eq, top.rows_of(index.joint), now.q, now.lam))
    felt = jnp.sum(force[np.array(on)], axis=0)
    slide = jnp.dot(rates[at] + sum(share * rates[k] for k, share in ends.items()), u)
    push = -numbers[0] * jnp.tanh(slide / numbers[1]) * u
    none, axes = jnp.zeros_like(now.q), np.arange(top.dim)
    line = sum((none.at[axes + k * top.dim].add(share * push) for k, share in ends.items()), none)
    ways = none.at[axes + at * top.dim].add(push), line
    return _Rubbing(*ways, friction_bodies(top, index), felt, lambda felt, _: magnitude(felt))
