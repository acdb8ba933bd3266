"""The least largest error: one unknown more, a height that no error exceeds.

An argument tells whether that height counts or the sum of squares, from which a search begins: what both need is
compiled once.
"""

import dataclasses
import math
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxnc.synthesis.problem import Evaluation, Extras, Problem
from jaxnc.synthesis.wrapped import Wrapped
from jaxnc.types import Array


@dataclasses.dataclass(frozen=True, eq=False, init=False)
class Minimax(Wrapped):
    """A problem with a height above all errors as its last unknown; its argument: whether that square is made small."""

    parts: int  # numbers that make up one error (coordinates of a point)

    @classmethod
    def of(cls, inner: Problem) -> "Minimax":
        """Make it from a problem."""
        out = object.__new__(cls)
        out.wrap(inner, Extras(("height",), np.ones(1), np.zeros(1), np.full(1, np.inf)), np.zeros(1))
        object.__setattr__(out, "parts", math.prod(inner.core.error_shape[1:]))
        return out

    def _sizes(self, errors: Array) -> Array:
        each = errors.reshape(-1, self.parts)
        return jnp.sqrt(jnp.sum(each * each, axis=1) + 1e-30)

    def fitted(self, x: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        new, left = self.inner.fitted(x[:, :-1], errors[:, :-1])
        return np.concatenate([new, x[:, -1:]], axis=1), np.concatenate([left, errors[:, -1:]], axis=1)

    @property
    def shape(self) -> tuple[int, int]:
        errors, conditions = self.inner.shape
        return errors + 1, conditions + (2 * errors if self.parts == 1 else errors // self.parts)

    def evaluate(self, x: Array, moves: Any = None, given: Any = ()) -> Evaluation:
        (inner, (levelled,)), height = self.inside(x, moves, given), x[-1]
        if self.parts == 1:
            above = jnp.concatenate([height - inner.errors, height + inner.errors])
        else:
            above = height - self._sizes(inner.errors)
        above = jnp.where(levelled > 0.0, above, 1.0)
        errors = jnp.append((1.0 - levelled) * inner.errors, levelled * height)
        return Evaluation(errors, jnp.concatenate([inner.conditions, above]), inner.ok)
