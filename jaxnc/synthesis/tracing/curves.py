"""Move chains of dyads in closed form: one program for each number of dyads, over arrays of chains, designs and poses.

A design is a row of numbers: six for each dyad, then the place of the tracing point in its link. Lengths are in units
of the crank, which turns about the origin and whose frame is its own; the frame of a link has its origin at an outer
joint that turns, else at the inner joint, and points along the link or along what it slides on. The six numbers are
where the outer joints are on their bodies, two for each, and two more:

- RRR: the lengths of both links;
- RRP: the length of the first link, the angle of the line on its body;
- RPR: how far the second pivot is beside the line through the first one on which it slides; the last is idle;
- PRP: the angles of both lines on their bodies.

Places are pairs of real arrays: XLA makes slow code of complex numbers on a CPU.

Links are plates too, and how far they stay from regions is measured over the same arrays.
"""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.errors import InputError, nearest
from jaxnc.solvers.kernel import fusion_barrier
from jaxnc.synthesis.clearance import ClearOf, all_pairs, ring, select_least, signed_distance, swept_distance
from jaxnc.synthesis.problem import array_module
from jaxnc.synthesis.tracing.chains import CRANK, KINDS, ChainArrays, dyadic_chains
from jaxnc.types import Array, Numbers

EACH = 6  # numbers of a dyad
_RRR, _RRP, _RPR, _PRP = range(len(KINDS))
_TINY = 1e-12

Pair = tuple[Any, Any]


class Traced(NamedTuple):
    """What designs do at some poses; the last axis is that of poses."""

    point: Array  # of the tracing point, (2, T)
    sine: Array  # square of the sine of the transmission angle, below zero where a dyad does not close, (dyads, T)
    joints: Any = None  # places of the outer joints of each dyad and of its inner one, (dyads, 3, 2, T)


def times(a: Pair, b: Pair) -> Pair:
    """Multiply as complex numbers."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def _turned_back(a: Pair, b: Pair) -> Pair:
    """Multiply the first by the conjugate of the second."""
    return a[0] * b[0] + a[1] * b[1], a[1] * b[0] - a[0] * b[1]


def _scaled(a: Pair, k: Any) -> Pair:
    return a[0] * k, a[1] * k


def _add(a: Pair, b: Pair) -> Pair:
    return a[0] + b[0], a[1] + b[1]


def _minus(a: Pair, b: Pair) -> Pair:
    return a[0] - b[0], a[1] - b[1]


def _select(kind: Any, *by_kind: Any) -> Any:
    """Take what belongs to a kind of dyad, in the order of `KINDS`."""
    out, of = by_kind[-1], array_module(kind, *jax.tree.leaves(by_kind))
    for k in range(len(by_kind) - 2, -1, -1):
        one = by_kind[k]
        if isinstance(one, tuple):
            out = tuple(of.where(kind == k, a, b) for a, b in zip(one, out, strict=True))
        else:
            out = of.where(kind == k, one, out)
    return out


class Frame(NamedTuple):
    """Origin and direction of a body, each a pair."""

    origin: Pair
    along: Pair

    def at(self, local: Pair) -> Pair:
        """Place a point of the body."""
        return _add(self.origin, times(self.along, local))


def begin(theta: Numbers) -> list[Frame]:
    """Frames of the ground and of the crank at its angles; NumPy's by NumPy's, as of `close`."""
    of = array_module(theta)
    zero, one = of.zeros_like(theta), of.ones_like(theta)
    return [Frame((zero, zero), (one, zero)), Frame((zero, zero), (of.cos(theta), of.sin(theta)))]


def frame_of(frames: list[Frame], body: Any) -> Frame:
    """Take the frame of a body by its number, which may be traced."""
    out = frames[0]
    for k, frame in enumerate(frames[1:], 1):
        out = jax.tree.map(lambda new, old, k=k: jnp.where(body == k, new, old), frame, out)
    return out


def close(
    kind: Any, sign: Any, p: Pair, q: Pair, on: Pair, other: Pair, m: Any, n: Any, m_line: Pair, n_line: Pair
) -> tuple[Any, Pair, list[Frame]]:
    """Close a dyad between the places p and q of its outer joints.

    Args:
        kind: index in `KINDS`.
        sign: which of its two assemblies, 1 or -1.
        p: the first outer joint.
        q: the second one, or a point of the line on which it slides.
        on: direction of the first body.
        other: direction of the second body.
        m: first of its own numbers.
        n: second of them.
        m_line: cosine and sine of the first, which may be the angle of a line.
        n_line: of the second.

    Returns:
        The square of the sine of its transmission angle, the inner joint, and the frames of its links.
    """
    v, of = _minus(q, p), array_module(kind, m, *p, *q)
    square = of.maximum(v[0] * v[0] + v[1] * v[1], _TINY)
    turns = kind == _RRR
    one = of.where(turns | (kind == _RRP), m, 1.0)  # lengths
    two = of.where(turns, n, 1.0)
    offset = of.where(kind == _RPR, m, 0.0)
    a, b = times(on, m_line), times(other, n_line)
    foot = _turned_back(_scaled(v, -1.0), b)  # the first joint along and beside the second line
    cosine = (one * one + two * two - square) / (2.0 * one * two)
    skew = a[0] * b[1] - a[1] * b[0]
    sine = _select(
        kind,
        1.0 - cosine * cosine,
        1.0 - (foot[1] / one) ** 2,
        1.0 - offset * offset / square,
        skew * skew,
    )
    root = sign * of.sqrt(of.maximum(sine, 1e-9))
    x = (square + one * one - two * two) / (2.0 * square)
    y = one * two * root / square
    reach = root * of.sqrt(square)
    skewed = of.where(kind == _PRP, skew, 1.0)
    far = (v[0] * b[1] - v[1] * b[0]) / of.where(of.abs(skewed) < _TINY, _TINY, skewed)
    inner = _select(
        kind,
        _add(p, times(v, (x, y))),
        _add(q, _scaled(b, foot[0] + one * root)),
        q,
        _add(p, _scaled(a, far)),
    )
    slid = _scaled(times(v, (reach, -offset)), 1.0 / square)
    first = _scaled(_minus(inner, p), 1.0 / one)
    second = _scaled(_minus(inner, q), 1.0 / two)
    on_p = (kind == _RRR) | (kind == _RRP) | (kind == _RPR)
    on_q = (kind == _RRR) | (kind == _RPR)
    links = [
        Frame(_choose(on_p, p, inner), _select(kind, first, first, slid, a)),
        Frame(_choose(on_q, q, inner), _select(kind, second, b, slid, b)),
    ]
    return sine, inner, links


def _choose(which: Any, a: Pair, b: Pair) -> Pair:
    of = array_module(which, *a, *b)
    return of.where(which, a[0], b[0]), of.where(which, a[1], b[1])


def _direction(angle: Any, about: Any) -> Pair:
    """Cosine and sine; where `about` is given, which is the same number, to first order in what they differ by."""
    if about is None:
        return jnp.cos(angle), jnp.sin(angle)
    cos, sin = jnp.cos(about), jnp.sin(about)
    return cos - sin * (angle - about), sin + cos * (angle - about)


def move(chain: ChainArrays, sign: Any, x: Any, theta: Array, go: Any, about: Any = None) -> Traced:
    """Move one design to some angles of its crank.

    Args:
        chain: the chain, arrays without their axis of chains.
        sign: assembly of each dyad, ``(dyads,)``.
        x: the design, ``(6 dyads + 2,)``, or of its own at each angle, ``(6 dyads + 2, T)``.
        theta: angles, ``(T,)``, radians.
        go: true, in a way that the compiler cannot know: dyads are then compiled one by one.
        about: where `x` is one design, repeated at each angle to be differentiated, that design, ``(6 dyads + 2,)``:
            cosines and sines of what is the same in all poses are calculated once.
    """
    frames, sines, joints = begin(theta), [], []
    for d in range(chain.kind.shape[-1]):
        row = x[EACH * d : EACH * (d + 1)]
        one, two = frame_of(frames, chain.first[d]), frame_of(frames, chain.second[d])
        p, q = one.at((row[0], row[1])), two.at((row[2], row[3]))
        lines = (_direction(row[k], None if about is None else about[EACH * d + k]) for k in (4, 5))
        dyad = (chain.kind[d], sign[d], p, q, one.along, two.along, row[4], row[5], *lines)
        sine, inner, links = fusion_barrier(go, close, *dyad)
        frames += links
        sines.append(sine)
        joints.append(jnp.stack([jnp.stack(jnp.broadcast_arrays(*place)) for place in (p, q, inner)]))
    point = frame_of(frames[-2:], chain.tracer - (len(frames) - 2)).at((x[-2], x[-1]))
    return Traced(jnp.stack(point), jnp.stack(sines), jnp.stack(joints))


def sample(chain: ChainArrays, u: Array, theta: Array) -> tuple[Array, Array, Traced]:
    """Make one design from random numbers whose crank turns.

    Lengths are chosen when what a dyad hangs on has been moved all the way round: they reach everywhere. Few designs
    have to be thrown away then.

    Args:
        chain: the chain, arrays without their axis of chains.
        u: random numbers between 0 and 1, ``(dyads + 1, 8)``.
        theta: angles of the crank all round, ``(T,)``.

    Returns:
        The assembly of each dyad, the design, and what it does at the angles. Where a link turns so far from one angle
        to the next that it may do anything in between, the sines are below zero.
    """
    frames, rows, signs, sines = begin(theta), [], [], []
    size = [jnp.asarray(3.0), jnp.asarray(1.0)]  # of bodies
    for d in range(chain.kind.shape[-1]):
        sign, row, sine, links, sizes = _draw(chain, d, u[d], frames, size)
        frames += links
        sines.append(sine)
        rows += row
        signs.append(sign)
        size += sizes
    own = _select(chain.tracer - (len(frames) - 2), *size[-2:])
    radius, turn = own * 1.6 * u[-1, 0] ** 0.5, 2.0 * jnp.pi * u[-1, 1]
    local = radius * jnp.cos(turn) + 0.5 * own, radius * jnp.sin(turn)
    point = frame_of(frames[-2:], chain.tracer - (len(frames) - 2)).at(local)
    cosines = [sum(a[1:] * a[:-1] for a in frame.along) for frame in frames[2:]]
    shown = jnp.min(functools.reduce(jnp.minimum, cosines)) > 0.7  # 45 degrees
    traced = Traced(jnp.stack(point), jnp.where(shown, jnp.stack(sines), -1.0))
    return jnp.stack(signs), jnp.stack([*rows, *local]), traced


def least_between(values: Array) -> Array:
    """Least of values all round, between them too, where parabolas run through each and its neighbours, ``(…,)``."""
    before, after = jnp.roll(values, 1, axis=-1), jnp.roll(values, -1, axis=-1)
    lowest = (values <= before) & (values <= after)
    bend = jnp.where(lowest, before + after - 2.0 * values, 0.0)
    return jnp.min(values - (before - after) ** 2 / (8.0 * jnp.where(bend > 0.0, bend, jnp.inf)), axis=-1)


def redraw(chain: ChainArrays, sign: Any, x: Any, u: Array, theta: Array) -> tuple[Array, Array, Array, Frame]:
    """Keep all dyads of a design but its last one, and make that from random numbers.

    Args:
        chain: the chain, arrays without their axis of chains.
        sign: assembly of each dyad, ``(dyads,)``; that of the last one is not looked at.
        x: the design, ``(6 dyads + 2,)``; likewise.
        u: random numbers between 0 and 1, ``(8,)``.
        theta: angles of the crank, ``(T,)``.

    Returns:
        The assemblies, the design without its tracing point, the least square of the sine of a transmission angle, and
        the frame of the link on which the tracing point rides.
    """
    frames, sines = begin(theta), []
    size = [jnp.asarray(3.0), jnp.asarray(1.0)]
    dyads = chain.kind.shape[-1]
    for d in range(dyads - 1):
        kind, row = chain.kind[d], x[EACH * d : EACH * (d + 1)]
        one, two = frame_of(frames, chain.first[d]), frame_of(frames, chain.second[d])
        p, q = one.at((row[0], row[1])), two.at((row[2], row[3]))
        lines = _direction(row[4], None), _direction(row[5], None)
        sine, _, links = close(kind, sign[d], p, q, one.along, two.along, row[4], row[5], *lines)
        frames += links
        sines.append(sine)
        size += _sizes(kind, row[4], row[5], jnp.sqrt(jnp.max((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2)))
    last, row, sine, links, _ = _draw(chain, dyads - 1, u, frames, size)
    frames += links
    design = jnp.concatenate([x[: EACH * (dyads - 1)], jnp.stack(row)])
    own = frame_of(frames[-2:], chain.tracer - (len(frames) - 2))
    return jnp.append(sign[: dyads - 1], last), design, jnp.min(jnp.stack([*sines, sine])), own


def _draw(chain: ChainArrays, d: int, v: Any, frames: list[Frame], size: list[Any]) -> tuple[Any, ...]:
    """Make a dyad that closes wherever what it hangs on is: its assembly, numbers, sine, frames and sizes of links."""
    kind = chain.kind[d]
    one, two = frame_of(frames, chain.first[d]), frame_of(frames, chain.second[d])
    p_local = _spot(chain.first[d], v[0], v[1], size)
    q_local = _spot(chain.second[d], v[2], v[3], size)
    p, q = one.at(p_local), two.at(q_local)
    n_line = 2.0 * jnp.pi * v[5]
    b = times(two.along, _direction(n_line, None))
    w = _minus(p, q)
    beside = jnp.max(jnp.abs(_turned_back(w, b)[1]))
    square = w[0] ** 2 + w[1] ** 2
    near, far = jnp.sqrt(jnp.min(square)), jnp.sqrt(jnp.max(square))
    total = far * (1.03 + 1.5 * v[4] ** 2)
    less = near * 0.97 * (2.0 * v[5] - 1.0)
    m = _select(
        kind,
        0.5 * (total + less),
        beside * (1.05 + 2.0 * v[4] ** 2) + 0.1 * v[6],
        near * (1.9 * v[4] - 0.95),
        6.28 * v[4],
    )
    n = _select(kind, 0.5 * (total - less), n_line, 0.0 * v[4], n_line)
    sign = jnp.where(v[6] < 0.5, -1.0, 1.0)
    lines = _direction(m, None), _direction(n, None)
    sine, _, links = close(kind, sign, p, q, one.along, two.along, m, n, *lines)
    sine = jnp.where(near > 1e-3 * far, sine, -1.0)  # a dyad whose outer joints meet turns by itself
    return sign, [*p_local, *q_local, m, n], sine, links, _sizes(kind, m, n, far)


def _sizes(kind: Any, m: Any, n: Any, far: Any) -> list[Any]:
    """Sizes of a dyad's links, of those that slide by how far apart its outer joints are."""
    return [jnp.where(kind == _PRP, 1.0, jnp.where(kind == _RPR, far, m)), jnp.where(kind == _RRR, n, far)]


def _spot(body: Any, u: Any, v: Any, sizes: list[Any]) -> Pair:
    """Choose where on a body a joint is: at the crank's end mostly, at a link's end at times."""
    size = sizes[0]
    for k, one in enumerate(sizes[1:], 1):
        size = jnp.where(body == k, one, size)
    ends = jnp.where(body == 0, 0.0, jnp.where(body == 1, 0.66, 0.3))
    share = jnp.clip((v - ends) / (1.0 - ends), 0.0, 1.0)
    radius = size * jnp.where(body == 0, 0.4 + 1.6 * share, 1.6 * jnp.sqrt(share))
    turn = 2.0 * jnp.pi * u
    at_end = v < ends
    middle = jnp.where(body > 1, 0.5 * size, 0.0)
    return (
        jnp.where(at_end, size, middle + radius * jnp.cos(turn)),
        jnp.where(at_end, 0.0, radius * jnp.sin(turn)),
    )


# -- links as plates ---------------------------------------------------------------------------------------------------


_BODIES = 8  # of a linkage, the ground among them
_FREE = 1e6  # in place of the distance of a link that need not keep clear


class Walls(NamedTuple):
    """A region that links have to keep clear of."""

    pieces: Any  # convex ones, (m, 2, pieces)
    room: Any  # distance of the lines between a link's joints
    which: Any  # whether each body has to keep clear, (bodies,)

    def in_units(self, centre: np.ndarray, size: float) -> "Walls":
        """Write the region in units of a size about a centre."""
        return Walls((self.pieces - centre[:, None]) / size, self.room / size, self.which)


def to_walls(condition: ClearOf, bars: Sequence[int]) -> Walls:
    """Read a condition whose links are those of linkages that are not known yet."""
    names = ["crank", *(f"link {k}" for k in range(2, max(bars)))]
    for name in condition.links or ():
        if name not in names:
            raise InputError(f"trace: clear_of(links=…) has {name!r}; {nearest(name, names)}")
    which = np.array([k > 0 and k <= len(names) and (condition.links is None or names[k - 1] in condition.links)
                      for k in range(_BODIES)])  # fmt: skip
    return Walls(condition.pieces, condition.room, which)


def _carries(chain: ChainArrays, of: Any) -> Any:
    """Which bodies but the ground carry which places: the crank's pivot, joints of dyads, the tracing point.

    Returns:
        Marks, ``(…, bodies - 1, 3 dyads + 2)``; the places of a dyad are its outer joints and the inner one.
    """
    dyads = chain.kind.shape[-1]
    body = np.arange(CRANK, 2 + 2 * dyads)
    columns = [of.broadcast_to(of.asarray(body == CRANK), (*chain.tracer.shape, len(body)))]
    for d in range(dyads):
        kind, first, second = (a[..., d, None] for a in (chain.kind, chain.first, chain.second))
        one, two, rod = body == 2 + 2 * d, body == 3 + 2 * d, kind == _RPR  # a rod goes through the pivot of its slider
        columns.append((body == first) | (one & (kind <= _RPR)))
        columns.append((body == second) | (two & (rod | (kind == _RRR))) | (one & rod))
        guides = ((body == first) & (kind == _PRP)) | ((body == second) & ((kind == _RRP) | (kind == _PRP)))
        columns.append(((one | two) & ~rod) | guides)
    columns.append(body == chain.tracer[..., None])
    return of.stack(columns, axis=-1)


@functools.cache
def _most_places(dyads: int) -> int:
    """Count the places of the link that carries most of them, over all chains."""
    return int(_carries(ChainArrays.of(dyadic_chains(2 + 2 * dyads)), np).sum(axis=-1).max())


def link_corners(chain: ChainArrays, traced: Traced) -> Array:
    """Places of the joints of all links but the ground, ``(k, 2, bodies - 1, T)``, some of them more than once."""
    dyads, count = chain.kind.shape[-1], traced.point.shape[-1]
    places = jnp.concatenate([jnp.zeros((1, 2, count)), traced.joints.reshape(-1, 2, count), traced.point[None]])
    on = _carries(chain, jnp)
    order = jnp.argsort(~on, axis=1, stable=True)[:, : _most_places(dyads)]
    order = jnp.where(jnp.take_along_axis(on, order, axis=1), order, order[:, :1])
    return jnp.moveaxis(places[order], 0, 2)


def gaps(links: Array, walls: Walls, swept: bool = False) -> Array:
    """Distances of links from a region beyond the room that they need, ``(links, T)``.

    Args:
        links: corners, ``(k, 2, links, T)``.
        walls: the region.
        swept: bounds between each pose and the next, ``(links, T - 1)``, instead of distances in the poses.
    """
    pieces = jnp.asarray(walls.pieces)[:, :, :, None, None]
    shape = pieces.shape[2], *links.shape[2:]
    links, pieces = (jnp.broadcast_to(a, (*a.shape[:2], *shape)) for a in (links[:, :, None], pieces))
    measure = swept_distance if swept else signed_distance
    found = select_least(measure(links, pieces, all_pairs(len(links)), ring(len(pieces)))) - walls.room
    return jnp.where(jnp.asarray(walls.which)[CRANK : CRANK + found.shape[0], None], found, _FREE)
