"""`solve`: screen, refine, look at what came out, rank.

Searches can be stopped: they are saved in a file after every round and taken up again, and interrupted by Ctrl-C.
"""

import contextlib
import functools
import hashlib
import io
import json
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import jax
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import refuse_fork
from jaxnc.errors import InputError, ModelFileError
from jaxnc.kinematics.design import geometry_vector
from jaxnc.pickling import fields_of
from jaxnc.progress import bar
from jaxnc.synthesis.design import Design, describe_nonfinite, is_rounding, judge, largest_error, shortfalls
from jaxnc.synthesis.evaluate import LANES, MEETS, move_designs
from jaxnc.synthesis.problem import Problem, check_problem
from jaxnc.synthesis.pytree import Leaves
from jaxnc.synthesis.result import Progress, Result, format_quantity
from jaxnc.synthesis.search.basins import Basin, as_they_are, bring_to_ends, list_once
from jaxnc.synthesis.search.goal import Goal
from jaxnc.synthesis.search.refine import LEVEL, ROUGH, Refinement
from jaxnc.synthesis.search.screen import initial_guess, reseat_targets, screen
from jaxnc.synthesis.search.sqp import End, Sqp
from jaxnc.synthesis.search.stock import best_sizes, relax
from jaxnc.synthesis.validate import as_seed, as_time_limit, check_counts, check_limit
from jaxnc.types import Array


class SavedSearch:
    """A search's history, the time it has, and the file that it is kept in."""

    def __init__(self, name: str, limit: float, path: str | Path | None):
        self.name, self.limit, self.path = name, limit, path
        self.history: list[Progress] = []
        self.begun = self.kept = time.perf_counter()
        self.terms: dict[str, Any] = {}

    def set_common(self, numbers: object, **settings: object) -> None:
        """Note what this search and one that resumes it must have in common, and see that its file can be written."""
        from jaxnc.io import target

        out = hashlib.sha256()
        _add_to_digest(out, numbers)
        # 3 is the form of the file: another number when its contents change.
        self.terms = {"form": 3, "problem": self.name, **settings, "numbers": out.hexdigest()}
        if self.path is not None:
            if Path(self.path).is_dir():
                raise InputError(f"checkpoint={str(self.path)!r} is a folder; name a file in it")
            target.folder(Path(self.path).parent)

    def resume(self, path: str | Path) -> dict[str, np.ndarray]:
        """Return the state of a search that was saved, which is kept in the same file unless it has another one."""
        from jaxnc.io.target import read_archive

        arrays = read_archive(path, "a file that a search with checkpoint= wrote")
        try:
            begun = json.loads(str(arrays["terms"]))
        except (KeyError, ValueError):
            raise ModelFileError(f"{path} is not a file that a search with checkpoint= wrote; give another") from None
        for name, value in self.terms.items():
            if begun.get(name) == value:
                continue
            if name == "numbers":
                raise InputError(f"{path} is a search for {begun['problem']} with other targets, bounds or conditions")
            raise InputError(f"{path} was begun with {name} = {begun.get(name)}; it cannot go on with {value}")
        self.history = [Progress(float(s), int(n), float(e)) for s, n, e in arrays["history"]]
        spent = self.history[-1].seconds if self.history else 0.0
        self.begun, self.limit = self.begun - spent, self.limit + spent
        self.path = path if self.path is None else self.path
        return arrays

    def save(self, state: Callable[[], dict[str, np.ndarray]], every: float = 0.0) -> None:
        """Write a search between two rounds, if it has a file, unless that was done in the last `every` seconds.

        Its state is everything that decides how it goes on, as arrays by name.
        """
        if self.path is None or time.perf_counter() - self.kept < every:
            return
        from jaxnc.io import target

        out = io.BytesIO()
        rows = np.array([tuple(row) for row in self.history], dtype=float).reshape(-1, 3)
        terms = np.array(json.dumps(self.terms))
        np.savez(out, **state(), history=rows, terms=terms)  # pyright: ignore[reportArgumentType]
        target.write(self.path, out.getvalue())
        self.kept = time.perf_counter()

    @property
    def seconds(self) -> float:
        """How long the search has been going on."""
        return time.perf_counter() - self.begun

    @property
    def hint(self) -> str:
        """How to go on with a search that was stopped, in words; "" if it is not kept in a file."""
        return "" if self.path is None else f"; to go on, resume from {self.path}"


class Course(SavedSearch):
    """The course of a search for designs of a problem: round by round, with a bar."""

    def __init__(self, problem: Problem, limit: float, path: str | Path | None):
        super().__init__(problem.name, limit, path)
        self.problem = problem

    def set_terms(self, **settings: object) -> None:
        """Note what this search and one that resumes it must have in common, all numbers of the problem among it."""
        numbers = np.asarray(geometry_vector(self.problem.system), dtype=float), self.problem
        self.set_common(numbers, unknowns=list(self.problem.names), **settings)

    def show(self, total: int, unit: str, progress: bool | None, done: int) -> None:
        """Show a bar, where someone is watching or as `progress` says."""
        self.bar = bar(total, self.problem.name, unit, progress, initial=done)

    def note(self, done: int, square: float) -> float:
        """Add a line to the history and show it; the error that is reported for the least square so far."""
        error = float(self.problem.reported_error(square))
        self.history.append(Progress(time.perf_counter() - self.begun, done, error))
        self.bar.set_postfix_str(f"best error {format_quantity(error, self.problem.error_unit, 4)}", refresh=False)
        self.bar.update(done - self.bar.n)
        return error

    @property
    def until(self) -> float:
        """When the best designs are no longer brought to their ends, as of `time.perf_counter`."""
        return self.begun + 1.25 * self.limit + 5.0  # more than the search itself has: its last steps gain the most

    @property
    def out_of_time(self) -> str:
        """In words, that the search has had all of its time; "" as long as it has not."""
        seconds = self.history[-1].seconds
        return f"stopped after {seconds:.0f} s" if seconds > self.limit else ""


def _add_to_digest(out: Any, value: object) -> None:
    """Add numbers and names, also inside tuples and records; functions and systems do not count."""
    if isinstance(value, np.ndarray):
        out.update(np.asarray(value, dtype=float).tobytes())
    elif value is None or isinstance(value, (str, int, float)):
        out.update(repr(value).encode())
    elif isinstance(value, tuple):
        for one in value:
            _add_to_digest(out, one)
    elif isinstance(value, Leaves):
        out.update(type(value).__name__.encode())
        for part in fields_of(value).values():
            _add_to_digest(out, part)


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Within it an interruption ends in a `KeyboardInterrupt`.

    JAX makes another error of one that comes while it compares or traces what Python tells it, and none of one that
    comes while it collects garbage: that one is raised at the end. One that comes while it notes what it traces can
    leave a note of its caches open, at which every later call stops ("Recursively calling ..."): they are emptied.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    seen = traced = False

    def handle(number: int, frame: FrameType | None) -> None:
        nonlocal seen, traced
        seen, traced = True, traced or _in_jax(frame)
        before(number, frame)

    signal.signal(signal.SIGINT, handle)
    try:
        yield
    except Exception:
        if seen:
            raise KeyboardInterrupt from None
        raise
    else:
        if seen:
            raise KeyboardInterrupt
    finally:
        signal.signal(signal.SIGINT, before)
        if traced:
            jax.clear_caches()


def _in_jax(frame: Any) -> bool:
    """Tell whether a frame of JAX's own Python is at work."""
    while frame is not None:
        if frame.f_globals.get("__name__", "").partition(".")[0] == "jax":
            return True
        frame = frame.f_back
    return False


# -- the search --------------------------------------------------------------------------------------------------------


_INTERRUPTED = "interrupted"


@public
def solve(
    problem: Problem,
    starts: int = 20_000,
    refine: int = 192,
    iterations: int = 400,
    keep: int = 10,
    key: Array | None = None,
    enough: float = 0.0,
    seconds: float | None = None,
    progress: bool | None = None,
    checkpoint: str | Path | None = None,
    resume: str | Path | None = None,
) -> Result:
    """Search for the best designs of a problem.

    Random starts are screened, all at once; the most promising are refined by constrained least squares with exact
    derivatives; what comes out is moved through its targets and its range by the robust solver, and ranked. Starts that
    do not assemble cost next to nothing.

    Args:
        problem: what is wanted.
        starts: random designs to screen; the idea itself is always among them.
        refine: how many are refined.
        iterations: the most of each refinement.
        keep: designs in the result.
        key: of the random numbers (``jax.random.key(0)`` if not given): the same key, the same result.
        enough: stop as soon as a design with this error is found.
        seconds: refine for so long. What is best then is brought to its end in a quarter more and five seconds, but
            for what is compiled on the way.
        progress: show a bar with the best error so far; if not given, where stderr is a terminal, and in a notebook.
        checkpoint: file in which the search is kept after every round, replaced in one step.
        resume: such a file, from which the search goes on (and in which it is kept, unless `checkpoint` names another
            one). The problem, `starts`, `refine`, `iterations` and `key` must be those it was begun with; the result
            is then that of a search that was never stopped.

    Returns:
        The designs, best first; see `Result`. Ctrl-C returns the best ones so far, as they are then.

    Raises:
        InputError: settings that are no counts, times or keys, a free variable that does not influence anything,
            conditions that are not finite, or a file of another search.
        ModelFileError: a file that holds no search.
    """
    refuse_fork()
    check_problem("solve", problem)
    check_counts("solve", starts=starts, refine=refine, iterations=iterations, keep=keep)
    check_limit("solve", "an error to stop at, 0 or a positive number", enough=enough)
    course = Course(problem, as_time_limit("solve", seconds), checkpoint)
    try:
        with interruptible():
            seed = as_seed("solve", key)  # which compiles
            course.set_terms(starts=starts, refine=refine, iterations=iterations, key=seed)
            goal, free = Goal.of(problem), relax(problem)
            # by 100 iterations a start has come near an end, if it ever does
            run = Refinement(goal, min(iterations, 100), refine, ROUGH)
            if resume is None:
                run.queue = starting_rows(free, run, starts, refine, np.random.default_rng(seed))
            else:
                run.restore(course.resume(resume))
            if course.path is not None and run.more():  # what was screened is kept before the first round is over
                course.save(run.to_arrays)
    except KeyboardInterrupt:
        return Result(problem, (), (), 0, 0, 0, None, f"{_INTERRUPTED} before the first designs were refined")
    # mean square of the divided errors: what is left is rounding, or that of the targets
    exactly = 1e-18 * run.shape[0]
    total = run.done + int(run.live.sum()) + len(run.queue)
    best, stopped = run.best, ""
    course.show(total, "design", progress, run.done)
    ended = 2  # times as many as are kept are brought to their ends
    try:
        with interruptible():
            while run.more():
                run.go(best)
                best = min(best, run.best)
                error = course.note(run.done, best)
                course.save(run.to_arrays)
                stopped = course.out_of_time
                if not stopped and error <= enough:
                    stopped = f"stopped at enough={enough:g}" if run.busy else ""
                exact = sum(square <= exactly for square, _ in run.found)
                # after 48 starts with such errors no others are refined
                if not stopped and run.busy and exact >= max(48, ended * keep):
                    stopped = f"stopped when {exact} starts had led to errors of 1e-9 of the size and less,"
                if stopped:
                    break
    except KeyboardInterrupt:
        stopped = _INTERRUPTED
    course.bar.close()
    finished, under_way = run.done, int(run.live.sum())
    if stopped and run.busy:
        stopped += f" with {finished} of {total} designs refined"
        stopped += f" and {under_way} on the way" if under_way else ""
        stopped += course.hint
    run.stop()
    found, loose = [x for _, x in sorted(run.found, key=lambda pair: pair[0])], []
    basins = as_they_are(problem, found, keep) if stopped.startswith(_INTERRUPTED) else None
    end = functools.partial(
        bring_to_ends, most=ended * keep, iterations=iterations, width=run.width, until=course.until
    )
    try:
        with interruptible():
            if goal.stocks and found and basins is None:
                still = {"still": LEVEL} if problem.minimax else {}
                loose = _end_seated(free, goal, found, end)
                begin = functools.partial(Refinement, goal, iterations, refine, **still)
                found = [x for _, x in best_sizes(goal, [v.end.row for v in loose], begin)]
            if basins is None:
                basins = _end_seated(problem, goal, found, end)
                again = functools.partial(Sqp(goal, run.width, course.until).run, most=iterations)
                first = max(keep, sum(_exact(problem, basin) for basin in basins))  # exact ones have no order yet
                basins = [*_tighten_margins(problem, goal, basins[:first], again), *basins[first:]]
    except KeyboardInterrupt:
        stopped = f"{_INTERRUPTED} while the best designs were brought to their ends"
        basins = as_they_are(problem, found, keep) if basins is None else basins
    try:
        with interruptible():
            designs = designs_to_show(problem, basins, keep)
            if not goal.stocks and not stopped.startswith(_INTERRUPTED):
                designs = list_once(problem, designs)
    except KeyboardInterrupt:  # what was found is told all the same
        stopped, designs = f"{_INTERRUPTED} while designs were judged", judge(problem, basins[:keep])
    return Result(
        problem=problem,
        designs=tuple(designs[:keep]),
        history=tuple(course.history),
        refined=finished,
        screened=starts,
        unfit=run.unfit,
        broken=run.broken,
        nearest=run.nearest and (run.nearest[0], run.nearest[1][: problem.count]),
        stopped=stopped,
        relaxed=judge(free, loose[:1])[0] if loose else None,
    )


def designs_to_show(problem: Problem, basins: Sequence[Basin], keep: int) -> list[Design]:
    """Judge designs until enough are without defects, best first.

    Those behind as many without defects as are kept are not looked at, but for exact ones, whose order is rounding.
    """
    designs: list[Design] = []
    for basin in basins:
        if sum(not design.defects for design in designs) < keep or _exact(problem, basin):
            designs += judge(problem, [basin])
    return sorted(designs, key=lambda design: design.rank)


def _exact(problem: Problem, basin: Basin) -> bool:
    return is_rounding(problem, problem.size * np.sqrt(basin.end.square / problem.shape[0]))


def starting_rows(
    problem: Problem,
    run: Refinement,
    starts: int,
    refine: int,
    rng: np.random.Generator,
) -> list[np.ndarray]:
    """Screen random starts for the most promising; the idea itself comes first if it reaches its targets."""
    # 4 times as many as are refined are looked at with their conditions
    x, run.unfit = screen(problem, rng, starts, 4 * refine)
    own = initial_guess(problem, rng)
    bounded = np.clip(np.concatenate([own, x]), problem.low, problem.high)
    bounded = np.stack(reseat_targets(problem, list(bounded)))
    behind = run.goal.row[problem.count :]
    bounded = np.concatenate([bounded, np.broadcast_to(behind, (len(bounded), len(behind)))], axis=1)
    likely = bounded[:1]
    if len(own) > 1:
        rows, merit = run.merits(bounded[: len(own)])
        likely = rows[np.argsort(merit, kind="stable")[:8]]  # 8 at most
    bounded = np.concatenate([run.suit(likely, len(problem.variables.names)), bounded])
    bounded, merit = run.merits(bounded)
    idle = [name for name in run.idle if name in problem.variables.names]
    if problem.variables.chosen and idle:
        given = [name for name in problem.system.topology.dimensions if name not in problem.variables.names]
        raise InputError(
            f"{problem.name}: {', '.join(idle)} {'has' if len(idle) == 1 else 'have'} no influence on the "
            f"errors or the conditions; leave {'it' if len(idle) == 1 else 'them'} out of free="
            + f", and name dimensions that are given, such as {', '.join(given[:4])}"
            * bool(given)
        )
    if run.spoilt is not None and not np.isfinite(merit).any():
        raise InputError(
            f"{problem.name}: every random design that reaches its targets has "
            f"{describe_nonfinite(problem, run.spoilt)} that are not finite; keep divisions, roots and logarithms of "
            f"your own functions away from where they, or their derivatives, are not defined"
        )
    order = np.argsort(merit, kind="stable")
    first = int(np.argmin(merit[: len(bounded) - len(x)]))  # the idea
    order = np.append(first, order[order != first]) if np.isfinite(merit[first]) else order
    return list(bounded[order[np.isfinite(merit[order])]][:refine])


def _end_seated(problem: Problem, goal: Goal, found: list[np.ndarray], end: Callable[..., list[Basin]]) -> list[Basin]:
    """Bring designs to their ends, again where a target without order has come nearer to another part of the curve."""
    basins: list[Basin] = []
    rows = reseat_targets(problem, _begin_levelling(problem, goal, found))
    for _ in range(8):  # designs are brought to their ends 8 times, at most
        basins = end(problem, goal, rows)
        old = [basin.end.row for basin in basins]
        rows = reseat_targets(problem, old)
        if all(np.array_equal(a, b) for a, b in zip(old, rows, strict=True)):
            break
    return basins


def _tighten_margins(
    problem: Problem, goal: Goal, best: Sequence[Basin], refine: Callable[[list[np.ndarray]], list[End]]
) -> list[Basin]:
    """Refine designs again with a margin where they miss a condition between the poses that were looked at.

    A search looks at fewer poses of the range than the judge. Between its poses it misses a little of a condition that
    it just meets. What a design misses there is added to the margin that the search keeps from then on.
    """
    looked_at = [id(goal.problem.conditions[i]) for i, *_ in goal.margins]
    left, done = list(best), []
    for _ in range(6 if looked_at else 0):  # rounds of refining again with margins
        short = []
        for basin in left:
            far = shortfalls(problem, basin.one)
            if not far:
                done.append(basin)
                continue
            new = basin.end.row.copy()
            # 1.02 times what was missed, as the gap between two poses changes with the design, and 1e-9 to be met
            new[goal.margin_places] += [1.02 * far[key] + 1e-9 if key in far else 0.0 for key in looked_at]
            short.append((basin, new))
        if not short:
            return done
        ends, left = refine([row for _, row in short]), []
        moves = move_designs(problem, [end.row[: problem.count] for end in ends])
        for (basin, _), end, one in zip(short, ends, moves, strict=True):
            if end.feasibility <= MEETS:
                left.append(basin._replace(one=one, end=end))
            else:
                done.append(basin)
    return done + left


def _begin_levelling(problem: Problem, goal: Goal, found: list[np.ndarray]) -> list[np.ndarray]:
    """Turn from least squares to the least largest error, where that is wanted."""
    if not (problem.minimax and found):
        return found
    out = [x.copy() for x in found[:LANES]]
    heights = [largest_error(problem, one) for one in move_designs(problem, [x[: problem.count] for x in out])]
    for row, height in zip(out, heights, strict=True):
        row[goal.count - 1], row[-1] = height / problem.size, 1.0
    return [row for _, row in sorted(zip(heights, out, strict=True), key=lambda pair: pair[0])]
