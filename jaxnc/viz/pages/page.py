"""A motion as one HTML file that needs nothing else: the drawing, a slider over the poses, and a table to read.

Beside it the page on which a curve is drawn and machines appear: those of an embedded atlas, with Python those of a
search.
"""

import html
import json
import tempfile
import threading
from collections.abc import Iterable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, JaxncError, OutputError
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.solvers.branch import page_numbers
from jaxnc.synthesis.tracing.atlas import Atlas, atlas
from jaxnc.synthesis.tracing.chains import KINDS, Chain
from jaxnc.synthesis.tracing.trace import TracedDesign, TraceResult, trace
from jaxnc.viz.pages.content import (
    embed_json,
    fill_template,
    first_plot,
    page_part,
    planar_scene,
    plotted_series,
    spatial_scene,
    timeline,
)
from jaxnc.viz.pages.solver import Refused, page_solver
from jaxnc.viz.poses import poses
from jaxnc.viz.quantities import EXERTED
from jaxnc.viz.spatial.camera import read_view
from jaxnc.viz.style import BODIES, DARK, INK, LIGHT, colour_of
from jaxnc.viz.svg import draw_still, save_page

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
    "home": "It cannot be saved: with these dimensions no pose was found that can be its drawing.",
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


# -- the page on which a curve is drawn --------------------------------------------------------------------------------


_EMBEDDED = {4: 1200, 6: 1800}  # machines in a page, by their number of bars
_LIVE = (3, 20)  # seconds of the searches that follow each other


@public
def trace_page(path: str | Path, source: Atlas | None = None) -> Path:
    """Write a page on which a curve is drawn and machines for it appear: no Python, no network, one file.

    It holds 1,200 four-bars and 1,800 six-bars of an atlas, some 300 kB, looks up by Fourier coefficients those whose
    curves are like the drawn one, and lays them on it. Their joints are dragged.

    Args:
        path: file ending in ``.html``.
        source: an atlas; the first part of `jaxnc.synthesis.atlas` if not given.

    Raises:
        OutputError: a file that cannot be written.
    """
    return save_page(path, _page(source, ()))


def _page(source: Atlas | None, live: tuple[float, ...]) -> str:
    known = atlas(25_000) if source is None else source
    chains: dict[Chain, int] = {}
    rows = []
    for bars, count in _EMBEDDED.items():
        shelf = known.shelves[bars].at(slice(count))
        for k, index in enumerate(shelf.chain):
            chain = chains.setdefault(shelf.chains[index], len(chains))
            numbers = [float(f"{x:.5g}") for x in (*shelf.window[k].tolist(), *shelf.design[k].tolist())]
            rows.append([chain, *numbers[:2], *shelf.sign[k].tolist(), *numbers[2:]])
    data = {"chains": [_chain(chain) for chain in chains], "rows": rows, "live": live}
    hint = page_part("trace_online.html" if live else "trace_offline.html").strip()
    hint = hint.format(" and ".join(f"{s:g}" for s in live) if live else f"{len(rows):,}")
    colours = page_colours("@media (prefers-color-scheme:dark){:root{#}}")
    parts = {"COLOURS": colours, "HINT": hint, "DATA": embed_json(data), "PROGRAM": page_part("trace.js")}
    return fill_template(page_part("trace.html"), parts)


def _chain(chain: Chain) -> list[Any]:
    return [chain.name, chain.tracer, [[KINDS.index(dyad.kind), dyad.first, dyad.second] for dyad in chain.dyads]]


def _machine(design: TracedDesign, links: list[list[str]]) -> dict[str, object]:
    """Write a design as the page has them."""
    drawn = design.numbers
    name, tracer, dyads = _chain(design.chain)
    return {
        "name": name, "tracer": tracer, "dyads": dyads, "sign": np.asarray(drawn.sign, float).tolist(),
        "design": np.asarray(drawn.design, float).tolist(), "begin": drawn.begin, "span": drawn.span,
        "place": [drawn.place.real, drawn.place.imag], "factor": [drawn.factor.real, drawn.factor.imag],
        "closed": design.closed, "distance": design.distance, "links": links,
    }  # fmt: skip


class TraceServer(ThreadingHTTPServer):
    """Serves the page, and what searches find, to this machine alone."""

    daemon_threads = True

    def __init__(self, port: int = 0, source: Atlas | None = None, live: tuple[float, ...] = _LIVE):
        self.text, self.source = _page(source, live).encode(), source
        self.results: list[TraceResult] = []
        self.busy = threading.Lock()
        try:
            super().__init__(("127.0.0.1", port), _Handler)
        except OSError as error:
            raise OutputError(f"port {port} cannot be listened to: {error.strerror or error}; give another") from None

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.server_port}/"

    def search(self, asked: dict[str, object]) -> dict[str, object]:
        """Search for machines for a curve that was drawn."""
        points, closed, seconds = (asked.get(name) for name in ("points", "closed", "seconds"))
        with self.busy:  # one after the other: each takes all processors
            result = trace(points, closed, seconds=seconds, source=self.source, progress=False)  # pyright: ignore[reportArgumentType]
            self.results.append(result)
            number = len(self.results) - 1
        links = [[["open", f"{number}/{k}.html"], ["model", f"{number}/{k}.toml"]] for k in range(len(result.designs))]
        designs = [_machine(design, own) for design, own in zip(result.designs, links, strict=True)]
        return {"designs": designs, "said": f"{result.refined:,} machines refined in {result.seconds:.2g} s"}

    def file(self, path: str) -> tuple[bytes, str] | None:
        """The page or the model file of a machine that was found, by its address; None if there is none."""
        number, _, name = path.strip("/").partition("/")
        which, _, kind = name.partition(".")
        if not (number.isdigit() and which.isdigit() and int(number) < len(self.results)):
            return None
        designs = self.results[int(number)].designs
        if int(which) >= len(designs) or kind not in ("html", "toml"):
            return None
        design = designs[int(which)]
        with tempfile.TemporaryDirectory() as folder:
            to = Path(folder) / f"linkage.{kind}"
            if kind == "html":
                design.move().to_html(to, trace="P", title=design.name, model=design.mechanism)
            else:
                design.save(to)
            return to.read_bytes(), "text/html; charset=utf-8" if kind == "html" else "application/toml"


class _Handler(BaseHTTPRequestHandler):
    server: TraceServer  # pyright: ignore[reportIncompatibleVariableOverride]

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: the page tells what happens."""

    def do_GET(self) -> None:
        """Answer with the page, or with a machine's."""
        if not self._is_local():
            return
        found = (self.server.text, "text/html; charset=utf-8") if self.path == "/" else self.server.file(self.path)
        if found is None:
            self._answer(404, b"there is no such page", "text/plain")
        else:
            self._answer(200, *found)

    def do_POST(self) -> None:
        """Search for what was drawn."""
        if not self._is_local():
            return
        size = int(self.headers.get("Content-Length") or 0)
        most = 1_000_000  # bytes of a question
        if self.path != "/trace" or not 0 < size <= most or self.headers.get("Content-Type") != "application/json":
            self._answer(400, b'{"error": "a curve is sent as JSON, at most 1 MB"}', "application/json")
            return
        try:
            asked = json.loads(self.rfile.read(size))
            if not isinstance(asked, dict):
                raise InputError("a curve is sent as points, closed and seconds")
            answer, code = self.server.search(asked), 200
        except (JaxncError, ValueError) as error:
            answer, code = {"error": str(error)}, 400
        self._answer(code, json.dumps(answer).encode(), "application/json")

    def _is_local(self) -> bool:
        """Refuse pages from elsewhere that have led their own name to this address."""
        host = (self.headers.get("Host") or "").rpartition(":")[0]
        if host in ("127.0.0.1", "localhost"):
            return True
        self._answer(403, b"for this machine only", "text/plain")
        return False

    def _answer(self, code: int, content: bytes, kind: str) -> None:
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)
