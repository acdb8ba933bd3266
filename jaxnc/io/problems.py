"""Problem files: what a mechanism should do, for `jaxnc synthesise`; TOML or JSON beside the model file they name."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs

from jaxnc.io.curve_files import outline, read_numbers
from jaxnc.io.drives import unit_of
from jaxnc.io.files import load
from jaxnc.io.source import ConditionEntry, ProblemFile, SearchOptions, Source, SvgTarget, statement
from jaxnc.mechanism import Mechanism
from jaxnc.synthesis import conditions as kinds
from jaxnc.synthesis.clearance import clear_links, clear_of
from jaxnc.synthesis.conditions import direction, on_circuit
from jaxnc.synthesis.function import FunctionGeneration
from jaxnc.synthesis.path import MotionGeneration, PathGeneration, rotation_matrix
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.search.stock import integer, stock
from jaxnc.synthesis.validate import as_interval
from jaxnc.vehicle.suspension import ATTITUDE


def load_problem(path: str | Path) -> tuple[Problem, SearchOptions]:
    """Read a problem file.

    Angles are in the angle unit of the model file: orientations (in space rotation vectors: the axis, as long as the
    angle is large), transmission angles; timing, values and travel of an input that is one. A target may be the name
    of a CSV file of points, or of a table with the columns input, output; or a path of a drawing,
    ``{ svg = "foot.svg", points = 60, size = 0.2 }``, which also says whether it is closed.
    """
    said, source = statement(path)
    folder = source.path.parent
    mechanism = load(folder / said.mechanism)
    watched = _Watched(said, "mechanism", "search", "kind")
    with source.blamed():
        made = _problem(watched, mechanism, folder, source)
    watched.refuse_unused(source, f"a problem of kind {said.kind!r}")
    return made, said.search


def _problem(said: Any, mechanism: Mechanism, folder: Path, source: Source) -> Problem:
    angle = math.pi / 180.0 if mechanism.model.units.angle == "deg" else 1.0
    names = [*mechanism.model.angles, *mechanism.model.distances]
    likely = [*mechanism.model.run.inputs] or names
    driven = said.input or (likely[0] if len(likely) == 1 else None)
    unit = unit_of(mechanism, driven) if driven is not None else 1.0
    common: dict[str, Any] = {
        "input": said.input,
        "free": said.free,
        "bounds": said.bounds,
        "hold": said.hold,
        "weights": said.weights,
        "minimax": said.minimax,
        "subject_to": [_condition(c, mechanism, unit, k, source) for k, c in enumerate(said.conditions)],
    }
    for name, pair in said.bounds.items():
        with source.blamed(("bounds", name)):
            for one in pair if any(isinstance(p, list) for p in pair) else [pair]:
                as_interval(one, f"bounds of {name!r}")
    target, closed = _target(said, folder, source)

    def require(name: str) -> Any:
        value = getattr(said, name)
        if value is None:
            raise source.fault(f"kind = {said.kind!r} needs {name} = …")
        return value

    if said.kind == "function":
        output = require("output")
        target = np.asarray(target, dtype=float)
        if said.values is None and target.ndim == 2 and target.shape[1] == 2:
            values, target = target.T
        else:
            values = require("values")
        # A number of a suspension, if no coordinate is called so.
        attitude = ATTITUDE.get(output) == "angle" and output not in mechanism.scalar_names
        out = angle if attitude else unit_of(mechanism, output)
        offsets = {"input_offset": said.input_offset, "output_offset": said.output_offset}
        return FunctionGeneration(mechanism, output, np.asarray(values) * unit, target * out, **offsets, **common)
    travel = None if said.travel is None else (said.travel[0] * unit, said.travel[1] * unit)
    timing = None if said.timing is None else np.asarray(said.timing) * unit
    common |= {"travel": travel, "offset": said.offset, "timing": timing}
    if said.kind == "path":
        begun = None if said.start_timing is None else np.asarray(said.start_timing) * unit
        common |= {"ordered": said.ordered, "start_timing": begun, "either_sense": said.either_sense}
        return PathGeneration(mechanism, require("point"), target, closed=closed, **common)
    turns = _orientations(require("orientations"), mechanism.model.dim, angle, source)
    return MotionGeneration(mechanism, require("body"), require("point"), target, turns, **common)


def _orientations(given: list[Any], dim: int, angle: float, source: Source) -> np.ndarray:
    """Read angles, or rotation vectors as matrices."""
    try:
        found = np.asarray(given, dtype=float) * angle
    except (TypeError, ValueError, OverflowError):
        found = np.zeros(0)
    if found.ndim != dim - 1 or found.shape[1:] != (3,) * (dim - 2):
        wanted = "angles, one for each pose" if dim == 2 else "rotation vectors [x, y, z], one for each pose"
        raise source.fault(f"orientations must be {wanted}", ("orientations",))
    return found if dim == 2 else np.stack([np.asarray(rotation_matrix(v)) for v in found])


class _Watched:
    """A record of a file that remembers which of its fields were asked for."""

    def __init__(self, record: ProblemFile | ConditionEntry, *asked: str):
        self._record, self._asked = record, {*asked}

    def __getattr__(self, name: str) -> Any:
        self._asked.add(name)
        return getattr(self._record, name)

    def refuse_unused(self, source: Source, where: str, *place: str | int) -> None:
        """Refuse fields that were given, and nobody asked for."""
        for field in structs.fields(self._record):
            if field.name not in self._asked and getattr(self._record, field.name) not in (field.default, [], {}):
                raise source.fault(f"{field.name} = … says nothing in {where}; leave it out", (*place, field.name))


def _condition(entry: ConditionEntry, mechanism: Mechanism, driven: float, k: int, source: Source) -> kinds.Condition:
    """Make the condition that an entry means, with nothing in it that says nothing; `driven` is one of the input."""
    angle = math.pi / 180.0 if mechanism.model.units.angle == "deg" else 1.0
    c: Any = _Watched(entry)

    def require(name: str, count: int | None = None) -> Any:
        value = getattr(c, name)
        if value is None or (count is not None and len(value) != count):
            wanted = f"{count} names" if count else "a value"
            raise source.fault(f"condition {c.type!r} needs {name} = …, {wanted}", ("conditions", k))
        return value if count is None else tuple(value)

    def variable() -> Any:
        return require("points", 2) if c.variable is None else c.variable

    def scale(*values: float | None, by: float = angle) -> Any:
        return tuple(None if value is None else value * by for value in values)

    made: dict[str, Callable[[], kinds.Condition]] = {
        "crank turns": lambda: kinds.crank_turns(c.kind, c.margin),
        "transmission angle": lambda: kinds.transmission_angle(require("min") * angle, c.joint),
        "size": lambda: kinds.size(require("max")),
        "stock": lambda: stock(variable(), require("sizes")),
        "integer": lambda: integer(variable(), c.step),
        "within": lambda: kinds.within(require("point"), c.x, c.y, c.z),
        "clear of": lambda: clear_of(require("region"), c.links, c.width, c.margin),
        "clear links": lambda: clear_links(require("layers"), c.width, c.margin),
        "no flip": lambda: kinds.no_flip(c.distance, *scale(c.input, by=driven)),
        "only circuit": lambda: kinds.only_circuit(
            {name: scale(*bounds, by=unit_of(mechanism, name)) for name, bounds in (c.stops or {}).items()}
        ),
        "circuit": lambda: on_circuit(require("side"), c.joint),
        "direction": lambda: direction(*require("points", 2), *scale(c.value, c.min, c.max)),
        "length": lambda: kinds.length(*require("points", 2), min=c.min, max=c.max),
        "local": lambda: kinds.local(along=require("points", 2), point=require("point"), x=c.x, y=c.y),
        "symmetric": lambda: kinds.symmetric(*require("points", 2), *([] if c.about is None else [c.about])),
        "equal": lambda: kinds.equal(require("points", 2), require("other", 2) if c.value is None else c.value),
    }
    with source.blamed(("conditions", k)):
        condition = made[c.type]()
    c.refuse_unused(source, f"a condition {entry.type!r}", "conditions", k)
    return condition


def _target(said: ProblemFile, folder: Path, source: Source) -> tuple[Any, bool]:
    """Return the target's numbers, and whether it is closed."""
    target = said.target
    if isinstance(target, str) and target.lower().endswith(".svg"):
        raise source.fault(
            f'a drawing needs the number of points: target = {{ svg = "{target}", points = 60 }}', ("target",)
        )
    if isinstance(target, str):
        try:
            numbers = read_numbers(folder / target)
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or error
            raise source.fault(f"target {target!r} cannot be read ({why})", ("target",)) from None
        if not len(numbers):
            raise source.fault(f"target {target!r} holds no numbers", ("target",))
        return numbers, bool(said.closed)
    if isinstance(target, SvgTarget):
        if said.kind == "function":
            raise source.fault(
                "a function is a table of numbers; a path of a drawing is a target of a path", ("target",)
            )
        with source.blamed(("target",)):
            d = target
            found = outline(folder / d.svg, d.points, d.id, d.piece, d.size, d.centre, d.up)
        return found.points, found.closed if said.closed is None else said.closed
    if isinstance(target, list):
        try:
            target = np.asarray(target, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise source.fault("target must be numbers, or rows of equally many numbers", ("target",)) from None
    return target, bool(said.closed)
