"""Reference-point coordinates: every body by a point and its orientation, as if it were free (source text §2.2)."""

from collections.abc import Mapping

import numpy as np

from jaxnc.constraints import ALIGNED, FIXED_ANGLE, SCALAR_PRODUCT
from jaxnc.dynamics.model import body_inertia
from jaxnc.errors import InputError, nearest
from jaxnc.families.bodies import Joined, Origin, Part
from jaxnc.families.planner import Planner
from jaxnc.families.program import EQUAL, PROJECTION, Frame, Scribe, fixed
from jaxnc.mechanism import model as record
from jaxnc.mechanism.model import Place as Spot
from jaxnc.solvers.assembly import derive
from jaxnc.system.assemble import Instance
from jaxnc.system.design import design, design_numbers
from jaxnc.system.identity import Owner
from jaxnc.system.system import System


class Reference(Planner):
    """Variables and rows of reference-point coordinates. The points are in the middle until `refer` is called."""

    family = "reference point"

    def _frame(self, scribe: Scribe, k: int) -> Frame:
        return self.free_frame(scribe, k)

    def place_parts(self, points: Joined, vectors: Joined) -> None:
        """Note the variables of every part, and the rows that normalise its orientation."""
        for k, part in enumerate(self.parts.parts[1:], start=1):
            what = f"body {part.name}" if part.turns != "no" else f"point {part.name}"
            self.free(k, f"the reference point of {what}", what)

    def met(self, data: Instance) -> bool:
        """Write what the text writes otherwise than in points: the prismatic joint (9)-(10), the pin in a slot."""
        if self.parts.dim != 2 or data.kind not in (ALIGNED, FIXED_ANGLE, SCALAR_PRODUCT):
            return False
        joints = [j for owner in data.owners if (j := self.parts.joint(owner)) is not None]
        joint = joints[0] if joints else None
        if isinstance(joint, record.Prismatic):
            line, on = self.a.pair(joint.line), self.a.pair(joint.on)
            i, j = self.parts.holder(line), self.parts.holder(on)
            if not i or not j or on[0] in line:
                return False
            if data.kind is ALIGNED:
                self.slide(data.owners, i, j, line, on)
            else:
                self.together(data.owners, line, on)
            return True
        if isinstance(joint, record.Slot):
            line = self.a.at(*joint.line)
            i = self.parts.holder(line)
            if i:
                self.pin(data.owners, i, line, self.a.index[joint.point])
                return True
        return False

    def together(self, owners: tuple[Owner, ...], line: tuple[int, int], on: tuple[int, int]) -> None:
        """Two bodies turn together (9)."""
        scribe = Scribe()
        (kept,) = scribe.c("between", scribe.at((*line, *on)))
        one, other = self.angle(scribe, line), self.angle(scribe, on)
        assert one is not None and other is not None
        turns = round((self.estimate(scribe, other) - self.estimate(scribe, one + kept)) / (2 * np.pi))
        self.write(EQUAL, owners, scribe, scalars=(other, one + kept + fixed(2 * np.pi * turns)))

    def slide(self, owners: tuple[Owner, ...], i: int, j: int, line: tuple[int, ...], on: tuple[int, ...]) -> None:
        """A body slides along a line of another (10)."""
        scribe = Scribe()
        first, second = self.parts.parts[i], self.parts.parts[j]
        points = (
            *scribe.at((*second.axis, *on), second),
            *scribe.at(line, first),
            *scribe.at((*line, *on)),
            *scribe.at(second.origin.points, second),
            *scribe.at(first.origin.points, first),
        )
        extra = (len(second.origin.points), second.origin.how, first.origin.how)
        gamma, offset = scribe.c("prismatic", points, (), extra)
        one, other = self.frame(scribe, i), self.frame(scribe, j)
        assert other.turn is not None
        self.write(PROJECTION, owners, scribe, (one.origin, other.origin), (other.turn.of[0] + gamma, offset))

    def pin(self, owners: tuple[Owner, ...], i: int, line: tuple[int, ...], point: int) -> None:
        """A point slides along a line of a body (37), as its projection on the line's normal."""
        scribe = Scribe()
        part = self.parts.parts[i]
        origin = part.origin
        gamma, offset = scribe.c("normal", scribe.at((*line, *part.axis, *origin.points), part), (), origin.how)
        frame = self.frame(scribe, i)
        assert frame.turn is not None
        holder = next(k for k in self.parts.of_point[point] if k != i)
        place = self.place(scribe, holder, point)
        self.write(PROJECTION, owners, scribe, (place, frame.origin), (frame.turn.of[0] + gamma, offset))

    # -- reference points -----------------------------------------------------------------------------------------

    def refer(self, reference: str | Mapping[str, str | Spot]) -> None:
        """Set the reference points of all parts (source text §2.2).

        Args:
            reference: ``"mass"``, ``"middle"``, or the points of some bodies; see `formulate`.
        """
        parts, natural = self.parts, self.natural
        chosen = {} if isinstance(reference, str) else dict(reference)
        if isinstance(reference, str) and reference not in ("mass", "middle"):
            raise InputError(f"reference={reference!r}; use 'mass', 'middle', or points of bodies, {{body: point}}")
        of = {body: part for part in parts.parts[1:] for body in part.bodies}
        for body in chosen:
            if body not in of:
                raise InputError(f"reference={{{body!r}: …}}: no moving body has that name; {nearest(body, of)}")
        top, home = natural.topology, np.asarray(derive(natural).home)
        drawing = design_numbers(top, natural.parameters.in_numpy(), 1)[design(top).drawing]
        for part in parts.parts[1:]:
            if part.turns == "no" or not part.points:
                continue
            drawn = {p: parts.a.home[p] for p in part.points}
            given = next((chosen[b] for b in part.bodies if b in chosen), None)
            if given is not None:
                at = self.locate(part, given)
            elif reference == "middle":
                continue
            else:
                drawn = {p: drawing[i] for p, i in part.drawn.items()}
                at = _centre_of_mass(natural, part, home, drawn)
            if at is not None:
                part.origin = self.origin(part, at, drawn)

    def locate(self, part: Part, given: str | Spot) -> np.ndarray:
        """A point, a marker or a place of a part, as drawn."""
        if not isinstance(given, str):
            found = np.asarray(given, dtype=float)
            if found.shape != (self.parts.dim,) or not np.isfinite(found).all():
                raise InputError(
                    f"reference point {given!r} of body {part.name!r}: give a point's name or {self.parts.dim} numbers"
                )
            return found
        names = {self.parts.point(p): self.a.home[p] for p in part.points}
        for name, marker in self.a.model.markers.items():
            if marker.on in part.bodies and marker.at is not None:
                names[name] = np.asarray(marker.at, dtype=float)
        if given not in names:
            raise InputError(
                f"reference point {given!r}: body {part.name!r} has no such point; {nearest(given, names)}"
            )
        return names[given]

    def origin(self, part: Part, at: np.ndarray, drawn: Mapping[int, np.ndarray]) -> Origin:
        """A place of a part as an origin."""
        near = 1e-9 * self.a.size  # 1e-9 of the mechanism's size: places that are one
        for p, spot in drawn.items():
            if np.linalg.norm(spot - at) <= near:
                return Origin((p,))
        if np.linalg.norm(np.mean(list(drawn.values()), axis=0) - at) <= near:
            return Origin(part.points)
        segments = (part.axis,) if self.parts.dim == 2 else part.segments[:2]
        axes = [drawn[s[1]] - drawn[s[0]] if len(s) == 2 else self.a.vectors[~s[0]] for s in segments]
        if self.parts.dim == 2:
            axes.append(np.array([-axes[0][1], axes[0][0]]))
        elif len(axes) == 2:
            axes.append(np.cross(axes[0], axes[1]))
        first = segments[0][0] if len(segments[0]) == 2 else part.points[0]
        factors, *_ = np.linalg.lstsq(np.array(axes).T, at - drawn[first], rcond=None)
        off = np.linalg.norm(np.array(axes).T @ factors + drawn[first] - at)
        if off > near:
            raise InputError(
                f"the reference point of {part.name!r} is {off:.3g} beside its line, and a bar does not know its "
                f"rotation; put it on the line, or give the bar a point or vector across it"
            )
        points = (first, *(p for s in segments if len(s) == 2 for p in s))
        forms = "".join("p" if len(s) == 2 else "v" for s in segments)
        return Origin(points, tuple(~s[0] for s in segments if len(s) == 1), (forms, *map(float, factors)))


def _centre_of_mass(
    natural: System, part: Part, home: np.ndarray, drawn: Mapping[int, np.ndarray]
) -> np.ndarray | None:
    """The centre of mass of a part's bodies as drawn; None without mass."""
    q, dim = home.copy(), natural.topology.dim
    for p, at in drawn.items():
        q[dim * p : dim * p + dim] = at
    moment, mass = np.zeros(dim), 0.0
    for body in part.bodies:
        at, _, first, m = body_inertia(natural, body)
        moment, mass = moment + np.asarray(first) @ q[at], mass + float(m)
    return moment / mass if mass else None
