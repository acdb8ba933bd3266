"""The committed baselines, one for each kind of processor: ratios only, of full runs and quick ones, and their gate.

Two processors differ in more than speed: where C is twice as quick and memory is not, every ratio to a peer moves. So
a run is held against a baseline of its own kind of processor; where there is none, against the most lenient of all.
"""

import json
from pathlib import Path
from typing import Any

from benchmarks.record import Record

DEFAULT = Path(__file__).with_name("baseline.json")


def write(record: Record, path: Path) -> None:
    """Make this run's ratios the baseline of its processor and mode; ratios of cases that did not run stay."""
    data = json.loads(path.read_text()) if path.exists() else {}
    section = data.setdefault(record.machine["cpu"], {}).setdefault(_mode(record), {})
    for r in record.ratios:
        if r.tolerance is not None:
            section[r.name] = {"value": float(f"{r.value:.6g}"), "direction": r.direction, "tolerance": r.tolerance}
    path.write_text(json.dumps(data, indent=1, ensure_ascii=False, sort_keys=True) + "\n")


def regressions(record: Record, path: Path) -> tuple[list[str], int, str]:
    """Ratios that are worse than the baseline by more than their tolerance, as sentences.

    Direction and tolerance are those of the baseline. A ratio that only one side has (a peer that is not installed, a
    case that did not run) is not compared.

    Returns:
        The sentences, how many ratios were compared, and with which baseline.
    """
    data = json.loads(path.read_text()) if path.exists() else {}
    cpu, mode = record.machine["cpu"], _mode(record)
    of_this = mode in data.get(cpu, {})
    sections = [data[cpu][mode]] if of_this else [sets[mode] for sets in data.values() if mode in sets]
    if not sections:
        return [], 0, "no baseline"
    name = f"the baseline of {cpu}" if of_this else f"the most lenient baseline, as there is none of {cpu}"
    worse, compared = [], 0
    for r in record.ratios:
        stored = [section[r.name] for section in sections if r.name in section]
        if not stored or r.tolerance is None:
            continue
        compared += 1
        lower = stored[0]["direction"] == "lower"
        lenient = (max if lower else min)(stored, key=_limit)
        limit = _limit(lenient)
        if (r.value > limit) if lower else (r.value < limit):
            sign = "at most" if lower else "at least"
            was = lenient["value"]
            worse.append(f"{r.name}: {r.value:.6g}, baseline {was:.6g}, {sign} {limit:.6g} is let through")
    return worse, compared, name


def _limit(stored: dict[str, Any]) -> float:
    """The worst value that is let through."""
    was = stored["value"]
    return was + (1 if stored["direction"] == "lower" else -1) * stored["tolerance"] * abs(was)


def _mode(record: Record) -> str:
    return "quick" if record.quick else "full"
