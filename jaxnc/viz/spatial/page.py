"""A spatial mechanism as the page draws it: its scene, with every mesh written once."""

import dataclasses
from typing import Any

import numpy as np

from jaxnc.kinematics.hardpoints import numbered
from jaxnc.viz.arrows import LONGEST, Arrows, arrows, in_page
from jaxnc.viz.numbers import packed, quantum_of, rounded, written
from jaxnc.viz.poses import Poses
from jaxnc.viz.spatial.camera import Camera
from jaxnc.viz.spatial.drawing import View, spread
from jaxnc.viz.spatial.mesh import Coil, Mesh, Piece, Shell, Turned
from jaxnc.viz.spatial.scene import SOLIDS, Ball, Frame, Item, Label, Plate, Solid, Turn, Way

_UNIT = 1.0 / 95.0  # of the drawing's size, while labels are placed; the page chooses its own
_CORNERS = 400  # places that the page fits its first view to


def spatial(
    data: Poses, trace, velocities, accelerations, camera: Camera | None, forces: bool
) -> tuple[dict, list[Arrows]]:
    """What a page of a spatial mechanism draws, and its arrows.

    The camera is the first view, chosen to suit the mechanism if not given.
    """
    view = View(data, data.shown.tolist(), trace, True, camera)
    drawn = arrows(data, velocities, accelerations, view.size, None, forces)
    without = len(view.scene.items) + sum(len(a.columns) for a in drawn)
    view.add_arrows(drawn)
    view.place(spread(data.shown), _UNIT * view.size)
    top, scene, places = data.topology, view.scene, len(data.names)
    meshes: dict[Mesh, int] = {}
    items = [_item(item, meshes) for item in scene.items]
    for item in items[without:]:
        item["force"] = 1
    ends = view.columns[data.shown, places + len(data.directions) :].reshape(-1, 3)  # of arrows
    seen = np.concatenate([scene.reach(view.columns[data.shown]), view.tips, ends[np.isfinite(ends).all(axis=1)]])
    directions = data.directions
    quantum = quantum_of(data.places[data.shown])
    trade = numbered((*data.names, *directions))
    content = {
        "points": [
            {
                "name": name,
                **({"trade": trade[name]} if name in trade else {}),
                "body": scene.bodies[k],
                "marker": k >= len(top.points),
                "moves": k >= len(top.points) or not all(top.fixed[3 * k : 3 * k + 3]),
                **_places(view.columns[:, k], quantum),
            }
            for k, name in enumerate(data.names)
        ],
        "directions": [
            {"name": name, "moves": True, **_places(view.columns[:, places + k], 1e-6)}
            for k, name in enumerate(directions)
        ],
        "traces": list(view.traces),
        "box": rounded(np.stack([view.lower, view.upper])),
        "seen": rounded(_outermost(seen), 5),
        "size": view.size,
        "longest": LONGEST * view.size,
        "view": [view.camera.elevation, view.camera.azimuth],
        "styles": {role: written(SOLIDS[role]) for role in sorted({item["role"] for item in items})},
        "items": items,
        "labels": [_plain(label) for label in scene.labels],
        "meshes": [[piece(one) for one in mesh.pieces] for mesh in meshes],
        **in_page(data, drawn, quantum),
    }
    return content, drawn


def _places(x: np.ndarray, quantum: float) -> dict[str, Any]:
    return {axis: packed(x[:, k], quantum) for k, axis in enumerate("xyz")}


def _outermost(x: np.ndarray) -> np.ndarray:
    """Some of the places, those that lie furthest out in many directions among them."""
    if len(x) <= _CORNERS:
        return x if len(x) else np.zeros((1, 3))
    ways = np.random.default_rng(0).normal(size=(_CORNERS, 3))
    return x[np.unique([int(np.argmax(x @ way)) for way in ways])]  # there may be a million places


def _item(item: Item, meshes: dict[Mesh, int]) -> dict:
    shape = {Solid: "solid", Plate: "plate", Ball: "ball", Turn: "turn"}[type(item)]
    out = {"shape": shape, **_plain(item, ("mesh",))}
    if isinstance(item, Solid):
        out["mesh"] = meshes.setdefault(item.mesh, len(meshes))
    return out


def _plain(item: Item | Label, without: tuple[str, ...] = ()) -> dict[str, Any]:
    """Fields of an item, and of what it holds, as dictionaries."""
    out = {}
    for part in dataclasses.fields(item):
        value = getattr(item, part.name)
        if part.name not in without:
            out[part.name] = dataclasses.asdict(value) if isinstance(value, (Frame, Way)) else value
    return out


def piece(one: Piece) -> dict[str, Any]:
    """What a page makes a piece of a mesh from."""
    if isinstance(one, Turned):
        rings = [rounded(np.array([r.share, r.length, r.units, r.radius, r.thick])) for r in one.rings]
        shown = {name: 1 for name in ("prism", "caps", "lined") if getattr(one, name)}
        return {"rings": rings, "sides": one.sides, **shown}
    if isinstance(one, Shell):
        return {"profile": rounded(np.array(one.profile)), "sides": one.sides}
    if isinstance(one, Coil):
        return {"coil": [one.turns, one.radius, one.start, one.end], "sides": one.sides}
    vertices = rounded(np.array(one.vertices), 5)
    return {"v": vertices, "f": one.faces, "strokes": one.strokes, "apart": int(one.apart)}
