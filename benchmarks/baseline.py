"""The committed baseline: ratios only, one set for full runs and one for quick ones, and the gate that reads it."""

import json
from pathlib import Path

from benchmarks.record import Record

DEFAULT = Path(__file__).with_name("baseline.json")


def write(record: Record, path: Path) -> None:
    """Make this run's ratios the baseline of its mode; ratios of cases that did not run stay."""
    data = json.loads(path.read_text()) if path.exists() else {}
    section = data.setdefault(_mode(record), {})
    for r in record.ratios:
        if r.tolerance is not None:
            section[r.name] = {"value": float(f"{r.value:.6g}"), "direction": r.direction, "tolerance": r.tolerance}
    path.write_text(json.dumps(data, indent=1, ensure_ascii=False, sort_keys=True) + "\n")


def regressions(record: Record, path: Path) -> tuple[list[str], int]:
    """Ratios that are worse than the baseline by more than their tolerance, as sentences.

    Direction and tolerance are those of the baseline. A ratio that only one side has (a peer that is not installed, a
    case that did not run) is not compared.

    Returns:
        The sentences, and how many ratios were compared.
    """
    if not path.exists():
        return [], 0
    section = json.loads(path.read_text()).get(_mode(record), {})
    worse, compared = [], 0
    for r in record.ratios:
        stored = section.get(r.name)
        if stored is None or r.tolerance is None:
            continue
        compared += 1
        was, lower, tolerance = stored["value"], stored["direction"] == "lower", stored["tolerance"]
        limit = was + (1 if lower else -1) * tolerance * abs(was)
        if (r.value > limit) if lower else (r.value < limit):
            sign = "at most" if lower else "at least"
            worse.append(f"{r.name}: {r.value:.6g}, baseline {was:.6g}, {sign} {limit:.6g} is let through")
    return worse, compared


def _mode(record: Record) -> str:
    return "quick" if record.quick else "full"
