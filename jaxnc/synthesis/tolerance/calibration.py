"""Dimensions of a real mechanism from measured poses: least squares with exact Jacobians, and what they do not tell."""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import jit
from jaxnc.errors import AssemblyError, InputError, counted, nearest
from jaxnc.kinematics.design import geometry_vector, samples_of, shift_geometry, without_needless_turns
from jaxnc.synthesis.tolerance.spread import make_question, variable_components
from jaxnc.synthesis.validate import as_floats, check_name
from jaxnc.system.precision import on_host
from jaxnc.system.system import System
from jaxnc.types import Array, ArrayLike, Inputs, Numbers

_RANK = 1e-8  # of the largest singular value: combinations of dimensions below it are not determined


@public
@dataclasses.dataclass(frozen=True)
class Calibration:
    """Dimensions fitted to measurements; ``print()`` is a report.

    Attributes:
        system: the calibrated design. Where an angle that is counted in turns has gone past half a turn, it goes on
            counting from the design as drawn, which the numbers of the design alone do not tell.
        variables: components of the design variables that were fitted.
        values: their values, ``(k,)``.
        drawn: their values before, ``(k,)``.
        units: their units.
        covariance: of the values, ``(k, k)``; of undetermined combinations nothing is known, they are not in it.
        standard_errors: square roots of its diagonal, infinite for variables in ``undetermined``.
        undetermined: variables that the measurements do not determine, alone or together with one another; they keep
            what is closest to the drawing.
        combinations: an orthonormal basis of the undetermined changes, ``(count, k)``.
        residuals: calibrated - measured by output, in its unit, NaN where nothing was measured.
        rms: root mean square of the residuals by output.
        chi_square: sum of squares of the weighted residuals.
        degrees_of_freedom: measurements less determined combinations.
        noise: estimated standard deviation of a measurement of unit weight, sqrt(chi²/degrees of freedom); near 1
            where the given sigmas are right.
        scaled: whether the covariance was scaled with `noise`, because no sigmas were given.
        iterations: steps of Gauss-Newton with damping.
        converged: whether the last step was negligible.
        failed: poses that the calibrated design does not reach; their measurements are left out.
    """

    system: System
    variables: tuple[str, ...]
    values: np.ndarray
    drawn: np.ndarray
    units: tuple[str, ...]
    covariance: np.ndarray
    standard_errors: np.ndarray
    undetermined: tuple[str, ...]
    combinations: np.ndarray
    residuals: Mapping[str, np.ndarray]
    rms: Mapping[str, float]
    chi_square: float
    degrees_of_freedom: int
    noise: float
    scaled: bool
    iterations: int
    converged: bool
    failed: int

    def __getitem__(self, name: str) -> tuple[float, float]:
        """Value and standard error of a variable."""
        check_name(name, self.variables, f"calibration: no variable {name!r}")
        k = self.variables.index(name)
        return float(self.values[k]), float(self.standard_errors[k])

    @property
    def correlation(self) -> np.ndarray:
        """Correlations of the estimates, ``(k, k)``."""
        spread = np.sqrt(np.diag(self.covariance))
        spread = np.where(spread > 0, spread, 1.0)
        return self.covariance / np.outer(spread, spread)

    def __repr__(self) -> str:
        return self.table()

    def table(self) -> str:
        """The report as text."""
        state = "converged" if self.converged else "NOT converged"
        lines = [
            f"{self.system.name}: calibration of {counted(len(self.variables), 'dimension')}, {state} in "
            f"{counted(self.iterations, 'step')}"
        ]
        if self.failed:
            lines.append(f"  {self.failed} measured poses are not reached and are left out")
        for k, name in enumerate(self.variables):
            error = self.standard_errors[k]
            shown = f"± {error:.2g}" if math.isfinite(error) else "not determined"
            lines.append(f"  {name:<16} {self.values[k]:.8g} {shown} {self.units[k]}   drawn {self.drawn[k]:.6g}")
        for name, value in self.rms.items():
            lines.append(f"  residual of {name}: rms {value:.3g}")
        if self.scaled:
            lines.append(
                f"  noise of a measurement {self.noise:.3g} (from {self.degrees_of_freedom} degrees of freedom)"
            )
        else:
            lines.append(f"  chi² {self.chi_square:.4g} with {self.degrees_of_freedom} degrees of freedom")
        if self.undetermined:
            lines.append(
                f"  not determined by these measurements, in {len(self.combinations)} combinations: "
                f"{', '.join(self.undetermined)}; leave some out of variables=, or measure something else"
            )
        return "\n".join(lines)


@public
@on_host
def calibrate(
    system: System,
    inputs: Inputs,
    measurements: Mapping[str, ArrayLike],
    variables: Sequence[str],
    sigma: Mapping[str, ArrayLike] | float | None = None,
    hold: Sequence[str] = (),
    steps: int = 60,
) -> Calibration:
    """Fit dimensions of a mechanism to measured poses.

    Weighted least squares by Gauss-Newton with Levenberg's damping and exact Jacobians. Combinations of dimensions that
    the measurements do not determine are found by the singular values of the Jacobian, named, and left as drawn.

    Args:
        system: the design as drawn, from which the fit starts.
        inputs: the driven coordinates at the measured poses, ``(T,)``, in an order that the mechanism can follow.
        measurements: measured outputs by name: points ``(T, dim)``, coordinates ``(T,)``; NaN where not measured.
        variables: design variables (a point: its coordinates) or components to be fitted.
        sigma: standard deviation of a measurement, by output or for all, in the output's unit: one number, or one for
            each pose ``(T,)``; of a point also one for each component ``(dim,)``, as which it is taken where there are
            as many poses, or for each of each ``(T, dim)``. If not given all weigh the same, and the noise is estimated
            from the residuals.
        hold: free coordinates that keep the value at which the nominal design starts.
        steps: most iterations.

    Returns:
        The calibrated design with the covariance of its dimensions; see `Calibration`.

    Raises:
        InputError: unknown names, measurements of another shape or fewer than what they should determine, sigmas that
            are not positive.
        AssemblyError: the drawing does not reach the measured poses.

    Source: K. Levenberg (1944), D. W. Marquardt (1963); covariance and rank: Å. Björck, Numerical Methods for Least
    Squares Problems (1996), chapters 1, 2.
    """
    wanted = [variables] if isinstance(variables, str) else variables
    found = [row for name in wanted for row in zip(*variable_components("calibration", system, name), strict=True)]
    if not found:
        raise InputError("calibration: no variables; name the dimensions to be fitted")
    names, places, units = zip(*dict.fromkeys(found), strict=True)
    at = np.array(places)
    if not isinstance(measurements, Mapping) or not measurements:
        raise InputError("calibration: no measurements; give measurements={'P': array (T, 2), …} by output")
    asked, values = make_question("calibration", system, inputs, list(measurements), hold)
    lead = values[0].shape if values else ()
    top = system.topology
    measured, weights = {}, {}
    for name, value in measurements.items():
        array = np.asarray(value, float)
        known = (*top.points, *top.vectors, *(m.name for m in top.markers))
        if name not in (*known, *top.position) and name.partition(".")[0] not in known:
            raise InputError(f"calibration: no output {name!r}; {nearest(name, (*known, *top.scalars))}")
        want = (*lead, top.dim) if name in known else lead
        if array.shape != want:
            raise InputError(f"calibration: measurement of {name!r} has shape {array.shape}; with these inputs {want}")
        spread = sigma.get(name, None) if isinstance(sigma, Mapping) else sigma
        if isinstance(sigma, Mapping) and spread is None:
            raise InputError(f"calibration: sigma has nothing for {name!r}; give it for every output or for none")
        spread = as_floats(1.0 if spread is None else spread, f"calibration: sigma of {name!r} must be numbers")
        if spread.shape == lead != want[-1:]:  # one for each pose, for all components
            spread = spread[..., None]
        if spread.shape not in ((), (1,), lead, want[-1:], (1, *want[-1:]), (*lead, 1), want):
            raise InputError(
                f"calibration: sigma of {name!r} has shape {spread.shape}; give one number, or those of shape "
                f"{' or '.join(str(s) for s in dict.fromkeys((lead, want[-1:], want)) if s)}"
            )
        spread = np.broadcast_to(spread, want)
        seen = np.isfinite(array)
        if not ((spread > 0) & (spread < np.inf))[seen].all():
            raise InputError(f"calibration: sigma of {name!r} must be positive")
        measured[name] = np.where(seen, array, 0.0)
        weights[name] = np.where(seen, 1.0 / np.where(seen, spread, 1.0), 0.0)
    count = sum(int((w > 0).sum()) for w in weights.values())
    if count < 1:
        raise InputError("calibration: every measurement is NaN; there is nothing to fit")
    size = float(np.max(np.ptp(np.asarray(system.parameters.points), axis=0))) or 1.0
    scales = np.array([size if unit != "rad" else 1.0 for unit in units])
    angular = tuple(n for n in measured if top.is_angle(n))

    def evaluate(changes: np.ndarray):
        given = (jnp.asarray(at), jnp.asarray(changes), values, measured, weights)
        rest, slopes, good = map(np.asarray, _linearise(asked, angular, system, *given))
        return rest, slopes * scales, good

    system, x = samples_of(system), np.zeros(len(at))
    rest, slopes, good = evaluate(x)
    if not good.any():
        raise AssemblyError(
            f"calibration: {system.name!r} as drawn reaches none of the measured poses; draw it closer to the real "
            f"one, or see jaxnc.diagnose"
        )
    damping, converged, iterations = 1e-6, False, 0
    for _ in range(steps):
        iterations += 1
        u, s, vt = np.linalg.svd(slopes, full_matrices=False)
        kept = s > _RANK * s[0]
        floor = damping * s[0]
        step = -vt.T @ (np.where(kept, s / np.where(kept, s * s + floor * floor, 1.0), 0.0) * (u.T @ rest))
        trial = evaluate(x + step * scales)
        if trial[2].sum() >= good.sum() and trial[0] @ trial[0] <= (rest @ rest) * (1 + 1e-12) + 1e-300:
            x, (rest, slopes, good) = x + step * scales, trial
            damping = max(0.1 * damping, 1e-12) if damping > 1e-12 else 0.0
        else:
            damping = max(10.0 * damping, 1e-6)
        if np.abs(step).max() < 1e-13 or damping > 1e6:  # a step of 1e-13 of the mechanism's size ends the iteration
            converged = damping <= 1e6
            break
    _, s, vt = np.linalg.svd(slopes, full_matrices=True)
    s = np.concatenate([s, np.zeros(len(at) - len(s))])
    kept = s > _RANK * s[0] if s[0] > 0 else np.zeros(len(s), bool)
    lost = vt[~kept]
    counts = {name: np.broadcast_to(_align(good, w), w.shape) & (w > 0) for name, w in weights.items()}
    used = int(sum(some.sum() for some in counts.values()))
    freedom = used - int(kept.sum())
    chi = float(rest @ rest)
    noise = math.sqrt(chi / freedom) if freedom > 0 else math.nan
    inverse = (vt[kept].T / s[kept] ** 2) @ vt[kept]
    covariance = inverse * np.outer(scales, scales) * (1.0 if sigma is not None else noise**2)
    part = np.sqrt((lost**2).sum(axis=0))
    unknown = part > 1e-2  # a dimension is named if 1e-2 of it lies in undetermined combinations
    residuals, rms, offset = {}, {}, 0
    for name in sorted(measured):
        w = weights[name]
        block = rest[offset : offset + w.size].reshape(w.shape)
        offset += w.size
        residuals[name] = np.where(counts[name], block / np.where(w > 0, w, 1.0), np.nan)
        rms[name] = float(np.sqrt(np.nanmean(residuals[name] ** 2))) if counts[name].any() else math.nan
    drawn = np.asarray(geometry_vector(system))[at]
    return Calibration(
        system=without_needless_turns(shift_geometry(system, at, jnp.asarray(x))),
        variables=names,
        values=drawn + x,
        drawn=drawn,
        units=units,
        covariance=covariance,
        standard_errors=np.where(unknown, np.inf, np.sqrt(np.maximum(np.diag(covariance), 0.0))),
        undetermined=tuple(n for n, u in zip(names, unknown, strict=True) if u),
        combinations=lost,
        residuals={name: residuals[name] for name in measured},
        rms={name: rms[name] for name in measured},
        chi_square=chi,
        degrees_of_freedom=freedom,
        noise=noise,
        scaled=sigma is None,
        iterations=iterations,
        converged=converged,
        failed=int((~good).sum()),
    )


def _weighted_residuals(
    asked, angles, system, at, changes, values, measured, weights
) -> tuple[Array, tuple[Array, Array]]:
    motion = asked.move(shift_geometry(system, at, changes), values)
    found = asked.read(motion)
    parts = []
    for name in sorted(measured):
        off = found[name] - measured[name]
        if name in angles:  # a reading knows no turns
            off = off - 2 * jnp.pi * jax.lax.stop_gradient(jnp.round(off / (2 * jnp.pi)))
        weight = jnp.where(_align(motion.converged, off), weights[name], 0.0)
        parts.append((weight * off).reshape(-1))
    rest = jnp.concatenate(parts)
    return rest, (rest, motion.converged)


@functools.partial(jit, static_argnums=(0, 1))
def _linearise(asked, angles, system, at, changes, values, measured, weights):
    """Weighted residuals in alphabetical order of the outputs, their Jacobian, and which poses converged."""
    slope = jax.jacfwd(_weighted_residuals, argnums=4, has_aux=True)
    slopes, (rest, good) = slope(asked, angles, system, at, changes, values, measured, weights)
    return rest, slopes, good


def _align(good: Numbers, like: Numbers) -> Numbers:
    """Poses with trailing axes, to stand beside an output."""
    return good.reshape(good.shape + (1,) * (like.ndim - good.ndim))
