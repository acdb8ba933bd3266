"""Fit hundreds of linkages to a curve at once: least squares of distances, with timings, place and size eliminated.

Distances count both ways: from target points to the curve, and from the curve to the polyline of the target. Where the
crank is when the point passes a target is no unknown: it is the foot of a perpendicular, and to first order a distance
does not change with it. So each distance has one row of derivatives, and one reverse sweep over the dyads of its pose
gives the whole row. Place, turn and size of the linkage are four columns beside it.

Method: K. Levenberg (1944), D. Marquardt (1963); variable projection as G. Golub and V. Pereyra, SIAM J. Numer. Anal.
10 (1973).
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import jit
from jaxnc.solvers.dense import cholesky_solve
from jaxnc.synthesis.tracing.chains import GROUND, KINDS, ChainArrays
from jaxnc.synthesis.tracing.curves import EACH, Frame, Traced, move, redraw
from jaxnc.synthesis.tracing.plates import Walls, gaps, link_corners
from jaxnc.types import Array

_RRR, _PRP = KINDS.index("RRR"), KINDS.index("PRP")
WHOLE = 4  # numbers of place, turn and size: x, y, and the factor as a complex number
_GROW, _SHRINK = 4.0, 0.3  # of the damping
_FIRST, _LEAST_DAMPING, _MOST_DAMPING = 1e-2, 1e-14, 1e8
_CLOSING = 3.0  # weight of a dyad that does not close, against a distance of the target's size
COUNT = 64  # corners of a target, and poses of the crank at which a design is looked at
_NEAR = 1e-3  # sizes of the target: distances below count by their squares all the same
_BEGINS = 64  # places of the crank that are tried as the begin of given timings
_TOGETHER = 16  # designs that are calculated side by side: their numbers stay in the processor's cache
_BAD = 0.02  # square of the sine of a transmission angle, below which a dyad that was drawn is not looked at
_REACH = 20.0  # sizes of the target: no number of a design that was drawn is longer
_LONG = 0.1  # and of a link that is longer than allowed, for each size of the target


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
    walls: tuple[Walls, ...] = ()  # what links shall keep clear of


class Lanes(NamedTuple):
    """Designs on their way; the first axis is that of designs."""

    chain: ChainArrays
    sign: Any  # (N, dyads)
    row: Any  # the design, then place and factor, then where the crank begins and how far it goes, (N, 6 dyads + 8)


class Course(NamedTuple):
    """Where the steps of a design have come."""

    best: Array  # the row
    cost: Array  # sum of squares of what it misses, its penalties included
    matrix: Array  # of the normal equations there
    slope: Array
    damping: Array
    error: Array  # mean square of the distances alone


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
        at, part, *_ = _nearest(target.points, here, closed)
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
    origin, along = (a[0] + 1j * a[1].astype(float) for a in frame)
    centres = [a.mean(axis=1, keepdims=True) for a in (origin, along, goal)]
    a, b, y = (array - centre for array, centre in zip((origin, along, goal), centres, strict=True))
    aa, bb = (np.sum(np.abs(c) ** 2, axis=1) for c in (a, b))
    ab, ay, by = (np.sum(np.conj(c) * d, axis=1) for c, d in ((a, b), (a, y), (b, y)))
    with np.errstate(all="ignore"):
        det = aa * bb - np.abs(ab) ** 2
        factor, spot = (bb * ay - ab * by) / det, (aa * by - np.conj(ab) * ay) / det
        left = np.mean(np.abs(y - factor[:, None] * a - spot[:, None] * b) ** 2, axis=1)
        place = (centres[2] - factor[:, None] * centres[0] - spot[:, None] * centres[1])[:, 0]
        local = spot / factor
        good = (sine > _BAD) & (det > 1e-9 * aa * bb) & np.isfinite(left + np.abs(local))
    row = np.concatenate([design.astype(float), np.zeros((len(design), 2)), lanes.row[:, -6:]], axis=1)
    row[:, -8:-2] = np.stack([local.real, local.imag, place.real, place.imag, factor.real, factor.imag], axis=1)
    longest = np.abs(row[:, :-6]).max(axis=1) * np.abs(factor)
    return Lanes(lanes.chain, sign.astype(float), row), np.where(good & (longest < _REACH), left, np.inf)


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

    def one(chain: ChainArrays, sign: Array, row: Array) -> tuple[Array, Array, Array]:
        look = functools.partial(_look, chain, sign, target, go, feet)
        cost, matrix, slope, error = look(row)
        start = Course(row, cost, matrix, slope, jnp.asarray(_FIRST, row.dtype), error)

        def step(_: int, now: Course) -> Course:
            new = now.best - _solve(now.matrix, now.slope, now.damping)
            cost, matrix, slope, error = look(new)
            better = cost < now.cost  # false where it is not finite
            grown = jnp.clip(now.damping * jnp.where(better, _SHRINK, _GROW), _LEAST_DAMPING, _MOST_DAMPING)
            chosen = Course(new, cost, matrix, slope, grown, error)
            return jax.tree.map(lambda a, b: jnp.where(better, a, b), chosen, now._replace(damping=grown))

        end = jax.lax.fori_loop(0, steps, step, start)
        return end.best, end.error, end.cost

    return jax.lax.map(lambda lane: one(*lane), tuple(lanes), batch_size=_TOGETHER)


def _solve(matrix: Array, slope: Array, damping: Array) -> Array:
    """Solve the damped normal equations; unknowns that nothing depends on stay."""
    size = jnp.diagonal(matrix)
    scale = jnp.where(size > 1e-14, size, 1.0)
    root = jnp.sqrt(scale)
    whole = matrix / (root[:, None] * root) + (damping + 1e-15) * jnp.eye(len(slope))
    whole = whole + jnp.diag(jnp.where(size > 1e-14, 0.0, 1.0))
    return cholesky_solve(whole, (slope / root)[:, None])[:, 0] / root


def _look(
    chain: ChainArrays, sign: Array, target: Target, go: Array, feet: Any, row: Array
) -> tuple[Array, Array, Array, Array]:
    """Look at one design: its cost, its normal equations and its mean square of distances."""
    goal, dyads = target.points, chain.kind.shape[-1]
    closed = target.closed > 0
    span = jnp.where(closed, 2.0 * jnp.pi, row[-1])
    pieces = jnp.where(closed, COUNT, COUNT - 1.0)
    share = jnp.arange(COUNT) / pieces
    angles = row[-2] + span * share
    timed = target.timed > 0
    low, high = jnp.minimum(angles[0], angles[0] + span), jnp.maximum(angles[0], angles[0] + span)

    def limit(angle: Array) -> Array:
        return jnp.where(closed, angle, jnp.clip(angle, low, high))

    # Poses all round first, then those in which the point is nearest to the target's: one program for both.
    def place_poses(k: Any, now: tuple[Any, ...]) -> tuple[Any, ...]:
        angle, *_ = now

        def at(angle: Array) -> tuple[Array, Traced]:
            traced = move(chain, sign, row[:-6], angle, go)
            return _put(row, traced.point), traced if target.walls else traced._replace(joints=None)

        place, speed, traced = jax.jvp(at, (angle,), (jnp.ones_like(angle),), has_aux=True)

        def seek(_: Any) -> tuple[Any, ...]:
            here = place.T
            at, part, *_ = _nearest(goal, here, closed)
            angle = angles[0] + (at + part) * span / pieces
            angle = jnp.where(timed, row[-2] + target.timing, limit(angle))
            return angle, angle, place, traced, place, speed

        def approach(_: Any) -> tuple[Any, ...]:
            gap = place - goal.T
            nearer = angle - jnp.sum(gap * speed, axis=0) / jnp.maximum(jnp.sum(speed**2, axis=0), 1e-12)
            # Near a cusp a step may be a long one; the foot is between the neighbours of the nearest pose.
            nearer = jnp.clip(nearer, now[1] - jnp.abs(span) / pieces, now[1] + jnp.abs(span) / pieces)
            return jnp.where(timed, angle, limit(nearer)), *now[1:4], gap, speed

        return jax.lax.cond(k == 0, seek, approach, None)

    nothing = jnp.zeros((2, COUNT))
    seen = Traced(nothing, jnp.zeros((dyads, COUNT)), jnp.zeros((dyads, 3, 2, COUNT)) if target.walls else None)
    begun = (angles, angles, nothing, seen, nothing, nothing)
    angle, _, here, seen, gap, speed = jax.lax.fori_loop(0, feet + 1, place_poses, begun)
    here = here.T
    at_end = ~closed & ((angle <= low) | (angle >= high))
    along = jnp.abs(jnp.sum(gap * speed, axis=0))
    across = jnp.abs(gap[0] * speed[1] - gap[1] * speed[0])
    normal = _across(speed, gap, at_end | (along > across))  # at a cusp there is no perpendicular

    # Feet of the curve's poses on the polyline of the target.
    _, _, foot, tangent, _ = _nearest(here, goal, closed)
    off = (here - foot).T  # across a piece, or from a corner
    other = _across(tangent.T, off, jnp.sum(off**2, axis=0) > 1e-20)
    length = jnp.sqrt(jnp.sum((jnp.roll(here, -1, axis=0) - here) ** 2, axis=1))
    length = jnp.where(closed | (jnp.arange(COUNT) < COUNT - 1), length, 0.0)
    length = 0.5 * (length + jnp.roll(length, 1))
    length = length / jnp.maximum(jnp.sum(length), 1e-12)

    # Rows: distances of the feet, distances of the poses, the worst pose of each dyad, and of each link near a wall.
    worst = jnp.argmin(seen.sine, axis=1)
    if target.walls:
        links = _link_corners(chain, row, seen)
        worst = jnp.concatenate([worst, *(jnp.argmin(gaps(links, wall), axis=1) for wall in target.walls)])
    more, bodies = len(worst), 1 + 2 * dyads
    # Where timings are given, the two distances of a point are those along x and along y.
    x, y = jnp.eye(2)[:, :, None] * jnp.ones(COUNT)
    normal, other = jnp.where(timed, x, normal), jnp.where(timed, y, other)
    foot = jnp.where(timed, goal, foot)
    own_weight = jnp.sqrt(target.weight)
    other_weight = jnp.where(timed, own_weight, jnp.sqrt(target.both * length))
    wanted = jnp.concatenate([goal, foot, jnp.zeros((more, 2))]).T
    normals = jnp.concatenate([normal, other, jnp.zeros((2, more))], axis=1)
    weights = jnp.concatenate([own_weight, other_weight, jnp.full(more, _CLOSING)])
    # Ends of an open piece move with its range; feet within it do not.
    shares = jnp.concatenate([(angle - angles[0]) / jnp.where(span == 0, 1.0, span), share, share[worst]])
    fixed = jnp.concatenate([~at_end, jnp.zeros(COUNT, bool), jnp.zeros(more, bool)])
    every = jnp.concatenate([angle, angles, angles[worst]])
    given = jnp.concatenate([target.timing, target.timing, jnp.zeros(more)])
    by_time = timed & (jnp.arange(len(every)) < 2 * COUNT)
    own = jnp.arange(dyads)[:, None] == jnp.arange(2 * COUNT + more) - 2 * COUNT

    def rows(spread: Array) -> tuple[Array, Array]:
        crank = jnp.where(fixed | closed, every, spread[-2] + spread[-1] * shares)
        crank = jnp.where(by_time, spread[-2] + given, crank)
        traced = move(chain, sign, spread[:-6], crank, go, row[:-6])
        miss = _put(spread, traced.point) - wanted
        short = jnp.sum(jnp.where(own, jnp.maximum(target.sine - traced.sine, 0.0), 0.0), axis=0)
        for k, wall in enumerate(target.walls):
            first = 2 * COUNT + dyads + k * bodies
            last = jax.tree.map(lambda a, first=first: a[..., first : first + bodies], (spread, traced))
            links = jnp.diagonal(_link_corners(chain, *last), axis1=2, axis2=3)[..., None]
            short = short.at[first : first + bodies].add(jnp.maximum(-gaps(links, wall)[:, 0], 0.0))
        out = weights * (jnp.sum(normals * miss, axis=0) + short)
        return jnp.sum(out), out

    spread = jnp.broadcast_to(row[:, None], (len(row), len(every)))
    jacobian, miss = jax.grad(rows, has_aux=True)(spread)
    held = jnp.stack([closed & ~timed, closed | timed])  # begin and range of the crank
    jacobian = jacobian.at[-2:].set(jnp.where(held[:, None], 0.0, jacobian[-2:]))
    error = jnp.sum(miss[: 2 * COUNT] ** 2)
    # Squares over distances are distances: least squares with weights that follow.
    far = jnp.abs(miss) / jnp.where(weights > 0, weights, 1.0)
    less = jnp.where(
        (target.mean > 0) & (jnp.arange(len(every)) < 2 * COUNT), 1.0 / jnp.sqrt(jnp.maximum(far, _NEAR)), 1.0
    )
    jacobian, miss = jacobian * less, miss * less
    more, extra_matrix, extra_slope = _beyond(chain, row, target)
    cost = jnp.sum(miss**2) + more
    return cost, jacobian @ jacobian.T + extra_matrix, jacobian @ miss + extra_slope, error


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
        return jnp.concatenate([_LONG * long, jnp.where(grounded, out, 0.0).reshape(-1)])

    value, pull = jax.vjp(miss, row)
    jacobian = jax.vmap(lambda one: pull(one)[0])(jnp.eye(len(value)))
    return jnp.sum(value**2), jacobian.T @ jacobian, jacobian.T @ value


def _nearest(of: Array, corners: Array, closed: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Nearest points of a polyline.

    Args:
        of: points, ``(n, 2)``.
        corners: of the polyline, ``(m, 2)``.
        closed: whether the last one is joined to the first.

    Returns:
        The piece from a corner to the next, which share of it lies behind, the nearest point, the direction there, and
        whether an end of an open polyline is nearest; the first axis is that of the points.
    """
    last = len(corners) - 1
    piece = jnp.roll(corners, -1, axis=0) - corners
    piece = jnp.where((closed | (jnp.arange(last + 1) < last))[:, None], piece, 0.0)
    square = jnp.sum(piece**2, axis=1)
    off_x, off_y = (of[:, k, None] - corners[:, k] for k in range(2))
    share = (off_x * piece[:, 0] + off_y * piece[:, 1]) / jnp.where(square > 0, square, 1.0)
    part = jnp.clip(share, 0.0, 1.0)
    apart = (off_x - part * piece[:, 0]) ** 2 + (off_y - part * piece[:, 1]) ** 2
    apart = jnp.where(square > 0, apart, jnp.inf)
    at = jnp.argmin(apart, axis=1)
    share, part = (jnp.take_along_axis(a, at[:, None], axis=1)[:, 0] for a in (share, part))
    beyond = ~closed & (((at == 0) & (share < 0.0)) | ((at == last - 1) & (share > 1.0)))
    return at, part, corners[at] + part[:, None] * piece[at], piece[at], beyond


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
    row[:, -1] = (
        lanes.row[:, -1] if target.closed else float(np.asarray(target.timing)[np.asarray(target.weight) > 0].max())
    )
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
