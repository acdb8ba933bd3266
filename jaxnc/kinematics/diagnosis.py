"""Diagnosis: why a mechanism does not assemble, and the single dimension whose smallest change closes it."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from jaxnc import constraints as kinds
from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.host_solve import end_of_way, never_moves
from jaxnc.kinematics.inputs import (
    NEVER_MOVES,
    check_inputs,
    check_system,
    dense_only,
    outside,
    row_gaps,
)
from jaxnc.kinematics.motion import coordinates_of
from jaxnc.kinematics.polynomial import circuits_hint
from jaxnc.kinematics.position import solve_position
from jaxnc.notebooks import Reported
from jaxnc.solvers.assembly import derive, free_plan, meets, sample_poses, settle
from jaxnc.solvers.host import HostView
from jaxnc.solvers.host.view import least_squares
from jaxnc.status import Status
from jaxnc.system.host import Expansion, HostEquations, Slot, from_jax
from jaxnc.system.identity import Thing
from jaxnc.system.precision import widened
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import Inputs

_SINGULAR = (
    "the drawing is a singular position of these inputs, where branches meet: draw it beside that, or give start="
)
_PARTS = tuple((k + 1) / 24 for k in range(24))  # steps by which inputs go beyond their reach, and a gap is closed
_LENGTHS = ("length", "radius")  # constants whose change is offered
_NOT_DRAWN = "  its drawing does not assemble either: diagnose without inputs says why"


@public
@dataclass(frozen=True)
class Violation:
    """A constraint that is not met in the closest pose.

    Attributes:
        row: its name.
        gap: how far a point has to move to meet it, a length: of a bar what its length lacks.
    """

    row: str
    gap: float


@public
@dataclass(frozen=True)
class Remedy:
    """A change of one dimension that just closes the mechanism.

    Attributes:
        dimension: which one.
        value: its value now.
        change: the smallest change of it that closes the mechanism.
    """

    dimension: str
    value: float
    change: float

    def __str__(self) -> str:
        return f"{self.dimension}: {self.value:.6g} → {self.value + self.change:.6g} ({self.change:+.3g})"

    __repr__ = __str__


@public
@dataclass(frozen=True, repr=False)
class Diagnosis(Reported):
    """A finding whether a mechanism assembles at its inputs, and if not why; ``str()`` is a report.

    Attributes:
        name: the mechanism.
        inputs: the inputs asked for; empty for the drawing itself.
        assembles: whether there is a pose.
        reachable: whether it was reached along the branch of the drawing.
        reached: inputs as far as the drawing's branch could be followed; empty where the drawing does not assemble.
        singular: whether the drawing is a singular position of the inputs, so that it has no branch to follow.
        never_moves: whether poses nearby are, too: one of the inputs may never change.
        gap: the largest gap of the closest pose, a length.
        violations: constraints that it does not meet, largest first.
        remedies: single changes of a dimension that just close the mechanism, smallest first.
        system: the system, for its drawing.
    """

    name: str
    inputs: dict[str, float]
    assembles: bool
    reachable: bool
    reached: dict[str, float]
    gap: float
    violations: tuple[Violation, ...]
    remedies: tuple[Remedy, ...]
    system: System | None = field(default=None, repr=False, compare=False)
    singular: bool = False
    never_moves: bool = False

    def __str__(self) -> str:
        at, got = "its drawing", ""
        if self.system is not None:
            write = self.system.topology.write_values
            at, got = write(self.inputs) or at, write(self.reached)
        if self.never_moves:
            return f"{self.name}: {NEVER_MOVES.format(', '.join(self.inputs))}"
        if self.assembles and self.reachable:
            return f"{self.name} assembles at {at}"
        if self.assembles and self.singular:
            return f"{self.name} assembles at {at}, but {_SINGULAR}"
        if self.assembles:
            hint = "" if self.system is None else circuits_hint(self.system, [*self.inputs])
            return (
                f"{self.name} assembles at {at}, but that pose is not reached from the drawing: along its branch the "
                f"motion ends at {got} (a dead point lies between). Draw it on the other side, or give start="
                f"{hint and f'; {hint}'}"
            )
        lines = [f"{self.name} does not assemble at {at}; the closest pose leaves a gap of {self.gap:.3g}"]
        if self.singular:
            lines.append(f"  {_SINGULAR}")
        elif self.inputs:
            lines.append(f"  from the drawing it can be moved as far as {got}" if got else _NOT_DRAWN)
        lines += [f"  not met: {v.row} (off by {v.gap:.3g})" for v in self.violations[:8]]
        if self.remedies:
            lines.append("  the smallest change of a single dimension that closes it:")
            lines += [f"    {r}" for r in self.remedies[:6]]
        else:
            lines.append("  no change of a single bar, cable, radius or ground coordinate was found that closes it")
        return "\n".join(lines)


@public
@widened
def diagnose(
    system: System, inputs: Inputs | None = None, hold: Sequence[str] = (), unit: str | None = None
) -> Diagnosis:
    """Say why a mechanism does not assemble, and what would mend it.

    The closest pose is found by least squares. For every length (bars, cables, radii, coordinates of ground points) the
    smallest change that closes the mechanism is solved for exactly: there the constraints are met and the pose is
    singular, because the mechanism just reaches.

    Args:
        system: the system.
        inputs: value of each driven coordinate; None to assemble the drawing itself.
        hold: coordinates that keep their start value.
        unit: what angles are given in, ``"rad"`` or ``"deg"``.

    Raises:
        InputError: wrong inputs, as in `solve_position`.
    """
    check_system(system, "diagnose")
    top = system.topology
    dense_only(system.topology, "diagnose")
    if inputs is None:
        plan, values = free_plan(top), np.zeros(0)
    else:
        plan, values, _ = check_inputs(system, inputs, hold, unit)
        if values.shape[:-1]:
            raise InputError(f"diagnose looks at one pose: give single values, got inputs of shape {values.shape[:-1]}")
        outside(values, "diagnose")
    asked = dict(zip(inputs or (), np.asarray(values).tolist(), strict=True))
    eq = derive(system)
    inner = from_jax(eq)
    view, reached, reachable, singular, never = HostView(plan, inner), {}, True, False, False
    drawn, size, _ = settle(eq, np.zeros(len(top.coordinates)))
    assembles = meets(eq, drawn, float(size))
    if inputs is None:
        q, rows, columns = np.asarray(drawn), np.arange(len(plan.rows)), np.arange(len(plan.unknown))
        known = q[plan.known]
    else:
        pose = solve_position(system, asked, hold=hold, throw=False, unit="rad")
        q, drawn_assembles = np.array(pose.q), assembles
        assembles = reachable = int(pose.status) in (int(Status.CONVERGED), int(Status.SINGULAR))
        singular = int(pose.status) == Status.SINGULAR_START
        if singular or int(pose.status) == Status.SINGULAR:
            never = never_moves(system, plan, eq)
        if singular:
            assembles, q = _assembles_beside(system, asked, hold, q)
        if assembles or drawn_assembles:
            end = q
            if not reachable and not singular:
                end = end_of_way(plan, inner, np.asarray(drawn), np.asarray(values, float), q)
            reached = {n: float(end[top.position[n]]) for n in asked}
        if not assembles:
            known = np.concatenate([np.asarray(values), q[plan.known[len(asked) :]]])
            q, rows, columns = _as_far_as_possible(view, q, known)
            assembles = meets(eq, q, float(np.max(np.abs(inner.residual(q[:, None])), initial=0.0)))
    if assembles:
        return Diagnosis(top.name, asked, True, reachable, reached, 0.0, (), (), system, singular, never)
    r = np.zeros(len(top.rows))
    r[view.plan.rows[rows]] = view.residual(q[:, None])[rows, 0]
    order = [int(i) for i in np.argsort(-np.abs(r)) if abs(r[i]) > 1e-6 * np.abs(r).max()]
    gaps = row_gaps(inner, q, np.array(order, int))
    violations = tuple(Violation(top.rows[i], float(gap)) for i, gap in zip(order, gaps, strict=True))
    violations = tuple(sorted(violations, key=lambda v: -v.gap))
    return Diagnosis(
        top.name,
        asked,
        False,
        False,
        reached,
        max((v.gap for v in violations), default=0.0),
        violations,
        _find_remedies(top, view, q, rows, columns, known),
        system,
        singular,
        never,
    )


def _assembles_beside(
    system: System, asked: dict[str, float], hold: Sequence[str], drawn: np.ndarray
) -> tuple[bool, np.ndarray]:
    """Say whether inputs are met from a pose near a singular drawing, and return that pose, or the last one."""
    top, q = system.topology, drawn
    names = (*top.points, *top.vectors, *(n for n in top.scalars if n not in asked))
    for sample in sample_poses(system, 4)[1:]:  # to either side, twice
        q = np.asarray(sample.q)
        start = {name: q[coordinates_of(top, name)] for name in names}
        pose = solve_position(system, asked, hold=hold, start=start, throw=False, unit="rad")
        if int(pose.status) == Status.CONVERGED:
            return True, drawn
    return False, q


def _as_far_as_possible(view: HostView, q: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Solve block after block at the wanted inputs, from the end of the branch, until one cannot be met.

    Returns:
        The pose, with the block that fails in its least-squares pose, and the rows and columns solved so far, that
        block included. Where the system has no block structure (redundant rows), everything is one block.
    """
    plan, begin = view.plan, q[view.plan.known]
    blocks = plan.sequence or ((np.arange(len(plan.rows)), np.arange(len(plan.unknown))),)
    rows, columns = np.zeros(0, int), np.zeros(0, int)
    paths = np.repeat(q[None], len(_PARTS), axis=0)
    paths[:, plan.known] = begin + np.array(_PARTS)[:, None] * (known - begin)
    paths[:, plan.fixed] = view.eq.home[plan.fixed]
    solved = np.zeros((len(_PARTS), len(plan.unknown)))
    for block_rows, block_columns in blocks:
        rows, columns = np.append(rows, block_rows), np.append(columns, block_columns)
        x, before = q[plan.unknown], np.isin(columns, block_columns)
        size = np.inf
        for k, path in enumerate(paths):  # followed along the change of the inputs, so that nothing turns over
            x[columns] = np.where(before, x[columns], solved[k][columns])
            close = 1e-13 if k + 1 == len(paths) else 1e-6  # on the way it need not be known better
            x, size = _least_squares(view, path, x, block_rows, block_columns, close)
            solved[k] = x
        if size > 1e-9 * view.eq.length:
            break
    paths[-1, plan.unknown] = solved[-1]
    return paths[-1], rows, columns


def _least_squares(
    view: HostView, q: np.ndarray, x: np.ndarray, rows: np.ndarray, columns: np.ndarray, close: float
) -> tuple[np.ndarray, float]:
    """Levenberg-Marquardt on some rows and columns of a plan, until a step is shorter than `close` sizes."""
    q, damping, length = q[:, None].copy(), 1e-6, view.eq.length

    def residual(x: np.ndarray) -> np.ndarray:
        q[view.plan.unknown, 0] = x
        return view.residual(q)[rows, 0]

    def jacobian() -> np.ndarray:  # where the residual was taken last
        return view.matrices(q)[0][0][np.ix_(rows, columns)]

    r, slope = residual(x), jacobian()
    for _ in range(200):
        if np.abs(r).max() < 1e-14 * length or damping > 1e8:
            break
        normal = slope.T @ slope
        weight = damping * np.trace(normal) / len(columns) + 1e-300
        trial = x.copy()
        trial[columns] -= np.linalg.lstsq(normal + weight * np.eye(len(columns)), slope.T @ r, rcond=None)[0]
        new = residual(trial)
        if new @ new < r @ r:
            done = np.abs(trial - x).max() < close * length
            x, r, damping = trial, new, max(0.1 * damping, 1e-14)
            if done:
                break
            slope = jacobian()
        else:
            damping *= 10.0
    return x, float(np.abs(r).max())


# -- remedies ---------------------------------------------------------------------------------------------------------


def _find_remedies(
    top: Topology, view: HostView, q: np.ndarray, rows: np.ndarray, columns: np.ndarray, known: np.ndarray
) -> tuple[Remedy, ...]:
    """Find what closes all the rows that are looked at, and what closes a loop of them that fails by itself."""
    found = {r.dimension: r for r in remedies(top, view, q, rows, columns, q, known)}
    pose, loop, own = _failing_loop(top, view, q, rows, columns)
    if len(loop) < len(rows):
        for remedy in remedies(top, view, pose, loop, own, q, known):
            found.setdefault(remedy.dimension, remedy)
    # Equal ones, as of two points of the ground, stay in their order whatever rounding says.
    return tuple(sorted(found.values(), key=lambda r: float(f"{abs(r.change):.9g}")))


def _failing_loop(
    top: Topology, view: HostView, q: np.ndarray, rows: np.ndarray, columns: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Leave out what need not be there for rows to fail: the closest pose, the rows and the columns that are left.

    A pose that is closest to all loops misses those that would close, too, if they hang together with one that fails.
    """
    owner = [top.row_owners[r][0] for r in view.plan.rows[rows]]
    owners = list(dict.fromkeys(owner))
    x, one_less = q[view.plan.unknown], np.ones(len(rows), bool)
    for leave in owners if len(owners) <= 60 else ():  # more take long, one after the other
        trial = one_less & np.array([o != leave for o in owner])
        if not trial.any():
            break
        nearest, size = _least_squares(view, q, x.copy(), rows[trial], columns, 1e-9)
        if size > 1e-9 * view.eq.length:
            x, one_less = nearest, trial
    pose, loop = q.copy(), rows[one_less]
    pose[view.plan.unknown] = x
    taking_part = view.matrices(pose[:, None])[0][0][np.ix_(loop, columns)].any(axis=0)
    return pose, loop, columns[taking_part]


def remedies(
    top: Topology,
    view: HostView,
    q: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
    begin: np.ndarray,
    known: np.ndarray,
) -> tuple[Remedy, ...]:
    """Single changes of a length or of a ground coordinate that just close a mechanism.

    What closes the `rows` that fail, from the pose `q` that is closest to them, need not close those behind them, of
    other loops, nor in the assembly of the pose `begin`: so it is looked for from there. `known` are the inputs.
    """
    candidates = _candidates(top, view.eq)
    if not candidates:
        return ()
    # The multiplier of the failing rows is their residual; those solved before balance it on their own columns.
    r, jacobian = view.residual(q[:, None])[:, 0], view.matrices(q[:, None])[0][0]
    matrix, multiplier = jacobian[np.ix_(rows, columns)], r[rows].copy()
    failing = np.abs(multiplier) > 1e-9 * np.abs(multiplier).max()
    if not failing.all():
        pull = matrix[failing].T @ multiplier[failing]
        multiplier[~failing] = -np.linalg.lstsq(matrix[~failing].T, pull, rcond=None)[0]
    with np.errstate(all="ignore"):
        changes, left = _fold(view, q, rows, columns, multiplier, [slot for _, _, slot in candidates])
    found, length = [], view.eq.length
    for (name, value, slot), change, rest in zip(candidates, changes, left, strict=True):
        sensible = np.isfinite(change) and abs(change) < 20 * length
        if not (rest <= 1e-9 * length and sensible and (isinstance(slot, int) or value + change > 0)):
            continue
        if len(rows) == len(view.plan.rows) or _closes(view, slot, float(change), begin, known):
            found.append(Remedy(name, value, float(change)))
    return tuple(found)


def _closes(view: HostView, slot: Slot, change: float, q: np.ndarray, known: np.ndarray) -> bool:
    """Say whether all loops close with a dimension that is changed by a little more."""
    eq, change = view.eq, 1.001 * change
    if isinstance(slot, int):
        home = eq.home.copy()
        home[slot] += change
        changed = dataclasses.replace(eq, home=home)
    else:
        block, instance, k = slot
        constants = [c.copy() for c in eq.constants]
        constants[block][instance, k] += change
        changed = dataclasses.replace(eq, constants=tuple(constants))
    again = HostView(view.plan, changed)
    pose = _as_far_as_possible(again, q, known)[0]
    return float(np.max(np.abs(again.residual(pose[:, None])), initial=0.0)) <= 1e-6 * float(eq.length)


def _candidates(top: Topology, eq: HostEquations) -> list[tuple[str, float, Slot]]:
    """Dimensions that may be changed: name, value, and where it is."""
    out: list[tuple[str, float, Slot]] = []
    for b, block in enumerate(top.blocks):
        for k, constant in enumerate(block.kind.constants):
            if constant not in _LENGTHS:
                continue
            for i, owners in enumerate(block.owners):
                ends = block.points[i] if block.kind is kinds.cable(len(block.points[i])) else block.points[i][:2]
                where = "-".join(top.points[p] for p in dict.fromkeys(ends))
                value = float(eq.constants[b][i, k])
                # Other points of such a body are carried along, in proportion.
                wide = any(o.thing is Thing.BODY and len(top.bodies[o.number].points) > len({*ends}) for o in owners)
                scaled = " (all of it in proportion)" if wide and len({*ends}) == 2 else ""
                out.append((f"{constant} {where} of {top.called(*owners)}{scaled}", value, (b, i, k)))
    for index, name in enumerate(top.coordinates[: len(top.points) * top.dim]):
        if top.fixed[index]:
            out.append((f"{name} of the ground", float(eq.home[index]), index))
    return out


def _fold(
    view: HostView, q: np.ndarray, rows: np.ndarray, columns: np.ndarray, multiplier: np.ndarray, slots: list[Slot]
) -> tuple[np.ndarray, np.ndarray]:
    """The change p of each candidate dimension at which the mechanism just closes, and what is left of the equations.

    There Φ(x, p) = 0 and the pose is singular, Φ_xᵀ λ = 0, with Φ_p·λ = 1. The least-squares pose solves the same
    equations for Φ - r with its own residual r and p unchanged; r is taken away step by step. Candidates are lanes.
    """
    eq, length = view.eq, view.eq.length
    at, row = view.plan.unknown[columns], view.plan.rows[rows]
    n, m, last = len(at), len(row), len(q)
    change, rest = np.zeros(len(slots)), np.full(len(slots), np.inf)

    still = np.zeros((len(eq.topology.rows), len(slots)))
    r, slopes, _ = Expansion(eq, slots)(np.repeat(q[:, None], len(slots), axis=1), change, still)
    gap, slope = r[row, 0], slopes[:, row, last]
    pull = slope @ multiplier
    useful = np.abs(pull) > 1e-6 * np.linalg.norm(multiplier) * np.linalg.norm(slope, axis=1)
    if not useful.any():
        return change, rest
    # Coordinates and change in parts of the size, forces on angles too: no step is judged by the unit of length.
    unit = np.concatenate([length / view.weights[at, 0], [length], np.ones(m)])
    scale = np.concatenate([np.full(m, length), length / unit[: n + 1]])
    expansion = Expansion(eq, [slot for slot, good in zip(slots, useful, strict=True) if good])
    count, moved = int(useful.sum()), np.append(at, last)

    def equations(z: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Residuals ``(lanes, m + n + 1)`` and their derivatives, at unknowns, change and multipliers: pure numbers."""
        pose, factors = np.repeat(q[:, None], count, axis=1), np.zeros((len(eq.topology.rows), count))
        pose[at], factors[row] = z[:, :n].T, z[:, n + 1 :].T
        r, slopes, curvature = expansion(pose, z[:, n], factors)
        slopes = slopes[:, row[:, None], moved]
        force = (np.swapaxes(slopes, 1, 2) @ z[:, n + 1 :, None])[:, :, 0]
        force[:, n] -= 1.0
        matrix = np.zeros((count, m + n + 1, n + 1 + m))
        matrix[:, :m, : n + 1] = slopes
        matrix[:, m:, : n + 1] = curvature[:, moved[:, None], moved]
        matrix[:, m:, n + 1 :] = np.swapaxes(slopes, 1, 2)
        return np.concatenate([r[row].T - share * gap, force], axis=1) / scale, matrix * unit / scale[:, None]

    z = np.concatenate(
        [np.repeat(q[None, at], count, axis=0), np.zeros((count, 1)), multiplier / pull[useful, None]], axis=1
    )
    for share in 1.0 - np.array(_PARTS):
        for _ in range(5):  # iterations of Newton after each step
            dz = _newton_steps(*equations(z, share), 1e3)
            z = z - unit * dz
            if np.max(np.abs(dz[:, : n + 1])) <= 1e-13:
                break
    change[useful], rest[useful] = z[:, n], length * np.max(np.abs(equations(z, 0.0)[0]), axis=1)
    return change, rest


def _newton_steps(right: np.ndarray, matrix: np.ndarray, most: float) -> np.ndarray:
    """Newton's steps ``(lanes, k)``; hardly damped where redundant rows leave the multipliers undetermined."""
    step = least_squares(matrix, right[:, :, None])[:, :, 0]
    wild = ~(np.max(np.abs(step), axis=1) < most)
    if wild.any():
        matrix, back = matrix[wild], np.swapaxes(matrix[wild], 1, 2)
        normal, size = back @ matrix, matrix.shape[2]
        weight = 1e-12 * np.trace(normal, axis1=1, axis2=2) / size + 1e-300
        step[wild] = least_squares(normal + weight[:, None, None] * np.eye(size), back @ right[wild, :, None])[:, :, 0]
    return np.where(np.isfinite(step).all(axis=1, keepdims=True), step, 0.0)
