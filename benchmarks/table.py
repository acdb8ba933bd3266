"""The table a person reads, in the terminal and on the page."""

from collections.abc import Sequence

from benchmarks.record import OURS, Ratio, Record, Row

HEAD = ("case", "lanes", "way", "per lane", "spread", "× jaxnc", "right", "compile")


def per_lane(ns: float) -> str:
    """A time with three digits and its unit."""
    for factor, unit in ((1.0, "ns"), (1e3, "µs"), (1e6, "ms"), (1e9, "s")):
        if ns < 999.5 * factor or unit == "s":
            return f"{ns / factor:.3g} {unit}"
    raise AssertionError


def right(value: float | None) -> str:
    """A fraction, never rounded up to all."""
    if value is None:
        return "–"
    if value == 1.0:
        return "all"
    return f"{min(value, 0.999999) * 100:.6g} %"


def cells(row: Row, record: Record) -> tuple[str, ...]:
    """One line of the table."""
    ours = record.find(row.case, OURS, row.size) or record.find(row.case, OURS)
    ratio = "" if ours is None else f"{row.median_ns_per_lane / ours.median_ns_per_lane:.3g}"
    compile_s = "" if row.compile_s is None else f"{row.compile_s:.2f} s"
    spread = f"{row.spread * 100:.0f} %"
    time = per_lane(row.median_ns_per_lane)
    return row.case, f"{row.size:,}", row.way, time, spread, ratio, right(row.correct), compile_s


def text(record: Record) -> str:
    """All rows as aligned columns, then the ratios and what is missing."""
    lines = [HEAD, *(cells(r, record) for r in record.rows)]
    out = aligned(lines, left=(0, 2))
    if record.ratios:
        out += "\n\n" + aligned(
            [("ratio", "value", "target", "met"), *(ratio_cells(r) for r in record.ratios)], left=(0,)
        )
    for title, items in (("left out", record.left_out), ("failed", record.failed)):
        out += "".join(f"\n{title}: {item}" for item in items)
    return out


def ratio_cells(ratio: Ratio) -> tuple[str, ...]:
    """One line of the table of ratios."""
    sign = "≤" if ratio.direction == "lower" else "≥"
    target = "" if ratio.target is None else f"{sign} {ratio.target:g}"
    met = "" if ratio.met is None else "yes" if ratio.met else "no"
    value = f"{ratio.value:.4g}" if ratio.value < 0.9999 or ratio.value > 1 else f"{ratio.value:.10g}"
    return ratio.name, value, target, met


def aligned(lines: Sequence[Sequence[str]], left: Sequence[int]) -> str:
    """Columns of equal width."""
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    rows = [
        "  ".join(x.ljust(w) if k in left else x.rjust(w) for k, (x, w) in enumerate(zip(line, widths, strict=True)))
        for line in lines
    ]
    return "\n".join([rows[0].rstrip(), "-" * len(rows[0]), *(r.rstrip() for r in rows[1:])])
