"""A problem around another one: the same mechanism, and unknowns or arguments more behind its own."""

import copy
import dataclasses
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from jaxnc.synthesis.conditions import Condition
from jaxnc.synthesis.problem import Evaluation, Extras, Problem
from jaxnc.types import Array

_P = TypeVar("_P", bound=Problem)


@dataclasses.dataclass(frozen=True, eq=False, init=False)
class Wrapped(Problem):
    """A problem with unknowns and arguments behind those of another one; `evaluate` says what it does with them."""

    inner: Problem  # the problem inside
    more: Extras  # the unknowns behind its own
    own_defaults: np.ndarray  # the arguments behind its own, as a search begins with them

    def wrap(self, inner: Problem, more: Extras, defaults: np.ndarray) -> None:
        """Take over what `inner` has."""
        for field in dataclasses.fields(Problem):
            object.__setattr__(self, field.name, getattr(inner, field.name))
        for name, value in {"inner": inner, "more": more, "own_defaults": defaults}.items():
            object.__setattr__(self, name, value)

    @property
    def count(self) -> int:
        return self.inner.count + len(self.more.names)

    @property
    def names(self) -> tuple[str, ...]:
        return (*self.inner.names, *self.more.names)

    @property
    def start(self) -> np.ndarray:
        return np.concatenate([self.inner.start, self.more.home])

    @property
    def low(self) -> np.ndarray:
        return np.concatenate([self.inner.low, self.more.low])

    @property
    def high(self) -> np.ndarray:
        return np.concatenate([self.inner.high, self.more.high])

    @property
    def defaults(self) -> np.ndarray:
        return np.concatenate([self.inner.defaults, self.own_defaults])

    @property
    def arguments(self) -> int:
        return self.inner.arguments + len(self.own_defaults)

    def inside(self, x: Array, moves: Any, given: Any) -> tuple[Evaluation, Any]:
        """What the problem inside sees, and the arguments behind its own; those of `defaults` if none are given."""
        given = given if len(given) else self.defaults
        first = self.inner.arguments
        return self.inner.evaluate(x[: self.inner.count], moves, given[:first]), given[first:]

    @property
    def scale(self) -> np.ndarray:
        return np.append(self.inner.scale, np.ones(len(self.more.names)))

    def fitted(self, x: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        new, left = self.inner.fitted(x[:, : self.inner.count], errors)
        return np.concatenate([new, x[:, self.inner.count :]], axis=1), left

    @property
    def core(self) -> Problem:
        return self.inner.core

    @property
    def shape(self) -> tuple[int, int]:
        return self.inner.shape

    @property
    def equalities(self) -> np.ndarray:
        """Those of the problem inside; conditions behind them are inequalities."""
        inner = self.inner.equalities
        return np.append(inner, np.zeros(self.shape[1] - len(inner), dtype=bool))


def with_conditions(problem: _P, conditions: Sequence[Condition]) -> _P:
    """The same problem with other conditions, which are prepared already."""
    out = copy.copy(problem)
    object.__setattr__(out, "conditions", tuple(conditions))
    return out
