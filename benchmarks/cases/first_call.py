"""How long the first batched call compiles, in fresh processes and without a compilation cache."""

import statistics

from benchmarks import fresh
from benchmarks.record import Row
from benchmarks.suite import Suite


def compiled(suite: Suite) -> None:
    """First call minus later call, for the four-bar and the MacPherson suspension."""
    for mechanism in ("four-bar", "MacPherson"):
        found = [fresh.measure(f"first-call:{mechanism}") for _ in range(suite.size(3, 1))]
        seconds = [f["first_s"] - f["later_s"] for f in found]
        middle = statistics.median(seconds)
        lanes = found[0]["lanes"]
        note = (
            f"first call of {lanes:,} lanes less a later one, imports ({found[0]['import_s']:.1f} s) and "
            f"Mechanism.compile ({found[0]['build_s']:.2f} s) apart; {len(found)} fresh processes"
        )
        later = statistics.median(f["later_s"] for f in found) / lanes * 1e9
        spread = (max(seconds) - min(seconds)) / middle
        suite.record.rows.append(Row(f"compile {mechanism}", "jaxnc", lanes, later, spread, None, middle, note))
