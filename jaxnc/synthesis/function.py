"""Function generation: an output of a mechanism follows its input as a function says."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.synthesis.conditions import Condition
from jaxnc.synthesis.problem import Extras, Problem, repeat_drawing
from jaxnc.synthesis.pytree import shapes
from jaxnc.synthesis.statement import complete, set_up
from jaxnc.synthesis.validate import as_sequence, as_weights, call_on_motion, check_radians
from jaxnc.system.system import System
from jaxnc.types import Array, ArrayLike, Numbers
from jaxnc.validate import as_array
from jaxnc.vehicle.suspension import ATTITUDE, NUMBERS, suspension


def _read_attitude(motion: Motion, name: str) -> Array:
    return getattr(suspension(motion), name)


@functools.cache
def _attitude_reader(name: str) -> Callable[[Motion], Array]:
    """Return one function for each name, so that what is traced of it is found again."""
    return functools.partial(_read_attitude, name=name)


def _is_angle(system: System, output: object) -> bool:
    """Tell whether an output is an angle that is the same a turn further on."""
    top = system.topology
    return isinstance(output, str) and output in top.scalars and bool(top.periodic[top.scalars.index(output)])


@public
@dataclasses.dataclass(frozen=True, eq=False, init=False, repr=False)
class FunctionGeneration(Problem):
    """An output follows the input as a table says.

    Attributes:
        output: name of a coordinate or of a number of a `Suspension`, or a function of a motion, ``(T,)``.
        values: of the input, ``(M,)``.
        target: of the output, ``(M,)``.
        input_offset: whether the input counts from a value that is free.
        output_offset: whether the output does.
        jumps: whether the output is an angle that goes on by more than half a turn somewhere in the table.
    """

    by_target = ("target", "weights")
    longest = 10.0  # ratios of lengths alone count, and the best of them may be far from 1
    output: str | Callable[[Motion], Any]
    values: np.ndarray
    target: np.ndarray
    input_offset: bool
    output_offset: bool
    jumps: bool

    def __init__(
        self,
        mechanism: Mechanism | System,
        output: str | Callable[[Motion], ArrayLike],
        values: ArrayLike,
        target: ArrayLike,
        input: str | None = None,
        free: Sequence[str] | None = None,
        bounds: Mapping[str, Sequence[float | None]] | None = None,
        subject_to: Sequence[Condition] = (),
        hold: Sequence[str] = (),
        input_offset: bool = False,
        output_offset: bool = False,
        weights: ArrayLike | None = None,
        minimax: bool = False,
    ):
        """State the problem.

        Args:
            mechanism: the starting idea, as a `Mechanism` or compiled.
            output: name of an angle, a distance or a coordinate such as ``"P.y"``; of a suspension with the usual
                names also ``"toe"``, ``"camber"`` or another number of a `Suspension`; or a function of a motion that
                returns one number for each pose.
            values: of the input, radians or lengths, in the order in which they are gone through, ``(M,)``: a dense
                table for a least-squares or minimax fit, or precision points (`chebyshev_points`).
            target: of the output at them, ``(M,)``; of an angle whole turns do not matter.
            input: name of the driven coordinate; may be left out where the mechanism has one only.
            free: names of what may change; all if not given.
            bounds: as in `PathGeneration`.
            subject_to: conditions; those over a range look at the range of `values`.
            hold: free coordinates that keep their start values.
            input_offset: the input counts from an angle that is free.
            output_offset: the output counts from a value that is free.
            weights: of the points.
            minimax: make the largest error small rather than the sum of squares.

        Raises:
            InputError: unknown names, numbers that are not finite, tables of different length.
        """
        what = "FunctionGeneration"
        values = as_array(values, f"{what}: values")
        count = values.size
        if count < 3:
            raise InputError(f"{what}: {count} values of the input; give at least 3")
        table = as_sequence(values, count, f"{what}: values")
        wanted = as_sequence(target, count, f"{what}: target")
        set_up(self, what, mechanism, input, free, bounds, subject_to, hold, table=table)
        top = self.system.topology
        if not isinstance(output, str) and not callable(output):
            raise InputError(f"{what}: output is the name of a coordinate or a function of a motion, got {output!r}")
        if output == self.driven:
            raise InputError(
                f"{what}: output {output!r} is the input itself, which follows any table; name another coordinate"
            )
        if isinstance(output, str) and output not in top.position:
            numbers = NUMBERS[:-1] if top.dim == 3 else ()  # all but the place of the contact
            if output not in numbers:
                known = (*top.coordinates, *numbers)
                raise InputError(f"{what}: {top.name!r} has no coordinate {output!r}; {nearest(output, known)}")
            shapes(_attitude_reader(output), repeat_drawing(self, 1))  # says what it lacks
        turn = 4 * np.pi if self.periodic else np.inf
        check_radians(table, f"{what}: values", turn, "state one turn, which the others repeat")
        turns = _is_angle(self.system, output)
        if turns:
            check_radians(wanted, f"{what}: target", 4 * np.pi, "leave out whole turns")
        names = ("input offset",) * bool(input_offset) + ("output offset",) * bool(output_offset)
        complete(
            self,
            extras=Extras(names, np.zeros(len(names))),
            size=float(np.ptp(wanted)) or 1.0,
            minimax=minimax,
            output=output,
            values=table,
            target=wanted,
            input_offset=input_offset,
            output_offset=output_offset,
            jumps=turns and bool((np.abs(np.diff(wanted)) > np.pi).any()),
            weights=as_weights(weights, count, what),
        )

    @property
    def unit(self) -> str:
        top = self.system.topology
        if isinstance(self.output, str) and self.output not in top.position:
            return {"angle": "rad", "length": top.length_unit}.get(ATTITUDE.get(self.output, ""), "")
        return top.unit(self.output) if isinstance(self.output, str) else ""

    def inputs(self, extra: Numbers) -> Any:
        return self.values + (extra[0] if self.input_offset else 0.0)

    def span(self, home: Numbers, extra: Numbers) -> tuple[Any, Any]:
        first = extra[..., 0] if self.input_offset else 0.0
        return self.travel[0] + first, self.travel[1] + first

    def misses(self, motion: Motion, extra: Array) -> Array:
        found: Any
        if callable(self.output):
            found = call_on_motion(self.output, f"FunctionGeneration: output {self.output!r}", motion)
            if found.shape != self.target.shape:
                raise InputError(
                    f"FunctionGeneration: output {self.output!r} must return one number for each pose, shape "
                    f"{self.target.shape}, and returned shape {found.shape}; take a component: motion['P'][:, 0]"
                )
        elif self.output in self.system.topology.position:
            found = motion[self.output]
        else:
            found = _read_attitude(motion, self.output)
        missed = found - (extra[-1] if self.output_offset else 0.0) - self.target
        if not _is_angle(self.system, self.output):
            return missed
        # The table's turns are not the drawing's; in one that jumps, as angles in (-pi, pi] do, each has its own.
        off = missed if self.jumps else missed[0]
        return missed - 2.0 * jnp.pi * jnp.round(off / (2.0 * jnp.pi))

    def guesses(self, rng: np.random.Generator, count: int) -> np.ndarray:
        # The output's offset is fitted to each start.
        out = super().guesses(rng, count)
        if self.input_offset:
            out[:, 0] += (np.pi if self.periodic else 0.5 * float(np.ptp(self.values))) * rng.uniform(-1.0, 1.0, count)
        return out

    def fit(self, x: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if not self.output_offset:
            return x, errors
        root = np.sqrt(self.weights)
        x = x.copy()
        if self.jumps:
            turned = np.exp(1j * self.size * errors / np.where(root > 0.0, root, 1.0))
            mean = turned @ self.weights
            x[:, -1] += np.angle(mean)
            return x, np.angle(turned * np.conj(mean)[:, None]) * root / self.size
        off = errors @ root / self.weights.sum()
        x[:, -1] += off * self.size
        return x, errors - off[:, None] * root
