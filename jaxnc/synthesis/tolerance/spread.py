"""Deviations of outputs from tolerances of dimensions: by exact derivatives, and by Monte Carlo through the batch.

Dimensions are those that come out of the workshop: which vary, how far, samples of them, and what a mechanism does
then. In robust design a statistic of an output over the samples is an objective that can be differentiated.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import jit, shapes_of
from jaxnc.errors import AssemblyError, InputError, counted
from jaxnc.kinematics.design import OutputSet, name_outputs, samples_of, shift_geometry
from jaxnc.kinematics.inputs import positive, whole
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position, sweep
from jaxnc.kinematics.sensitivity import Outputs, design_components, sensitivity
from jaxnc.solvers.assembly import derive, settle
from jaxnc.synthesis.validate import as_floats, as_seed, check_name
from jaxnc.system.precision import on_host, widened
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
    """Outputs of every changed design, by name, and which poses converged; pure, compiled once for each question.

    Angles count their turns as those of the design itself do: one drawn near half a turn is on either side of it in
    changed designs.
    """
    system = samples_of(system)

    def outputs(change: Array) -> tuple[dict[str, Array], Array]:
        motion = asked.move(shift_geometry(system, at, change), values)
        return asked.read(motion), motion.converged

    return jax.vmap(outputs)(changes)


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


# -- deviations of outputs ---------------------------------------------------------------------------------------------


@public
@dataclasses.dataclass(frozen=True)
class Spread:
    """How far one output strays; arrays over the poses, ``(*poses,)``, in the output's unit.

    Attributes:
        nominal: the output of the nominal design.
        first_order: standard deviation from the derivatives, sqrt(J Σ Jᵀ).
        worst_case: largest deviation to first order when every dimension is at an end of its range, ``Σ |J| t``.
        mean: mean of the samples.
        std: standard deviation of the samples.
        percentiles: of the samples, ``(percentiles, *poses)``.
        shares: part of each dimension in the first-order variance, over all poses, ``(variables,)``; they add up to 1.
        unit: the length unit, ``"rad"``, or ``""``.
    """

    nominal: np.ndarray
    first_order: np.ndarray
    worst_case: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    percentiles: np.ndarray
    shares: np.ndarray
    unit: str


@public
@dataclasses.dataclass(frozen=True)
class Tolerance:
    """Statistics of outputs under tolerances; ``print()`` compares first order and Monte Carlo.

    ``found["P.y"]`` is the `Spread` of an output.

    Attributes:
        name: the mechanism.
        variables: components of design variables that vary.
        tolerances: their half widths, ``(variables,)``.
        variable_units: their units.
        outputs: a `Spread` for each component of each output.
        levels: which percentiles were taken.
        inputs: values of the driven coordinates.
        input_units: their units.
        samples: how many designs were drawn.
        failed: how many of them did not assemble in every pose, or had outputs that are not finite; they are left out.
        distribution: in words.
    """

    name: str
    variables: tuple[str, ...]
    tolerances: np.ndarray
    variable_units: tuple[str, ...]
    outputs: Mapping[str, Spread]
    levels: tuple[float, ...]
    inputs: Mapping[str, np.ndarray]
    input_units: Mapping[str, str]
    samples: int
    failed: int
    distribution: str

    def __getitem__(self, name: str) -> Spread:
        check_name(name, self.outputs, f"tolerance: no output {name!r}")
        return self.outputs[name]

    @property
    def worst(self) -> dict[str, str]:
        """The dimension with the largest share in each output's variance."""
        return {label: self.variables[int(np.argmax(s.shares))] for label, s in self.outputs.items()}

    @property
    def statistical_error(self) -> float:
        """Relative standard error of a standard deviation from this many samples, for a normal output."""
        return 1.0 / math.sqrt(2.0 * max(self.samples - self.failed - 1, 1))

    def ratio(self, name: str) -> np.ndarray:
        """Monte Carlo's standard deviation over that of first order, ``(*poses,)``; 1 where both are zero.

        Away from 1 by more than a few `statistical_error`, the mechanism is not linear within its tolerances.
        """
        s = self[name]
        return np.where(s.first_order > 0, s.std / np.where(s.first_order > 0, s.first_order, 1.0), 1.0)

    def table(self, most: int = 5) -> str:
        """The statistics as text: for each output the pose where it strays most, and who is to blame.

        Args:
            most: how many dimensions to name for each output.

        Returns:
            Standard deviations by both ways, the range of percentiles and the worst case, as deviations from nominal.
        """
        lines = [
            f"{self.name}: {counted(len(self.variables), 'dimension varies', 'dimensions vary')}, "
            f"{self.distribution}; {counted(self.samples, 'sample')}"
            + (f", {_describe_inputs(self.inputs)}" if _pose_count(self.inputs) > 1 else "")
        ]
        if self.failed:
            lines.append(f"  {self.failed} of {self.samples} samples did not assemble everywhere and are left out")
        low, high = self.levels[0], self.levels[-1]
        for label, s in self.outputs.items():
            k = np.unravel_index(int(np.argmax(s.first_order)), s.first_order.shape)
            unit = f" {s.unit}" if s.unit else ""
            at = ""
            if s.nominal.ndim:
                at = ", worst at " + ", ".join(f"{n} = {float(v[k]):.6g}" for n, v in self.inputs.items())
            off = s.percentiles[(slice(None), *k)] - s.nominal[k]
            error, shift = s.std[k] * self.statistical_error, s.mean[k] - s.nominal[k]
            lines += [
                f"  {label} = {s.nominal[k]:.6g}{unit}{at}",
                f"    σ first order  {s.first_order[k]:.4g}{unit}",
                f"    σ Monte Carlo  {s.std[k]:.4g} ± {error:.1g}{unit}, mean shifted by {shift:.2g}",
                f"    {low:g} % … {high:g} %  {off[0]:+.4g} … {off[-1]:+.4g}{unit}",
                f"    worst case     ±{s.worst_case[k]:.4g}{unit}",
            ]
            order = np.argsort(-s.shares, kind="stable")[:most]
            named = [f"{self.variables[i]} {100 * s.shares[i]:.1f} %" for i in order if s.shares[i] > 5e-4]
            lines.append(f"    variance from  {', '.join(named) or 'nothing'}")
        return "\n".join(lines)

    def __repr__(self) -> str:
        return self.table()

    def plot(self, name: str | None = None, **options):
        """Draw how far an output strays over the input, and the dimensions' shares; see `jaxnc.viz.band`."""
        from jaxnc import viz

        return viz.band(self, name, **options)


@public
@on_host
def tolerance(
    system: System,
    inputs: Inputs,
    outputs: Outputs,
    tolerances: Mapping[str, ArrayLike],
    samples: int = 2000,
    key: Array | None = None,
    distribution: str = "normal",
    covariance: ArrayLike | None = None,
    sigmas: float = 3.0,
    percentiles: Sequence[float] = (0.5, 50.0, 99.5),
    hold: Sequence[str] = (),
    units: Mapping[str, str] | None = None,
) -> Tolerance:
    """Find how far tolerances of dimensions let outputs stray, to first order and by Monte Carlo.

    Args:
        system: the nominal design.
        inputs: value, or sequence of values, of each driven coordinate, radians and lengths; they are exact.
        outputs: as in `jaxnc.sensitivity`: names, or functions of a motion.
        tolerances: half width t of the range nominal ± t by design variable (a point: for each of its coordinates), or
            by component, ``"B.x"``; lengths.
        samples: how many designs to draw.
        key: JAX random key; that of seed 0 if not given.
        distribution: ``"normal"``, t being `sigmas` standard deviations, or ``"uniform"`` over the range.
        covariance: of all components in the order given (normal), for dimensions that vary together; the half widths
            are then its standard deviations times `sigmas`, whatever `tolerances` say.
        sigmas: how many standard deviations a tolerance is.
        percentiles: which percentiles to take, in percent.
        hold: free coordinates that keep the value at which the nominal design starts.
        units: ``"rad"`` or another label by output, for the table.

    Raises:
        InputError: unknown names, tolerances that are no lengths, too few samples; see the message.
        AssemblyError: the nominal design does not assemble, or no sample does.

    Source: first order, e.g. P. J. Drake, Dimensioning and Tolerancing Handbook (1999), chapter 9; the derivatives are
    those of `jaxnc.sensitivity`.
    """
    samples = whole(samples, "tolerance: samples, of which percentiles need a thousand,", 2)
    as_seed("tolerance", key)
    levels = tuple(np.atleast_1d(as_array(percentiles, "tolerance: percentiles")).tolist())
    if not levels or np.ndim(levels) > 1 or not np.all(np.diff([0.0, *levels, 100.0]) >= 0.0):
        raise InputError(f"tolerance: percentiles = {levels} must increase between 0 and 100")
    vary = read_variation("tolerance", system, tolerances, distribution, covariance, sigmas)
    asked, values = make_question("tolerance", system, inputs, outputs, hold)
    motion = move_nominal(system, asked, values)
    if failures := int(motion.failures):
        raise AssemblyError(
            f"tolerance: the nominal design of {system.name!r} does not assemble in {failures} of "
            f"{motion.status.size} poses; leave those out, or see jaxnc.diagnose"
        )
    linear = sensitivity(motion, outputs, variables=list(vary.names), units=units)
    order = [linear.variables.index(name) for name in vary.names]
    changes = vary.draw(jax.random.key(0) if key is None else key, samples)
    found, converged = sample_outputs(asked, system, vary.at, changes, values)
    good = converged.reshape(samples, -1).all(axis=1)
    for value in found.values():
        good &= np.isfinite(value.reshape(samples, -1)).all(axis=1)
    if good.sum() < 2:
        raise AssemblyError(
            f"tolerance: {int(good.sum())} of {samples} samples assemble everywhere; the tolerances are too wide for "
            f"{system.name!r}, or the inputs reach a dead point"
        )
    lead = linear.converged.shape
    spreads: dict[str, Spread] = {}
    wanted = [name for name, _ in asked.outputs.wanted]  # compiled functions return a mapping in alphabetical order
    for name in sorted(found, key=lambda n: wanted.index(n) if n in wanted else len(wanted)):
        value = found[name]
        for label, index in by_component(name, value[0], lead).items():
            sample = value[(good, ..., *index)]
            slopes = linear.derivatives[name][..., order][(..., *index, slice(None))]
            spreads[label] = _spread_of(
                np.asarray(linear.values[name])[(..., *index)], slopes, sample, vary.tolerances, vary.covariance,
                levels, linear.units[name],
            )  # fmt: skip
    words = f"normal, ± tolerance = ± {sigmas:g} σ" if distribution == "normal" else "uniform over the tolerance"
    return Tolerance(
        name=system.name,
        variables=vary.names,
        tolerances=vary.tolerances,
        variable_units=vary.units,
        outputs=spreads,
        levels=levels,
        inputs={name: linear.inputs[name] for name in inputs},
        input_units={name: system.topology.unit(name) for name in inputs},
        samples=samples,
        failed=int(samples - good.sum()),
        distribution=words + (", correlated" if vary.correlated else ""),
    )


def _spread_of(nominal, slopes, sample, half, covariance, levels, unit) -> Spread:
    parts = slopes * (slopes @ covariance)  # of each dimension in the variance; a covariance is shared by halves
    variance = parts.sum(axis=-1)
    total = float(variance.sum())
    flat = parts.reshape(-1, parts.shape[-1]).sum(axis=0)
    return Spread(
        nominal=nominal,
        first_order=np.sqrt(np.maximum(variance, 0.0)),
        worst_case=np.abs(slopes) @ half,
        mean=sample.mean(axis=0),
        std=sample.std(axis=0, ddof=1),
        percentiles=np.percentile(sample, levels, axis=0),
        shares=flat / total if total > 0 else np.zeros_like(flat),
        unit=unit,
    )


def _pose_count(inputs: Mapping[str, np.ndarray]) -> int:
    return max((int(np.size(v)) for v in inputs.values()), default=1)


def _describe_inputs(inputs: Mapping[str, np.ndarray]) -> str:
    spans = [f"{name} = {float(np.min(v)):.4g} … {float(np.max(v)):.4g}" for name, v in inputs.items()]
    return f"{counted(_pose_count(inputs), 'pose')}, {', '.join(spans)}"


# -- robust design -----------------------------------------------------------------------------------------------------


STATISTICS = ("mean", "std", "variance", "percentile", "worst")


@public
@dataclasses.dataclass(frozen=True, eq=False)
class Robust:
    """A statistic of one number over the same sampled deviations of every design: call it with a system.

    It is pure: ``jax.grad(measure)(system)``, ``jax.jit``, ``jax.vmap`` work. A sample that does not assemble counts as
    the worst of those that do, and every one adds its part of `penalty`; where none assembles the value is infinite.
    Failing pays all the same if the worst sample is the one that fails and `penalty` is small: see `failures`.
    """

    asked: Question
    values: tuple[Array, ...]
    at: np.ndarray
    changes: Array
    statistic: str
    percentile: float
    penalty: float | None

    def samples(self, system: System) -> tuple[Array, Array]:
        """The number for every sampled design, ``(samples,)``, and which designs assemble in every pose.

        Args:
            system: the nominal design.
        """
        parts, converged = solve_batch(self.asked, system, jnp.asarray(self.at), self.changes, self.values)
        (found,) = parts.values()
        return found, jnp.all(converged.reshape(len(found), -1), axis=1) & jnp.isfinite(found)

    def failures(self, system: System) -> Array:
        """How many sampled designs do not assemble in every pose.

        Args:
            system: the nominal design.
        """
        return jnp.sum(~self.samples(system)[1])

    def __call__(self, system: System) -> Array:
        """The statistic for a design."""
        found, good = self.samples(system)
        worst = jnp.max(jnp.where(good, found, -jnp.inf))
        some = jnp.isfinite(worst)
        worst = jnp.where(some, worst, 0.0)
        x = jnp.where(good, found, worst)
        if self.statistic == "mean":
            value = jnp.mean(x)
        elif self.statistic == "worst":
            value = jnp.max(x)
        elif self.statistic == "percentile":
            value = jnp.percentile(x, self.percentile)
        else:
            value = jnp.sum((x - jnp.mean(x)) ** 2) / (len(x) - 1)
            if self.statistic == "std":
                spread = value > 0
                value = jnp.where(spread, jnp.sqrt(jnp.where(spread, value, 1.0)), 0.0)
        penalty = jnp.abs(worst) if self.penalty is None else self.penalty
        return jnp.where(some, value + penalty * jnp.mean(~good), jnp.inf)


@public
def robust(
    system: System,
    inputs: Inputs,
    output: str | Callable[[Motion], ArrayLike],
    tolerances: Mapping[str, ArrayLike],
    samples: int = 64,
    key: Array | None = None,
    statistic: str = "percentile",
    percentile: float = 95.0,
    distribution: str = "normal",
    covariance: ArrayLike | None = None,
    sigmas: float = 3.0,
    hold: Sequence[str] = (),
    penalty: float | None = None,
) -> Robust:
    """An objective for robust design: a statistic of an output over seeded samples of the tolerances.

    The samples are drawn once, so that designs are compared under the same deviations and the gradient is exact.

    Args:
        system: any design of the topology.
        inputs: value or sequence of values of each driven coordinate.
        output: a coordinate of one pose, or a function of a motion that returns one number, the larger the worse.
        tolerances: as in `tolerance`.
        samples: how many.
        key: JAX random key; that of seed 0 if not given.
        statistic: ``"mean"``, ``"std"``, ``"variance"``, ``"percentile"`` or ``"worst"``.
        percentile: which, in percent.
        distribution: as in `tolerance`.
        covariance: as in `tolerance`.
        sigmas: as in `tolerance`.
        hold: free coordinates that keep the value at which the nominal design starts.
        penalty: added times the part of the samples that does not assemble, in the output's unit; as much as the worst
            of those that do if not given.

    Returns:
        The objective, a function of a system.

    Raises:
        InputError: an unknown statistic, and as in `tolerance`.
    """
    if statistic not in STATISTICS:
        raise InputError(f"robust: statistic={statistic!r}; use one of {', '.join(map(repr, STATISTICS))}")
    samples = whole(samples, "robust: samples, of which a statistic is made,", 2)
    as_seed("robust", key)
    if not 0 <= percentile <= 100:
        raise InputError(f"robust: percentile = {percentile} must be between 0 and 100")
    vary = read_variation("robust", system, tolerances, distribution, covariance, sigmas)
    asked, values = make_question("robust", system, inputs, output, hold)
    changes = vary.draw(jax.random.key(0) if key is None else key, samples)
    parts = shapes_of(functools.partial(solve_batch, asked), system, jnp.asarray(vary.at), changes, values)[0]
    shapes = {name or "output": part.shape[1:] for name, part in parts.items()}
    if list(shapes.values()) != [()]:
        raise InputError(
            f"robust: the output must be one number for a design, its shape is {shapes}; take its largest value or a "
            f"sum over the poses"
        )
    return Robust(
        asked, values, vary.at, changes, statistic, float(percentile), None if penalty is None else float(penalty)
    )
