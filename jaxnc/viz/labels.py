"""Where names go: beside their points, clear of bars, joints and each other, in several poses at once."""

import dataclasses

import numpy as np

from jaxnc.viz.scene import Arc, Circle, Hatch, Item, Label, Line, Scene, Span, Stamp

TEXT = 2.0
"""Size of the letters, units."""

_WIDTH = 0.62  # of a letter, in its size: a little more than most letters take
_DIRECTIONS = 24
_RINGS = (0.0, 0.8, 1.7, 2.9)  # extra distance from the point, units
_SHAFT = 0.2  # half width of an arrow, units
_TURNS = 3
_CLEAR = 0.55  # wanted distance to lines, units


def placed(scene: Scene, places: np.ndarray, unit: float, shafts: np.ndarray | None = None) -> Scene:
    """Choose the offset of every label so that it keeps clear in the poses given.

    Args:
        scene: the scene.
        places: a few poses ``(S, columns, 2)``.
        unit: length of a unit.
        shafts: starts and ends of arrows in these poses, ``(S, arrows, 2, 2)``.

    Returns:
        The scene with labels placed.
    """
    if not np.isfinite(places).all():
        return scene
    obstacles = [segments(scene.items, x, unit) for x in places]
    if shafts is not None:
        ends = [s[np.isfinite(s).all(axis=(1, 2))] / unit for s in shafts]
        obstacles = [
            (np.concatenate([a, s[:, 0]]), np.concatenate([b, s[:, 1]]), np.concatenate([w, np.full(len(s), _SHAFT)]))
            for (a, b, w), s in zip(obstacles, ends, strict=True)
        ]
    items = tuple(_beside(item, places, unit, obstacles) if isinstance(item, Arc) else item for item in scene.items)
    scene = dataclasses.replace(scene, items=items)
    arcs = [item for item in items if isinstance(item, Arc)]
    middle = places[:, list(scene.visible)].mean(axis=(0, 1))
    turn = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    ways = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    done = list(scene.labels)
    halves = [half_of(label.text) for label in done]
    costs = []
    for label, half in zip(done, halves, strict=True):
        reach = 1.75 + np.abs(ways) @ half
        steps = np.concatenate([ways * (reach + ring)[:, None] for ring in _RINGS])  # centres, units
        cost = np.repeat(np.array(_RINGS) * 0.25, _DIRECTIONS)
        outward = places[:, label.at].mean(axis=0) - middle
        size = float(np.hypot(*outward))
        if size > 0:
            cost = cost - 0.3 * np.tile(ways @ outward / size, len(_RINGS))
        for x, (a, b, width) in zip(places, obstacles, strict=True):
            centre = x[label.at] / unit + steps
            cost += crowding(centre, half, a, b, width) / len(places)
            for arc in arcs:
                gap = np.abs(centre - arc.spot(x, unit) / unit)
                over = np.minimum(half + half_of(arc.text) - gap, 4.0).min(axis=1)
                cost += 12.0 * np.maximum(over, 0.0) / len(places)
        costs.append((steps, cost))
    for turn in range(_TURNS):  # each in turn keeps clear of the others, first of those before it
        moved = False
        for k, (steps, own) in enumerate(costs):
            others = [i for i in range(len(done) if turn else k) if i != k]
            cost = own + _over(places, unit, [done[i] for i in others], [halves[i] for i in others], done[k], steps)
            best = steps[int(np.argmin(cost))]
            moved |= (done[k].dx, done[k].dy) != (float(best[0]), float(best[1]))
            done[k] = dataclasses.replace(done[k], dx=float(best[0]), dy=float(best[1]))
        if not moved:
            break
    return dataclasses.replace(scene, labels=tuple(done))


def _over(
    places: np.ndarray, unit: float, others: list[Label], halves: list[np.ndarray], label: Label, steps: np.ndarray
) -> np.ndarray:
    """What it costs to put a label over others, for each place that it may have, ``(n,)``."""
    if not others:
        return np.zeros(len(steps))
    at = places[:, [other.at for other in others]] / unit + np.array([(other.dx, other.dy) for other in others])
    gap = np.abs((places[:, label.at] / unit)[:, None, None] + steps[None, :, None] - at[:, None])  # (S, n, others, 2)
    over = np.minimum(half_of(label.text) + np.array(halves) + 0.3 - gap, 4.0).min(axis=-1)
    return 12.0 * np.maximum(over, 0.0).sum(axis=-1).mean(axis=0)


def half_of(text: str) -> np.ndarray:
    """Half width and half height of a text, units."""
    return np.array([0.5 * _WIDTH * TEXT * max(len(text), 1), 0.5 * TEXT])


def _beside(arc: Arc, places: np.ndarray, unit: float, obstacles: list) -> Arc:
    """Move the name of a driven angle to where it is clear."""
    spots = [(share, 0.0) for share in (0.5, 0.38, 0.62, 0.26, 0.74)]
    spots += [(0.0, lead) for lead in (-0.4, 0.4, -0.75, 0.75)]
    options = [
        dataclasses.replace(arc, share=share, lead=lead, beside=arc.units + gap)
        for gap in (1.6, 2.6, -1.7)
        for share, lead in spots
    ]
    cost = np.arange(len(options)) * 0.02 + np.array([0.5 * abs(option.lead) for option in options])
    for x, (a, b, width) in zip(places, obstacles, strict=True):
        centre = np.stack([option.spot(x, unit) for option in options]) / unit
        cost += crowding(centre, half_of(arc.text), a, b, width)
    return options[int(np.argmin(cost))]


def crowding(centre: np.ndarray, half: np.ndarray, a: np.ndarray, b: np.ndarray, width: np.ndarray) -> np.ndarray:
    """How much boxes ``(n, 2)`` are too close to segments, ``(n,)``."""
    columns = max(3, round(2 * half[0]))
    across, up = np.meshgrid(np.linspace(-1, 1, columns) * half[0], np.linspace(-1, 1, 3) * half[1])
    # Only boxes and segments that are near enough to matter, component by component: this is what labels cost.
    near = np.sqrt(_squares(centre[:, None, 0], centre[:, None, 1], a, b)) < np.hypot(*half) + width + _CLEAR
    box, segment = np.nonzero(near)
    x, y = centre[box, 0] + across.reshape(-1, 1), centre[box, 1] + up.reshape(-1, 1)
    gap = np.sqrt(_squares(x, y, a[segment], b[segment]).min(axis=0)) - width[segment]
    return np.bincount(box, np.maximum(_CLEAR - gap, 0.0) ** 2, len(centre)) * 4.0


def _squares(x: np.ndarray, y: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Squared distances of places from segments ``(m, 2)``, ``(..., m)``."""
    x, y = x - a[:, 0], y - a[:, 1]
    dx, dy = (b - a).T
    t = np.clip((x * dx + y * dy) / np.maximum(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
    x -= t * dx
    y -= t * dy
    return x * x + y * y


def segments(items: tuple[Item, ...], places: np.ndarray, unit: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start, end and half width of every segment in a pose, in units."""
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
    if not parts:
        return np.zeros((1, 2)) + 1e9, np.zeros((1, 2)) + 1e9, np.zeros(1)
    ends = np.concatenate(parts) / unit
    return ends[:, 0], ends[:, 1], np.concatenate(widths)
