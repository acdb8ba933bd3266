"""`descend`: any optax optimiser, many designs side by side, from random starts to a ranked table."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import refuse_fork
from jaxnc.errors import InputError
from jaxnc.progress import bar
from jaxnc.synthesis.descent import Descent, tolerance_given, traced
from jaxnc.synthesis.evaluate import reached
from jaxnc.synthesis.lanes import Lanes
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.result import Result, judged, quantity
from jaxnc.synthesis.search import checkpoint as file
from jaxnc.synthesis.search.basins import different, once
from jaxnc.synthesis.search.checkpoint import interruptible
from jaxnc.synthesis.search.screen import idea, reseated, screen
from jaxnc.synthesis.search.solve import Progress
from jaxnc.synthesis.settings import at_least_one, problem_given, seconds_given, seed_of
from jaxnc.types import Array

_KEPT_EVERY = 1.0  # seconds between two savings
_LOOKS = 50  # random designs that are looked at for each lane
_LIKELY = 4  # times as many as there are lanes, of which those that assemble are taken


@public
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
        progress: show a bar with the best error so far; if not given, where stderr is a terminal, and in a notebook.
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
    run = Lanes(Descent(problem, optimiser, batch, gradient), jax.random.key(0) if key is None else key, patience)
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
    designs = judged(problem, valleys)
    if not stopped.startswith("interrupted"):
        designs = once(problem, designs)
    return Result(
        problem=problem,
        designs=tuple(designs[:keep]),
        history=tuple(history),
        refined=run.count,
        screened=looked,
        broken=run.broken,
        nearest=None,
        stopped=stopped,
        steps=run.steps(),
    )


def _starting(problem: Problem, rng: np.random.Generator, lanes: int, looks: int) -> np.ndarray:
    """The idea, and the most promising random designs that assemble, ``(lanes or fewer, n)``."""
    own = idea(problem, rng)
    x = screen(problem, rng, looks, _LIKELY * lanes).x if lanes > 1 else own[:0]
    every = np.clip(np.concatenate([own, x]), problem.low, problem.high)
    every = np.stack(reseated(problem, list(every)))
    good = np.all(reached(problem, every, 0).status == 0, axis=1)
    own, x = every[: len(own)][good[: len(own)]], every[len(own) :][good[len(own) :]]
    return np.concatenate([own[:1], x])[:lanes]


def _unknowns(problem: Problem, starts: Any) -> np.ndarray:
    """Starts that were given."""
    try:
        x = np.asarray([getattr(one, "x", one) for one in starts] if isinstance(starts, Sequence) else starts, float)
    except (TypeError, ValueError, OverflowError):
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
