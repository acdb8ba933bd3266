"""Places of names: beside their points, clear of bars, joints and each other, in several poses at once.

In a view of a spatial mechanism the rules of the plane hold on the picture. Arrows of velocities, accelerations and
forces have a scale that a reader can measure by.
"""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from jaxnc.errors import InputError, nearest
from jaxnc.viz.poses import Poses
from jaxnc.viz.scene import Arc, Circle, Hatch, Item, Label, Line, Scene, Span, Stamp
from jaxnc.viz.spatial.camera import Camera
from jaxnc.viz.spatial.scene import Ball, Plate, Solid, SpaceScene, Turn

LONGEST = 0.2
"""Length of the longest arrow, of the drawing's size."""

_USUAL, _BEYOND = 90.0, 1.6  # percentile of the poses, and how much more than in these is still drawn to scale
_DISC, _RING = 1.05, 1.6  # radius of the symbol of a centre of mass, and of one that is seen around a joint, units


@dataclass(frozen=True)
class Arrows:
    """Arrows of one quantity."""

    noun: str  # "velocity", "acceleration", or a kind of force
    columns: tuple[int, ...]  # the points they stand at; none for forces, which may act elsewhere
    places: np.ndarray  # where they stand, (T, arrows, dim)
    vectors: np.ndarray  # as lengths in the drawing, (T, arrows, dim), NaN where a pose is not right
    key: float  # length of the key's arrow in the drawing
    text: str  # what the key's arrow stands for
    longest: str  # what the longest arrow stands for
    scale: float  # what a vector is multiplied by to be a length in the drawing; those longer than `LONGEST` are cut
    chosen: tuple[int, ...] = ()  # of forces, which of their kind are shown
    discs: tuple[float, ...] = ()  # of weights, radii of the symbols of the centres of mass, units

    def point(self, poses: Poses, k: int) -> int | None:
        """Find the column of the point in the plane that an arrow stands at; None where it has its own place."""
        if poses.dim == 3:
            return None
        same = np.abs(poses.places - self.places[:, k, None])[poses.good].max(axis=(0, 2), initial=0.0) < 1e-9
        return int(np.argmax(same)) if same.any() else None


def arrows(
    poses: Poses,
    velocities,
    accelerations,
    size: float,
    pose: int | None = None,
    forces: bool | str | Iterable[str] = (),
) -> list[Arrows]:
    """Scale the arrows that were asked for.

    One pose decides the scale, or all of them. Kinds of forces that are shown share one scale, except those that are
    much smaller than the others.
    """
    out = []
    wanted = (1, "velocity", "velocities", velocities), (2, "acceleration", "accelerations", accelerations)
    for order, noun, what, names in wanted:
        columns = poses.columns(names, what)
        if not columns:
            continue
        x = poses.rates(order)[:, list(columns)]
        shown, most = _reach(np.linalg.norm(x if pose is None else x[pose : pose + 1], axis=-1))
        unit = f"{poses.topology.length_unit}/s" + ("" if order == 1 else "²")
        out.append(_scale(noun, columns, poses.places[:, list(columns)], x, (shown, shown, most), unit, size))
    return out + _forces(poses, forces, size, pose)


def _reach(length: np.ndarray) -> tuple[float, float]:
    """Choose the value that the longest arrow stands for, and find the largest, of lengths ``(T, arrows)``.

    A few poses that exceed the others by far do not decide: they would leave dots of the rest.
    """
    peaks = np.max(np.nan_to_num(length), axis=1, initial=0.0)
    most = float(peaks.max(initial=0.0))
    usual = peaks[peaks > 1e-3 * most]
    return (min(most, _BEYOND * float(np.percentile(usual, _USUAL))) if len(usual) else 0.0), most


def _scale(noun, columns, places, x, reach: tuple[float, float, float], unit: str, size: float) -> Arrows:
    """Make arrows of vectors ``(T, arrows, dim)``, to scale up to a value; with the largest of their own and of all."""
    shown, own, most = reach
    scale = LONGEST * size / shown if shown > 0 else 1.0
    length = np.linalg.norm(np.nan_to_num(x), axis=-1, keepdims=True)
    vectors = scale * x * np.minimum(1.0, shown / np.maximum(length, 1e-300))
    key = nice(0.6 * shown) if own > 0 else 1.0  # arrows of one scale have keys of one length
    cut = f", cut at {_three_digits(shown)}" if most > shown * (1 + 1e-9) else ""
    words = (
        f"{noun} {key:g} {unit}{cut}",
        f"{noun} {_three_digits(own)} {unit}{f' of {_three_digits(most)}' if cut else ''}",
    )
    return Arrows(noun, columns, places, vectors, key * scale if own > 0 else 0.0, *words, scale)


def _three_digits(value: float) -> str:
    """Write three digits, and 2320 rather than 2.32e+03."""
    return f"{float(f'{value:.3g}'):g}"


def _forces(poses: Poses, wanted: bool | str | Iterable[str], size: float, pose: int | None) -> list[Arrows]:
    """Make arrows of forces where they act, all on one scale; kinds and places where nothing acts are left out."""
    if not wanted:
        return []
    from jaxnc.dynamics.reactions import KINDS, nodal_forces

    kinds = KINDS if wanted is True else (wanted,) if isinstance(wanted, str) else tuple(wanted)
    for kind in kinds:
        if kind not in KINDS:
            raise InputError(f"forces={kind!r}; {nearest(str(kind), KINDS)}, or True for all of them")
    if len(poses.motion.rates) < 2:
        raise InputError("forces= needs a motion with velocities and accelerations: of simulate(), or of motion()")
    found = nodal_forces(poses.reactions)
    dim = poses.places.shape[-1]
    right = poses.good[:, None, None]
    every = {k: np.where(right, np.asarray(found[k][1]).reshape(poses.count, -1, dim), np.nan) for k in kinds}
    sizes = {k: np.linalg.norm(x if pose is None else x[pose : pose + 1], axis=-1) for k, x in every.items()}
    reach = {k: _reach(n) for k, n in sizes.items()}
    shared, out = max(shown for shown, _ in reach.values()), []
    longest = max(most for _, most in reach.values())
    for kind in kinds:
        chosen = np.flatnonzero(np.nanmax(sizes[kind], axis=0, initial=0.0) > 1e-9 * longest)
        if len(chosen):
            own, most = reach[kind]
            places = np.asarray(found[kind][0]).reshape(poses.count, -1, dim)[:, chosen]
            # A kind that is much smaller than the largest force has a scale of its own.
            shown = shared if own > 0.2 * shared else own  # a weight beside large reactions
            made = _scale(kind, (), places, every[kind][:, chosen], (shown, own, most), "N", size)
            made = dataclasses.replace(made, chosen=tuple(chosen.tolist()))
            if kind == "weight":
                joints = range(len(poses.topology.points))  # and markers, which are crosses
                discs = tuple(_RING if made.point(poses, k) in joints else _DISC for k in range(len(chosen)))
                made = dataclasses.replace(made, discs=discs)
            out.append(made)
    return out


Segments = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Starts and ends of segments in a pose, each ``(n, dim)``, and half of their widths, units, ``(n,)``."""


def shafts(drawn: list[Arrows], sampled: Sequence[int] | np.ndarray) -> list[Segments]:
    """Collect all arrows in some poses, and the symbols of centres of mass, as what names keep clear of; lengths."""
    parts = [(a.places, a.places + a.vectors, 0.2) for a in drawn]  # half width of an arrow, units
    parts += [(a.places, a.places, np.array(a.discs)) for a in drawn if a.discs]
    if not parts:
        return []
    starts, ends = (np.concatenate([part[k] for part in parts], axis=1)[sampled] for k in (0, 1))
    widths = np.concatenate([np.broadcast_to(width, places.shape[1]) for places, _, width in parts])
    known: np.ndarray = np.all(np.isfinite(starts + ends), axis=2)
    return [(a[k], b[k], widths[k]) for a, b, k in zip(starts, ends, known, strict=True)]


def nice(value: float) -> float:
    """Round a positive value down to 1, 2 or 5 times a power of ten."""
    if not value > 0 or not math.isfinite(value):
        raise InputError(f"no scale for {value!r}")
    power = 10.0 ** math.floor(math.log10(value))
    step = max(k for k in (1, 2, 5) if k * power <= value * (1 + 1e-12))
    return float(f"{step * power:.12g}")


# -- labels ------------------------------------------------------------------------------------------------------------


TEXT = 2.0
"""Size of the letters, units."""

_Box = tuple[np.ndarray, np.ndarray]  # middles of a name in some poses, (S, 2), and its half size, (2,), units

_EMS = {
    letter: ems
    for ems, letters in (
        (0.42, "ijltfrIJ.,:;'|!()[]-/ ₀₁₂₃₄₅₆₇₈₉′"),
        (0.6, "sczkxyvFL_εγλξχ"),
        (0.85, "wOQGNUDH"),
        (1.03, "mMW%@…∞"),
    )
    for letter in letters
}
_BETWEEN = np.array(
    [1.1, 0.45]
)  # between names side by side, which must not read as one, and one above the other, units
_SIGNS = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
_STEPS = 9  # places along the arrow of an angle
_DIRECTIONS = 24
_WAYS = np.stack([f(2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS) for f in (np.cos, np.sin)], axis=1)
_RINGS = (0.0, 0.8, 1.7, 2.9, 4.4)  # extra distance from the point, units
_NEXT = 1.75  # from a point to the edge of its name, units
_NEAR = (0.0, 1.2, 2.9)  # as `_RINGS`, of names that give way
_CLEAR = 0.55  # wanted distance to lines, units
_STRAIGHT = ("bar", "edge", "rod", "cable", "distance", "velocity", "acceleration", "weight", "applied", "reaction")
_SPRING_RINGS = (0.15, 0.38, 0.62, 0.85)  # of a spring, kept clear
_TURN_STEPS = np.concatenate(
    [[(0.0, 0.0)]]
    + [r * np.stack([np.cos(t), np.sin(t)], axis=1) for r in (0.7, 1.4, 2.2, 3.0) for t in [np.arange(16) * np.pi / 8]]
)
"""Where the name of an angle may go from where it belongs, units."""


def track_labels(
    scene: Scene, places: np.ndarray, unit: float, closed: bool, shafts: Sequence[Segments] = ()
) -> np.ndarray:
    """Choose offsets of names, units ``(K, labels, 2)``, that stay until something comes near, and give way to it.

    Of all ways round its point that a name can go, the one is taken that is least crowded and moves least.

    Places are poses along the motion, ``(K, columns, 2)``; `shafts` the arrows in them.
    """
    obstacles = _obstacles(scene, places, unit, shafts)
    turned = np.arange(_DIRECTIONS)
    apart = np.abs(turned[:, None] - turned)
    apart = np.tile(np.minimum(apart, _DIRECTIONS - apart), (len(_NEAR), len(_NEAR)))
    rings = np.repeat(np.array(_NEAR), _DIRECTIONS)
    price = 0.05 * (apart**2.0 + (rings[:, None] - rings) ** 2)  # what it costs to go on by one direction, or by a unit
    taken = [
        (np.array([arc.spot(x, unit) for x in places]) / unit, half_size(arc.text))
        for arc in scene.items
        if isinstance(arc, Arc)
    ]
    out = np.zeros((len(places), len(scene.labels), 2))
    for k, label in enumerate(scene.labels):
        half, at = half_size(label.text), label.foot(places) / unit
        steps = _steps(half, _NEAR)
        first = 0.02 * np.hypot(*(steps - (label.dx, label.dy)).T) + 0.25 * rings
        chosen = _cheapest(_prices(at[:, None] + steps, half, obstacles, taken) + first, price, closed)
        turn = np.unwrap(2 * np.pi * (chosen % _DIRECTIONS) / _DIRECTIONS)
        turn, ring = _smooth(turn, closed), _smooth(rings[chosen], closed)
        way = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        out[:, k] = way * (_NEXT + np.abs(way) @ half + ring)[:, None]
        taken.append((at + out[:, k], half))
    return out


def _cheapest(cost: np.ndarray, price: np.ndarray, closed: bool) -> np.ndarray:
    """Find the places ``(K,)`` of the cheapest way through costs ``(K, places)``, changes of place priced."""
    rounds = np.concatenate([cost, cost]) if closed else cost  # the second time round it begins where it ends
    best, whence = rounds[0], []
    for row in rounds[1:]:
        ways = best[:, None] + price
        whence.append(ways.argmin(axis=0))
        best = ways.min(axis=0) + row
    out = [int(best.argmin())]
    for back in reversed(whence):
        out.append(int(back[out[-1]]))
    return np.array(out[::-1])[-len(cost) :]


def _smooth(x: np.ndarray, closed: bool) -> np.ndarray:
    """Smooth values along a motion."""
    if len(x) < 8:
        return x
    turns = 2 * np.pi * np.round((x[-1] - x[0]) / (2 * np.pi)) if closed else 0.0
    wide = np.concatenate([x[-4:-1] - turns, x, x[1:4] + turns]) if closed else np.pad(x, 3, mode="edge")
    return np.convolve(wide, np.array([1, 2, 3, 4, 3, 2, 1]) / 16.0, mode="valid")


def _obstacles(scene: Scene, places: np.ndarray, unit: float, shafts: Sequence[Segments]) -> list[Segments]:
    """Collect what names keep clear of in each pose, units."""
    out = [segments(scene.items, x, unit) for x in places]
    for k, (start, end, width) in enumerate(shafts):
        a, b, w = out[k]
        out[k] = np.concatenate([a, start / unit]), np.concatenate([b, end / unit]), np.concatenate([w, width])
    return out


def label_boxes(scene: Scene, places: np.ndarray, unit: float) -> tuple[np.ndarray, np.ndarray]:
    """Find middles and half sizes of all names in poses ``(S, columns, 2)``, as lengths, each ``(n, 2)``."""
    found = [
        (
            name.foot(x) + unit * np.array([name.dx, name.dy]) if isinstance(name, Label) else name.spot(x, unit),
            name.text,
        )
        for x in places
        for name in (*scene.labels, *scene.items)
        if isinstance(name, (Label, Arc))
    ]
    middle = np.array([spot for spot, _ in found]).reshape(-1, 2)
    right = np.isfinite(middle).all(axis=1)
    return middle[right], unit * np.array([half_size(text) for _, text in found]).reshape(-1, 2)[right]


def place_labels(
    scene: Scene,
    places: np.ndarray,
    unit: float,
    shafts: Sequence[Segments] = (),
    paper: tuple[np.ndarray, np.ndarray] | None = None,
) -> Scene:
    """Choose the offset of every label so that it keeps clear in the poses given.

    Places are a few poses ``(S, columns, 2)``; `shafts` the arrows in them. Names stay within the corners of the
    `paper`.
    """
    if not np.isfinite(places).all():
        return scene
    obstacles = _obstacles(scene, places, unit, shafts)
    edges = None if paper is None else np.stack(paper) / unit
    items, taken = list(scene.items), []  # middles in each pose and half sizes of what stands there already
    for k, item in enumerate(items):
        if isinstance(item, Arc):
            arc = items[k] = _place_angle_name(item, places, unit, obstacles, edges, taken)
            taken.append((np.array([arc.spot(x, unit) for x in places]) / unit, half_size(arc.text)))
    scene = dataclasses.replace(scene, items=tuple(items))
    middle = places[:, list(scene.visible)].mean(axis=(0, 1))
    labels = list(scene.labels)
    feet, halves = [label.foot(places) / unit for label in labels], [half_size(label.text) for label in labels]
    options = []
    for label, at, half in zip(labels, feet, halves, strict=True):
        steps = _steps(half, _RINGS)
        cost = np.repeat(np.array(_RINGS) * 0.25, _DIRECTIONS)
        outward = label.foot(places).mean(axis=0) - middle
        size = float(np.hypot(*outward))
        if size > 0:
            cost = cost - 0.3 * np.tile(_WAYS @ outward / size, len(_RINGS))
        options.append((steps, cost + _prices(at[:, None] + steps, half, obstacles, taken, edges).mean(axis=0)))
    for turn in range(3):  # each in turn keeps clear of the others, first of those before it
        moved = False
        for k, (steps, own) in enumerate(options):
            others = [i for i in range(len(labels) if turn else k) if i != k]
            around = [(feet[i] + (labels[i].dx, labels[i].dy), halves[i]) for i in others]
            cost = own + _overlaps(feet[k][:, None] + steps, halves[k], around).mean(axis=0)
            dx, dy = steps[int(np.argmin(cost))].tolist()
            moved |= (labels[k].dx, labels[k].dy) != (dx, dy)
            labels[k] = dataclasses.replace(labels[k], dx=dx, dy=dy)
        if not moved:
            break
    return dataclasses.replace(scene, labels=tuple(labels))


def _steps(half: np.ndarray, rings: tuple[float, ...]) -> np.ndarray:
    """List where the middle of a name may be beside what it names, units: on rings, nearer and farther."""
    return np.concatenate([_WAYS * (_NEXT + np.abs(_WAYS) @ half + ring)[:, None] for ring in rings])


def _prices(
    centres: np.ndarray, half: np.ndarray, obstacles: list, taken: Sequence[_Box], edges: np.ndarray | None = None
) -> np.ndarray:
    """Price of a name where its middle may be in poses, ``(S, n, 2)``, near things, other names, and edges: (S, n)."""
    near = [crowding(x, half, *seen) + _outside(x, half, edges) for x, seen in zip(centres, obstacles, strict=True)]
    return np.stack(near) + _overlaps(centres, half, taken)


def _overlaps(centres: np.ndarray, half: np.ndarray, taken: Sequence[_Box]) -> np.ndarray:
    """Price of a name over others, for each place ``(S, n, 2)`` that its middle may have: ``(S, n)``."""
    cost = np.zeros(centres.shape[:2])
    for middle, size in taken:
        apart = np.abs(centres - middle[:, None])
        cost += 12.0 * np.maximum(np.minimum(half + size + _BETWEEN - apart, 4.0).min(axis=-1), 0.0)
    return cost


def _outside(centre: np.ndarray, half: np.ndarray, edges: np.ndarray | None) -> np.ndarray | float:
    """Price of boxes ``(n, 2)`` that reach over the edges of the paper, units."""
    if edges is None:
        return 0.0
    return 12.0 * np.maximum(np.maximum(edges[0] - centre, centre - edges[1]) + half, 0.0).sum(axis=1)


def half_size(text: str) -> np.ndarray:
    """Measure half width and half height of a text, units."""
    # A letter that is not listed is 0.68 of its size wide.
    return np.array([0.5 * TEXT * sum(_EMS.get(letter, 0.68) for letter in text), 0.5 * TEXT])


def _place_angle_name(
    arc: Arc, places: np.ndarray, unit: float, obstacles: list, edges: np.ndarray | None, taken: Sequence[_Box]
) -> Arc:
    """Move the name of a driven angle to where it is clear."""
    spots = [(share, 0.0) for share in (0.5, 0.38, 0.62, 0.26, 0.74)]
    spots += [(0.0, lead) for lead in (-0.4, 0.4, -0.75, 0.75)]
    half, options = half_size(arc.text), []
    for gap in (0.7, 1.7, -0.8, 3.4):
        for share, lead in spots:
            option = dataclasses.replace(arc, share=share, lead=lead, beside=1.0)
            ways = np.array([(option.spot(x, unit) - x[arc.at]) / unit for x in places])
            depth = float((np.abs(ways) @ half).max())  # of the name, seen from the vertex: it is clear of the arrow
            if gap > 0 or 2 * depth < arc.units:
                options.append(dataclasses.replace(option, beside=arc.units + gap + (depth if gap > 0 else -depth)))
    cost = np.arange(len(options)) * 0.02 + np.array([0.5 * abs(option.lead) for option in options])
    centres = np.stack([[option.spot(x, unit) for option in options] for x in places]) / unit
    return options[int(np.argmin(cost + _prices(centres, half, obstacles, taken, edges).sum(axis=0)))]


def crowding(centre: np.ndarray, half: np.ndarray, a: np.ndarray, b: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Price of boxes ``(n, 2)`` that are too close to segments, ``(n,)``."""
    # Only boxes and segments that are near enough to matter, component by component: this is what labels cost.
    near = np.sqrt(_squares(centre[:, None, 0], centre[:, None, 1], a, b)) < np.hypot(*half) + width + _CLEAR
    box, segment = np.nonzero(near)
    p, q = a[segment] - centre[box], b[segment] - centre[box]
    d = q - p
    # Between a box and a segment that does not cross it, the shortest way begins at a corner or at an end.
    ends = (np.square(np.maximum(np.abs(x) - half, 0.0)).sum(axis=1) for x in (p, q))
    gap = np.sqrt(np.minimum.reduce([_squares(c[:1], c[1:], p, q) for c in _SIGNS * half] + list(ends)))
    beside = (np.minimum(p, q) > half) | (np.maximum(p, q) < -half)
    apart = beside.any(axis=1) | (np.abs(p[:, 0] * d[:, 1] - p[:, 1] * d[:, 0]) > np.abs(d[:, ::-1]) @ half)
    # 0.4 units worse is it to be crossed by a segment than to touch it
    gap = np.where(apart, gap, -0.4) - width[segment]
    return np.bincount(box, np.maximum(_CLEAR - gap, 0.0) ** 2, len(centre)) * 4.0


def _squares(x: np.ndarray, y: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Find the squared distances of places from segments ``(m, 2)``, ``(..., m)``."""
    x, y = x - a[:, 0], y - a[:, 1]
    dx, dy = (b - a).T
    t = np.clip((x * dx + y * dy) / np.maximum(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
    x -= t * dx
    y -= t * dy
    return x * x + y * y


def segments(items: tuple[Item, ...], places: np.ndarray, unit: float) -> Segments:
    """List start, end and half width of every segment in a pose, in units."""
    parts, widths = [], []
    for item in items:
        if isinstance(item, (Line, Stamp, Span)):
            x = item.outline(places, unit)
            closed = item.closed and len(x) > 2
            ends = np.stack([x, np.roll(x, -1, axis=0)], axis=1)
            parts.append(ends if closed else ends[:-1])
            if closed and item.style.fill == "tint":  # blocks are full
                parts[-1] = np.concatenate([parts[-1], x[None, [0, 2]], x[None, [1, 3]]])
            widths.append(np.full(len(parts[-1]), 0.5 * item.style.width))
        elif isinstance(item, Hatch):
            parts.append(item.strokes(places, unit)[[0, -1], 1][None])
            widths.append(np.array([0.5]))
        elif isinstance(item, Circle) and not item.radius:
            parts.append(np.repeat(places[None, None, item.at], 2, axis=1))
            widths.append(np.array([item.units]))
        elif isinstance(item, Circle):
            turn = np.linspace(0, 2 * np.pi, 37)
            rim = places[item.at] + item.radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
            parts.append(np.stack([rim[:-1], rim[1:]], axis=1))
            widths.append(np.full(36, 0.2))
        elif isinstance(item, Arc):
            rim = item.rim(places, unit, _STEPS)
            parts.append(np.stack([rim[:-1], rim[1:]], axis=1))
            widths.append(np.full(_STEPS - 1, 0.1))
    if not parts:
        return np.zeros((1, 2)) + 1e9, np.zeros((1, 2)) + 1e9, np.zeros(1)
    ends = np.concatenate(parts) / unit
    return ends[:, 0], ends[:, 1], np.concatenate(widths)


# -- in space ---------------------------------------------------------------------------------------------------------


def place_names(scene: SpaceScene, poses: np.ndarray, scalars: np.ndarray, camera: Camera, unit: float) -> SpaceScene:
    """Choose the offset of every name so that it keeps clear in the poses given.

    The poses are a few, ``(S, columns, 3)``, and `scalars` angles and distances in them, ``(S, scalars)``.
    """
    if not np.isfinite(poses).all():
        return scene
    columns, items = [poses], []

    def add(places: np.ndarray) -> tuple[int, ...]:
        """Add places ``(S, n, 3)`` beside the columns; returns their numbers."""
        first = sum(x.shape[1] for x in columns)
        columns.append(places)
        return tuple(range(first, first + places.shape[1]))

    names, turns, spots = [], [], []
    for label in scene.labels:
        at = label.at
        if label.way is not None or label.to is not None:  # it stands beside a place of its own, not beside a column
            (at,) = add(label.foot(poses, unit)[:, None])
        if label.way is not None:
            items.append(Line("rod", (label.at, at)))
        names.append(Label(at, label.text))
    for item in scene.items:
        if isinstance(item, Plate):
            items += [Line("plate", face, closed=True) for face in item.faces if len(face) > 2]
        elif isinstance(item, Ball):
            items.append(Circle("pin", item.at, 0.0, item.units))
        elif isinstance(item, Turn):
            values = scalars[:, item.scalar].tolist()
            pairs = list(zip(poses, values, strict=True))
            items.append(Line("arc", add(np.stack([item.curve(x, v, unit, _STEPS) for x, v in pairs]))))
            turns.append(item)
            spots += add(np.stack([item.spot(x, v, unit) for x, v in pairs])[:, None])
        elif isinstance(item, Solid):
            along = item.frame.along.columns
            if item.role == "support":
                (foot,) = add(np.stack([_foot(item, x, unit) for x in poses])[:, None])
                items.append(Circle("pin", foot, 0.0, 2.7))
            elif item.role in ("rail", "bar", "rod") and len(along) < 2:
                items.append(Line("bar", add(np.stack([item.vertices(x, unit)[[0, -1]] for x in poses]))))
            elif item.role == "spring" and len(along) == 2:
                shares = np.array(_SPRING_RINGS)[:, None]
                rings = add((1.0 - shares) * poses[:, along[:1]] + shares * poses[:, along[1:]])
                items += [Circle("pin", ring, 0.0, 2.2) for ring in rings]
            elif isinstance(item.frame.at, int) and len(along) == 2 and item.role in _STRAIGHT:
                items.append(Line("bar", along))
            elif isinstance(item.frame.at, int) and item.role in ("hinge", "ground hinge", "block", "cross"):
                items.append(Circle("pin", item.frame.at, 0.0, 1.5))
    flat, around = np.concatenate(columns, axis=1) @ camera.axes[:2].T, []
    for spot, turn in zip(spots, turns, strict=True):
        around.append(_place_turn_name(turn, items, flat, spot, unit))
        flat[:, spot] += unit * np.array([around[-1].dx, around[-1].dy])
        items.append(Circle("pin", spot, 0.0, max(1.1, 0.3 + half_size(turn.text)[0])))
    whole = Scene(tuple(items), tuple(names), tuple(range(len(scene.bodies))), np.zeros((0, 2)), ())
    done = place_labels(whole, flat, unit).labels
    names = tuple(dataclasses.replace(a, dx=b.dx, dy=b.dy) for a, b in zip(scene.labels, done, strict=True))
    moved = dict(zip(turns, around, strict=True))
    kept = tuple(moved[item] if isinstance(item, Turn) else item for item in scene.items)
    return dataclasses.replace(scene, labels=names, items=kept)


def label_corners(label: Label, poses: np.ndarray, camera: Camera, unit: float, spare: float) -> np.ndarray:
    """Find the corners of a placed name in poses ``(T, columns, 3)``, in the plane of the picture, ``(4 T, 3)``.

    `spare` is how far within its own box they are, units.
    """
    half = half_size(label.text) - spare
    shifts = [(label.dx + s * half[0], label.dy + t * half[1]) for s in (-1, 1) for t in (-1, 1)]
    across = unit * np.array(shifts) @ camera.axes[:2]
    return (label.foot(poses, unit)[:, None] + across).reshape(-1, 3)


def _foot(stand: Solid, pose: np.ndarray, unit: float) -> np.ndarray:
    """Find the middle of the widest part of a stand, ``(3,)``."""
    origin, axes, _ = stand.frame.stand(pose)
    return origin + 0.8 * unit * stand.mesh.vertices[:, 4].min() * axes[0]


def _place_turn_name(turn: Turn, items: list[Item], flat: np.ndarray, spot: int, unit: float) -> Turn:
    """Move the name of an angle to where it is clear of lines."""
    cost = 0.25 * np.linalg.norm(_TURN_STEPS, axis=1)
    for x in flat:
        a, b, width = segments(tuple(items), x, unit)
        cost += crowding(x[spot] / unit + _TURN_STEPS, half_size(turn.text), a, b, width) / len(flat)
    dx, dy = _TURN_STEPS[int(np.argmin(cost))]
    return dataclasses.replace(turn, dx=float(dx), dy=float(dy))
