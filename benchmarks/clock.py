"""Timing: warm-up apart, the ways of one case in turn, new inputs for every repeat.

Time is processor time: a process bound to one core is not charged for what its neighbours do there.
"""

import dataclasses
import gc
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.record import OURS, Row

_PROBE = 4000  # lanes of the first calls, which show how long a full call will take
_SHORT = 0.1  # seconds that a way is timed for at least
_TOO_LONG = 6.0  # seconds: a way whose full call would take longer runs on fewer lanes, and says so


@dataclasses.dataclass(frozen=True)
class Way:
    """One way to compute a batch.

    Args:
        name: what the table calls it.
        run: the timed call: takes prepared inputs, returns when the result is there.
        right: ``(result, data) -> fraction of right lanes``.
        prepare: brings drawn data into the form that `run` takes; not timed.
        compiles: whether the first call compiles.
        note: what a reader must know.
        most: largest size it is run at (None: as large as the others).
        build_s: seconds spent on building it before, counted as compilation.
    """

    name: str
    run: Callable[[Any], Any]
    right: Callable[[Any, Any], float | None]
    prepare: Callable[[Any], Any] = lambda data: data
    compiles: bool = False
    note: str = ""
    most: int | None = None
    build_s: float | None = None


@dataclasses.dataclass(frozen=True)
class Pace:
    """How thoroughly to measure.

    Args:
        repeats: timed calls of each way.
        budget: seconds after which a way is not repeated any more.
    """

    repeats: int = 7
    budget: float = 15.0


@dataclasses.dataclass
class _Run:
    """A way that works, and how its calls went."""

    way: Way
    size: int
    repeats: int
    compile_s: float | None
    note: str
    times: list[float] = dataclasses.field(default_factory=list)
    rights: list[float | None] = dataclasses.field(default_factory=list)


def compare(
    case: str, ways: Sequence[Way], draw: Callable[[int, int], Any], size: int, pace: Pace, per: int = 1
) -> tuple[list[Row], list[str]]:
    """Time several ways of doing the same.

    Args:
        case: name of the case.
        ways: the ways.
        draw: ``(seed, size) -> data``: inputs, different for every seed.
        size: how many are asked for.
        pace: how thoroughly.
        per: lanes of one unit of size (angles of one design).

    Returns:
        A row for each way, and which opponents broke down, with the reason. This library's own errors are raised.
    """
    runs, broken = [], []
    for way in ways:
        try:
            runs.append(_warm(way, draw, size, pace, per))
        except Exception as error:
            if way.name.startswith(OURS):
                raise
            broken.append(f"{way.name}: {type(error).__name__}: {str(error)[:160]}")
    for k in range(max((r.repeats for r in runs), default=0)):
        drawn: dict[int, Any] = {}
        if k < pace.repeats:
            gc.collect()
        for r in runs:
            if k >= r.repeats or sum(r.times) > pace.budget:
                continue
            if r.size not in drawn:
                drawn[r.size] = draw(k + 3, r.size)
            seconds, right = _timed(r.way, drawn[r.size])
            r.times.append(seconds)
            r.rights.append(right)
    return [row(case, r.way.name, r.size * per, r.times, r.rights, r.compile_s, r.note) for r in runs], broken


def _warm(way: Way, draw: Callable[[int, int], Any], size: int, pace: Pace, per: int) -> _Run:
    """First calls of a way, which compile it and show how many lanes and repeats there is time for."""
    full = min(size, way.most or size)
    small = min(full, max(1, _PROBE // per))
    first = _timed(way, draw(0, small))[0]
    later = min(_timed(way, draw(k, small))[0] for k in (1, 2))
    compile_s = max(0.0, first - later) + (way.build_s or 0.0) if way.compiles else None
    expected, lanes, note = later * full / small, full, way.note
    if expected > _TOO_LONG:
        lanes = max(small, int(full * _TOO_LONG / expected))
    if lanes < size:
        note = (note + "; " if note else "") + f"on {lanes * per:,} lanes"
    if lanes != small:
        _timed(way, draw(0, lanes))
    # Short calls are disturbed more: repeat them more often.
    repeats = int(min(101, max(pace.repeats, _SHORT / max(expected, 1e-6))))
    return _Run(way, lanes, repeats, compile_s, note)


def row(
    case: str,
    way: str,
    lanes: int,
    seconds: Sequence[float],
    rights: Sequence[float | None],
    compile_s: float | None = None,
    note: str = "",
) -> Row:
    """The row of one way from the times of its calls."""
    low, middle, high = np.percentile(seconds, [10, 50, 90]).tolist()
    known = [r for r in rights if r is not None]
    right = min(known) if known else None
    return Row(case, way, lanes, middle / lanes * 1e9, (high - low) / middle, right, compile_s, note)


def _timed(way: Way, data: Any) -> tuple[float, float | None]:
    """Seconds of one call and its fraction of right lanes."""
    prepared = way.prepare(data)
    start = time.process_time()
    result = way.run(prepared)
    seconds = time.process_time() - start
    return seconds, way.right(result, data)
