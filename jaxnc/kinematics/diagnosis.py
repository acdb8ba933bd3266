"""Diagnosis: why a mechanism does not assemble, and the single dimension whose smallest change closes it."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc import constraints as kinds
from jaxnc.compiling import jit
from jaxnc.errors import InputError
from jaxnc.kinematics.inputs import check_parameters, check_system, make_plan, outside, stack
from jaxnc.kinematics.large import dense_only
from jaxnc.kinematics.position import solve_position
from jaxnc.solvers import linear
from jaxnc.solvers.assembly import derive, free_plan, settle
from jaxnc.solvers.newton import largest, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.status import Status
from jaxnc.system.equations import Equations, residual
from jaxnc.system.precision import widened
from jaxnc.system.system import System
from jaxnc.types import Array, Inputs

_PARTS = tuple((k + 1) / 24 for k in range(24))  # steps by which inputs go beyond their reach, and a gap is closed
_LENGTHS = ("length", "radius")  # constants whose change is offered


@dataclass(frozen=True)
class Violation:
    """A constraint that is not met in the closest pose.

    Attributes:
        row: its name.
        gap: its residual, a length.
    """

    row: str
    gap: float


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


@dataclass(frozen=True)
class Diagnosis:
    """Whether a mechanism assembles at its inputs, and if not why; ``str()`` is a report.

    Attributes:
        name: the mechanism.
        inputs: the inputs asked for; empty for the drawing itself.
        assembles: whether there is a pose.
        reachable: whether it was reached along the branch of the drawing.
        reached: inputs as far as the drawing's branch could be followed.
        gap: largest residual of the closest pose, a length.
        violations: constraints that it does not meet, largest first.
        remedies: single changes of a dimension that just close the mechanism, smallest first.
    """

    name: str
    inputs: dict[str, float]
    assembles: bool
    reachable: bool
    reached: dict[str, float]
    gap: float
    violations: tuple[Violation, ...]
    remedies: tuple[Remedy, ...]

    def __str__(self) -> str:
        at = ", ".join(f"{k} = {v:.6g}" for k, v in self.inputs.items()) or "its drawing"
        got = ", ".join(f"{k} = {v:.6g}" for k, v in self.reached.items())
        if self.assembles and self.reachable:
            return f"{self.name} assembles at {at}"
        if self.assembles:
            return (
                f"{self.name} assembles at {at}, but that pose is not reached from the drawing: along its branch the "
                f"motion ends at {got} (a dead point lies between). Draw it on the other side, or give guess= or start="
            )
        lines = [f"{self.name} does not assemble at {at}; the closest pose leaves a gap of {self.gap:.3g}"]
        if self.reached and self.inputs:
            lines.append(f"  from the drawing it can be moved as far as {got}")
        lines += [f"  not met: {v.row} (off by {v.gap:.3g})" for v in self.violations[:8]]
        if self.remedies:
            lines.append("  the smallest change of a single dimension that closes it:")
            lines += [f"    {r}" for r in self.remedies[:6]]
        else:
            lines.append("  no change of a single bar, cable, radius or ground coordinate was found that closes it")
        return "\n".join(lines)


@widened
def diagnose(system: System, inputs: Inputs | None = None, hold: Sequence[str] = ()) -> Diagnosis:
    """Say why a mechanism does not assemble, and what would mend it.

    The closest pose is found by least squares. For every length (bars, cables, radii, coordinates of ground points) the
    smallest change that closes the mechanism is solved for exactly: there the constraints are met and the pose is
    singular, because the mechanism just reaches.

    Args:
        system: the system.
        inputs: value of each driven coordinate; None to assemble the drawing itself.
        hold: coordinates that keep their start value.

    Returns:
        The diagnosis.

    Raises:
        InputError: wrong inputs, as in `solve_position`.
    """
    check_system(system, "diagnose")
    top = system.topology
    dense_only(system.topology, "diagnose")
    check_parameters(system)
    eq = derive(system)
    q, size, _ = settle(eq, np.zeros(len(top.coordinates)))
    names, values, shape = stack(inputs or {})
    if shape != ():
        raise InputError(f"diagnose looks at one pose: give single values, got inputs of shape {shape}")
    outside(values, "diagnose")
    reached: dict[str, float] = {}
    reachable = True
    if inputs is None:
        view, assembles = free_plan(top), bool(size <= 1e3 * tolerance(eq, q))
        rows, columns = np.arange(len(view.rows)), np.arange(len(view.unknown))
    else:
        view = make_plan(system, names, hold)
        pose = solve_position(system, inputs, hold=hold, throw=False)
        assembles = reachable = int(pose.status) in (int(Status.CONVERGED), int(Status.SINGULAR))
        reached = {n: float(pose[n]) for n in names}
        known = jnp.concatenate([jnp.asarray(values), pose.q[view.known[len(names) :]]])
        q, rows, columns = _as_far_as_possible(view, eq, pose.q, known)
        assembles = assembles or bool(largest(residual(eq, q)) <= 1e3 * tolerance(eq, q))
    asked = {n: float(v) for n, v in zip(names, np.asarray(values).reshape(-1), strict=True)}
    if assembles:
        return Diagnosis(top.name, asked, True, reachable, reached, 0.0, (), ())
    r = np.zeros(len(top.rows))
    r[view.rows[rows]] = np.asarray(residual(eq, q))[view.rows[rows]]
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
        _remedies(view, eq, q, rows, columns),
    )


@functools.partial(jit, static_argnums=0)
def _linearise(view: Plan, eq: Equations, q: Array):
    return view.linearise(eq, q)[:2]


def _as_far_as_possible(view: Plan, eq: Equations, q: Array, known: Array) -> tuple[Array, np.ndarray, np.ndarray]:
    """Solve block after block at the wanted inputs, from the end of the branch, until one cannot be met.

    Returns:
        The pose, with the block that fails in its least-squares pose, and the rows and columns solved so far, that
        block included. Where the system has no block structure (redundant rows), everything is one block.
    """
    begin = q[view.known]
    blocks = view.sequence or ((np.arange(len(view.rows)), np.arange(len(view.unknown))),)
    rows, columns = np.zeros(0, int), np.zeros(0, int)
    paths = [view.join(q[view.unknown], begin + p * (known - begin), eq.home[view.fixed]) for p in _PARTS]
    solved = np.zeros((len(_PARTS), len(view.unknown)))
    for block_rows, block_columns in blocks:
        rows, columns = np.append(rows, block_rows), np.append(columns, block_columns)
        x = np.asarray(q)[view.unknown].copy()
        size = np.inf
        for k, path in enumerate(paths):  # followed along the change of the inputs, so that nothing turns over
            x[columns] = np.where(np.isin(columns, block_columns), x[columns], solved[k][columns])
            x, size = _least_squares(view, eq, np.asarray(path), x, block_rows, block_columns)
            solved[k] = x
        if size > 1e-9 * float(eq.length):
            break
    return jnp.asarray(paths[-1]).at[view.unknown].set(solved[-1]), rows, columns


def _least_squares(view: Plan, eq: Equations, q: np.ndarray, x: np.ndarray, rows, columns) -> tuple[np.ndarray, float]:
    """Levenberg-Marquardt on some rows and columns of a plan, on the host."""
    q, x, damping = q.copy(), x.copy(), 1e-6

    def at(x):
        q[view.unknown] = x
        r, jacobian = _linearise(view, eq, jnp.asarray(q))
        return np.asarray(r)[rows], np.asarray(jacobian)[np.ix_(rows, columns)]

    r, jacobian = at(x)
    for _ in range(200):
        if np.abs(r).max() < 1e-14 * float(eq.length) or damping > 1e8:
            break
        normal = jacobian.T @ jacobian
        weight = damping * np.trace(normal) / len(columns) + 1e-300
        trial = x.copy()
        trial[columns] -= np.linalg.lstsq(normal + weight * np.eye(len(columns)), jacobian.T @ r, rcond=None)[0]
        new, new_jacobian = at(trial)
        if new @ new < r @ r:
            done = np.abs(trial - x).max() < 1e-13 * float(eq.length)
            x, r, jacobian, damping = trial, new, new_jacobian, max(0.1 * damping, 1e-14)
            if done:
                break
        else:
            damping *= 10.0
    return x, float(np.abs(r).max())


def _candidates(eq: Equations) -> list[tuple[str, float, tuple[int, int, int] | None, int]]:
    """Dimensions that may be changed: ``(name, value, (block, instance, constant) or None, coordinate or -1)``."""
    top, out = eq.topology, []
    for b, block in enumerate(top.blocks):
        for k, constant in enumerate(block.kind.constants):
            if constant not in _LENGTHS:
                continue
            for i, owners in enumerate(block.owners):
                ends = block.points[i] if block.kind is kinds.cable(len(block.points[i])) else block.points[i][:2]
                where = "-".join(top.points[p] for p in dict.fromkeys(ends))
                value = float(eq.constants[b][i, k])
                out.append((f"{constant} {where} of {top.called(*owners)}", value, (b, i, k), -1))
    for index, name in enumerate(top.coordinates[: len(top.points) * top.dim]):
        if top.fixed[index]:
            out.append((f"{name} of the ground", float(eq.home[index]), None, index))
    return out


def _remedies(view: Plan, eq: Equations, q: Array, rows: np.ndarray, columns: np.ndarray) -> tuple[Remedy, ...]:
    candidates = _candidates(eq)
    if not candidates:
        return ()
    found = []
    directions, shifts = _directions(eq, candidates)
    # The multiplier of the failing rows is their residual; those solved before balance it on their own columns.
    r, jacobian = (np.asarray(a) for a in _linearise(view, eq, q))
    matrix, multiplier = jacobian[np.ix_(rows, columns)], r[rows].copy()
    failing = np.abs(multiplier) > 1e-9 * np.abs(multiplier).max()
    if not failing.all():
        pull = matrix[failing].T @ multiplier[failing]
        multiplier[~failing] = -np.linalg.lstsq(matrix[~failing].T, pull, rcond=None)[0]
    sub = _Part(view, tuple(rows.tolist()), tuple(columns.tolist()))
    changes, left = _fold(sub, eq, q, jnp.asarray(multiplier), directions, shifts)
    for (name, value, slot, _), change, rest in zip(candidates, np.asarray(changes), np.asarray(left), strict=True):
        sensible = np.isfinite(change) and abs(change) < 20 * float(eq.length)
        if rest <= 1e-9 * float(eq.length) and sensible and (slot is None or value + change > 0):
            found.append(Remedy(name, value, float(change)))
    return tuple(sorted(found, key=lambda r: abs(r.change)))


def _directions(eq: Equations, candidates) -> tuple[list[Array], Array]:
    """Unit changes of constants (per block) and of fixed coordinates, one leading axis over candidates."""
    count = len(candidates)
    constants = [np.zeros((count, *c.shape)) for c in eq.constants]
    shifts = np.zeros((count, len(eq.home)))
    for j, (_, _, slot, index) in enumerate(candidates):
        if slot is None:
            shifts[j, index] = 1.0
        else:
            b, i, k = slot
            constants[b][j, i, k] = 1.0
    return [jnp.asarray(c) for c in constants], jnp.asarray(shifts)


@dataclass(frozen=True)
class _Part:
    """Some rows and columns of a plan (static)."""

    view: Plan
    rows: tuple[int, ...]
    columns: tuple[int, ...]


@functools.partial(jit, static_argnums=0)
def _fold(part: _Part, eq: Equations, q: Array, multiplier: Array, directions: list[Array], shifts: Array):
    """The value of each candidate dimension p at which the mechanism just closes.

    There Φ(x, p) = 0 and the pose is singular, Φ_xᵀ λ = 0, with Φ_p·λ = 1. The least-squares pose solves the same
    equations for Φ - r with its own residual r and p unchanged; r is taken away step by step.
    """
    view, rows, columns = part.view, np.array(part.rows), np.array(part.columns)
    n = len(columns)
    base = q[view.unknown]
    left = view.residual(eq, q)[rows]

    def one(direction, shift):
        def phi(x, p):
            moved = _with_constants(eq, [c + p * d for c, d in zip(eq.constants, direction, strict=True)])
            at = view.join(base.at[columns].set(x), q[view.known], q[view.fixed]) + p * shift
            return view.residual(moved, at)[rows]

        def equations_of(z, share):
            r, pull = jax.vjp(phi, z[:n], z[n])
            gx, gp = pull(z[n + 1 :])
            return jnp.concatenate([r - share * left, gx * eq.length, jnp.reshape(gp - 1.0, (1,)) * eq.length])

        slope = jax.jvp(lambda p: phi(base[columns], p), (jnp.zeros(()),), (jnp.ones(()),))[1]
        pull = jnp.sum(multiplier * slope)
        useful = jnp.abs(pull) > 1e-6 * jnp.sqrt(jnp.sum(multiplier**2)) * jnp.sqrt(jnp.sum(slope**2) + 1e-300)
        lam = jnp.where(useful, multiplier / jnp.where(useful, pull, 1.0), 0.0)
        start = jnp.concatenate([base[columns], jnp.zeros(1), lam])

        def step(z, share):
            def again(_, z):
                r, jacobian = equations_of(z, share), jax.jacfwd(equations_of)(z, share)
                direct = linear.steps(jacobian, r[:, None])[:, 0]
                safe = linear.damped_step(jacobian, r, 1e-12)  # redundant rows leave the multipliers undetermined
                dz = jnp.where(jnp.max(jnp.abs(direct)) < 1e3 * eq.length, direct, safe)
                return z - jnp.where(jnp.all(jnp.isfinite(dz)), dz, 0.0)

            z = lax.fori_loop(0, 5, again, z)
            r = equations_of(z, share)
            return z, largest(r)

        z, sizes = lax.scan(step, start, jnp.asarray(1.0 - np.array(_PARTS)))
        return z[n], jnp.where(useful, sizes[-1], jnp.inf)

    return jax.vmap(one)(directions, shifts)


def _with_constants(eq: Equations, constants) -> Equations:
    return Equations(
        eq.topology, eq.home, eq.length, tuple(constants), eq.scales, eq.linear, eq.quadratic, eq.markers, eq.misfit
    )
