"""Content of a page: items of the scene, places and numbers over the poses, arrows and their scale.

The text of a page is put together here: its parts, and numbers that are short and cannot break out of a script element.
"""

import dataclasses
import json
import math
import re
from collections.abc import Callable, Iterable, Sequence
from importlib.resources import files
from typing import Any

import numpy as np

from jaxnc.vehicle.hardpoints import number_names
from jaxnc.viz.annotations import LONGEST, Arrows, arrows, place_labels, shafts
from jaxnc.viz.poses import Poses, evenly
from jaxnc.viz.quantities import ENERGIES, Quantity, attitudes, default_plots, forces_of, quantity, running
from jaxnc.viz.scene import CROSSING, JOINT, SHALLOW, UNITS_ACROSS, Frame, Scene, Span
from jaxnc.viz.sketch import sketch_plane
from jaxnc.viz.spatial.camera import Camera
from jaxnc.viz.spatial.mesh import Coil, Mesh, Piece, Shell, Turned
from jaxnc.viz.spatial.scene import SOLIDS, Solid, SpaceFrame, Way
from jaxnc.viz.style import ROLES, symbol

# Parts that hold others, the outer before the inner.
_NESTED = ("PROGRAM", "CLOCK", "STAGE", "CHARTS", "LIVE", "SOLVER", "MORPHING", "HANDLING", "SIZING", "SHAPING", "MORE")


def page_part(name: str) -> str:
    """Read a part of the page, a file beside this module."""
    return files("jaxnc.viz.pages").joinpath(name).read_text(encoding="utf-8")


def fill_template(text: str, parts: dict[str, str]) -> str:
    """Put parts into a text. Parts that hold no others are put in once: a title may look like the name of a part."""
    for name in _NESTED:
        text = text.replace(f"{{{{{name}}}}}", parts.get(name, ""))
    return re.sub(r"\{\{([A-Z]+)\}\}", lambda name: parts[name[1]], text)


def input_names(*arrays: tuple[str, int | None]) -> Callable[[int], str]:
    """Name inputs that lie in several arrays behind one another; one whose size is None is a number."""
    names = [
        letter if size is None else f"{letter}[{k}]"
        for letter, size in arrays
        for k in range(1 if size is None else size)
    ]
    return names.__getitem__


def embed_json(content: object) -> str:
    """Write JSON that is safe inside a script element, whatever names it carries."""
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    for character in "<>&\u2028\u2029":  # they only occur inside strings
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def round_numbers(values: np.ndarray, digits: int = 7) -> list:
    """Round numbers to so many significant digits; None where there is none."""
    flat = [
        float(f"{v:.{digits}g}") if math.isfinite(v) else None for v in np.asarray(values, float).reshape(-1).tolist()
    ]
    flat = [int(v) if v is not None and v == int(v) and abs(v) < 1e7 else v for v in flat]
    if np.ndim(values) < 2:
        return flat
    width = np.shape(values)[-1]
    return [flat[i : i + width] for i in range(0, len(flat), width)]


def pack(values: np.ndarray, quantum: float) -> Any:
    """Write values over the poses of a motion in short, as differences of whole numbers of quanta.

    A number where all values are the same. Otherwise differences of that order of which the text is shortest, each in
    digits of five bits, the lowest first and a sixth bit where another follows; ``"!"`` stands where there is no value,
    and the differences begin anew.
    """
    values = np.asarray(values, float)
    known = np.isfinite(values)
    if known.all() and np.ptp(values) <= quantum:
        return float(f"{values[0]:.12g}")
    whole = np.rint(np.where(known, values, 0.0) / quantum).astype(np.int64)
    edges = np.flatnonzero(np.diff(known)) + 1
    runs = [(bool(part[0]), rest) for part, rest in zip(np.split(known, edges), np.split(whole, edges), strict=True)]
    best = None
    for order in range(1, 7):  # beyond the sixth order, differences of rounded values are noise
        steps = [np.diff(np.concatenate([np.zeros(order, np.int64), run]), order) for good, run in runs if good]
        signed = [np.where(step < 0, -2 * step - 1, 2 * step) for step in steps]
        size = sum(int(np.sum(x >= 32**k)) for x in signed for k in range(1, 12))
        if best is None or size < best[0]:
            best = size, order, signed
    _, order, signed = best or (0, 1, [])
    rest = iter(signed)
    text = "".join("".join(map(_base32, next(rest).tolist())) if good else "!" * len(run) for good, run in runs)
    return {"quantum": quantum, "order": order, "steps": text}


def pack_places(x: np.ndarray, quantum: float) -> dict[str, object]:
    """Write places over the poses of a motion ``(T, dim)`` in short, axis by axis."""
    return {axis: pack(row, quantum) for axis, row in zip("xyz", x.T, strict=False)}


def _base32(x: int) -> str:
    """Write a whole number, not negative, in digits of five bits."""
    text = ""
    while x >= 32:
        text += chr(95 + x % 32)
        x //= 32
    return text + chr(63 + x)


def quantum_of(places: np.ndarray) -> float:
    """Choose the power of ten that lengths are rounded to: a ten millionth of the size of places ``(..., dim)``."""
    places = places.reshape(-1, places.shape[-1])
    places = places[np.isfinite(places).all(axis=1)]
    size = float(np.linalg.norm(np.ptp(places, axis=0))) if len(places) else 0.0
    return 10.0 ** (math.floor(math.log10(size or 1.0)) - 6)


def pack_exactly(values: np.ndarray) -> Any:
    """Write values over the poses of a motion to the last digit: their ends where they are spaced evenly, else all."""
    values = np.asarray(values, float)
    if np.isfinite(values).all() and len(values) > 2:
        even = np.linspace(values[0], values[-1], len(values))
        if np.max(np.abs(even - values)) <= 4e-16 * np.max(np.abs(values)):
            return {"from": float(values[0]), "to": float(values[-1])}
    return round_numbers(values, 16)


# -- over the poses ---------------------------------------------------------------------------------------------------


def timeline(data: Poses, heading: str, fps: float) -> dict[str, object]:
    """Collect what pages of every kind hold: poses and their status, angles and distances, time."""
    top, time = data.topology, data.motion.time
    quantum = quantum_of(data.places[data.extent_poses])
    scalars = [
        {
            "name": name,
            "symbol": symbol(name),
            "unit": "" if angle else top.length_unit,
            "angle": bool(angle),
            "driven": name in data.motion.driven,
            "values": pack(data.scalars[:, k], 1e-7 if angle else quantum),  # radians
        }
        for k, (name, angle) in enumerate(zip(top.scalars, top.angles, strict=True))
    ]
    paths = {k: data.path(k)[0] for k in range(len(data.names))}
    return {
        "title": heading,
        "dim": data.dim,
        "unit": top.length_unit,
        "fps": fps,
        "poses": data.count,
        "closed": data.closed,
        "degrees": data.angles == "deg",
        "over": running(data.motion),
        "status": [0 if good else int(s) or 1 for good, s in zip(data.good, data.status, strict=True)],
        "sentences": {int(data.status[k]) or 1: data.sentence(k) for k in np.flatnonzero(~data.good).tolist()},
        "time": None if time is None else pack_exactly(np.asarray(time)),
        "pace": data.pace,
        "inputs": [
            [name, data.names.index(point), axis]
            for point, _, axis, name in ((*name.rpartition("."), name) for name in data.motion.driven)
            if name not in top.scalars and point in data.names
        ],
        "scalars": scalars,
        # Paths of which the poses alone would show chords.
        "fine": {
            k: {"count": len(x)} | pack_places(x, quantum) for k, x in paths.items() if len(x) > data.count
        },
    }  # fmt: skip


def plotted_series(data: Poses, plots: str | Iterable[str] | None, forces: bool) -> dict[str, object]:
    """Collect quantities that a page plots and does not calculate: energies, forces, numbers of a suspension.

    Returns:
        ``series``, with the plots that are asked for before those that suit the motion; and ``first``, which of them
        is shown at first, where one was asked for.
    """
    looked = attitudes(data)
    asked = () if plots is None else (plots,) if isinstance(plots, str) else tuple(plots)
    suited = (*ENERGIES, *(f"velocity {s}" for s in data.topology.scalars)) if data.run else looked
    names = dict.fromkeys((*asked, *suited, *(forces_of(data) if forces else ())))
    rows = [row for name in names for row in _series_rows(quantity(data, name), name in looked)]
    found: dict[str, object] = {"series": rows}
    return found | {"first": 0} if asked or looked else found


def _series_rows(q: Quantity, plain: bool) -> list[dict[str, object]]:
    """Write a quantity as a page reads it; a vector as its size and its components."""
    turns = q.unit.startswith(("°", "rad")) and not plain
    values = np.radians(q.values) if turns and q.unit.startswith("°") else q.values
    unit = q.unit.removeprefix("°").removeprefix("rad") if turns else q.unit
    rows = [(q.label, values)]
    if values.ndim > 1:
        rows = [(q.label, np.linalg.norm(values, axis=1))] if q.kind == "vector" else []
        rows += [(f"{q.label}, {axis}", x) for axis, x in zip("xyz", values.T, strict=False)]
    out: list[dict[str, object]] = []
    for text, x in rows:
        size = float(np.nanmax(np.abs(x), initial=0.0)) if np.isfinite(x).any() else 0.0
        quantum = float(10.0 ** np.floor(np.log10(size) - 6)) if size > 0 else 1.0
        more = {"per" if turns else "unit": unit}  # of an angle: the rest of its unit
        out.append({"symbol": text, "name": q.name, "angle": bool(turns), "values": pack(x, quantum), **more})
    return out


def first_plot(data: Poses, content: dict[str, Any]) -> int:
    """Choose which quantity is plotted at first: one of what is traced, or else what `jaxnc.viz.plot` shows."""
    scalars, series = content["scalars"], content["series"]
    if "first" in content:
        return len(scalars)
    axes = "xyz"[: data.dim]
    keys = [s["name"] for s in scalars] + [None] * len(series)
    keys += [f"{p['name']}.{axis}" for p in content["points"] if p["moves"] for axis in axes]
    points = [data.names[column] for column in content["traces"]]
    points += [name for name in default_plots(data) if name in data.names]

    def moves(name: str, axis: str) -> bool:
        x = data.places[data.extent_poses, data.names.index(name), axes.index(axis)]
        return bool(np.ptp(x) > 1e-7 * data.size)

    moving = [f"{name}.{axis}" for name in points for axis in "yxz" if axis in axes and moves(name, axis)]
    wanted = [name for name in (*moving, *default_plots(data)) if name in keys and name not in data.motion.driven]
    return keys.index(wanted[0]) if wanted else 0


# -- the scene --------------------------------------------------------------------------------------------------------


def planar_scene(data: Poses, trace, velocities, accelerations, forces: bool) -> tuple[dict, list[Arrows]]:
    """Collect what a page of a planar mechanism draws, and its arrows."""
    scene = sketch_plane(data)
    lower, upper = scene.box(data.places[data.extent_poses])
    size = float(np.hypot(*(upper - lower))) or 1.0
    sampled = evenly(data.extent_poses)
    drawn = arrows(data, velocities, accelerations, size, None, forces)
    scene = place_labels(scene, data.places[sampled], size / UNITS_ACROSS, shafts(drawn, sampled))
    tips = np.concatenate(
        [np.zeros((0, 2)), *((a.places + a.vectors)[data.extent_poses].reshape(-1, 2) for a in drawn)]
    )
    reached = np.concatenate([[lower, upper], tips[np.isfinite(tips).all(axis=1)]])
    content = _common(data, scene, data.columns(trace, "trace"), drawn, size) | {
        "box": round_numbers(np.stack([reached.min(axis=0), reached.max(axis=0)])),
        "joint": JOINT,
        "crossing": CROSSING,
        "shallow": SHALLOW,
        "styles": {role: _css(role) for role in sorted({item.role for item in scene.items})},
        "items": [_item(item, {}) for item in scene.items],
    }
    return content, drawn


def spatial_scene(
    data: Poses, trace, velocities, accelerations, forces: bool, camera: Camera | None
) -> tuple[dict, list[Arrows]]:
    """Collect what a page of a spatial mechanism draws, every mesh once, and its arrows."""
    from jaxnc.viz.spatial.drawing import SpaceView

    view = SpaceView(data, data.extent_poses.tolist(), trace, True, camera)
    drawn = arrows(data, velocities, accelerations, view.size, None, forces)
    without = len(view.scene.items) + sum(len(a.columns) for a in drawn)
    view.add_arrows(drawn)
    view.place(evenly(data.extent_poses), view.size / UNITS_ACROSS)
    scene, places = view.scene, len(data.names)
    meshes: dict[Mesh, int] = {}
    items = [_item(item, meshes) for item in scene.items]
    for item in items[without:]:
        item["force"] = 1
    ends = view.columns[data.extent_poses, places + len(data.directions) :].reshape(-1, 3)  # of arrows
    seen = np.concatenate(
        [scene.reach(view.columns[data.extent_poses]), view.tips, ends[np.isfinite(ends).all(axis=1)]]
    )
    content = _common(data, scene, view.traces, drawn, view.size) | {
        "box": round_numbers(np.stack([view.lower, view.upper])),
        "seen": round_numbers(_outermost(seen), 5),
        "view": [view.camera.elevation, view.camera.azimuth],
        "styles": {role: dataclasses.asdict(SOLIDS[role]) for role in sorted({item["role"] for item in items})},
        "items": items,
        "meshes": [[write_piece(one) for one in mesh.pieces] for mesh in meshes],
    }
    return content, drawn


def _common(
    data: Poses, scene: Scene, traces: Sequence[int], drawn: Sequence[Arrows], size: float
) -> dict[str, object]:
    """Collect points, directions, traces, names and arrows of a scene of the plane or of space."""
    top, dim, quantum = data.topology, data.dim, quantum_of(data.places[data.extent_poses])
    trade = number_names((*data.names, *data.directions)) if dim == 3 else {}
    points = [
        {
            "name": name,
            **({"trade": trade[name]} if name in trade else {}),
            "body": scene.bodies[k],
            "marker": k >= len(top.points),
            "moves": k >= len(top.points) or not all(top.fixed[dim * k : dim * (k + 1)]),
            **pack_places(data.places[:, k], quantum),
        }
        for k, name in enumerate(data.names)
    ]
    return {
        "points": points,
        "directions": [
            {"name": name, "moves": True, **pack_places(data.axes[:, k], 1e-6)}
            for k, name in enumerate(data.directions)
        ],
        "traces": list(traces),
        "labels": [_fields(label) for label in scene.labels],
        "size": size,
        "longest": LONGEST * size,
        **_arrow_sets(data, drawn, quantum),
    }


def _arrow_sets(data: Poses, drawn: Sequence[Arrows], quantum: float) -> dict[str, object]:
    """Write arrows as a page reads them: columns of their feet and tips, and the places of those that are no points.

    An order of 2 says that a set of arrows shows forces.
    """
    tips: list[np.ndarray] = []
    first, sets = len(data.names) + len(data.directions), []
    for one in drawn:
        feet = [*one.columns] if one.columns else [one.point(data, k) for k in range(len(one.chosen))]
        for k, foot in enumerate(feet):
            if foot is None:
                feet[k] = first + len(tips)
                tips.append(one.places[:, k])
        pairs = [[foot, first + len(tips) + k] for k, foot in enumerate(feet)]
        tips += list(np.swapaxes(one.places + np.nan_to_num(one.vectors), 0, 1))
        sets.append(
            {
                "noun": one.noun,
                "order": ("velocity", "acceleration").index(one.noun) if one.columns else 2,
                "shafts": pairs,
                "scale": float(f"{one.scale:.12g}"),
                "key": float(f"{one.key:.7g}"),
                "text": one.text if data.dim == 2 else f"longest {one.longest}",
            }
        )
    return {"arrows": sets, "tips": [pack_places(tip, quantum) for tip in tips]}


def _css(role: str) -> dict[str, object]:
    """Write the style of a role as a page has it: units as ``--u``, and ``#`` for the colour of a body."""
    style = ROLES[role]
    fill, stroke = (f"var(--{x}{'-#' * (x in ('body', 'tint'))})" if x else "none" for x in (style.fill, style.stroke))
    look = f"fill:{fill};fill-opacity:{style.opacity:g};stroke:{stroke};stroke-width:calc({style.width:g}*var(--u))"
    if style.dash:
        look += ";stroke-dasharray:" + " ".join(f"calc({d:g}*var(--u))" for d in style.dash)
    elif style.width > 0.4 and role != "casing":  # wider lines have round ends
        look += ";stroke-linecap:round"
    return {"css": look, "fixed": style.fixed}


def _item(item: object, meshes: dict[Mesh, int]) -> dict[str, Any]:
    """Write an item, its mesh by number; a span is a stamp in a frame that is as long as the way between its ends."""
    if isinstance(item, Span):
        return {"shape": "stamp", **_fields(item), "frame": {"at": item.ends[0], "toward": item.ends}}
    out = {"shape": type(item).__name__.lower(), **_fields(item)}
    if isinstance(item, Solid):
        out["mesh"] = meshes.setdefault(item.mesh, len(meshes))
    return out


def _fields(item: Any) -> dict[str, object]:
    """List the fields of an item or a name, frames and directions as dictionaries, without what it does not have."""
    out = {}
    for field in dataclasses.fields(item):
        value = getattr(item, field.name)
        if isinstance(value, (Frame, SpaceFrame, Way)):
            value = dataclasses.asdict(value)
        if not isinstance(value, Mesh):
            out[field.name] = value
    return out


def _outermost(x: np.ndarray) -> np.ndarray:
    """Pick some of the places, those that lie furthest out in many directions among them; there may be a million."""
    corners = 400  # places that a page in space fits its first view to
    if len(x) <= corners:
        return x if len(x) else np.zeros((1, 3))
    ways = np.random.default_rng(0).normal(size=(corners, 3))
    return x[np.unique([int(np.argmax(x @ way)) for way in ways])]


def write_piece(one: Piece) -> dict[str, object]:
    """Write what a page makes a piece of a mesh from."""
    if isinstance(one, Turned):
        rings = [round_numbers(np.array([r.share, r.length, r.units, r.radius, r.thick])) for r in one.rings]
        shown = {name: 1 for name in ("prism", "caps", "lined") if getattr(one, name)}
        return {"rings": rings, "sides": one.sides, **shown}
    if isinstance(one, Shell):
        return {"profile": round_numbers(np.array(one.profile)), "sides": one.sides}
    if isinstance(one, Coil):
        return {"coil": [one.turns, one.radius, one.start, one.end], "sides": one.sides}
    vertices = round_numbers(np.array(one.vertices), 5)
    return {"v": vertices, "f": one.faces, "strokes": one.strokes, "apart": int(one.apart)}
