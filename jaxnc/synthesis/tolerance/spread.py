"""Deviations of outputs from tolerances of dimensions: by exact derivatives, and by Monte Carlo through the batch."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import jax
import numpy as np

from jaxnc.calls import public
from jaxnc.errors import AssemblyError, InputError, counted
from jaxnc.kinematics.inputs import whole
from jaxnc.kinematics.sensitivity import Outputs, sensitivity
from jaxnc.synthesis.tolerance.sampling import by_component, make_question, move_nominal, read_variation, sample_outputs
from jaxnc.synthesis.validate import as_seed, check_name
from jaxnc.system.precision import on_host
from jaxnc.system.system import System
from jaxnc.types import Array, ArrayLike, Inputs
from jaxnc.validate import as_array


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
