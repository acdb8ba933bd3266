"""The table of the synthesis cases that a person reads."""

import json
from pathlib import Path
from typing import Any

from benchmarks.table import aligned

_HEAD = (
    "case",
    "key",
    "start",
    "error",
    "target",
    "met",
    "polish",
    "wall",
    "processor",
    "compile",
    "screened",
    "not finite",
)


def _number(value: Any) -> str:
    return "" if value is None else f"{value:.4g}"


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    times = tuple(f"{row[name]:.3g} s" for name in ("wall_s", "processor_s", "compile_s"))
    if "target_s" in row:
        met = "yes" if row["wall_s"] <= row["target_s"] else "no"  # by the clock, on the cores there are
        return row["case"], "", "", "", f"{row['target_s']:g} s", met, "", *times, "", str(row["not_finite"])
    return (
        row["case"],
        str(row["key"]),
        _number(row.get("start")),
        _number(row["error"]) or "none",
        f"{row['target']:.7g}",
        "yes" if row["met"] else "no",
        f"{row['polish']:.0e}" if "polish" in row else "",
        *times,
        f"{row['screened']:,}",
        str(row["not_finite"]),
    )


def _lines(record: dict[str, Any]) -> list[tuple[str, ...]]:
    return [_cells(row) for rows in record["cases"].values() for row in rows]


def _machine(record: dict[str, Any]) -> str:
    low, high = min(record["load"]), max(record["load"])
    busy = f"{low:g} to {high:g} processes at a time wanted a core while it ran"
    return f"{record['machine']['cpu']}, {record['machine']['cores']} cores; {busy}"


def text(record: dict[str, Any], head: bool = True) -> str:
    """All rows as aligned columns, then the machine."""
    out = aligned([_HEAD, *_lines(record)], left=(0,))
    return f"{out}\n\n{_machine(record)}" if head else "\n".join(out.splitlines()[2:])


def section(path: Path) -> str:
    """The section of the page, from the JSON file; empty if there is none."""
    if not path.exists():
        return ""
    record = json.loads(path.read_text())
    rows = ["| " + " | ".join(r) + " |" for r in (_HEAD, (":--", *["--:"] * (len(_HEAD) - 1)), *_lines(record))]
    return (
        "## Design by gradient\n\n"
        "One search a row; the first of a case compiles what the others use. Errors are sums of squared distances, or\n"
        "the largest one where the unit is said or a linkage is to be recovered, measured on the finished design;\n"
        "start is the error of the idea; polish the part of the error that SciPy's SLSQP and least_squares, at\n"
        "tolerances of 1e-14, still take away. Compilation is what JAX reports of itself, by the clock on the wall.\n\n"
        f"{_machine(record)}.\n\n" + "\n".join(rows) + "\n"
    )
