"""A motion as one HTML file that needs nothing else: the drawing, a slider over the poses, and a table to read."""

import html
from collections.abc import Iterable
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.solvers.branch import page_numbers
from jaxnc.viz.pages.content import first_plot, planar_scene, plotted_series, spatial_scene, timeline
from jaxnc.viz.pages.packing import embed_json, fill_template, page_part
from jaxnc.viz.pages.solver import Refused, page_solver
from jaxnc.viz.poses import poses
from jaxnc.viz.quantities import EXERTED
from jaxnc.viz.repr_html import save_page
from jaxnc.viz.spatial.camera import read_view
from jaxnc.viz.style import BODIES, DARK, INK, LIGHT, colour_of
from jaxnc.viz.svg import draw_still

if TYPE_CHECKING:
    from jaxnc.dynamics.reactions import InverseDynamics, Reactions
    from jaxnc.kinematics.modes import Modes, ModesMap

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
_SENTENCES = {
    "live": "With these dimensions this assembly does not reach it.",
    "stuck": " goes no further: the mechanism could not be assembled.",
    "stays": "So it cannot be assembled: it stays as it was.",
    "home": "It cannot be saved: with these dimensions it does not reach the pose in which it was drawn.",
}
_DESIGN = '<button id="design" type="button">{}</button>'


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
    forces: "bool | InverseDynamics | Reactions" = False,
    modes: "bool | Modes | ModesMap" = False,
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
        modes: whether a button leads from one assembly to the next. True, or what `jaxnc.modes` has found for values of
            the motion's inputs.

    Raises:
        InputError: unknown names, a batch of several axes, no rates for arrows, no such view; assemblies of another
            mechanism or other inputs, and what `jaxnc.modes` refuses.
        OutputError: a file that cannot be written.
    """
    parts = page_parts(
        motion, trace, velocities, accelerations, title, fps, view, model, unit, plots=plots, forces=forces, modes=modes
    )
    parts["COLOURS"] = page_colours("@media (prefers-color-scheme:dark){:root{#}}")
    return save_page(path, fill_template(page_part("page.html"), parts))


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
    forces: "bool | InverseDynamics | Reactions" = False,
    modes: "bool | Modes | ModesMap" = False,
) -> dict[str, str]:
    """Make what a page is filled with, by name; see `to_html`. Where scripts run for certain it needs no still."""
    if model is not None and not isinstance(model, Mechanism):
        raise InputError(f"model= takes the Mechanism that was compiled, got {type(model).__name__}")
    if not isinstance(fps, Real) or not 0 < fps <= 1000:
        raise InputError(f"fps={fps!r}: poses per second must be a positive number, at most 1000")
    data, fps = poses(motion, unit), float(fps)
    heading = data.topology.name if title is None else title
    with_forces = forces is not False and forces is not None
    data = data.with_reactions(forces) if with_forces and forces is not True else data
    camera, plane = read_view(data, view), data.dim == 2
    content: dict[str, Any] = timeline(data, heading, fps) | plotted_series(data, plots, with_forces)
    if plane:
        more, drawn = planar_scene(data, trace, velocities, accelerations, with_forces)
    else:
        more, drawn = spatial_scene(data, trace, velocities, accelerations, with_forces, camera)
    content |= more
    content["first"] = first_plot(data, content)
    names = dict.fromkeys(row["name"] for row in content["series"])
    plotted = [name for name in names if name.partition(" ")[0] in EXERTED]  # forces, which a page may find again
    drawing, hint = page_part("planar.html" if plane else "spatial.html"), _STEPPING if plane else _TURNING
    back = page_part("back.html").strip()
    try:
        equations, content["live"] = page_solver(data, model, drawn, plotted, modes)
        content["sentences"] |= _SENTENCES
        hint = (_DRAGGING if plane else _SIZING) + hint
        drawing += fill_template(page_part("reshape.html"), {"BACK": back}) if plane else ""
    except Refused as reason:
        equations, hint = "", f"{hint} {html.escape(str(reason))}"
    alive = "live" in content
    exerting = alive and "felt" in content["live"]
    content["unforced"] = content["live"].pop("unforced", "") if alive else ""
    for row in content["series"]:
        row["made"] = int(row.pop("name") in plotted and exerting)
    # Scripts that a page has only if it needs them.
    scripts = {
        "FORCES": ("forces.js", with_forces),
        "CLOCK": ("clock.js", data.motion.time is not None),
        "SOLVER": ("solver.js", alive),
        "HANDLING": ("live.js", alive),
        "MORPHING": ("morph.js", alive),
        "SIZING": ("sizes.js", alive),
        "CENTRES": ("centres.js", alive and content["live"].get("design", {}).get("centres")),
        "EXERTING": ("exert.js", exerting),
        "SWITCHING": ("modes.js", alive and content["live"].get("assemblies")),
    }
    return {
        "TITLE": html.escape(heading),
        "DRAWING": drawing.rstrip(),
        "HINT": hint,
        "STILL": draw_still(data) if plane and not scripted else "",
        "DATA": embed_json(content),
        "PROGRAM": page_part("player.js"),
        "STAGE": page_part("planar.js" if plane else "spatial.js"),
        "CHARTS": page_part("charts.js"),
        **{name: f"{number:g}" for name, number in page_numbers().items()},
        **{part: page_part(name) if needed else "" for part, (name, needed) in scripts.items()},
        "LIVE": page_part("calculating.js") if alive else "",
        "EQUATIONS": equations,
        # In space a changed design is drawn in the pose of the first drawing, from which angles may be counted.
        "SHAPING": page_part("shape.js" if alive and plane else "unshaped.js"),
        "HOLDING": page_part("hold.js") if exerting else "let holding={};",
        "MORE": "",
        "PICTURE": "SVG" if plane else "PNG",
        "DESIGN": _DESIGN.format("design" if model is None else "model file") if alive else "",
        "BACK": f"<span>{back}</span>" if alive and not plane else "",
    }


def page_colours(dark: str) -> str:
    """Write the custom properties of a page's style, light, and dark in the rule that is given."""

    def block(dark: bool) -> str:
        base = DARK if dark else LIGHT
        lines = [f"--{name}:{colour}" for name, colour in base.items()]
        for body in (INK, *range(len(BODIES))):
            name = "ink" if body == INK else str(body)
            lines += [f"--{kind}-{name}:{colour_of(kind, body, dark)}" for kind in ("body", "tint")]
        return ";".join(lines)

    return f":root,:host{{{block(False)}}}{dark.replace('#', block(True))}"
