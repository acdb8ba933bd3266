"""`solve`: screen, refine, look at what came out, rank."""

import functools
import time
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from tqdm import tqdm

from jaxnc.errors import InputError
from jaxnc.synthesis import levenberg
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.result import Design, Result, judged, merged
from jaxnc.synthesis.screen import screen
from jaxnc.types import Array

_LANES = 48  # designs refined at once
_ROUND = 20  # iterations between looks at them
_MEETS = 1e-8  # violation of a condition that a design may have
_HOPELESS = 4  # rounds without getting anywhere after which a lane is given to another start


class Progress(NamedTuple):
    """One line of the history: seconds, designs looked at, best error so far."""

    seconds: float
    designs: int
    error: float


def solve(
    problem: Problem,
    starts: int = 20_000,
    refine: int = 192,
    iterations: int = 400,
    keep: int = 10,
    key: Array | None = None,
    enough: float = 0.0,
    seconds: float | None = None,
    progress: bool = True,
    checkpoint: str | Path | None = None,
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
        seconds: stop after so long.
        progress: show a bar with the best error so far.
        checkpoint: a file in which the state is kept; if it exists and belongs to this problem, the search goes on
            from there.

    Returns:
        The designs, best first; see `Result`.

    Raises:
        InputError: no starts, or a free variable that does not influence anything.
    """
    if starts < 0 or refine < 1 or iterations < 1 or keep < 1:
        raise InputError("solve: starts must be at least 0, refine, iterations and keep at least 1")
    key = jax.random.key(0) if key is None else key
    begun = time.perf_counter()
    bar = tqdm(total=refine, desc=problem.name, disable=not progress, unit="design")
    x, merit = screen(problem, key, starts) if starts else (problem.start[None], np.zeros(1))
    x = np.concatenate([problem.start[None], x])
    merit = np.concatenate([[0.0], merit])  # the idea itself is always tried
    x = x[np.isfinite(merit)][:refine]
    run = _Run(problem, iterations)
    queue, found, history, done = list(x), [], [], 0
    run.fill(queue)
    best = np.inf
    while run.busy():
        run.go()
        for one, error, far in run.finished(best, bool(queue)):
            done += 1
            bar.update(1)
            if far <= _MEETS and np.isfinite(error):
                found.append((error, one))
        now = min([e for e, _ in found] + [run.best()], default=np.inf)
        if now < best:
            best = now
        history.append(Progress(time.perf_counter() - begun, done, problem.shown(best)))
        bar.set_postfix_str(f"best error {problem.shown(best):.4g} {problem.unit}", refresh=False)
        late = seconds is not None and time.perf_counter() - begun > seconds
        if late or problem.shown(best) <= enough:
            found += [(e, one) for one, e, far in run.rest() if far <= _MEETS and np.isfinite(e)]
            break
        run.fill(queue)
    bar.close()
    found.sort(key=lambda pair: pair[0])
    candidates = merged(problem, [one for _, one in found], 3 * keep)
    designs = sorted((judged(problem, one) for one in candidates), key=lambda d: d.rank)
    return Result(problem, tuple(designs[:keep]), tuple(history), len(x), starts, run.closest())


class _Run:
    """Lanes of the refinement, filled anew as they finish."""

    def __init__(self, problem: Problem, iterations: int):
        self.problem, self.most = problem, iterations
        self.scale = problem.scale
        self.lanes: levenberg.Lanes | None = None
        self.live = np.zeros(_LANES, dtype=bool)
        self.spent = np.zeros(_LANES, dtype=int)
        self.poor = np.zeros(_LANES, dtype=int)
        self.last = np.full(_LANES, np.inf)
        self.nearest: tuple[float, np.ndarray] | None = None
        look = jax.eval_shape(problem.look, jnp.asarray(problem.start))
        self.shape = look.errors.shape[0], look.conditions.shape[0]

    def fill(self, queue: list) -> None:
        """Give free lanes to the next starts."""
        free = np.flatnonzero(~self.live)
        some = [queue.pop(0) for _ in range(min(len(free), len(queue)))]
        if not some and self.lanes is not None:
            return
        at = free[: len(some)]
        n, (m, k) = self.problem.count, self.shape
        if self.lanes is None:
            x = np.broadcast_to(self.problem.start / self.scale, (_LANES, n))
            self.lanes = levenberg.waiting(jnp.asarray(x), m, k)._replace(settled=jnp.ones(_LANES, bool))
        fresh = levenberg.waiting(jnp.asarray(np.stack(some) / self.scale), m, k)
        self.lanes = jax.tree.map(lambda a, b: a.at[at].set(b), self.lanes, fresh)
        self.live[at], self.spent[at], self.poor[at], self.last[at] = True, 0, 0, np.inf

    def busy(self) -> bool:
        return bool(self.live.any())

    def go(self) -> None:
        assert self.lanes is not None
        self.lanes = _advance(self.problem, self.lanes, _ROUND)
        self.spent[self.live] += _ROUND

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Squares of the errors and violations."""
        assert self.lanes is not None
        square = np.asarray(jnp.sum(self.lanes.errors**2, axis=1))
        far = levenberg.violation(self.lanes.conditions, self.problem.equalities)
        return square, np.asarray(jnp.max(far, axis=1, initial=0.0))

    def best(self) -> float:
        square, far = self.state()
        ok = self.live & (far <= _MEETS)
        return float(np.min(square[ok], initial=np.inf))

    def rest(self) -> list:
        return self._out(np.flatnonzero(self.live))

    def finished(self, best: float, waiting: bool) -> list:
        """Lanes that have nothing left to do, or no prospect while others wait."""
        assert self.lanes is not None
        square, far = self.state()
        merit = square + far
        self.poor = np.where(merit < 0.9 * self.last, 0, self.poor + 1)
        self.last = np.minimum(self.last, merit)
        over = np.asarray(self.lanes.settled) | (self.spent >= self.most)
        over = over | (self.poor >= _HOPELESS) & (merit > 2.0 * best)
        return self._out(np.flatnonzero(self.live & over))

    def _out(self, at: np.ndarray) -> list:
        assert self.lanes is not None
        square, far = self.state()
        x = np.asarray(self.lanes.x) * self.scale
        self.live[at] = False
        self.lanes = self.lanes._replace(settled=self.lanes.settled.at[at].set(True))
        for i in at:
            if square[i] < 1e5 and (self.nearest is None or far[i] < self.nearest[0]):
                self.nearest = float(far[i]), x[i]
        return [(x[i], square[i], far[i]) for i in at]

    def closest(self) -> tuple[float, np.ndarray] | None:
        """The design that came nearest to meeting its conditions."""
        return self.nearest


@functools.partial(jax.jit, static_argnums=(0, 2))
def _advance(problem: Problem, lanes: levenberg.Lanes, count: int) -> levenberg.Lanes:
    scale = jnp.asarray(problem.scale)

    def both(x):
        look = problem.look(x * scale)
        return jnp.concatenate([look.errors, look.conditions]), look

    def evaluate(x):
        slopes, look = jax.vmap(jax.jacfwd(both, has_aux=True))(x)
        return look.errors, look.conditions, slopes, look.ok

    low, high = jnp.asarray(problem.low) / scale, jnp.asarray(problem.high) / scale
    return levenberg.advance(evaluate, lanes, problem.equalities, low, high, count)
