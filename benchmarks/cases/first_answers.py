"""How long a person waits for the first answers of a new process, without a compilation cache."""

import statistics

from benchmarks import fresh
from benchmarks.record import OURS, Row
from benchmarks.suite import Suite

IMPORT = "import numpy"
STEPS = {
    "compile": "Mechanism.compile, and what it imports besides jax and numpy",
    "first sweep": "361 poses with rates",
    "another number": "of poses, 200",
    "second sweep": "361 poses again",
    "another design": "of the same topology, 361 poses",
    "first pose": "solve_position in a process that has swept",
}
"""What is timed, one after the other, in one process."""


def swept(suite: Suite) -> None:
    """A four-bar, a Jansen leg and a MacPherson strut: compiled, swept, swept otherwise, and again."""
    for mechanism in ("four-bar", "Jansen", "MacPherson"):
        _add(suite, f"first answers, {mechanism}", f"first-answers:{mechanism}", STEPS)


def many_linkages(suite: Suite) -> None:
    """Different small linkages one after the other, each compiled and swept once."""
    count = suite.size(50, 10)
    steps = {"all": f"{count} linkages of 4 to 10 bars with random dimensions, 91 poses each"}
    _add(suite, "first answers, linkages", f"linkages:{count}", steps)


def searches(suite: Suite) -> None:
    """The first design of a search for a path, a function and a suspension's toe, and that of a problem stated anew."""
    for kind in ("path", "function", "suspension"):
        steps = {"first search": "until its designs are ranked", "second search": "the problem stated anew"}
        _add(suite, f"first answers, search for a {kind}", f"search:{kind}", steps)


def _add(suite: Suite, case: str, name: str, steps: dict[str, str]) -> None:
    found = [fresh.measure(name) for _ in range(suite.size(5, 1))]
    for step, note in {IMPORT: "for comparison, in the same processes", **steps}.items():
        seconds = [f["seconds"][step] for f in found]
        middle = statistics.median(seconds)
        spread = (max(seconds) - min(seconds)) / middle
        right = None if step == IMPORT else min(f["right"] for f in found)
        way = step if step == IMPORT else f"{OURS}: {step}"
        suite.record.rows.append(Row(case, way, 1, middle * 1e9, spread, right, None, note))
