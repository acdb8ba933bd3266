"""Whether SciPy makes a design better that a search has returned: on the same errors, conditions and bounds."""

from typing import Any, NamedTuple

import numpy as np
import scipy.optimize

from jaxnc.synthesis.evaluate import Evaluator
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.search.goal import Goal

_MEETS = 1e-10  # violation of a condition that a better design may have
_FAR = 1e6  # times the error: what a design costs that does not reach its targets


class Polished(NamedTuple):
    """What came of a design.

    Attributes:
        before: its error, a sum of squares.
        after: the least error of a design that meets the conditions.
        evaluations: how many it took.
    """

    before: float
    after: float
    evaluations: int

    @property
    def gain(self) -> float:
        """The part of the error that was taken away."""
        return (self.before - self.after) / self.before if self.before > 0.0 else 0.0


def polished(problem: Problem, x: np.ndarray, method: str = "SLSQP", most: int = 500) -> Polished:
    """Polish a design of a problem of least squares.

    Args:
        problem: the problem.
        x: unknowns of the design.
        method: ``"SLSQP"``, with conditions and bounds, or ``"least_squares"``, with bounds alone: then conditions that
            the design just meets are errors of a large weight.
        most: iterations.
    """
    look = _Look(problem, x)
    y = x / problem.scale
    low, high = problem.low / problem.scale, problem.high / problem.scale
    with np.errstate(all="ignore"):
        if method == "SLSQP":
            equal = problem.equalities
            rules: list[dict[str, Any]] = [
                {"type": kind, "fun": lambda y, k=k: look(y)[1][k], "jac": lambda y, k=k: look(y)[3][k]}
                for kind, k in (("ineq", ~equal), ("eq", equal))
                if k.any()
            ]
            scipy.optimize.minimize(
                look.square,
                y,
                jac=True,
                bounds=list(zip(low, high, strict=True)),
                constraints=rules,
                method="SLSQP",
                options={"ftol": 1e-14, "maxiter": most},
            )
        else:
            inside = [np.where(np.isfinite(b), b + way * 1e-15 * np.abs(b), b) for b, way in ((low, 1.0), (high, -1.0))]
            y = np.clip(y, *inside)
            tight = {"ftol": 1e-14, "xtol": 1e-14, "gtol": 1e-14}
            scipy.optimize.least_squares(look.rows, y, look.slopes, (low, high), max_nfev=most, **tight)  # pyright: ignore
    return Polished(look.before, look.best, look.count)


class _Look:
    """The problem as SciPy wants it, and the best design that it has asked for."""

    def __init__(self, problem: Problem, x: np.ndarray):
        self.problem, self.evaluate, self.m = problem, Evaluator(Goal(problem)), problem.shape[0]
        self.count, self.last, self.seen = 0, b"", None
        self.best = self.before = np.inf
        errors, conditions, *_ = self(x / problem.scale)
        self.before = self.best = float(errors @ errors)
        self.tight = problem.equalities | (conditions <= 1e-9)
        self.norm = max(self.before, 1e-300)

    def __call__(self, y: np.ndarray) -> Any:
        if y.tobytes() != self.last:
            problem, scale = self.problem, self.problem.scale
            given = np.zeros((1, 0))
            found = self.evaluate(y[None] * scale, given, way="close")
            errors, conditions, slopes, ok = (part[0] for part in found)
            self.last, self.seen = y.tobytes(), (errors, conditions, slopes[: self.m], slopes[self.m :], bool(ok))
            self.count += 1
            missed = np.where(problem.equalities, np.abs(conditions), -conditions)
            inside = np.all(y * scale >= problem.low) and np.all(y * scale <= problem.high)
            if ok and inside and np.max(missed, initial=0.0) <= _MEETS and np.isfinite(errors).all():
                self.best = min(self.best, float(errors @ errors))
        return self.seen

    def square(self, y: np.ndarray) -> tuple[float, np.ndarray]:
        errors, _, slopes, _, ok = self(y)
        if not ok:
            return _FAR, np.zeros(len(y))
        return float(errors @ errors) / self.norm, 2.0 * errors @ slopes / self.norm

    def rows(self, y: np.ndarray) -> np.ndarray:
        errors, conditions, *_, ok = self(y)
        return (
            np.concatenate([errors, _FAR * conditions[self.tight]]) if ok else np.full(self.m + self.tight.sum(), 1e3)
        )

    def slopes(self, y: np.ndarray) -> np.ndarray:
        _, _, slopes, others, _ = self(y)
        return np.concatenate([slopes, _FAR * others[self.tight]])
