"""A mechanism as a tree of links: which joints hang links on each other, which close loops, what links weigh."""

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from jaxnc.dynamics.extended import extended, lift
from jaxnc.dynamics.model import body_inertia
from jaxnc.families.bodies import Joined, Parts, apart, join, root, spanning_tree
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.robots.description import (
    Description,
    ElementaryJoint,
    Inertia,
    Link,
    LoopClosure,
    Tie,
    Vec,
    cross_matrix,
    free_name,
    join_inertias,
)
from jaxnc.robots.edges import TreeEdge, can_turn, find_edges
from jaxnc.robots.joint_coordinates import JointSum, add_coordinates
from jaxnc.robots.pose import TreePose, joint_values
from jaxnc.solvers.assembly import derive
from jaxnc.system.frames import marker_along
from jaxnc.system.system import System


class ExportTree:
    """The tree of a mechanism in one design.

    Attributes:
        description: links, loops and ties; what of the mechanism is left out, and what was chosen.
        coordinates: the mechanism's coordinates in joints.
        cables: sites along each cable, by its name.
        link_of: number of the link of each part.
    """

    def __init__(self, mechanism: Mechanism, system: System, q: np.ndarray):
        self.mechanism, self.system = mechanism, system
        self.parts = Parts(mechanism)
        self.home = TreePose(self.parts, q)
        self.size = float(np.linalg.norm(np.ptp(self.home.points, axis=0))) or 1.0
        self.links = [Link("ground", -1, np.zeros(3), part=0)]
        self.description = Description(mechanism.name, self.links)
        self.coordinates: dict[str, JointSum] = {}
        self.cables: dict[str, list[str]] = {}
        self.link_of = {0: 0}
        self._points: Joined = apart(self.parts.of_point)
        self._vectors: Joined = apart(self.parts.of_vector)
        self._held: set[int] = set()  # points whose fixed coordinates are kept
        self._done: set[str] = set()  # joints of the user that are written
        self.edges, lost = find_edges(self.parts, self.home)
        for edge in self._hang():
            self._close(edge)
        self.description.left_out += [f"joint {n!r} ({what}): its freedoms are not kept" for n, what in lost.items()]
        self._sort_in_depth()
        self._add_sites()
        add_coordinates(self)
        self._add_masses()
        self._leave_out_rest()

    def joint_values(self, q: np.ndarray) -> np.ndarray:
        """Return values of all joints ``(..., nq)`` of poses ``(..., N)``, hinges counted on through whole turns."""
        out, before = [], None
        for x in q.reshape(-1, q.shape[-1]):
            before = joint_values(self.links, TreePose(self.parts, x, self.home), before)
            out.append(before)
        return np.reshape(out, (*q.shape[:-1], sum(j.width for j in self.joints.values())))

    @property
    def joints(self) -> dict[str, ElementaryJoint]:
        """All joints by name, in their order."""
        return self.description.joints

    def path(self, i: int, j: int) -> list[tuple[float, Link]]:
        """List the links on the way from one part to another, with the sign of their joints."""
        one, other = (self._way(self.link_of[k]) for k in (i, j))
        while one and other and one[0] == other[0]:
            one, other = one[1:], other[1:]
        return [(-1.0, self.links[k]) for k in one[::-1]] + [(1.0, self.links[k]) for k in other]

    def _way(self, k: int) -> list[int]:
        """List the links from the ground to a link, the ground left out."""
        out = []
        while k > 0:
            out.append(k)
            k = self.links[k].parent
        return out[::-1]

    # -- the tree -----------------------------------------------------------------------------------------------

    def _hang(self) -> list[TreeEdge]:
        """Hang every part on another, or free on the ground; the joints that are left close loops.

        A joint is called after the user's, or after its point and the part that hangs on it.
        """
        parts, dim = self.parts, self.parts.dim
        edges = sorted(self.edges, key=lambda e: (not e.wanted, e.freedoms(dim)))
        count = 1 + sum(bool(part.points) for part in parts.parts[1:])  # after these come vectors of no body

        def free(k: int) -> TreeEdge:
            at = parts.parts[k].points[0]
            return TreeEdge(parts.parts[k].name, "free", 0, k, (at, at), turns=can_turn(parts, k), user=True)

        tree: list[TreeEdge] = []
        for edge, parent, child in spanning_tree(count, edges, free):
            name = edge.name if edge.user else f"{edge.name} {parts.parts[child].name}"
            self._add(child, self.link_of[parent], *edge.sequence(parent, dim), name)
            if edge.how != "free":
                self._note_shared(edge)
            tree.append(edge)
        return [edge for edge in edges if not any(edge is hung for hung in tree)]

    def _add(self, k: int, parent: int, at: int, sequence: list[tuple[str, Vec]], name: str) -> None:
        part = self.parts.parts[k]
        link = Link(_new_name(part.name, self.links), parent, self.home.points[at].copy(), part=k)
        link.reference = at if part.turns == "no" else -1
        link.spinless = part.turns == "bar" and all(kind in ("hinge", "slide") for kind, _ in sequence)
        self.link_of[k] = len(self.links)
        self.links.append(link)
        self._add_joints(link, sequence, name)

    def _add_joints(self, link: Link, sequence: list[tuple[str, Vec]], name: str) -> None:
        kinds = [kind for kind, _ in sequence]
        for i, (kind, axis) in enumerate(sequence):
            more = f" {kind}" if len(sequence) > 1 else ""
            more += f" {i + 1}" if kinds.count(kind) > 1 else ""
            link.joints.append(ElementaryJoint(_new_name(name + more, list(self.joints.values())), kind, axis))

    def _note_shared(self, edge: TreeEdge) -> None:
        for items, shared in ((self._points, edge.points), (self._vectors, edge.vectors)):
            for i in shared:
                join(items[i], edge.first, edge.second)
        if edge.holder >= 0:
            self._held.add(edge.holder)
        elif edge.user:
            self._done.add(edge.name)

    # -- loops --------------------------------------------------------------------------------------------------

    def _close(self, edge: TreeEdge) -> None:
        """Close a loop by a joint that is not in the tree, if nothing else does so already."""
        if (edge.user and edge.name in self._done) or edge.holder in self._held:
            return
        i, j = self.link_of[edge.first], self.link_of[edge.second]
        at = self.home.points[edge.at[1]]
        if edge.how in ("revolute", "spherical"):
            self._pin(edge, i, j, at)
            self._note_shared(edge)
            return
        sequence = edge.sequence(edge.first, self.parts.dim)[1]
        if edge.how != "universal":
            sequence = [(kind, axis) for kind, axis in sequence if kind == "slide"]
        k = self._piece(edge, sequence)
        self._loop(edge.name, "weld" if edge.how in ("universal", "prismatic") else "connect", k, j, at)
        if edge.how not in ("universal", "prismatic", "slot") and self.parts.dim == 3:
            self._loop_axis(edge, k, j, at, edge.axes[-1])
        self._note_shared(edge)

    def _pin(self, edge: TreeEdge, i: int, j: int, at: Vec) -> None:
        """Write a pin or ball: what is joined already is not written again."""
        met = [p for p in edge.points if root(self._points[p], edge.first) == root(self._points[p], edge.second)]
        if not met:
            self._loop(edge.name, "connect", i, j, at)
        if edge.how == "revolute" and self.parts.dim == 3 and len(met) < 2:
            self._loop_axis(edge, i, j, at, edge.axes[0])

    def _loop_axis(self, edge: TreeEdge, i: int, j: int, at: Vec, axis: Vec) -> None:
        """Keep another place of an axis together, unless a vector along it is shared."""
        groups = (self._vectors[v] for v in edge.vectors)
        if not any(root(group, edge.first) == root(group, edge.second) for group in groups):
            self._loop(f"{edge.name} axis", "connect", i, j, at + 0.25 * self.size * axis)

    def _loop(self, name: str, kind: str, i: int, j: int, at: Vec) -> None:
        loops = self.description.loops
        loops.append(LoopClosure(_new_name(name, loops), kind, i, j, (at, at)))

    def _piece(self, edge: TreeEdge, sequence: list[tuple[str, Vec]]) -> int:
        """Add a link without mass that has moved by some of a joint's freedoms."""
        name, point = _new_name(f"{edge.name} piece", self.links), edge.at[1]
        place = self.home.points[point].copy()
        link = Link(name, self.link_of[edge.first], place, part=edge.second, auxiliary=True)
        if all(kind == "slide" for kind, _ in sequence):
            link.reference = point
        self.links.append(link)
        self._add_joints(link, sequence, name)
        return len(self.links) - 1

    def name_closure(self, name: str) -> str:
        """Return a name that no loop and no tie has."""
        return _new_name(name, [*self.description.loops, *self.description.ties])

    def _sort_in_depth(self) -> None:
        """Put the links in the order of a file: each followed by what hangs on it."""
        links, order = list(self.links), [0]
        waiting = [k for k in range(len(links) - 1, 0, -1) if links[k].parent == 0]
        while waiting:
            k = waiting.pop()
            order.append(k)
            waiting += [c for c in range(len(links) - 1, 0, -1) if links[c].parent == k]
        new = {old: i for i, old in enumerate(order)} | {-1: -1}
        for link in links:
            link.parent = new[link.parent]
        self.links[:] = [links[k] for k in order]
        self.link_of = {part: new[k] for part, k in self.link_of.items()}
        for loop in self.description.loops:
            loop.first, loop.second = new[loop.first], new[loop.second]

    # -- what links carry ---------------------------------------------------------------------------------------

    def _add_sites(self) -> None:
        """Add places of points and markers, and lines to be shown."""
        a, taken = self.parts.a, set()
        for k, part in enumerate(self.parts.parts):
            if not part.points:
                continue
            link = self.links[self.link_of[k]]
            for p in part.points:
                name = a.names[p] if a.names[p] not in taken else f"{a.names[p]} on {part.name}"
                taken.add(a.names[p])
                link.sites[name] = self.home.points[p]
            if k:
                link.lines = [(self.home.points[p], self.home.points[q]) for p, q in pairwise(part.points)]
                if len(part.points) > 2:
                    link.lines.append((self.home.points[part.points[-1]], self.home.points[part.points[0]]))
        top, eq = self.system.topology, derive(self.system)
        numbers = {marker.name: number for number, marker in enumerate(top.markers)}
        for name, marker in self.mechanism.model.markers.items():
            if marker.direction is not None:
                self.description.left_out.append(f"marker {name!r}: a direction, and sites are places")
                continue
            at = np.zeros(3)
            at[: top.dim] = np.asarray(marker_along(eq, numbers[name], self.home.q, ()))
            self.links[self.link_of[self._part_of(marker.on)]].sites[name] = at

    def _part_of(self, body: str) -> int:
        """Return the part of a body; the ground if there is none."""
        return next((k for k, part in enumerate(self.parts.parts) if body in part.bodies), 0)

    def _add_masses(self) -> None:
        """Give the links the masses of the mechanism; those without get little, or none if no body has any."""
        inner, notes = extended(self.system), self.description.notes
        for k, number in self.link_of.items():
            pieces = [self._body_inertia(inner, body) for body in self.parts.parts[k].bodies]
            pieces += self._point_masses(k)
            self.links[number].inertia = join_inertias([p for p in pieces if p is not None and p.mass > 0])
        moving = [link for link in self.links[1:] if not link.auxiliary]
        known = [link.inertia for link in moving if link.inertia is not None]
        if not known:
            if moving:
                what = f"links have that of their capsules, {self.density:.4g} kg a cubic unit of length"
                notes.append(f"no body has a mass: {what}")
            return
        # 1e-6 of the mean mass get links that have none, where others do
        light = 1e-6 * float(np.mean([i.mass for i in known]))
        for link in self.links[1:]:
            if link.inertia is None:
                link.inertia = Inertia(light, link.origin, light * (0.1 * self.size) ** 2 * np.eye(3))
                notes.append(f"link {link.name!r} has no mass: it is given {light:.3g}, since no link may be without")
            else:
                self._fill(link.name, link.inertia)

    @property
    def density(self) -> float:
        """Of capsules where no body has a mass: so much that MuJoCo takes their inertias, whatever their unit."""
        return max(1000.0, 2e-3 / self.size**5)

    def _body_inertia(self, inner: System, body: str) -> Inertia | None:
        """Return mass, centre of mass and inertia of a body in the home pose, by its own mass matrix."""
        dim, top = self.parts.dim, inner.topology
        if not top.loads.inertias:
            return None
        at, local, first, m = map(np.asarray, body_inertia(inner, body))
        if not float(m):
            return None
        q = np.asarray(lift(self.system.topology, self.home.q))[at]
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

    def _point_masses(self, k: int) -> list[Inertia]:
        """List the point masses that a part carries: of a point that several hold, the first does."""
        physical, out = np.asarray(self.system.parameters.physical), []
        for group in self.system.topology.loads.inertias:
            for index in group:
                holders = [h for h in self.parts.of_point[index.origin] if h]
                if not index.body and holders and holders[0] == k:
                    mass = float(physical[index.mass])
                    out.append(Inertia(mass, self.home.points[index.origin], np.zeros((3, 3))))
        return out

    def _fill(self, name: str, inertia: Inertia) -> None:
        """Make an inertia one that a simulator takes: positive about every axis."""
        values, axes = np.linalg.eigh(inertia.tensor)
        largest, rest = values[-1], values[0] + values[1]
        rounding = 1e-10
        if 0.0 < largest < rest * (1.0 + rounding) and rest < largest * (1.0 + rounding):
            values[:2] *= 1.0 + 2.0 * rounding  # what is flat: rounding must not make one moment larger than the others
            inertia.tensor = (axes * values) @ axes.T
        if largest <= 0.0:
            inertia.tensor = inertia.mass * (1e-3 * self.size) ** 2 * np.eye(3)
            what = "is a point mass: it is given the inertia of a small ball, since no link may be without"
            self.description.notes.append(f"link {name!r} {what}")
        elif values[0] < 1e-9 * largest:  # the link has no inertia about an axis
            share = 1e-2  # of the largest moment
            inertia.tensor = (axes * np.maximum(values, share * largest)) @ axes.T
            what = f"has no inertia about its own line: it is given {share:g} of that across it"
            self.description.notes.append(f"link {name!r} {what}")

    def _leave_out_rest(self) -> None:
        """Write welds between links, and name what a tree has nothing for."""
        model, d = self.mechanism.model, self.description
        d.left_out += [f"constraint {name!r} of kind {c.kind!r}" for name, c in model.constraints.items()]
        d.left_out += [f"friction {name!r}: Coulomb friction in proportion to a reaction" for name in model.friction]
        loose = [part.name for part in self.parts.parts[1:] if not part.points]
        d.left_out += [f"vector {name!r}: it belongs to no body" for name in loose]
        for name, joint in model.joints.items():
            if isinstance(joint, record.Weld):
                one, other = (self._part_of(body) for body in joint.bodies)
                if one != other:
                    i, j = self.link_of[one], self.link_of[other]
                    self._loop(name, "weld", i, j, self.links[j].origin)
        if model.units.length != "m":
            d.notes.append(f"lengths are in {model.units.length} as in the mechanism, and numbers are not converted")


def _new_name(name: str, things: Iterable[Link | ElementaryJoint | LoopClosure | Tie]) -> str:
    """Return a name that none of some things has, and that is not "world"."""
    return free_name(name, {"world", *(thing.name for thing in things)})
