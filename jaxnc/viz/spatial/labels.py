"""Where names go in a view: the rules of the plane, on the picture."""

import dataclasses

import numpy as np

from jaxnc.viz import labels as plane
from jaxnc.viz.scene import Circle, Line
from jaxnc.viz.scene import Item as FlatItem
from jaxnc.viz.scene import Label as FlatLabel
from jaxnc.viz.scene import Scene as FlatScene
from jaxnc.viz.spatial.camera import Camera
from jaxnc.viz.spatial.scene import Ball, Label, Plate, Scene, Solid, Turn


def placed(scene: Scene, poses: np.ndarray, scalars: np.ndarray, camera: Camera, unit: float) -> tuple[Label, ...]:
    """Choose the offset of every name so that it keeps clear in the poses given.

    Args:
        scene: the scene.
        poses: a few poses ``(S, columns, 3)``.
        scalars: angles and distances in them, ``(S, scalars)``.
        camera: from where it is seen.
        unit: length of a unit.

    Returns:
        The names, placed.
    """
    columns = poses.shape[1]
    seen = camera.axes[:2].T
    tips = [np.stack([label.anchor(x, unit) for x in poses])[:, None] for label in scene.labels if label.way]
    solids = [item for item in scene.items if isinstance(item, Solid)]
    stands = [item for item in solids if item.role == "support"]
    feet = [np.stack([item.frame.stand(x)[0] for x in poses])[:, None] - (0.0, 0.0, 3.4 * unit) for item in stands]
    rods = [item for item in solids if item.role in ("rail", "bar", "rod") and len(item.frame.along.columns) < 2]
    ends = [np.stack([item.vertices(x, unit)[[0, -1]] for x in poses]) for item in rods]
    turns = [item for item in scene.items if isinstance(item, Turn)]
    values = [zip(poses, scalars[:, turn.scalar], strict=True) for turn in turns]
    spots = [
        np.stack([turn.spot(x, float(v), unit) for x, v in pairs])[:, None]
        for turn, pairs in zip(turns, values, strict=True)
    ]
    flat = np.concatenate([poses, *tips, *feet, *spots, *ends], axis=1) @ seen
    foot = columns + len(tips)
    items: list[FlatItem] = [Circle("pin", foot + k, 0.0, 2.4) for k in range(len(stands))]
    items += [Circle("pin", foot + len(feet) + k, 0.0, 1.1) for k in range(len(turns))]
    first = foot + len(feet) + len(turns)
    items += [Line("bar", (first + 2 * k, first + 2 * k + 1)) for k in range(len(rods))]
    for item in scene.items:
        if isinstance(item, Plate):
            items.extend(Line("plate", face, closed=True) for face in item.faces if len(face) > 2)
        elif isinstance(item, Ball):
            items.append(Circle("pin", item.at, 0.0, item.units))
        elif isinstance(item, Solid) and isinstance(item.frame.at, int):
            along = item.frame.along.columns
            if len(along) == 2 and item.role in ("bar", "edge", "rod", "cable"):
                items.append(Line("bar", along))
            elif item.role in ("hinge", "ground hinge", "block", "cross"):
                items.append(Circle("pin", item.frame.at, 0.0, 1.5))
    names, tip = [], columns
    for label in scene.labels:
        if label.way:
            items.append(Line("rod", (label.at, tip)))
            names.append(FlatLabel("label", tip, label.text))
            tip += 1
        else:
            names.append(FlatLabel("label", label.at, label.text))
    whole = FlatScene(tuple(items), tuple(names), tuple(range(len(scene.bodies))), np.zeros((0, 2)), ())
    done = plane.placed(whole, flat, unit).labels
    return tuple(dataclasses.replace(a, dx=b.dx, dy=b.dy) for a, b in zip(scene.labels, done, strict=True))
