"""What counts as the same branch: every number of that test, for NumPy, for XLA and for the script of a page.

Steps of the host are judged by `is_accepted` and `is_edge`; poses that are solved side by side by `steady` and
`smooth`, in both libraries. A page checks fewer things, in shorter steps, with what `page_numbers` hands to its script.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxnc.solvers.plan import Plan
from jaxnc.system.precision import Limits, limits
from jaxnc.types import AnyArray, Numbers

# A correction beside the step that it belongs to.
SHARP = 0.2  # a correction may be this part of a step that was predicted along the tangent
EXTRAPOLATED = 0.5  # and this part of one that was predicted from the two poses before
STRAY = 0.05  # of the size: where one pose after the other is taken on trust, a shorter correction leads nowhere else
KINK = 0.03  # times the predicted step: so far may the mean of both tangents lead from where it ends
NEAR = 0.1  # of the way between two anchors: so far may a pose lie from where they place it

# Determinants of the diagonal blocks.
REBOUND = 0.3  # of a determinant: less was expected of it, so that it has been thrown back behind a gap
DROP = 0.1  # of a determinant: a step that leaves less of it ends beside a change point, on either branch
LANDING = 0.1  # of the determinant that a step may begin from: so little may be left of it behind a singular position
CLEAR = 1e-3  # of the largest determinant: where all are larger, Newton's corrections are squares of one another

# How long steps may be.
SHORT = 1e-3  # of a step: a first one, that shows in which direction determinants change
FIRST = 0.25  # of the size: the first step from the start pose is shorter
STEP = 0.4  # radians that a driven angle turns in a step: a change point behind a longer one may not be seen
TURN = 1.0  # the same where steps are controlled: in a longer one, all signs may agree behind a gap by chance
TURNING = 64  # steps at least for a sequence of values whose steps are not controlled, so that none is long
LEADING = 16  # and from the start pose to the first of these values
EASY = 0.85  # of what a step may bend is aimed at
FOLDING = 0.2  # times what determinants say of a fold: so much of it the speed has to say too
LEFT = 0.5  # of the way to a fold is gone in a step: the tangent then changes by what is aimed at
FAST = 30.0  # times its usual speed: towards a fold the pose changes as one over a root, at a crossing it does not
PAGE_TURN = 0.7  # radians of a page's first step: it sees less of a branch than the host does, and tries again
PAGE_SHORTEST = 1e-8  # of the first step: where a page's steps are shorter, the branch ends
PAGE_STEPS = 500  # at most for each such first step: along a dead point steps stay short


def parts_of_way(steps: int) -> np.ndarray:
    """Return where equal steps on a way end, with a short one in front that shows how determinants change."""
    return np.append(SHORT, np.arange(1, steps + 1)) / steps


def page_numbers() -> dict[str, float]:
    """Return the numbers by which the script of a page tells branches apart, by their names in the script."""
    least = limits(np.zeros(0))
    lengths = {"ACCEPT": least.accept, "ROUNDING": least.rounding, "CLOSE": least.close, "CROSSING": least.crossing}
    steps = {"FIRST": FIRST, "TURN": PAGE_TURN, "SHORTEST": PAGE_SHORTEST, "STEPS": PAGE_STEPS}
    return {**lengths, **steps, "SHARP": SHARP}


class TrialStep(NamedTuple):
    """A trial step; all ``(lanes,)``, those about determinants ``(blocks, lanes)``."""

    part: np.ndarray  # the part of the way that it makes
    expected: np.ndarray  # its length as predicted
    corrected: np.ndarray  # how far the corrector moved it
    bend: np.ndarray  # how much the tangent differs at its ends, times its length
    after: np.ndarray  # its length by the tangent at its end
    kink: np.ndarray  # how far from its end the mean of both tangents leads: of third order where it is smooth
    ratio: np.ndarray  # determinants of the diagonal blocks at its end, relative to its beginning
    level: np.ndarray  # the same relative to the largest that the way has seen, sizes only
    rise: np.ndarray  # what the step before says that they change by, relative
    fresh: np.ndarray  # whether it has no length: a pose where a way begins


def is_accepted(step: TrialStep, least: Limits, length: float) -> np.ndarray:
    """Say whether a converged step stays on its branch.

    Its correction is small beside it and so is the change of the tangent, which comes gradually, not in a kink behind a
    gap; no determinant changes its sign, vanishes, or is thrown back from where it was falling to. Only the shortest of
    steps may cross a singular position: what is left of a gap there is below what can be told from a point where
    branches cross.
    """
    slack = least.close * length
    close = step.corrected <= SHARP * step.expected + slack
    even = step.fresh | smooth(step.bend, step.kink, step.expected + step.after, slack)
    keeps = _keeps_signs(step)
    # Nearer to a singular position rounding decides; where a step over one ends may be nearer than where it began.
    regular = np.all(step.level >= np.where(keeps, 1.0, LANDING) * least.crossing, axis=0)
    return close & even & (step.fresh | ((keeps | _is_short(step, least, length)) & regular))


def is_edge(step: TrialStep, least: Limits, length: float, corner: Callable[[], np.ndarray]) -> np.ndarray:
    """Say whether a step that is not accepted goes over an edge of the constraints themselves, such as that of a cam.

    A motion turns there and is continuous: the shortest of steps ends where the one tangent leads, and behind some
    place the other. `corner` says how far from there; where a motion jumps, no turn accounts for it. The step is short
    as a length: where the pose gets ever faster, as on a vertical profile, the shortest of steps is a long one.
    """
    maybe = np.maximum(step.expected, step.after) <= 10.0 * least.crossing * length
    maybe &= _keeps_signs(step) & ~step.fresh & np.all(step.level >= least.crossing, axis=0)
    if maybe.any():
        maybe &= corner() <= KINK * (step.expected + step.after) + least.close * length
    return maybe


def _keeps_signs(step: TrialStep) -> np.ndarray:
    return np.all((step.ratio >= 0.0) & (1.0 + step.rise >= REBOUND * step.ratio), axis=0)


def _is_short(step: TrialStep, least: Limits, length: float) -> np.ndarray:
    return (step.expected <= 20.0 * least.crossing * length) | (step.part <= 10.0 * least.smallest)


def smooth(bend: Numbers, kink: AnyArray, lengths: AnyArray, slack: AnyArray) -> np.ndarray:
    """Say whether the change of a tangent in a step is small and comes gradually; `lengths` is the step's by both."""
    return (bend <= SHARP * lengths + slack) & (kink <= KINK * lengths + slack)


def steady(
    new: Sequence[AnyArray] | AnyArray,
    now: Sequence[AnyArray] | AnyArray,
    rise: Sequence[AnyArray] | AnyArray,
    share: Numbers,
) -> AnyArray:
    """Say whether determinants go on as they did, lane by lane.

    Where a branch ends and its mirror image begins again soon afterwards, no orientation changes between a pose before
    and a pose behind the gap; but a determinant that fell towards zero has been thrown back. So it is where branches
    cross, unless the step ends close behind the crossing.

    `new` and `now` are determinants of the blocks after a step and before it, `rise` is their change in the step
    before, and `share` the length of this step in terms of that one.
    """
    numeric: Any = np if isinstance(share, np.ndarray) else jnp
    ok = numeric.ones(numeric.shape(share), bool)
    for a, b, d in zip(new, now, rise, strict=True):
        size = numeric.abs(a)
        ok = ok & ((b + share * d) * numeric.sign(a) >= REBOUND * size) & (size >= DROP * numeric.abs(b))
    return ok


def next_step(step: TrialStep, least: Limits, length: float) -> np.ndarray:
    """The part of the way after which the tangent will have changed by what it may, going by the last step.

    Towards a fold the pose changes as the root of what is left of the way. Its speed says how much that is, and where
    the speed begins to grow so do the determinants, sooner.
    """
    allowed = EASY * (SHARP * (step.expected + step.after) + least.close * length)
    grown = (step.after / np.maximum(step.expected, least.tiny)) ** 2 - 1.0
    shrunk = np.maximum(np.min(np.abs(step.ratio), axis=0, initial=np.inf), least.tiny) ** -2.0 - 1.0
    grown = np.where(grown > FOLDING * shrunk, np.maximum(grown, shrunk), grown)
    # The last of these steps leads beyond the fold, and so says that the branch ends.
    left = np.maximum(step.part * LEFT / np.maximum(grown, least.tiny), 2.0 * least.smallest)
    return np.minimum(left, step.part * allowed / np.maximum(step.bend, least.tiny))


def crossing(speed: np.ndarray, least: Limits, length: float) -> np.ndarray:
    """The part of a way that a step makes which may cross a singular position, from the speed along the way."""
    return 5.0 * least.crossing * length / np.maximum(speed, least.tiny)


def leap(over_it: np.ndarray, rise: np.ndarray, least: Limits) -> np.ndarray:
    """The part of a way that a step over a singular position makes.

    It ends as far behind as it begins before, as determinants fall by what they `rise` for a part of the way.
    """
    falling = np.max(-rise, axis=0, initial=0.0)
    # up to 3 times as long where they fall slowly
    return np.clip(2.0 / np.maximum(falling, least.tiny), over_it, 3.0 * over_it)


def longest(plan: Plan, way: np.ndarray) -> np.ndarray:
    """The part of ways ``(known, lanes)`` that may be gone in one step."""
    turned = np.max(np.abs(way[plan.angles]), axis=0, initial=0.0)
    return TURN / np.maximum(turned, TURN)
