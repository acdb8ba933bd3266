"""How things show themselves in a notebook: a drawing and a few lines of text, quickly; pages as they are."""

import base64
import html
import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.system.system import System
from jaxnc.viz.poses import Poses, poses, simulated
from jaxnc.viz.still import still
from jaxnc.viz.typed import caption

if TYPE_CHECKING:
    from jaxnc.dynamics.simulation import Simulation

_TEXT = "font:13px/1.5 system-ui,sans-serif;white-space:pre-wrap;margin:2px 0 0"
_ROWS = "font:12px/1.45 ui-monospace,monospace;white-space:{};overflow-x:auto;margin:4px 0 0"
_TABLE = "font:12px/1.5 system-ui,sans-serif;border-collapse:collapse;margin:4px 0 0"
_CELL = "text-align:left;padding:1px 12px 1px 0;font-weight:{};white-space:nowrap"
_LINES = 16  # of a report
_DPI = 100.0
_LARGEST = 40_000  # letters of a drawing; larger ones are drawn as pixels

Rows = Sequence[Sequence[str]]


def shown(thing: Any) -> str:
    """A drawing and what is to be said of a thing, as HTML; it never raises.

    It may be a mechanism, a system, a motion, a report on one, or the result of a search; what cannot be drawn is said
    in words only, and why.
    """
    try:
        words, rows, report = _said(thing)
    except Exception as error:
        words, rows, report = f"{type(thing).__name__}: {error}", (), ""
    try:
        picture = _picture(thing)
    except Exception as error:
        picture, words = "", f"{words}\n(not drawn: {error})"
    parts = [picture and f'<div style="max-width:480px">{picture}</div>']
    parts += [f'<div style="{_TEXT}">{html.escape(words)}</div>' if words else "", _table(rows) if rows else ""]
    look = _ROWS.format("pre" if "\n" in report else "pre-wrap")  # sentences are wrapped, tables are not
    parts += [f'<pre style="{look}">{html.escape(report)}</pre>' if report else ""]
    return f"<div>{''.join(parts)}</div>"


def _said(thing: Any) -> tuple[str, Rows, str]:
    """What is said of a thing: a sentence, rows of a table, lines of a report."""
    if isinstance(thing, Mechanism):
        return f"{thing!r}\n{caption(thing)}", (), ""
    if simulated(thing) and thing.status.ndim == 1:
        return str(thing), _run(thing), ""
    if isinstance(thing, (System, Motion)):
        return str(thing), (), ""
    if hasattr(thing, "rows") and hasattr(thing, "sentences"):  # of a search
        rows = thing.rows() if thing.designs else ()
        return "\n".join(thing.sentences), rows[:_LINES], ""
    if hasattr(thing, "optimiser"):
        return f"{type(thing).__name__}: {thing.problem.name}, {len(thing.problem.names)} unknowns", (), ""
    report = thing.table(rows=_LINES - 2) if hasattr(thing, "wheel_travel") and thing.converged.ndim else str(thing)
    lines = report.splitlines()
    more = [f"… ({len(lines)} lines: print() it)"] if len(lines) > _LINES else []
    return "", (), "\n".join([*lines[: _LINES - len(more)], *more])


def _run(run: "Simulation") -> Rows:
    """Of a simulation what is known without compiling: its times, steps, energies and constraints."""
    t, e, good = (np.asarray(x) for x in (run.time, run.energy, run.converged))
    last = int(np.flatnonzero(good)[-1]) if good.any() else 0
    made, rejected = map(int, run.steps)
    first, second = map(float, run.violation)
    return (
        ("time", f"{t[0]:g} s to {float(run.end):.6g} s"),
        ("steps", f"{made}" + (f" and {rejected} rejected" if rejected else "")),
        ("energy", f"{e[0]:.6g} J at the start, {e[last]:.6g} J at the end"),
        ("constraints", f"met to {first:.2g}, their rates to {second:.2g}"),
    )


def _table(rows: Rows) -> str:
    """Rows as a table; the first is a heading if its first word is empty."""
    lines = []
    for k, row in enumerate(rows):
        heading = k == 0 and not row[0]
        cells = (
            f'<td style="{_CELL.format(600 if heading or (i == 0 and not rows[0][0]) else 400)}">{html.escape(x)}</td>'
            for i, x in enumerate(row)
        )
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return f'<div style="overflow-x:auto"><table style="{_TABLE}"><tbody>{"".join(lines)}</tbody></table></div>'


def _picture(thing: Any) -> str:
    """The drawing of a thing, or of what it is about; none of what is numbers only."""
    drawn = _drawn(thing)
    if drawn is None:
        return ""
    data = poses(drawn)
    if data.dim == 2:
        picture = still(data, paper=True, traces=_traces(data))
        if len(picture) <= _LARGEST:
            return picture
    return f'<img alt="" src="data:image/png;base64,{pixels(drawn, int(data.shown[0]))}">'


def pixels(drawn: Mechanism | System | Motion, pose: int = 0, trace: Sequence[str] = ()) -> str:
    """Draw a pose as a small PNG, in the letters of base64."""
    from PIL import Image

    from jaxnc.viz.drawing import draw

    figure: Any = draw(drawn, pose=pose, trace=trace, size=(4.8, 3.6), title="")
    figure.set_dpi(_DPI)
    figure.canvas.draw()
    data, image = io.BytesIO(), Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3])
    image.quantize(96, dither=Image.Dither.NONE).save(data, "PNG")
    return base64.b64encode(data.getvalue()).decode()


def _drawn(thing: Any) -> Mechanism | System | Motion | None:
    if isinstance(thing, (Mechanism, System, Motion)):
        return thing
    if getattr(thing, "designs", ()):
        return thing.designs[getattr(thing, "knee", 0)].turn
    return thing.problem.system if hasattr(thing, "problem") else getattr(thing, "system", None)


def _traces(data: Poses) -> tuple[int, ...]:
    """The last point that moves, of a motion."""
    if data.count < 3:
        return ()
    moves = [k for k in range(len(data.names)) if np.ptp(data.places[data.shown, k], axis=0).any()]
    return tuple(moves[-1:])


class Page(type(Path())):
    """The path of a page, which a notebook shows as the page."""

    def _repr_html_(self) -> str:
        try:
            text = self.read_text(encoding="utf-8")
        except OSError:
            return html.escape(str(self))
        look = "width:100%;height:760px;border:0"
        return f'<iframe style="{look}" sandbox="allow-scripts allow-downloads" srcdoc="{html.escape(text)}"></iframe>'


class Animation(type(Path())):
    """The path of an animation, which a notebook shows as the animation."""

    def _repr_html_(self) -> str:
        try:
            data = base64.b64encode(self.read_bytes()).decode()
        except OSError:
            return html.escape(str(self))
        if self.suffix.lower() == ".mp4":
            return f'<video controls loop src="data:video/mp4;base64,{data}"></video>'
        return f'<img alt="{html.escape(self.name)}" src="data:image/gif;base64,{data}">'
