"""A motion as one HTML file that needs nothing else: the drawing, a slider over the poses, and a table to read."""

import dataclasses
import html
import math
import re
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.viz.arrows import arrows
from jaxnc.viz.labels import placed
from jaxnc.viz.numbers import embedded, rounded, written
from jaxnc.viz.output import writing
from jaxnc.viz.poses import Poses, poses
from jaxnc.viz.scene import Arc, Circle, Frame, Hatch, Item, Label, Line, Stamp
from jaxnc.viz.sketch import sketch
from jaxnc.viz.spatial.camera import given
from jaxnc.viz.spatial.page import spatial
from jaxnc.viz.style import BODIES, DARK, INK, LIGHT, ROLES, colour_of, symbol

_SVG = '<svg id="drawing" role="img" aria-label="Drawing of the mechanism"></svg>'
_CANVAS = """<canvas id="drawing" role="img" tabindex="0" aria-label="Drawing of the mechanism; \
with the drawing in focus the arrow keys turn it, with shift they shift it, plus and minus zoom, 0 resets"></canvas>
<div id="viewing"><label><input id="names" type="checkbox" checked>names</label>\
<label><input id="arrows" type="checkbox" checked>vectors</label>\
<button id="front" type="button" title="Along y: the xz plane">front</button>\
<button id="side" type="button" title="Along x: the yz plane">side</button>\
<button id="top" type="button" title="Along z: the xy plane">top</button>\
<button id="reset" type="button" title="The first view again">reset</button></div>"""
_STEPPING = "Space plays; the arrow keys step; Home and End jump."
_TURNING = (
    "Drag to turn, with shift or the right button to shift, the wheel or two fingers to zoom; Tab to the drawing and "
    f"the arrow keys turn it. {_STEPPING}"
)
_UNIT = 1.0 / 95.0  # of the drawing's size, while labels are placed; the page chooses its own


def to_html(
    motion: Motion,
    path: str | Path,
    trace: str | Iterable[str] = (),
    velocities: str | Iterable[str] = (),
    accelerations: str | Iterable[str] = (),
    title: str | None = None,
    fps: float = 25.0,
    view: tuple[float, float] | None = None,
) -> Path:
    """Write a page that shows a motion: no Python, no network, one file.

    Args:
        motion: one pose, or a sequence of them.
        path: file ending in ``.html``.
        trace: points and markers whose path is shown at first; all of them can be switched on in the page.
        velocities: points and markers whose velocity is drawn as an arrow; the motion must carry rates.
        accelerations: the same for accelerations.
        title: heading; the mechanism's name if not given.
        fps: poses per second while it plays.
        view: from where a spatial mechanism is seen at first: elevation and azimuth, degrees; chosen to suit it if not
            given.

    Returns:
        The path.

    Raises:
        InputError: unknown names, a batch of several axes, no rates for arrows, no such view.
        OutputError: a file that cannot be written.
    """
    data = poses(motion)
    heading = data.topology.name if title is None else title
    content = _played(data, heading, fps)
    if data.dim == 3:
        stage, drawing, hint = "spatial.js", _CANVAS, _TURNING
        content |= spatial(data, trace, velocities, accelerations, None if view is None else given(view))
    elif view is not None:
        raise InputError(f"view={view!r}: {data.topology.name!r} is planar, and is seen from the front; leave view out")
    else:
        stage, drawing, hint = "planar.js", _SVG, _STEPPING
        content |= _planar(data, trace, velocities, accelerations)
    parts = {
        "TITLE": html.escape(heading),
        "COLOURS": _colours(),
        "DRAWING": drawing,
        "HINT": hint,
        "DATA": embedded(content),
        "PROGRAM": _own("player.js").replace("{{STAGE}}", _own(stage)),
    }
    text = re.sub(r"\{\{([A-Z]+)\}\}", lambda found: parts[found[1]], _own("page.html"))
    with writing(path, (".html", ".htm"), "a page") as new:
        new.write_text(text, encoding="utf-8")
    return Path(path).expanduser()


def _own(name: str) -> str:
    """A part of the page, from beside this module."""
    return files("jaxnc.viz").joinpath(name).read_text(encoding="utf-8")


def _played(data: Poses, heading: str, fps: float) -> dict:
    """What pages of every kind hold: poses and their status, angles and distances, time."""
    top = data.topology
    degrees = top.angle_unit == "deg"
    factor = [180.0 / math.pi if angle and degrees else 1.0 for angle in top.angles]
    unit = ["°" if angle and degrees else "rad" if angle else top.length_unit for angle in top.angles]
    scalars = [
        {
            "name": name,
            "symbol": symbol(name),
            "unit": unit[k],
            "driven": name in data.motion.driven,
            "values": rounded(data.scalars[:, k] * factor[k]),
        }
        for k, name in enumerate(top.scalars)
    ]
    time = data.motion.time
    return {
        "title": heading,
        "dim": data.dim,
        "lengthUnit": top.length_unit,
        "fps": fps,
        "poses": data.count,
        "closed": data.closed,
        "status": [0 if good else int(s) or 1 for good, s in zip(data.good, data.status, strict=True)],
        "sentences": {int(data.status[k]) or 1: data.sentence(k) for k in np.flatnonzero(~data.good).tolist()},
        "time": None if time is None else rounded(np.asarray(time)),
        "inputs": [name for name in data.motion.driven if name not in top.scalars],
        "scalars": scalars,
    }


def _planar(data: Poses, trace, velocities, accelerations) -> dict:
    """What a page of a planar mechanism draws."""
    top, scene = data.topology, sketch(data)
    traces = data.columns(trace, "trace")
    lower, upper = scene.box(data.places[data.shown])
    size = float(np.hypot(*(upper - lower))) or 1.0
    sampled = data.shown[np.unique(np.linspace(0, len(data.shown) - 1, 9).astype(int))]
    scene = placed(scene, data.places[sampled], _UNIT * size)
    drawn = arrows(data, velocities, accelerations, size)
    points = [
        {
            "name": name,
            "body": scene.bodies[k],
            "marker": k >= len(top.points),
            "moves": k >= len(top.points) or not all(top.fixed[2 * k : 2 * k + 2]),
            "x": rounded(data.places[:, k, 0]),
            "y": rounded(data.places[:, k, 1]),
        }
        for k, name in enumerate(data.names)
    ]
    return {
        "points": points,
        "traces": list(traces),
        "box": rounded(np.stack([lower, upper])),
        "size": size,
        "styles": {role: written(style) for role, style in ROLES.items()},
        "items": [_item(item) for item in scene.items],
        "labels": [_item(label) for label in scene.labels],
        "arrows": [
            {
                "noun": a.noun,
                "columns": list(a.columns),
                "vectors": [rounded(a.vectors[:, k]) for k in range(len(a.columns))],
                "key": float(f"{a.key:.7g}"),
                "text": a.text,
            }
            for a in drawn
        ],
    }


def _item(item: Item) -> dict:
    shape = {Line: "line", Circle: "circle", Stamp: "stamp", Hatch: "hatch", Arc: "arc", Label: "label"}[type(item)]
    out: dict[str, Any] = {"shape": shape}
    for part in dataclasses.fields(item):
        value = getattr(item, part.name)
        if isinstance(value, Frame):
            at = value.at if isinstance(value.at, int) else [float(v) for v in value.at]
            value = {"at": at, "toward": value.toward, "angle": float(value.angle)}
        out[part.name] = value
    return out


def _colours() -> str:
    """Custom properties of the page's style, light and dark."""

    def block(dark: bool) -> str:
        base = DARK if dark else LIGHT
        lines = [f"--{name}:{colour}" for name, colour in base.items()]
        for body in (INK, *range(len(BODIES))):
            name = "ink" if body == INK else str(body)
            lines += [f"--{kind}-{name}:{colour_of(kind, body, dark)}" for kind in ("body", "tint")]
        return ";".join(lines)

    return f":root{{{block(False)}}}@media (prefers-color-scheme:dark){{:root{{{block(True)}}}}}"
