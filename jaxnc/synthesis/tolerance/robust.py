"""Robust design: a statistic of an output over sampled tolerances, as an objective that can be differentiated."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import shapes_of
from jaxnc.errors import InputError
from jaxnc.kinematics.inputs import whole
from jaxnc.kinematics.motion import Motion
from jaxnc.synthesis.tolerance.sampling import Question, make_question, read_variation, solve_batch
from jaxnc.synthesis.validate import as_seed
from jaxnc.system.system import System
from jaxnc.types import Array, ArrayLike, Inputs

STATISTICS = ("mean", "std", "variance", "percentile", "worst")


@public
@dataclasses.dataclass(frozen=True)
class Robust:
    """A statistic of one number over the same sampled deviations of every design: call it with a system.

    It is pure: ``jax.grad(measure)(system)``, ``jax.jit``, ``jax.vmap`` work. A sample that does not assemble counts as
    the worst of those that do, and every one adds its part of `penalty`, so that failing never pays; where none
    assembles the value is infinite.
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
        worst = jax.lax.stop_gradient(jnp.where(some, worst, 0.0))
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
