"""Diagnosis: why a mechanism does not assemble, and the single dimension whose smallest change closes it."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.inputs import (
    check_parameters,
    check_system,
    dense_only,
    doubt_degrees,
    in_radians,
    make_plan,
    outside,
    stack,
)
from jaxnc.kinematics.position import solve_position
from jaxnc.kinematics.remedies import PARTS, Remedy, remedies
from jaxnc.notebooks import Shown
from jaxnc.solvers.assembly import derive, free_plan, meets, settle
from jaxnc.solvers.host import HostView
from jaxnc.status import Status
from jaxnc.system.host import from_jax
from jaxnc.system.precision import widened
from jaxnc.system.system import System
from jaxnc.types import Inputs

_NOT_DRAWN = "  its drawing does not assemble either: diagnose without inputs says why"


@public
@dataclass(frozen=True)
class Violation:
    """A constraint that is not met in the closest pose.

    Attributes:
        row: its name.
        gap: its residual, a length.
    """

    row: str
    gap: float


@public
@dataclass(frozen=True)
class Diagnosis(Shown):
    """Whether a mechanism assembles at its inputs, and if not why; ``str()`` is a report.

    Attributes:
        name: the mechanism.
        inputs: the inputs asked for; empty for the drawing itself.
        assembles: whether there is a pose.
        reachable: whether it was reached along the branch of the drawing.
        reached: inputs as far as the drawing's branch could be followed; empty where the drawing does not assemble.
        gap: largest residual of the closest pose, a length.
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

    def __str__(self) -> str:
        at = ", ".join(f"{k} = {v:.6g}" for k, v in self.inputs.items()) or "its drawing"
        got = ", ".join(f"{k} = {v:.6g}" for k, v in self.reached.items())
        if self.assembles and self.reachable:
            return f"{self.name} assembles at {at}"
        if self.assembles:
            return (
                f"{self.name} assembles at {at}, but that pose is not reached from the drawing: along its branch the "
                f"motion ends at {got} (a dead point lies between). Draw it on the other side, or give start="
            )
        lines = [f"{self.name} does not assemble at {at}; the closest pose leaves a gap of {self.gap:.3g}"]
        if self.inputs:
            lines.append(f"  from the drawing it can be moved as far as {got}" if got else _NOT_DRAWN)
        lines += [f"  not met: {v.row} (off by {v.gap:.3g})" for v in self.violations[:8]]
        if self.remedies:
            lines.append("  the smallest change of a single dimension that closes it:")
            lines += [f"    {r}" for r in self.remedies[:6]]
        else:
            lines.append("  no change of a single bar, cable, radius or ground coordinate was found that closes it")
        return "\n".join(lines)

    __repr__ = __str__


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
    check_parameters(system)
    eq = derive(system)
    inner = from_jax(eq)
    doubt_degrees(system, unit, inputs)
    (inputs,) = in_radians(system, unit, inputs)
    names, values, shape = stack(inputs or {})
    if shape != ():
        raise InputError(f"diagnose looks at one pose: give single values, got inputs of shape {shape}")
    outside(values, "diagnose")
    reached: dict[str, float] = {}
    reachable = True
    if inputs is None:
        q, size, _ = settle(eq, np.zeros(len(top.coordinates)))
        q, assembles, view = np.asarray(q), meets(eq, q, float(size)), HostView(free_plan(top), inner)
        rows, columns = np.arange(len(view.plan.rows)), np.arange(len(view.plan.unknown))
    else:
        view = HostView(make_plan(system, names, hold), inner)
        pose = solve_position(system, inputs, hold=hold, throw=False)
        assembles = reachable = int(pose.status) in (int(Status.CONVERGED), int(Status.SINGULAR))
        q = np.array(pose.q)
        reached = {n: float(q[top.position[n]]) for n in names}
        if not assembles:
            drawn, size, _ = settle(eq, np.zeros(len(top.coordinates)))
            reached = reached if meets(eq, drawn, float(size)) else {}
            known = np.concatenate([np.asarray(values), q[view.plan.known[len(names) :]]])
            q, rows, columns = _as_far_as_possible(view, q, known)
            assembles = meets(eq, q, float(np.max(np.abs(inner.residual(q[:, None])), initial=0.0)))
    asked = {n: float(v) for n, v in zip(names, np.asarray(values).reshape(-1), strict=True)}
    if assembles:
        return Diagnosis(top.name, asked, True, reachable, reached, 0.0, (), (), system)
    r = np.zeros(len(top.rows))
    r[view.plan.rows[rows]] = view.residual(q[:, None])[rows, 0]
    order = [int(i) for i in np.argsort(-np.abs(r)) if abs(r[i]) > 1e-6 * np.abs(r).max()]
    violations = tuple(Violation(top.rows[i], float(abs(r[i]))) for i in order)
    return Diagnosis(
        top.name,
        asked,
        False,
        False,
        reached,
        float(np.abs(r).max()),
        violations,
        remedies(top, view, q, rows, columns),
        system,
    )


def _as_far_as_possible(view: HostView, q: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Solve block after block at the wanted inputs, from the end of the branch, until one cannot be met.

    Returns:
        The pose, with the block that fails in its least-squares pose, and the rows and columns solved so far, that
        block included. Where the system has no block structure (redundant rows), everything is one block.
    """
    plan, begin = view.plan, q[view.plan.known]
    blocks = plan.sequence or ((np.arange(len(plan.rows)), np.arange(len(plan.unknown))),)
    rows, columns = np.zeros(0, int), np.zeros(0, int)
    paths = np.repeat(q[None], len(PARTS), axis=0)
    paths[:, plan.known] = begin + np.array(PARTS)[:, None] * (known - begin)
    paths[:, plan.fixed] = view.eq.home[plan.fixed]
    solved = np.zeros((len(PARTS), len(plan.unknown)))
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
