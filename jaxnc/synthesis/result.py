"""Results of searches: ranked designs with their practical quality; printed, drawn, saved and read back."""

import dataclasses
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, ModelFileError, counted
from jaxnc.kinematics.motion import Motion
from jaxnc.notebooks import Shown, align_columns
from jaxnc.pickling import fields_of
from jaxnc.synthesis.design import BLUNT, NAMED, Design, judge, to_mechanism, worst_conditions
from jaxnc.synthesis.evaluate import MovedDesign, move_designs
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.search.basins import Basin
from jaxnc.synthesis.search.sqp import End
from jaxnc.synthesis.search.stock import relax
from jaxnc.system.system import System

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

_CONTINUUM = (
    "the best found of a continuum of exact designs, which is listed once: it can change in {} and still meet the "
    "targets; more targets, conditions or bounds narrow it down"
)


@public
class Progress(NamedTuple):
    """A line of the history: seconds, designs looked at, best error so far."""

    seconds: float
    designs: int
    error: float


@public
@dataclasses.dataclass(frozen=True, eq=False)
class Steps:
    """The history of a descent; what a design has not done, because it had come to its end, is NaN.

    Attributes:
        value: what was made small, in the unit of the error, ``(steps, lanes)``: of a problem with batches, or drawn
            anew at every step, one sample of it.
        gradient: norm of what bounds leave of the gradient, by unknowns in their scales, ``(steps, lanes)``.
        violation: largest violation of a condition, in parts of the problem's size, ``(steps, lanes)``.
        good: whether the design that was tried assembles and is finite, ``(steps, lanes)``; if not, it was taken back.
        seconds: after each step, ``(steps,)``.
        random: whether values are samples.
    """

    value: np.ndarray
    gradient: np.ndarray
    violation: np.ndarray
    good: np.ndarray
    seconds: np.ndarray
    random: bool

    @property
    def count(self) -> int:
        """How many steps there were."""
        return len(self.seconds)

    def plot(self, path: str | Path | None = None, unit: str = "") -> "Figure":
        """Draw value and gradient of all designs, step by step, on logarithmic axes; see `jaxnc.viz.synthesis`."""
        from jaxnc.viz import synthesis

        return synthesis.steps(self, path, unit)


@public
@dataclasses.dataclass(frozen=True, eq=False)
class Result(Shown):
    """Designs that a search has found; ``print()`` shows the ranked table.

    Attributes:
        problem: what was wanted.
        designs: best first, those with defects last.
        history: seconds, designs finished and best error, round by round.
        refined: how many starts were refined to their ends.
        screened: how many were screened.
        unfit: how many of these could not be moved through their targets, or the range; 0 where that is not known.
        broken: gradients that were not finite although the design assembled (none should be).
        nearest: how far the closest design is from meeting the conditions, and its unknowns.
        stopped: if the search was stopped before its end, how, in words.
        relaxed: where dimensions come in sizes, the best design without regard to them.
        steps: of `descend`, value and gradient of every design after every step.
    """

    problem: Problem
    designs: tuple[Design, ...]
    history: tuple[Progress, ...]
    refined: int
    screened: int
    broken: int
    nearest: tuple[float, np.ndarray] | None
    stopped: str = ""
    unfit: int = 0
    relaxed: Design | None = None
    steps: Steps | None = None

    @property
    def found(self) -> bool:
        """True if a design meets all conditions and reaches all targets."""
        return bool(self.designs) and not self.designs[0].defects

    @property
    def interrupted(self) -> bool:
        """True if the search was interrupted, by Ctrl-C."""
        return self.stopped.startswith("interrupted")

    @property
    def best(self) -> System:
        """The best design, a `System`."""
        return self._first.system

    @property
    def error(self) -> float:
        """Its error."""
        return self._first.error

    @property
    def _first(self) -> Design:
        if not self.designs:
            raise InputError(self.verdict)
        return self.designs[0]

    def motion(self, number: int = 0) -> Motion:
        """The motion of a design through its targets."""
        return self.designs[number].motion

    @property
    def verdict(self) -> str:
        """In a sentence, what was found or why nothing was."""
        if self.found:
            d = self.designs[0]
            unit, weighted = self.problem.unit, "weighted; " if self.problem.weighted else ""
            if d.exact:
                return f"the best design is exact (largest error {format_quantity(d.largest, unit)}, which is rounding)"
            words = f"best error {format_quantity(d.error, self.problem.error_unit, 6)}"
            if self.problem.at_rest:
                return words
            words += f" ({weighted}largest {format_quantity(d.largest, unit)}, rms {format_quantity(d.rms, unit)})"
            return words + self._describe_miss(d)
        if self.designs:
            words = f"no design without defects: the best one {', '.join(self.designs[0].defects)}"
            if any(defect.startswith(BLUNT) for defect in self.designs[0].defects):
                words += "; the condition transmission_angle(min) makes a search keep above an angle, min=0 accepts any"
            return words
        if self.stopped:
            return "nothing was found yet that reaches all targets and meets the conditions; let the search go on"
        if not self.refined:
            return (
                f"none of {self.screened} random designs reaches all targets: widen the bounds, give a better idea, "
                f"or a range of the input that the mechanism has"
            )
        if self.nearest is not None:
            worst = worst_conditions(self.problem, self.nearest[1])
            worst = worst or (
                f"one of them by {self.nearest[0]:.2g} (of the size; of angles the sine) at the {self.problem.poses} "
                f"poses that a search looks at"
            )
            more = "more starts or iterations are needed"
            if self.nearest[0] > 1e-3:  # a design that comes so near does not come up against a contradiction
                more = f"They contradict each other or the bounds, or {more}"
            return f"no design meets the conditions; the closest one misses {worst}. {more[0].upper()}{more[1:]}"
        return "no design reaches all targets; more starts, wider bounds or another mechanism are needed"

    def _describe_miss(self, best: Design) -> str:
        """Of a target that is not met: by how much, and what may stand in the way."""
        size = self.problem.size
        # an error of more than 0.01 of the target's extent is no fit
        if not hasattr(self.problem, "target") or best.rms <= 0.01 * size:
            return ""
        words = f"; the targets are not met, by up to {100 * best.largest / size:.3g} % of their extent: "
        if best.binding:
            more = f" and {len(best.binding) - NAMED} more" if len(best.binding) > NAMED else ""
            return words + f"what holds the best design back is {', '.join(best.binding[:NAMED])}{more}"
        return words + (
            "no condition and no bound holds the best design back, so that a mechanism of this kind comes no closer, "
            "unless more starts or other free variables find one"
        )

    @property
    def price(self) -> str:
        """A sentence that says what sizes of dimensions cost; "" where any size is allowed."""
        if self.relaxed is None or not self.found:
            return ""
        before, after = self.relaxed.error, self.designs[0].error
        words = f"with dimensions of any size the best error found is {before:.4g}; those that there are cost "
        if after <= before * (1 + 1e-6) + 1e-20:
            return words + "nothing"
        return words + (
            f"{after - before:.3g} (a factor of {after / before:.3g})" if before > 1e-20 else f"{after:.3g}"
        )

    def rows(self) -> list[tuple[str, ...]]:
        """The designs as rows of words, under what their columns are called."""
        unit, square = (f" [{u}]" if u else "" for u in (self.problem.unit, self.problem.error_unit))
        head = (
            "",
            f"error{square}",
            f"largest{unit}",
            f"rms{unit}",
            "type",
            "transmission",
            "size",
            "starts",
            "end",
            "defects",
        )
        rows: list[tuple[str, ...]] = [head]
        for k, d in enumerate(self.designs):
            rows.append(
                (
                    str(k + 1),
                    "exact" if d.exact else f"{d.error:.4g}",
                    *("exact" if d.exact else "-" if np.isnan(e) else f"{e:.3g}" for e in (d.largest, d.rms)),
                    *d.shape_words,
                    str(d.starts),
                    d.ending,
                    "; ".join(d.defects) or "none",
                )
            )
        return rows

    def table(self) -> str:
        """The designs as a table, one line each, and under it the lengths of their links."""
        rows = self.rows()
        names = list(self.designs[0].lengths) if self.designs else []
        if not names:
            return "\n".join(align_columns(rows))
        most = 12  # lengths that a table shows
        shown, more = names[:most], f" (the first {most} of {len(names)})" if len(names) > most else ""
        sides = [("", *shown)]
        sides += [(str(k + 1), *(f"{d.lengths[n]:.5g}" for n in shown)) for k, d in enumerate(self.designs)]
        between = f"lengths [{self.problem.system.topology.length_unit}]{more}"
        return "\n".join([*align_columns(rows), between, *align_columns(sides)])

    @property
    def sentences(self) -> list[str]:
        """The result in sentences, a line each."""
        counts = f"{counted(self.screened, 'design')} screened, {self.refined} refined"
        if self.broken:
            counts += f", {self.broken} gradients not finite and left out"
        lines = [f"{self.problem.name}: {self.verdict} ({counts})"]
        lines += [f"the search was {self.stopped}"] if self.stopped else []
        if 2 * self.unfit > self.screened:
            lines.append(f"{self.unfit} of the {self.screened} designs do not move through their targets")
        for freedom in sorted({d.freedom for d in self.designs} - {0}):
            numbers = [str(k + 1) for k, d in enumerate(self.designs) if d.freedom == freedom]
            some = f"designs {', '.join(numbers)} are each" if len(numbers) > 1 else f"design {numbers[0]} is"
            lines.append(f"{some} {_CONTINUUM.format(counted(freedom, 'direction'))}")
        return lines + ([self.price] if self.price else [])

    def __repr__(self) -> str:
        return "\n".join([*self.sentences, self.table()] if self.designs else self.sentences)

    # -- looking and keeping ---------------------------------------------------------------------------------------

    def gallery(self, path: str | Path | None = None, most: int = 6) -> "Figure":
        """Draw the best designs, each with its path and the target; see `jaxnc.viz.synthesis`."""
        from jaxnc.viz import synthesis

        return synthesis.gallery(self, path, most)

    def convergence(self, path: str | Path | None = None) -> "Figure":
        """Draw the best error round by round, of a descent every design step by step; see `jaxnc.viz.synthesis`."""
        from jaxnc.viz import synthesis

        if self.steps is not None:
            return self.steps.plot(path, self.problem.error_unit)
        return synthesis.convergence(self, path)

    def to_frame(self) -> "pandas.DataFrame":
        """A pandas data frame, one row a design; see `jaxnc.io.tables.designs_to_frame`."""
        from jaxnc.io import tables

        return tables.designs_to_frame(self)

    def save(self, folder: str | Path) -> Path:
        """Write a folder with the table, the numbers (``result.npz``) and a model file of each design.

        Model files are written where the problem was given a `Mechanism`. `load` reads the folder back.
        """
        meta = {"screened": self.screened, "refined": self.refined, "broken": self.broken, "unfit": self.unfit}
        history = np.array([tuple(h) for h in self.history], dtype=float).reshape(-1, 3)
        arrays = {} if self.steps is None else {f"steps.{k}": v for k, v in fields_of(self.steps).items()}
        if self.nearest is not None:
            arrays["nearest"] = np.append(self.nearest[1], self.nearest[0])
        if self.relaxed is not None:
            arrays |= {"relaxed": self.relaxed.x, "relaxed end": np.array(_end_numbers(self.relaxed))}
        meta |= {"stopped": self.stopped}
        return write_designs(folder, self.problem, self.designs, f"{self}\n", meta, {"history": history, **arrays})


def format_quantity(value: float, unit: str, digits: int = 3) -> str:
    """A number with its unit, if it has one."""
    return f"{value:.{digits}g} {unit}".rstrip()


def _end_numbers(design: Design) -> tuple[float, ...]:
    """List how a search ended in a design, as it is written."""
    return design.optimality, design.error, design.feasibility, design.iterations, design.starts


def _to_basin(one: MovedDesign, end: np.ndarray, reason: str) -> Basin:
    return Basin(one, End(one.x, end[1], end[0], np.nan, end[2], int(end[3]), reason), int(end[4]))


def write_designs(
    folder: str | Path,
    problem: Problem,
    designs: Sequence[Design],
    table: str,
    meta: Mapping[str, Any],
    arrays: Mapping[str, np.ndarray],
) -> Path:
    """Write a folder of designs: a table, ``result.npz`` with arrays and meta data beside theirs, and model files.

    Model files of an earlier result in the folder are replaced, or removed where there are fewer now.
    """
    from jaxnc.io import target

    folder = target.folder(folder)
    x = np.stack([d.x for d in designs]) if designs else np.zeros((0, problem.count))
    ends = np.reshape([_end_numbers(d) for d in designs], (-1, 5))
    each = {"reasons": "reason", "freedoms": "freedom", "errors": "error"}
    told = json.dumps(
        {**meta, "names": problem.names, **{name: [getattr(d, of) for d in designs] for name, of in each.items()}}
    )
    more: Any = arrays
    earlier = (folder / "result.npz").exists()
    with target.replacing(folder / "result.npz") as new:
        np.savez(new, x=x, ends=ends, meta=np.array(told), **more)
    target.write(folder / "designs.txt", table.encode())
    models = (folder / f"design_{k}.toml" for k in itertools.count(1))
    if problem.mechanism is not None:
        for d in designs:
            to_mechanism(problem.mechanism, d.system).save(next(models))
    if earlier:
        target.remove_rest(models)
    return folder


def read_designs(
    folder: str | Path, problem: Problem, writer: str, *names: str
) -> tuple[list[Design], dict[str, Any], dict[str, np.ndarray]]:
    """Read what `write_designs` wrote for a writer: designs, each judged again, meta data and arrays.

    Of these the writer needs some by name.

    Raises:
        InputError: there is nothing of the kind, or it belongs to a problem with other unknowns.
        ModelFileError: it is damaged, or another one's.
    """
    path = Path(folder) / "result.npz"
    if not path.exists():
        raise InputError(f"{folder} holds no result of a search: there is no {path.name} in it")
    from jaxnc.io.target import read_archive

    arrays = read_archive(path, f"a file that {writer} wrote")
    try:
        x, ends, meta = arrays["x"], arrays["ends"], json.loads(str(arrays["meta"]))
        wanted, reasons, freedoms, errors = (meta[name] for name in ("names", "reasons", "freedoms", "errors"))
        missing = [name for name in names if name not in arrays and name not in meta]
    except (KeyError, ValueError, TypeError):
        missing = ["meta"]
    if missing:
        raise ModelFileError(
            f"{path} is not a file that {writer} wrote. A result is read by load(), a front by Front.load(); if it is "
            f"damaged, save it again"
        )
    if tuple(wanted) != problem.names:
        raise InputError(f"{path} belongs to a problem with other unknowns: {', '.join(wanted[:8])}, …")
    moved = zip(move_designs(problem, list(x)), ends, reasons, strict=True)
    basins = [_to_basin(one, end, str(reason)) for one, end, reason in moved]
    judged, anew = zip(judge(problem, basins, ranked=False), freedoms, errors, strict=True), []
    for design, freedom, error in judged:
        same = design.exact or math.isclose(design.error, error, rel_tol=1e-6)
        other = {"converged": False, "reason": "refined for other targets"}
        anew.append(dataclasses.replace(design, **{"freedom": int(freedom)} if same else other))
    return anew, meta, arrays


@public
def load(folder: str | Path, problem: Problem) -> Result:
    """Read what `Result.save` wrote; every design is judged again, also by a problem with other targets.

    Raises:
        InputError: there is no such result, or it belongs to a problem with other unknowns.
        ModelFileError: it is damaged.
    """
    counts = ("screened", "refined", "broken", "unfit")
    designs, meta, arrays = read_designs(folder, problem, "Result.save", "history", *counts)
    rows = tuple(Progress(float(s), int(n), float(e)) for s, n, e in arrays["history"])
    known: Any = {name.removeprefix("steps."): a for name, a in arrays.items() if name.startswith("steps.")}
    steps = Steps(**known | {"random": bool(known["random"])}) if known else None
    designs.sort(key=lambda design: design.rank)
    screened, refined, broken, unfit = (int(meta[name]) for name in counts)
    near, relaxed = arrays.get("nearest"), None
    if "relaxed" in arrays:
        free = relax(problem)
        (one,) = move_designs(free, [arrays["relaxed"]])
        (relaxed,) = judge(free, [_to_basin(one, arrays["relaxed end"], "")])
    return Result(
        problem=problem,
        designs=tuple(designs),
        history=rows,
        refined=refined,
        screened=screened,
        broken=broken,
        unfit=unfit,
        nearest=None if near is None else (float(near[-1]), near[:-1]),
        stopped=str(meta.get("stopped", "")),
        relaxed=relaxed,
        steps=steps,
    )
