"""Things as a notebook shows them: a drawing and a few lines of text, quickly; pages as they are."""

import base64
import html
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.io.target import file_name, writing
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.system.system import System
from jaxnc.viz.draft import caption
from jaxnc.viz.poses import is_simulation, poses
from jaxnc.viz.svg import inline_pose

if TYPE_CHECKING:
    from jaxnc.dynamics.simulation import Simulation

_TEXT = "font:13px/1.5 system-ui,sans-serif;white-space:pre-wrap;margin:2px 0 0"
_ROWS = "font:12px/1.45 ui-monospace,monospace;white-space:{};overflow-x:auto;margin:4px 0 0"
_TABLE = "font:12px/1.5 system-ui,sans-serif;border-collapse:collapse;margin:4px 0 0"
_CELL = "text-align:left;padding:1px 12px 1px 0;font-weight:{};white-space:nowrap"
_LINES = 16  # of a report

Rows = Sequence[Sequence[str]]


def show_html(thing: object) -> str:
    """Show a drawing and a description of a thing as HTML. Nothing is raised.

    The thing may be a mechanism, a system, a motion, a report on one, or the result of a search. What cannot be drawn
    is described in words only, with the reason.
    """
    try:
        words, rows, report = _describe(thing)
    except Exception as error:
        words, rows, report = f"{type(thing).__name__}: {error}", (), ""
    try:
        drawn = _subject(thing)
        picture = "" if drawn is None else inline_pose(poses(drawn), paper=True)
    except Exception as error:
        picture, words = "", f"{words}\n(not drawn: {error})"
    parts = [picture and f'<div style="max-width:480px">{picture}</div>']
    parts += [f'<div style="{_TEXT}">{html.escape(words)}</div>' if words else "", _table(rows) if rows else ""]
    look = _ROWS.format("pre" if "\n" in report else "pre-wrap")  # sentences are wrapped, tables are not
    parts += [f'<pre style="{look}">{html.escape(report)}</pre>' if report else ""]
    return f"<div>{''.join(parts)}</div>"


def _describe(thing: Any) -> tuple[str, Rows, str]:
    """Describe a thing: a sentence, rows of a table, lines of a report."""
    if isinstance(thing, Mechanism):
        return f"{thing!r}\n{caption(thing)}", (), ""
    if is_simulation(thing) and thing.status.ndim == 1:
        return str(thing), _run_rows(thing), ""
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


def _run_rows(run: "Simulation") -> Rows:
    """List what is known of a simulation without compiling: its times, steps, energies and constraints."""
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
    """Write rows as a table; the first is a heading if its first word is empty."""
    lines = []
    for k, row in enumerate(rows):
        heading = k == 0 and not row[0]
        cells = (
            f'<td style="{_CELL.format(600 if heading or (i == 0 and not rows[0][0]) else 400)}">{html.escape(x)}</td>'
            for i, x in enumerate(row)
        )
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return f'<div style="overflow-x:auto"><table style="{_TABLE}"><tbody>{"".join(lines)}</tbody></table></div>'


def _subject(thing: Any) -> Mechanism | System | Motion | None:
    """Find what there is to be drawn."""
    if isinstance(thing, (Mechanism, System, Motion)):
        return thing
    if getattr(thing, "designs", ()):
        return thing.designs[getattr(thing, "knee", 0)].turn
    return thing.problem.system if hasattr(thing, "problem") else getattr(thing, "system", None)


def save_page(path: str | Path, text: str) -> Path:
    """Write a page to a file; returns its path, which a notebook shows as the page."""
    with writing(path, (".html", ".htm"), "a page") as new:
        new.write_text(text, encoding="utf-8", newline="\n")
    return ShownPath(file_name(path))


class ShownPath(type(Path())):
    """The path of a page or an animation, which a notebook shows as what is in it; as text where it cannot be read."""

    def _repr_html_(self) -> str:
        try:
            content = self.read_bytes()
        except OSError:
            return html.escape(str(self))
        kind = self.suffix.lower()
        if kind == ".mp4":
            return f'<video controls loop src="data:video/mp4;base64,{base64.b64encode(content).decode()}"></video>'
        if kind == ".gif":
            data = base64.b64encode(content).decode()
            return f'<img alt="{html.escape(self.name)}" src="data:image/gif;base64,{data}">'
        look, page = "width:100%;height:760px;border:0", html.escape(content.decode("utf-8"))
        return f'<iframe style="{look}" sandbox="allow-scripts allow-downloads" srcdoc="{page}"></iframe>'
