"""The verdict on a mechanism for machines: one versioned record, which every command prints as JSON when asked to."""

import math
import re
from typing import Any, Literal

import msgspec

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.exports import version

VERSION = 1
"""Raised when a field changes its meaning or goes; new fields leave it as it is."""

_EXPECTATION = re.compile(r"\s*(.+?)(?:\s+(smallest|largest|range))?\s*(<=|>=|<|>)\s*([-+.\deE]+)\s*")
_HELP = "write QUANTITY [smallest|largest|range] < NUMBER (or <=, >, >=), such as 'psi range > 30'"

Code = Literal[
    "bad-input", "incomplete", "does-not-assemble", "does-not-move", "cannot-be-driven", "not-found",
    "beyond-limits", "expectation-missed", "no-design", "broke-off", "redundant", "overconstrained", "singular",
    "left-out", "loose", "unused", "doubtful-size", "drawing-does-not-fit", "nothing-driven", "not-known",
]  # fmt: skip


class _Record(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Every key is always there; a number that does not exist is null, never NaN."""


class Change(_Record):
    """The smallest change of one dimension that closes a mechanism."""

    dimension: str
    value: float
    becomes: float


class Finding(_Record):
    """Something worth knowing.

    ``error`` means that the mechanism, or the question, fails; ``warning`` that it was hardly meant so. `names` are the
    points, bodies, coordinates or rows that it is about, `remedies` what would mend it, the smallest change first.
    """

    code: Code
    level: Literal["error", "warning", "note"]
    text: str
    names: list[str] = []
    remedies: list[Change] = []


class Counts(_Record):
    """Counts of a mechanism: unknowns, equations and their rank, and freedoms, in the drawing assembled."""

    points: int
    bodies: int
    joints: int
    unknowns: int
    equations: int
    rank: int
    freedoms: int
    grubler: int
    redundant: list[str]
    overconstrained: int


class Reach(_Record):
    """How far an input can go from the drawing, in its unit; no limit is null. Limits are its nearest dead points.

    `followed` tells whether its motion was followed to its end; where not, limits that are null may lie farther on.
    """

    name: str
    unit: str
    lower: float | None
    upper: float | None
    turns: bool
    dead_points: list[float]
    followed: bool = True

    @property
    def no_limit(self) -> str:
        """Words for an end where there is none."""
        return "no limit" if self.followed else "no limit found"


class Drive(_Record):
    """The values that an input is driven through, in its unit; `rate` is per second."""

    name: str
    unit: str
    first: float
    last: float
    poses: int
    rate: float | None = None


class Poses(_Record):
    """Outcome of the poses; `conditioning` is 0 at a singular position, `residual` a length of `unit`."""

    asked: int
    found: int
    status: dict[str, int]
    residual: float | None
    conditioning: float | None
    unit: str


class Extreme(_Record):
    """The smallest and the largest value of a quantity over the motion, and the inputs there."""

    quantity: str
    unit: str
    smallest: float
    smallest_at: dict[str, float]
    largest: float
    largest_at: dict[str, float]


class Derivative(_Record):
    """The derivative of an output by a design variable, exact, where it is largest over the motion."""

    output: str
    variable: str
    value: float
    unit: str
    at: dict[str, float]


class Expectation(_Record):
    """Something that was asked to hold, and the number that decided it."""

    text: str
    met: bool
    value: float | None
    unit: str


class WheelNumber(_Record):
    """A number of a suspension: as drawn, its derivative there, and its range."""

    name: str
    unit: str
    static: float | None
    gradient: float | None
    gradient_unit: str
    smallest: float | None
    largest: float | None


class Wheel(_Record):
    """A suspension over wheel travel or steering, angles in degrees."""

    over: str
    unit: str
    side: str
    axle: str
    numbers: list[WheelNumber]


class Simulated(_Record):
    """A motion under forces: seconds, joules, and how well the constraints are met at the worst time."""

    start: float
    end: float
    asked_end: float
    steps: int
    rejected: int
    energy_start: float | None
    energy_end: float | None
    balance_error: float | None
    violation: float | None


class Design(_Record):
    """A design that a search has found."""

    error: float | None
    defects: list[str]
    variables: dict[str, float]


class Search(_Record):
    """Outcome of a search; `unit` is that of errors."""

    screened: int
    refined: int
    stopped: str
    unit: str
    designs: list[Design]


class Family(_Record):
    """A family of coordinates; null where there is no number, and `note` says why."""

    family: str
    variables: int | None
    equations: int | None
    freedoms: int | None
    condition: float | None
    iterations: int | None
    note: str


class BranchEnds(_Record):
    """A branch of a circuit, in the unit of its input: its ends, and which of them are dead points."""

    circuit: int
    lower: float
    upper: float
    dead: list[bool]
    turns: bool


class Assemblies(_Record):
    """All assemblies: their number at the inputs, or at each of the values of an input, and the branches over them."""

    statement: str
    complete: bool
    count: list[int]
    values: list[float]
    branches: list[BranchEnds]


class File(_Record):
    """A file that was written."""

    path: str
    what: str


class Entry(_Record):
    """A ready mechanism."""

    name: str
    description: str


class Verdict(_Record):
    """Does it assemble, does it move, does it do what was asked, and what is wrong.

    `assembles`, `moves` and `does` are null where nobody looked: where the question could not be read, or what comes
    before has failed. `good` is ``exit == 0``. Angles are in ``angle_unit``, lengths in ``length_unit``.
    """

    schema: Literal["jaxnc.verdict"] = "jaxnc.verdict"
    version: Literal[1] = VERSION
    jaxnc: str = ""
    command: str = ""
    name: str = ""
    exit: int = 0
    good: bool = True
    assembles: bool | None = None
    moves: bool | None = None
    does: bool | None = None
    summary: str = ""
    findings: list[Finding] = []
    length_unit: str = ""
    angle_unit: str = ""
    counts: Counts | None = None
    drivable: list[str] = []
    reach: list[Reach] = []
    drives: list[Drive] = []
    hold: list[str] = []
    poses: Poses | None = None
    extremes: list[Extreme] = []
    sensitivities: list[Derivative] = []
    expectations: list[Expectation] = []
    wheels: list[Wheel] = []
    simulation: Simulated | None = None
    search: Search | None = None
    families: list[Family] = []
    assemblies: Assemblies | None = None
    files: list[File] = []
    library: list[Entry] = []
    origin: dict[str, str] = {}

    @classmethod
    def from_json(cls, text: str | bytes) -> "Verdict":
        """Read a verdict that was printed, strictly: an unknown field or a wrong type is refused.

        Raises:
            msgspec.ValidationError: what the text holds is no verdict of this version.
        """
        return msgspec.json.decode(text, type=cls)

    def add(self, code: Code, level: Literal["error", "warning", "note"], text: str, **more: Any) -> Finding:
        """Add a finding, see `Finding`; returns it."""
        self.findings.append(Finding(code=code, level=level, text=text, **more))
        return self.findings[-1]

    @property
    def errors(self) -> list[Finding]:
        """The findings that make it fail."""
        return [f for f in self.findings if f.level == "error"]

    @property
    def warnings(self) -> list[Finding]:
        """The findings on what is allowed but probably not meant."""
        return [f for f in self.findings if f.level == "warning"]

    def close(self, code: int) -> "Verdict":
        """Fill in what follows from the rest: the exit code, whether all is good, and a sentence; returns itself."""
        self.jaxnc, self.exit, self.good = version(), code, code == 0
        self.summary = self.summary or self._sentence()
        return self

    def _sentence(self) -> str:
        if self.errors:
            return self.errors[0].text
        words = [word for word, holds in (("assembles", self.assembles), ("moves", self.moves)) if holds]
        if self.does:
            words.append("does what was asked")
        about = self.name or "it"
        return f"{about} {', '.join(words[:-1])}{' and ' if words[:-1] else ''}{words[-1]}" if words else ""

    def to_json(self, indent: int = 1) -> str:
        """Write the verdict as JSON that holds to `schema`.

        Args:
            indent: spaces by which levels are set in; 0 for a single line.
        """
        text = msgspec.json.encode(self)  # numbers that are not finite as null
        return (msgspec.json.format(text, indent=indent) if indent else text).decode()


@public
def schema() -> dict[str, object]:
    """Make the JSON Schema (draft 2020-12) of a verdict from the records above."""
    found = msgspec.json.schema(Verdict)
    for part in found.get("$defs", {}).values():
        part["required"] = sorted(part.get("properties", {}), key=list(part.get("properties", {})).index)
        for entry in part.get("properties", {}).values():
            entry.pop("default", None)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"jaxnc verdict {VERSION}", **found}


def number(value: Any) -> float | None:
    """Read a number; None where it is none or not finite."""
    return None if value is None or not math.isfinite(float(value)) else float(value)


def parse_expectation(text: str) -> tuple[str, str, str, float]:
    """Read quantity, word (or ""), comparison and number of an expectation, such as ``"psi range > 30"``."""
    found = _EXPECTATION.fullmatch(text) if isinstance(text, str) else None
    try:
        if found is None:
            raise ValueError
        return found[1], found[2] or "", found[3], float(found[4])
    except ValueError:
        raise InputError(f"--expect {text!r}: {_HELP}") from None
