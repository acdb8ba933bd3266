"""The plots of the page: how time grows with the batch, with the unknowns, with the designs."""

import math
import re
from pathlib import Path
from typing import Any

from benchmarks.record import OURS, Record, Row

# One look for each way in every panel: colours that stay apart for colour-blind readers, and another mark each.
_LOOKS = {
    OURS: ("#0b5394", "o", "-"),
    "JAX by hand, n = 2": ("#38761d", "s", "--"),
    "naive JAX": ("#cc4125", "^", "-."),
    "numba Newton, n = 4": ("#8e6bb0", "D", ":"),
    "pylinkage Ensemble": ("#8e6bb0", "D", ":"),
}
_LABELS = {"naive JAX, n = 2": "naive JAX"}


def growth(record: Record, path: Path) -> bool:
    """Draw the three panels; False if there is nothing to draw."""
    panels = [p for p in (_batch(record), _unknowns(record), _designs(record)) if p[3]]
    if not panels:
        return False
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    style: dict[Any, Any] = {
        "font.size": 9,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.linewidth": 0.7,
    }
    with plt.rc_context(style):
        figure, axes = plt.subplots(
            1, len(panels), figsize=(max(4.8, 4.1 * len(panels)), 3.4), layout="constrained", squeeze=False
        )
        for ax, (title, x, y, lines) in zip(axes[0], panels, strict=True):
            for name, points in lines.items():
                colour, mark, dash = _LOOKS.get(name, ("#555555", "x", ":"))
                xs, ys = zip(*sorted(points), strict=True)
                wide = 2.2 if name == OURS else 1.2
                ax.plot(xs, ys, dash, color=colour, marker=mark, markersize=4, linewidth=wide)
            ax.set(xscale="log", yscale="log", xlabel=x, ylabel=y)
            ax.xaxis.set_major_formatter(lambda v, _: _count(v))
            ax.yaxis.set_major_formatter(lambda v, _: _time(v))
            ax.set_title(title, loc="left", fontsize=10)
            ax.grid(True, which="major", color="#dddddd", linewidth=0.6)
            ax.minorticks_off()
            counts = sorted({x for points in lines.values() for x, _ in points})
            if len(counts) <= 5:
                ax.set_xticks(counts, [f"{x:,.0f}" for x in counts])
            ax.margins(x=0.04, y=0.06)
            _name(ax, lines)
        figure.savefig(path, dpi=160)
        plt.close(figure)
    return True


def _count(number: float) -> str:
    """A power of ten, written out as long as it is short."""
    return f"{number:,.0f}" if number < 9999.0 else f"$10^{{{math.log10(number):.0f}}}$"


def _time(seconds: float) -> str:
    """A round time with its unit."""
    for factor, unit in ((1e-9, "ns"), (1e-6, "µs"), (1e-3, "ms"), (1.0, "s")):
        if seconds < 999.5 * factor or unit == "s":
            return f"{seconds / factor:g} {unit}"
    raise AssertionError


def _name(ax: Any, lines: dict[str, list[tuple[float, float]]]) -> None:
    """Names beside the ends of the lines, at the right edge and far enough apart."""
    low, high = (math.log10(y) for y in ax.get_ylim())
    apart, last = 0.065 * (high - low), -math.inf
    for name, points in sorted(lines.items(), key=lambda line: max(line[1])[1]):
        colour = _LOOKS.get(name, ("#555555", "x", ":"))[0]
        y = max(math.log10(max(points)[1]), last + apart)
        last = y
        at = ax.get_yaxis_transform()
        bold = "bold" if name == OURS else "normal"
        ax.text(1.02, 10**y, name, color=colour, fontsize=8, va="center", transform=at, weight=bold)


Panel = tuple[str, str, str, dict[str, list[tuple[float, float]]]]


def _lines(pairs: list[tuple[float, float, Row]]) -> dict[str, list[tuple[float, float]]]:
    out: dict[str, list[tuple[float, float]]] = {}
    for x, y, row in pairs:
        out.setdefault(_LABELS.get(row.way, row.way), []).append((x, y))
    return out


def _batch(record: Record) -> Panel:
    rows = [r for r in record.rows if r.case == "growth: batch"]
    pairs = [(float(r.size), r.size * r.median_ns_per_lane / 1e9, r) for r in rows]
    return "One four-bar", "angles in one call", "time of the call", _lines(pairs)


def _unknowns(record: Record) -> Panel:
    pairs: list[Any] = []
    for r in record.rows:
        found = re.fullmatch(r"growth: unknowns, (\d+)", r.case)
        if found:
            pairs.append((float(found[1]), r.median_ns_per_lane / 1e9, r))
    return "Rows of four-bars", "unknowns", "time per pose", _lines(pairs)


def _designs(record: Record) -> Panel:
    rows = [r for r in record.rows if r.case == "growth: designs"]
    pairs = [(r.size / 360, r.size * r.median_ns_per_lane / 1e9, r) for r in rows]
    return "Four-bar designs, 360 angles each", "designs in one call", "time of the call", _lines(pairs)
