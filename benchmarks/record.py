"""What a run leaves behind: rows of measured times and the ratios between them, as JSON with a fixed schema."""

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

VERSION = 1
OURS = "jaxnc"


@dataclasses.dataclass(frozen=True)
class Row:
    """One way to do one case at one size.

    Args:
        case: name of the case.
        way: who did it; those of this library begin with ``jaxnc``.
        size: number of lanes (poses) of one call.
        median_ns_per_lane: median over the repeats, nanoseconds per lane.
        spread: (90th - 10th percentile) / median over the repeats.
        correct: fraction of lanes that are right, the smallest of all timed calls; None where nothing is checked.
        compile_s: what the first call took longer than a later one, seconds; None where nothing is compiled.
        note: what a reader must know to compare it.
    """

    case: str
    way: str
    size: int
    median_ns_per_lane: float
    spread: float
    correct: float | None
    compile_s: float | None
    note: str = ""


@dataclasses.dataclass(frozen=True)
class Ratio:
    """A number that is compared with the baseline, or with a target.

    Args:
        name: what it is.
        value: the number.
        direction: ``"lower"`` or ``"higher"``: which is better.
        tolerance: relative change for the worse that is let through; None for a number that is never compared with
            the baseline (absolute times).
        target: what it has to reach; None without one.
        met: whether the target is met; None without one.
    """

    name: str
    value: float
    direction: str
    tolerance: float | None
    target: float | None
    met: bool | None

    @classmethod
    def of(
        cls, name: str, value: float, direction: str, tolerance: float | None = 0.3, target: float | None = None
    ) -> "Ratio":
        """A ratio that knows by itself whether it meets its target."""
        met = None if target is None else bool(value <= target if direction == "lower" else value >= target)
        return cls(name, value, direction, tolerance, target, met)


@dataclasses.dataclass
class Record:
    """Everything one run has measured."""

    machine: dict[str, Any]
    quick: bool
    rows: list[Row] = dataclasses.field(default_factory=list)
    ratios: list[Ratio] = dataclasses.field(default_factory=list)
    left_out: list[str] = dataclasses.field(default_factory=list)
    failed: list[str] = dataclasses.field(default_factory=list)

    def find(self, case: str, way: str, size: int | None = None) -> Row | None:
        """The row of a way in a case, of the largest size unless one is given; None if it was not measured."""
        found = [r for r in self.rows if r.case == case and r.way == way and size in (None, r.size)]
        return max(found, key=lambda r: r.size, default=None)

    def leave_out(self, what: str, why: str) -> None:
        """Say that something is not measured, and why."""
        line = f"{what}: {why}"
        if line not in self.left_out:
            self.left_out.append(line)

    def keep(self, old: "Record") -> None:
        """Take over from an earlier run the rows of cases that are not in this one, in the order they had."""
        new: dict[str, list[Row]] = {}
        for row in self.rows:
            new.setdefault(row.case, []).append(row)
        order = dict.fromkeys([*(r.case for r in old.rows), *new])
        self.rows = [r for case in order for r in (new.get(case) or [r for r in old.rows if r.case == case])]
        measured = tuple(f"{r.case}, {r.way}:" for r in self.rows)
        before = [line for line in old.left_out if not line.startswith(measured)]
        self.left_out = list(dict.fromkeys([*before, *self.left_out]))

    def write(self, path: Path) -> None:
        """Write as JSON."""
        path.parent.mkdir(parents=True, exist_ok=True)
        data = {
            "version": VERSION,
            "machine": self.machine,
            "quick": self.quick,
            "rows": [_plain(r) for r in self.rows],
            "ratios": [_plain(r) for r in self.ratios],
            "left_out": self.left_out,
            "failed": self.failed,
        }
        path.write_text(json.dumps(data, indent=1) + "\n")

    @classmethod
    def read(cls, path: Path) -> "Record":
        """Read what `write` wrote."""
        data = json.loads(path.read_text())
        if data.get("version") != VERSION:
            raise SystemExit(f"{path}: schema version {data.get('version')}, this suite reads {VERSION}")
        rows, ratios = [Row(**r) for r in data["rows"]], [Ratio(**r) for r in data["ratios"]]
        return cls(data["machine"], data["quick"], rows, ratios, data["left_out"], data["failed"])


def _plain(item: Row | Ratio) -> dict[str, Any]:
    """A record as numbers of four digits: more is noise."""
    out = dataclasses.asdict(item)
    for key, value in out.items():
        if isinstance(value, float) and key != "correct" and math.isfinite(value):
            out[key] = float(f"{value:.4g}")
    return out
