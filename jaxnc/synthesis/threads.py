"""Work on blocks of arrays in as many threads as there are processors: NumPy lets go of the interpreter meanwhile."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

_Item = TypeVar("_Item")
_Out = TypeVar("_Out")
_MOST = 8  # threads


def in_threads(work: Callable[[_Item], _Out], items: Sequence[_Item]) -> list[_Out]:
    """What comes of each item, in their order; the first one by itself, which makes ready what the others share."""
    out, rest = [work(item) for item in items[:1]], items[1:]
    count = min(_processors(), _MOST, len(rest))
    if count < 2:
        return out + [work(item) for item in rest]
    pool = ThreadPoolExecutor(count)
    try:
        return out + list(pool.map(work, rest))
    finally:
        pool.shutdown(cancel_futures=True)


def _processors() -> int:
    """How many processors this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # where a process cannot be held to some of them
        return os.cpu_count() or 1
