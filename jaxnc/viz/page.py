"""A motion as one HTML file that needs nothing else: the drawing, a slider over the poses, and a table to read."""

import dataclasses
import html
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.io.target import file_name
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.solvers.branch import page_numbers
from jaxnc.viz.arrows import LONGEST, Arrows, arrows, in_page, shafts
from jaxnc.viz.labels import placed
from jaxnc.viz.live import Refused, live
from jaxnc.viz.numbers import embedded, packed, quantum_of, rounded
from jaxnc.viz.output import writing
from jaxnc.viz.parts import filled, own
from jaxnc.viz.plots import usual
from jaxnc.viz.poses import Poses, poses
from jaxnc.viz.quantities import running
from jaxnc.viz.scene import CROSSING, JOINT, SHALLOW, Arc, Casing, Circle, Frame, Hatch, Item, Label, Line, Span, Stamp
from jaxnc.viz.series import found, series
from jaxnc.viz.shown import Page
from jaxnc.viz.sketch import sketch
from jaxnc.viz.spatial.camera import given
from jaxnc.viz.spatial.page import spatial
from jaxnc.viz.still import still
from jaxnc.viz.style import BODIES, DARK, INK, LIGHT, ROLES, colour_of, symbol

_SVG = '<svg id="drawing" role="group" aria-label="Drawing of the mechanism"></svg>'
_BACK = """<button id="undo" type="button" disabled title="The dimensions before the last change">undo</button>\
<button id="reset" type="button" title="The mechanism as it was">reset</button>"""
_MODES = f"""
<div id="viewing"><button id="move" type="button" aria-pressed="true" title="Drag a joint: the mechanism moves">move\
</button><button id="shape" type="button" aria-pressed="false" \
title="Drag a joint: the links that meet there change">shape</button>{_BACK}</div>"""
_CANVAS = """<canvas id="drawing" role="img" tabindex="0" aria-label="Drawing of the mechanism; \
with the drawing in focus the arrow keys turn it, with shift they shift it, plus and minus zoom, 0 resets"></canvas>
<div id="viewing"><label><input id="names" type="checkbox" checked>names</label>\
<label><input id="arrows" type="checkbox" checked>vectors</label>\
<button id="front" type="button" title="Along y: the xz plane">front</button>\
<button id="side" type="button" title="Along x: the yz plane">side</button>\
<button id="top" type="button" title="Along z: the xy plane">top</button>\
<button id="home" type="button" title="The first view again">view</button></div>"""
_STEPPING = "Space plays; the arrow keys step; Home and End jump."
_DRAGGING = "Drag a joint to move the mechanism, or choose shape and drag it to change the links that meet there. "
_SIZING = (
    "Inputs and dimensions are changed by their fields and sliders. Joints are not dragged here, as they are on planar "
    "pages: a pointer tells two of three directions, and axes of joints would have to turn with what is dragged. "
)
_TURNING = (
    "Drag to turn, with shift or the right button to shift, the wheel or two fingers to zoom; Tab to the drawing and "
    f"the arrow keys turn it. {_STEPPING}"
)
_LIVE = """const F = {{EQUATIONS}};
{{SOLVER}}
handled = (() => { const L = D.live;
{{HANDLING}}
})();
"""
_SENTENCES = {
    "live": "With these dimensions the mechanism does not reach it.",
    "stuck": " goes no further: the mechanism could not be assembled.",
    "stays": "So it cannot be assembled: it stays as it was.",
    "home": "It cannot be saved: with these dimensions it does not reach the pose in which it was drawn.",
}
# In space a changed design is drawn in the pose of the first drawing, from which angles may be counted.
_UNSHAPED = """let fit=()=>{},grips=fit,stretch=fit;
let drawing=()=>{let q=now.q.slice();return S.follow(q,now.c,L.home)?q:null};
"""
_DESIGN = '<button id="design" type="button">{}</button>'
_ROUND = 0.4  # units: wider lines have round ends
_UNIT = 1.0 / 95.0  # of the drawing's size, while labels are placed; the page chooses its own


@public
def to_html(
    motion: Motion,
    path: str | Path,
    trace: str | Iterable[str] = (),
    velocities: str | Iterable[str] = (),
    accelerations: str | Iterable[str] = (),
    title: str | None = None,
    fps: float = 25.0,
    view: tuple[float, float] | None = None,
    model: Mechanism | None = None,
    unit: str | None = None,
    plots: str | Iterable[str] | None = None,
    forces: Any = False,
) -> Path:
    """Write a page that shows a motion and calculates it anew: no Python, no network, one file.

    The page has a solver of its own, with the mechanism's equations: in the plane joints are dragged, and dimensions
    changed, while curves and plots follow; in space the inputs are moved. Where it cannot have one (a large mechanism,
    a constraint kind that branches by its numbers) it shows the motion as it is, and says why.

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
        model: the mechanism that was compiled; a changed design can then be taken from the page as a model file, and
            otherwise as the values that `System.replace` takes.
        unit: what angles are shown in at first, ``"rad"`` or ``"deg"``; the mechanism's ``angle_unit`` if not given.
        plots: further quantities to be plotted, as of `plot`: energies, forces, efforts, rates; those of the motion
            that was given. The first of them is shown at first. A simulation has its energies and the rates of angles
            and distances without being asked, a suspension with the usual names camber, toe and what else `Suspension`
            tells.
        forces: whether forces are shown: as arrows (weights, what is applied, reactions) in the poses of the motion as
            it was given, and as plots (efforts of the inputs, loads, what passes through points and into the ground).
            True, or what was found of this motion already by `jaxnc.inverse_dynamics` or `reactions`.

    Raises:
        InputError: unknown names, a batch of several axes, no rates for arrows, no such view.
        OutputError: a file that cannot be written.
    """
    parts = page_parts(
        motion, trace, velocities, accelerations, title, fps, view, model, unit, plots=plots, forces=forces
    )
    parts["COLOURS"] = colours("@media (prefers-color-scheme:dark){:root{#}}")
    with writing(path, (".html", ".htm"), "a page") as new:
        new.write_text(filled(own("page.html"), parts), encoding="utf-8")
    return Page(file_name(path))


def page_parts(
    motion: Motion,
    trace: str | Iterable[str],
    velocities: str | Iterable[str],
    accelerations: str | Iterable[str],
    title: str | None,
    fps: float,
    view: tuple[float, float] | None,
    model: Mechanism | None,
    unit: str | None = None,
    scripted: bool = False,
    plots: str | Iterable[str] | None = None,
    forces: Any = False,
) -> dict[str, str]:
    """What a page is filled with, by name; see `to_html`. Where scripts run for certain it needs no still."""
    if model is not None and not isinstance(model, Mechanism):
        raise InputError(f"model= takes the Mechanism that was compiled, got {type(model).__name__}")
    data = poses(motion, unit)
    heading = data.topology.name if title is None else title
    forced = forces is not False and forces is not None
    data = data.given(forces) if forced and forces is not True else data
    content = _played(data, heading, fps) | series(data, plots, forced)
    if data.dim == 3:
        stage, drawing, hint = "spatial.js", _CANVAS, _TURNING
        more, drawn = spatial(data, trace, velocities, accelerations, None if view is None else given(view), forced)
    elif view is not None:
        raise InputError(f"view={view!r}: {data.topology.name!r} is planar, and is seen from the front; leave view out")
    else:
        stage, drawing, hint = "planar.js", _SVG, _STEPPING
        more, drawn = _planar(data, trace, velocities, accelerations, forced)
    content |= more
    plotted = found(content["series"])
    try:
        equations, content["live"] = live(data, model, drawn, plotted)
        content["sentences"] |= _SENTENCES
        drawing, hint = (drawing + _MODES, _DRAGGING + hint) if data.dim == 2 else (drawing, _SIZING + hint)
    except Refused as reason:
        equations, hint = "", f"{hint} {html.escape(str(reason))}"
    alive = "live" in content
    exerting = alive and "felt" in content["live"]
    content["first"] = _first(data, content)
    content["unforced"] = content["live"].pop("unforced", "") if alive else ""
    for row in content["series"]:
        row["made"] = int(row.pop("name") in plotted and exerting)
    return {
        "TITLE": html.escape(heading),
        "DRAWING": drawing,
        "HINT": hint,
        "STILL": still(data) if data.dim == 2 and not scripted else "",
        "DATA": embedded(content),
        "PROGRAM": own("player.js"),
        "STAGE": own(stage),
        "CHARTS": own("charts.js"),
        "FORCES": own("forces.js") if forced else "",
        "CLOCK": own("clock.js") if data.motion.time is not None else "",
        "LIVE": _LIVE if alive else "",
        "EQUATIONS": equations,
        "SOLVER": own("solver.js") if alive else "",
        **{name: f"{number:g}" for name, number in page_numbers().items()},
        "HANDLING": own("live.js") if alive else "",
        "MORPHING": own("morph.js") if alive else "",
        "SIZING": own("sizes.js") if alive else "",
        "SHAPING": own("shape.js") if alive and data.dim == 2 else _UNSHAPED,
        "CENTRES": own("centres.js") if alive and content["live"].get("design", {}).get("centres") else "",
        "HOLDING": own("hold.js") if exerting else "let holding={};",
        "EXERTING": own("exert.js") if exerting else "",
        "MORE": "",
        "PICTURE": "SVG" if data.dim == 2 else "PNG",
        "DESIGN": _DESIGN.format("design" if model is None else "model file") if alive else "",
        "BACK": f"<span>{_BACK}</span>" if alive and data.dim == 3 else "",
    }


def _played(data: Poses, heading: str, fps: float) -> dict:
    """What pages of every kind hold: poses and their status, angles and distances, time."""
    top = data.topology
    quantum = quantum_of(data.places[data.shown])
    scalars = [
        {
            "name": name,
            "symbol": symbol(name),
            "unit": "" if angle else top.length_unit,
            "angle": bool(angle),
            "driven": name in data.motion.driven,
            "values": packed(data.scalars[:, k], 1e-7 if angle else quantum),
        }
        for k, (name, angle) in enumerate(zip(top.scalars, top.angles, strict=True))
    ]
    time = data.motion.time
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
        "time": None if time is None else rounded(np.asarray(time)),
        "pace": data.pace,
        "inputs": [
            [name, data.names.index(point), axis]
            for point, _, axis, name in ((*name.rpartition("."), name) for name in data.motion.driven)
            if name not in top.scalars and point in data.names
        ],
        "scalars": scalars,
        "fine": _fine(data, quantum),
    }


def _first(data: Poses, content: dict[str, Any]) -> int:
    """Which of the quantities of a page is plotted at first: of what is traced, or else what `plot` shows."""
    scalars, series = content["scalars"], content["series"]
    if "first" in content:
        return len(scalars)
    axes = "xyz"[: data.dim]
    keys = [s["name"] for s in scalars] + [None] * len(series)
    keys += [f"{p['name']}.{axis}" for p in content["points"] if p["moves"] for axis in axes]
    points = [data.names[column] for column in content["traces"]]
    points += [name for name in usual(data) if name in data.names]
    moving = [f"{name}.{axis}" for name in points for axis in "yxz" if axis in axes and _moves(data, name, axis)]
    wanted = [name for name in (*moving, *usual(data)) if name in keys and name not in data.motion.driven]
    return keys.index(wanted[0]) if wanted else 0


def _moves(data: Poses, name: str, axis: str) -> bool:
    x = data.places[data.shown, data.names.index(name), "xyz".index(axis)]
    return bool(np.ptp(x) > 1e-7 * data.size)


def _fine(data: Poses, quantum: float) -> dict[int, dict[str, Any]]:
    """Paths of columns of which the poses alone would show chords."""
    paths = {k: data.path(k)[0] for k in range(len(data.names))}
    return {
        k: {"count": len(x)} | {axis: packed(y, quantum) for axis, y in zip("xyz", x.T, strict=False)}
        for k, x in paths.items()
        if len(x) > data.count
    }


def _planar(data: Poses, trace, velocities, accelerations, forces: bool) -> tuple[dict, list[Arrows]]:
    """What a page of a planar mechanism draws, and its arrows."""
    top, scene = data.topology, sketch(data)
    traces = data.columns(trace, "trace")
    lower, upper = scene.box(data.places[data.shown])
    size = float(np.hypot(*(upper - lower))) or 1.0
    sampled = data.shown[np.unique(np.linspace(0, len(data.shown) - 1, 9).astype(int))]
    drawn = arrows(data, velocities, accelerations, size, None, forces)
    scene = placed(scene, data.places[sampled], _UNIT * size, shafts(drawn, sampled))
    tips = [(a.places + a.vectors)[data.shown].reshape(-1, 2) for a in drawn]
    for x in (tip[np.isfinite(tip).all(axis=1)] for tip in tips):
        if len(x):
            lower, upper = np.minimum(lower, x.min(axis=0)), np.maximum(upper, x.max(axis=0))
    quantum = quantum_of(data.places[data.shown])
    points = [
        {
            "name": name,
            "body": scene.bodies[k],
            "marker": k >= len(top.points),
            "moves": k >= len(top.points) or not all(top.fixed[2 * k : 2 * k + 2]),
            "x": packed(data.places[:, k, 0], quantum),
            "y": packed(data.places[:, k, 1], quantum),
        }
        for k, name in enumerate(data.names)
    ]
    content = {
        "points": points,
        "traces": list(traces),
        "box": rounded(np.stack([lower, upper])),
        "size": size,
        "longest": LONGEST * size,
        "joint": JOINT,
        "crossing": CROSSING,
        "shallow": SHALLOW,
        "styles": {role: _look(role) for role in sorted({item.role for item in scene.items})},
        "items": [_item(item) for item in scene.items],
        "labels": [_item(label) for label in scene.labels],
        "directions": [],
        **in_page(data, drawn, quantum),
    }
    return content, drawn


def _look(role: str) -> dict[str, Any]:
    """The style of a role as a page has it: units as ``--u``, and ``#`` for the colour of a body."""
    style = ROLES[role]
    fill, stroke = (f"var(--{x}{'-#' * (x in ('body', 'tint'))})" if x else "none" for x in (style.fill, style.stroke))
    look = f"fill:{fill};fill-opacity:{style.opacity:g};stroke:{stroke};stroke-width:calc({style.width:g}*var(--u))"
    if style.dash:
        look += ";stroke-dasharray:" + " ".join(f"calc({d:g}*var(--u))" for d in style.dash)
    elif style.width > _ROUND and role != "casing":
        look += ";stroke-linecap:round"
    return {"css": look, "fixed": style.fixed}


_SHAPES: dict[type[Item], str] = {
    kind: kind.__name__.lower() for kind in (Line, Circle, Stamp, Casing, Hatch, Arc, Label)
}
_SHAPES[Span] = "stamp"  # in a frame that is as long as the way between its ends


def _item(item: Item) -> dict:
    out: dict[str, Any] = {"shape": _SHAPES[type(item)]}
    for part in dataclasses.fields(item):
        value = getattr(item, part.name)
        if isinstance(value, Frame):
            at = value.at if isinstance(value.at, int) else [float(v) for v in value.at]
            value = {"at": at, "toward": value.toward, "angle": float(value.angle)}
        out[part.name] = value
    return out | {"frame": {"at": item.ends[0], "toward": item.ends}} if isinstance(item, Span) else out


def colours(dark: str) -> str:
    """Custom properties of the page's style, light, and dark in the rule that is given."""

    def block(dark: bool) -> str:
        base = DARK if dark else LIGHT
        lines = [f"--{name}:{colour}" for name, colour in base.items()]
        for body in (INK, *range(len(BODIES))):
            name = "ink" if body == INK else str(body)
            lines += [f"--{kind}-{name}:{colour_of(kind, body, dark)}" for kind in ("body", "tint")]
        return ";".join(lines)

    return f":root,:host{{{block(False)}}}{dark.replace('#', block(True))}"
