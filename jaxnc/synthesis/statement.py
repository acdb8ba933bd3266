"""What all problems have in common when they are stated: names, bounds and conditions, checked and completed."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.inputs import check_system
from jaxnc.mechanism import Mechanism
from jaxnc.solvers.plan import plan
from jaxnc.synthesis.conditions import Condition, Length
from jaxnc.synthesis.loops import four_bar_loop
from jaxnc.synthesis.problem import system_home
from jaxnc.synthesis.variables import interval, variables
from jaxnc.system.system import System, characteristic_length, drivable


def check_lengths(what: str, system: System, driven: str, conditions: Sequence[Condition]) -> None:
    """See that bounds of lengths leave something: each length by itself, and the loop at the input.

    Raises:
        InputError: naming the lengths whose bounds exclude every assembly.
    """
    box: dict[frozenset[str], tuple[float, float]] = {}
    for c in conditions:
        if isinstance(c, Length):
            pair = frozenset((c.start, c.end))
            low, high = box.get(pair, (0.0, np.inf))
            box[pair] = low, high = max(low, c.low), min(high, c.high)
            if not low <= high:
                raise InputError(f"{what}: length {c.start}-{c.end} is to be at least {low:g} and at most {high:g}; "
                                 f"these conditions contradict each other")  # fmt: skip
    loop = four_bar_loop(system, driven)
    names = loop.names(system) if loop is not None else ()
    bars = [
        (a, b, *box.get(frozenset((a, b)), (0.0, np.inf))) for a, b in zip(names, names[1:] + names[:1], strict=True)
    ]
    for a, b, low, _ in bars:
        rest = [bar for bar in bars if bar[:2] != (a, b)]
        most = sum(bar[3] for bar in rest)
        if low > most:
            raise InputError(
                f"{what}: the bounds exclude every assembly: {a}-{b} is at least {low:g}, and the other sides of the "
                f"loop, {', '.join(f'{c}-{d}' for c, d, *_ in rest)}, are at most {most:g} together"
            )


def set_up(
    what: str,
    mechanism: Mechanism | System,
    driven: str | None,
    free: Sequence[str] | None,
    bounds: Mapping[str, Any] | None,
    subject_to: Sequence[Condition],
    hold: Sequence[str],
    travel: tuple[float, float] | None,
    given: Sequence[float] | np.ndarray = (),
) -> dict[str, Any]:
    """Check and complete what all problems have in common; returns fields of `Problem`.

    `given` are values of the input, where they are known.
    """
    description = mechanism if isinstance(mechanism, Mechanism) else None
    system = mechanism.compile() if isinstance(mechanism, Mechanism) else mechanism
    check_system(system, what)
    top = system.topology
    if driven is None:
        named = description.model.run.inputs if description is not None else {}
        names = list(named) or [s for s in top.scalars]
        if len(names) != 1:
            raise InputError(
                f"{what}: say which coordinate is driven: input=, one of {', '.join(drivable(system.topology))}"
            )
        (driven,) = names
    elif driven not in drivable(top):
        raise InputError(
            f"{what}: {top.name!r} has no coordinate {driven!r} to drive; {nearest(driven, drivable(top))}"
        )
    plan(top, (driven,), tuple(hold), system.degrees_of_freedom)
    lengths, box = [], {}
    for name, pair in (bounds or {}).items():
        start, dash, end = name.partition("-")
        if dash and name not in top.dimensions and start in top.points and end in top.points:
            low, high = interval(pair, f"{what}: bounds of {name!r}")
            lengths.append(Length(start, end, low, high))
        else:
            box[name] = pair
    found = variables(system, free, box, what)
    for c in subject_to:
        if not isinstance(c, Condition):
            raise InputError(f"{what}: subject_to= takes conditions such as crank_turns(), got {c!r}")
    conditions = tuple(c.prepared(system, driven) for c in (*subject_to, *lengths))
    check_lengths(what, system, driven, conditions)
    if travel is None and len(given):
        travel = (float(np.min(given)), float(np.max(given)))
    elif travel is None:
        turning = driven in top.scalars and bool(top.periodic[top.scalars.index(driven)])
        home = float(system_home(system, driven))
        travel = (home, home + 2 * np.pi) if turning else (home, home)
        if not turning and any(c.over_range for c in conditions):
            raise InputError(f"{what}: say over which range {driven!r} moves: travel=(low, high)")
    else:
        travel = interval(travel, f"{what}: travel")
    return {
        "system": system,
        "driven": driven,
        "variables": found,
        "conditions": conditions,
        "hold": tuple(hold),
        "travel": travel,
        "whole": bool(np.isclose(travel[1] - travel[0], 2 * np.pi)),
        "length": float(characteristic_length(system.parameters.points)),
        "mechanism": description,
    }
