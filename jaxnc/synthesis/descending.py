"""`descend`: any optax optimiser, many designs side by side, from random starts to a ranked table."""

import functools
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.compiling import jit, on_device, refuse_fork
from jaxnc.errors import InputError
from jaxnc.progress import bar
from jaxnc.synthesis import checkpoint as file
from jaxnc.synthesis.descent import LARGE, LOST, MEETS, NO_SLOPE, Descent, Lane, begun, stepped, tolerance_given, traced
from jaxnc.synthesis.ending import Ended
from jaxnc.synthesis.idea import idea
from jaxnc.synthesis.interruption import interruptible
from jaxnc.synthesis.nearest import reseated
from jaxnc.synthesis.optimiser import Optimiser
from jaxnc.synthesis.poses import reached
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.result import Result, judged, quantity
from jaxnc.synthesis.screen import screen
from jaxnc.synthesis.search import Progress
from jaxnc.synthesis.settings import at_least_one, problem_given, seconds_given, seed_of
from jaxnc.synthesis.steps import Steps
from jaxnc.synthesis.valleys import different
from jaxnc.synthesis.walls import Walls
from jaxnc.types import Array

_ROOM = 64  # steps that compiled code takes at once, at most
_LASTING = 0.2  # seconds that they should last: so often is a descent looked at, and can be stopped
_KEPT_EVERY = 1.0  # seconds between two savings
_GAIN = 1e-3  # of the value: less in `patience` steps is no progress
_AVERAGED = 20  # steps over which values that are samples are averaged, to be compared with `enough`
_SAMPLES = 64  # of a value that is drawn anew at every step, to rank designs
_LATER = 1 << 30  # number of the first of these samples
_LOOKS = 50  # random designs that are looked at for each lane
_LIKELY = 4  # times as many as there are lanes, of which those that assemble are taken


def descend(
    problem: Problem,
    optimiser: Any,
    steps: int = 1000,
    starts: Any = 32,
    key: Array | None = None,
    batch: int | None = None,
    gradient: float = 1e-8,
    patience: int | None = None,
    enough: float | None = None,
    seconds: float | None = None,
    keep: int = 10,
    progress: bool | None = None,
    checkpoint: str | Path | None = None,
    resume: str | Path | None = None,
) -> Result:
    """Bring designs down the gradient of a problem by an optax optimiser, all of them side by side.

    One step of all designs is one compiled function. Unknowns are divided by their scales, so that a learning rate is a
    part of the drawing's size; they stay in their boxes and lengths within bounds by projection, other conditions are
    met by an augmented Lagrangian. A step to a design that does not assemble is taken back, and the next is shorter.

    Args:
        problem: what is wanted: a ready problem, or a `Loss` around any JAX function of a design.
        optimiser: an optax transformation, such as ``optax.adam(1e-2)`` or ``optax.lbfgs()``.
        steps: the most.
        starts: how many designs, the idea and random ones; or their unknowns, ``(lanes, n)``.
        key: of the starts and of what is drawn at each step (``jax.random.key(0)`` if not given).
        batch: how many of the targets count in a step, drawn anew each time; all if not given.
        gradient: norm of the projected gradient, by unknowns in their scales, at which a design is at its end.
        patience: a design is left alone when it has become no better by a thousandth in so many steps.
        enough: stop as soon as a design has this error.
        seconds: stop after so long.
        keep: designs in the result.
        progress: show a bar with the best error so far; if not given, where stderr is a terminal or a notebook.
        checkpoint: file in which the descent is kept, replaced in one step.
        resume: such a file, from which it goes on, also to more `steps` than at first.

    Returns:
        The designs, best first, with the history in ``result.steps``. Ctrl-C returns what there is.

    Raises:
        InputError: no optax transformation, settings that are none, nothing finite at any start, traced numbers.
        ModelFileError: a file that holds no descent.
    """
    what = "descend"
    refuse_fork()
    problem_given(what, problem, squares=False)
    at_least_one(what, steps=steps, keep=keep, **({} if patience is None else {"patience": patience}))
    tolerance_given(what, gradient)
    if enough is not None and (isinstance(enough, bool) or not isinstance(enough, (int, float, np.number))):
        raise InputError(f"{what}: enough={enough!r}; it must be an error to stop at, or None")
    if traced(problem, starts, key):
        raise InputError(
            f"{what} is a loop in Python and needs numbers; in traced code take steps of your own: "
            f"lane = descent.begin(x), then lane = descent(lane), of descent = nc.synthesis.Descent(problem, optimiser)"
        )
    limit, seed = seconds_given(what, seconds), seed_of(what, key)
    run = _Run(Descent(problem, optimiser, batch, gradient), jax.random.key(0) if key is None else key, patience)
    given = None if isinstance(starts, (int, np.integer)) else _unknowns(problem, starts)
    if given is None:
        at_least_one(what, starts=starts)
    own = {"optimiser": run.descent.optimiser.digest, "starts": starts if given is None else given.tolist()}
    terms = file.terms_of(problem, **own, batch=batch, gradient=gradient, patience=patience, key=seed)
    if checkpoint is not None:
        file.prepare(checkpoint)
    history, begin, looked = [], time.perf_counter(), 0 if given is not None else _LOOKS * int(starts)
    try:
        with interruptible():
            x = given if given is not None else _starting(problem, np.random.default_rng(seed), int(starts), looked)
            if not len(x):
                return Result(problem, (), (), 0, looked, 0, None)
            run.begin(x, len(x) if given is not None else int(starts))
            if resume is not None:
                history = [Progress(*row) for row in file.take_up(resume, terms, run)]
                begin -= history[-1].seconds if history else 0.0
                checkpoint = resume if checkpoint is None else checkpoint
    except KeyboardInterrupt:
        return Result(problem, (), (), 0, 0, 0, None, "interrupted before the first step")
    limit += history[-1].seconds if history else 0.0
    stopped, kept, seen = "", begin, bar(steps, problem.name, "step", progress, initial=run.done)
    try:
        while run.done < steps and run.busy and not stopped:
            with interruptible():
                run.go(steps)
            now = time.perf_counter()
            best = float(problem.shown(run.best()))
            history.append(Progress(now - begin, run.done, best))
            run.told(now - begin)
            seen.set_postfix_str(f"best error {quantity(best, problem.error_unit, 4)}", refresh=False)
            seen.update(run.done - seen.n)
            if now - begin > limit:
                stopped = f"stopped after {now - begin:.0f} s"
            elif enough is not None and best <= enough:
                stopped = f"stopped at enough={enough:g}"
            if checkpoint is not None and (now - kept > _KEPT_EVERY or stopped):
                file.save(checkpoint, terms, run, history)
                kept = now
    except KeyboardInterrupt:
        stopped = "interrupted"
    seen.close()
    if stopped:
        stopped += f" after {run.done} of {steps} steps"
        stopped += "" if checkpoint is None else f"; to go on, resume from {checkpoint}"
    if checkpoint is not None and history:
        file.save(checkpoint, terms, run, history)
    ends = run.ends(stopped.partition(" ")[0])
    valleys = [valley for valley, _ in different(problem, [(end, 1) for end in ends])][: 2 * keep]
    return Result(
        problem=problem,
        designs=tuple(judged(problem, valleys)[:keep]),
        history=tuple(history),
        refined=run.count,
        screened=looked,
        broken=run.broken,
        nearest=None,
        stopped=stopped,
        steps=run.steps(),
    )


class _Run:
    """Lanes under way, and their history."""

    def __init__(self, descent: Descent, key: Array, patience: int | None):
        self.descent, self.patience = descent, patience
        self.problem, self.key = descent.problem, key
        self.leaves, self.structure = jax.tree.flatten(self.problem)
        self.leaves = on_device(self.leaves)
        self.equal = tuple(bool(e) for e in descent.equal)
        self.rows: list[np.ndarray] = []
        self.times: list[float] = []
        self.done = self.broken = self.count = 0
        self.each = np.inf
        self.first = True
        self.idle = np.zeros(0, bool)

    def begin(self, x: np.ndarray, lanes: int) -> None:
        """Put designs into so many lanes; what they do not fill has come to its end."""
        self.count = len(x)
        at = np.minimum(np.arange(lanes), len(x) - 1)
        lane = _begun(self.descent.optimiser, len(self.equal), self.descent.walls, on_device(x[at]))
        self.lanes = _with(lane, over=np.arange(lanes) >= len(x))
        self.idle = np.zeros(lanes, bool)

    @property
    def busy(self) -> bool:
        """Whether a design is still under way."""
        return not bool(np.asarray(self.lanes.over).all())

    def go(self, most: int) -> None:
        """Take some steps, not more than `most` altogether.

        Raises:
            InputError: no start is finite.
        """
        count = 1 if not np.isfinite(self.each) else int(np.clip(_LASTING / self.each, 1, _ROOM))
        count = min(count, most - self.done)
        if self.patience is not None:
            count = min(count, self.patience - self.done % self.patience)
        begin = time.perf_counter()
        new = self._taken(self.done, count)
        if not self.first:  # the first of them was compiled
            self.each = (time.perf_counter() - begin) / count
        elif self.done:
            self.each = _LASTING
        self.first, self.done = False, self.done + count
        self.rows.append(new)
        self.broken += int((new[:, : self.count, 3] == NO_SLOPE).sum())
        if self.done == count:
            self._see(new[0, : self.count, 3])
        if self.patience is not None and self.done % self.patience == 0:
            self._tire()

    def told(self, seconds: float) -> None:
        """Say when the last steps were taken."""
        before, count = (self.times[-1] if self.times else 0.0), len(self.rows[-1])
        self.times += [before + (seconds - before) * (k + 1) / count for k in range(count)]

    def best(self) -> float:
        """The least value of a design that meets its conditions; of samples their average over some steps."""
        if self.descent.random:
            few = np.concatenate(self.rows[-_AVERAGED:])[-_AVERAGED:, : self.count]
            return float(np.min(np.mean(few[..., 0], axis=0)))
        lanes = self.lanes
        meets = np.asarray(lanes.best_violation) <= MEETS
        return float(np.min(np.asarray(lanes.best_value)[meets], initial=np.inf))

    def ends(self, stopped: str) -> list[Ended]:
        """What designs have come to, those that assemble."""
        lanes, random = self.lanes, self.descent.random
        y = np.asarray(lanes.y if random else lanes.best) * np.asarray(self.descent.walls.scale)
        value, far = (np.asarray(a) for a in (lanes.best_value, lanes.best_violation))
        left, steps, over = (np.asarray(a) for a in (lanes.gradient, lanes.steps, lanes.over))
        lost = np.asarray(lanes.merit if random else lanes.best_value) >= LARGE
        if random and self.rows:
            self.lanes = _with(lanes, over=np.ones(len(y), bool))
            parts = [self._taken(_LATER + k, min(_ROOM, _SAMPLES - k)) for k in range(0, _SAMPLES, _ROOM)]
            self.lanes, samples = lanes, np.concatenate(parts)
            value, far = np.mean(samples[..., 0], axis=0), np.asarray(lanes.violation)
        out = []
        for k in range(self.count):
            if lost[k]:
                continue
            level = left[k] <= self.descent.tolerance and far[k] <= MEETS and not random
            end = "" if level else f"{steps[k]} steps"
            if end and self.idle[k]:
                end = f"no progress in {self.patience} steps"
            elif end and over[k]:
                end = "no step is possible"
            elif end and stopped:
                end = stopped
            out.append(Ended(y[k], float(value[k]), float(left[k]), np.nan, float(far[k]), int(steps[k]), end))
        return out

    def steps(self) -> Steps:
        """The history so far."""
        rows = np.concatenate(self.rows)[:, : self.count] if self.rows else np.zeros((0, self.count, 5))
        under = rows[..., 4] > 0.0
        value, left, far = (np.where(under & (rows[..., k] < LARGE), rows[..., k], np.nan) for k in range(3))
        shown = np.vectorize(self.problem.shown, otypes=[float])(value) if value.size else value
        times = np.array(self.times[: len(rows)])
        return Steps(shown, left, far, under & (rows[..., 3] == 0), times, self.descent.random)

    # -- keeping ----------------------------------------------------------------------------------------------------

    def saved(self) -> dict[str, np.ndarray]:
        """Everything that decides how it goes on, as arrays by name."""
        leaves = [_data(a) for a in jax.tree.leaves(self.lanes)]
        rows = np.concatenate(self.rows) if self.rows else np.zeros((0, len(self.idle), 5))
        own = {"rows": rows, "times": np.array(self.times), "idle": self.idle, "broken": np.array(self.broken)}
        return own | {f"lane.{k}": a for k, a in enumerate(leaves)}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go back to what `saved` returned."""
        old, structure = jax.tree.flatten(self.lanes)
        new = [_like(arrays[f"lane.{k}"], a) for k, a in enumerate(old)]
        self.lanes = jax.tree.unflatten(structure, new)
        self.rows, self.times = [arrays["rows"]], arrays["times"].tolist()
        self.idle, self.broken, self.done = arrays["idle"].copy(), int(arrays["broken"]), len(arrays["rows"])

    # -- inside -----------------------------------------------------------------------------------------------------

    def _taken(self, first: int, count: int) -> np.ndarray:
        """So many steps from the one with this number on; what was seen, ``(count, lanes, 5)``."""
        d = self.descent
        lanes, seen = _steps(
            self.structure, d.optimiser, self.equal, d.batch, self.leaves, d.walls, d.tolerance, self.lanes, self.key,
            np.int32(first), np.int32(count),
        )  # fmt: skip
        seen = np.asarray(seen)[:count]
        self.lanes = lanes
        return seen

    def _see(self, outcome: np.ndarray) -> None:
        if (outcome == LOST).any() or (outcome == 0).any():
            return
        of = "gradient" if (outcome == NO_SLOPE).any() else "value"
        raise InputError(
            f"{self.problem.name}: the {of} of all {self.count} starts, the idea among them, is not finite; keep "
            f"divisions, roots and logarithms of your own functions away from where they, or their derivatives, are "
            f"not defined"
        )

    def _tire(self) -> None:
        """Leave designs alone that have become no better of late."""
        assert self.patience is not None
        rows = np.concatenate(self.rows)[..., 0]
        late, early = rows[-self.patience :], rows[: -self.patience]
        if not len(early):
            return
        if self.descent.random:
            now, before = np.mean(late, axis=0), np.mean(early[-self.patience :], axis=0)
        else:
            now, before = np.min(late, axis=0), np.min(early, axis=0)
        over = np.asarray(self.lanes.over)
        tired = ~over & ~(now < before - _GAIN * np.abs(before))
        self.idle |= tired
        self.lanes = _with(self.lanes, over=over | tired)


@functools.partial(jit, static_argnums=(0, 1))
def _begun(optimiser: Optimiser, conditions: int, walls: Walls, x: Array) -> Lane:
    return jax.vmap(lambda x: begun(optimiser, walls, conditions, x))(x)


@functools.partial(jit, static_argnums=(0, 1, 2, 3))
def _steps(
    structure: Any,
    optimiser: Optimiser,
    equal: tuple[bool, ...],
    batch: int | None,
    leaves: list[Any],
    walls: Walls,
    tolerance: Any,
    lanes: Lane,
    key: Array,
    first: Array,
    count: Array,
) -> tuple[Lane, Array]:
    problem: Problem = jax.tree.unflatten(structure, leaves)
    which, random = np.array(equal, bool), batch is not None or problem.random

    def step(k: Array, state: tuple[Lane, Array]) -> tuple[Lane, Array]:
        lanes, seen = state
        own = jax.random.fold_in(key, first + k) if random else None
        under = ~lanes.over
        new = jax.vmap(lambda lane: stepped(problem, optimiser, walls, which, batch, tolerance, lane, own))(lanes)
        row = jnp.stack([new.value, new.gradient, new.violation, new.outcome, under], axis=1)
        return new, seen.at[k].set(row.astype(seen.dtype))

    seen = jnp.zeros((_ROOM, lanes.y.shape[0], 5), lanes.y.dtype)
    return lax.fori_loop(0, count, step, (lanes, seen))


def _starting(problem: Problem, rng: np.random.Generator, lanes: int, looks: int) -> np.ndarray:
    """The idea, and the most promising random designs that assemble, ``(lanes or fewer, n)``."""
    own = idea(problem, rng)
    x = screen(problem, rng, looks, _LIKELY * lanes) if lanes > 1 else own[:0]
    every = np.clip(np.concatenate([own, x]), problem.low, problem.high)
    every = np.stack(reseated(problem, list(every)))
    good = np.all(reached(problem.core, every, 0).status == 0, axis=1)
    own, x = every[: len(own)][good[: len(own)]], every[len(own) :][good[len(own) :]]
    return np.concatenate([own[:1], x])[:lanes]


def _unknowns(problem: Problem, starts: Any) -> np.ndarray:
    """Starts that were given.

    Raises:
        InputError: they are not numbers, or of another shape.
    """
    try:
        x = np.asarray([getattr(one, "x", one) for one in starts] if isinstance(starts, Sequence) else starts, float)
    except (TypeError, ValueError):
        raise InputError(
            f"descend: starts={starts!r}; it must be a number of designs, or their unknowns, (lanes, {problem.count})"
        ) from None
    x = x.reshape(0, problem.count) if not x.size else np.atleast_2d(x)
    if x.ndim != 2 or x.shape[1] != problem.count or not len(x) or not np.isfinite(x).all():
        raise InputError(
            f"descend: starts must be finite unknowns of designs, shape (lanes, {problem.count}), each "
            f"{', '.join(problem.names[:6])}{' …' if problem.count > 6 else ''}; got shape {x.shape}"
        )
    return x


def _with(lanes: Lane, over: np.ndarray) -> Lane:
    parts = {name: getattr(lanes, name) for name in Lane.__dataclass_fields__}  # pyright: ignore[reportAttributeAccessIssue]
    return Lane(**{**parts, "over": on_device(over)})


def _data(a: Any) -> np.ndarray:
    return np.asarray(jax.random.key_data(a) if jnp.issubdtype(a.dtype, jax.dtypes.prng_key) else a)


def _like(a: np.ndarray, old: Any) -> Any:
    if jnp.issubdtype(old.dtype, jax.dtypes.prng_key):
        return jax.random.wrap_key_data(on_device(a), impl=jax.random.key_impl(old))
    return on_device(a)
