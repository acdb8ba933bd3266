"""The single dimension whose smallest change closes a mechanism that does not assemble."""

from dataclasses import dataclass

import numpy as np

from jaxnc import constraints as kinds
from jaxnc.calls import public
from jaxnc.solvers.host import HostView
from jaxnc.solvers.host.matrices import least_squares
from jaxnc.system.host import Expansion, HostEquations, Slot
from jaxnc.system.topology import Topology

PARTS = tuple((k + 1) / 24 for k in range(24))  # steps by which inputs go beyond their reach, and a gap is closed
_LENGTHS = ("length", "radius")  # constants whose change is offered
_NEWTON = 5  # iterations after each step


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


def remedies(top: Topology, view: HostView, q: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> tuple[Remedy, ...]:
    """Single changes of a length or of a ground coordinate that just close a mechanism, the smallest first."""
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
        if rest <= 1e-9 * length and sensible and (isinstance(slot, int) or value + change > 0):
            found.append(Remedy(name, value, float(change)))
    # Equal ones, as of two points of the ground, stay in their order whatever rounding says.
    return tuple(sorted(found, key=lambda r: float(f"{abs(r.change):.9g}")))


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
                out.append((f"{constant} {where} of {top.called(*owners)}", value, (b, i, k)))
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
    for share in 1.0 - np.array(PARTS):
        for _ in range(_NEWTON):
            dz = _steps(*equations(z, share), 1e3)
            z = z - unit * dz
            if np.max(np.abs(dz[:, : n + 1])) <= 1e-13:
                break
    change[useful], rest[useful] = z[:, n], length * np.max(np.abs(equations(z, 0.0)[0]), axis=1)
    return change, rest


def _steps(right: np.ndarray, matrix: np.ndarray, most: float) -> np.ndarray:
    """Newton's steps ``(lanes, k)``; hardly damped where redundant rows leave the multipliers undetermined."""
    step = least_squares(matrix, right[:, :, None])[:, :, 0]
    wild = ~(np.max(np.abs(step), axis=1) < most)
    if wild.any():
        matrix, back = matrix[wild], np.swapaxes(matrix[wild], 1, 2)
        normal, size = back @ matrix, matrix.shape[2]
        weight = 1e-12 * np.trace(normal, axis1=1, axis2=2) / size + 1e-300
        step[wild] = least_squares(normal + weight[:, None, None] * np.eye(size), back @ right[wild, :, None])[:, :, 0]
    return np.where(np.isfinite(step).all(axis=1, keepdims=True), step, 0.0)
