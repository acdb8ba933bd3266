"""Conditions that links keep clear of regions and of one another over a whole motion, between its poses too.

A link is the convex hull of its points, rounded by half of its width, as the workshop makes its plates. Its distance
from a convex region is that of the nearest points, and where they overlap minus the shortest way out: a function of the
places with exact derivatives almost everywhere. A region that is not convex is cut into pieces that are.

Between two poses corners are taken to move on straight lines. The distance of convex shapes is a convex function then,
never below its tangents at both poses; how far corners leave these lines is bounded by twice their second differences.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.synthesis.conditions import NO_POSE, Condition, Seen
from jaxnc.synthesis.loops import ground_points
from jaxnc.synthesis.validate import as_floats, check_name
from jaxnc.system.system import System
from jaxnc.types import Array

_FLAT = 1e-12  # of the size: corners that are one, and regions without an area

Pairs = tuple[tuple[int, int], ...]


# -- distances of convex shapes ----------------------------------------------------------------------------------------


def all_pairs(count: int) -> Pairs:
    """Pairs of corners of a hull that may be its edges, where their order is not known."""
    return tuple(itertools.combinations(range(count), 2))


def ring(count: int) -> Pairs:
    """Edges of a convex polygon whose corners are in order."""
    return tuple((k, (k + 1) % count) for k in range(count))


def signed_distance(one: Array, other: Array, edges: Pairs, other_edges: Pairs) -> Array:
    """Distance of two convex shapes; where they overlap minus the shortest way by which they come apart.

    Which corners and which edge are nearest is found first, without derivatives; then their distance has them.

    Args:
        one: corners, ``(k, 2, …)``; what follows are poses.
        other: corners, ``(m, 2, …)``.
        edges: pairs of corners of the first, its edges among them.
        other_edges: those of the other one.

    Returns:
        Distances, ``(…)``.
    """
    both = jnp.concatenate([one, other])
    chosen, across, sense = _find_nearest(jax.lax.stop_gradient(both), len(one), edges, other_edges)
    own = np.arange(len(both)).reshape(-1, 1, *(1,) * (both.ndim - 2))
    p, q, a, b = (jnp.sum(jnp.where(own == k, both, 0.0), axis=0) for k in chosen)
    gap, way = q - p, b - a
    square, length = (x[0] ** 2 + x[1] ** 2 for x in (gap, way))
    far = jnp.where(square > 0.0, jnp.sqrt(jnp.where(square > 0.0, square, 1.0)), 0.0)
    height = (way[0] * gap[1] - way[1] * gap[0]) / jnp.sqrt(jnp.where(length > 0.0, length, 1.0))
    return jnp.where(across, jnp.where(sense == 0.0, jnp.abs(height), sense * height), far)


def _find_nearest(
    both: Array, count: int, edges: Pairs, other_edges: Pairs
) -> tuple[tuple[Array, Array, Array, Array], Array, Array]:
    """Find what of two shapes is nearest; the first so many corners are those of the first one.

    Returns:
        A corner of each, and both ends of an edge, by number; whether the distance is that across the edge rather than
        that of the corners; and to which side of it, 0 for the one that it is on.
    """
    pairs = np.array([*edges, *((i + count, j + count) for i, j in other_edges)], int).reshape(-1, 2)
    start, way = both[pairs[:, 0]], both[pairs[:, 1]] - both[pairs[:, 0]]
    square = way[:, 0] ** 2 + way[:, 1] ** 2
    # A corner and an edge of the other shape, or one of its ends; corners alone where there are no edges.
    spots = [(c, e) for e, (i, _) in enumerate(pairs) for c in range(len(both)) if (c < count) != (i < count)]
    if not spots:
        p, q = np.indices((count, len(both) - count)).reshape(2, -1)
        best = _find_least(jnp.sum((both[p] - both[count + q]) ** 2, axis=1))[1]
        p, q = jnp.asarray(p)[best], count + jnp.asarray(q)[best]
        return (p, q, p, q), jnp.zeros(best.shape, bool), jnp.zeros(best.shape)
    corner, edge = np.array(spots).T
    x, y = (both[corner, k] - start[edge, k] for k in range(2))
    along = x * way[edge, 0] + y * way[edge, 1]
    share = jnp.clip(along / jnp.where(square > 0.0, square, 1.0)[edge], 0.0, 1.0)
    best = _find_least((x - share * way[edge, 0]) ** 2 + (y - share * way[edge, 1]) ** 2)[1]
    corner, edge = jnp.asarray(corner)[best], jnp.asarray(edge)[best]
    share = jnp.take_along_axis(share, best[None], axis=0)[0]
    a, b = (jnp.asarray(pairs[:, k])[edge] for k in range(2))
    end = jnp.where(share < 1.0, a, b)
    near = jnp.minimum(corner, end), jnp.maximum(corner, end), a, b
    # Where they overlap the way out is across an edge, from the last corner of one to the first of the other.
    level = both[:, None, 1] * way[:, 0] - both[:, None, 0] * way[:, 1]
    (low, lows), (less, firsts) = _find_least(level[:count]), _find_least(level[count:])
    (high, highs), (more, lasts) = _find_least(-level[:count]), _find_least(-level[count:])
    gaps = jnp.concatenate([less + high, low + more])  # how far the other one is beyond the first, and before it
    size = jnp.tile(jnp.sqrt(square), (2, *(1,) * (square.ndim - 1)))
    deep, side = _find_least(jnp.where(size > 0.0, -gaps / jnp.where(size > 0.0, size, 1.0), jnp.inf))
    p, q = (jnp.take_along_axis(jnp.concatenate(x), side[None], axis=0)[0] for x in ((highs, lows), (firsts, lasts)))
    a, b = (jnp.asarray(pairs[:, k])[side % len(pairs)] for k in range(2))
    overlap = (deep >= 0.0) & jnp.isfinite(deep)
    p, q, a, b = (jnp.where(overlap, x, y) for x, y in zip((p, count + q, a, b), near, strict=True))
    across = overlap | ((share > 0.0) & (share < 1.0))
    return (p, q, a, b), across, jnp.where(overlap, jnp.where(side < len(pairs), 1.0, -1.0), 0.0)


def _find_least(x: Array) -> tuple[Array, Array]:
    """Least along the first axis, and where it is."""
    at = jnp.broadcast_to(jnp.arange(len(x)).reshape(-1, *(1,) * (x.ndim - 1)), x.shape)
    while len(x) > 1:
        half = len(x) // 2
        less = x[:half] < x[half : 2 * half]
        x, at = (jnp.concatenate([jnp.where(less, a[:half], a[half : 2 * half]), a[2 * half :]]) for a in (x, at))
    return x[0], at[0]


def select_least(x: Array) -> Array:
    """Least along the first axis, by selections.

    JAX finds what a minimum depends on by comparing again, and where XLA has rounded otherwise then, it finds nothing.
    """
    return _find_least(x)[0]


def swept_distance(one: Array, other: Array, edges: Pairs, other_edges: Pairs) -> Array:
    """Bound the distance of two moving convex shapes from below, between each pose and the next.

    Args:
        one: corners in poses that follow one another, ``(k, 2, …, T)``.
        other: those of the other one, ``(m, 2, …, T)``.
        edges: pairs of corners of the first, its edges among them.
        other_edges: those of the other one.

    Returns:
        Bounds, ``(…, T - 1)``.
    """
    gap = _least_straight(one[..., :-1], one[..., 1:], other[..., :-1], other[..., 1:], edges, other_edges)
    return gap - _sag(one) - _sag(other)


def _least_straight(a: Array, b: Array, c: Array, d: Array, edges: Pairs, other_edges: Pairs) -> Array:
    """Bound the distance of shapes while their corners move straight on, from a to b and from c to d."""
    step = b - a, d - c

    def apart(one: Array, other: Array) -> Array:
        return signed_distance(one, other, edges, other_edges)

    first, leaving = jax.jvp(apart, (a, c), step)
    last, coming = jax.jvp(apart, (b, d), step)
    dips = (leaving < 0.0) & (coming > 0.0)
    share = jnp.clip((last - first - coming) / jnp.where(dips, leaving - coming, 1.0), 0.0, 1.0)
    return select_least(jnp.stack([first, last, jnp.where(dips, first + share * leaving, first)]))


def _sag(corners: Array) -> Array:
    """Bound how far corners leave the straight line from each pose to the next, ``(…, T - 1)``."""
    bend = jnp.diff(corners, 2, axis=-1)
    square = -select_least(-(bend[:, 0] ** 2) - bend[:, 1] ** 2)
    bend = jnp.where(square > 0.0, jnp.sqrt(jnp.where(square > 0.0, square, 1.0)), 0.0)
    bend = jnp.concatenate([bend[..., :1], bend, bend[..., -1:]], axis=-1)
    # Twice how far a parabola leaves its chord, which is an eighth of the second difference.
    return (2.0 / 8.0) * jnp.maximum(bend[..., :-1], bend[..., 1:])


# -- regions -----------------------------------------------------------------------------------------------------------


def as_region(region: object, what: str) -> np.ndarray:
    """Check a region: corners of a polygon, or two opposite ones of a box; return its corners anticlockwise."""
    corners = as_floats(region)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 2:
        raise InputError(
            f"{what}: a region is a polygon, its corners (N, 2), or a box, two opposite corners such as "
            f"[(0, 0), (2, 1)]; got {region!r}"
        )
    if not np.isfinite(corners).all():
        bad = int(np.flatnonzero(~np.isfinite(corners).all(axis=1))[0])
        raise InputError(f"{what}: corner {bad + 1} is not finite: {corners[bad].tolist()}")
    size = float(np.ptp(corners, axis=0).max())
    if len(corners) == 2:
        (a, b), (c, d) = np.sort(corners, axis=0)
        if not min(c - a, d - b) > _FLAT * size:
            raise InputError(f"{what}: the box from {corners[0].tolist()} to {corners[1].tolist()} has no area")
        return np.array([[a, b], [c, b], [c, d], [a, d]])
    corners = corners[np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1) > _FLAT * size]
    most = 200
    if len(corners) > most:
        raise InputError(f"{what}: {len(corners)} corners; draw the region with at most {most}")
    for i, j in itertools.combinations(range(len(corners)), 2):
        if j - i > 1 and (i > 0 or j < len(corners) - 1) and _cross(corners, i, j):
            raise InputError(
                f"{what}: the edges behind corners {i + 1} and {j + 1} cross; list the corners in order round the "
                f"region, and give two regions as two conditions"
            )
    x, y = corners.T
    area = 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    if len(corners) < 3 or not abs(area) > _FLAT * size**2:
        raise InputError(f"{what}: the corners lie on one line; a region has an area")
    return corners if area > 0 else corners[::-1].copy()


def _signed_area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    return float((b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]))


def _cross(corners: np.ndarray, i: int, j: int) -> bool:
    """Tell whether the edges behind two corners meet."""
    a, b, c, d = (corners[k % len(corners)] for k in (i, i + 1, j, j + 1))
    one, two, three, four = _signed_area(a, b, c), _signed_area(a, b, d), _signed_area(c, d, a), _signed_area(c, d, b)
    if one == two == 0.0:  # on one line
        way = b - a
        low, high = sorted(((c - a) @ way, (d - a) @ way))
        return bool(high >= 0.0 and low <= way @ way)
    return one * two <= 0.0 and three * four <= 0.0


def convex_pieces(corners: np.ndarray) -> tuple[np.ndarray, ...]:
    """Cut ears off a polygon, anticlockwise, until it is convex, and join them as far as they stay convex."""

    def convex(piece: list[int]) -> bool:
        some = corners[piece]
        return all(_signed_area(*some[np.arange(k, k + 3) % len(piece)]) >= 0.0 for k in range(len(piece)))

    rest, pieces = list(range(len(corners))), []
    while len(rest) > 3 and not convex(rest):
        ear = next(k for k in range(len(rest)) if _is_ear(corners, rest, k))
        pieces.append([rest[ear - 1], rest[ear], rest[(ear + 1) % len(rest)]])
        del rest[ear]
    pieces.append(rest)
    joined = True
    while joined:
        joined = False
        for one, other in itertools.combinations(pieces, 2):
            whole = _join_pieces(one, other)
            if whole is not None and convex(whole):
                pieces = [p for p in pieces if p is not one and p is not other] + [whole]
                joined = True
                break
    return tuple(corners[piece] for piece in pieces)


def _is_ear(corners: np.ndarray, rest: list[int], k: int) -> bool:
    a, b, c = corners[[rest[k - 1], rest[k], rest[(k + 1) % len(rest)]]]
    if _signed_area(a, b, c) <= 0.0:
        return False
    others = corners[[i for i in rest if i not in (rest[k - 1], rest[k], rest[(k + 1) % len(rest)])]]
    return not any(min(_signed_area(a, b, p), _signed_area(b, c, p), _signed_area(c, a, p)) >= 0.0 for p in others)


def _join_pieces(one: list[int], other: list[int]) -> list[int] | None:
    """Join two pieces along an edge that they share."""
    for k, a in enumerate(one):
        b = one[(k + 1) % len(one)]
        if a in other and b in other and other[(other.index(b) + 1) % len(other)] == a:
            at = other.index(a)
            return one[k + 1 :] + one[: k + 1] + [other[(at + i) % len(other)] for i in range(1, len(other) - 1)]
    return None


def inside(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Tell which points ``(N, 2)`` lie inside of a polygon."""
    a, b = corners, np.roll(corners, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    level = (a[:, 1] > y) != (b[:, 1] > y)
    rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
    return np.sum(level & (x < a[:, 0] + (y - a[:, 1]) / rise * (b[:, 0] - a[:, 0])), axis=1) % 2 == 1


# -- conditions --------------------------------------------------------------------------------------------------------


def link_points(system: System) -> dict[str, tuple[str, ...]]:
    """Names of the points, markers among them, of every link that moves."""
    top, still = system.topology, ground_points(system)
    out = {}
    for body in top.bodies:
        if not set(body.points) <= still:
            on = (m.name for m in top.markers if m.body == body.name and not m.direction)
            out[body.name] = (*(top.points[p] for p in body.points), *on)
    return out


def _check_links(system: System, what: str, known: Mapping[str, object], names: Sequence[str]) -> None:
    for name in names:
        check_name(name, known, f"{what}: {system.name!r} has no link {name!r} that moves")


def _corners(motion: Motion, links: Sequence[tuple[str, ...]]) -> Array:
    """Places of the points of links, ``(k, 2, links, T)``, the first one again for those that a link does not have.

    Poses that failed are at zero: nothing is to be learnt from their numbers.
    """
    most = max(len(names) for names in links)
    places = [[motion[name].T for name in (*names, *names[:1] * (most - len(names)))] for names in links]
    return jnp.where(motion.converged, jnp.stack([jnp.stack(row) for row in places], axis=2), 0.0)


def pad_pieces(pieces: Sequence[np.ndarray]) -> np.ndarray:
    """Corners of convex pieces, ``(m, 2, pieces)``, the last one again for those that a piece does not have."""
    most = max(len(piece) for piece in pieces)
    return np.stack([np.concatenate([p, np.repeat(p[-1:], most - len(p), axis=0)]) for p in pieces], axis=2)


def _largest_sag(turn: Motion, links: Sequence[tuple[str, ...]]) -> float:
    """The largest of the bounds for leaving the straight line that are taken off a distance."""
    places = np.stack([np.asarray(turn[name]) for name in {name for names in links for name in names}])
    return 0.25 * float(np.max(np.linalg.norm(np.diff(places, 2, axis=1), axis=-1), initial=0.0))


def _where_solved(motion: Motion, found: Array) -> Array:
    return jnp.ravel(jnp.where(motion.converged[1:] & motion.converged[:-1], found, NO_POSE))


@dataclass(frozen=True, eq=False)
class ClearOf(Condition):
    """Links keep clear of a region over the whole range of the input."""

    corners: np.ndarray  # of the region, anticlockwise, (N, 2)
    pieces: np.ndarray  # convex ones, which make it up, (m, 2, pieces), see `pad_pieces`
    width: float  # of links
    margin: float
    links: tuple[str, ...] | None  # all that move if None
    points: tuple[tuple[str, ...], ...] = ()  # of each link
    planar = "clear_of"
    over_range = True

    @classmethod
    def of(cls, region: object, width: float, margin: float = 0.0, links: tuple[str, ...] | None = None) -> "ClearOf":
        """Check a region and lengths; see `clear_of`."""
        corners = as_region(region, "clear_of")
        sizes = _as_size(width, "clear_of: width"), _as_size(margin, "clear_of: margin")
        return cls(corners, pad_pieces(convex_pieces(corners)), *sizes, links)

    @property
    def name(self) -> str:
        low, high = np.min(self.corners, axis=0), np.max(self.corners, axis=0)
        return f"clear of the region within ({low[0]:.4g}, {low[1]:.4g}) and ({high[0]:.4g}, {high[1]:.4g})"

    @property
    def room(self) -> Any:
        """How far the lines between a link's points stay away."""
        return 0.5 * self.width + self.margin

    def prepare(self, system: System, driven: str) -> "Condition":
        super().prepare(system, driven)
        known = link_points(system)
        _check_links(system, "clear_of", known, self.links or ())
        return replace(self, points=tuple(known[name] for name in self.links or known))

    def values(self, seen: Seen) -> Array:
        turn = seen.turn
        assert turn is not None
        links, walls = _corners(turn, self.points)[:, :, :, None], jnp.asarray(self.pieces)[:, :, None, :, None]
        shape = *links.shape[2:3], *walls.shape[3:4], *links.shape[4:]
        links, walls = (jnp.broadcast_to(a, (*a.shape[:2], *shape)) for a in (links, walls))
        found = swept_distance(links, walls, all_pairs(len(links)), ring(len(walls)))
        return _where_solved(turn, (found - self.room) / seen.size)

    def sag(self, turn: Motion) -> float:
        return _largest_sag(turn, self.points)


@dataclass(frozen=True)
class ClearLinks(Condition):
    """Links that lie in one layer keep clear of each other over the whole range of the input."""

    layers: tuple[tuple[str, ...], ...]  # names of links, layer by layer
    width: float
    margin: float
    pairs: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = ()  # points of two links each
    planar = "clear_links"
    over_range = True

    @property
    def name(self) -> str:
        return "clear links " + "; ".join(", ".join(layer) for layer in self.layers)

    def prepare(self, system: System, driven: str) -> "Condition":
        super().prepare(system, driven)
        known, top, pairs = link_points(system), system.topology, []
        welds = [{top.bodies[k].name for k in joint.bodies} for joint in top.joints if joint.type == "weld"]
        for layer in self.layers:
            _check_links(system, "clear_links", known, layer)
            for one, other in itertools.combinations(layer, 2):
                shared = set(known[one]) & set(known[other])
                if len(shared) == 1 and {one, other} not in welds:
                    raise InputError(
                        f"clear_links: {one} and {other} are joined at {shared.pop()} and cannot lie in one layer"
                    )
                if not shared and {one, other} not in welds:
                    pairs.append((known[one], known[other]))
        if not pairs:
            raise InputError("clear_links: no two links lie in one layer; there is nothing to keep apart")
        return replace(self, pairs=tuple(pairs))

    def values(self, seen: Seen) -> Array:
        turn = seen.turn
        assert turn is not None
        one, other = (_corners(turn, [pair[k] for pair in self.pairs]) for k in range(2))
        found = swept_distance(one, other, all_pairs(len(one)), all_pairs(len(other)))
        return _where_solved(turn, (found - self.width - self.margin) / seen.size)

    def sag(self, turn: Motion) -> float:
        return sum(_largest_sag(turn, [pair[k] for pair in self.pairs]) for k in range(2))


@public
def clear_of(region: object, links: Sequence[str] | None = None, width: float = 0.0, margin: float = 0.0) -> Condition:
    """Links keep clear of a region over the whole range of the input, between its poses too.

    A link is a plate: the convex hull of its points and markers, rounded by half of its width.

    Args:
        region: corners of a polygon in order, ``(N, 2)``, or two opposite corners of a box, in units of the mechanism.
        links: names of links (bodies); all that move if not given.
        width: of the links, a length.
        margin: what stays between them and the region at least, a length.

    Raises:
        InputError: a polygon that crosses itself or has no area, lengths that are negative.
    """
    return ClearOf.of(region, width, margin, None if links is None else _as_links(links, "clear_of: links="))


@public
def clear_links(layers: Mapping[str, int] | Sequence[str], width: float = 0.0, margin: float = 0.0) -> Condition:
    """Links that lie in one layer keep clear of each other over the whole range of the input, between its poses too.

    Args:
        layers: the layer of each link by name, as `jaxnc.workshop.Assembly.layer_of` has them; or names of links
            that lie in one layer.
        width: of the links, in units of the mechanism.
        margin: what stays between them at least, a length.

    Raises:
        InputError: layers that hold no two links, lengths that are negative.
    """
    if isinstance(layers, Mapping):
        names = _as_links(list(layers), "clear_links: layers=")
        groups = [tuple(n for n in names if layers[n] == k) for k in dict.fromkeys(layers.values())]
    else:
        groups = [_as_links(layers, "clear_links: layers=")]
    groups = [group for group in groups if len(group) > 1]
    if not groups:
        raise InputError(f"clear_links: layers={layers!r}: no two links lie in one layer; name two at least")
    return ClearLinks(tuple(groups), _as_size(width, "clear_links: width"), _as_size(margin, "clear_links: margin"))


def refuse_enclosed(what: str, conditions: Sequence[Condition], point: str | None, target: np.ndarray) -> None:
    """Refuse regions that hold all targets of a point of a link that is to keep clear of them."""
    for c in conditions:
        if not isinstance(c, ClearOf) or not (point is None or any(point in names for names in c.points)):
            continue
        if len(target) and inside(target, c.corners).all():
            raise InputError(
                f"{what}: all {len(target)} targets lie inside of what the link of {point or 'the tracer'} is to keep "
                f"{c.name}; take the region away, or name in links= those that are to stay out of it"
            )


def _as_links(names: object, what: str) -> tuple[str, ...]:
    given = (names,) if isinstance(names, str) else names
    if not isinstance(given, Sequence) or not given or not all(isinstance(name, str) for name in given):
        raise InputError(f"{what} takes names of links, such as ['coupler', 'rocker'], got {names!r}")
    return tuple(dict.fromkeys(given))


def _as_size(value: Any, what: str) -> float:
    size = as_floats(value)
    if isinstance(value, bool) or size.ndim or not 0.0 <= size < np.inf:
        raise InputError(f"{what} must be a length, 0 or more, got {value!r}")
    return float(size)
