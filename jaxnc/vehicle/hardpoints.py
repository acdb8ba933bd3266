"""Hardpoints of suspensions: the library's names for them, the book's numbers, and what the trade calls them."""

import itertools
from collections.abc import Iterable
from typing import Any, NamedTuple

Line = str | tuple[str, str]
"""A direction: the name of a unit vector or marker, or two points."""


class Names(NamedTuple):
    """Names of the parts of a suspension."""

    wheel_centre: Any = None  # a point or marker
    spin_axis: Any = None  # a `Line`
    steering_axis: tuple[str, str] | None = None
    contact: str | None = None
    spring: Line | None = None


USUAL = (
    Names("wheel_centre", ("wheel_centre", "spindle"), ("lower_ball", "upper_ball"), "contact", "damper"),
    Names("wheel_centre", "spin_axis", ("lower_ball", "upper_ball"), "contact", "damper"),
    Names("6", "v2", ("2", "8"), "contact", "s"),  # figure 42
)
"""Names that are looked for where none are given: those of `jaxnc.library`."""

FIGURE_42 = {
    "1": "lower_front",
    "2": "lower_ball",
    "3": "strut_lower",
    "5": "tie_outer",
    "6": "wheel_centre",
    "8": "strut_top",
    "10": "tie_inner",
}
"""Numbers of a MacPherson suspension's hardpoints in figure 42, and the library's names for them."""

RACK = {"wheel_centre": "tie_inner.y", "6": "10.y"}
"""The coordinate by which the library's suspensions are steered, by the name of the wheel's centre."""

_TRADE = {
    "lower_front": "LCA front",
    "lower_rear": "LCA rear",
    "lower_ball": "lower ball joint",
    "upper_front": "UCA front",
    "upper_rear": "UCA rear",
    "upper_ball": "upper ball joint",
    **{
        f"{level}_{side}_{end}": f"{level} {side} link, {end}"
        for level, side, end in itertools.product(("lower", "upper"), ("front", "rear"), ("inner", "outer"))
    },
    "strut_lower": "strut lower",
    "strut_top": "strut top",
    "tie_inner": "tie rod inner",
    "tie_outer": "tie rod outer",
    "wheel_centre": "wheel centre",
    "spindle": "spindle end",
    "spin_axis": "spin axis",
    "rim": "rim point",
    "damper_lower": "damper lower",
    "damper_top": "damper top",
    "damper": "damper length",
    "contact": "contact patch",
}
_BESIDE = {  # of figure 42, what is no hardpoint
    "4": "strut tube end",
    "7": "rim point",
    "9": "damper rod end",
    "v1": "LCA axis",
    "v2": "spin axis",
    "v3": "across strut",
    "s": "damper length",
}


def names_in(line: Line) -> tuple[str, ...]:
    """The names in a direction."""
    return (line,) if isinstance(line, str) else tuple(line)


def usual(names: Iterable[str]) -> Names | None:
    """The usual names of a suspension's parts among some names; None if the wheel's centre or axis is not there."""
    known = set(names)
    return next((n for n in USUAL if known.issuperset((n.wheel_centre, *names_in(n.spin_axis)))), None)


def trade_names(names: Iterable[str], every: bool = False) -> dict[str, str]:
    """Find what the trade calls the hardpoints among some names (LCA and UCA: lower and upper control arm).

    Returns:
        By those of the names that have one; empty where this is no suspension with the usual names.
    """
    known = set(names)
    found = usual(known)
    if found is None:
        return {}
    beside = {n: _TRADE[of] for n, of in FIGURE_42.items()} | _BESIDE | {"contact": _TRADE["contact"]}
    trade = beside if found.wheel_centre in FIGURE_42 else _TRADE
    return {n: called for n, called in trade.items() if n in known and (every or called != n.replace("_", " "))}


def number_names(names: Iterable[str]) -> dict[str, str]:
    """Find what the trade calls the hardpoints that have the book's numbers, which say nothing by themselves."""
    return {name: trade for name, trade in trade_names(names).items() if name in FIGURE_42}
