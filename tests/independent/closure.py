"""Closing loops in joint angles: one angle in closed form, several by Newton's method, and gradients by differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .jets import Jet, across, angle_about, atan2, cross, dot, jet, sqrt, turned

STEP = 0.1  # rad, or a share of the travel: the longest stride of a walk from the drawn pose
ITERATIONS = 30
ROUNDING = 1e-12  # residuals of order one are this small before they are taken for rounding


def hardpoints(default: dict, given: dict | None) -> dict:
    """Default hardpoints with those given put in their place; directions, whose names begin with v, made unit."""
    unknown = set(given or {}) - set(default)
    if unknown:
        raise KeyError(f"no such hardpoint: {sorted(unknown)}; there are {sorted(default)}")
    merged = {name: np.asarray(value, float) for name, value in (default | (given or {})).items()}
    return {n: p / np.linalg.norm(p, axis=-1, keepdims=True) if n[0] == "v" else p for n, p in merged.items()}


def solved_angle(a, b, c, side) -> Jet:
    """Angle ψ with a cos ψ + b sin ψ = c, all of shape (…); nan where there is none.

    Args:
        a: Coefficient of the cosine.
        b: Coefficient of the sine.
        c: Right-hand side.
        side: ±1, the sign of ψ − atan2(b, a): one value on each branch, for it changes only at a dead point.
    """
    a, b, c = jet(a), jet(b), jet(c)
    return atan2(b, a) + side * atan2(sqrt(a * a + b * b - c * c), c)


def swing(pivot, axis, drawn, target, length) -> tuple[Jet, Jet, Jet]:
    """Coefficients of the angle by which a point turns about an axis to lie at a distance from a target.

    With r the drawn arm across the axis, t = axis × r and w = target − centre of the circle, the distance is
    |w|² + |r|² − 2 (w·r cos ψ + w·t sin ψ) = length²: the equation of the RSSR linkage, of a wishbone, of a tie rod.

    Args:
        pivot: Point of the axis, (…, 3).
        axis: Unit axis, (…, 3).
        drawn: The point at ψ = 0, (…, 3).
        target: Where the rod's other end is, (…, 3).
        length: Length of the rod, (…).

    Returns:
        The coefficients (a, b, c) of `solved_angle`.
    """
    arm = jet(drawn) - pivot
    r = across(arm, axis)
    w = target - (pivot + (arm - r))
    return dot(w, r), dot(w, cross(axis, r)), (dot(w, w) + dot(r, r) - length * jet(length)) * 0.5


def drawn_side(coefficients) -> np.ndarray:
    """Branch of `solved_angle` that holds the drawn pose ψ = 0: the sign of −∂/∂ψ there."""
    return -np.sign(coefficients[1].x)


def linearised(residual: Callable, x: np.ndarray, u: Jet) -> tuple[np.ndarray, np.ndarray]:
    """Residual F and the inverse of ∂F/∂x, (…, n, m), its columns found by seeding unit velocities."""
    n = x.shape[-1]
    seeds = np.eye(n).reshape(n, *(1,) * (x.ndim - 1), n)  # leading: the other axes stay aligned
    seeded = residual(Jet(np.broadcast_to(x, (n, *x.shape)), np.broadcast_to(seeds, (n, *x.shape))), Jet(u.x))
    jacobian = np.moveaxis(seeded.v, 0, -1)
    square = jacobian.shape[-1] == jacobian.shape[-2]
    return seeded.x[0], np.linalg.inv(jacobian) if square else np.linalg.pinv(jacobian)


def newton(residual: Callable, x: np.ndarray, u: Jet, enough: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Roots of a residual.

    Args:
        residual: Of jets x (…, n) and u (…, k), a jet (…, m), m ≥ n; redundant equations in the least squares.
        x: First guess, (…, n).
        u: Inputs.
        enough: Residual to stop at; by default where rounding leaves no further digit.

    Returns:
        Unknowns, (…, n), and the inverse Jacobian there.
    """
    best, size = (x, None), np.inf
    for _ in range(ITERATIONS):
        f, inverse = linearised(residual, x, u)
        worst = np.max(np.abs(f), initial=0.0)
        stalled = worst >= size and size < ROUNDING
        if worst < size:
            best, size = (x, inverse), worst
        if worst <= enough or stalled:
            return best
        x = x - applied(inverse, f)
    raise ArithmeticError(f"the loop does not close: residual {size:.1e}")


def applied(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Matrix times vector, pose by pose."""
    return np.einsum("...ij,...j->...i", matrix, vector)


def implicit(residual: Callable, home, u: Jet, drawn) -> Jet:
    """Unknowns as functions of the inputs, on the branch continuous with the drawn pose.

    Every pose is reached along the straight line of inputs from the drawn pose. The velocity and acceleration
    equations J ẋ = −∂F/∂t and J ẍ = −(d²F/dt² at ẍ = 0) are linear, and share the Jacobian of the last pose.

    Args:
        residual: As in `newton`; to be of order one, so that its rounding is known.
        home: Unknowns in the drawn pose, or close to them, (n,).
        u: Inputs, (…, k).
        drawn: Inputs of the drawn pose, (k,).

    Returns:
        Unknowns, (…, n).
    """
    drawn = np.asarray(drawn, float)
    steps = max(1, int(np.ceil(np.max(np.abs(u.x - drawn), initial=0.0) / STEP)))
    home = np.asarray(home, float)
    x = np.broadcast_to(home, (*residual(Jet(home), u).shape[:-1], len(home)))  # hardpoints may add axes of their own
    for step in range(steps + 1):
        here = Jet(drawn + (step / steps) * (u.x - drawn), (u.x - drawn) / steps)
        x, inverse = newton(residual, x, here, 0.0 if step == steps else 1e-7)
        if step < steps:
            x = x - applied(inverse, residual(Jet(x), here).v)
    v = -applied(inverse, residual(Jet(x), u).v)
    a = -applied(inverse, residual(Jet(x, v), u).a)
    return Jet(x, v, a)


def input_jet(value, rate=1.0, acceleration=0.0) -> Jet:
    """An input, its rate and its acceleration; a jet stays as it is."""
    return value if isinstance(value, Jet) else Jet(value, rate, acceleration)


def revolved(pivot, axis, drawn, angle) -> Jet:
    """Point of a body turned about an axis through a pivot, (…, 3)."""
    return pivot + turned(jet(drawn) - pivot, axis, angle)


def crank_angle(phi: Jet, axis, drawn, zero) -> Jet:
    """Rotation from the drawn pose of a crank whose angle is measured from `zero`; from the drawn pose itself if None.

    Args:
        phi: Input angle, (…).
        axis: Unit axis of the crank, (3,).
        drawn: Drawn direction of the crank, (3,).
        zero: Direction of φ = 0, (3,), or None.
    """
    return phi if zero is None else phi - angle_about(axis, np.asarray(zero, float), drawn).x


_WEIGHTS = ((1, 3.0 / 4.0), (2, -3.0 / 20.0), (3, 1.0 / 60.0))  # central differences of the sixth order


def hardpoint_gradient(f: Callable[[dict], np.ndarray], points: dict, step: float = 5e-4) -> dict:
    """Derivatives of an output with respect to the hardpoints, by central differences of the sixth order.

    Truncation is (step / ρ)⁶ with ρ the relative distance to the nearest dead point, rounding 2e-16 / step; a step
    of 5e-4 keeps both under 1e-11 of the size of the gradient unless a dead point is within 3 % of the size.

    Args:
        f: Output as a function of the hardpoints. It is called once, with hardpoints of shape (K, 1, 3), dimensions
            (K, 1), all varied, and returns (K, N, …): N poses, or 1 where it does not depend on a row of inputs.
        points: Hardpoints by name, each (3,), or a dimension, ().
        step: Share of the mechanism's size; of unity for directions, whose names begin with v.

    Returns:
        By name, derivatives of shape (N, …, 3), or (N, …) for a dimension.
    """
    points = {name: np.asarray(value, float) for name, value in points.items()}
    located = [p for n, p in points.items() if n[0] != "v" and p.ndim]
    size = np.max(np.ptp(located, axis=0)) if located else 1.0
    rows, where = {}, {}
    for name, value in points.items():
        h = step * (np.abs(value) if not value.ndim else 1.0 if name[0] == "v" else size)
        rows[name] = h * (np.eye(3) if value.ndim else np.ones(1))
        where[name] = sum(len(r) for n, r in rows.items() if n != name)
    total = sum(len(r) for r in rows.values())
    varied = {}
    for name, value in points.items():
        offsets = np.zeros((2, 3, total, *value.shape))
        for i, (k, _) in enumerate(_WEIGHTS):
            block = slice(where[name], where[name] + len(rows[name]))
            offsets[0, i, block], offsets[1, i, block] = k * rows[name], -k * rows[name]
        varied[name] = (value + offsets).reshape(6 * total, 1, *value.shape)
    out = np.asarray(f(varied))
    if len(out) != 6 * total:  # no hardpoint enters
        out = np.broadcast_to(out, (6 * total, *np.shape(out)[-1:]))
    out = out.reshape(2, 3, total, *out.shape[1:])
    slopes = sum(w * (out[0, i] - out[1, i]) for i, (_, w) in enumerate(_WEIGHTS))
    gradient = {}
    for name, value in points.items():
        h = np.max(rows[name])
        columns = slopes[where[name] : where[name] + len(rows[name])] / h
        gradient[name] = np.moveaxis(columns, 0, -1) if value.ndim else columns[0]
    return gradient
