"""A tree of links grown from a mechanism: which joints it has, and which close loops."""

from itertools import pairwise

import numpy as np

from jaxnc.families.bodies import Joined, Parts, apart, join, root
from jaxnc.io.robots.inertia import add_inertia
from jaxnc.io.robots.joints import Edge, edges
from jaxnc.io.robots.pose import Posed
from jaxnc.io.robots.readings import add_readings
from jaxnc.io.robots.tree import Joint, Link, Loop, Tree, Vec
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.solvers.assembly import derive
from jaxnc.system.frames import marker_along
from jaxnc.system.system import System


class Grown:
    """The tree of a mechanism in one design.

    `q` is the home pose, ``(N,)``.
    """

    def __init__(self, mechanism: Mechanism, system: System, q: np.ndarray):
        self.mechanism, self.system = mechanism, system
        self.parts = Parts(mechanism)
        self.home = Posed(self.parts, q)
        self.size = float(np.linalg.norm(np.ptp(self.home.points, axis=0))) or 1.0
        self.tree = Tree(mechanism.name, [Link("ground", -1, np.zeros(3), part=0)])
        self.link_of = {0: 0}  # the link of every part
        self.points: Joined = apart(self.parts.of_point)
        self.vectors: Joined = apart(self.parts.of_vector)
        self.held: set[int] = set()
        self.done: set[str] = set()
        self.inertias: list = []
        lost: dict[str, str] = {}
        found = edges(self.parts, self.home, lost)
        left = self._hang(found)
        for edge in left:
            self._close(edge)
        self.tree.left_out += [f"joint {name!r} ({what}): its freedoms are not kept" for name, what in lost.items()]
        self._in_depth()
        self._sites()
        add_readings(self, found)
        add_inertia(self)
        self._rest()

    # -- the tree -----------------------------------------------------------------------------------------------

    def _hang(self, found: list[Edge]) -> list[Edge]:
        """Hang every part on another, or free on the ground; the joints that are left close loops."""
        parts, dim = self.parts, self.parts.dim
        group = {k: k for k in range(len(parts.parts))}
        chosen, left = [], []
        for edge in sorted(found, key=lambda e: (not e.wanted, e.freedoms(dim))):
            a, b = root(group, edge.first), root(group, edge.second)
            if a == b:
                left.append(edge)
                continue
            group[b] = a
            chosen.append(edge)
        waiting = [k for k, part in enumerate(parts.parts) if k and part.points]
        while waiting:
            step = next((e for e in chosen if (e.first in self.link_of) != (e.second in self.link_of)), None)
            if step is None:
                self._free(next(k for k in waiting if k not in self.link_of))
            else:
                self._hang_on(step)
            waiting = [k for k in waiting if k not in self.link_of]
        return left

    def _hang_on(self, edge: Edge) -> None:
        parent, child = (edge.first, edge.second) if edge.first in self.link_of else (edge.second, edge.first)
        at, sequence = edge.sequence(parent, self.parts.dim)
        self._add(child, self.link_of[parent], at, sequence, self._name(edge, child))
        self._joined(edge)

    def _free(self, k: int) -> None:
        part, dim = self.parts.parts[k], self.parts.dim
        slides = [("slide", axis) for axis in np.eye(3)[:dim]]
        if part.turns == "no":
            sequence = slides
        else:
            sequence = [*slides, ("hinge", np.eye(3)[2])] if dim == 2 else [("free", np.eye(3)[2])]
        self._add(k, 0, part.points[0], sequence, part.name)

    def _add(self, k: int, parent: int, at: int, sequence: list[tuple[str, Vec]], name: str) -> None:
        part = self.parts.parts[k]
        origin = self.home.points[at].copy()
        link = Link(self.unused(part.name, [x.name for x in self.tree.links]), parent, origin, part=k)
        link.reference = at if part.turns == "no" else -1
        if part.turns == "bar" and all(kind in ("hinge", "slide") for kind, _ in sequence):
            link.spinless = True
        self.link_of[k] = len(self.tree.links)
        self.tree.links.append(link)
        self._joints(link, sequence, name)

    def _joints(self, link: Link, sequence: list[tuple[str, Vec]], name: str) -> None:
        for i, (kind, axis) in enumerate(sequence):
            more = (
                ""
                if len(sequence) == 1
                else f" {kind}" + (f" {i + 1}" if sum(k == kind for k, _ in sequence) > 1 else "")
            )
            link.joints.append(Joint(self.unused(name + more, list(self.tree.joints)), kind, axis))

    def _name(self, edge: Edge, child: int) -> str:
        """What a joint is called: after the user's joint, or after the point and the part that hangs on it."""
        return edge.name if edge.user else f"{edge.name} {self.parts.parts[child].name}"

    def unused(self, name: str, taken: list[str]) -> str:
        """A name that nothing has yet."""
        k, out = 1, name
        while out in taken or out == "world":
            k += 1
            out = f"{name} {k}"
        return out

    def _joined(self, edge: Edge) -> None:
        for items, shared in ((self.points, edge.points), (self.vectors, edge.vectors)):
            for i in shared:
                join(items[i], edge.first, edge.second)
        if edge.holder >= 0:
            self.held.add(edge.holder)
        elif edge.user:
            self.done.add(edge.name)

    # -- loops --------------------------------------------------------------------------------------------------

    def _close(self, edge: Edge) -> None:
        """Close a loop by a joint that is not in the tree, if nothing else does so already."""
        if (edge.user and edge.name in self.done) or edge.holder in self.held:
            return
        i, j = self.link_of[edge.first], self.link_of[edge.second]
        at = self.home.points[edge.at[1]]
        if edge.how in ("revolute", "spherical"):
            self._pin(edge, i, j, at)
        elif edge.how == "universal":
            k = self._piece(edge, edge.sequence(edge.first, self.parts.dim)[1])
            self._loop(edge.name, "weld", k, j, at)
        else:
            sequence = edge.sequence(edge.first, self.parts.dim)[1]
            k = self._piece(edge, [(kind, axis) for kind, axis in sequence if kind == "slide"])
            if edge.how == "prismatic":
                self._loop(edge.name, "weld", k, j, at)
            elif edge.how == "slot" or self.parts.dim == 2:
                self._loop(edge.name, "connect", k, j, at)
            else:
                axis = edge.axes[-1]
                self._loop(edge.name, "connect", k, j, at)
                if not any(
                    root(self.vectors[v], edge.first) == root(self.vectors[v], edge.second) for v in edge.vectors
                ):
                    self._loop(f"{edge.name} axis", "connect", k, j, at + 0.25 * self.size * axis)
        self._joined(edge)

    def _pin(self, edge: Edge, i: int, j: int, at: Vec) -> None:
        """A pin or ball: what is joined already is not written again."""
        met = [p for p in edge.points if root(self.points[p], edge.first) == root(self.points[p], edge.second)]
        if not met:
            self._loop(edge.name, "connect", i, j, at)
        if edge.how == "spherical" or self.parts.dim == 2 or len(met) > 1:
            return
        if any(root(self.vectors[v], edge.first) == root(self.vectors[v], edge.second) for v in edge.vectors):
            return
        self._loop(f"{edge.name} axis", "connect", i, j, at + 0.25 * self.size * edge.axes[0])

    def _loop(self, name: str, kind: str, i: int, j: int, at: Vec) -> None:
        self.tree.loops.append(Loop(self.unused(name, [x.name for x in self.tree.loops]), kind, i, j, at))

    def _piece(self, edge: Edge, sequence: list[tuple[str, Vec]]) -> int:
        """A link without mass that has moved by some of a joint's freedoms."""
        name = self.unused(f"{edge.name} piece", [x.name for x in self.tree.links])
        point = edge.at[1]
        link = Link(name, self.link_of[edge.first], self.home.points[point].copy(), part=edge.second, auxiliary=True)
        if all(kind == "slide" for kind, _ in sequence):
            link.reference = point
        self.tree.links.append(link)
        self._joints(link, sequence, name)
        return len(self.tree.links) - 1

    def _in_depth(self) -> None:
        """Put the links in the order of a file: each followed by what hangs on it."""
        links, order = self.tree.links, [0]
        waiting = [k for k in range(len(links) - 1, 0, -1) if links[k].parent == 0]
        while waiting:
            k = waiting.pop()
            order.append(k)
            waiting += [c for c in range(len(links) - 1, 0, -1) if links[c].parent == k]
        new = {old: i for i, old in enumerate(order)} | {-1: -1}
        for link in links:
            link.parent = new[link.parent]
        self.tree.links = [links[k] for k in order]
        self.link_of = {part: new[k] for part, k in self.link_of.items()}
        for loop in self.tree.loops:
            loop.first, loop.second = new[loop.first], new[loop.second]

    # -- what it carries ----------------------------------------------------------------------------------------

    def _sites(self) -> None:
        """Places of points and markers, and lines to be shown."""
        a, taken = self.parts.a, set()
        for k, part in enumerate(self.parts.parts):
            if not part.points:
                continue
            link = self.tree.links[self.link_of[k]]
            for p in part.points:
                name = a.names[p] if a.names[p] not in taken else f"{a.names[p]} on {part.name}"
                taken.add(a.names[p])
                link.sites[name] = self.home.points[p]
            if k:
                link.lines = [(self.home.points[p], self.home.points[q]) for p, q in pairwise(part.points)]
                if len(part.points) > 2:
                    link.lines.append((self.home.points[part.points[-1]], self.home.points[part.points[0]]))
        places = self.marker_places()
        for name, marker in self.mechanism.model.markers.items():
            k = next((k for k, part in enumerate(self.parts.parts) if marker.on in part.bodies), 0)
            if marker.direction is not None:
                self.tree.left_out.append(f"marker {name!r}: a direction, and sites are places")
                continue
            self.tree.links[self.link_of[k]].sites[name] = places[name]

    def marker_places(self) -> dict[str, Vec]:
        """Where markers are in the home pose."""
        top, eq, out = self.system.topology, derive(self.system), {}
        for k, marker in enumerate(top.markers):
            if not marker.direction:
                at = np.zeros(3)
                at[: top.dim] = np.asarray(marker_along(eq, k, self.home.q, ()))  # pyright: ignore[reportArgumentType]
                out[marker.name] = at
        return out

    def _rest(self) -> None:
        """What a tree has nothing for."""
        model, tree = self.mechanism.model, self.tree
        tree.left_out += [f"constraint {name!r} of kind {c.kind!r}" for name, c in model.constraints.items()]
        tree.left_out += [f"friction {name!r}: Coulomb friction in proportion to a reaction" for name in model.friction]
        for part in self.parts.parts[1:]:
            if not part.points:
                tree.left_out.append(f"vector {part.name!r}: it belongs to no body")
        welds = [n for n, j in model.joints.items() if isinstance(j, record.Weld)]
        for name in welds:
            one, other = (next((k for k, p in enumerate(self.parts.parts) if b in p.bodies), 0)
                          for b in model.joints[name].bodies)  # fmt: skip # pyright: ignore[reportAttributeAccessIssue]
            if one != other:
                i, j = self.link_of[one], self.link_of[other]
                self._loop(name, "weld", i, j, tree.links[j].origin)
        if model.units.length != "m":
            tree.notes.append(f"lengths are in {model.units.length} as in the mechanism, and numbers are not converted")
