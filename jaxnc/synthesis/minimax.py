"""The least largest error: one unknown more, a height that no error exceeds."""

import dataclasses
import functools
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxnc.synthesis.problem import Extras, Look, Problem
from jaxnc.synthesis.wrapped import Wrapped
from jaxnc.types import Array


@dataclasses.dataclass(frozen=True, eq=False, init=False)
class Minimax(Wrapped):
    """A problem with the height above all errors as its last unknown, and its square as what is made small.

    Attributes:
        parts: numbers that make up one error (coordinates of a point).
    """

    parts: int

    @classmethod
    @functools.lru_cache(maxsize=8)
    def of(cls, inner: Problem) -> "Minimax":
        """Make it from a problem: the same one again for the same problem, so that it is compiled once."""
        out = object.__new__(cls)
        out.wrap(inner, Extras(("height",), np.ones(1), np.zeros(1), np.full(1, np.inf)), fixed=False)
        motion = inner.move(inner.start)
        errors = np.asarray(inner.errors(motion, inner.split(jnp.asarray(inner.start))[1]))
        object.__setattr__(out, "parts", errors.size // len(errors))
        return out

    def _sizes(self, errors: Array) -> Array:
        each = errors.reshape(-1, self.parts)
        return jnp.sqrt(jnp.sum(each * each, axis=1) + 1e-30)

    def height(self, x: Any) -> float:
        """The largest error of a vector of unknowns."""
        return float(jnp.max(self._sizes(self.inner.look(jnp.asarray(x)).errors)))

    def look(self, x: Array) -> Look:
        inner, height = self.inner.look(x[:-1]), x[-1]
        if self.parts == 1:
            above = jnp.concatenate([height - inner.errors, height + inner.errors])
        else:
            above = height - self._sizes(inner.errors)
        return Look(height[None], jnp.concatenate([inner.conditions, above]), inner.ok)
