"""Mobility: rows, rank and degrees of freedom, redundant and conflicting constraints by name; Grashof's types."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, list_first
from jaxnc.kinematics.freedoms import Freedoms, explain_lock, loose_motions
from jaxnc.kinematics.host_solve import judge_start, never_moves
from jaxnc.kinematics.inputs import NEVER_MOVES, check_system, dense_only, row_gaps
from jaxnc.kinematics.instant import body_of
from jaxnc.notebooks import Reported
from jaxnc.solvers.assembly import (
    Sample,
    derive,
    evaluate,
    free_plan,
    general_sample,
    meets,
    rank_of,
    sample_poses,
    settle,
    to_host,
)
from jaxnc.solvers.kernel import kernel, writes_out
from jaxnc.solvers.plan import LARGEST_WRITTEN, Plan, by_lu, plan
from jaxnc.status import Status
from jaxnc.system.equations import coefficients, rate_constants
from jaxnc.system.precision import on_host, widened
from jaxnc.system.system import System, drivable, unheld
from jaxnc.system.topology import Topology
from jaxnc.types import Array

IDLE = (
    "holds nothing to first order, since its points can move across it only: if it is to hold something, too many "
    "freedoms are counted, and a relation of their coordinates does it instead"
)
_PART = 1e-6  # of the largest share of a row in a dependency: less is rounding


@public
@dataclass(frozen=True, repr=False)
class Mobility(Reported):
    """A count of what a mechanism's constraints amount to; ``str()`` is a report.

    Attributes:
        name: the mechanism.
        n: coordinates that are not fixed.
        rows: constraint rows between them.
        rank: independent rows at a general pose.
        dof: degrees of freedom, ``n - rank``.
        grubler: freedoms by Grübler's count of bodies and joints; differs from `dof` where dimensions are special.
        redundant: rows that follow from the rows before them, by name; they can be left out.
        involved: all rows that take part in a dependency, by name.
        overconstrained: how many of the redundant rows are so only for these dimensions: a general change of them
            keeps the mechanism from assembling. The others are redundant whatever the dimensions.
        conflicting: rows that cannot be met together, by name; empty if the drawing assembles.
        gap: of a drawing that does not assemble how far its worst row is from being met, else rounding; a length.
        momentary: independent rows lost in the drawn pose only (a singular position), 0 if none.
        proposals: joints that could be freer without changing the motion, until nothing is held twice (in space).
        idle: rows that hold nothing to first order, by name: what they keep is smallest or largest in all poses,
            such as the length of a bar whose ends slide across it.
        loose: freedoms that were hardly meant, in words: a body that only spins about its own line, a point or vector
            that nothing holds.
        locked: where nothing moves, in words: which bodies lock each other, and which one to leave out.
        slips: rows on velocities that positions do not see (skates, rolling discs), by name.
        velocities: freedoms of the velocities: `dof` less the independent ones of `slips`.
        driven: the inputs that `blocks` and `solves` are said of; none where these would not determine the motion.
        blocks: unknowns of each block of the equations, in the order in which they are solved, one after the other;
            empty where they are all solved together.
        solves: which way poses take for these inputs, and why, in words.
        dead_point: whether the drawing is a singular position of the inputs `driven`, from which no branch is followed.
        never_moves: whether poses nearby are, too: one of the inputs may never change.
        system: the system, for its drawing.
    """

    name: str
    n: int
    rows: int
    rank: int
    dof: int
    grubler: int
    redundant: tuple[str, ...]
    involved: tuple[str, ...]
    overconstrained: int
    conflicting: tuple[str, ...]
    gap: float
    momentary: int
    velocities: int
    proposals: tuple[str, ...] = ()
    idle: tuple[str, ...] = ()
    loose: tuple[str, ...] = ()
    locked: tuple[str, ...] = ()
    slips: tuple[str, ...] = ()
    driven: tuple[str, ...] = ()
    blocks: tuple[int, ...] = ()
    solves: str = ""
    dead_point: bool = False
    never_moves: bool = False
    system: System | None = field(default=None, repr=False, compare=False)

    def __str__(self) -> str:
        lines = [
            f"{self.name}: {self.n} coordinates, {self.rows} constraint rows of rank {self.rank}, "
            f"degrees of freedom {self.dof} (Grübler's count {self.grubler})"
        ]
        if self.slips:
            lines.append(f"  {self.velocities} freedoms of velocity, by rows that positions do not see: "
                         f"{list_first(self.slips, 12, '; ')}")  # fmt: skip
        if self.redundant:
            harmless = "" if self.overconstrained or self.conflicting else ", whatever its dimensions"
            lines.append(f"  redundant{harmless}: {list_first(self.redundant, 12, '; ')}")
            lines.append(f"  rows that depend on each other: {list_first(self.involved, 12, '; ')}")
        if self.overconstrained:
            general = len(self.redundant) - self.overconstrained
            lines.append(
                f"  overconstrained: {self.overconstrained} of them fit together only for its special dimensions"
                + (f", {general} whatever its dimensions" if general else "")
                + "; a general change of dimensions keeps it from assembling"
            )
            lines += [f"    {proposal}" for proposal in self.proposals]
        lines += [f"  {name} {IDLE}" for name in self.idle]
        lines += [f"  {freedom}" for freedom in (*self.loose, *self.locked)]
        if self.momentary:
            lines.append(f"  the drawn pose is singular: {self.momentary} further rows lose their independence there")
        if self.conflicting:
            lines.append(f"  does not assemble, gap {self.gap:.3g}; in conflict: {'; '.join(self.conflicting)}")
        if self.solves:
            lines.append(f"  driven by {', '.join(self.driven)}: {self.solves}")
        if self.never_moves:
            lines.append(f"  {NEVER_MOVES.format(', '.join(self.driven))}")
        elif self.dead_point and not self.momentary:
            lines.append("  the drawn pose is a dead point of these inputs: draw it beside that to move it by them")
        return "\n".join(lines)


@public
@widened
def mobility(system: System, driven: str | Sequence[str] | None = None) -> Mobility:
    """Count coordinates, rows, rank and freedoms of a system, and name redundant and conflicting constraints.

    The rank is taken at the assembled drawing and at poses nearby, so that a singular drawing does not mislead. The
    report also says which way solves for poses take: block by block in closed form, by Newton, or on the host.

    Args:
        system: the system; its parameters must be concrete numbers.
        driven: name or names of the inputs that solves are to be described for; by default the independent coordinates
            that `compile` found, which need not be those that you will drive.

    Raises:
        InputError: an unknown name, too few or too many inputs, or inputs that leave a coordinate undetermined.

    Source: source text, (1), (22), (88); Grübler's count.
    """
    check_system(system, "mobility")
    top = system.topology
    inputs, blocks, solves = _way(system, (driven,) if isinstance(driven, str) else driven)
    view = free_plan(top)
    n, m = len(view.unknown), len(view.rows)
    eq = derive(system)
    if top.large and top.dim == 3:
        dense_only(top, "the mobility report of a spatial mechanism, which names joints,")
    samples = sample_poses(system, 4)  # 4 assembled poses at which the rank is taken; the largest counts
    best = max(samples, key=lambda sample: sample.rank)
    matrix, rank = best.jacobian, best.rank
    left = np.abs(np.asarray(evaluate(eq, samples[0].q)[0]))
    gap = float(left.max(initial=0.0))
    assembles = meets(eq, samples[0].q, gap)
    dead_point = stuck = False
    if assembles and solves:
        view_of_inputs = plan(top, inputs, (), system.degrees_of_freedom)
        dead_point = judge_start(view_of_inputs, eq, samples[0].q) == Status.SINGULAR_START
        stuck = dead_point and never_moves(system, view_of_inputs, eq)
    conflicting = () if assembles else tuple(top.rows[i] for i in np.argsort(-left) if left[i] > 1e-3 * gap)
    if not assembles and not top.large:
        gap = float(row_gaps(to_host(eq), np.asarray(samples[0].q), np.argsort(-left)[:1])[0])
    redundant, involved = _dependent(matrix)
    names = [top.rows[i] for i in view.rows]
    bodies = Freedoms(top, eq, np.asarray(best.q)) if top.dim == 3 else None
    count = grubler(top) if bodies is None else bodies.grubler
    special, idle = 0, _idle(matrix)
    if redundant and assembles:
        general = general_sample(system, 2)
        special = _special(general, rank, min(n - rank - count, len(redundant)), n)
        if not special:  # what holds something in other designs, and is redundant there too, is missed nowhere
            idle = [i for i in idle if i in _idle(general[0].jacobian)]
    # Of three rows that keep points on a line, two hold it, wherever it points: what counts is whether all are idle.
    without = {int(view.rows[i]) for i in idle}
    whole = [set(rows) for layout in top.layout for rows in layout.rows.tolist() if set(rows) <= without]
    idle = [i for i in idle if int(view.rows[i]) in set().union(*whole)]
    proposals = tuple(bodies.proposals()) if bodies is not None and special else ()
    return Mobility(
        name=top.name,
        n=n,
        rows=m,
        rank=rank,
        dof=n - rank,
        grubler=count,
        redundant=tuple(names[i] for i in redundant),
        involved=tuple(names[i] for i in involved),
        overconstrained=special,
        conflicting=conflicting,
        gap=gap,
        momentary=rank - samples[0].rank if assembles else 0,
        proposals=proposals,
        idle=tuple(names[i] for i in idle),
        loose=tuple(loose_motions(system, ()) if top.dim == 3 else unheld(top)),
        locked=tuple(explain_lock(system)) if assembles else (),
        slips=top.rate_rows,
        velocities=n - rank - _slipping(system, best),
        driven=inputs,
        blocks=blocks,
        solves=solves,
        dead_point=dead_point,
        never_moves=stuck,
        system=system,
    )


def _way(system: System, driven: Sequence[str] | None) -> tuple[tuple[str, ...], tuple[int, ...], str]:
    """Inputs, the blocks that their plan is solved in, and which way its poses take, in words."""
    usual = system.independent or drivable(system.topology)[: system.degrees_of_freedom]
    names = usual if driven is None else tuple(driven)
    try:
        view = plan(system.topology, names, (), system.degrees_of_freedom)
    except InputError:
        if driven is not None:
            raise
        return (), (), ""  # what is independent in the drawing need not determine the motion by its structure
    if not names or not len(view.unknown):
        return (), (), ""
    return names, *_describe_solves(view)


def _describe_solves(view: Plan) -> tuple[tuple[int, ...], str]:
    """Unknowns of the blocks that a plan is solved in, and which way its poses take, in words."""
    count, by_matrices = len(view.unknown), "by sparse LU" if by_lu(view) else "by dense matrices"
    if view.large:
        return (), f"{count} unknowns, whose matrices are kept sparse: pose by pose on the host, {by_matrices}"
    if not writes_out(view):
        too_much = f"{count} unknowns"
        if count <= LARGEST_WRITTEN:
            too_much = f"{sum(block.elimination.cost for block in kernel(view).blocks)} multiplications for a step"
        return (), f"too much to be written out, {too_much}: pose by pose on the host, {by_matrices}"
    every = kernel(view).blocks
    newton = [block for block in every if block.rows.form == "iterated"]
    sizes = tuple(len(block.columns) for block in every)
    if not newton:
        said = (
            f"in closed form, {_join_counts('block', [len(sizes)])} of at most {_join_counts('unknown', [max(sizes)])}"
        )
    else:
        closed = len(every) - len(newton)
        said = f"{_join_counts('block', [closed])} in closed form, " if closed else ""
        unknowns, spent = [len(block.columns) for block in newton], [block.elimination.cost for block in newton]
        said += (
            f"by Newton on {_join_counts('unknown', unknowns)}, eliminated with {_join_counts('multiplication', spent)}"
        )
    return sizes, said + (", single poses by sparse LU on the host" if by_lu(view) else "")


def _join_counts(noun: str, numbers: list[int]) -> str:
    *first, last = map(str, numbers)
    said = f"{', '.join(first)} and {last}" if first else last
    return f"{said} {noun}" + ("" if said == "1" else "s")


def _slipping(system: System, sample: Sample) -> int:
    """Count the freedoms that the rows on velocities take away in a pose."""
    top = system.topology
    if not top.rates:
        return 0
    dense_only(top, "the count of rows on velocities")
    free = rank_of(sample.jacobian)[1]
    rows = np.asarray(_rate_rows(system, sample.q))
    return rank_of(rows[:, top.unknown] @ free.T)[0]


@jax.jit  # operation by operation it is a hundred programs
def _rate_rows(system: System, q: Array) -> Array:
    return coefficients(system.topology, rate_constants(system), q)


def _special(general: tuple[Sample, bool], rank: int, by_count: int, unknowns: int) -> int:
    """Count the redundancies of these dimensions only: what the rank gains by a general change of the drawing.

    Where that leaves no motion at all the rank cannot show them all; the count of joints then says how many there are.
    """
    found, assembles = general
    if not assembles:
        return max(1, found.rank - rank, by_count)
    return max(0, found.rank - rank, by_count if found.rank == unknowns and found.rank > rank else 0)


def grubler(topology: Topology) -> int:
    """Freedoms by Grübler's count, ``3 (bodies - 1) - 2 (class I joints) - (class II joints)``.

    A point shared by k bodies counts as k - 1 revolute joints, one on the ground as k; a point of no body (or of a
    body of one point) has two freedoms.
    """
    fixed = np.array(topology.fixed[: len(topology.points) * topology.dim]).reshape(-1, topology.dim)
    bodies = [b for b in topology.bodies if len(b.points) > 1 and not fixed[list(b.points)].all()]
    shares = np.zeros(len(topology.points), dtype=int)
    for body in bodies:
        shares[list(body.points)] += 1
    count = 3 * len(bodies)
    for point, bodies_here in enumerate(shares):
        if bodies_here:
            count -= 2 * (bodies_here - 1) + int(fixed[point].sum())
        else:
            count += 2 - int(fixed[point].sum())
    return int(count - sum(joint.freedoms_removed for joint in topology.joints))


def _idle(matrix: np.ndarray) -> list[int]:
    """Rows without a slope in a general pose."""
    if not isinstance(matrix, np.ndarray) or not matrix.size:
        return []
    slopes = np.linalg.norm(matrix, axis=1)
    return np.flatnonzero(slopes <= 1e-6 * slopes.max()).tolist()


def _dependent(matrix: Any) -> tuple[list[int], list[int]]:
    """Find the rows that depend on earlier ones, and all rows that take part in a dependency.

    They are read off the combinations of rows that vanish, which are few.
    """
    if isinstance(matrix, np.ndarray):
        left = rank_of(matrix.T)[1].T
    else:  # of a large mechanism
        from jaxnc.solvers.sparse_matrix import dependencies

        left = dependencies(matrix)
    involved = np.flatnonzero(np.abs(left).max(axis=1, initial=0.0) > _PART)
    redundant = []
    while left.shape[1]:
        # The last row of a dependency follows from the others; what remains is free of that row.
        last = int(np.flatnonzero(np.linalg.norm(left, axis=1) > _PART)[-1])
        redundant.append(last)
        left = left @ np.linalg.svd(left[last : last + 1], full_matrices=True)[2][1:].T
    return sorted(redundant), involved.tolist()


# -- four bars --------------------------------------------------------------------------------------------------------


@public
@dataclass(frozen=True)
class Grashof:
    """Type of a four-bar linkage; ``str()`` is a sentence.

    Attributes:
        type: crank-rocker, rocker-crank, double-crank, double-rocker, triple-rocker or change-point.
        margin: (sum of the other two) - (shortest + longest), a length: positive if some bar turns fully.
        lengths: ground, input, coupler and output.
    """

    type: str
    margin: float
    lengths: tuple[float, float, float, float]

    def __str__(self) -> str:
        return f"{self.type}, Grashof margin {self.margin:.6g}"

    __repr__ = __str__


@public
def grashof_type(ground: float, crank: float, coupler: float, rocker: float) -> Grashof:
    """Classify a four-bar linkage by its lengths (Grashof; Barker's names of the types).

    Args:
        ground: distance of the fixed pivots.
        crank: length of the input bar.
        coupler: length of the coupler.
        rocker: length of the output bar.

    Returns:
        Type and margin.

    Raises:
        InputError: a length that is not positive and finite, or four lengths that do not close.
    """
    lengths = (float(ground), float(crank), float(coupler), float(rocker))
    for name, x in zip(("ground", "crank", "coupler", "rocker"), lengths, strict=True):
        if not (math.isfinite(x) and x > 0):
            raise InputError(f"Grashof type: length {name!r} must be positive, got {x}")
    ordered = sorted(lengths)
    if ordered[3] > sum(ordered[:3]):
        name = ("ground", "crank", "coupler", "rocker")[lengths.index(ordered[3])]
        raise InputError(
            f"Grashof type: the loop does not close, {name!r} = {ordered[3]:g} exceeds the other three together"
        )
    margin = ordered[1] + ordered[2] - ordered[0] - ordered[3]
    if abs(margin) <= 1e-12 * ordered[3]:
        kind = "change-point"
    elif margin < 0:
        kind = "triple-rocker"
    else:
        kind = ("double-crank", "crank-rocker", "double-rocker", "rocker-crank")[lengths.index(ordered[0])]
    return Grashof(kind, margin, lengths)


@public
@on_host
def grashof(system: System, crank: str, coupler: str, rocker: str) -> Grashof:
    """Classify the four-bar loop of three bodies and the ground in a system.

    Args:
        system: the system.
        crank: name of the input body.
        coupler: name of the coupler body.
        rocker: name of the output body.

    Returns:
        Type and margin, from the assembled drawing.

    Raises:
        InputError: unknown body, or bodies that do not form a loop with two ground pivots.
    """
    check_system(system, "grashof()")
    top = system.topology
    sets = {name: set(body_of(top, name).points) for name in (crank, coupler, rocker)}
    fixed = {i for i in range(len(top.points)) if all(top.fixed[i * top.dim : (i + 1) * top.dim])}

    def common_point(a: set[int], b: set[int], what: str) -> int:
        both = a & b
        if len(both) != 1:
            raise InputError(f"Grashof type: {what} must share exactly one point, they share {len(both)}")
        return both.pop()

    joints = [
        common_point(sets[crank], fixed, f"{crank!r} and the ground"),
        common_point(sets[crank], sets[coupler], f"{crank!r} and {coupler!r}"),
        common_point(sets[coupler], sets[rocker], f"{coupler!r} and {rocker!r}"),
        common_point(sets[rocker], fixed, f"{rocker!r} and the ground"),
    ]
    eq = derive(system)
    q = np.asarray(settle(eq, np.zeros(len(top.coordinates))).q)
    p = [q[i * top.dim : (i + 1) * top.dim] for i in joints]
    a, b, c = (float(np.linalg.norm(p[k + 1] - p[k])) for k in range(3))
    return grashof_type(float(np.linalg.norm(p[3] - p[0])), a, b, c)
