"""One mechanism, many slightly different ones: outputs of a batch of designs, compiled once for each question."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import jit
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position, sweep
from jaxnc.kinematics.redesign import parts_of, redrawn
from jaxnc.kinematics.sensitivity import Outputs, asked
from jaxnc.solvers.assembly import derive, settle
from jaxnc.system.precision import widened
from jaxnc.system.system import System
from jaxnc.types import Array, ArrayLike, Inputs

_LANES = 2**21  # poses solved together


@dataclasses.dataclass(frozen=True)
class Question:
    """What is asked of every design: inputs that are driven, coordinates held, outputs. Hashable, for compilation."""

    driven: tuple[str, ...]  # names of the inputs
    held: tuple[str, ...]  # names of free coordinates that each design keeps at its own start value
    # Names with what they are: a coordinate, or a function of a motion; one of name "" is the function that returns
    # them all.
    outputs: tuple[tuple[str, str | Callable[[Motion], Any]], ...]
    sequence: bool  # whether the inputs are a sequence, followed in order

    def move(self, system: System, values: Sequence[ArrayLike]) -> Motion:
        """Solve a design."""
        inputs = dict(zip(self.driven, values, strict=True))
        if self.sequence:
            return sweep(system, inputs, hold=self.held)
        return solve_position(system, inputs, hold=self.held, throw=False)

    def read(self, motion: Motion) -> dict[str, Array]:
        """Read the outputs off a motion."""
        if self.outputs[0][0] == "":
            return parts_of(asked(self.outputs[0][1], "outputs=", motion))  # pyright: ignore[reportArgumentType]
        found = {
            n: asked(output, f"output {n!r}", motion) if callable(output) else motion[output]
            for n, output in self.outputs
        }
        return parts_of(found)


@widened
def nominal(system: System, asked: Question, values: Sequence[ArrayLike]) -> Motion:
    """The motion of the design itself, on the host, with 64-bit numbers."""
    return asked.move(system, [np.asarray(value) for value in values])


def question(
    what: str, system: System, inputs: Inputs, outputs: Outputs, hold: Sequence[str]
) -> tuple[Question, tuple[Array, ...]]:
    """Sort out what is asked, and the values of the inputs.

    What is held becomes an input, at the value that it has in this design: others keep it there too, as a derivative
    with respect to the design does.
    """
    if not isinstance(inputs, Mapping):
        raise InputError(f"{what}: inputs are given by name, such as {{'phi': values}}; got {inputs!r}")
    top = system.topology
    if still := [name for name in hold if name in top.position and name not in inputs]:
        start = np.asarray(settle(derive(system), np.zeros(len(top.coordinates))).q)
        inputs = {**inputs, **{name: start[top.position[name]] for name in still}}
        hold = [name for name in hold if name not in still]
    values = jnp.broadcast_arrays(*(jnp.asarray(v, float) for v in inputs.values())) if inputs else []
    shape = values[0].shape if values else ()
    if len(shape) > 1:
        raise InputError(f"{what}: inputs have shape {shape}; give one pose or a sequence of them")
    if callable(outputs):
        wanted: tuple = (("", outputs),)
    else:
        names = [outputs] if isinstance(outputs, str) else outputs
        wanted = tuple(names.items()) if isinstance(names, Mapping) else tuple((name, name) for name in names)
        if not wanted:
            raise InputError(f"{what}: no outputs; name points or coordinates, or give a function of a motion")
    return Question(tuple(inputs), tuple(hold), wanted, bool(shape)), tuple(values)


@functools.partial(jit, static_argnums=0)
def batch(asked: Question, system: System, at: Array, changes: Array, values: tuple[Array, ...]):
    """Outputs of every changed design, by name, and which poses converged; pure, compiled once for each question."""

    def one(change):
        motion = asked.move(redrawn(system, at, change), values)
        return asked.read(motion), motion.converged

    return jax.vmap(one)(changes)


def outputs_of(
    asked: Question, system: System, at: np.ndarray, changes: Array, values: tuple[Array, ...]
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Outputs of every changed design, ``(samples, …)`` by name, and which poses converged, ``(samples, *poses)``."""
    count = len(changes)
    poses = int(np.prod(values[0].shape, dtype=int)) if values else 1
    chunk = min(count, max(1, _LANES // poses))
    found: list[Any] = []
    for start in range(0, count, chunk):
        # The last chunk overlaps the one before: one shape, compiled once.
        begin = min(start, count - chunk)
        part = jax.tree.map(np.asarray, batch(asked, system, jnp.asarray(at), changes[begin : begin + chunk], values))
        found.append(jax.tree.map(lambda x, skip=start - begin: x[skip:], part))
    return jax.tree.map(lambda *x: np.concatenate(x), *found)


def by_component(name: str, value: np.ndarray, lead: tuple[int, ...]) -> dict[str, tuple]:
    """Labels of an output's components, and the index of each behind the leading axes of the poses.

    `lead` is the shape of the poses, dropped where the output does not begin with it.
    """
    inner = value.shape[len(lead) :] if value.shape[: len(lead)] == lead else value.shape
    if not inner:
        return {name: ()}
    if inner in ((2,), (3,)):
        return {f"{name}.{axis}": (k,) for k, axis in enumerate("xyz"[: inner[0]])}
    return {f"{name}.{'.'.join(map(str, index))}": index for index in np.ndindex(*inner)}
