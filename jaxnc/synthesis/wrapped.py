"""A problem around another one: the same mechanism, a few unknowns more behind its own."""

import copy
import dataclasses
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from jaxnc.kinematics.motion import Motion
from jaxnc.synthesis.conditions import Condition
from jaxnc.synthesis.leaves import shapes
from jaxnc.synthesis.problem import Extras, Look, Problem
from jaxnc.types import Array

_P = TypeVar("_P", bound=Problem)


@dataclasses.dataclass(frozen=True, eq=False, init=False)
class Wrapped(Problem):
    """A problem with unknowns of its own behind those of another one; what it does with them is said in `look`.

    Attributes:
        inner: the problem inside.
        more: the unknowns behind its own.
        fixed: whether each of them keeps in each lane the value it starts with.
    """

    inner: Problem
    more: Extras
    fixed: tuple[bool, ...]

    def wrap(self, inner: Problem, more: Extras, fixed: tuple[bool, ...]) -> None:
        """Take over what `inner` has."""
        for field in dataclasses.fields(Problem):
            object.__setattr__(self, field.name, getattr(inner, field.name))
        for name, value in {"inner": inner, "more": more, "fixed": fixed}.items():
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
    def pinned(self) -> np.ndarray:
        return np.append(self.inner.pinned, np.array(self.fixed, dtype=bool))

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
        look = shapes(_looked, self, self.start, self.core.still)
        return look.errors.shape[0], look.conditions.shape[0]

    @property
    def equalities(self) -> np.ndarray:
        """Those of the problem inside; conditions behind them are inequalities."""
        inner = self.inner.equalities
        return np.append(inner, np.zeros(self.shape[1] - len(inner), dtype=bool))


def _looked(problem: Problem, x: Array, moves: tuple[Motion, Motion | None]) -> Look:
    return problem.look(x, moves)


def with_conditions(problem: _P, conditions: Sequence[Condition]) -> _P:
    """The same problem with other conditions, which are prepared already."""
    out = copy.copy(problem)
    object.__setattr__(out, "conditions", tuple(conditions))
    return out
