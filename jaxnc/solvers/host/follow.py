"""Continuation on the host: branches followed by predictor and corrector, several lanes in lockstep.

The only place with step control. Every lane has its own targets, step length and state, and may have its own design;
what is evaluated is evaluated for all lanes that are still on their way at once.

Newton's method finds poses that meet the constraints or come closest to it. Solved poses change in time and with the
design by the theorem of implicit functions. Nothing is compiled.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxnc.solvers import branch
from jaxnc.solvers.host.view import (
    HostView,
    Near,
    PoseEvaluation,
    closest_changes,
    largest_of_lanes,
    pseudoinverse,
)
from jaxnc.solvers.plan import Plan
from jaxnc.system.design import Drawn
from jaxnc.system.equations import pure_numbers
from jaxnc.system.host import HostEquations
from jaxnc.system.precision import farthest

ITERATIONS = 8  # of Newton from a predicted pose, of which two are usual
SLOW = 0.5  # of a correction: so short the next one of Newton's must be, or it leads nowhere


class Closest(NamedTuple):
    """Poses that meet the constraints, or come closest to it: one for JAX, on the host lanes as last axis."""

    q: Any  # the pose, (N,), or the poses, (N, lanes)
    gap: Any  # the largest residual, a length
    # Derivatives of the rows with respect to the unknowns there, every coordinate a length, (m, n), or (lanes, m, n);
    # of a large system the non-zeros. Nothing, or None, in traced code that leaves it to the host.
    jacobian: Any


def closest(view: HostView, q: np.ndarray, iterations: int = 200) -> Closest:
    """Find the pose that meets the constraints or comes closest to it, lane by lane, by Levenberg and Marquardt.

    Freedoms may be left: then poses move as little as possible. Known coordinates of the start poses ``(N, lanes)`` are
    at their values.
    """
    plan, least, lanes = view.plan, view.least, q.shape[1]
    length = np.broadcast_to(view.eq.length, lanes)
    floor = 2.5 * least.floor * (length + view.extent(q))
    q, gap, slope = np.array(q), np.full(lanes, np.inf), np.zeros((lanes, *view.shape), q.dtype)
    rows, trial, going = np.zeros((len(plan.rows), lanes), q.dtype), np.array(q), np.arange(lanes)
    damping, cost, moved = np.full(lanes, 1e-2), np.full(lanes, np.inf), np.ones(lanes)
    for i in range(iterations):
        here = view.select(going)
        new = here.residual(trial)
        size = np.einsum("ml,ml->l", new, new)
        better = size < cost[going]
        damping[going] = np.where(
            better, np.maximum(0.1 * damping[going], least.damping), (10.0 if i else 1.0) * damping[going]
        )
        moved[going] = 1.0
        at, trial = going[better], trial[:, better]
        if len(at):
            here = view.select(at)
            if i:
                change = here.weights * (trial - q[:, at])
                moved[at] = np.sqrt(np.einsum("nl,nl->l", change, change)) / length[at]
            q[:, at], cost[at], gap[at], rows[:, at] = (
                trial,
                size[better],
                largest_of_lanes(new[:, better]),
                new[:, better],
            )
            slope[at] = here.lengths(here.matrices(trial)[0])
        on = (gap[going] > floor[going]) & (damping[going] < 1e8) & (moved[going] > 2.5 * least.floor)
        going = going[on & np.isfinite(cost[going])]
        if not len(going):
            break
        here = view.select(going)
        step = here.damped_step(slope[going], rows[:, going], damping[going]) / here.inner.reshape(
            -1, len(plan.unknown)
        )
        trial = q[:, going]
        trial[plan.unknown] -= np.where(np.isfinite(step).all(axis=1), step.T, 0.0)
    return Closest(q, gap, slope)


def assemble_closest(view: HostView, begin: np.ndarray) -> Closest:
    """Find the poses that meet the constraints and are closest to where they begin, ``(N, lanes)``."""
    found, length = closest(view, begin), np.broadcast_to(view.eq.length, begin.shape[1])
    # What has moved by 1e-6 of the size is the closest to 1e-12 already.
    far = largest_of_lanes(view.weights * (found.q - begin)) > 1e-6 * length
    which = np.flatnonzero(far & (found.gap <= view.tolerance(found.q)))
    if not len(which):
        return found
    inner, q = view.select(which), found.q[:, which]

    def distance(q: np.ndarray) -> np.ndarray:
        return np.linalg.norm(inner.weights * (q - away), axis=0)

    away, length = begin[:, which], length[which]
    before, part = np.full(len(which), np.inf), np.ones(len(which))
    for _ in range(200):
        step = inner.approach(q, away)
        size = largest_of_lanes(step * inner.unknown_weights) / length
        on = (size > view.least.accept) & (part > 1e-3)
        if not on.any():
            break
        trial = np.array(q)
        trial[inner.plan.unknown] += np.minimum(part, 0.3 / np.maximum(size, 0.3)) * np.where(on, step, 0.0)
        back = closest(inner, trial)
        good = back.gap <= inner.tolerance(back.q)
        # Where steps are so short distances are rounding: they are trusted as long as they become shorter.
        taken = on & good & ((distance(back.q) < distance(q)) | (size < np.minimum(1e-4, before)))
        q = np.where(taken, back.q, q)
        before, part = np.where(taken, size, before), np.where(taken, np.minimum(1.0, 2.0 * part), 0.5 * part)
    found.q[:, which], found.gap[which] = q, largest_of_lanes(inner.residual(q))
    found.jacobian[which] = inner.lengths(inner.matrices(q)[0])
    return found


def correct_poses(view: HostView, q: np.ndarray, close: Near | None = None) -> np.ndarray:
    """Correct poses by Newton until its steps are rounding; by the inverses of what is `near` as long as these do."""
    if q.shape[1] > view.at_once:
        some = np.array_split(np.arange(q.shape[1]), -(-q.shape[1] // view.at_once))
        return np.concatenate([correct_poses(view.select(which), q[:, which]) for which in some], axis=1)
    if q.shape[1] == 1 and view.program is not None:
        found = view.program.correct(view.eq, q, view.unknown_weights, view.least.fine, ITERATIONS)
        if found is not None:
            return found
    if close is None:
        return _newton(view, q)
    at, before, done, inverse = np.array(q), None, np.zeros(q.shape[1], bool), close.interpolated
    for _ in range(ITERATIONS):
        step = (inverse @ view.residual(at).T[:, :, None])[:, :, 0].T
        at[view.plan.unknown] -= step / view.unknown_weights
        if done.all():  # that was the last one, to rounding
            break
        size = largest_of_lanes(step) / view.eq.length
        if before is not None:  # an error shrinks by one factor in every step
            done |= size * size <= 0.1 * view.least.accept * before
            if not np.any(done | (size <= SLOW * before)):
                break
        before = size
    rest = np.flatnonzero(~done)
    if len(rest):
        at[:, rest] = _newton(view.select(rest), q[:, rest])
    return at


def _newton(view: HostView, q: np.ndarray) -> np.ndarray:
    """Correct poses by their own matrices; short corrections go by the matrices of the one before."""
    unknown, at, going = view.plan.unknown, np.array(q), np.arange(q.shape[1])
    out, solve, before = at, None, np.zeros(0)
    for _ in range(ITERATIONS):
        if view.program is not None:
            step = view.program.run(("step",), view.eq, at)[0]
        else:
            again = solve is not None
            solve = solve or view.solver(at)
            step = solve(view.residual(at))
        step = np.where(np.isfinite(step), step, 0.0)
        at[unknown] -= step
        if at is not out:
            out[:, going] = at
        size = largest_of_lanes(step * view.unknown_weights) / view.eq.length
        # With old matrices an error shrinks by one factor in every step, with its own by ever smaller ones.
        on = size > view.least.fine
        if view.program is None and again:
            on = size * size > 0.1 * view.least.accept * before
        if not on.any():
            break
        before = size
        if solve is None or size.max() > 1e-3:  # after a correction of 1e-3 of the size, its matrices do for the next
            view, going, at, before, solve = view.select(on), going[on], at[:, on], size[on], None
    return out


def pose_rates(view: HostView, q: np.ndarray, known: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Differentiate solved poses once, twice, …: all coordinates, each ``(N, lanes)``; not finite if singular.

    `known` are those of the known coordinates, each ``(known, lanes)``.
    """
    plan, solve = view.plan, view.solver(q)
    found: list[np.ndarray] = []
    for values in known:
        # The highest derivative enters the differentiated rows linearly, with the Jacobian for its factor.
        term = np.zeros_like(q)
        term[plan.known] = values
        for _ in range(1 if view.refines else 2):
            term[plan.unknown] -= solve(view.eq.rates(q, [*found, term])[plan.rows])
        found.append(term)
    return found


def start_changes(
    plan: Plan, eq: HostEquations, drawn: Drawn, q: np.ndarray, still: Sequence[int] = ()
) -> np.ndarray | None:
    """Return an assembled start pose ``(N,)`` with its changes, ``(N, 1 + changes)``; None where they are not finite.

    Nothing is driven in the plan; see `jaxnc.solvers.newton.attach_start`, also for what is `still`.
    """
    at, weight = drawn.home.copy(), eq.weights[plan.unknown]
    at[:, 0], put = q, np.isin(plan.unknown, still)
    at[plan.unknown[put], 1:] = 0.0
    slopes = eq.jacobian(q[:, None])[0][np.ix_(plan.rows, plan.unknown)] / weight
    left = eq.changes(at[:, None], (), drawn.constants)[plan.rows, 0]
    if not (np.isfinite(slopes).all() and np.isfinite(left).all()):
        return None
    if put.any():
        for some in (np.where(put, 0.0, slopes), slopes):
            step = pseudoinverse(some) @ left
            at[plan.unknown, 1:] -= step / weight[:, None]
            left = left - slopes @ step
        return at
    back, stiffness, pull = pseudoinverse(slopes), np.eye(len(weight)), np.zeros((len(weight), left.shape[1]))
    apart = weight * (drawn.home[:, 0] - q)[plan.unknown]
    if np.max(np.abs(apart), initial=0.0) > 1e-12 * eq.length:  # the rows hold it there, by forces that turn
        bend, turn = np.split(_turns_of_forces(plan, eq, drawn, at, apart @ back), [len(weight)], axis=1)
        spread = drawn.drawing[: len(plan.topology.points)]
        spread = spread - spread.mean(axis=0)
        end = spread[np.argmax(np.sum(spread[..., 0] ** 2, axis=1))]  # half a size from the middle
        growth = 4.0 * (end[:, 0] @ end[:, 1:]) / eq.length**2
        pure = pure_numbers(plan.topology)[plan.unknown]  # which count by the size
        stiffness, pull = stiffness + bend, 2.0 * np.outer(pure * apart, growth) - turn
    step = closest_changes(*(x[None] for x in (slopes, back, stiffness, pull, left)))[0]
    at[plan.unknown, 1:] += step / weight[:, None]
    return at


def _turns_of_forces(plan: Plan, eq: HostEquations, drawn: Drawn, at: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Change the rows' forces on the unknowns, lengths all, by each unknown and by a pose's changes, ``(n, n + c)``.

    The pose comes with its changes, ``(N, 1 + c)``.
    """
    unknown, n = plan.unknown, len(plan.unknown)
    weight = eq.weights[unknown]
    units = np.zeros((len(at), n))
    units[unknown, range(n)] = 1.0 / weight
    wide = np.concatenate([at[:, :1], units, at[:, 1:]], axis=1)[:, None]
    constants = [np.insert(c, [1] * n, 0.0, axis=-1) for c in drawn.constants]
    out = np.empty((n, wide.shape[2] - 1))
    for k in range(n):  # along each unknown the rows change with a velocity of one
        along = np.zeros_like(wide)
        along[unknown[k], :, 0] = 1.0 / weight[k]
        out[k] = forces @ eq.changes(wide, [along], constants)[plan.rows, 0]
    return out


def changes(
    view: HostView, drawn: Drawn, q: np.ndarray, rates: Sequence[np.ndarray] = (), known: np.ndarray | None = None
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return poses and derivatives with their changes, ``(N, lanes, 1 + changes)``; not finite at a singular position.

    The known coordinates stay, or have changes ``(known, changes)``; their rates stay. Solved poses and rates are
    ``(N, lanes)``.
    """
    plan, width = view.plan, drawn.home.shape[-1]
    matrix = view.matrices(q)[0]
    found: list[np.ndarray] = []
    for order, values in enumerate((q, *rates)):
        # The highest derivative enters the differentiated rows linearly, with the Jacobian for its factor.
        term = np.concatenate([values[..., None], np.zeros((*values.shape, width - 1), q.dtype)], axis=2)
        if not order:
            term[plan.fixed, :, 1:] = drawn.home[plan.fixed][:, None, 1:]
            if known is not None:
                term[plan.known, :, 1:] = known[:, None]
        terms = [*found, term]
        right = np.moveaxis(view.eq.changes(terms[0], terms[1:], drawn.constants)[plan.rows], 1, 0)
        term[plan.unknown, :, 1:] = -np.moveaxis(view.solve(matrix, right), 0, 1)
        found.append(term)
    return found[0], found[1:]


def unabsorbed_changes(view: HostView, drawn: Drawn, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find how far the rows change with the design, and how far no motion takes that up, ``(lanes, changes)``.

    Arguments are as of `changes`.
    """
    plan = view.plan
    at = np.concatenate([q[..., None], np.zeros((*q.shape, drawn.home.shape[-1] - 1), q.dtype)], axis=2)
    at[plan.fixed, :, 1:] = drawn.home[plan.fixed][:, None, 1:]
    change = np.moveaxis(view.eq.changes(at, (), drawn.constants)[plan.rows], 1, 0)
    basis = np.linalg.qr(view.matrices(q)[0] / view.inner)[0]
    rest = change - basis @ (np.swapaxes(basis, 1, 2) @ change)
    return np.linalg.norm(change, axis=1), np.linalg.norm(rest, axis=1)


# -- continuation ------------------------------------------------------------------------------------------------------


class Followed(NamedTuple):
    """Where branches were followed to; lanes are the last axis.

    Attributes:
        poses: ``(T, N, lanes)``; those from `reached` on are not set.
        slopes: derivatives of the unknown coordinates with respect to the driven ones, ``(T, n, driven, lanes)``.
        reached: how many of the targets were reached, ``(lanes,)``.
        limit: whether the branch ends at the target, ``(T, lanes)``.
        crossed: whether it is a singular position where branches cross, ``(T, lanes)``.
        last: the last pose on the branch, ``(N, lanes)``.
        exhausted: whether it was given up for the number of evaluations, not because the branch ends.
    """

    poses: np.ndarray
    slopes: np.ndarray
    reached: np.ndarray
    limit: np.ndarray
    crossed: np.ndarray
    last: np.ndarray
    exhausted: np.ndarray


class _Lanes:
    """The lanes that are on their way; lanes are the last axis of every array.

    Attributes:
        which: their numbers.
        values: known coordinates they go to, ``(T, known, lanes)``.
        target, final: which of these they are on the way to, and which is their last.
        onward, aside: behind each of these, how far the next way leads on, as a part of the way before, and whether it
            leads aside, ``(T, lanes)``.
        origin, way_end: known coordinates where that way begins and ends, and
        way: their change along it.
        s, h, reach: the part of the way that is done, the next step, and where the current trial is.
        q, guess: the current iterate, and what it was predicted to be.
        base: the last accepted pose, and there:
        slope, slopes: derivatives of all coordinates along the way, and of the unknown ones by the driven ones;
        curve, twist: half the second and a sixth of the third derivative along the way, by the last step, and
        back: how long a step that was, as a part of the way;
        signs, sizes: of the determinants of the diagonal blocks, and
        greatest: the largest sizes that the lane has met, or its design has as drawn; or
        reference: the matrix, where there are more rows than unknowns;
        level: sizes of the determinants there, relative to the largest that were met;
        rise: relative change of the determinants per part of the way, in the last step;
        usual: speed along the way where it began.
        leapt: whether a step over a singular position was tried from the base.
        corrections, corrected: how many the current trial has had, and how long the last was.
    """

    def __init__(self, view: HostView, start: np.ndarray, values: np.ndarray, counts: np.ndarray):
        n, driven, count = len(view.plan.unknown), len(view.plan.driven), values.shape[2]
        blocks = len(view.plan.sequence) if view.plan.square else 1
        self.which, self.values = np.arange(count), values
        self.target, self.corrections = np.zeros(count, int), np.zeros(count, int)
        self.final = counts - 1
        self.origin, self.way_end = start[view.plan.known], values[0]
        self.way, self.back, self.corrected = self.way_end - self.origin, np.zeros(count), np.zeros(count)
        self.onward, self.aside = _find_corners(self.origin, values)
        self.s, self.h, self.reach, self.usual = np.zeros(count), np.ones(count), np.zeros(count), np.zeros(count)
        self.q = self.guess = self.base = start
        self.slope, self.slopes = np.zeros_like(start), np.zeros((n, driven, count))
        self.curve, self.twist = np.zeros_like(start), np.zeros_like(start)
        self.signs, self.sizes, self.rise = (
            np.ones((blocks, count)),
            np.zeros((blocks, count)),
            np.zeros((blocks, count)),
        )
        self.level, self.leapt = np.ones((blocks, count)), np.zeros(count, bool)
        self.greatest = _drawn_sizes(view, start, blocks)
        self.reference = np.zeros((*(view.shape if view.redundant else (0,)), count))

    def keep(self, which: np.ndarray) -> None:
        """Go on with some of them only."""
        for name, numbers in vars(self).items():
            setattr(self, name, numbers[..., which])


def _drawn_sizes(view: HostView, start: np.ndarray, blocks: int) -> np.ndarray:
    """Return logarithms of the determinants of lanes' designs as they are drawn, ``(blocks, lanes)``.

    What is small beside them is small wherever a way begins, and whatever other lanes meet. Where all begin as drawn
    they are found on the way.
    """
    home = view.eq.home.reshape(len(start), -1)
    if view.redundant or np.array_equal(start, np.broadcast_to(home, start.shape)):
        return np.full((blocks, start.shape[1]), -np.inf)
    sizes = view.evaluate(home).sizes
    return np.repeat(np.where(np.isfinite(sizes), sizes, -np.inf), start.shape[1] // home.shape[1], axis=1)


def _find_corners(origin: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find how far the way behind each value of sequences leads on, and whether it leads aside, ``(T, lanes)``.

    So does one behind a way that is so short that it tells nothing.
    """
    ways = np.diff(values, axis=0, prepend=origin[None], append=values[-1:])
    before, ahead = ways[:-1], ways[1:]
    square, along = np.sum(before * before, axis=1), np.sum(before * ahead, axis=1)
    aside = along * along < 0.99 * square * np.sum(ahead * ahead, axis=1)
    # of a way 100 times as long as the one before nothing is known
    aside |= square * 100.0**2 < np.sum(ahead * ahead, axis=1)
    return along / np.where(square > 0.0, square, 1.0), aside


def follow(view: HostView, start: np.ndarray, values: np.ndarray, counts: np.ndarray | None = None) -> Followed:
    """Follow branches from poses through sequences of input values.

    A step is accepted by `jaxnc.solvers.branch`; the other branch, which lies across a fold, is never taken for
    this one, nor its mirror image behind a narrow gap. Where branches cross (a change point), the motion goes on along
    its tangent.

    Args:
        view: what is solved for, of one design or of as many as there are lanes.
        start: poses that meet the constraints, ``(N, lanes)``.
        values: known coordinates to go to, one after the other, ``(T, known, lanes)``.
        counts: how many of them each lane goes to, at least one, ``(lanes,)``; all if not given.
    """
    total, _, count = values.shape
    n, driven = len(view.plan.unknown), len(view.plan.driven)
    out = Followed(
        np.zeros((total, *start.shape), start.dtype),
        np.zeros((total, n, driven, count), start.dtype),
        np.zeros(count, int),
        np.zeros((total, count), bool),
        np.zeros((total, count), bool),
        np.array(start),
        np.zeros(count, bool),
    )
    # 250 evaluations for each target, besides those for the way between them
    # and 50_000 for the way between them: about 25 for each radian that something turns
    most, counts = 250 * total + 50_000, np.full(count, total) if counts is None else counts
    values, counts, asked = _cut_off(view, start, values, counts, most)
    lanes = _Lanes(view, start, values, counts)
    for _ in range(most):
        if not len(lanes.which):
            beyond = out.reached > asked
            out.exhausted[beyond], out.reached[beyond] = True, asked[beyond]
            return out
        over = _evaluate_step(view, lanes, out)
        if over.any():
            lanes.keep(~over)
            view = view.select(~over)
    out.exhausted[lanes.which] = True
    out.last[:, lanes.which] = lanes.base
    return out


def _cut_off(
    view: HostView, start: np.ndarray, values: np.ndarray, counts: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cut sequences of inputs ``(T, known, lanes)`` off where they go farther than can be followed.

    That is where at least as many steps would be needed as there may be evaluations, `most`, and where angles are so
    large that their turns cannot be told apart. Of the way there the beginning is kept.

    Returns:
        The values; how many of them each lane has, ``(lanes,)``; and how many of these are as asked for.
    """
    ways = np.diff(values, axis=0, prepend=start[view.plan.known][None])
    steps = np.stack([1.0 / branch.longest(view.plan, way) for way in ways])
    far = steps > most
    if view.plan.angles:
        angles = np.abs(values[:, view.plan.angles])
        far |= ((angles > farthest(view.eq.home)) & np.isfinite(angles)).any(axis=1)
    far &= np.arange(len(values))[:, None] < counts
    lanes = np.flatnonzero(far.any(axis=0))
    if not len(lanes):
        return values, counts, counts
    values, asked, at = values.copy(), counts.copy(), np.argmax(far[:, lanes], axis=0)
    # 60 radians of a way that is too far: so far it is followed, as its branch may end there
    part = np.minimum(1.0, 60.0 / (steps[at, lanes] * branch.TURN))
    values[at, :, lanes] += ((part - 1.0) * ways[at, :, lanes].T).T
    asked[lanes] = at
    counts = np.where(asked < counts, asked + 1, counts)
    return values, counts, asked


def _evaluate_step(view: HostView, st: _Lanes, out: Followed) -> np.ndarray:
    """Evaluate once in every lane: its trial is accepted, given up or corrected. Return which lanes are over."""
    least, weight, length = view.least, view.weights, view.eq.length
    seen, part = view.evaluate(st.q), st.reach - st.s
    finite = np.isfinite(seen.step).all(axis=0) & np.isfinite(seen.slopes).all(axis=(0, 1))
    correction = view.norm(view.unknown_weights, seen.step)
    level, ratio = _level(view, st, seen)
    # Close to a singular position a small residual says little: the next correction has to be small too. Far from one
    # it is told by the last two, whose squares it goes by; but for redundant rows, which may contradict each other.
    met = largest_of_lanes(seen.residual) <= view.tolerance(st.q)
    met &= correction <= least.close * length
    short = 1e-4  # of the size: a shorter correction may be the last, if the one before says so
    squared = correction**3 <= min(1e2 * least.accept, 0.1 * short) * length * st.corrected**2
    squared &= (correction <= short * length) & (level >= branch.CLEAR).all(axis=0) & (not view.redundant)
    converged = finite & (met | squared)
    moved = np.array(st.q)
    moved[view.plan.unknown] -= np.where(finite, seen.step, 0.0)
    # 6 corrections of Newton, before a step is given up
    hopeless = (st.corrections >= 6) | ((st.corrections > 0) & (correction > SLOW * st.corrected))
    stopped = converged | ~finite | hopeless
    st.corrections, st.corrected = st.corrections + 1, correction
    if not stopped.any():
        st.q = moved
        return stopped

    fresh, base = part == 0.0, np.where(met, st.q, moved)
    new_slope = _change_along(view, seen.slopes, st.way)
    speed, after = view.norm(weight, st.slope), view.norm(weight, new_slope)
    corrected, bend = view.norm(weight, base - st.guess), part * view.norm(weight, new_slope - st.slope)
    kink = view.norm(weight, base - st.base - 0.5 * part * (new_slope + st.slope))
    trial = branch.TrialStep(
        part, part * speed, corrected, bend, part * after, kink, ratio, level, part * st.rise, fresh
    )
    good = converged & branch.is_accepted(trial, least, length)
    edge = converged & ~good
    if edge.any():
        move, tangents = base - st.base, (part * st.slope, part * new_slope)
        edge &= branch.is_edge(trial, least, length, lambda: _corner(weight, move, *tangents))
        good |= edge
    if good.any():
        good &= view.upright(base)
    bad = ~good & stopped
    st.corrections, st.corrected = np.where(stopped, 0, st.corrections), np.where(stopped, 0.0, st.corrected)

    over_it = branch.crossing(speed, least, length)
    leap = bad & ~fresh & ~st.leapt & (0.25 * part <= over_it)
    shortened = (st.s == 0.0) & (part == branch.SHORT)
    longer = np.minimum(np.where(shortened, 1.0, 2.0 * st.h), branch.next_step(trial, least, length))
    longer = np.where(fresh, branch.SHORT, longer)
    across = branch.leap(over_it, st.rise, least)
    st.h = np.where(good, longer, np.where(leap, across, np.where(bad, 0.25 * part, st.h)))
    leaving = st.s == 0.0
    # Just before a fold steps are short as parts of the way, not as lengths: a target that lies there is gone on to.
    near = (1.0 - st.s < least.touch) & (st.h > least.whole) & (st.h * speed > least.crossing * length)
    # 1e-3 of the smallest step: so short a one may lead away from a limit that was touched
    ended = bad & ~leap & (fresh | (~near & (st.h < least.smallest * np.where(leaving, 1e-3, 1.0))))
    vague = np.zeros(len(good), bool)
    if good.any():
        chosen = _chooser(good)
        rise = (ratio - 1.0) / ratio / part
        st.rise = chosen(np.where(np.isfinite(rise) & ~edge, rise, 0.0), st.rise)
        st.usual = np.where(good & fresh & (st.s == 0.0), after, st.usual)
        st.curve, st.twist = (np.where(edge, 0.0, x) for x in _bend(st, base, new_slope, part, good & ~fresh))
        st.back, st.level = chosen(part, st.back), np.where(good & ~fresh, np.minimum(level, 1.0), st.level)
        st.s, st.base = chosen(st.reach, st.s), chosen(base, st.base)
        vague = good & ~fresh & (st.s >= 1.0) & (st.level < branch.CLEAR).any(axis=0)
        if vague.any():
            vague[vague] = view.select(vague).conditioning(base[:, vague]) <= least.singular
        # At a singular position derivatives are made of rounding: those of the pose before it stay.
        told = _chooser(good & ~vague)
        st.slope, st.slopes = told(new_slope, st.slope), told(seen.slopes, st.slopes)
        if seen.matrix is not None:
            st.reference = chosen(seen.matrix, st.reference)
        else:
            st.signs, st.sizes = chosen(seen.signs, st.signs), chosen(seen.sizes, st.sizes)
            st.greatest = np.maximum(st.greatest, np.where(good, seen.sizes, -np.inf))
    st.leapt = ~good & (leap | st.leapt)
    over, back = _arrive(view, st, out, good, vague, ended & ~fresh, ended, speed, over_it)

    chosen = _chooser(stopped)
    reach = st.s + np.minimum(np.minimum(st.h, 1.0), branch.longest(view.plan, st.way))
    reach = np.where(reach >= 1.0 - least.whole, 1.0, reach)
    st.reach = chosen(np.where(back, 0.0, reach), st.reach)
    predicted = _predict(view, st)
    if back.any():
        predicted = np.where(back, st.base, predicted)
    st.q, st.guess = chosen(predicted, moved), chosen(predicted, st.guess)
    return over


def _corner(w: np.ndarray, move: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Measure how far moves are from such as go along one tangent first and along the other then, ``(lanes,)``."""
    turn, rest = w * (after - before), w * (move - before)
    square = np.sum(turn * turn, axis=0)
    share = np.clip(np.sum(turn * rest, axis=0) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    return np.sqrt(np.sum((rest - share * turn) ** 2, axis=0))


def _chooser(lanes: np.ndarray) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Make the function that takes one array in these lanes and another in the others."""
    return (lambda here, _: here) if lanes.all() else (lambda here, there: np.where(lanes, here, there))


def _bend(
    st: _Lanes, base: np.ndarray, slope: np.ndarray, part: np.ndarray, good: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find how the way bends at a new pose, by the cubic through it and the last one with the tangents of both."""
    p, chosen = np.where(good, part, 1.0), _chooser(good)
    chord = (base - st.base) / p
    both = slope + st.slope
    curve, twist = (both + slope - 3.0 * chord) / p, (both - 2.0 * chord) / (p * p)
    return chosen(curve, st.curve), chosen(twist, st.twist)


def _predict(view: HostView, st: _Lanes) -> np.ndarray:
    """Predict poses where the trials are, by the cubic behind, or by a parabola where the last step was far shorter."""
    known = np.where(st.reach == 1.0, st.way_end, st.origin + st.reach * st.way)
    a = st.reach - st.s
    cubic = a <= 4.0 * st.back  # beyond 4 times the last step its cubic is not trusted
    curve, twist = np.where(cubic, st.curve, st.curve - 1.5 * st.back * st.twist), np.where(cubic, st.twist, 0.0)
    predicted = st.base + a * (st.slope + a * (curve + a * twist))
    return view.join(predicted[view.plan.unknown], known, st.base)


def _arrive(
    view: HostView,
    st: _Lanes,
    out: Followed,
    good: np.ndarray,
    vague: np.ndarray,
    stopped: np.ndarray,
    ended: np.ndarray,
    speed: np.ndarray,
    over_it: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Send lanes on that have arrived or can go no further; return which are over, and which turn back."""
    least, weight, length = view.least, view.weights, view.eq.length
    arrived = good & (st.s >= 1.0)
    touched = stopped & ((1.0 - st.s < least.touch) | (1.0 - st.s <= 4.0 * over_it))
    visited = arrived | touched
    none = np.zeros(len(good), bool)
    if not visited.any():
        out.last[:, st.which[ended]] = st.base[:, ended]
        return ended, none
    aim, way, lane = st.way_end, st.way, np.arange(len(good))
    # Towards the end of a branch the pose changes ever faster; where branches cross it does not.
    crossed = touched & (speed <= branch.FAST * st.usual)
    if crossed.any():
        # 1e-3 of the mechanism's size: so far from a crossing is its pose read off the branch
        before = (1e-3 * length / speed)[crossed]
        at = st.base[:, crossed], st.slopes[:, :, crossed], way[:, crossed], (1.0 - st.s)[crossed]
        st.base[:, crossed], rate = _crossing_poses(view.select(crossed), *at, before, aim[:, crossed])
        # Next to a crossing derivatives are made of rounding: along the way they are those read off, too.
        slopes, along = st.slopes[:, :, crossed], way[: st.slopes.shape[1], crossed]
        off = rate[view.plan.unknown] - np.sum(slopes * along, axis=1)
        st.slopes[:, :, crossed] = slopes + off[:, None] * along / np.maximum(np.sum(along * along, axis=0), least.tiny)
    at_end, following = st.target >= st.final, np.minimum(st.target + 1, st.final)
    onward, aside = st.onward[st.target, lane], st.aside[st.target, lane]
    # A limit may be touched, not passed: it goes on afresh, only if the way turns back. A crossing is passed.
    back = touched & ~crossed & ~at_end & (onward < 0.0)
    through = crossed & ~at_end
    onwards = (arrived & ~at_end) | back | through
    over = (visited & at_end) | (ended & ~back & ~through)
    _note_arrivals(st, out, visited, over, touched & ~crossed, crossed)
    if onwards.any():
        chosen, straight = _chooser(onwards), arrived & ~aside
        st.origin = chosen(np.where(back, st.base[view.plan.known], aim), st.origin)
        st.way_end, st.target = chosen(st.values[following, :, lane].T, aim), chosen(following, st.target)
        st.way, st.s = chosen(st.way_end - st.origin, way), np.where(onwards, 0.0, st.s)
        st.slope, st.rise = chosen(_change_along(view, st.slopes, st.way), st.slope), chosen(st.rise * onward, st.rise)
        factor = np.where(onwards, np.where(straight, onward, 0.0), 1.0)
        st.curve, st.twist = st.curve * (factor * factor), st.twist * (factor * factor * factor)
        shorter = np.abs(np.where(straight & onwards & (onward != 0.0), onward, 1.0))
        fast = view.norm(weight, st.slope)
        st.back, st.usual, st.leapt = st.back / shorter, chosen(fast, st.usual), st.leapt & ~onwards
        # Onwards from a crossing by a step that leads clear of it, on another way by a short one.
        clear = branch.crossing(fast, least, length)
        st.h = np.where(through | vague, clear, np.where(arrived & aside, branch.SHORT, st.h / shorter))
    return over, back


def _level(view: HostView, st: _Lanes, seen: PoseEvaluation) -> tuple[np.ndarray, np.ndarray]:
    """Return sizes of determinants relative to the largest that a lane has met, and to those at the last pose."""
    if seen.matrix is not None:
        ratio = view.relative(np.moveaxis(seen.matrix, -1, 0), np.moveaxis(st.reference, -1, 0))[None]
        return np.abs(ratio) * st.level, ratio
    level = np.exp(seen.sizes - np.maximum(st.greatest, seen.sizes))
    return level, seen.signs * st.signs * np.exp(seen.sizes - st.sizes)


def _note_arrivals(st: _Lanes, out: Followed, visited, over, limit, crossed) -> None:
    """Note the poses of targets that were reached, and where lanes ended."""
    if visited.any():
        lane, place = st.which[visited], st.target[visited]
        out.poses[place, :, lane] = st.base[:, visited].T
        out.slopes[place, :, :, lane] = st.slopes[..., visited].transpose(2, 0, 1)
        out.limit[place, lane], out.crossed[place, lane] = limit[visited], crossed[visited]
        out.reached[lane] = place + 1
    if over.any():
        out.last[:, st.which[over]] = st.base[:, over]


def _crossing_poses(
    view: HostView,
    q: np.ndarray,
    slopes: np.ndarray,
    way: np.ndarray,
    rest: np.ndarray,
    before: np.ndarray,
    aim: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Find poses where branches cross, and how they change along the way there.

    Both by Taylor's series from a little before, where poses are well determined.
    """
    begin = q - (before - rest) * _change_along(view, slopes, way)
    begin[view.plan.known] = aim - before * way
    begin = correct_poses(view, begin)
    still = np.zeros_like(way)
    terms = pose_rates(view, begin, [way, still, still])
    out = begin + sum(before**k / math.factorial(k) * term for k, term in enumerate(terms, start=1))
    out[view.plan.known] = aim
    return out, np.sum([before**k / math.factorial(k) * term for k, term in enumerate(terms)], axis=0)


def _change_along(view: HostView, slopes: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Return the change of all coordinates ``(N, lanes)`` along ways of the known ones ``(known, lanes)``."""
    out = np.zeros((len(view.eq.home), way.shape[1]), slopes.dtype)
    out[view.plan.unknown] = np.sum(slopes * way[: slopes.shape[1]], axis=1)
    out[view.plan.known] = way
    return out
