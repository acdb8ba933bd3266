"""Fit hundreds of linkages to a curve at once: least squares of distances, with timings, place and size eliminated.

Distances count both ways: from target points to the curve, and from the curve to the polyline of the target. Where the
crank is when the point passes a target is no unknown: it is the foot of a perpendicular, and to first order a distance
does not change with it. A cubic through four poses stands for the curve there, so that the poses of one turn give all
distances, and one reverse sweep over the dyads gives all derivatives; they are exact, or steps would end short of the
minimum. Place, turn and size of the linkage are four columns beside it. Points that shall be met but for rounding have
poses of their own.

Method: K. Levenberg (1944), D. Marquardt (1963); variable projection as G. Golub and V. Pereyra, SIAM J. Numer. Anal.
10 (1973).
"""

import functools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import jit
from jaxnc.solvers.dense import cholesky_solve
from jaxnc.synthesis.tracing.chains import GROUND, KINDS, ChainArrays
from jaxnc.synthesis.tracing.curves import EACH, Frame, Traced, Walls, gaps, link_corners, move, redraw
from jaxnc.types import Array

_RRR, _PRP = KINDS.index("RRR"), KINDS.index("PRP")
WHOLE = 4  # numbers of place, turn and size: x, y, and the factor as a complex number
_GROW, _SHRINK = 4.0, 0.3  # of the damping
# Distances to the nearest point have kinks, at which steps that only go down end. So a step may go up, to so many times
# the least cost. The same number of steps then brings root mean squares 6 % further down, 12 % of designs not yet good.
_UPHILL = 2.0
_RENEW = 12  # steps after which poses are chosen anew, since designs make use of where they are
_FIRST, _LEAST_DAMPING, _MOST_DAMPING = 1e-2, 1e-14, 1e8
# Weights of a dyad that does not close against a distance of the target's size: on the way, where a larger one holds
# designs back, and at the end, when they shall meet what is asked.
CLOSING, FIRM = 3.0, 30.0
COUNT = 64  # corners of a target, and poses of the crank at which a design is looked at
_LAGRANGE = np.array([[6, 0, 0, 0], [-11, 18, -9, 2], [6, -15, 12, -3], [-1, 3, -3, 1]]) / 6  # by power, then by corner
_NEAR = 1e-3  # sizes of the target: distances below count by their squares all the same
_BEGINS = 64  # places of the crank that are tried as the begin of given timings
_TOGETHER = 16  # designs that are calculated side by side: their numbers stay in the processor's cache
_REACH = 20.0  # sizes of the target: no number of a design that was drawn is longer


class Target(NamedTuple):
    """A curve as corners, in units of its size about its centre."""

    points: Array  # (COUNT, 2)
    weight: Array  # of each, together 1, (COUNT,)
    closed: Array  # whether the last corner is joined to the first: 1 or 0
    both: Array  # how much the way from the curve to the target counts
    mean: Array  # whether distances count rather than their squares: 1 or 0
    sine: Array  # what the square of the sine of a transmission angle shall be at least
    longest: Array  # what a link shall measure at most
    timing: Array  # of the crank at the points, counted from its begin, (COUNT,)
    timed: Array  # whether that is asked for: 1 or 0
    ground: Array  # a box in which the pivots of the ground shall be: lower and upper corner, (2, 2)
    closing: Array  # weight of a dyad that does not close
    walls: tuple[Walls, ...] = ()  # what links shall keep clear of


class Lanes(NamedTuple):
    """Designs on their way; the first axis is that of designs."""

    chain: ChainArrays
    sign: Any  # (N, dyads)
    row: Any  # the design, then place and factor, then where the crank begins and how far it goes, (N, 6 dyads + 8)


class Course(NamedTuple):
    """Where the steps of a design have come."""

    row: Array  # the design here
    cost: Array  # sum of squares of what it misses, its penalties included
    matrix: Array  # of the normal equations here
    slope: Array
    damping: Array
    best: Array  # the best row so far
    least: Array  # its cost
    error: Array  # its mean square of the distances alone


@functools.partial(jit, static_argnums=(1,))
def trace_curves(lanes: Lanes, count: int, closed: Array) -> tuple[Array, Array]:
    """Move designs over their ranges.

    Args:
        lanes: the designs.
        count: how many poses, evenly by the angle of the crank.
        closed: 1 where the crank turns all round, and the last pose is not the first one again; else 0.

    Returns:
        Points of the curves in the units of the target, ``(N, count, 2)``, and the squares of the sines of their
        smallest transmission angles, below zero where a dyad does not close, ``(N,)``.
    """
    go = jnp.all(jnp.isfinite(lanes.row[0]))

    def one(chain: ChainArrays, sign: Array, row: Array) -> tuple[Array, Array]:
        share = jnp.arange(count) / jnp.where(closed > 0, count, count - 1.0)
        traced = move(chain, sign, row[:-6], row[-2] + row[-1] * share, go)
        return _put(row, traced.point).T, jnp.min(traced.sine)

    return jax.vmap(one)(*lanes)


@functools.partial(jit, static_argnums=(1,))
def least_gaps(lanes: Lanes, count: int, closed: Array, walls: Walls) -> Array:
    """The least distance of each design's links from a region beyond the room that they need, ``(N,)``.

    Args:
        lanes: the designs.
        count: poses over the range of the crank; between them distances are bounded.
        closed: 1 where the crank turns all round, else 0.
        walls: the region.
    """

    def one(lane: tuple[Any, ...]) -> Array:
        chain, sign, row = lane
        span = jnp.where(closed > 0, 2.0 * jnp.pi, row[-1])
        angle = row[-2] + span * jnp.linspace(0.0, 1.0, count)
        traced = move(chain, sign, row[:-6], angle, jnp.all(jnp.isfinite(row)))
        return jnp.min(gaps(_link_corners(chain, row, traced), walls, True))

    return jax.lax.map(one, tuple(lanes), batch_size=4)


def _put(row: Array, point: Array) -> Array:
    """Move a point of the linkage to its place, ``(2, …)``."""
    x, y, a, b = (row[k] for k in range(-6, -2))
    return jnp.stack([x + a * point[0] - b * point[1], y + b * point[0] + a * point[1]])


def _link_corners(chain: ChainArrays, row: Array, traced: Traced) -> Array:
    return jnp.moveaxis(_put(row, jnp.moveaxis(link_corners(chain, traced), 1, 0)), 0, 1)


@jax.jit
def match_points(lanes: Lanes, target: Target) -> tuple[Array, Array]:
    """Say where cranks are when designs pass the target's corners, and which points of it their own poses are near.

    Returns:
        Angles ``(N, 2 COUNT)``, and the points of the target that belong to them, ``(N, 2 COUNT, 2)``.
    """
    go, closed = jnp.all(jnp.isfinite(lanes.row[0])), target.closed > 0

    def one(chain: ChainArrays, sign: Array, row: Array) -> tuple[Array, Array]:
        pieces = jnp.where(closed, COUNT, COUNT - 1.0)
        span = jnp.where(closed, 2.0 * jnp.pi, row[-1])
        angles = row[-2] + span * jnp.arange(COUNT) / pieces
        here = _put(row, move(chain, sign, row[:-6], angles, go).point).T
        at, part, _, _ = _nearest(target.points, here, closed)
        passing = jnp.where(target.timed > 0, row[-2] + target.timing, angles[0] + (at + part) * span / pieces)
        foot = _nearest(here, target.points, closed)[2]
        return jnp.concatenate([passing, angles]), jnp.concatenate([target.points, foot])

    return jax.vmap(one)(*lanes)


@jax.jit
def _redraw(chain: ChainArrays, sign: Array, x: Array, u: Array, theta: Array) -> tuple[Array, Array, Array, Frame]:
    return jax.vmap(redraw)(chain, sign, x, u, theta)


def redraw_last(lanes: Lanes, theta: np.ndarray, goal: np.ndarray, u: np.ndarray) -> tuple[Lanes, np.ndarray]:
    """Draw the last dyads of designs at random, and put the tracing points and the whole where they fit best.

    With the timings known, place, turn, size and tracing point are two complex numbers beside a centre: linear least
    squares.

    Args:
        lanes: the designs; what they have for a last dyad and a tracing point is not looked at.
        theta: angles of their cranks, ``(N, T)``.
        goal: points where the tracing points should be then, complex ``(N, T)``.
        u: random numbers between 0 and 1, ``(N, 8)``.

    Returns:
        The designs, and their mean squares of distances, infinite where a dyad does not close.
    """
    few = (np.asarray(a, np.float32) for a in (lanes.sign, lanes.row[:, :-6], u, theta))
    sign, design, sine, frame = jax.tree.map(np.asarray, _redraw(lanes.chain, *few))
    with np.errstate(all="ignore"):  # of dyads that do not close
        origin, along = (a[0] + 1j * a[1].astype(float) for a in frame)
        centres = [a.mean(axis=1, keepdims=True) for a in (origin, along, goal)]
        a, b, y = (array - centre for array, centre in zip((origin, along, goal), centres, strict=True))
        aa, bb = (np.sum(np.abs(c) ** 2, axis=1) for c in (a, b))
        ab, ay, by = (np.sum(np.conj(c) * d, axis=1) for c, d in ((a, b), (a, y), (b, y)))
        det = aa * bb - np.abs(ab) ** 2
        factor, spot = (bb * ay - ab * by) / det, (aa * by - np.conj(ab) * ay) / det
        left = np.mean(np.abs(y - factor[:, None] * a - spot[:, None] * b) ** 2, axis=1)
        place = (centres[2] - factor[:, None] * centres[0] - spot[:, None] * centres[1])[:, 0]
        local = spot / factor
        # Below 8 degrees of transmission a dyad is not looked at.
        good = (sine > 0.02) & (det > 1e-9 * aa * bb) & np.isfinite(left + np.abs(local))
    row = np.concatenate([design.astype(float), np.zeros((len(design), 2)), lanes.row[:, -6:]], axis=1)
    row[:, -8:-2] = np.stack([local.real, local.imag, place.real, place.imag, factor.real, factor.imag], axis=1)
    with np.errstate(all="ignore"):
        good &= np.abs(row[:, :-6]).max(axis=1) * np.abs(factor) < _REACH
    return Lanes(lanes.chain, sign.astype(float), row), np.where(good, left, np.inf)


@jax.jit  # runs for a minute: code that takes as long to compile and is a quarter quicker
def refine(lanes: Lanes, target: Target, steps: Any, feet: Any) -> tuple[Array, Array, Array]:
    """Refine designs by so many steps, all at once.

    Args:
        lanes: where they begin.
        target: what they shall trace.
        steps: how many.
        feet: how often the feet of perpendiculars are brought nearer in each.

    Returns:
        The rows, their mean squares of distances, and their costs with penalties.
    """
    go = jnp.all(jnp.isfinite(lanes.row[0]))

    def one(chain: ChainArrays, sign: Array, share: Array, now: Course) -> Course:
        new = now.row - _solve(now.matrix, now.slope, now.damping)
        cost, matrix, slope, error = _look(chain, sign, share, target, go, feet, new)
        better = cost < now.cost  # false where it is not finite
        taken = better | (cost < _UPHILL * now.least)
        factor = jnp.where(better, _SHRINK, jnp.where(taken, 1.0, _GROW))
        damping = jnp.clip(now.damping * factor, _LEAST_DAMPING, _MOST_DAMPING)
        row, cost, matrix, slope = (
            jnp.where(taken, a, b) for a, b in zip((new, cost, matrix, slope), now[:4], strict=True)
        )
        least, best, error = (
            jnp.where(cost < now.least, a, b) for a, b in ((cost, now.least), (row, now.best), (error, now.error))
        )
        return Course(row, cost, matrix, slope, damping, best, least, error)

    def together(few: tuple[Any, ...]) -> tuple[Array, Array, Array]:
        chain, sign, row = few
        far, flat = jnp.full(row.shape[:1], jnp.inf, row.dtype), jnp.zeros((*row.shape, row.shape[1]), row.dtype)

        def stay(now: Course, _: Array) -> tuple[Course, Array]:
            # The next step stays where it is, so that there is one program for it and all others.
            share = jax.vmap(_spread_poses, (0, 0, 0, None, None))(chain, sign, now.best, target, go)
            return Course(now.best, far, flat, jnp.zeros_like(row), now.damping, now.best, far, far), share

        def step(k: Array, state: tuple[Course, Array]) -> tuple[Course, Array]:
            renewed = (k % (_RENEW + 1) == 0) | (k == count - 1)
            now, share = jax.lax.cond(renewed, stay, lambda *same: same, *state)
            return jax.vmap(one)(chain, sign, share, now), share

        count = steps + 2 + steps // _RENEW
        damping = jnp.full_like(far, _FIRST / _SHRINK)
        start = Course(row, far, flat, jnp.zeros_like(row), damping, row, far, far)
        end, _ = jax.lax.fori_loop(0, count, step, (start, jnp.zeros((len(row), COUNT), row.dtype)))
        return end.best, end.error, end.least

    side = math.gcd(len(lanes.row), _TOGETHER)
    parts = jax.tree.map(lambda a: a.reshape(-1, side, *a.shape[1:]), tuple(lanes))
    return jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:]), jax.lax.map(together, parts))


def _solve(matrix: Array, slope: Array, damping: Array) -> Array:
    """Solve the damped normal equations; unknowns that nothing depends on stay."""
    size = jnp.diagonal(matrix)
    scale = jnp.where(size > 1e-14, size, 1.0)
    root = jnp.sqrt(scale)
    whole = matrix / (root[:, None] * root) + (damping + 1e-15) * jnp.eye(len(slope))
    whole = whole + jnp.diag(jnp.where(size > 1e-14, 0.0, 1.0))
    return cholesky_solve(whole, (slope / root)[:, None])[:, 0] / root


def _spread_poses(chain: ChainArrays, sign: Array, row: Array, target: Target, go: Array) -> Array:
    """Choose the poses in which a design is looked at, as shares of its crank's range, ``(COUNT,)``.

    They are halfway between even by the angle of the crank and even along the curve. In poses that are even by the
    angle designs of little distance would be those that go astray between them, where they are quick.
    """
    knots = jnp.arange(4 * COUNT + 1) / (4.0 * COUNT)
    span = jnp.where(target.closed > 0, 2.0 * jnp.pi, row[-1])
    place = _put(row, move(chain, sign, row[:-6], row[-2] + span * knots, go).point)
    chord = jnp.sqrt(jnp.sum(jnp.diff(place, axis=1) ** 2, axis=0))
    along = jnp.concatenate([jnp.zeros(1), jnp.cumsum(chord / jnp.maximum(jnp.sum(chord), 1e-12))])
    even = jnp.arange(COUNT) / jnp.where(target.closed > 0, COUNT, COUNT - 1.0)
    return jnp.where(target.both > 0, jnp.interp(even, 0.25 * knots + 0.75 * along, knots), even)


def _look(
    chain: ChainArrays, sign: Array, share: Array, target: Target, go: Array, feet: Any, row: Array
) -> tuple[Array, Array, Array, Array]:
    """Look at one design in some poses: its cost, its normal equations and its mean square of distances."""
    goal, dyads = target.points.T, chain.kind.shape[-1]
    closed, timed = target.closed > 0, target.timed > 0
    even = target.both > 0  # both ways, in even poses; else corners alone, each in a pose of its own
    span = jnp.where(closed, 2.0 * jnp.pi, row[-1])
    pieces = jnp.where(closed, COUNT, COUNT - 1.0)
    angles = row[-2] + span * share
    low, high = jnp.minimum(angles[0], angles[0] + span), jnp.maximum(angles[0], angles[0] + span)
    seen = move(chain, sign, row[:-6], angles, go)
    here = _put(row, seen.point)

    # Feet of the corners on the curve, for which a cubic through four poses stands.
    at, part, _, _ = _nearest(target.points, here.T, closed)
    first = jnp.where(closed, at - 1, jnp.clip(at - 1, 0, COUNT - 4))
    index = (first[:, None] + jnp.arange(4)) % COUNT
    along, at_limit = _find_feet(here[:, index], goal, at - first, part, closed)
    angle = jnp.where(timed, row[-2] + target.timing, angles[0] + (first + along) * span / pieces)

    def approach(_: Any, now: tuple[Array, Array]) -> tuple[Array, Array]:
        def put(angle: Array) -> Array:
            return _put(row, move(chain, sign, row[:-6], angle, go).point)

        place, speed = jax.jvp(put, now[:1], (jnp.ones(COUNT),))
        nearer = now[0] - jnp.sum((place - goal) * speed, axis=0) / jnp.maximum(jnp.sum(speed**2, axis=0), 1e-12)
        # Near a cusp a step may be a long one; the foot is between the neighbours of the nearest pose.
        nearer = jnp.clip(nearer, angle - jnp.abs(span) / pieces, angle + jnp.abs(span) / pieces)
        return jnp.where(closed, nearer, jnp.clip(nearer, low, high)), speed

    foot_angle, speed = jax.lax.fori_loop(0, feet, approach, (angle, jnp.zeros((2, COUNT))))
    foot_angle = jnp.where(timed, angle, foot_angle)
    at_limit = jnp.where(even, at_limit, ~closed & ((foot_angle <= low) | (foot_angle >= high)))

    # Rows: places of the poses along x and y, the worst pose of each dyad, and of each link near a wall.
    worst = _find_worst(chain, sign, row, share[jnp.argmin(seen.sine, axis=1)], closed, go)
    if target.walls:
        links = _link_corners(chain, row, seen)
        worst = jnp.concatenate([worst, *(share[jnp.argmin(gaps(links, wall), axis=1)] for wall in target.walls)])
    more, bodies = len(worst), 1 + 2 * dyads
    count = 2 * COUNT + more
    pose = jnp.where(even, angles, foot_angle)
    # Even poses move with the range of an open piece, and so do feet at its ends; feet within it do not.
    own_share = (foot_angle - angles[0]) / jnp.where(span == 0, 1.0, span)
    pose_share, held = jnp.where(even, share, own_share), ~(even | at_limit)
    shares = jnp.concatenate([pose_share, pose_share, worst])
    fixed = jnp.concatenate([held, held, jnp.zeros(more, bool)])
    every = jnp.concatenate([pose, pose, row[-2] + span * worst])
    given = jnp.concatenate([target.timing, target.timing, jnp.zeros(more)])
    of_place = jnp.arange(count) < 2 * COUNT
    axes = jnp.eye(2)[:, jnp.arange(count) // COUNT % 2] * of_place
    own = jnp.arange(dyads)[:, None] == jnp.arange(count) - 2 * COUNT

    def rows(spread: Array) -> tuple[Array, Array]:
        crank = jnp.where(fixed | closed, every, spread[-2] + spread[-1] * shares)
        crank = jnp.where(timed & of_place, spread[-2] + given, crank)
        traced = move(chain, sign, spread[:-6], crank, go, row[:-6])
        short = jnp.sum(jnp.where(own, jnp.maximum(target.sine - traced.sine, 0.0), 0.0), axis=0)
        for k, wall in enumerate(target.walls):
            begin = 2 * COUNT + dyads + k * bodies
            last = jax.tree.map(lambda a, begin=begin: a[..., begin : begin + bodies], (spread, traced))
            links = jnp.diagonal(_link_corners(chain, *last), axis1=2, axis2=3)[..., None]
            short = short.at[begin : begin + bodies].add(jnp.maximum(-gaps(links, wall)[:, 0], 0.0))
        out = jnp.sum(axes * _put(spread, traced.point), axis=0) + short
        return jnp.sum(out), out

    spread = jnp.broadcast_to(row[:, None], (len(row), count))
    jacobian, value = jax.grad(rows, has_aux=True)(spread)
    still = jnp.stack([closed & ~timed, closed | timed])  # begin and range of the crank
    jacobian = jacobian.at[-2:].set(jnp.where(still[:, None], 0.0, jacobian[-2:]))
    place, moved = value[: 2 * COUNT].reshape(2, COUNT), jacobian[:, : 2 * COUNT].reshape(-1, 2, COUNT)

    # Distances of the corners, from feet between poses or from poses of their own.
    basis, slopes = (jnp.where(even, _cubic_weights(along, k), jnp.eye(4)[0]) for k in range(2))
    index = jnp.where(even, index, jnp.arange(COUNT)[:, None])
    gap = jnp.sum(place[:, index] * basis, axis=2) - goal
    speed = jnp.where(even, jnp.sum(place[:, index] * slopes, axis=2), speed)
    sideways = jnp.abs(gap[0] * speed[1] - gap[1] * speed[0])
    whole = at_limit | (jnp.abs(jnp.sum(gap * speed, axis=0)) > sideways)  # at a cusp there is no perpendicular
    # Where timings are given, the two distances of a point are those along x and along y.
    x, y = jnp.eye(2)[:, :, None] * jnp.ones(COUNT)
    normal = jnp.where(timed, x, _across(speed, gap, whole))
    corner_slopes = jnp.sum(moved[:, :, index] * (normal[:, :, None] * basis), axis=(1, 3))

    # Distances of the poses from the polyline of the target: across a piece, or from a corner.
    _, _, foot, tangent = _nearest(place.T, target.points, closed)
    off = jnp.where(timed, gap, place - foot.T)
    other = jnp.where(timed, y, _across(tangent.T, off, jnp.sum(off**2, axis=0) > 1e-20))
    pose_slopes = jnp.sum(moved * other, axis=1)

    length, length_slopes = _share_length(place, moved, closed)
    own_weight = jnp.sqrt(target.weight)
    other_weight = jnp.where(timed, own_weight, jnp.sqrt(target.both * length))
    weight_slopes = jnp.where(timed, 0.0, target.both * length_slopes / (2.0 * jnp.maximum(other_weight, 1e-6)))

    far = jnp.concatenate([jnp.sum(normal * gap, axis=0), jnp.sum(other * off, axis=0)])
    weights = jnp.concatenate([own_weight, other_weight])
    # Squares over distances are distances: least squares with weights that follow, and have half the slope.
    less = jnp.where(target.mean > 0, 1.0 / jnp.sqrt(jnp.maximum(jnp.abs(far), _NEAR)), 1.0)
    twice = jnp.where((target.mean > 0) & (jnp.abs(far) > _NEAR), 2.0, 1.0)
    slopes = jnp.concatenate([corner_slopes, pose_slopes], axis=1) * weights
    slopes = slopes.at[:, COUNT:].add(weight_slopes * (twice * far)[COUNT:])
    miss = jnp.concatenate([weights * far * less, target.closing * value[2 * COUNT :]])
    slopes = jnp.concatenate([slopes * less, target.closing * jacobian[:, 2 * COUNT :]], axis=1)
    error = jnp.sum((weights * far) ** 2)
    beyond, extra_matrix, extra_slope = _beyond(chain, row, target)
    return jnp.sum(miss**2) + beyond, slopes @ slopes.T + extra_matrix, slopes @ miss + extra_slope, error


def _find_worst(chain: ChainArrays, sign: Array, row: Array, share: Array, closed: Array, go: Array) -> Array:
    """Find where dyads come nearest to not closing, between the poses too, near a share of the crank's range for each.

    A design that met what is asked in its poses alone would often miss it beside them.
    """
    dyads = len(share)
    span, pieces = jnp.where(closed, 2.0 * jnp.pi, row[-1]), jnp.where(closed, COUNT, COUNT - 1.0)
    near = share[:, None] + jnp.linspace(-1.0, 1.0, 9) / pieces
    near = jnp.where(closed, near, jnp.clip(near, 0.0, 1.0))
    sine = move(chain, sign, row[:-6], row[-2] + span * near.reshape(-1), go).sine.reshape(dyads, dyads, -1)
    own = jnp.arange(dyads)
    return near[own, jnp.argmin(sine[own, own], axis=1)]


def _share_length(place: Array, moved: Array, closed: Array) -> tuple[Array, Array]:
    """Share the length of a curve among its poses: a pose stands for the chords that meet there.

    Args:
        place: of the poses, ``(2, n)``.
        moved: their slopes, ``(numbers, 2, n)``.
        closed: whether the last one is joined to the first.

    Returns:
        The shares, together 1, ``(n,)``, and their slopes, ``(numbers, n)``.
    """
    pair = closed | (jnp.arange(COUNT) < COUNT - 1)
    chord, chord_slopes = (jnp.where(pair, jnp.roll(a, -1, axis=-1) - a, 0.0) for a in (place, moved))
    size = jnp.sqrt(jnp.sum(chord**2, axis=0))
    chord_slopes = jnp.sum(chord / jnp.maximum(size, 1e-12) * chord_slopes, axis=1)
    length, slopes = (0.5 * (a + jnp.roll(a, 1, axis=-1)) for a in (size, chord_slopes))
    total = jnp.maximum(jnp.sum(length), 1e-12)
    share = length / total
    return share, slopes / total - share * (jnp.sum(slopes, axis=1, keepdims=True) / total)


def _cubic_weights(along: Array, order: int) -> Array:
    """Weights of four values at 0, 1, 2 and 3 in the cubic through them, or in its derivatives, ``(n, 4)``."""
    falling = jnp.array([jnp.prod(jnp.arange(k, k - order, -1.0)) for k in range(4)])
    powers = falling * along[:, None] ** jnp.maximum(jnp.arange(4) - order, 0)
    return powers @ _LAGRANGE


def _find_feet(corners: Array, goal: Array, piece: Array, part: Array, closed: Array) -> tuple[Array, Array]:
    """Find the points of cubics that are nearest to a target's corners, near where they are on the chords.

    Args:
        corners: of the cubics, ``(2, n, 4)``.
        goal: the corners, ``(2, n)``.
        piece: between which two corners of a cubic the nearest point of its chords is, ``(n,)``.
        part: and which share of that piece lies before it.
        closed: whether the curve is, and so has no ends.

    Returns:
        Where on the cubics, 0 to 3, and whether that is a limit.
    """
    low, high = piece - 0.5, piece + 1.5
    low, high = jnp.where(closed, low, jnp.maximum(low, 0.0)), jnp.where(closed, high, jnp.minimum(high, 3.0))

    def step(_: Any, along: Array) -> Array:
        place, speed, turn = (jnp.sum(corners * _cubic_weights(along, k), axis=2) for k in range(3))
        gap, square = place - goal, jnp.sum(speed**2, axis=0)
        curvature = jnp.maximum(square + jnp.sum(gap * turn, axis=0), 0.2 * square)
        return jnp.clip(along - jnp.sum(gap * speed, axis=0) / jnp.maximum(curvature, 1e-12), low, high)

    along = jax.lax.fori_loop(0, 4, step, piece + part)
    return along, (along <= low) | (along >= high)


def _beyond(chain: ChainArrays, row: Array, target: Target) -> tuple[Array, Array, Array]:
    """What links miss that are longer than allowed, and pivots of the ground that are out of their box."""

    def miss(row: Array) -> Array:
        size = jnp.sqrt(row[-4] ** 2 + row[-3] ** 2)
        each = row[: EACH * chain.kind.shape[-1]].reshape(-1, EACH)
        first = jnp.where(chain.kind == _PRP, 0.0, each[:, 4])  # lengths among a dyad's own numbers
        second = jnp.where(chain.kind == _RRR, each[:, 5], 0.0)
        every = jnp.concatenate([each[:, :4].reshape(-1), first, second, row[-8:-6]])
        pivots = jnp.concatenate([jnp.zeros((1, 2)), each[:, :2], each[:, 2:4]])
        at = _put(row, pivots.T).T
        grounded = jnp.concatenate([jnp.ones(1, bool), chain.first == GROUND, chain.second == GROUND])[:, None]
        out = jnp.maximum(jnp.maximum(target.ground[0] - at, at - target.ground[1]), 0.0)
        long = jnp.maximum(jnp.abs(every) * size - target.longest, 0.0)
        return jnp.concatenate([0.1 * long, jnp.where(grounded, out, 0.0).reshape(-1)])

    value, pull = jax.vjp(miss, row)
    jacobian = jax.vmap(lambda one: pull(one)[0])(jnp.eye(len(value)))
    return jnp.sum(value**2), jacobian.T @ jacobian, jacobian.T @ value


def _nearest(of: Array, corners: Array, closed: Array) -> tuple[Array, Array, Array, Array]:
    """Nearest points of a polyline.

    Args:
        of: points, ``(n, 2)``.
        corners: of the polyline, ``(m, 2)``.
        closed: whether the last one is joined to the first.

    Returns:
        The piece from a corner to the next, which share of it lies behind, the nearest point, and the direction there;
        the first axis is that of the points.
    """
    last = len(corners) - 1
    piece = jnp.roll(corners, -1, axis=0) - corners
    piece = jnp.where((closed | (jnp.arange(last + 1) < last))[:, None], piece, 0.0)
    square = jnp.sum(piece**2, axis=1)
    off_x, off_y = (of[:, k, None] - corners[:, k] for k in range(2))
    part = jnp.clip((off_x * piece[:, 0] + off_y * piece[:, 1]) / jnp.where(square > 0, square, 1.0), 0.0, 1.0)
    apart = (off_x - part * piece[:, 0]) ** 2 + (off_y - part * piece[:, 1]) ** 2
    apart = jnp.where(square > 0, apart, jnp.inf)
    at = jnp.argmin(apart, axis=1)
    part = jnp.take_along_axis(part, at[:, None], axis=1)[:, 0]
    return at, part, corners[at] + part[:, None] * piece[at], piece[at]


def _across(tangent: Array, gap: Array, whole: Array) -> Array:
    """Unit vectors across a direction; where the whole gap counts, along the gap, ``(2, n)``."""
    across = jnp.stack([-tangent[1], tangent[0]])
    chosen = jnp.where(whole, gap, across)
    size = jnp.sqrt(jnp.sum(chosen**2, axis=0))
    return jax.lax.stop_gradient(chosen / jnp.where(size > 0, size, 1.0))


def start_lanes(target: np.ndarray, closed: bool, found: Any, arrays: ChainArrays) -> Lanes:
    """Put designs of an atlas where they fit a target best: turned, mirrored, of its size, about its centre.

    Args:
        target: its corners, ``(M, 2)``, in units of its size about its centre.
        closed: whether it is closed.
        found: designs, a `Candidates`.
        arrays: their chains.
    """
    shelf = found.shelf
    design = mirror(shelf.design.astype(float), arrays, found.mirrored)
    sign = np.where(found.mirrored[:, None], -1.0, 1.0) * shelf.sign
    begin, span = shelf.window.astype(float).T
    if closed:
        begin, span = np.zeros(len(begin)), np.full(len(begin), 2.0 * np.pi)
    else:
        begin, span = np.where(found.mirrored, [-begin, -span], [begin, span])
    unit = np.broadcast_to([0.0, 0.0, 1.0, 0.0], (len(begin), WHOLE))
    lanes = Lanes(arrays, sign, np.concatenate([design, unit, begin[:, None], span[:, None]], axis=1))
    own = np.asarray(trace_curves(lanes, COUNT, float(closed))[0])
    centre, size = _centre(own, closed)
    goal, extent = _centre(target[None], closed)
    factor = (extent / size) * np.exp(1j * found.turn)
    place = (goal @ [1, 1j]) - factor * (centre @ [1, 1j])
    row = lanes.row.copy()
    row[:, -6:-2] = np.stack([place.real, place.imag, factor.real, factor.imag], axis=1)
    return lanes._replace(row=row)


def begin_timed(lanes: Lanes, target: Target) -> Lanes:
    """Let cranks begin where the points fit best, and turn, place and size each linkage for that."""
    row = np.array(lanes.row)
    row[:, -6:] = [0.0, 0.0, 1.0, 0.0, 0.0, 2.0 * np.pi]
    own = np.asarray(trace_curves(lanes._replace(row=row), _BEGINS, 1.0)[0]) @ [1, 1j]
    at = (np.arange(_BEGINS)[:, None] + np.asarray(target.timing) * (_BEGINS / (2.0 * np.pi))) % _BEGINS
    before = at.astype(int) % _BEGINS
    share = at - np.floor(at)
    weight = np.asarray(target.weight)
    goal = np.asarray(target.points) @ [1, 1j]
    goal_centre = goal @ weight
    for k, curve in enumerate(own):
        found = (1.0 - share) * curve[before] + share * curve[(before + 1) % _BEGINS]  # by begin, then by point
        centre = found @ weight
        off = found - centre[:, None]
        factor = (np.conj(off) * (goal - goal_centre)) @ weight / np.maximum(np.abs(off) ** 2 @ weight, 1e-300)
        left = np.abs(goal - goal_centre - factor[:, None] * off) ** 2 @ weight
        best = int(left.argmin())
        place = goal_centre - factor[best] * centre[best]
        row[k, -6:-1] = place.real, place.imag, factor[best].real, factor[best].imag, best * 2.0 * np.pi / _BEGINS
    last = float(np.asarray(target.timing)[weight > 0][-1])
    row[:, -1] = np.copysign(2.0 * np.pi, last) if target.closed else last
    return lanes._replace(row=row)


def mirror(design: np.ndarray, arrays: ChainArrays, which: np.ndarray) -> np.ndarray:
    """Mirror designs; their assemblies, and the way their cranks turn, change sign too."""
    dyads = arrays.kind.shape[1]
    flip = np.ones_like(design)
    for d in range(dyads):
        flip[:, [EACH * d + 1, EACH * d + 3]] = -1.0
        flip[:, EACH * d + 4] = np.where(arrays.kind[:, d] >= 2, -1.0, 1.0)  # offsets and angles, not lengths
        flip[:, EACH * d + 5] = np.where(arrays.kind[:, d] == 0, 1.0, -1.0)
    flip[:, -1] = -1.0
    return np.where(which[:, None], flip * design, design)


def _centre(points: np.ndarray, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Centre and root mean square distance from it, by arc length, of curves ``(N, T, 2)``."""
    step = np.roll(points, -1, axis=1) - points
    if not closed:
        step, points = step[:, :-1], points[:, :-1]
    weight = np.linalg.norm(step, axis=-1)
    weight = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    middle = points + 0.5 * step
    centre = np.einsum("nt,ntd->nd", weight, middle)
    return centre, np.sqrt(np.einsum("nt,ntd->n", weight, (middle - centre[:, None]) ** 2))
