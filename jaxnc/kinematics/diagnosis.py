"""Diagnosis: why a mechanism does not assemble, and the single dimension whose smallest change closes it."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.kinematics.inputs import check_parameters, make_plan, stack
from jaxnc.kinematics.position import solve_position
from jaxnc.solvers import linear
from jaxnc.solvers.assembly import closest, derive, free_plan, settle
from jaxnc.solvers.newton import largest, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.status import Status
from jaxnc.system.equations import Equations, residual
from jaxnc.system.system import System
from jaxnc.types import Array, Inputs

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
        assembles: whether a pose was found.
        reached: inputs as far as the drawing's branch could be followed.
        gap: largest residual of the closest pose, a length.
        violations: constraints that it does not meet, largest first.
        remedies: single changes of a dimension that just close the mechanism, smallest first.
    """

    name: str
    inputs: dict[str, float]
    assembles: bool
    reached: dict[str, float]
    gap: float
    violations: tuple[Violation, ...]
    remedies: tuple[Remedy, ...]

    def __str__(self) -> str:
        at = ", ".join(f"{k} = {v:.6g}" for k, v in self.inputs.items()) or "its drawing"
        if self.assembles:
            return f"{self.name} assembles at {at}"
        lines = [f"{self.name} does not assemble at {at}; the closest pose leaves a gap of {self.gap:.3g}"]
        if self.reached and self.inputs:
            got = ", ".join(f"{k} = {v:.6g}" for k, v in self.reached.items())
            lines.append(f"  from the drawing it can be moved as far as {got}")
        lines += [f"  not met: {v.row} (off by {v.gap:.3g})" for v in self.violations[:8]]
        if self.remedies:
            lines.append("  the smallest change of a single dimension that closes it:")
            lines += [f"    {r}" for r in self.remedies[:6]]
        else:
            lines.append("  no change of a single length closes it")
        return "\n".join(lines)


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
    top = system.topology
    check_parameters(system)
    eq = derive(system)
    q, size = settle(eq, np.zeros(len(top.coordinates)))
    names, values, _ = stack(inputs or {})
    reached: dict[str, float] = {}
    if inputs is None:
        view, assembles = free_plan(top), bool(size <= 1e3 * tolerance(eq, q))
    else:
        view = make_plan(system, names, hold)
        pose = solve_position(system, inputs, hold=hold, throw=False)
        assembles = int(pose.status) in (int(Status.CONVERGED), int(Status.SINGULAR))
        reached = {n: float(pose[n]) for n in names}
        known = jnp.concatenate([jnp.asarray(values), pose.q[view.known[len(names) :]]])
        q = view.join(pose.q[view.unknown], known, eq.home[view.fixed])
        q, size = _closest(view, eq, q)
    asked = {n: float(v) for n, v in zip(names, np.asarray(values).reshape(-1), strict=True)}
    if assembles:
        return Diagnosis(top.name, asked, True, reached, 0.0, (), ())
    r = np.asarray(residual(eq, q))
    order = [int(i) for i in np.argsort(-np.abs(r)) if abs(r[i]) > 1e-6 * np.abs(r).max()]
    violations = tuple(Violation(top.rows[i], float(abs(r[i]))) for i in order)
    return Diagnosis(top.name, asked, False, reached, float(np.abs(r).max()), violations, _remedies(view, eq, q))


@functools.partial(jax.jit, static_argnums=0)
def _closest(view: Plan, eq: Equations, q: Array):
    return closest(view, eq, q, 400)


def _candidates(eq: Equations) -> list[tuple[str, float, tuple[int, int, int] | None, int]]:
    """Dimensions that may be changed: ``(name, value, (block, instance, constant) or None, coordinate or -1)``."""
    top, out = eq.topology, []
    for b, block in enumerate(top.blocks):
        for k, constant in enumerate(block.kind.constants):
            if constant not in _LENGTHS:
                continue
            for i, owner in enumerate(block.owners):
                where = "-".join(top.points[p] for p in dict.fromkeys(block.points[i][:2]))
                value = float(eq.constants[b][i, k])
                out.append((f"{constant} {where} of {owner}", value, (b, i, k), -1))
    for index, name in enumerate(top.coordinates[: len(top.points) * top.dim]):
        if top.fixed[index]:
            out.append((f"{name} of the ground", float(eq.home[index]), None, index))
    return out


def _remedies(view: Plan, eq: Equations, q: Array) -> tuple[Remedy, ...]:
    candidates = _candidates(eq)
    if not candidates:
        return ()
    found = []
    directions, shifts = _directions(eq, candidates)
    changes, left = _fold(view, eq, q, directions, shifts)
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


@functools.partial(jax.jit, static_argnums=0)
def _fold(view: Plan, eq: Equations, q: Array, directions: list[Array], shifts: Array):
    """Per candidate dimension p: Φ(x, p) = 0, Φ_xᵀ λ = 0, Φ_p·λ = 1, by damped Newton from the closest pose."""
    m, n = len(view.rows), len(view.unknown)
    start_r = view.residual(eq, q)

    def one(direction, shift):
        def phi(x, p):
            moved = _with_constants(eq, [c + p * d for c, d in zip(eq.constants, direction, strict=True)])
            at = view.join(x, q[view.known], q[view.fixed]) + p * shift
            return view.residual(moved, at)

        def rows(z):
            x, p, lam = z[:n], z[n], z[n + 1 :]
            r, pull = jax.vjp(phi, x, p)
            gx, gp = pull(lam)
            return jnp.concatenate([r, gx * eq.length, jnp.reshape(gp - 1.0, (1,)) * eq.length])

        slope = jax.jvp(lambda p: phi(q[view.unknown], p), (jnp.zeros(()),), (jnp.ones(()),))[1]
        pull = jnp.sum(start_r * slope)
        useful = jnp.abs(pull) > 1e-9 * jnp.sqrt(jnp.sum(start_r**2))
        pull = jnp.where(useful, pull, 1.0)
        lam = jnp.where(useful, start_r / pull, 0.0)
        z = jnp.concatenate([q[view.unknown], jnp.reshape(-jnp.sum(start_r**2) / pull, (1,)), lam])

        def improve(_, state):
            z, r, damping = state
            dz = linear.damped_step(jax.jacfwd(rows)(z), r, damping)
            trial = z - jnp.where(jnp.all(jnp.isfinite(dz)), dz, 0.0)
            new = rows(trial)
            better = jnp.sum(new**2) < jnp.sum(r**2)
            return (
                jnp.where(better, trial, z),
                jnp.where(better, new, r),
                jnp.where(better, jnp.maximum(0.1 * damping, 1e-14), 10 * damping),
            )

        z, r, _ = lax.fori_loop(0, 60, improve, (z, rows(z), jnp.asarray(1e-4)))
        return z[n], jnp.where(useful, largest(r), jnp.inf)

    return jax.vmap(one)(directions, shifts)


def _with_constants(eq: Equations, constants) -> Equations:
    return Equations(
        eq.topology, eq.home, eq.length, tuple(constants), eq.scales, eq.linear, eq.quadratic, eq.markers
    )
