"""`descend`: any optax optimiser for a problem, many designs side by side, from random starts to a ranked table.

Unknowns are divided by their scales, so that a rate is a part of the drawing's size. After each step they are projected
on boxes and bounds of lengths; other conditions make an augmented Lagrangian. A step to a design that does not
assemble is taken back, and the next one is shorter: such a design has a large value and no gradient.

Nothing here imports optax: whatever has its ``init`` and ``update`` is taken.

Source: J. Nocedal and S. J. Wright, Numerical Optimization, 2nd ed., 2006, section 17.4 (augmented Lagrangian).
"""

import dataclasses
import functools
import hashlib
import inspect
import time
import types
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.compiling import jit, on_device, refuse_fork
from jaxnc.errors import InputError
from jaxnc.internals import outermost
from jaxnc.notebooks import Shown
from jaxnc.records import record
from jaxnc.synthesis.design import judge
from jaxnc.synthesis.evaluate import solve_poses
from jaxnc.synthesis.problem import Bounds, Problem, check_problem, repeat_drawing
from jaxnc.synthesis.pytree import Leaves, Static
from jaxnc.synthesis.result import Result, Steps
from jaxnc.synthesis.search.basins import distinct_basins, list_once
from jaxnc.synthesis.search.screen import initial_guess, reseat_targets, screen
from jaxnc.synthesis.search.solve import Course, interruptible
from jaxnc.synthesis.search.sqp import End
from jaxnc.synthesis.validate import as_floats, as_seed, as_time_limit, check_counts, check_limit
from jaxnc.types import Array, ArrayLike, PyTree

LARGE = 1e15  # the value of a design that does not assemble
GOOD, LOST, NO_VALUE, NO_SLOPE = range(4)  # what became of a trial
MEETS = 1e-7  # violation that is none

_ROOM = 64  # steps that compiled code takes at once, at most
_LASTING = 0.2  # seconds that they should last: so often is a descent looked at, and can be stopped

_GRADIENT = "a norm to stop at, 0 or a positive number"
_EXTRA = ("value", "grad", "value_fn")  # what optimisers that search along lines ask for
_THEIRS = ("optax", "jax")  # packages whose functions are what their code and closures are


# -- optimisers --------------------------------------------------------------------------------------------------------


class Optimiser:
    """An optax transformation: equal to another one that is made of the same functions with the same numbers."""

    def __init__(self, what: str, given: Any):
        """Check what was given; `what` is what messages call the caller."""
        parts = getattr(given, "init", None), getattr(given, "update", None)
        if isinstance(given, type) or not all(map(callable, parts)):
            name = getattr(given, "__name__", type(given).__name__)
            theirs = str(getattr(given, "__module__", "")).startswith("optax")
            makes = callable(given) and name.isidentifier() and theirs
            remedy = f": call it, optax.{name}(1e-2)" if makes else ", such as optax.adam(1e-2)"
            raise InputError(
                f"{what}: the optimiser must be an optax transformation, with init and update, got {name}{remedy}"
            )
        self.init: Callable = given.init  # the memory of an optimiser at some unknowns
        self.update: Callable = given.update
        taken = inspect.signature(self.update).parameters.values()
        every = any(p.kind is p.VAR_KEYWORD for p in taken)
        self.extra = _EXTRA if every else tuple(p.name for p in taken if p.name in _EXTRA)
        self.key = _identity(given, [])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Optimiser) and other.key == self.key

    def __hash__(self) -> int:
        return hash(self.key)

    @property
    def digest(self) -> str:
        """A text that is the same in every process."""
        return hashlib.sha256(repr(_lasting(self.key)).encode()).hexdigest()[:16]

    def updates(
        self, slope: Array, memory: object, y: Array, value: Array, value_fn: Callable[[PyTree], PyTree]
    ) -> tuple[PyTree, PyTree]:
        """Return what is added to the unknowns, and the memory afterwards."""
        known = {"value": value, "grad": slope, "value_fn": value_fn}
        return self.update(slope, memory, y, **{name: known[name] for name in self.extra})


def _identity(thing: object, above: list[object]) -> object:
    """A key that things share if they do the same: numbers, code with what it encloses, else identity."""
    if isinstance(thing, int) and not isinstance(thing, bool) and abs(thing) < 1 << 53:
        return "float", float(thing)  # schedules make one of the other when they are first asked
    if thing is None or isinstance(thing, (bool, int, float, complex, str, bytes, type, np.dtype)):
        return type(thing).__name__, thing
    if any(thing is one for one in above):
        return "above", [thing is one for one in above].index(True)
    inside = functools.partial(_identity, above=[*above, thing])
    if isinstance(thing, (np.ndarray, np.generic, jax.Array)) and not _is_key(thing):
        array = np.asarray(thing)
        return "array", array.shape, array.dtype.str, array.tobytes()
    if isinstance(thing, (tuple, list)):
        return type(thing).__name__, tuple(map(inside, thing))
    if isinstance(thing, dict):
        return "dict", tuple((inside(k), inside(v)) for k, v in thing.items())
    if isinstance(thing, functools.partial):
        return "partial", inside(thing.func), inside(thing.args), inside(thing.keywords)
    if isinstance(thing, types.FunctionType) and (thing.__module__ or "").split(".")[0] in _THEIRS:
        cells = []
        for cell in thing.__closure__ or ():
            try:
                cells.append(inside(cell.cell_contents))
            except ValueError:  # not filled yet
                return "only", Static.only(thing)
        held = inside(thing.__defaults__), inside(thing.__kwdefaults__)
        return "function", thing.__module__, thing.__qualname__, thing.__code__, tuple(cells), held
    return "only", Static.only(thing)


def _lasting(key: object) -> object:
    """A key without what differs from process to process."""
    if isinstance(key, Static):
        return getattr(key.value, "__qualname__", type(key.value).__name__)
    if isinstance(key, types.CodeType):
        return key.co_name
    return tuple(map(_lasting, key)) if isinstance(key, tuple) else key


def _is_key(array: Any) -> bool:
    """Tell whether an array holds keys of random numbers."""
    return jax.dtypes.issubdtype(array.dtype, jax.dtypes.prng_key)


# -- one step of one design --------------------------------------------------------------------------------------------


@record
class Lane:
    """A design under way, in unknowns divided by their scales; `Descent.unknowns` and `Descent.design` tell what it is.

    Attributes:
        y: the design, the last one that assembles, ``(n,)``.
        value: what is made small, there: of a problem the sum of the squares of the divided errors.
        gradient: norm of what bounds leave of the gradient of value and conditions.
        violation: the largest violation of a condition there.
        outcome: of the last trial: 0 good, 1 it does not assemble, 2 its value is not finite, 3 its gradient is not.
        steps: taken.
        over: whether it has come to its end: its trials stay where it is.
        best: the best design that meets all conditions, or the one that is closest to that.
        best_value: what is made small, there.
        best_violation: the violation there.
        trial: the next design.
        slope: the gradient.
        merit: value with conditions.
        memory: of the optimiser, in this design.
        after: of the optimiser, in the next.
        share: part of the optimiser's steps that is taken, after steps were taken back.
        multipliers: of the conditions, ``(k,)``.
        heavy: weight of their violations.
        before: violation when these were last changed.
    """

    y: Array
    value: Array
    gradient: Array
    violation: Array
    outcome: Array
    steps: Array
    over: Array
    best: Array
    best_value: Array
    best_violation: Array
    trial: Array
    slope: Array
    merit: Array
    memory: PyTree
    after: PyTree
    share: Array
    multipliers: Array
    heavy: Array
    before: Array


@public
@dataclasses.dataclass(frozen=True, eq=False, init=False, repr=False)
class Descent(Shown, Leaves):
    """An optimiser for a problem: `begin` with unknowns, then call it for step after step.

    Both are pure: ``jax.jit(descent)``, ``jax.vmap`` of it, ``lax.scan`` over keys.
    """

    problem: Problem
    optimiser: Optimiser
    batch: int | None  # how many targets count in a step
    tolerance: float  # norm of the projected gradient at an end
    bounds: Bounds
    equal: np.ndarray  # which of the conditions' numbers must be zero, (k,)

    def __init__(self, problem: Problem, optimiser: object, batch: int | None = None, gradient: float = 1e-8):
        """Put them together.

        Args:
            problem: what is wanted.
            optimiser: an optax transformation; its rates are parts of the unknowns' scales, see `Problem.scale`.
            batch: how many of the targets count in a step, drawn anew each time; all if not given.
            gradient: norm of the projected gradient at which a design is at its end.

        Raises:
            InputError: no problem, no optax transformation, a batch of more targets than there are.
        """
        what = "Descent"
        check_problem(what, problem, squares=False)
        check_limit(what, _GRADIENT, gradient=gradient)
        if batch is not None:
            check_counts(what, batch=batch)
            if not problem.by_target:
                raise InputError(
                    f"{what}: batch={batch}, and {problem.name} has no targets of its own to choose from: draw them in "
                    f"the function: Loss(mechanism, function) calls function(system, key)"
                )
            if batch >= problem.targets:
                raise InputError(
                    f"{what}: batch={batch} of {problem.targets} targets; leave it out, or give a smaller number"
                )
        # Of a batch conditions at the targets have fewer numbers.
        motions = problem.still
        if batch is not None:
            motions = repeat_drawing(problem, batch), repeat_drawing(problem, problem.poses)
        vars(self).update(
            problem=problem,
            optimiser=Optimiser(what, optimiser),
            batch=batch,
            tolerance=float(gradient),
            bounds=Bounds.of(problem),
            equal=problem.mark_equalities(problem.count_values(*motions)),
        )

    @property
    def random(self) -> bool:
        """True if a step needs a key of random numbers."""
        return self.batch is not None or self.problem.random

    def begin(self, x: ArrayLike | None = None) -> Lane:
        """A design before its first step.

        Args:
            x: unknowns as `Problem.names` names them, ``(n,)``; the idea if not given.
        """
        known = self.problem.start if x is None else x
        if np.shape(known) != (self.problem.count,):
            raise InputError(
                f"Descent: a design has {self.problem.count} unknowns, {', '.join(self.problem.names[:6])} …; "
                f"got shape {np.shape(known)}"
            )
        # Leaves of their own, so that a step may be given them for good.
        return jax.tree.map(jnp.copy, self._begin(jnp.asarray(known, float)))

    def __call__(self, lane: Lane, key: Array | None = None) -> Lane:
        """The design after one more step.

        Args:
            lane: the design.
            key: of random numbers, another one for each step, where the problem or the batch is drawn anew.

        Raises:
            InputError: there is no key and one is needed, or the other way round.
        """
        if self.random and key is None:
            why = f"batch={self.batch} targets are" if self.batch else f"{self.problem.name} is"
            raise InputError(f"Descent: {why} drawn anew at every step: give a key, another one each time")
        if not self.random and key is not None:
            raise InputError(
                f"Descent: {self.problem.name} draws no random numbers: leave out the key, or give batch=, or a Loss "
                f"whose function takes a key"
            )
        return self._step(lane, key)

    def unknowns(self, lane: Lane) -> Array:
        """The unknowns of a design."""
        return lane.y * self.bounds.scale

    def design(self, lane: Lane) -> Any:
        """A design as a `System`."""
        return self.problem.design(self.unknowns(lane))

    # -- inside ----------------------------------------------------------------------------------------------------

    def _begin(self, x: Array) -> Lane:
        y = self.bounds.project(x / self.bounds.scale)
        large, one = jnp.full((), LARGE, y.dtype), jnp.ones((), y.dtype)
        # Strong types, so that the second step is compiled as the first one is.
        memory = jax.tree.map(lambda a: _strong(a, jnp.asarray(a)), self.optimiser.init(y))
        unknown = ("value", "gradient", "violation", "best_value", "best_violation", "merit", "before")
        return Lane(
            **dict.fromkeys(unknown, large),
            **dict.fromkeys(("y", "best", "trial"), y),
            **dict.fromkeys(("memory", "after"), memory),
            outcome=jnp.full((), LOST, jnp.int32),
            steps=jnp.zeros((), jnp.int32),
            over=jnp.zeros((), bool),
            slope=jnp.zeros_like(y),
            share=one,
            multipliers=jnp.zeros(len(self.equal), y.dtype),
            heavy=10.0 * one,  # first weight of a violation
        )

    def _step(self, lane: Lane, key: Array | None) -> Lane:
        """Look at a design's trial and make the next one."""
        look, equal, random, bounds = self._look(lane, key), self.equal, self.random, self.bounds

        def slope_of(y: Array) -> tuple[Array, Array, PyTree]:
            (merit, seen), slope = jax.value_and_grad(look, has_aux=True)(y)
            value, conditions, outcome = seen
            outcome = jnp.where((outcome == GOOD) & ~jnp.all(jnp.isfinite(slope)), NO_SLOPE, outcome)
            good = outcome == GOOD
            return jnp.where(good, merit, LARGE), jnp.where(good, slope, 0.0), (value, conditions, outcome)

        @jax.custom_jvp
        def merit_of(y: Array) -> Array:
            return look(y)[0]

        @merit_of.defjvp
        def _(primals: Any, tangents: Any) -> Any:
            merit, slope, _ = slope_of(primals[0])
            return merit, jnp.dot(slope, tangents[0])

        new, new_slope, (value, conditions, outcome) = slope_of(lane.trial)
        good = (outcome == GOOD) & ~lane.over
        pick = lambda a, b: jnp.where(good, a, b)  # noqa: E731
        y, slope, merit = pick(lane.trial, lane.y), pick(new_slope, lane.slope), pick(new, lane.merit)
        memory = jax.tree.map(pick, lane.after, lane.memory)
        far = jnp.max(jnp.where(equal, jnp.abs(conditions), -conditions), initial=0.0)
        left = bounds.distance_down(y, slope)
        # a step that is taken back becomes 0.25 times as long
        share = jnp.where(lane.over, lane.share, pick(jnp.minimum(2.0 * lane.share, 1.0), 0.25 * lane.share))

        meets = jnp.maximum(far, MEETS)
        better = good & (
            random | (meets < lane.best_violation) | ((meets == lane.best_violation) & (value < lane.best_value))
        )
        over = lane.over | (share < 1e-9) | ((lane.steps == 0) & ~good)  # below 1e-9 of a step none is possible
        if not random:
            over = over | (good & (left <= self.tolerance) & (far <= MEETS))

        searches = False

        def looked_at(y: Array) -> Array:
            nonlocal searches
            searches = True
            return jnp.sum(y)

        # An optimiser that gives unknowns rates of their own would be turned along a bound by the gradient across it.
        # One that searches along lines has to know the gradient of what it looks at.
        jax.eval_shape(lambda: self.optimiser.updates(slope, memory, y, merit, looked_at))  # nothing of the loss
        along = slope if searches else bounds.slope_along(y, slope)
        moves, after = self.optimiser.updates(along, memory, y, merit, merit_of)
        moves = jnp.where(jnp.isfinite(moves), moves, 0.0)
        after = jax.tree.map(_strong, after, memory)
        trial = bounds.project(y + share * moves)

        multipliers, heavy, before = lane.multipliers, lane.heavy, lane.before
        if len(equal) and not random:
            # 50 steps, or a gradient of 1e-2 of the violation, which is level enough to change multipliers at once
            due = good & (((lane.steps + 1) % 50 == 0) | (left <= jnp.maximum(1e-2 * far, self.tolerance)))
            wanted = multipliers - heavy * self._with_margin(conditions)
            multipliers = jnp.where(due, jnp.where(equal, wanted, jnp.maximum(wanted, 0.0)), multipliers)
            times = 4.0  # heavier, where a round has not made the violation so many times smaller
            more = due & (far > MEETS) & (times * far > before)
            heavy = jnp.where(more, jnp.minimum(times * heavy, 1e6), heavy)
            before = jnp.where(due, far, before)
        return Lane(
            y=y,
            value=jnp.where(good | (random & (outcome == GOOD)), value, lane.value),
            gradient=pick(left, lane.gradient),
            violation=pick(far, lane.violation),
            outcome=outcome.astype(jnp.int32),
            steps=jnp.where(lane.over, lane.steps, lane.steps + 1),
            over=over,
            best=jnp.where(better, y, lane.best),
            best_value=jnp.where(better, value, lane.best_value),
            best_violation=jnp.where(better, meets, lane.best_violation),
            trial=jnp.where(over, y, trial),
            slope=slope,
            merit=merit,
            memory=memory,
            after=after,
            share=share,
            multipliers=multipliers,
            heavy=heavy,
            before=before,
        )

    def _look(self, lane: Lane, key: Array | None) -> Callable[[Array], tuple[Array, PyTree]]:
        """Make the function of unknowns in their scales: value with conditions, large where a design is lost."""
        problem, targets, own = self.problem, None, key
        if self.batch is not None:
            assert key is not None
            first, own = jax.random.split(key)
            # One of each of as many equal parts of them, so that every target counts as often.
            parts = jnp.arange(self.batch) + jax.random.uniform(first, (self.batch,))
            targets = jnp.minimum(parts * (problem.targets / self.batch), problem.targets - 1).astype(jnp.int32)

        def look(y: Array) -> tuple[Array, PyTree]:
            value, conditions, found = problem.cost(y * self.bounds.scale, own if problem.random else None, targets)
            heavy, of = lane.heavy, lane.multipliers
            short = of - heavy * self._with_margin(conditions)
            terms = jnp.where(self.equal, short, jnp.maximum(short, 0.0)) ** 2 - of**2
            merit = value + jnp.sum(terms) / (2.0 * heavy)
            outcome = jnp.where(found, jnp.where(jnp.isfinite(merit), GOOD, NO_VALUE), LOST)
            good = outcome == GOOD
            return jnp.where(good, merit, LARGE), (jnp.where(good, value, LARGE), conditions, outcome)

        return look

    def _with_margin(self, conditions: Array) -> Array:
        """Conditions with a margin on those that are no equations."""
        return conditions - jnp.where(self.equal, 0.0, 1e-4)  # 1e-4 more than they need is asked of inequalities


def _strong(a: Array, like: Array) -> Array:
    """Give numbers a type that is not a weak one."""
    return a if _is_key(like) else lax.convert_element_type(a, like.dtype)


# -- many designs ------------------------------------------------------------------------------------------------------


class DescentLanes:
    """Designs under way, all in one compiled step, and their history."""

    def __init__(self, descent: Descent, key: Array, patience: int | None):
        leaves, structure = jax.tree.flatten(descent)
        self.descent: Descent = jax.tree.unflatten(structure, on_device(leaves))
        self.problem, self.key, self.patience = descent.problem, key, patience
        self.rows: list[np.ndarray] = []
        self.times: list[float] = []
        self.done = self.broken = self.count = 0
        self.each = np.inf  # seconds that a step takes
        self.first = True
        self.idle = np.zeros(0, bool)

    def begin(self, x: np.ndarray, lanes: int) -> None:
        """Put designs into so many lanes; what they do not fill has come to its end."""
        self.count = len(x)
        at = np.minimum(np.arange(lanes), len(x) - 1)
        self.lanes = _with_over(_begin_all(self.descent, on_device(x[at])), np.arange(lanes) >= len(x))
        self.idle = np.zeros(lanes, bool)

    @property
    def busy(self) -> bool:
        """True as long as a design is under way."""
        return not bool(np.asarray(self.lanes.over).all())

    def go(self, most: int) -> None:
        """Take some steps, not more than `most` altogether."""
        count = 1 if not np.isfinite(self.each) else int(np.clip(_LASTING / self.each, 1, _ROOM))
        count = min(count, most - self.done)
        if self.patience is not None:
            count = min(count, self.patience - self.done % self.patience)
        begin = time.perf_counter()
        new = self._take_steps(self.done, count)
        if not self.first:  # the first of them was compiled
            self.each = (time.perf_counter() - begin) / count
        elif self.done:
            self.each = _LASTING
        self.first, self.done = False, self.done + count
        self.rows.append(new)
        self.broken += int((new[:, : self.count, 3] == NO_SLOPE).sum())
        if self.done == count:
            self._check_start(new[0, : self.count, 3])
        if self.patience is not None and self.done % self.patience == 0:
            self._tire()

    def note_time(self, seconds: float) -> None:
        """Note when the last steps were taken."""
        before, count = (self.times[-1] if self.times else 0.0), len(self.rows[-1])
        self.times += [before + (seconds - before) * (k + 1) / count for k in range(count)]

    def best(self) -> float:
        """The least value of a design that meets its conditions; of samples their average over some steps."""
        if self.descent.random:
            last = 20  # steps over which values that are samples are averaged
            few = np.concatenate(self.rows[-last:])[-last:, : self.count]
            return float(np.min(np.mean(few[..., 0], axis=0)))
        meets = np.asarray(self.lanes.best_violation) <= MEETS
        return float(np.min(np.asarray(self.lanes.best_value)[meets], initial=np.inf))

    def ends(self, stopped: str) -> list[End]:
        """Ends of the designs that assemble."""
        lanes, random = self.lanes, self.descent.random
        y = np.asarray(lanes.y if random else lanes.best) * np.asarray(self.descent.bounds.scale)
        value, far = (np.asarray(a) for a in (lanes.best_value, lanes.best_violation))
        left, steps, over = (np.asarray(a) for a in (lanes.gradient, lanes.steps, lanes.over))
        lost = np.asarray(lanes.merit if random else lanes.best_value) >= LARGE
        if random and self.rows:
            self.lanes = _with_over(lanes, np.ones(len(y), bool))
            later = 1 << 30  # number of the first of these samples
            often = 64  # a value that is drawn anew at every step is drawn so often, to rank designs
            parts = [self._take_steps(later + k, min(_ROOM, often - k)) for k in range(0, often, _ROOM)]
            self.lanes, samples = lanes, np.concatenate(parts)
            value, far = np.mean(samples[..., 0], axis=0), np.asarray(lanes.violation)
        out = []
        for k in np.flatnonzero(~lost[: self.count]):
            level = left[k] <= self.descent.tolerance and far[k] <= MEETS and not random
            end = "" if level else f"{steps[k]} steps"
            if end and self.idle[k]:
                end = f"no progress in {self.patience} steps"
            elif end and over[k]:
                end = "no step is possible"
            elif end and stopped:
                end = stopped
            out.append(End(y[k], float(value[k]), float(left[k]), np.nan, float(far[k]), int(steps[k]), end))
        return out

    def steps(self) -> Steps:
        """The history so far."""
        rows = np.concatenate(self.rows)[:, : self.count] if self.rows else np.zeros((0, self.count, 5))
        under = rows[..., 4] > 0.0
        value, left, far = (np.where(under & (rows[..., k] < LARGE), rows[..., k], np.nan) for k in range(3))
        shown = (np.sqrt(value) if self.problem.minimax else value) * self.problem.reported_error(1.0)
        times = np.array([*self.times, *(self.times[-1:] or [0.0]) * (len(rows) - len(self.times))])
        return Steps(shown, left, far, under & (rows[..., 3] == 0), times, self.descent.random)

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Write everything that decides how it goes on, as arrays by name."""
        leaves = [np.asarray(jax.random.key_data(a) if _is_key(a) else a) for a in jax.tree.leaves(self.lanes)]
        rows = np.concatenate(self.rows) if self.rows else np.zeros((0, len(self.idle), 5))
        own = {"rows": rows, "times": np.array(self.times), "idle": self.idle, "broken": np.array(self.broken)}
        return own | {f"lane.{k}": a for k, a in enumerate(leaves)}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go back to what `to_arrays` returned."""
        old, structure = jax.tree.flatten(self.lanes)
        new = [on_device(arrays[f"lane.{k}"]) for k in range(len(old))]
        new = [
            jax.random.wrap_key_data(a, impl=jax.random.key_impl(b)) if _is_key(b) else a
            for a, b in zip(new, old, strict=True)
        ]
        self.lanes = jax.tree.unflatten(structure, new)
        self.rows, self.times = [arrays["rows"]], arrays["times"].tolist()
        self.idle, self.broken, self.done = arrays["idle"].copy(), int(arrays["broken"]), len(arrays["rows"])

    def _take_steps(self, first: int, count: int) -> np.ndarray:
        """Take so many steps from the one with this number on; what was seen, ``(count, lanes, 5)``."""
        self.lanes, seen = _step_all(self.descent, self.lanes, self.key, np.int32(first), np.int32(count))
        return np.asarray(seen)[:count]

    def _check_start(self, outcome: np.ndarray) -> None:
        """Refuse a problem of which nothing is finite at any start."""
        if (outcome == LOST).any() or (outcome == GOOD).any():
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
        # a gain of less than 1e-3 of the value in `patience` steps is no progress
        tired = ~over & ~(now < before - 1e-3 * np.abs(before))
        self.idle |= tired
        self.lanes = _with_over(self.lanes, over | tired)


@jit
def _begin_all(descent: Descent, x: Array) -> Lane:
    return jax.vmap(descent._begin)(x)


@jit
def _step_all(descent: Descent, lanes: Lane, key: Array, first: Array, count: Array) -> tuple[Lane, Array]:
    def step(k: Array, state: tuple[Lane, Array]) -> tuple[Lane, Array]:
        lanes, seen = state
        own = jax.random.fold_in(key, first + k) if descent.random else None
        under = ~lanes.over
        new = jax.vmap(lambda lane: descent._step(lane, own))(lanes)
        row = jnp.stack([new.value, new.gradient, new.violation, new.outcome, under], axis=1)
        return new, seen.at[k].set(row.astype(seen.dtype))

    seen = jnp.zeros((_ROOM, lanes.y.shape[0], 5), lanes.y.dtype)
    return lax.fori_loop(0, count, step, (lanes, seen))


def _with_over(lanes: Lane, over: np.ndarray) -> Lane:
    return dataclasses.replace(lanes, over=on_device(over))


# -- from starts to a table --------------------------------------------------------------------------------------------


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
    check_problem(what, problem, squares=False)
    check_counts(what, steps=steps, keep=keep, **({} if patience is None else {"patience": patience}))
    check_limit(what, _GRADIENT, gradient=gradient)
    if enough is not None:
        check_limit(what, "an error to stop at, or None", -np.inf, enough=enough)
    if not outermost() or any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((problem, starts, key))):
        raise InputError(
            f"{what} is a loop in Python and needs numbers; in traced code take steps of your own: "
            f"lane = descent.begin(x), then lane = descent(lane), of descent = nc.synthesis.Descent(problem, optimiser)"
        )
    course, seed = Course(problem, as_time_limit(what, seconds), checkpoint), as_seed(what, key)
    descent = Descent(problem, optimiser, batch, gradient)
    run = DescentLanes(descent, jax.random.key(0) if key is None else key, patience)
    given = None if isinstance(starts, (int, np.integer)) else _unknowns(problem, starts)
    if given is None:
        check_counts(what, starts=starts)
    own = {"optimiser": descent.optimiser.digest, "starts": starts if given is None else given.tolist()}
    course.set_terms(**own, batch=batch, gradient=gradient, patience=patience, key=seed)
    looked = 0 if given is not None else 50 * int(starts)  # 50 random designs are looked at for each lane
    try:
        with interruptible():
            x = given
            if x is None:
                x = starting_designs(problem, np.random.default_rng(seed), int(starts), looked)
            if not len(x):
                return Result(problem, (), (), 0, looked, 0, None)
            run.begin(x, len(x) if given is not None else int(starts))
            if resume is not None:
                run.restore(course.resume(resume))
    except KeyboardInterrupt:
        return Result(problem, (), (), 0, 0, 0, None, "interrupted before the first step")
    stopped = ""
    course.show(steps, "step", progress, run.done)
    try:
        while run.done < steps and run.busy and not stopped:
            with interruptible():
                run.go(steps)
            best = course.note(run.done, run.best())
            run.note_time(course.history[-1].seconds)
            stopped = course.out_of_time
            if not stopped and enough is not None and best <= enough:
                stopped = f"stopped at enough={enough:g}"
            course.save(run.to_arrays, every=1.0)  # seconds
    except KeyboardInterrupt:
        stopped = "interrupted"
    course.bar.close()
    if stopped:
        stopped += f" after {run.done} of {steps} steps{course.hint}"
    if course.history:
        course.save(run.to_arrays)
    ends = run.ends(stopped.partition(" ")[0])
    designs = judge(problem, [basin for basin, _ in distinct_basins(problem, [(end, 1) for end in ends])][: 2 * keep])
    if not stopped.startswith("interrupted"):
        designs = list_once(problem, designs)
    return Result(
        problem=problem,
        designs=tuple(designs[:keep]),
        history=tuple(course.history),
        refined=run.count,
        screened=looked,
        broken=run.broken,
        nearest=None,
        stopped=stopped,
        steps=run.steps(),
    )


def starting_designs(problem: Problem, rng: np.random.Generator, lanes: int, looks: int) -> np.ndarray:
    """The idea, and the most promising random designs that assemble, ``(lanes or fewer, n)``."""
    own = initial_guess(problem, rng)
    # 4 times as many as there are lanes, of which those that assemble are taken
    x = screen(problem, rng, looks, 4 * lanes).x if lanes > 1 else own[:0]
    every = np.clip(np.concatenate([own, x]), problem.low, problem.high)
    every = np.stack(reseat_targets(problem, list(every)))
    good = np.all(solve_poses(problem, every, 0).status == 0, axis=1)
    own, x = every[: len(own)][good[: len(own)]], every[len(own) :][good[len(own) :]]
    return np.concatenate([own[:1], x])[:lanes]


def _unknowns(problem: Problem, starts: object) -> np.ndarray:
    """Starts that were given."""
    x = as_floats(
        [getattr(one, "x", one) for one in starts] if isinstance(starts, Sequence) else starts,
        f"descend: starts={starts!r}; it must be a number of designs, or their unknowns, (lanes, {problem.count})",
    )
    x = x.reshape(0, problem.count) if not x.size else np.atleast_2d(x)
    if x.ndim != 2 or x.shape[1] != problem.count or not len(x) or not np.isfinite(x).all():
        raise InputError(
            f"descend: starts must be finite unknowns of designs, shape (lanes, {problem.count}), each "
            f"{', '.join(problem.names[:6])}{' …' if problem.count > 6 else ''}; got shape {x.shape}"
        )
    return x
