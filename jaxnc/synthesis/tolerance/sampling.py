"""Dimensions as they come out of the workshop: which vary, how far, samples of them, and what a mechanism does then."""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import jit
from jaxnc.errors import InputError
from jaxnc.kinematics.design import OutputSet, name_outputs, shift_geometry
from jaxnc.kinematics.inputs import positive
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position, sweep
from jaxnc.kinematics.sensitivity import Outputs, design_components
from jaxnc.solvers.assembly import derive, settle
from jaxnc.synthesis.validate import as_floats
from jaxnc.system.precision import widened
from jaxnc.system.system import System
from jaxnc.types import Array, ArrayLike, Float, Inputs
from jaxnc.validate import as_array

DISTRIBUTIONS = ("normal", "uniform")


@dataclasses.dataclass(frozen=True)
class Variation:
    """Random deviations of design variables from their nominal values."""

    names: tuple[str, ...]  # components of design variables, "B.x", "crank.A-B"
    at: np.ndarray  # their places in the flat parameters, (k,)
    units: tuple[str, ...]  # length unit or "rad"
    tolerances: np.ndarray  # half widths t of the ranges nominal ± t, (k,)
    covariance: np.ndarray  # of the deviations, (k, k)
    distribution: str  # "normal" or "uniform"

    @property
    def correlated(self) -> bool:
        """True if the deviations depend on one another."""
        return bool(np.any(self.covariance != np.diag(np.diag(self.covariance))))

    def draw(self, key: Array, samples: int) -> Float[Array, "samples k"]:
        """Samples of the deviations."""
        if self.distribution == "uniform":
            return jax.random.uniform(key, (samples, len(self.at)), minval=-1.0) * self.tolerances
        values, vectors = np.linalg.eigh(self.covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        return jax.random.normal(key, (samples, len(self.at))) @ root.T


def read_variation(
    what: str,
    system: System,
    tolerances: Mapping[str, ArrayLike],
    distribution: str = "normal",
    covariance: ArrayLike | None = None,
    sigmas: float = 3.0,
) -> Variation:
    """Read what a user says about the deviations of dimensions.

    A tolerance is the half width of a range, `sigmas` standard deviations, by design variable (then of each of its
    components) or component. The distribution is ``"normal"`` or ``"uniform"``; the covariance is ``(k, k)``,
    independent if not given.
    """
    if distribution not in DISTRIBUTIONS:
        raise InputError(f"{what}: distribution={distribution!r}; use {' or '.join(map(repr, DISTRIBUTIONS))}")
    positive(sigmas, f"{what}: sigmas (3 means that ± the tolerance is ± 3 σ)")
    sigmas = float(sigmas)
    if not isinstance(tolerances, Mapping) or not tolerances:
        raise InputError(f"{what}: no tolerances; give tolerances={{'crank.A-B': 0.01, …}} by design variable")
    rows: list = []
    for name, value in tolerances.items():
        found = variable_components(what, system, name)
        rows += zip(*found, _width(what, name, value, len(found[0])), strict=True)
    names, at, units, widths = zip(*rows, strict=True)
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"{what}: {twice[0]!r} has two tolerances; give it one")
    half = np.array(widths)
    spread = half / sigmas if distribution == "normal" else half / math.sqrt(3.0)
    matrix = np.diag(spread**2)
    if covariance is not None:
        matrix = _covariance(what, covariance, names, distribution)
        half = sigmas * np.sqrt(np.diag(matrix))
    return Variation(names, np.array(at), units, half, matrix, distribution)


def variable_components(what: str, system: System, name: str) -> tuple[tuple[str, ...], np.ndarray, tuple[str, ...]]:
    """Components of a design variable, or one component: names, places, units."""
    try:
        return design_components(system, [name])
    except InputError as error:
        raise InputError(str(error).replace("sensitivity:", f"{what}:")) from None


def _width(what: str, name: str, value: object, count: int) -> np.ndarray:
    width = as_floats(value, f"{what}: tolerance of {name!r} must be a number, got {value!r}")
    if width.shape not in ((), (count,)):
        raise InputError(f"{what}: tolerance of {name!r} has shape {width.shape}; give a number or one for each of "
                         f"its {count} components")  # fmt: skip
    if not (np.isfinite(width).all() and (width >= 0).all()):
        raise InputError(f"{what}: tolerance of {name!r} must be finite and not negative, got {value!r}")
    return np.broadcast_to(width, (count,))


def _covariance(what: str, covariance: ArrayLike, names: tuple[str, ...], distribution: str) -> np.ndarray:
    if distribution != "normal":
        raise InputError(f"{what}: covariance= is for distribution='normal'; leave it out for {distribution!r}")
    matrix = as_array(covariance, f"{what}: covariance")
    if matrix.shape != (len(names), len(names)):
        raise InputError(
            f"{what}: covariance has shape {matrix.shape}; the {len(names)} components {', '.join(names)} need "
            f"({len(names)}, {len(names)})"
        )
    size = float(np.abs(matrix).max(initial=0.0))
    if not np.isfinite(matrix).all() or np.abs(matrix - matrix.T).max() > 1e-12 * size:
        raise InputError(f"{what}: covariance must be finite and symmetric")
    least = float(np.linalg.eigvalsh(matrix)[0])
    if least < -1e-12 * size:
        raise InputError(f"{what}: covariance has the negative eigenvalue {least:.3g}; no deviations vary like that")
    return matrix


@dataclasses.dataclass(frozen=True)
class Question:
    """A question to every design: inputs that are driven, coordinates held, outputs. Hashable, for compilation."""

    driven: tuple[str, ...]  # names of the inputs
    held: tuple[str, ...]  # names of free coordinates that each design keeps at its own start value
    outputs: OutputSet
    sequence: bool  # whether the inputs are a sequence, followed in order

    def move(self, system: System, values: Sequence[ArrayLike]) -> Motion:
        """Solve a design."""
        inputs = dict(zip(self.driven, values, strict=True))
        if self.sequence:
            return sweep(system, inputs, hold=self.held)
        return solve_position(system, inputs, hold=self.held, throw=False)

    def read(self, motion: Motion) -> dict[str, Array]:
        """Read the outputs off a motion."""
        return name_outputs(self.outputs(motion))


@widened
def move_nominal(system: System, asked: Question, values: Sequence[ArrayLike]) -> Motion:
    """The motion of the design itself, on the host, with 64-bit numbers."""
    return asked.move(system, [np.asarray(value) for value in values])


def make_question(
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
    return Question(tuple(inputs), tuple(hold), OutputSet.of(what, outputs), bool(shape)), tuple(values)


@functools.partial(jit, static_argnums=0)
def solve_batch(asked: Question, system: System, at: Array, changes: Array, values: tuple[Array, ...]):
    """Outputs of every changed design, by name, and which poses converged; pure, compiled once for each question."""

    def one(change):
        motion = asked.move(shift_geometry(system, at, change), values)
        return asked.read(motion), motion.converged

    return jax.vmap(one)(changes)


def sample_outputs(
    asked: Question, system: System, at: np.ndarray, changes: Array, values: tuple[Array, ...]
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Outputs of every changed design, ``(samples, …)`` by name, and which poses converged, ``(samples, *poses)``."""
    count = len(changes)
    poses = int(np.prod(values[0].shape, dtype=int)) if values else 1
    chunk = min(count, max(1, 2**21 // poses))  # 2**21 poses are solved together
    found: list[Any] = []
    for start in range(0, count, chunk):
        # The last chunk overlaps the one before: one shape, compiled once.
        begin = min(start, count - chunk)
        part = jax.tree.map(
            np.asarray, solve_batch(asked, system, jnp.asarray(at), changes[begin : begin + chunk], values)
        )
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
