"""Any objective of a motion: whatever a differentiable function returns is made small."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxnc.asking import function_name, numbers
from jaxnc.calls import public
from jaxnc.compiling import jit
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.synthesis import given
from jaxnc.synthesis.conditions import Condition
from jaxnc.synthesis.moved import moved
from jaxnc.synthesis.problem import Extras, Problem
from jaxnc.synthesis.statement import set_up, state, turn_of
from jaxnc.system.system import System
from jaxnc.types import Array


@public
@dataclasses.dataclass(frozen=True, eq=False, init=False, repr=False)
class Objective(Problem):
    """Residuals of a motion, to be made small.

    Attributes:
        residuals: functions of a motion.
        values: of the input.
    """

    by_target = ()
    residuals: tuple[Callable[[Motion], Any], ...]
    values: np.ndarray

    def __init__(
        self,
        mechanism: Mechanism | System,
        residuals: Callable[[Motion], Any] | Sequence[Callable[[Motion], Any]],
        values: Any,
        weights: Sequence[float] | None = None,
        input: str | None = None,
        free: Sequence[str] | None = None,
        bounds: Mapping[str, Any] | None = None,
        subject_to: Sequence[Condition] = (),
        hold: Sequence[str] = (),
        minimax: bool = False,
    ):
        """State the problem.

        Args:
            mechanism: the starting idea, as a `Mechanism` or compiled.
            residuals: a function of the motion over `values` that returns an array; the sum of its squares is made
                small. Several functions are several objectives, weighted.
            values: of the input, in the order in which they are gone through, ``(T,)``.
            weights: of the squares of each function; ones if not given.
            input: name of the driven coordinate; may be left out where the mechanism has one only.
            free: names of what may change; all if not given.
            bounds: as in `PathGeneration`.
            subject_to: conditions; those over a range look at the range of `values`.
            hold: free coordinates that keep their start values.
            minimax: make the largest number small rather than the sum of squares.

        Raises:
            InputError: unknown names, a function that returns nothing finite for the starting idea.
        """
        what = "Objective"
        values = numbers(values, f"{what}: values")
        if not values.size:
            raise InputError(f"{what}: values is empty; give those of the input at which the residuals are taken")
        table = given.sequence(values, values.size, f"{what}: values")
        functions = (residuals,) if callable(residuals) else tuple(residuals if np.iterable(residuals) else ())
        if not functions or not all(callable(f) for f in functions):
            raise InputError(f"{what}: residuals must be a function of a motion, or several, got {residuals!r}")
        share = given.weights(weights, len(functions), what)
        parts = set_up(what, mechanism, input, free, bounds, subject_to, hold, None, table)
        given.radians(table, f"{what}: values", turn_of(parts, False), "state one turn, which the others repeat")
        own = {
            **parts,
            "extras": Extras.none(),
            "size": 1.0,
            "minimax": minimax,
            "dense": given.rising(table),
            "residuals": functions,
            "weights": tuple(share.tolist()),
            "values": table,
        }
        state(self, own)
        found = _errors(self, moved(self, [self.start])[0].motion)
        if not found.size:
            raise InputError(f"{what}: the residuals are arrays of no numbers, and there is nothing to make small")
        if not np.isfinite(np.asarray(found)).all():
            raise InputError(f"{what}: the residuals of the starting idea are not finite")

    @property
    def unit(self) -> str:
        return ""

    def inputs(self, extra: Any) -> Any:
        return self.values

    def misses(self, motion: Motion, extra: Array) -> Array:
        return jnp.concatenate([_numbers(f, motion) for f in self.residuals])

    def errors(self, motion: Motion, extra: Array) -> Array:
        return jnp.concatenate(self.pieces(motion))

    def pieces(self, motion: Motion) -> list[Array]:
        """The errors of each function, weighted."""
        return [_numbers(f, motion) * jnp.sqrt(w) for f, w in zip(self.residuals, self.weights, strict=True)]


def _numbers(residual: Callable[[Motion], Any], motion: Motion) -> Array:
    return jnp.ravel(given.numbers(residual, f"Objective: residual {function_name(residual)}", motion))


@jit
def _errors(problem: Objective, motion: Motion) -> Array:
    return problem.errors(motion, jnp.zeros(0))
