"""Places of names in a view of a spatial mechanism: the rules of the plane, on the picture."""

import dataclasses

import numpy as np

from jaxnc.viz import labels as plane
from jaxnc.viz.scene import Circle, Label, Line
from jaxnc.viz.scene import Item as FlatItem
from jaxnc.viz.scene import Scene as FlatScene
from jaxnc.viz.spatial.camera import Camera
from jaxnc.viz.spatial.scene import Ball, Plate, Scene, Solid, Turn

_CURVE = 9  # places along the arrow of an angle
_STRAIGHT = ("bar", "edge", "rod", "cable", "distance", "velocity", "acceleration", "weight", "applied", "reaction")
_RINGS = (0.15, 0.38, 0.62, 0.85)  # of a spring, kept clear
_STEPS = np.concatenate(
    [[(0.0, 0.0)]]
    + [r * np.stack([np.cos(t), np.sin(t)], axis=1) for r in (0.7, 1.4, 2.2, 3.0) for t in [np.arange(16) * np.pi / 8]]
)
"""Where the name of an angle may go from where it belongs, units."""


def place_names(scene: Scene, poses: np.ndarray, scalars: np.ndarray, camera: Camera, unit: float) -> Scene:
    """Choose the offset of every name so that it keeps clear in the poses given.

    The poses are a few, ``(S, columns, 3)``, and `scalars` angles and distances in them, ``(S, scalars)``.
    """
    if not np.isfinite(poses).all():
        return scene
    columns = poses.shape[1]
    seen = camera.axes[:2].T
    tips = [label.foot(poses, unit)[:, None] for label in scene.labels if _beside(label)]
    solids = [item for item in scene.items if isinstance(item, Solid)]
    stands = [item for item in solids if item.role == "support"]
    feet = [np.stack([_foot(item, x, unit) for x in poses])[:, None] for item in stands]
    rods = [item for item in solids if item.role in ("rail", "bar", "rod") and len(item.frame.along.columns) < 2]
    ends = [np.stack([item.vertices(x, unit)[[0, -1]] for x in poses]) for item in rods]
    turns = [item for item in scene.items if isinstance(item, Turn)]
    values = [zip(poses, scalars[:, turn.scalar], strict=True) for turn in turns]
    spots = [
        np.stack([turn.spot(x, float(v), unit) for x, v in pairs])[:, None]
        for turn, pairs in zip(turns, values, strict=True)
    ]
    curves = [
        np.stack([turn.curve(x, float(v), unit, _CURVE) for x, v in zip(poses, scalars[:, turn.scalar], strict=True)])
        for turn in turns
    ]
    springs = [
        item.frame.along.columns for item in solids if item.role == "spring" and len(item.frame.along.columns) == 2
    ]
    rings = [(1.0 - s) * poses[:, a, None] + s * poses[:, b, None] for a, b in springs for s in _RINGS]
    flat = np.concatenate([poses, *tips, *feet, *spots, *ends, *curves, *rings], axis=1) @ seen
    foot = columns + len(tips)
    items: list[FlatItem] = [Circle("pin", foot + k, 0.0, 2.7) for k in range(len(stands))]
    first = foot + len(feet) + len(turns)
    items += [Line("bar", (first + 2 * k, first + 2 * k + 1)) for k in range(len(rods))]
    first += 2 * len(rods)
    items += [Line("arc", tuple(range(first + _CURVE * k, first + _CURVE * (k + 1)))) for k in range(len(turns))]
    items += [Circle("pin", flat.shape[1] - 1 - k, 0.0, 2.2) for k in range(len(rings))]
    for item in scene.items:
        if isinstance(item, Plate):
            items.extend(Line("plate", face, closed=True) for face in item.faces if len(face) > 2)
        elif isinstance(item, Ball):
            items.append(Circle("pin", item.at, 0.0, item.units))
        elif isinstance(item, Solid) and isinstance(item.frame.at, int):
            along = item.frame.along.columns
            if len(along) == 2 and item.role in _STRAIGHT:
                items.append(Line("bar", along))
            elif item.role in ("hinge", "ground hinge", "block", "cross"):
                items.append(Circle("pin", item.frame.at, 0.0, 1.5))
    names, tip = [], columns
    for label in scene.labels:
        if _beside(label):
            if label.way:
                items.append(Line("rod", (label.at, tip)))
            names.append(Label(tip, label.text))
            tip += 1
        else:
            names.append(Label(label.at, label.text))
    around = []
    for spot, turn in enumerate(turns, foot + len(feet)):
        around.append(_around(turn, items, flat, spot, unit))
        flat[:, spot] += unit * np.array([around[-1].dx, around[-1].dy])
        items.append(Circle("pin", spot, 0.0, max(1.1, 0.3 + plane.half_size(turn.text)[0])))
    whole = FlatScene(tuple(items), tuple(names), tuple(range(len(scene.bodies))), np.zeros((0, 2)), ())
    done = plane.place_labels(whole, flat, unit).labels
    names = tuple(dataclasses.replace(a, dx=b.dx, dy=b.dy) for a, b in zip(scene.labels, done, strict=True))
    moved = dict(zip(turns, around, strict=True))
    kept = tuple(moved[item] if isinstance(item, Turn) else item for item in scene.items)
    return dataclasses.replace(scene, labels=names, items=kept)


def _beside(label: Label) -> bool:
    """Whether a name stands beside a place of its own, not beside a column."""
    return label.way is not None or label.to is not None


def label_corners(label: Label, poses: np.ndarray, camera: Camera, unit: float, spare: float) -> np.ndarray:
    """Find the corners of a placed name in poses ``(T, columns, 3)``, in the plane of the picture, ``(4 T, 3)``.

    `spare` is how far within its own box they are, units.
    """
    half = plane.half_size(label.text) - spare
    shifts = [(label.dx + s * half[0], label.dy + t * half[1]) for s in (-1, 1) for t in (-1, 1)]
    across = unit * np.array(shifts) @ camera.axes[:2]
    return (label.foot(poses, unit)[:, None] + across).reshape(-1, 3)


def _foot(stand: Solid, pose: np.ndarray, unit: float) -> np.ndarray:
    """The middle of the widest part of a stand, ``(3,)``."""
    origin, axes, _ = stand.frame.stand(pose)
    return origin + 0.8 * unit * stand.mesh.vertices[:, 4].min() * axes[0]


def _around(turn: Turn, items: list[FlatItem], flat: np.ndarray, spot: int, unit: float) -> Turn:
    """Move the name of an angle to where it is clear of lines."""
    cost = 0.25 * np.linalg.norm(_STEPS, axis=1)
    for x in flat:
        a, b, width = plane.segments(tuple(items), x, unit)
        cost += plane.crowding(x[spot] / unit + _STEPS, plane.half_size(turn.text), a, b, width) / len(flat)
    dx, dy = _STEPS[int(np.argmin(cost))]
    return dataclasses.replace(turn, dx=float(dx), dy=float(dy))
