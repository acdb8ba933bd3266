"""`solve`: screen, refine, look at what came out, rank."""

import functools
import time
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from tqdm import tqdm

from jaxnc.errors import InputError
from jaxnc.synthesis import levenberg
from jaxnc.synthesis.minimax import Minimax
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.result import Result, judged, merged
from jaxnc.synthesis.screen import screen
from jaxnc.types import Array

_LANES = 48  # the most designs refined at once
_ROUND = 20  # iterations between looks at them
_MEETS = 1e-8  # violation of a condition that a design may have
_SHORTLIST = 4  # times as many as are refined, are looked at with their conditions
_HEAVY = 10.0  # weight of a condition's violation against an error
_IDLE = 1e-12  # derivatives that are nothing
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

    Returns:
        The designs, best first; see `Result`.

    Raises:
        InputError: no starts, or a free variable that does not influence anything.
    """
    for name, value in {"starts": starts, "refine": refine, "iterations": iterations, "keep": keep}.items():
        if value < 1:
            raise InputError(f"solve: {name}={value!r}; it must be at least 1")
    key = jax.random.key(0) if key is None else key
    begun = time.perf_counter()
    bar = tqdm(total=refine, desc=problem.name, disable=not progress, unit="design")
    rng = np.random.default_rng(np.asarray(jax.random.key_data(key)).astype(np.uint32).tolist())
    run = _Run(problem, iterations, refine)
    x = screen(problem, rng, starts, _SHORTLIST * refine)
    bounded = np.clip(np.concatenate([problem.start[None], x]), problem.low, problem.high)
    bounded, merit = run.merits(bounded)
    if problem.variables.chosen and run.idle:
        raise InputError(
            f"{problem.name}: {', '.join(run.idle)} {'has' if len(run.idle) == 1 else 'have'} no influence on the "
            f"errors or the conditions; leave {'it' if len(run.idle) == 1 else 'them'} out of free="
        )
    order = np.argsort(merit, kind="stable")
    order = np.append(0, order[order != 0]) if np.isfinite(merit[0]) else order
    x = bounded[order[np.isfinite(merit[order])]][:refine]
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
    if problem.minimax and found:
        found = _levelled(problem, [one for _, one in found[:_LANES]], iterations)
    candidates = merged(problem, [one for _, one in found], 3 * keep)
    designs = sorted((judged(problem, one) for one in candidates), key=lambda d: d.rank)
    return Result(problem, tuple(designs[:keep]), tuple(history), len(x), starts, run.broken, run.closest())


def _levelled(problem: Problem, xs: list, iterations: int) -> list:
    """From least squares to the least largest error."""
    level = Minimax.of(problem)
    run = _Run(level, iterations, len(xs))
    run.fill([np.append(x, level.height(x)) for x in xs])
    found = []
    while run.busy():
        run.go()
        found += [(e, one[:-1]) for one, e, far in run.finished(np.inf, False) if far <= _MEETS and np.isfinite(e)]
    return sorted(found, key=lambda pair: pair[0])


class _Run:
    """Lanes of the refinement, filled anew as they finish."""

    def __init__(self, problem: Problem, iterations: int, designs: int):
        self.problem, self.most, self.width = problem, iterations, min(designs, _LANES)
        self.scale = problem.scale
        self.lanes: levenberg.Lanes | None = None
        self.live = np.zeros(self.width, dtype=bool)
        self.spent = np.zeros(self.width, dtype=int)
        self.poor = np.zeros(self.width, dtype=int)
        self.last = np.full(self.width, np.inf)
        self.nearest: tuple[float, np.ndarray] | None = None
        self.moving = np.zeros(problem.count, dtype=bool)
        self.seen = False
        self.broken = 0
        look = jax.eval_shape(problem.look, jnp.asarray(problem.start))
        self.shape = look.errors.shape[0], look.conditions.shape[0]

    def merits(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Starts with offsets fitted, and their errors and violated conditions, infinite where a target is missed."""
        (m, k), moved, out = self.shape, [], []
        for first in range(0, len(x), self.width):
            at = np.minimum(np.arange(first, first + self.width), len(x) - 1)
            lanes = levenberg.waiting(jnp.asarray(x[at] / self.scale), m, k)
            self.lanes = _advance(self.problem, lanes, jnp.asarray(1))
            assert self.lanes is not None
            square, far = self.state()
            good = square < 1e10
            new, errors = self.problem.fitted(x[at], np.asarray(self.lanes.errors))
            moved.append(np.where(good[:, None], new, x[at]))
            square = np.sum(errors**2, axis=1)
            self.seen = self.seen or bool(good.any())
            self.moving |= np.any(np.abs(np.asarray(self.lanes.slopes)[good]) > _IDLE, axis=(0, 1))
            out.append(np.where(good, square + _HEAVY * far**2, np.inf))
        self.lanes = None
        return np.concatenate(moved)[: len(x)], np.concatenate(out)[: len(x)]

    @property
    def idle(self) -> list[str]:
        """Unknowns that change nothing in any of the starts."""
        return [n for n, m in zip(self.problem.names, self.moving, strict=True) if not m] if self.seen else []

    def fill(self, queue: list) -> None:
        """Give free lanes to the next starts."""
        free = np.flatnonzero(~self.live)
        some = [queue.pop(0) for _ in range(min(len(free), len(queue)))]
        if not some and self.lanes is not None:
            return
        at = free[: len(some)]
        n, (m, k) = self.problem.count, self.shape
        if self.lanes is None:
            x = np.broadcast_to(self.problem.start / self.scale, (self.width, n))
            self.lanes = levenberg.waiting(jnp.asarray(x), m, k)._replace(settled=jnp.ones(self.width, bool))
        fresh = levenberg.waiting(jnp.asarray(np.stack(some) / self.scale), m, k)
        self.lanes = jax.tree.map(lambda a, b: a.at[at].set(b), self.lanes, fresh)
        self.live[at], self.spent[at], self.poor[at], self.last[at] = True, 0, 0, np.inf

    def busy(self) -> bool:
        return bool(self.live.any())

    def go(self) -> None:
        assert self.lanes is not None
        self.lanes = _advance(self.problem, self.lanes, jnp.asarray(_ROUND))
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
        self.broken += int(np.asarray(self.lanes.broken)[at].sum())
        self.lanes = self.lanes._replace(settled=self.lanes.settled.at[at].set(True))
        for i in at:
            if square[i] < 1e10 and (self.nearest is None or far[i] < self.nearest[0]):
                self.nearest = float(far[i]), x[i]
        return [(x[i], square[i], far[i]) for i in at]

    def closest(self) -> tuple[float, np.ndarray] | None:
        """The design that came nearest to meeting its conditions."""
        return self.nearest


@functools.partial(jax.jit, static_argnums=0)
def _advance(problem: Problem, lanes: levenberg.Lanes, count: Array) -> levenberg.Lanes:
    scale = jnp.asarray(problem.scale)

    def both(x):
        look = problem.look(x * scale)
        return jnp.concatenate([look.errors, look.conditions]), look

    def evaluate(x):
        slopes, look = jax.vmap(jax.jacfwd(both, has_aux=True))(x)
        return look.errors, look.conditions, slopes, look.ok

    low, high = jnp.asarray(problem.low) / scale, jnp.asarray(problem.high) / scale
    return levenberg.advance(evaluate, lanes, problem.equalities, low, high, count)
