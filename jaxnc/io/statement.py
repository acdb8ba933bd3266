"""What a problem file of `jaxnc synthesise` may say, and how to search; `jaxnc.io.problems` makes a problem of it."""

from pathlib import Path
from typing import Any, Literal

import msgspec

from jaxnc.io.source import Source, decode
from jaxnc.io.target import file_name


class _Record(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    pass


class ConditionEntry(_Record):
    """An entry of ``[[conditions]]``; which fields there are depends on its type."""

    type: Literal[
        "crank turns",
        "transmission angle",
        "length",
        "equal",
        "symmetric",
        "within",
        "local",
        "size",
        "stock",
        "integer",
        "direction",
        "circuit",
        "clear of",
        "clear links",
        "no flip",
        "only circuit",
    ]
    kind: Literal["crank-rocker", "double-crank"] | None = None
    margin: float = 0.0
    min: float | None = None
    max: float | None = None
    joint: tuple[str, str, str] | None = None
    points: list[str] = []
    other: list[str] = []
    value: float | None = None
    about: list | None = None
    variable: str | None = None
    sizes: list[float] | None = None
    step: float = 1.0
    side: Literal["left", "right"] | None = None
    point: str | None = None
    x: tuple[float | None, float | None] | None = None
    y: tuple[float | None, float | None] | None = None
    region: list[tuple[float, float]] | None = None
    links: list[str] | None = None
    layers: dict[str, int] | list[str] | None = None
    width: float = 0.0
    distance: float | None = None
    input: float | None = None
    stops: dict[str, tuple[float | None, float | None]] | None = None


class SvgTarget(_Record):
    """A target that is a path of an SVG file; see `jaxnc.io.svg.outline`."""

    svg: str
    points: int
    id: str | None = None
    piece: int | None = None
    size: float | None = None
    centre: tuple[float, float] | None = None
    up: bool = True


class SearchOptions(_Record):
    """How long to search; see `jaxnc.synthesis.solve`."""

    starts: int = 20_000
    refine: int = 192
    iterations: int = 400
    keep: int = 10
    key: int = 0
    seconds: float | None = None
    enough: float = 0.0


class ProblemFile(_Record):
    """A problem file."""

    mechanism: str
    kind: Literal["path", "function", "motion"]
    target: str | list[Any] | SvgTarget
    point: str | None = None
    output: str | None = None
    body: str | None = None
    input: str | None = None
    timing: list[float] | None = None
    values: list[float] | None = None
    orientations: list | None = None
    start_timing: list[float] | None = None
    ordered: bool = True
    closed: bool | None = None
    offset: bool = False
    either_sense: bool = False
    input_offset: bool = False
    output_offset: bool = False
    minimax: bool = False
    free: list[str] | None = None
    hold: list[str] = []
    travel: tuple[float, float] | None = None
    weights: list[float] | None = None
    bounds: dict[str, list] = {}
    conditions: list[ConditionEntry] = []
    search: SearchOptions = msgspec.field(default_factory=SearchOptions)


def statement(path: str | Path) -> tuple[ProblemFile, Source]:
    """Read what a problem file says, without making a problem of it; that takes JAX."""
    source = Source(file_name(path))
    return decode(source, ProblemFile), source
