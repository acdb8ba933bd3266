"""Several objectives: the designs of which none is better in everything, as a front.

The first objective is made small with bounds on the others, at many bounds at once (the ε-constraint method): that
finds the parts of a front that no weighted sum finds, and keeps the least-squares form. The ends are those of each
objective by itself. Y. Haimes, L. Lasdon, D. Wismer, IEEE Trans. Syst. Man Cybern. 1 (1971) 296-297.
"""

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, counted
from jaxnc.kinematics.motion import Motion
from jaxnc.notebooks import Shown, align_columns
from jaxnc.synthesis.design import Design, judge
from jaxnc.synthesis.evaluate import move_designs
from jaxnc.synthesis.objective import Objective
from jaxnc.synthesis.problem import Problem, check_problem
from jaxnc.synthesis.result import read_designs, write_designs
from jaxnc.synthesis.search.basins import Basin
from jaxnc.synthesis.search.goal import OPEN, Goal
from jaxnc.synthesis.search.refine import Refinement
from jaxnc.synthesis.search.solve import interruptible, starting_rows
from jaxnc.synthesis.search.sqp import MEETS, End, Sqp
from jaxnc.synthesis.search.stock import Stock
from jaxnc.synthesis.validate import as_seed, check_counts
from jaxnc.types import Array, ArrayLike

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TOLD = ("refined", "screened", "dominated", "defective", "stopped")  # of a front, beside its designs
_POINT = 1e-6  # a front that is narrower than this part of its values is one point


@public
@dataclasses.dataclass(frozen=True, eq=False)
class Front(Shown):
    """Designs of which none is better than another one in every objective; ``print()`` shows the table.

    Attributes:
        problem: what was wanted.
        names: of the objectives.
        values: roots of the sums of squares of the objectives' residuals, in their units, without the weights of an
            `Objective` of several functions, ``(designs, k)``.
        designs: in the order of the first objective.
        refined: how many starts were refined.
        screened: how many were screened.
        dominated: how many designs were left out because another one is as good in everything.
        defective: how many were left out because of defects.
        stopped: if the search was stopped before its end, how, in words.
        lost: objectives whose best design is one of the defective ones, each with its defects, in words.
    """

    problem: Problem
    names: tuple[str, ...]
    values: np.ndarray
    designs: tuple[Design, ...]
    refined: int
    screened: int
    dominated: int
    defective: int
    stopped: str = ""
    lost: tuple[str, ...] = ()

    @property
    def knee(self) -> int:
        """Number of the design at the bend: the least sum of the objectives, each in parts of its range."""
        low, high = self.values.min(axis=0), self.values.max(axis=0)
        return int(np.argmin(((self.values - low) / np.maximum(high - low, 1e-300)).sum(axis=1)))

    @property
    def verdict(self) -> str:
        """The front in a sentence."""
        if not self.designs and self.defective:
            return f"no design without defects; {self.defective} with"
        if not self.designs:
            return "no design reaches all targets and meets the conditions"
        at = ", ".join(f"{n} {v:.4g}" for n, v in zip(self.names, self.values[self.knee], strict=True))
        if len(self.designs) == 1:
            return (
                f"the front is one point ({at}): the objectives do not contradict each other, one design is best in all"
            )
        low, high = self.values.min(axis=0), self.values.max(axis=0)
        idle = [n for n, a, b in zip(self.names, low, high, strict=True) if b - a <= _POINT * abs(b)]
        more = f"; {', '.join(idle)} is as good in all of them" if idle else ""
        return f"{counted(len(self.designs), 'design')}, the one at the bend has {at}{more}"

    def rows(self) -> list[tuple[str, ...]]:
        """The designs as rows of words, under what their columns are called."""
        rows = [("", *self.names, "type", "transmission", "size", "end", "defects")]
        for k, (d, v) in enumerate(zip(self.designs, self.values, strict=True)):
            values = [f"{o:.4g}" for o in v]
            if d.exact and self.names[0] == "error":
                values[0] = "exact"
            rows.append((str(k + 1), *values, *d.shape_words, d.ending, "; ".join(d.defects) or "none"))
        return rows

    def table(self) -> str:
        """The designs as a table, one line each."""
        return "\n".join(align_columns(self.rows()))

    @property
    def sentences(self) -> list[str]:
        """The front in sentences, a line each."""
        counts = f"{counted(self.screened, 'design')} screened, {self.refined} refined"
        counts += f", {self.defective} left out for their defects" if self.defective else ""
        lines = [f"{self.problem.name}, {' against '.join(self.names)}: {self.verdict} ({counts})"]
        lines += [
            f"left out is the best in {end}: with a condition against that, such as crank_turns() or "
            f"transmission_angle(min), the search looks for the end that meets it"
            for end in self.lost
        ]
        return lines + ([f"the search was {self.stopped}"] if self.stopped else [])

    def __repr__(self) -> str:
        return "\n".join([*self.sentences, self.table()] if self.designs else self.sentences)

    def plot(self, path: str | Path | None = None) -> "Figure":
        """Draw the front, and the designs at its ends and its bend; see `jaxnc.viz.synthesis`."""
        from jaxnc.viz import synthesis

        return synthesis.front(self, path)

    def save(self, folder: str | Path) -> Path:
        """Write a folder with the table, the numbers and a model file of each design; `load` reads it back."""
        meta = {"objectives": self.names} | {name: getattr(self, name) for name in (*_TOLD, "lost")}
        return write_designs(folder, self.problem, self.designs, f"{self}\n", meta, {"values": self.values})

    @classmethod
    def load(cls, folder: str | Path, problem: Problem) -> "Front":
        """Read what `save` wrote, of the same problem; every design is judged again.

        Raises:
            InputError: there is no front, or it belongs to a problem with other unknowns.
            ModelFileError: it is damaged, or the result of a search for one objective.
        """
        designs, meta, arrays = read_designs(folder, problem, "Front.save", "values", "objectives", *_TOLD)
        told = {name: meta[name] for name in _TOLD}
        lost = tuple(meta.get("lost", ()))
        return cls(problem, tuple(meta["objectives"]), arrays["values"], tuple(designs), **told, lost=lost)


@public
def pareto(
    problem: Problem,
    others: Mapping[str, Callable[[Motion], ArrayLike]] | None = None,
    points: int = 16,
    starts: int = 2000,
    refine: int = 48,
    iterations: int = 200,
    key: Array | None = None,
    names: Sequence[str] | None = None,
) -> Front:
    """Search for the designs of which none is better than another one in every objective.

    Args:
        problem: what is wanted; its error is the first objective. Of an `Objective` of several functions each is one.
        others: further objectives by name: functions of the motion through the targets that return a number or an
            array; the sum of its squares is to be small.
        points: of the front, about.
        starts: random designs to screen.
        refine: how many are refined towards each end of the front.
        iterations: the most of each refinement.
        key: of the random numbers.
        names: of the objectives of an `Objective` of several functions.

    Returns:
        The front, see `Front`; each design is brought to its end by steps of second order. Ctrl-C returns the designs
        found so far, as they are then.

    Raises:
        InputError: fewer than two objectives or three points, an objective that is not finite, a problem of the largest
            error or with sizes of a stock.
    """
    check_problem("pareto", problem)
    check_counts("pareto", points=points, starts=starts, refine=refine, iterations=iterations)
    if points < 3:
        raise InputError(f"pareto: points={points!r}; a front needs at least 3")
    if others is not None and not isinstance(others, Mapping):
        raise InputError(f"pareto: others= takes functions of a motion by name, {{'name': function}}, got {others!r}")
    if problem.minimax:
        raise InputError("pareto: a front is one of sums of squares; state the problem without minimax=True")
    if any(isinstance(c, Stock) for c in problem.conditions):
        raise InputError("pareto: a front has no stock sizes; bound the length instead, and solve() for sizes")
    several = isinstance(problem, Objective) and len(problem.residuals) > 1
    if several == bool(others):
        raise InputError(
            "pareto: give an Objective of several functions, or another problem and others={name: function of a motion}"
        )
    goal = Goal.several(problem, tuple((others or {}).values()))
    k = len(goal.objectives)
    labels = tuple(others or names or (f"objective {i + 1}" for i in range(k)))
    labels = ("error", *labels) if others else labels
    if len(labels) != k:
        raise InputError(f"pareto: {len(labels)} names for {k} objectives")
    first = goal.values(problem.start)
    if not np.isfinite(first).all():
        raise InputError(f"pareto: {labels[int(np.argmin(np.isfinite(first)))]} of the starting idea is not finite")
    seed = as_seed("pareto", key)
    search = _Search(goal, iterations)
    try:
        with interruptible():
            rng = np.random.default_rng(seed)
            begun = starting_rows(problem, Refinement(goal, iterations), starts, refine, rng)
            # Objectives that do not count weigh 1e-8 of the one that does, in the sizes that they have in the designs
            # of the beginning, so that among equals the better one is taken.
            sizes = np.nanmedian([first, *map(goal.values, begun)], axis=0)
            sizes = np.where(sizes > 0.0, sizes, 1.0)
            ends = [np.where(np.arange(k) == i, 1.0, 1e-8 * np.square(sizes[i] / sizes)) for i in range(k)]
            ends = [np.append(end, np.full(k, OPEN)) for end in ends]
            search.refine([(x, end) for end in ends for x in begun])
            search.settle()
            for _ in range(4):  # so often at most are bounds laid anew, because an end was beaten between the ends
                if not all(end in search for end in ends):
                    break
                corners = np.array([goal.values(search.row(end)) for end in ends])
                low, high = corners.min(axis=0), corners.max(axis=0)
                if not np.any(high - low > _POINT * np.abs(high)):
                    break
                search.between(ends, low, high, points, begun)
                search.settle()
                if not search.improve(ends, corners):
                    break
    except KeyboardInterrupt:
        search.stopped = "interrupted"
    moves = move_designs(problem, [x[: problem.count] for _, x in search.best.values()])
    basins = [Basin(one, search.end(key), 1) for key, one in zip(search.best, moves, strict=True)]
    designs = judge(problem, basins, ranked=False)
    whole = [n for n, d in enumerate(designs) if not d.defects]
    values = np.array([goal.values(x) for _, x in search.best.values()]).reshape(-1, k)
    kept = [whole[n] for n in _pareto_rows(values[whole])]
    kept.sort(key=lambda n: values[n, 0])
    lost = []
    for label, column in zip(labels, values.T if designs else (), strict=False):
        column = np.where(np.isfinite(column), column, np.inf)
        best, most = int(np.argmin(column)), float(np.min(column[whole], initial=np.inf))
        if column[best] < most - (1e-3 * np.ptp(column[kept]) if kept else 0.0):  # less of its range does not show
            lost.append(f"{label}, which {'; '.join(designs[best].defects)}")
    # A search sees a problem's error in parts of its size, and functions of an `Objective` with their weights.
    units = [problem.size, *[1.0] * (k - 1)] if others else 1.0 / np.sqrt(problem.weights)
    return Front(
        problem=problem,
        names=labels,
        values=values[kept] * units,
        designs=tuple(designs[n] for n in kept),
        refined=search.refined,
        screened=starts,
        dominated=len(whole) - len(kept),
        defective=len(designs) - len(whole),
        stopped=search.stopped,
        lost=tuple(lost),
    )


class _Search:
    """The best design for each place: a choice of weights and bounds of the objectives, ``(2 k,)``."""

    def __init__(self, goal: Goal, iterations: int):
        self.goal, self.iterations, self.refined = goal, iterations, 0
        self.best: dict[bytes, tuple[float, np.ndarray]] = {}
        self.ends: dict[bytes, End] = {}
        self.stopped = ""

    def __contains__(self, place: np.ndarray) -> bool:
        return place.tobytes() in self.best

    def row(self, place: np.ndarray) -> np.ndarray:
        return self.best[place.tobytes()][1]

    def refine(self, starts: list[tuple[np.ndarray, np.ndarray]]) -> None:
        """Refine designs ``(n,)``, each at the place that follows it."""
        run, n = Refinement(self.goal, self.iterations), self.goal.count
        run.queue = [np.concatenate([x[:n], place]) for x, place in starts]
        self.refined += len(starts)
        try:
            found = run.run()
        except KeyboardInterrupt:
            run.stop()
            self._keep(run.found)
            raise
        self._keep(found)

    def _keep(self, found: Iterable[tuple[float, np.ndarray]]) -> None:
        n = self.goal.count
        for error, x in found:
            key = x[n:].tobytes()
            if key not in self.best or error < self.best[key][0]:
                self.best[key] = error, x

    def settle(self) -> None:
        """Bring the best designs to their ends by steps of second order."""
        some = [key for key, (_, x) in self.best.items() if key not in self.ends or self.ends[key].row is not x]
        ends = Sqp(self.goal).run([self.best[key][1] for key in some], self.iterations)
        for key, end in zip(some, ends, strict=True):
            # What ends on its bounds may be a little worse than what has missed them by a little.
            if end.converged or (end.feasibility <= MEETS and end.square <= self.best[key][0]):
                self.best[key], self.ends[key] = (end.square, end.row), end

    def end(self, key: bytes) -> End:
        """End of a design, as far as it is known."""
        square, x = self.best[key]
        known = self.ends.get(key)
        if known is not None and known.row is x:
            return known
        return End.unknown(x, square, self.stopped or "no step is possible")

    def between(self, ends: list[np.ndarray], low: np.ndarray, high: np.ndarray, points: int, begun: list) -> None:
        """Refine at bounds between the ends: from all known, a few random designs, and then each other's designs."""
        k = len(low)
        each = max(1, round((points - k) ** (1.0 / (k - 1))))
        steps = [low[j] + (high[j] - low[j]) * np.arange(1, each + 1) / (each + 1) for j in range(1, k)]
        places = [np.array([*ends[0][:k], OPEN, *np.square(b)]) for b in itertools.product(*steps)]
        known = [x for _, x in self.best.values()]
        # 4 random designs from which each point of the front is also started
        self.refine([(x, place) for place in places for x in [*known, *begun[:4]]])
        for _ in range(2):  # the points of the front are started from each other's designs
            starts = []
            for place in places:
                apart = [float(np.abs(np.sqrt(p[k + 1 :]) - np.sqrt(place[k + 1 :])).sum()) for p in places]
                near = [places[i] for i in np.argsort(apart, kind="stable")[1 : 1 + 2 * (k - 1)]]
                starts += [(self.row(p), place) for p in near if p in self]
            if starts:
                self.refine(starts)

    def improve(self, ends: list[np.ndarray], corners: np.ndarray) -> bool:
        """Start ends anew from designs that are better there, and say whether one has become better."""
        rows = [x for _, x in self.best.values()]
        values = np.array([self.goal.values(x) for x in rows])
        enough = corners.diagonal() - _POINT * np.ptp(corners, axis=0)
        beaten = np.flatnonzero(values.min(axis=0) < enough)
        self.refine([(rows[int(values[:, i].argmin())], ends[i]) for i in beaten])
        self.settle()
        return any(self.goal.values(self.row(ends[i]))[i] < enough[i] for i in beaten)


def _pareto_rows(values: np.ndarray) -> list[int]:
    """Select rows that no other row beats: as good in everything, better in something; of equal ones the first."""
    kept: list[int] = []
    if not len(values):
        return kept
    small = _POINT * np.maximum(np.ptp(values, axis=0), 1e-3 * np.abs(values).max(axis=0))
    for i, v in enumerate(values):
        no_worse = np.all(values <= v + small, axis=1)
        better = np.any(values < v - small, axis=1)
        same = np.all(np.abs(values[kept] - v) <= small, axis=1) if kept else np.zeros(0)
        if not (no_worse & better).any() and not same.any():
            kept.append(i)
    return kept
