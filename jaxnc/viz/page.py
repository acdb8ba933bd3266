"""A motion as one HTML file that needs nothing else: the drawing, a slider over the poses, and a table to read."""

import dataclasses
import html
import json
import math
import re
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from jaxnc.kinematics.motion import Motion
from jaxnc.viz.arrows import arrows
from jaxnc.viz.labels import placed
from jaxnc.viz.output import writing
from jaxnc.viz.poses import Poses, poses
from jaxnc.viz.scene import Arc, Circle, Frame, Hatch, Item, Label, Line, Stamp
from jaxnc.viz.sketch import sketch
from jaxnc.viz.style import BODIES, DARK, INK, LIGHT, ROLES, colour_of, symbol

_DIGITS = 7
_UNIT = 1.0 / 95.0  # of the drawing's size, while labels are placed; the page chooses its own


def to_html(
    motion: Motion,
    path: str | Path,
    trace: str | Iterable[str] = (),
    velocities: str | Iterable[str] = (),
    accelerations: str | Iterable[str] = (),
    title: str | None = None,
    fps: float = 25.0,
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

    Returns:
        The path.

    Raises:
        InputError: unknown names, a batch of several axes, no rates for arrows.
        OutputError: a file that cannot be written.
    """
    data = poses(motion)
    heading = data.topology.name if title is None else title
    content = _content(data, heading, trace, velocities, accelerations, fps)
    template = files("jaxnc.viz").joinpath("page.html").read_text(encoding="utf-8")
    parts = {"TITLE": html.escape(heading), "COLOURS": _colours(), "DATA": embedded(content)}
    text = re.sub(r"\{\{(TITLE|COLOURS|DATA)\}\}", lambda found: parts[found[1]], template)
    with writing(path, (".html", ".htm"), "a page") as target:
        target.write_text(text, encoding="utf-8")
    return target


def embedded(content: Any) -> str:
    """JSON that is safe inside a script element, whatever names it carries."""
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    for character in "<>&\u2028\u2029":  # they only occur inside strings
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def rounded(values: np.ndarray) -> list:
    """Numbers of seven significant digits; None where there is none."""
    flat = [
        float(f"{v:.{_DIGITS}g}") if math.isfinite(v) else None for v in np.asarray(values, float).reshape(-1).tolist()
    ]
    flat = [int(v) if v is not None and v == int(v) and abs(v) < 1e7 else v for v in flat]
    if np.ndim(values) < 2:
        return flat
    width = np.shape(values)[-1]
    return [flat[i : i + width] for i in range(0, len(flat), width)]


def _content(data: Poses, heading: str, trace, velocities, accelerations, fps: float) -> dict:
    top, scene = data.topology, sketch(data)
    traces = data.columns(trace, "trace")
    lower, upper = scene.box(data.places[data.shown])
    size = float(np.hypot(*(upper - lower))) or 1.0
    sampled = data.shown[np.unique(np.linspace(0, len(data.shown) - 1, 9).astype(int))]
    scene = placed(scene, data.places[sampled], _UNIT * size)
    drawn = arrows(data, velocities, accelerations, size)
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
    time = data.motion.time
    return {
        "title": heading,
        "lengthUnit": top.length_unit,
        "fps": fps,
        "poses": data.count,
        "closed": data.closed,
        "status": [0 if good else int(s) or 1 for good, s in zip(data.good, data.status, strict=True)],
        "sentences": {int(data.status[k]) or 1: data.sentence(k) for k in np.flatnonzero(~data.good).tolist()},
        "time": None if time is None else rounded(np.asarray(time)),
        "inputs": [name for name in data.motion.driven if name not in top.scalars],
        "points": points,
        "scalars": scalars,
        "traces": list(traces),
        "box": rounded(np.stack([lower, upper])),
        "size": size,
        "styles": {role: _style(role) for role in ROLES},
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


def _style(role: str) -> dict:
    style = ROLES[role]
    return {"stroke": style.stroke, "width": style.width, "fill": style.fill, "opacity": style.opacity} | {
        "dash": list(style.dash),
        "fixed": style.fixed,
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
