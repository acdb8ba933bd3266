"""The page of a report: one file without a network, for screens, telephones and paper."""

import html
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.dynamics.simulation import Simulation
from jaxnc.errors import JaxncError, counted
from jaxnc.io.files import model_toml
from jaxnc.kinematics.motion import Motion
from jaxnc.reporting.checked import ZERO, Quantity, constant, extremes_of, parts, unit_of
from jaxnc.reporting.outcome import energies, idle, inputs_at, scales_of
from jaxnc.reporting.transmission import transmission_quantities, unexplained_bodies
from jaxnc.reporting.verdict import Finding, Verdict
from jaxnc.types import ArrayLike
from jaxnc.viz.pages.content import fill_template
from jaxnc.viz.pages.page import page_colours
from jaxnc.viz.poses import poses, true_runs
from jaxnc.viz.style import short, symbol
from jaxnc.viz.svg import element, inline_pose, path_data, save_page

if TYPE_CHECKING:
    from jaxnc.reporting.study import Report
    from jaxnc.vehicle.report import SuspensionReport

_WHEEL = ("steer", "toe", "camber", "caster", "half_track_change", "toe_out_in_turns", "scrub_radius")
_WIDTH, _HEIGHT = 460.0, 190.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 54.0, 10.0, 22.0, 34.0
_DASHES = ("", "6 3", "2 2.5", "8 2 2 2")
_SAID = {"error": "wrong", "warning": "warning", "note": "note"}


def write_page(found: "Report", path: str | Path) -> Path:
    """Write the page of a report; see `Report.to_html`."""
    text = files("jaxnc.reporting").joinpath("report.html").read_text(encoding="utf-8")
    dark = "@media screen and (prefers-color-scheme:dark){:root{#}}"
    title = html.escape(f"{found.name}: report")
    text = fill_template(
        text, {"TITLE": title, "COLOURS": page_colours(dark), "BODY": "\n".join(filter(None, _body(found)))}
    )
    return save_page(path, text)


def _body(found: "Report") -> Iterator[str]:
    v, motion = found.verdict, found.motion
    wrong = any(f.level != "note" for f in v.findings)
    yield _header(found)
    if v.findings or v.expectations:
        yield _section("What is wrong" if wrong else "What to know", _findings(found), "wide")
    yield _section("Drawing", _drawing(found), "drawing")
    yield _section("Counts", _counts(found))
    if isinstance(motion, Simulation):
        yield _section("Under its forces", _simulation(motion), "wide")
    if motion is not None:
        yield _section("Range of the inputs", _ranges(found))
        yield _section("Poses", _poses(v))
        yield _section("Curves", _curves(found, found.quantities), "wide long")
        yield _section("Extremes", _extremes(v), "wide")
        yield _section("Transmission angle", _transmission(found, motion), "wide")
    yield _section("Sensitivities", _sensitivities(found), "wide long")
    yield _section("Forces", _forces(found), "wide long")
    for k, one in enumerate(found.suspensions):
        text = f'<pre class="told">{html.escape(one.text(all_of_it=not k))}</pre>'
        yield _section(f"Suspension over {one.over}", _wheel(one) + text, "wide long")
    # As it was read, or as `Mechanism.save` writes it.
    if text := found.model_text or (found.mechanism and model_toml(found.mechanism.model)):
        yield _section("The model", f"<pre>{html.escape(text)}</pre>", "wide long")
    yield _section("Where it comes from", _origin_section(found), "wide long")


def _section(title: str, content: str, look: str = "") -> str:
    """Write a section; nothing where it has no content."""
    return f'<section class="{look}"><h2>{html.escape(title)}</h2>{content}</section>' if content else ""


def _hint(text: str) -> str:
    return f'<p class="hint">{html.escape(text)}</p>'


def _charts(charts: Iterable[str]) -> str:
    """Put charts side by side; nothing if there are none."""
    drawn = "".join(charts)
    return f'<div class="charts">{drawn}</div>' if drawn else ""


def _table(rows: Sequence[Sequence[str]], look: str = "", text: Sequence[int] = ()) -> str:
    """Write rows under a heading; numbers stand at the right, columns of text at the left."""

    def cells(row: Sequence[str], tag: str) -> str:
        marks = (' class="text"' if k in text else "" for k in range(len(row)))
        return "".join(f"<{tag}{mark}>{html.escape(cell)}</{tag}>" for cell, mark in zip(row, marks, strict=True))

    head = f"<thead><tr>{cells(rows[0], 'th')}</tr></thead>" if any(rows[0]) else ""
    body = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows[1:])
    return f'<div class="scroll"><table class="{look}">{head}<tbody>{body}</tbody></table></div>'


def _pairs(rows: Sequence[tuple[str, str]]) -> str:
    return _table([("", ""), *rows], "pairs")


def _header(found: "Report") -> str:
    v = found.verdict
    asked = "nothing was asked of it" if v.moves else "not known whether it does what was asked"
    marks = "".join(
        f'<li class="{look}">{word}</li>'
        for holds, yes, no, unknown in (
            (v.assembles, "assembles", "does not assemble", "not known whether it assembles"),
            (v.moves, "moves", "does not move", "not known whether it moves"),
            (v.does, "does what was asked", "does not do what was asked", asked),
        )
        for look, word in [("open", unknown) if holds is None else ("yes", yes) if holds else ("no", no)]
    )
    about = f"<p>{html.escape(found.description)}</p>" if found.description else ""
    return f'<header><h1>{html.escape(found.name)}</h1>{about}<ul class="verdicts">{marks}</ul></header>'


def _findings(found: "Report") -> str:
    order = {"error": 0, "warning": 1, "note": 2}
    items = "".join(_finding(f) for f in sorted(found.verdict.findings, key=lambda f: order[f.level]))
    met = "".join(
        f'<li class="note"><b>met</b>: {html.escape(e.text)}'
        + (f" ({short(e.value, 6)} {html.escape(e.unit)})" if e.value is not None else "")
        + "</li>"
        for e in found.verdict.expectations
        if e.met
    )
    return f'<ul class="found">{items}{met}</ul>'


def _finding(f: Finding) -> str:
    text = f"<b>{_SAID[f.level]}</b>: {html.escape(f.text)}"
    if f.code in ("does-not-assemble", "redundant", "overconstrained") and f.names:
        more = f"; … ({len(f.names)} in all)" if len(f.names) > 8 else ""
        noun = "Not met" if f.code == "does-not-assemble" else "Rows"
        text += f"<br>{noun}: {html.escape('; '.join(f.names[:8]) + more)}"
    if f.remedies:
        rows = "".join(
            f"<li>{html.escape(r.dimension)}: {short(r.value, 6)} → <b>{short(r.becomes, 6)}</b> "
            f"({'+' if r.becomes >= r.value else ''}{short(r.becomes - r.value, 3)})</li>"
            for r in f.remedies[:6]
        )
        text += f"<br>The smallest change of a single dimension that closes it:<ul>{rows}</ul>"
    elif f.code == "does-not-assemble":
        text += "<br>No change of a single bar, cable, radius or ground coordinate was found that closes it."
    return f'<li class="{f.level}">{text}</li>'


def _drawing(found: "Report") -> str:
    thing: Any = found.motion if found.motion is not None else found.system
    if thing is None:
        return ""
    try:
        data = poses(thing)
    except JaxncError as error:
        return _hint(f"There is no drawing: {error}")
    pose = int(
        data.extent_poses[len(data.extent_poses) // 8]
    )  # not the first: many mechanisms start where their bars lie in line
    traces = [k for k, name in enumerate(data.names) if name in found.outputs and data.count > 2][:3]
    if found.motion is None:
        hint = "as it was typed, not assembled" if found.verdict.assembles is not True else "as it was drawn"
    else:
        at = ", ".join(
            f"{symbol(n)} = {short(v)} {unit_of(found.motion, n)[0] if found.motion.driven else 's'}"
            for n, v in inputs_at(found.motion, pose).items()
        )
        hint = f"{at}; path{'s' * (len(traces) > 1)} of {', '.join(data.names[k] for k in traces)}" if traces else at
    return inline_pose(data, pose, traces) + _hint(hint)


def _counts(found: "Report") -> str:
    c = found.verdict.counts
    rows = [("made of", ", ".join(parts(found.mechanism)))] if found.mechanism is not None else []
    if c is not None and found.mobility is not None:
        rows += [
            ("bodies", str(c.bodies)),
            ("joints that write equations", str(c.joints)),
            ("unknowns", str(c.unknowns)),
            ("equations", str(c.equations)),
            ("rank", str(c.rank)),
            ("degrees of freedom", f"{c.freedoms} (Grübler's count: {c.grubler})"),
            ("redundant equations", str(len(c.redundant)) if c.redundant else "none"),
        ]
        if c.overconstrained:
            rows.append(("overconstrained", f"{c.overconstrained}, by its special dimensions"))
        if found.verdict.assembles:
            rows.append(("assembled to", f"{found.mobility.gap:.1e} {found.verdict.length_unit}"))
        names = found.verdict.drivable
        more = f", … ({len(names)} in all)" if len(names) > 10 else ""
        rows += [("may be driven", ", ".join(names[:10]) + more)] if names else []
    return _pairs(rows) if rows else _hint("nothing could be counted")


def _ranges(found: "Report") -> str:
    v, out = found.verdict, []
    for drive in v.drives:
        rate = f" at {short(drive.rate)} {drive.unit}/s" if drive.rate is not None else ""
        text = f"driven from {short(drive.first, 6)} to {short(drive.last, 6)} {drive.unit}{rate}"
        out.append(f"<h3>{html.escape(symbol(drive.name))}</h3><div>{html.escape(text)}</div>")
        for r in (r for r in v.reach if r.name == drive.name):
            if r.turns:
                out.append("<div>turns fully, without a dead point</div>")
                continue
            if r.lower is None and r.upper is None:
                out.append("<div>no dead point was found, either way</div>")
                continue
            ends = [r.no_limit if x is None else f"{short(x, 10)} {r.unit}" for x in (r.lower, r.upper)]
            out.append(f"<div>can go from {html.escape(ends[0])} to {html.escape(ends[1])}</div>")
            if r.lower is not None and r.upper is not None and r.upper > r.lower:
                out.append(_strip(r.lower, r.upper, *sorted((drive.first, drive.last))))
            if r.dead_points:
                dead = ", ".join(short(x, 10) for x in r.dead_points[:8])
                out.append(_hint(f"dead points of its circuit: {dead} {r.unit}"))
    if v.hold:
        out.append(_hint(f"held as drawn: {', '.join(v.hold)}"))
    return "".join(out)


def _strip(lower: float, upper: float, first: float, last: float) -> str:
    """Draw a bar of what can be reached between its dead points, with what was asked for in it."""
    low, high = min(lower, first), max(upper, last)

    def at(x: float) -> float:
        return 100.0 * (x - low) / (high - low)

    asked = f'<i style="left:{at(first):.2f}%;width:{at(last) - at(first):.2f}%"></i>'
    ends = "".join(f'<b style="left:calc({at(x):.2f}% - 1px)"></b>' for x in (lower, upper))
    return f'<div class="reach" role="img" aria-label="the part of the range that is driven">{asked}{ends}</div>'


def _simulation(run: Simulation) -> str:
    """Write what the integration tells of itself, and where the energy goes."""
    t, kinds = np.asarray(run.time, float), energies(run)
    drawn = [chart(t, "time [s]", kinds[0].unit, {q.label: q.values for q in kinds})] if kinds else []
    text = "\n".join(line.removeprefix("  ") for line in run.report().splitlines()[1:])
    return f'<pre class="told">{html.escape(text)}</pre>{_charts(drawn)}'


def _poses(v: Verdict) -> str:
    p = v.poses
    if p is None:
        return ""
    rows = [("found", f"{p.found} of {counted(p.asked, 'pose')}")]
    rows += [(word.replace("_", " "), str(n)) for word, n in p.status.items() if word != "converged"]
    if p.residual is not None:
        rows.append(("worst residual", f"{p.residual:.1e} {p.unit}"))
    if p.conditioning is not None:
        rows.append(("smallest conditioning", f"{p.conditioning:.2g} (0 is a singular position)"))
    return _pairs(rows)


def _abscissa(found: "Report") -> tuple[np.ndarray, str] | None:
    motion: Any = found.motion
    if len(motion.status) < 2:
        return None
    if motion.time is not None:
        return np.asarray(motion.time, float), "time [s]"
    for name in motion.driven:
        unit, factor = unit_of(motion, name)
        values = np.asarray(motion.inputs[name], float) * factor
        steps = np.diff(values)
        if (steps > 0).all() or (steps < 0).all():
            return values, f"{name} [{unit}]"
    return np.arange(len(motion.status), dtype=float), "pose"


def _curves(found: "Report", quantities: Sequence[Quantity]) -> str:
    """Draw charts: the coordinates of a place share one."""
    over = _abscissa(found)
    if over is None:
        return ""
    groups: dict[tuple[str, bool, str], list[Quantity]] = {}
    scales = scales_of(quantities)
    for q in quantities:
        if np.isfinite(q.values).any() and not idle(q, scales[q.unit]):
            groups.setdefault((q.unit, q.rate, q.label.partition(".")[0]), []).append(q)
    charts = []
    most = 4  # curves in one chart
    for (unit, *_), group in groups.items():
        for k in range(0, len(group), most):
            some = ((q, np.abs(q.values) <= ZERO * scales[q.unit]) for q in group[k : k + most])
            lines = {q.label: np.where(rounding, 0.0, q.values) for q, rounding in some}
            charts.append(chart(over[0], over[1], unit, lines))
    return _charts(charts)


def _at(at: dict[str, float]) -> str:
    return ", ".join(short(v, 5) for v in at.values())


def _extremes(v: Verdict) -> str:
    if not v.extremes:
        return ""
    where = "at " + (", ".join(f"{symbol(d.name)} [{d.unit}]" for d in v.drives) or "time [s]")
    rows = [["", "smallest", where, "largest", where, "range"]]
    for e in v.extremes:
        label = with_symbols(e.quantity) + (f" [{e.unit}]" if e.unit else "")
        values = np.array([e.smallest, e.largest])
        if constant(values):
            rows.append([label, short(e.smallest, 6), "everywhere", "", "", ""])
            continue
        low, high = short(e.smallest, 6), short(e.largest, 6)
        rows.append([label, low, _at(e.smallest_at), high, _at(e.largest_at), short(e.largest - e.smallest, 6)])
    return _table(rows)


def _transmission(found: "Report", motion: Motion) -> str:
    if not motion.driven or not np.asarray(motion.converged).any():
        return ""
    left = unexplained_bodies(motion)
    some = ", ".join(left[:8]) + ", …" * (len(left) > 8)
    why = f"Not known of {some}: no single link moves the next there." if left else ""
    if not found.transmissions:
        return _hint(why) if why else ""
    over, out, rows = _abscissa(found), [], [["joint", "between", "least [deg]", "at", "largest [deg]"]]
    for t, (low, high) in zip(found.transmissions, extremes_of(motion, transmission_quantities), strict=True):
        rows.append([t.at, t.between, short(low.value), _at(inputs_at(motion, low.at)), short(high.value)])
        if over is not None and np.nanmax(t.values) - np.nanmin(t.values) > 1e-6:
            label = f"{t.at}: {t.between}" if len(t.between) <= 36 else t.at  # the table says the rest
            out.append(chart(over[0], over[1], "deg", {label: t.values}, level=0.0))
    hint = f"90 degrees is best, 0 a dead point: what the coupler cannot turn. {why}"
    return _table(rows, text=(1,)) + _charts(out) + _hint(hint)


def _sensitivities(found: "Report") -> str:
    """List for each output which design variable matters most."""
    if not found.verdict.sensitivities:
        return ""
    groups: dict[tuple[str, str], list[Any]] = {}
    for d in found.verdict.sensitivities:
        groups.setdefault((d.output, d.unit), []).append(d)
    blocks = []
    for (output, unit), some in groups.items():
        rows = []
        for d in some:
            at = ", ".join(f"{symbol(n)} = {short(v)}" for n, v in d.at.items())
            rows.append((d.variable, d.value, f"{short(d.value)}  at {at}"))
        blocks.append(
            f"<div><h3>∂{html.escape(with_symbols(output))} / ∂… [{html.escape(unit)}]</h3>{bars(rows)}</div>"
        )
    hint = (
        "Exact derivatives at the same input, where they are largest over the motion: by points as they are drawn and "
        "dimensions that are given. |P| is the size of what a place moves by."
    )
    lost = found.sensitivity is not None and not found.sensitivity.exists.all()
    hint += " Where a dimension changed alone leaves no way to assemble, there is none." if lost else ""
    return _charts(blocks) + _hint(hint)


def _forces(found: "Report") -> str:
    f = found.forces
    if f is None or found.motion is None:
        return ""
    more = [] if f.power is None else [f.power]
    out = [_curves(found, (*f.efforts, *more))] if f.efforts else []
    rows = [["", "smallest", "at", "largest", "at"]]
    for q in (*f.efforts, *more):
        ends = int(np.nanargmin(q.values)), int(np.nanargmax(q.values))
        cells = [c for k in ends for c in (short(float(q.values[k])), _at(inputs_at(found.motion, k)))]
        rows.append([f"{with_symbols(q.label)} [{q.unit}]", *cells])
    out += [_table(rows)] if rows[1:] else []
    force, moment = (found.motion.system.topology.load_unit(kind) for kind in ("force", "moment"))
    peaks = [["on", "by", f"largest force [{force}]", "at", f"largest moment [{moment}]"]]
    peaks += [[p.on, p.by, short(p.force), _at(inputs_at(found.motion, p.pose)), short(p.moment)] for p in f.peaks]
    out.append(f"<h3>Peaks in the joints</h3>{_table(peaks, text=(1,))}")
    hint = "Every pose is held at rest, since no rate is given." if f.resting else "With the rates of the motion."
    if found.mobility is not None and found.mobility.redundant:
        hint += " Equations are redundant: reactions that equilibrium leaves open are those of least norm."
    return "".join(out) + _hint(f"{hint} Moments are about centres of mass.")


def _wheel(one: "SuspensionReport") -> str:
    """Draw the numbers that are looked at first in a suspension, over its travel or its steering."""
    shown = [name for name in _WHEEL if np.ptp(one.curves.get(name, np.zeros(1))) > 0]
    over = f"{one.over} [{one.unit}]"
    charts = (chart(one.along, over, one[name].unit, {one[name].label: one.curves[name]}) for name in shown[:4])
    return _charts(charts)


def _origin_section(found: "Report") -> str:
    out = [_pairs(list(found.verdict.origin.items()))]
    if found.motion is not None and (rows := _digits(found.motion)):
        hint = _hint("All digits, in radians and lengths: another run agrees to a few units of the last.")
        out.append(f"<h3>Coordinates of a few poses</h3>{_table(rows, 'digits')}{hint}")
    return "".join(out)


def _digits(motion: Motion) -> list[list[str]]:
    """List all moving coordinates of a few poses to the last digit, radians and lengths: a heading and rows."""
    top = motion.system.topology
    good = np.flatnonzero(np.asarray(motion.converged).reshape(-1))
    if not len(good):
        return []
    # the digits of 3 poses are listed
    chosen = list(dict.fromkeys(good[[0, len(good) // 3, 2 * len(good) // 3, -1]].tolist()))[:3]
    q = np.asarray(motion.q).reshape(-1, len(top.coordinates))
    moving = [k >= len(top.fixed) or not top.fixed[k] for k in range(len(top.coordinates))]
    names = [n for n in (*top.scalars, *top.coordinates[: -len(top.scalars) or None]) if moving[top.position[n]]]
    rows = [["coordinate", *(f"pose {k}" for k in chosen)]]
    for name in dict.fromkeys([*motion.driven, *names]):
        rows.append([name, *(repr(float(q[k, top.position[name]])) for k in chosen)])
    return rows


# -- charts: small SVGs in the colours of the page, sharp on paper ----------------------------------------------------


def chart(x: np.ndarray, name: str, unit: str, curves: Mapping[str, np.ndarray], level: float | None = None) -> str:
    """Draw curves of one unit over an abscissa, as an SVG element.

    Curves are values by label, with gaps where they are NaN; each has its own colour and dash, named above. A `level`
    is drawn as a line.
    """
    every = np.concatenate([values[np.isfinite(values)] for values in curves.values()])
    if not len(every) or not np.ptp(x) > 0:
        return ""
    low, high = _room(every, level)
    across = (_WIDTH - _LEFT - _RIGHT) / float(np.ptp(x))
    up = (_HEIGHT - _TOP - _BOTTOM) / (high - low)

    def place(u: ArrayLike, v: ArrayLike) -> np.ndarray:
        places = _LEFT + (u - x.min()) * across, _HEIGHT - _BOTTOM - (v - low) * up
        return np.stack(np.broadcast_arrays(*places), axis=-1)

    parts = []

    def stroke(look: str, d: str, **more: str) -> None:
        parts.append(element("path", class_=look, **more, d=d))

    def write(at: float, y: float, text: str, anchor: str | None = None, look: str | None = None) -> None:
        place = {"x": f"{at:.1f}", "y": f"{y:.1f}"}
        parts.append(element("text", html.escape(text), class_=look, **place, text_anchor=anchor))

    right, ground = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM
    for v in ticks(low, high):
        _, y = place(x.min(), v)
        stroke("rule", f"M{_LEFT} {y:.1f}H{right}")
        write(_LEFT - 5, y + 3.5, short(v), "end")
    for u in ticks(float(x.min()), float(x.max()), turns=name.endswith("[deg]")):
        at, _ = place(u, low)
        stroke("tick", f"M{at:.1f} {ground:.1f}v4")
        write(at, ground + 15, short(u), "middle")
    for start, end in true_runs(np.all([~np.isfinite(values) for values in curves.values()], axis=0)):
        ends = place(x[[max(start - 1, 0), min(end, len(x) - 1)]], low)[:, 0]
        at, width = f"{ends.min():.1f}", f"{max(np.ptp(ends), 1.0):.1f}"
        parts.append(element("rect", class_="failed", x=at, y=_TOP, width=width, height=ground - _TOP))
    if level is not None:
        stroke("level", f"M{_LEFT} {place(x.min(), level)[1]:.1f}H{right}")
    keep = np.unique(np.linspace(0, len(x) - 1, min(len(x), 400)).astype(int))  # 400 points of a curve, at most
    at = _LEFT
    for k, (label, values) in enumerate(curves.items()):
        look = {"stroke": f"var(--body-{k % 10})", "stroke_dasharray": _DASHES[k % 4]}
        stroke("curve", path_data(place(x, values)[keep]), **look)
        stroke("curve", f"M{at:.0f} 11h22", **look)
        write(at + 27, 15, with_symbols(label), look="name")
        at += 27 + 6.7 * len(label) + 16
    write(right, 15, f"[{unit}]" if unit else "", "end")
    write((_LEFT + right) / 2, _HEIGHT - 4, with_symbols(name), "middle")
    box, text = f"0 0 {_WIDTH:.0f} {_HEIGHT:.0f}", f"{', '.join(curves)} over {name}"
    return element("svg", *parts, class_="chart", viewBox=box, role="img", aria_label=text)


def bars(rows: Sequence[tuple[str, float, str]]) -> str:
    """Write a table whose numbers have bars: name, signed value, and what stands behind it."""
    most = max((abs(v) for _, v, _ in rows), default=1.0) or 1.0
    cells = (
        f'<tr><td>{html.escape(name)}</td><td class="bar"><i style="width:{100 * abs(value) / most:.1f}%" '
        f'class="{"minus" if value < 0 else "plus"}"></i></td><td>{html.escape(text)}</td></tr>'
        for name, value, text in rows
    )
    return f'<table class="bars"><tbody>{"".join(cells)}</tbody></table>'


def ticks(low: float, high: float, turns: bool = False) -> list[float]:
    """Choose round numbers in a range; of degrees parts of a turn."""
    span = high - low
    steps = [
        m * 10.0**e for e in range(math.floor(math.log10(span)) - 2, math.ceil(math.log10(span)) + 1) for m in (1, 2, 5)
    ]
    if turns and span > 60:
        steps = [15.0, 30.0, 45.0, 60.0, 90.0, 180.0, 360.0, 720.0, 1440.0, *(s for s in steps if s > 1440)]
    step = next((s for s in steps if span / s <= 6.01), steps[-1])
    first = math.ceil(low / step - 1e-9)
    return [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]


def with_symbols(label: str) -> str:
    """Write a label as in a picture: names of Greek letters within it as letters."""
    return re.sub(r"[A-Za-z]\w*", lambda word: symbol(word[0]), label)


def _room(values: np.ndarray, level: float | None) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    if level is not None:
        low, high = min(low, level), max(high, level)
    least = 1e-9 * max(abs(low), abs(high)) or 1.0
    if high - low <= least:
        low, high = low - 0.5 * max(abs(low), least), high + 0.5 * max(abs(high), least)
    spare = 0.06 * (high - low)
    return low - spare, high + spare
