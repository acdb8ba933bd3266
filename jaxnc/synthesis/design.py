"""`Design`: a mechanism that a search has found, with its practical quality."""

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from jaxnc.calls import public
from jaxnc.kinematics.motion import Motion
from jaxnc.system.system import System

if TYPE_CHECKING:
    from jaxnc.synthesis.problem import Problem

_ROUNDING = 4096  # units of rounding: no error that is smaller can be told from none


def is_rounding(problem: "Problem", error: float, dtype: np.dtype | type = np.float64) -> bool:
    """Return whether an error, in units of the target, is rounding of numbers as large as the target's.

    That of angles is at least rounding of a radian, however little they change. What has no target has no such size.
    """
    target = getattr(problem, "target", None)
    if target is None:
        return False
    size = max(problem.size, float(np.max(np.abs(target))), 1.0 if problem.unit == "rad" else 0.0)
    return bool(error <= _ROUNDING * float(np.finfo(dtype).eps) * size)


@public
@dataclasses.dataclass(frozen=True, eq=False)
class Design:
    """A design that was found.

    Attributes:
        system: the mechanism.
        motion: through the targets.
        turn: its motion over the range of the input; through the targets where there is no range.
        x: the unknowns, see `Problem.names`.
        error: what was made small: the sum of the squares of the errors (the largest error, of a minimax problem).
        rms: root of the mean of the squares of the errors without their weights, in units of the target.
        largest: the largest error without weights (of a pose with its angle as a length, see `MotionGeneration`).
        errors: at the targets, ``(targets, …)``, with their weights.
        inputs: values of the input at the targets.
        type: Grashof type of the four-bar loop at the input, "" if there is none.
        transmission: least angle at which the constraints of a loop meet over the range, or between the targets if the
            input does not go through the range, radians; NaN in space.
        turns: whether the input goes through its whole range.
        size: width and height (and depth) of everything that moves over the range.
        lengths: of its links, by the names of two points: ``"B-C"``.
        defects: what is wrong with it, in words; empty if nothing.
        binding: conditions that it just meets, unknowns at their bounds: what may hold it back.
        converged: whether its refinement came to an end: no step of second order makes it better.
        optimality: what is left of the error's gradient along all directions that conditions and bounds leave, as a
            cosine; see `jaxnc.synthesis.search.sqp`.
        feasibility: the largest violation of a condition where the search looked, in parts of the problem's size.
        iterations: of second order at the end of its refinement.
        reason: why its refinement did not come to an end, in words.
        starts: how many of the starts that were followed to their ends ended in this design, or in its continuum.
        exact: whether the targets are met but for rounding.
        freedom: in how many directions an exact design can change and still meet the targets; 0 if it stands alone. Of
            such a continuum only the best design that was found is listed.
    """

    system: System
    motion: Motion
    turn: Motion
    x: np.ndarray
    error: float
    rms: float
    largest: float
    errors: np.ndarray
    inputs: np.ndarray
    type: str
    transmission: float
    turns: bool
    size: tuple[float, ...]
    lengths: dict[str, float]
    defects: tuple[str, ...]
    binding: tuple[str, ...]
    converged: bool
    optimality: float
    feasibility: float
    iterations: int
    reason: str
    starts: int
    exact: bool = False
    freedom: int = 0

    @property
    def rank(self) -> tuple[float, ...]:
        """What designs are ordered by: those without defects first, then by error.

        The errors of exact designs are rounding: they come first, by their transmission angle and then by their size.
        """
        if not self.exact:
            return (1.0 if self.defects else 0.0, self.error, 0.0, 0.0)
        return (
            1.0 if self.defects else 0.0,
            0.0,
            -float(np.nan_to_num(self.transmission)),
            max(self.size, default=0.0),
        )

    @property
    def ending(self) -> str:
        """How its refinement ended, in words."""
        end = "converged" if self.converged else self.reason
        return f"{end}, of a continuum" if self.freedom else end
