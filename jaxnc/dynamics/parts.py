"""A simulation in parts, so that someone who watches sees how far it is."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from jaxnc import progress
from jaxnc.compiling import on_device
from jaxnc.dynamics.asked import Asked, Numbers
from jaxnc.dynamics.runs import Run

_COUNT = 20  # parts, or a few more
_DELAY = 2.0  # seconds before a bar is shown

Known = Callable[[Asked, Numbers], Run]


def watched(known: Known, asked: Asked, numbers: Numbers, name: str) -> Run:
    """A run of known numbers, with a bar if it takes more than a few seconds and someone is watching."""
    count = len(numbers.t) - 1
    if count < 2 or not progress.is_watched() or progress.showing():
        return known(asked, numbers)
    width = 2 ** max(0, int(np.ceil(np.log2(count / _COUNT))))
    parts: list[tuple[Run, int]] = []
    with progress.bar(count, name, "times", delay=_DELAY, leave=False) as shown:
        for first in range(0, count, width):
            at = np.asarray(numbers.t)[first : first + width + 1]
            whole = np.concatenate([at, np.full(width + 1 - len(at), at[-1])])  # one program for all parts
            found = known(asked, numbers._replace(t=whole))
            parts.append((found, len(at)))
            shown.update(len(at) - 1)
            if np.asarray(found.other["status"])[len(at) - 1]:
                break
            asked, numbers = asked._replace(places=None), _resumed(numbers, found)
    return _joined(parts, count + 1)


def _resumed(numbers: Numbers, found: Run) -> Numbers:
    """Where the next part begins: where the last one has ended, with the step that it wanted next."""
    made = sum(int(x) for x in found.other["steps"])
    control = numbers.control._replace(most=max(int(numbers.control.most) - made, 1))
    if found.kept is not None:
        control = control._replace(first=float(np.asarray(found.kept.h)[-1]))
    last = np.asarray(found.smooth["poses"])[-1], np.asarray(found.smooth["rates"][0])[-1]
    return numbers._replace(state=last[0], rates=last[1], control=control)


def _joined(parts: list[tuple[Run, int]], count: int) -> Run:
    """One run of its parts; what was not reached holds the last state."""
    runs = [run for run, _ in parts]

    def together(*each: Any) -> Any:
        cut = [np.asarray(x)[bool(k) : n] for k, (x, (_, n)) in enumerate(zip(each, parts, strict=True))]
        whole = np.concatenate(cut)
        return on_device(np.concatenate([whole, np.repeat(whole[-1:], count - len(whole), axis=0)]))

    def joined(which: str, names: tuple[str, ...]) -> dict[str, Any]:
        return {name: jax.tree.map(together, *(getattr(run, which)[name] for run in runs)) for name in names}

    smooth = joined("smooth", ("poses", "rates", "asked", "residual", "multipliers"))
    smooth["violation"] = tuple(
        on_device(np.max(x, axis=0)) for x in zip(*(r.smooth["violation"] for r in runs), strict=True)
    )
    smooth |= {"correction": runs[0].smooth["correction"], "end": runs[-1].smooth["end"]}
    steps = tuple(
        on_device(np.sum(x, axis=0, dtype=np.int32)) for x in zip(*(run.other["steps"] for run in runs), strict=True)
    )
    return Run(smooth, joined("other", ("status",)) | {"steps": steps}, runs[0].start, None)
