"""The cheapest tolerances that keep outputs within their limits: a convex problem, solved to rounding."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import AssemblyError, InputError
from jaxnc.kinematics.sensitivity import Outputs, Sensitivity, sensitivity
from jaxnc.synthesis.tolerance.spread import by_component, make_question, move_nominal, variable_components
from jaxnc.system.precision import on_host
from jaxnc.system.system import System
from jaxnc.types import Inputs

RULES = ("root sum square", "worst case")


@public
class Cost(NamedTuple):
    """Cost of a tolerance t: a + b / t^power.

    Attributes:
        b: cost times length^power.
        a: cost of not asking for any tolerance.
        power: 1 or 2 usually, any positive number.
    """

    b: float
    a: float = 0.0
    power: float = 1.0

    def __call__(self, t: float) -> float:
        """The cost of a tolerance t, a length."""
        return self.a + self.b / t**self.power


@public
def reciprocal(b: float, a: float = 0.0) -> Cost:
    """Cost a + b/t of a tolerance t (K. W. Chase and W. H. Greenwood, Manufacturing Review 1 (1988) 49-59)."""
    return Cost(b, a, 1.0)


@public
def reciprocal_square(b: float, a: float = 0.0) -> Cost:
    """Cost a + b/t² of a tolerance t (M. F. Spotts, J. Eng. for Industry 95 (1973) 762-764)."""
    return Cost(b, a, 2.0)


@public
@dataclasses.dataclass(frozen=True)
class Allocation:
    """Tolerances of least cost; ``print()`` lists them.

    Attributes:
        name: the mechanism.
        rule: ``"root sum square"`` or ``"worst case"``.
        tolerances: half width by dimension, as `jaxnc.tolerance` takes them; infinite without influence or bound.
        costs: cost of each.
        cost: of all.
        units: unit of each tolerance.
        limits: allowed deviation of each output, and the one reached, over all poses: ``(allowed, reached)``.
        active: the outputs and poses that decide, with their multipliers (cost per part of the limit): ``(output, pose,
            multiplier)``, the largest first.
        residual: of the conditions of optimality (Karush-Kuhn-Tucker), as a part of the cost.
    """

    name: str
    rule: str
    tolerances: Mapping[str, float]
    costs: Mapping[str, float]
    cost: float
    units: Mapping[str, str]
    limits: Mapping[str, tuple[float, float]]
    active: tuple[tuple[str, int, float], ...]
    residual: float

    def __repr__(self) -> str:
        lines = [f"{self.name}: cheapest tolerances, {self.rule}; cost {self.cost:.6g}"]
        for name, t in self.tolerances.items():
            lines.append(f"  {name:<16} ± {t:.6g} {self.units[name]}   cost {self.costs[name]:.4g}")
        for name, (allowed, reached) in self.limits.items():
            lines.append(f"  {name} strays by {reached:.6g} of {allowed:.6g} allowed")
        for name, pose, multiplier in self.active[:4]:
            lines.append(f"  decided by {name} in pose {pose} (multiplier {multiplier:.4g})")
        return "\n".join(lines)


@public
@on_host
def allocate_tolerances(
    system: System | Sensitivity,
    limits: Mapping[str, float],
    costs: Mapping[str, Cost],
    inputs: Inputs | None = None,
    rule: str = "root sum square",
    bounds: Mapping[str, tuple[float, float]] | None = None,
    outputs: Outputs | None = None,
    hold: Sequence[str] = (),
) -> Allocation:
    """Choose tolerances of least cost that keep outputs within limits in every pose, to first order.

    Args:
        system: the nominal design; or a sensitivity that is already known, and then no inputs.
        limits: allowed deviation (half width) by output, ``"P.y"`` or ``"psi"``; a point's name limits each of its
            coordinates.
        costs: a `Cost` by dimension: `reciprocal`, `reciprocal_square`. A point has one tolerance for its coordinates;
            ``"B.x"`` is one of them.
        inputs: value or sequence of values of each driven coordinate.
        rule: ``"root sum square"``: sqrt(Σ (J t)²) ≤ limit, for independent deviations (limit and tolerances being the
            same number of standard deviations); ``"worst case"``: ``Σ |J| t ≤ limit``.
        bounds: finest and coarsest tolerance by dimension.
        outputs: functions of a motion by name, for limits on them.
        hold: free coordinates that keep the value at which the nominal design starts.

    Returns:
        The tolerances; the only optimum there is, as the problem is convex.

    Raises:
        InputError: unknown names, limits or costs that are not positive, bounds that leave nothing, limits that even
            the finest tolerances miss (named, with the smallest limit that works).
        AssemblyError: the nominal design does not assemble in a pose.

    Source: the problem is that of M. F. Spotts (1973) and K. W. Chase and W. H. Greenwood (1988), here with any number
    of limits, by a primal-dual interior-point method (S. Boyd and L. Vandenberghe, Convex Optimization, section 11.7).
    """
    if rule not in RULES:
        raise InputError(f"allocation: rule={rule!r}; use {' or '.join(map(repr, RULES))}")
    for name, cost in costs.items():
        if not isinstance(cost, Cost) or not (cost.b > 0 and cost.power > 0 and math.isfinite(cost.a + cost.b)):
            raise InputError(
                f"allocation: cost of {name!r} must be a Cost with b > 0, such as reciprocal(b); got {cost!r}"
            )
    if not costs or not limits:
        raise InputError("allocation: give costs={'crank.A-B': reciprocal(1.0), …} and limits={'P.y': 0.1, …}")
    for name, value in limits.items():
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"allocation: limit of {name!r} must be positive, got {value!r}")
    if isinstance(system, Sensitivity):
        found = system
    else:
        if inputs is None:
            raise InputError("allocation: give inputs={'phi': ...}, the poses in which the limits hold")
        wanted = outputs if outputs is not None else list(limits)
        parts = [part for name in costs for part in variable_components("allocation", system, name)[0]]
        asked, values = make_question("allocation", system, inputs, wanted, hold)
        found = sensitivity(move_nominal(system, asked, values), wanted, variables=parts)
    if failures := int(np.count_nonzero(~np.asarray(found.converged))):
        raise AssemblyError(
            f"allocation: the nominal design of {found.name!r} does not assemble in {failures} of "
            f"{np.size(found.converged)} poses; leave those out, or see jaxnc.diagnose"
        )
    rows, labels, allowed = _limit_rows(found, limits)
    groups = _dimension_groups(found, costs)
    power = 2.0 if rule == RULES[0] else 1.0
    matrix = np.stack([(np.abs(rows[:, group]) ** power).sum(axis=1) for group in groups.values()], axis=1)
    right = allowed**power
    low, high = _bounds(costs, bounds or {})
    low, high = low**power, high**power
    # 1e-12 of the largest influence is rounding
    matrix = np.where(matrix > (1e-12**power) * matrix.max(initial=0.0), matrix, 0.0)
    exponents = np.array([c.power for c in costs.values()]) / power
    weights = np.array([c.b for c in costs.values()])
    matters = (matrix > 0).any(axis=0)
    x = np.where(matters, 0.0, high)
    multipliers, residual = np.zeros(len(right)), 0.0
    if matters.any():
        at_least = matrix @ np.where(matters, low, 0.0)
        if (at_least >= right).any():
            k = int(np.argmax(at_least / right))
            raise InputError(
                f"allocation: even with the finest tolerances {labels[k][0]} strays by "
                f"{at_least[k] ** (1 / power):.6g} in pose {labels[k][1]}, the limit is {allowed[k]:.6g}; widen the "
                f"limit or allow finer tolerances"
            )
        x[matters], multipliers, residual = _minimise_cost(
            matrix[:, matters], right, weights[matters], exponents[matters], low[matters], high[matters]
        )
    with np.errstate(divide="ignore"):
        t = x ** (1.0 / power)
    tolerances = dict(zip(costs, map(float, t), strict=True))
    prices = {
        name: (cost(tolerances[name]) if math.isfinite(tolerances[name]) else cost.a) for name, cost in costs.items()
    }
    reached = (matrix @ np.where(matters, x, 0.0)) ** (1.0 / power)
    order = [
        int(k) for k in np.argsort(-multipliers * right) if multipliers[k] * right[k] > 1e-6 * sum(prices.values())
    ]
    return Allocation(
        name=found.name,
        rule=rule,
        tolerances=tolerances,
        costs=prices,
        cost=sum(prices.values()),
        units={name: found.variable_units[group[0]] for name, group in groups.items()},
        limits={
            name: (float(value), float(max(r for r, lab in zip(reached, labels, strict=True) if lab[2] == name)))
            for name, value in limits.items()
        },
        active=tuple((labels[k][0], labels[k][1], float(multipliers[k] * right[k])) for k in order),
        residual=residual,
    )


def _limit_rows(
    found: Sensitivity, limits: Mapping[str, float]
) -> tuple[np.ndarray, list[tuple[str, int, str]], np.ndarray]:
    """Derivatives of every limited output in every pose, who they are, and what is allowed."""
    lead = found.converged.shape
    rows, labels, allowed = [], [], []
    for limit, value in limits.items():
        met: set[str] = set()  # a point, and a coordinate of it, may both be outputs
        for name, jacobian in found.derivatives.items():
            for label, index in by_component(name, found.values[name], lead).items():
                if limit not in (name, label) or label in met:
                    continue
                met.add(label)
                for k, row in enumerate(jacobian[(..., *index, slice(None))].reshape(-1, len(found.variables))):
                    rows.append(row)
                    labels.append((label, k, limit))
                    allowed.append(value)
        if not met:
            raise InputError(
                f"allocation: limit of {limit!r}, which is no output; outputs are {', '.join(found.values)}"
            )
    return np.array(rows), labels, np.array(allowed, float)


def _dimension_groups(found: Sensitivity, costs: Mapping[str, Cost]) -> dict[str, list[int]]:
    """Places of each dimension's components among the sensitivity's variables."""
    groups: dict[str, list[int]] = {}
    taken: dict[int, str] = {}
    for name in costs:
        groups[name] = [k for k, v in enumerate(found.variables) if v in (name, *(f"{name}.{axis}" for axis in "xyz"))]
        if not groups[name]:
            raise InputError(f"allocation: cost of {name!r}, which is no variable of the sensitivity; variables are "
                             f"{', '.join(found.variables)}")  # fmt: skip
        for k in groups[name]:
            if k in taken:
                raise InputError(f"allocation: {found.variables[k]!r} has a cost under {taken[k]!r} and {name!r}")
            taken[k] = name
    return groups


def _bounds(costs: Mapping[str, Cost], bounds: Mapping[str, tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    for name, (finest, coarsest) in bounds.items():
        if name not in costs:
            raise InputError(f"allocation: bounds of {name!r}, which has no cost; dimensions are {', '.join(costs)}")
        if not 0 <= finest < coarsest:
            raise InputError(f"allocation: bounds of {name!r} must be (finest, coarsest), increasing, got "
                             f"{bounds[name]!r}")  # fmt: skip
    low, high = np.array([bounds.get(name, (0.0, np.inf)) for name in costs], float).T
    return low, high


def _minimise_cost(matrix, right, weights, exponents, low, high) -> tuple[np.ndarray, np.ndarray, float]:
    """Minimise Σ w x^-m with M x ≤ r, low ≤ x ≤ high: x, multipliers of M x ≤ r, residual of optimality."""
    alone = np.where(matrix > 0, right[:, None] / np.where(matrix > 0, matrix, 1.0), np.inf)
    scale = np.minimum(alone.min(axis=0), high)
    w = weights * scale**-exponents
    price = w.sum()
    w = w / price
    n = len(w)
    finite = np.isfinite(high)
    eye = np.eye(n)
    g = np.concatenate([matrix * scale / right[:, None], -eye, eye[finite]])
    h = np.concatenate([np.ones(len(right)), -low / scale, (high / scale)[finite]])
    # Strictly inside: part of the way from the finest tolerances to the coarsest.
    room = 0.5 * np.min((1.0 - g[: len(right)] @ (low / scale)) / np.maximum(g[: len(right)].sum(axis=1), 1e-300))
    x = low / scale + np.minimum(room, 0.5 * (np.where(finite, high, np.inf) - low) / scale)
    s = h - g @ x
    y = 1.0 / s
    y /= (s @ y) / max(1.0, float(w @ x**-exponents))
    best, since = (math.inf, x, y), 0
    for _ in range(200):
        slope = -w * exponents * x ** (-exponents - 1.0)
        curve = w * exponents * (exponents + 1.0) * x ** (-exponents - 2.0)
        gap = float(s @ y)
        residual = max(gap, float(np.abs((slope + g.T @ y) * x).max()))
        best, since = ((residual, x, y), 0) if residual < best[0] else (best, since + 1)
        if residual < 1e-13 or since > 5:  # of the cost; beyond rounding nothing improves
            break
        aim = 0.1 * gap / len(h)
        hessian = np.diag(curve) + (g.T * (y / s)) @ g
        try:
            dx = np.linalg.solve(hessian, -(slope + g.T @ (aim / s)))
        except np.linalg.LinAlgError:  # slacks are rounding: the best point is as good as numbers allow
            break
        dy = (aim - y * s + y * (g @ dx)) / s
        step = 1.0
        for value, change in ((s, -(g @ dx)), (y, dy), (x, dx)):
            down = change < 0
            if down.any():
                step = min(step, 0.99 * float(np.min(-value[down] / change[down])))
        x, y = x + step * dx, y + step * dy
        s = s - step * (g @ dx)  # carried along: h - g x would be rounding where a limit is reached
    residual, x, y = best
    return x * scale, y[: len(right)] * price / right, residual
