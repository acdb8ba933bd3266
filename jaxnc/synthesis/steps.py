"""How a descent went: value and gradient of every design after every step."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jaxnc.calls import public

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@public
@dataclasses.dataclass(frozen=True, eq=False)
class Steps:
    """The history of a descent; what a design has not done, because it had come to its end, is NaN.

    Attributes:
        value: what was made small, in the unit of the error, ``(steps, lanes)``: of a problem with batches, or drawn
            anew at every step, one sample of it.
        gradient: norm of what bounds leave of the gradient, by unknowns in their scales, ``(steps, lanes)``.
        violation: largest violation of a condition, in parts of the problem's size, ``(steps, lanes)``.
        good: whether the design that was tried assembles and is finite, ``(steps, lanes)``; if not, it was taken back.
        seconds: after each step, ``(steps,)``.
        random: whether values are samples.
    """

    value: np.ndarray
    gradient: np.ndarray
    violation: np.ndarray
    good: np.ndarray
    seconds: np.ndarray
    random: bool

    @property
    def count(self) -> int:
        """How many steps there were."""
        return len(self.seconds)

    def plot(self, path: str | Path | None = None, unit: str = "") -> "Figure":
        """Draw value and gradient of all designs, step by step, on logarithmic axes; see `jaxnc.viz.synthesis`."""
        from jaxnc.viz import synthesis

        return synthesis.steps(self, path, unit)

    def saved(self) -> dict[str, np.ndarray]:
        """As arrays by name."""
        return {f"steps.{f.name}": np.asarray(getattr(self, f.name)) for f in dataclasses.fields(self)}

    @classmethod
    def read(cls, arrays: dict[str, np.ndarray]) -> "Steps | None":
        """What `saved` returned, if it is there."""
        names = [f.name for f in dataclasses.fields(cls)]
        if "steps.value" not in arrays:
            return None
        found = {name: arrays[f"steps.{name}"] for name in names}
        return cls(**{**found, "random": bool(found["random"])})
