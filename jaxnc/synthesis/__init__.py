"""Design by gradient: what a mechanism should do, and the best designs found for it."""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jaxnc.synthesis.conditions import (
        condition,
        crank_turns,
        equal,
        length,
        local,
        size,
        transmission_angle,
        within,
    )
    from jaxnc.synthesis.path import PathGeneration
    from jaxnc.synthesis.result import Design, Result, load
    from jaxnc.synthesis.search import solve

_HOME = {
    "jaxnc.synthesis.conditions": (
        "condition",
        "crank_turns",
        "equal",
        "length",
        "local",
        "size",
        "transmission_angle",
        "within",
    ),
    "jaxnc.synthesis.path": ("PathGeneration",),
    "jaxnc.synthesis.result": ("Design", "Result", "load"),
    "jaxnc.synthesis.search": ("solve",),
}
_WHERE = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "Design",
    "PathGeneration",
    "Result",
    "condition",
    "crank_turns",
    "equal",
    "length",
    "load",
    "local",
    "size",
    "solve",
    "transmission_angle",
    "within",
]


def __getattr__(name: str):
    if name in _WHERE:
        return getattr(importlib.import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'jaxnc.synthesis' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
