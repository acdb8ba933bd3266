"""`modes`: every assembly of a mechanism for its inputs, with a statement of completeness and certificates.

All solutions of a generic member of the mechanism's family are followed to the mechanism (parameter homotopy). The
member's are found once for a structure, by monodromy and total degree, and kept in the user's cache.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import on_device
from jaxnc.continuation.certificate import Balls, are_disjoint, certify
from jaxnc.continuation.monodromy import SAME, is_new
from jaxnc.continuation.tracker import BOLD, CAREFUL, QuadraticPaths, inverses
from jaxnc.doors import door
from jaxnc.errors import InputError, brief, counted
from jaxnc.kinematics.inputs import check_inputs, check_system, whole
from jaxnc.kinematics.motion import Motion, motion_of
from jaxnc.kinematics.polynomial import (
    ZERO,
    Design,
    Member,
    NotPolynomial,
    Reading,
    by_structure,
    describe,
    read_polynomials,
)
from jaxnc.kinematics.position import solve_position
from jaxnc.kinematics.reduction import WAYS, Placed, Reduction
from jaxnc.kinematics.starts import (
    NoMember,
    PositiveDimension,
    StartSet,
    TooMany,
    count_tied,
    draw_generic,
    find_starts,
    keep_starts,
    prove_starts,
    recall_starts,
    structure_key,
)
from jaxnc.notebooks import Reported
from jaxnc.process import one_thread
from jaxnc.solvers.assembly import derive, to_host
from jaxnc.solvers.host import HostView, correct_poses
from jaxnc.solvers.kernel import kernel, writes_out
from jaxnc.solvers.plan import Plan, plan
from jaxnc.solvers.rows import Rows
from jaxnc.status import Status
from jaxnc.system.precision import limits, widened
from jaxnc.system.structure import is_own
from jaxnc.system.system import System
from jaxnc.types import Inputs, Numbers

MOST = 1000
"""Solutions of a generic mechanism that are looked for without being asked to."""

_ROUTES = ((True, BOLD), (False, BOLD), (True, CAREFUL), (False, CAREFUL), (False, CAREFUL))  # straight, or around


@public
@dataclasses.dataclass(frozen=True)
class Certificate:
    """What is proved of one assembly, with rounding counted.

    Existence and uniqueness are those of the equations that are solved: where rows are redundant, combinations of them.

    Attributes:
        radius: within so much of the pose's coordinates there is a solution, a length; infinite if nothing is proved.
        alone: and no other one within this larger distance.
        conditioning: reciprocal condition number of the equations at the pose, 0 … 1.
        exact: whether existence, uniqueness and that the solution is real are proved.
    """

    radius: float
    alone: float
    conditioning: float
    exact: bool


@public
@dataclasses.dataclass(frozen=True, repr=False)
class Modes(Reported):
    """All assemblies of a mechanism for one set of inputs; ``len()`` counts the real ones, ``print()`` says all.

    Attributes:
        poses: the real assemblies, ``(assemblies,)``, the one nearest to the drawing first.
        certificates: what is proved of each of them.
        mirrored: real solutions of the rows that are no assemblies: a body is its mirror image, or an angle its half
            turn.
        complex: all coordinates of all other solutions, ``(solutions, N)``; angles and distances that only follow are
            zero in them.
        expected: how many solutions a generic mechanism of this structure has, complex ones included.
        at_infinity: how many of them this mechanism has at infinity.
        singular: how many end where solutions meet or are not isolated.
        lost: how many paths were lost, after all attempts.
        proof: what shows that there are not more than `expected`, ``"total degree"`` or ``"trace test"``; empty where
            it is what loops have found.
        loops: loops of monodromy that the structure took.
        quiet: how many of them, at the end, brought no new solution.
        disjoint: whether all certified solutions, complex ones too, are proved to be different.
    """

    poses: Motion
    certificates: tuple[Certificate, ...]
    mirrored: Motion
    complex: np.ndarray
    expected: int
    at_infinity: int
    singular: int
    lost: int
    proof: str
    loops: int
    quiet: int
    disjoint: bool

    def __len__(self) -> int:
        return len(self.certificates)

    @property
    def proved(self) -> bool:
        """True if `expected` is proved, not only observed."""
        return bool(self.proof)

    @property
    def complete(self) -> bool:
        """True if every path ended in a solution of its own or at infinity, and every assembly is certified."""
        return not self.lost and not self.singular and self.disjoint and all(c.exact for c in self.certificates)

    @property
    def statement(self) -> str:
        """What is proved and what was observed, in sentences."""
        how = {
            "total degree": "proved by total degree: every path ends in a solution or at infinity",
            "trace test": "proved but for rounding by the trace test: a sum over all that hang together is linear",
        }.get(
            self.proof,
            f"observed: {counted(self.loops, 'loop')} of monodromy, the last {self.quiet} without a new one",
        )
        ends = [f"{counted(len(self), 'assembly', 'assemblies')}"]
        real = self.mirrored.status.shape[0]
        others = (
            (real, "mirror image or half turn", "mirror images or half turns"),
            (len(self.complex), "complex", "complex"),
            (self.at_infinity, "at infinity", "at infinity"),
            (self.singular, "singular", "singular"),
            (self.lost, "lost", "lost"),
        )
        ends += [f"{n} {one if n == 1 else more}" for n, one, more in others if n]
        exact = sum(c.exact for c in self.certificates)
        told = "all" if exact == len(self) else f"{exact} of {len(self)}"
        lines = [
            f"A generic mechanism of this structure has {counted(self.expected, 'solution')} ({how}).",
            f"This one has {', '.join(ends)}.",
        ]
        if len(self):
            lines.append(f"Existence and uniqueness are proved of {told}{', and that no two are one' * self.disjoint}.")
        if self.singular:
            lines.append(
                "Singular ends are multiple solutions, as at a dead point, or not isolated: then the mechanism moves "
                "with these inputs held."
            )
        if self.lost:
            lines.append("Lost paths may end in assemblies that are missing here.")
        return " ".join(lines)

    def __str__(self) -> str:
        system = self.poses.system
        at = system.topology.write_values({n: v for n, v in self.poses.inputs.items() if v.size})
        head = f"{system.topology.name}{f' at {at}' if at else ''}: {counted(len(self), 'assembly', 'assemblies')}"
        lines = [head, *(f"  {line}." for line in self.statement.rstrip(".").split(". "))]
        for k, c in enumerate(self.certificates):
            proof = f"within {c.radius:.1g}, alone within {c.alone:.1g} {system.topology.length_unit}"
            lines.append(f"  {k}: {proof if c.exact else 'not certified'}, conditioning {c.conditioning:.1g}")
        return "\n".join(lines)

    def draw(self, path: object = None, **options: Any):
        """Draw all assemblies side by side; see `jaxnc.viz.draw_modes`."""
        return door("Modes.draw")(self, path, **options)


# -- families ----------------------------------------------------------------------------------------------------------


class Family:
    """A structure with its inputs, and what is zero in it: start set and eliminations, for all designs."""

    def __init__(self, reading: Reading, starts: StartSet):
        self.reading, self.starts = reading, starts
        self.checked: set[int] = set()  # designs whose own poses were found, by their hashes
        self.reductions: list[tuple[Reduction, Placed]] = []

    def reduction(self, design: Member, strict: bool = False) -> tuple[Reduction, Placed, Placed]:
        """An elimination that suits a design, with its maps for the generic member and for the design.

        Of several members it suits one of them, and all if there is such a one. A `strict` one leads no path out of the
        family.
        """
        count, found = design.known.shape[1], []
        for way in (*WAYS[max(WAYS.index(self.starts.way), int(strict)) :], None):
            for known, start in self.reductions if count == 1 else ():
                if known.way == way and (placed := known.place(design)).sound.all():
                    return known, start, placed
            for at in sorted({0, count // 2, count - 1}):
                made = Reduction(self.reading, self.starts.member, design.each(lambda v, at=at: v[..., [at]]), way)
                found.append((made, made.place(self.starts.member), made.place(design)))
            if any(placed.sound.all() for *_, placed in found):
                break
        made, start, placed = max(found, key=lambda one: one[2].sound.sum())
        made.square_rows(start, self.starts.x[:, 0], np.random.default_rng(7))
        if count == 1:
            self.reductions.append((made, start))
        return made, start, placed


def family_of(design: Design, inputs: Sequence[int], seed: int, most: float, prove: bool) -> Family:
    """The family of a design: made once for a structure, of `most` solutions, or read from the user's cache."""
    base, fixed = design.reading, tuple(by_structure(c).tobytes() for c in design.constants)
    known = base.families
    if (fixed, seed) not in known or any(is_own(block.kind) for block in base.top.blocks):
        base.check_cases(design.x, design.constants)
    if (fixed, seed) not in known:
        rng = np.random.default_rng([seed, 33])
        generic = draw_generic(design, rng)
        if base.freedoms(*generic) < sum(not base.top.fixed[c] for c in inputs):
            raise NoMember  # overconstrained: generic dimensions do not move
        reading = base.paired(*generic)
        # A row that others tie down would contradict them on the way from one member to another: half turns are then
        # told from what is asked for at the end.
        if count_tied(dataclasses.replace(design, reading=reading), inputs, *generic) > count_tied(
            design, inputs, *generic
        ):
            reading = base
        starts = recall_starts(design, reading, seed)
        if starts is None:
            own, key = dataclasses.replace(design, reading=reading), structure_key(reading, design.constants, seed)
            starts = find_starts(own, inputs, rng, key, most)
            keep_starts(design, reading, seed, starts)
        known[fixed, seed] = Family(reading, starts)
    family = known[fixed, seed]
    if prove and not family.starts.proof:
        rng, own = np.random.default_rng([seed, 34]), dataclasses.replace(design, reading=family.reading)
        family.starts = prove_starts(own, inputs, family.starts, rng)
        keep_starts(design, family.reading, seed, family.starts)
    return family


# -- all solutions -----------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Ends:
    """Ends of all paths at one design."""

    w: np.ndarray  # the solutions, in the unknowns that stay, (n, solutions)
    balls: Balls
    maps: np.ndarray  # from them to all unknowns
    at_infinity: int
    singular: int
    lost: int

    @property
    def count(self) -> int:
        """Number of solutions."""
        return self.w.shape[1]

    @property
    def missing(self) -> int:
        """Number of paths that end in no solution."""
        return self.at_infinity + self.singular + self.lost


def solve_all(family: Family, design: Member, isolated: float, seed: int = 0) -> Ends:
    """All solutions of one design, by paths from the family's generic member; what is lost goes other ways.

    Where the reciprocal condition number is no larger than `isolated`, a solution is singular.
    """
    reduction, begin, end = family.reduction(design)
    found = _follow_all(family, reduction, begin, end, isolated, seed)
    if found.missing and reduction.leads_out:
        # An end at infinity, or a lost one, says something only of a path that stays in the family.
        other = _follow_all(family, *family.reduction(design, strict=True), isolated, seed)
        if (-other.count, other.lost) <= (-found.count, found.lost):
            return other
    return found


def _follow_all(family: Family, reduction: Reduction, begin: Placed, end: Placed, isolated: float, seed: int) -> Ends:
    """Ends of all paths in one elimination, those that have not arrived by several routes."""
    start = reduction.shorten(family.starts.x)
    t = np.tensordot(reduction.mix, end.restricted[0], 1).real
    largest = np.abs(t).max(axis=(1, 2), keepdims=True, initial=0.0)
    t = t / np.where(largest > 0.0, largest, 1.0)
    count = start.shape[1]
    if not reduction.n:
        return Ends(np.zeros((0, 1)), certify(t, np.zeros((0, 1))), end.maps[0], 0, 0, 0)
    rng, found, least = np.random.default_rng([seed, 5]), [], (count, count)
    for route, (direct, pace) in enumerate(_ROUTES):
        legs = [reduction.paths(begin, end)] if direct else _detour(reduction, begin, end, rng)
        w, far, singular = start, 0, 0
        for leg in legs:
            ends = leg.follow(w, pace)
            far, singular = far + int(ends.at_infinity.sum()), singular + int(ends.singular.sum())
            w = ends.w[:, ends.arrived]
        w = _polish(t, w)
        balls = certify(t, w)
        # Unknowns are of size one: an end far beyond is at infinity.
        there = (np.abs(w).max(axis=0) > 1e4) & ~balls.proved
        # A proof is one of the design as it was rounded: without the rounding two solutions may be one.
        rounded = isolated > limits(t).isolated
        unclear = ~there & (balls.condition <= isolated) & (~balls.proved | rounded)
        far, singular = far + int(there.sum()), singular + int(unclear.sum())
        found.append(w[:, ~there & ~unclear])
        every = np.concatenate(found, axis=1)
        found = [every[:, is_new(np.zeros((reduction.n, 0)), every)]]
        least = (min(least[0], far), min(least[1], singular))
        left = count - found[0].shape[1] - sum(least)
        if left <= 0 and (route or not least[1]):
            break
    # Combinations of rows may have solutions that the rows have not; no path of the family ends there.
    w = found[0][:, end.meets_all(found[0])]
    far = min(least[0], count - w.shape[1])
    singular = min(least[1], count - w.shape[1] - far)
    return Ends(w, certify(t, w), end.maps[0], far, singular, count - w.shape[1] - far - singular)


def _detour(reduction: Reduction, begin: Placed, end: Placed, rng: np.random.Generator) -> list[QuadraticPaths]:
    """Two legs by way of a member beside the straight line, in a random complex direction."""
    middle = _place_between(reduction, begin, end, 0.5 + 0.7j * rng.choice([-1, 1]) * (0.5 + rng.random()))
    return [reduction.paths(begin, middle), reduction.paths(middle, end)]


def _place_between(reduction: Reduction, begin: Placed, end: Placed, part: complex) -> Placed:
    """The member some part of the way from one to another."""
    at = np.array([part])
    straight = tuple(a + (b - a) * at for a, b in zip(begin.straight, end.straight, strict=True))
    return reduction.place(begin.member.mix(end.member, at), straight)


def _polish(t: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Solutions after two more of Newton's steps, where they stay near."""
    here, lanes = QuadraticPaths(t[None, None]), np.arange(w.shape[1])
    with np.errstate(all="ignore"):
        for _ in range(2):
            f, jacobian = here.evaluate(w, np.zeros(w.shape[1]), lanes)
            step = np.matmul(inverses(jacobian), f[:, :, None])[:, :, 0].T
            small = np.abs(step).max(axis=0, initial=0.0) < SAME * np.maximum(1.0, np.abs(w).max(axis=0, initial=0.0))
            w = np.where(small, w - step, w)
    return w


# -- many sets of inputs, or designs -----------------------------------------------------------------------------------


@dataclasses.dataclass
class Place:
    """Real assemblies at one set of inputs."""

    w: np.ndarray  # in the unknowns that stay, (n, assemblies)
    q: np.ndarray  # all coordinates, (N, assemblies)
    gap: np.ndarray
    condition: np.ndarray
    doubtful: bool


class Targets:
    """Sets of inputs ``(targets, inputs)`` of one design, or of one each, solved from the solutions of a neighbour."""

    def __init__(
        self, designs: Sequence[Design], family: Family, order: tuple[int, ...], values: np.ndarray, seed: int
    ):
        self.designs, self.family, self.order, self.values, self.seed = designs, family, order, values, seed
        if len(designs) == 1:
            self.member, self.x = designs[0].at(values.T, order)
        else:
            members, poses = zip(*(d.at(v[:, None], order) for d, v in zip(designs, values, strict=True)), strict=True)
            self.member = members[0].each(lambda *side_by_side: np.concatenate(side_by_side, axis=-1), *members[1:])
            self.x = np.concatenate(poses, axis=1)
        self.reduction, self.begin, self.end = family.reduction(self.member)
        self.places = self._solve()

    def design_of(self, target: int) -> Design:
        """The design of a target."""
        return self.designs[target if len(self.designs) > 1 else 0]

    def _find_near(self) -> tuple[Placed, np.ndarray]:
        """All solutions of a member amid the targets, at complex inputs, from where the ways to all are short."""
        if len(self.designs) == 1:
            middle, reach = (0.5 * (self.values.max(axis=0) + s * self.values.min(axis=0)) for s in (1.0, -1.0))
            away = 0.7j * np.minimum(reach, self.designs[0].unit[list(self.order)])
            member, _ = self.designs[0].at((middle + away)[:, None], self.order)
            there = self.reduction.place(member)
        else:
            # A neighbour of designs, most of the way from the generic member.
            one = self.end.choose([int(np.argmax(self.end.sound))])
            there = _place_between(self.reduction, self.begin, one, 0.85 + 0.35j)
        if not self.reduction.n:
            return there, np.zeros((0, 1))
        ends = self.reduction.paths(self.begin, there).follow(self.reduction.shorten(self.family.starts.x), CAREFUL)
        w = ends.w[:, ends.arrived]
        return there, w[:, is_new(np.zeros((len(w), 0)), w)]

    def _solve(self) -> list[Place]:
        """Real assemblies at all values."""
        found = self._follow_near()
        if len(found) < len(self.values) and self.reduction.leads_out:  # the ways may have left the family
            self.reduction, self.begin, self.end = self.family.reduction(self.member, strict=True)
            found = self._follow_near()
        return [found.get(value) or self._follow_far(value) for value in range(len(self.values))]

    def _follow_near(self) -> dict[int, Place]:
        """Assemblies at values, by ways from the member near them; those of which no way is lost."""
        sound = np.flatnonzero(self.end.sound)
        if not len(sound):
            return {}
        there, start = self._find_near()
        n, each = self.reduction.n, start.shape[1]
        out: dict[int, Place] = {}
        # Two million numbers of coefficients are held at once.
        block = max(1, int(2_000_000 / max(1, 4 * n**3 + n * each)))
        for first in range(0, len(sound), block):
            which = sound[first : first + block]
            some = self.end.choose(which)
            t = self._coefficients(some)
            if n and each:
                ends = self.reduction.paths(there, some, each).follow(np.tile(start, (1, len(which))), BOLD)
                w, arrived, far = ends.w, ends.arrived, ends.at_infinity
            else:
                w, arrived, far = np.zeros((n, len(which))), np.ones(len(which), bool), np.zeros(len(which), bool)
                each = 1
            far = far & (not self.reduction.leads_out)
            balls = certify(np.repeat(t, each, axis=0), w)
            for j, value in enumerate(which):
                own = np.arange(j * each, (j + 1) * each)
                good = own[arrived[own] & balls.proved[own] & (balls.condition[own] > self.designs[0].isolated)]
                new = good[is_new(np.zeros((n, 0)), w[:, good])]
                if len(new) + int(far[own].sum()) == len(self.family.starts):
                    out[int(value)] = self._judge(int(value), w[:, new], certify(t[j], w[:, new]), some.maps[j], False)
        return out

    def _follow_far(self, value: int) -> Place:
        """The assemblies at a value, by all ways from the family's generic member."""
        ends = solve_all(self.family, self.member.each(lambda v: v[..., [value]]), self.designs[0].isolated, self.seed)
        found = self._judge(value, ends.w, ends.balls, ends.maps, bool(ends.lost + ends.singular))
        every = (ends.maps @ np.concatenate([np.ones((1, found.w.shape[1])), found.w]))[1:]
        return dataclasses.replace(found, w=np.real(self.reduction.shorten(every)))

    def _coefficients(self, placed: Placed) -> np.ndarray:
        t = np.real(np.tensordot(placed.restricted, self.reduction.mix, ([1], [1]))).transpose(0, 3, 1, 2)
        return t / np.abs(t).max(axis=(2, 3), keepdims=True, initial=1e-300)

    def _judge(self, value: int, w: np.ndarray, balls: Balls, maps: np.ndarray, doubtful: bool) -> Place:
        """The assemblies among the solutions at a value."""
        design, real = self.design_of(value), select_real(w, balls)
        w, condition = np.real(w[:, real]), balls.condition[real]
        q = np.real(place_poses(design, self.x[:, value], maps, w))
        q, status, gap = judge(design, q)
        good = status == int(Status.CONVERGED)
        return Place(w[:, good], q[:, good], gap[good], condition[good], doubtful)


@public
@dataclasses.dataclass(frozen=True, repr=False)
class ModesMap(Reported):
    """All real assemblies for many sets of inputs, or of many designs; `print` says how many there are where.

    Attributes:
        inputs: the values of each input, by name, ``(...,)``.
        count: number of assemblies of each, ``(...,)``.
        poses: the assemblies, ``(..., most)``, those nearest to the drawing first; where there are fewer than `most`
            the status says so.
        doubtful: where paths were lost, solutions are not isolated or a design is not finite, so that others may be
            missing, ``(...,)``. Of solutions that are not isolated, as of a kite that turns freely, rounding may leave
            none: single inputs tell that, a map does not.
        expected: how many solutions a generic mechanism of this structure has, complex ones included.
        proof: as of `Modes`.
    """

    inputs: dict[str, np.ndarray]
    count: np.ndarray
    poses: Motion
    doubtful: np.ndarray
    expected: int
    proof: str

    @property
    def complete(self) -> bool:
        """True if no place is doubtful."""
        return not self.doubtful.any()

    @property
    def statement(self) -> str:
        """How many assemblies there are where, and what may be missing."""
        found = ", ".join(
            f"{n} at {k}" for n, k in zip(*(a.tolist() for a in np.unique(self.count, return_counts=True)), strict=True)
        )
        how = f"proved by {self.proof}" if self.proof else "observed"
        text = (
            f"A generic mechanism of this structure has {counted(self.expected, 'solution')} ({how}). "
            f"Of {self.count.size} places these have so many assemblies: {found}."
        )
        if not self.complete:
            text += (
                f" At {int(self.doubtful.sum())} of them paths were lost, solutions are not isolated or the design is "
                f"not finite."
            )
        return text

    def __str__(self) -> str:
        return f"{self.poses.system.topology.name}: {self.statement}"

    def draw(self, path: object = None, **options: Any):
        """Draw the number of assemblies over two inputs, with the loci where it changes; see `jaxnc.viz`."""
        return door("ModesMap.draw")(self, path, **options)


def _solve_map(
    system: System, view: Plan, names: Sequence[str], values: np.ndarray, seed: int, most: int, prove: bool
) -> ModesMap:
    """All real assemblies for inputs ``(..., inputs)``, of one design or of as many."""
    lead, top = system.parameters.points.ndim - 2, system.topology
    order, held = tuple(top.position[n] for n in names), tuple(map(int, view.held))
    shape = values.shape[:-1]
    if lead:
        own = system.parameters.points.shape[:lead]
        try:
            shape = np.broadcast_shapes(own, shape)
        except ValueError:
            raise InputError(f"modes(): designs of shape {own} and inputs {shape} do not go together") from None
        flat = jax.tree.map(lambda v: np.asarray(v).reshape(math.prod(v.shape[:lead]), *v.shape[lead:]), system)
        several = [jax.tree.map(lambda v, k=k: v[k], flat) for k in range(flat.parameters.points.shape[0])]
        values = np.broadcast_to(values, (*shape, values.shape[-1]))
        if len(several) != math.prod(shape):
            raise InputError(f"modes(): designs of shape {own} and inputs {shape} do not go together")
    else:
        several = [system]
    values = np.asarray(values, float).reshape(-1, values.shape[-1])
    nonzero = np.array([_count_nonzero(one) for one in several])
    if nonzero.max() < 0:
        raise InputError(f"modes(): of {counted(len(several), 'design')} none is finite")
    own, family = prepare(several[int(nonzero.argmax())], order, held, seed, most, prove)
    finite = np.flatnonzero(nonzero >= 0) if lead else np.arange(len(values))
    designs = [own] if not lead else [describe(several[k], family.reading) for k in finite]
    found = Targets(designs, family, order, values[finite], seed)
    count, doubtful = np.zeros(len(values), int), np.ones(len(values), bool)
    count[finite] = [p.w.shape[1] for p in found.places]
    doubtful[finite] = [p.doubtful for p in found.places]
    most = max(int(count.max(initial=0)), 1)
    q = np.full((len(values), most, len(top.coordinates)), np.nan)
    status = np.full((len(values), most), int(Status.DID_NOT_ASSEMBLE))
    gap, condition = np.full((2, len(values), most), np.nan)
    for number, (k, place) in enumerate(zip(finite, found.places, strict=True)):
        design = found.design_of(number)
        away = np.abs(((place.q.T - design.pose) / design.unit)[:, : design.reading.first]).sum(axis=1)
        at, n = np.argsort(away, kind="stable"), len(away)
        q[k], status[k, :n] = design.pose, int(Status.CONVERGED)
        q[k, :n], gap[k, :n], condition[k, :n] = place.q.T[at], place.gap[at], place.condition[at]
    asked = np.broadcast_to(values[:, None], (len(values), most, values.shape[1]))
    arrays = (a.reshape(*shape, *a.shape[1:]) for a in (q, asked, status, gap, condition))
    motion = motion_of(system, view, *on_device(tuple(arrays)))
    return ModesMap(
        {n: values[:, k].reshape(shape) for k, n in enumerate(names)},
        count.reshape(shape),
        motion,
        doubtful.reshape(shape),
        len(family.starts),
        family.starts.proof,
    )


def _count_nonzero(system: System) -> int:
    """Count the constants of a design that are not zero; -1 of a design that is not finite."""
    eq, drawn = to_host(derive(system)), system.parameters
    if not all(np.isfinite(x).all() for x in (eq.home, *eq.constants, drawn.markers, drawn.dimensions)):
        return -1
    return sum(int((np.abs(c) > ZERO).sum()) for c in eq.constants)


@public
@widened
def modes(
    system: System,
    inputs: Inputs,
    hold: Sequence[str] = (),
    unit: str | None = None,
    seed: int = 0,
    most: int = MOST,
    prove: bool = False,
) -> Modes | ModesMap:
    """Find every assembly of a mechanism for its inputs, with certificates and a statement of completeness.

    Args:
        system: the system; several designs, as `jax.vmap` stacks them, give their assemblies as arrays.
        inputs: one value of each driven coordinate, by name; radians and lengths. Empty for a mechanism without
            freedom. Arrays zip, and give the assemblies at each of their places as arrays.
        hold: free coordinates that keep the value they have in the drawing.
        unit: what angles are given in, ``"rad"`` or ``"deg"``.
        seed: another number takes other ways, and another generic mechanism to begin from.
        most: how many solutions of a generic mechanism of this structure may be looked for, complex ones included. If
            there turn out to be more, the error says how many there may be and how long they take, and what is known is
            kept: with a larger number the next call goes on from there. So it does after Ctrl-C.
        prove: whether a number of solutions that was only observed is to be proved by the trace test, once for a
            structure: some seconds for eight solutions, twenty for forty. Where the test comes to no end the number
            stays observed.

    Returns:
        The assemblies, a `Modes` for one set of inputs, a `ModesMap` for many; failures are counted there, never
        raised.

    Raises:
        InputError: inputs that are too many or too few, or not finite; rows that are no polynomials of second degree
            (gears, rolling, screws, own kinds); a mechanism that moves with its inputs held; more than `most`
            solutions.
    """
    one_thread("numpy")
    check_system(system, "modes()", several=True)
    view, values, _ = check_inputs(system, inputs, hold, unit, several=True)
    values, shape = np.asarray(values, float), values.shape[:-1]
    if shape or system.parameters.points.ndim > 2:
        if not math.prod(shape):
            raise InputError(f"modes(): inputs of the shape {shape} hold no value")
        return _solve_map(system, view, tuple(inputs), values, seed, most, prove)
    order = tuple(system.topology.position[n] for n in inputs)
    design, family = prepare(system, order, tuple(map(int, view.held)), seed, most, prove)
    member, x = design.at(values[:, None], order)
    found = _report(system, view, design, family, x[:, 0], values, solve_all(family, member, design.isolated, seed))
    key = hash((design.x.tobytes(), *(c.tobytes() for c in design.constants)))
    # Once for a design; of dyads, whose pose takes no time, at all its inputs.
    if key in family.checked and not (writes_out(view) and kernel(view).by_formulas):
        return found
    own = solve_position(system, inputs, hold=hold, unit=unit, throw=False)
    # Solutions that are not isolated may be lost to rounding of the coefficients: a pose among them is still found.
    if int(own.status) == Status.SINGULAR and not (found.singular or _has(found, own, design)):
        return dataclasses.replace(found, singular=1)
    # A pose that is found another way has to be among the assemblies, at these inputs or at those of the drawing: once
    # for a design, since all that it can be moved to hangs together.
    here = found
    if int(own.status):
        at = design.pose[list(order)]
        own = solve_position(system, dict(zip(inputs, at, strict=True)), hold=hold, unit="rad", throw=False)
        if not int(own.status):
            member, x = design.at(at[:, None], order)
            here = _report(system, view, design, family, x[:, 0], at, solve_all(family, member, design.isolated, seed))
    if not int(own.status) and not _has(here, own, design):
        return dataclasses.replace(found, lost=found.lost + 1)
    family.checked.add(key)
    return found


def _has(found: Modes, own: Motion, design: Design) -> bool:
    """Tell whether a pose, if it is one, is among the assemblies; an ill conditioned one is not looked for."""
    if not int(own.status) and (own.conditioning is None or float(own.conditioning) < 1e-6):
        return True
    every = np.asarray(found.poses.q).reshape(-1, len(design.unit))
    off = np.abs((every - np.asarray(own.q)) / design.unit)[:, : design.reading.first]
    return bool((off.max(axis=1, initial=0.0) < 1e-6).any())  # sizes of the mechanism


def prepare(
    system: System, driven: tuple[int, ...], held: tuple[int, ...], seed: int, most: int, prove: bool = False
) -> tuple[Design, Family]:
    """The design of a system and its family; what cannot be read as polynomials is refused."""
    top = system.topology
    seed, most = whole(seed, "modes(): seed", 0), whole(most, "modes(): most")
    if not isinstance(prove, bool | np.bool_):
        raise InputError(f"modes(): prove must be True or False, got {brief(prove)}")
    if top.large:  # with too many assemblies to begin
        view = plan(top, top.named(driven), top.named(held), system.degrees_of_freedom)
        blocks = (([int(view.rows[r]) for r in rows], view.unknown[columns].tolist()) for rows, columns in view.choice)
        dyads = sum(Rows(top, *block).form == "round" for block in blocks)
        if dyads > math.log2(most):
            raise InputError(
                f"modes(): {top.name!r} has {counted(dyads, 'dyad')}, each with two assemblies, one behind the other: "
                f"2^{dyads} in all, and most={most} are asked for"
            )
    try:
        reading = read_polynomials(top.structure, (*driven, *held))
        design = describe(system, reading)
        family = family_of(design, (*driven, *held), seed, most, prove)
    except NotPolynomial as error:
        block, instance, why = error.args
        owner = top.called(*top.blocks[block].owners[instance])
        raise InputError(
            f"modes(): {owner!r} of {top.name!r} ({top.blocks[block].kind.name}) is not for this: {why}; "
            f"solve_position(system, inputs, start={{'P': (x, y)}}) finds them one by one from other places, and "
            f"jaxnc.formulate(mechanism, 'independent').assemblies(…) of a chain of bodies, both without a proof"
        ) from None
    except PositiveDimension as error:
        raise InputError(
            f"modes(): with these inputs {top.name!r} still has {counted(error.args[0], 'freedom')}: hold a coordinate "
            f"of what moves (a rod's spin), hold=[…], or drive it; jaxnc.mobility(system) names the free motions"
        ) from None
    except TooMany as error:
        known, expected, seconds, kept = error.args
        raise InputError(
            f"modes(): a generic mechanism of the structure of {top.name!r} has more than {most:,} solutions: "
            f"{known:,} are known{' and kept' * kept}, about {expected:,} are expected, which take about "
            f"{_write_time(seconds)}; jaxnc.modes(…, most={_round_up(2 * expected)}) looks for them"
        ) from None
    except NoMember as error:
        beside = ", or directions in it depend on each other (let bodies share a vector)" if error.args else ""
        raise InputError(
            f"modes(): {top.name!r} is overconstrained{beside}: it moves for special dimensions only, and has no "
            f"family of mechanisms to begin from; leave out what is redundant (jaxnc.mobility(system) names it)"
        ) from None
    return dataclasses.replace(design, reading=family.reading), family


def _write_time(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds > 90 else f"{max(1.0, seconds):.0f} s"


def _round_up(count: float) -> int:
    """Round up to one digit."""
    power = 10 ** int(math.log10(max(1.0, count)))
    return math.ceil(count / power) * power


def _report(system, view, design: Design, family: Family, x: np.ndarray, values: np.ndarray, ends: Ends) -> Modes:
    """Poses, certificates and counts of the ends of all paths."""
    q = place_poses(design, x, ends.maps, ends.w)
    balls = ends.balls
    is_real = select_real(ends.w, balls)
    real, status, residual = judge(design, np.real(q[:, is_real]))
    good = status == int(Status.CONVERGED)
    away = np.abs((real - design.pose[:, None]) / design.unit[:, None])[: design.reading.first].sum(axis=0)
    order = np.argsort(np.where(good, away, np.inf), kind="stable")[: int(good.sum())]
    scale = float(design.unit[: design.reading.first].max(initial=0.0))
    which = np.flatnonzero(is_real)
    certificates = tuple(
        Certificate(
            float(balls.radius[k]) * scale,
            float(balls.alone[k]) * scale,
            float(balls.condition[k]),
            bool(balls.real[k]),
        )
        for k in which[order]
    )
    motion = functools.partial(to_motion, system, view, values)
    other = np.flatnonzero(~good & (status != int(Status.DID_NOT_ASSEMBLE)))
    return Modes(
        motion(real[:, order], status[order], residual[order], balls.condition[which[order]]),
        certificates,
        motion(real[:, other], status[other], residual[other], balls.condition[which[other]]),
        q[:, ~is_real].T,
        len(family.starts),
        ends.at_infinity,
        ends.singular,
        ends.lost + int((status == int(Status.DID_NOT_ASSEMBLE)).sum()),
        family.starts.proof,
        family.starts.loops,
        family.starts.quiet,
        are_disjoint(ends.w, balls),
    )


def select_real(w: np.ndarray, balls: Balls) -> np.ndarray:
    """Tell which solutions are real: by their certificates, by their size where they have none."""
    # So small is the imaginary part of a real solution that has no certificate.
    return balls.real | (~balls.proved & (np.abs(np.imag(w)).max(axis=0, initial=0.0) < 1e-8))


def place_poses(design: Design, x: np.ndarray, maps: np.ndarray, w: np.ndarray) -> np.ndarray:
    """All coordinates ``(N, lanes)`` of solutions ``(n, lanes)``; angles and distances that only follow are zero."""
    reading = design.reading
    q = np.repeat(x[:, None].astype(complex), w.shape[1], axis=1)
    q[reading.follows] = 0.0
    q[reading.unknown] = (maps @ np.concatenate([np.ones((1, w.shape[1])), w]))[1:]
    return q * design.unit[:, None] + design.shift[:, None]


def judge(design: Design, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Real poses, corrected and with what follows measured, their statuses and largest residuals."""
    reading, host = design.reading, design.host
    with np.errstate(all="ignore"):
        measured = host.measured(q)
        follows = reading.follows[reading.first :]
        q[reading.first :][follows] = measured[follows]
        # Solutions of combined rows are as good as these are conditioned; a correction of more than 1e-4 is none.
        view = HostView(plan(reading.top, reading.top.named(reading.inputs)), host)
        exact = correct_poses(view, q)
        q = np.where((np.abs(exact - q) / design.unit[:, None]).max(axis=0, initial=0.0) < 1e-4, exact, q)
        gap = np.abs(host.residual(q)).max(axis=0, initial=0.0)
        upright, mirrored = host.guards(q)
    # A pose meets all rows if none is off by more than 1e-9 of the mechanism's size.
    status = np.where(gap <= 1e-9 * design.unit.max(initial=1.0), int(Status.CONVERGED), int(Status.DID_NOT_ASSEMBLE))
    status = np.where((status == 0) & ~upright, int(Status.BRANCH_JUMP), status)
    return q, np.where((status == int(Status.BRANCH_JUMP)) & mirrored, int(Status.MIRRORED), status), gap


def to_motion(
    system: System,
    view: Plan,
    values: np.ndarray,
    q: np.ndarray,
    status: Numbers,
    residual: Numbers,
    conditioning: Numbers,
) -> Motion:
    """Poses ``(N, lanes)`` as a motion, at one set of inputs or a set ``(lanes, inputs)`` each."""
    asked = np.broadcast_to(values, (q.shape[1], values.shape[-1]))
    return motion_of(system, view, *on_device((q.T, asked, status, residual, conditioning)))
