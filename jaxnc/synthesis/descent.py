"""Steps of any optax optimiser for a problem: pure, for many designs at once, and for loops of your own.

Unknowns are divided by their scales, so that a rate is a part of the drawing's size. After each step they are projected
on boxes and bounds of lengths; other conditions make an augmented Lagrangian. A step to a design that does not
assemble is taken back, and the next one is shorter: such a design has a large value and no gradient.

Source: J. Nocedal and S. J. Wright, Numerical Optimization, 2nd ed., 2006, section 17.4 (augmented Lagrangian).
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.notebooks import Shown
from jaxnc.records import record
from jaxnc.synthesis.bounds import Walls
from jaxnc.synthesis.optimiser import Optimiser
from jaxnc.synthesis.problem import Problem, resting
from jaxnc.synthesis.pytree import shapes
from jaxnc.synthesis.settings import at_least_one, problem_given
from jaxnc.types import Array, ArrayLike

LARGE = 1e15  # the value of a design that does not assemble
GOOD, LOST, NO_VALUE, NO_SLOPE = range(4)  # what became of a trial
_MARGIN = 1e-4  # by which inequalities are asked for more than they need
_HEAVY = 10.0  # first weight of a violation
_HEAVIEST = 1e6
_HEAVIER = 4.0  # times, where a round has not made the violation so many times smaller
_ROUND = 50  # steps between changes of multipliers, at most
_LEVEL = 1e-2  # of the violation: a gradient so small is level enough to change them at once
_SHORTER = 0.25  # times, after a step that is taken back
_SHORTEST = 1e-9  # part of a step: below it none is possible
MEETS = 1e-7  # violation that is none


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
    memory: Any
    after: Any
    share: Array
    multipliers: Array
    heavy: Array
    before: Array


@public
class Descent(Shown):
    """An optimiser for a problem: `begin` with unknowns, then call it for step after step.

    Both are pure: ``jax.jit(descent)``, ``jax.vmap`` of it, ``lax.scan`` over keys.
    """

    def __init__(self, problem: Problem, optimiser: Any, batch: int | None = None, gradient: float = 1e-8):
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
        problem_given(what, problem, squares=False)
        tolerance_given(what, gradient)
        if batch is not None:
            at_least_one(what, batch=batch)
            if not problem.by_target:
                raise InputError(
                    f"{what}: batch={batch}, and {problem.name} has no targets of its own to choose from: draw them in "
                    f"the function: Loss(mechanism, function) calls function(system, key)"
                )
            if batch >= problem.targets:
                raise InputError(
                    f"{what}: batch={batch} of {problem.targets} targets; leave it out, or give a smaller number"
                )
        self.problem, self.batch, self.tolerance = problem, batch, float(gradient)
        self.optimiser, self.walls = Optimiser(what, optimiser), Walls.of(problem)
        self.equal = _equal(problem, batch)

    @property
    def random(self) -> bool:
        """Whether a step needs a key of random numbers."""
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
        return begun(self.optimiser, self.walls, len(self.equal), jnp.asarray(known, float))

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
        return stepped(self.problem, self.optimiser, self.walls, self.equal, self.batch, self.tolerance, lane, key)

    def unknowns(self, lane: Lane) -> Array:
        """The unknowns of a design."""
        return lane.y * self.walls.scale

    def design(self, lane: Lane) -> Any:
        """A design as a `System`."""
        return self.problem.design(self.unknowns(lane))


def tolerance_given(what: str, gradient: Any) -> None:
    """See that a norm to stop at is one."""
    if isinstance(gradient, bool) or not isinstance(gradient, (int, float, np.number)) or not gradient >= 0:
        raise InputError(f"{what}: gradient={gradient!r}; it must be a norm to stop at, 0 or a positive number")


def begun(optimiser: Optimiser, walls: Walls, conditions: int, x: Array) -> Lane:
    """A design before its first step."""
    y = walls.projected(x / walls.scale)
    large, none = jnp.full((), LARGE, y.dtype), jnp.zeros((), y.dtype)
    # Strong types, so that the second step is compiled as the first one is.
    memory = jax.tree.map(lambda a: _typed(a, jnp.asarray(a)), optimiser.init(y))
    return Lane(
        y=y,
        value=large,
        gradient=large,
        violation=large,
        outcome=jnp.full((), LOST, jnp.int32),
        steps=jnp.zeros((), jnp.int32),
        over=jnp.zeros((), bool),
        best=y,
        best_value=large,
        best_violation=large,
        trial=y,
        slope=jnp.zeros_like(y),
        merit=large,
        memory=memory,
        after=memory,
        share=none + 1.0,
        multipliers=jnp.zeros(conditions, y.dtype),
        heavy=none + _HEAVY,
        before=large,
    )


def stepped(
    problem: Problem,
    optimiser: Optimiser,
    walls: Walls,
    equal: np.ndarray,
    batch: int | None,
    tolerance: Any,
    lane: Lane,
    key: Array | None,
) -> Lane:
    """A design after one more step: its trial looked at, and the next one made.

    Of the conditions' numbers those that must be zero are `equal`, ``(k,)``; so many targets count as a `batch`, None
    for all.
    """
    random = batch is not None or problem.random
    sighted = _sighted(problem, walls, equal, batch, lane, key)

    def slope_of(y: Array) -> tuple[Array, Array, Any]:
        (merit, seen), slope = jax.value_and_grad(sighted, has_aux=True)(y)
        value, conditions, outcome = seen
        outcome = jnp.where((outcome == GOOD) & ~jnp.all(jnp.isfinite(slope)), NO_SLOPE, outcome)
        good = outcome == GOOD
        return jnp.where(good, merit, LARGE), jnp.where(good, slope, 0.0), (value, conditions, outcome)

    @jax.custom_jvp
    def merit_of(y: Array) -> Array:
        return sighted(y)[0]

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
    left = walls.left(y, slope)
    share = jnp.where(lane.over, lane.share, pick(jnp.minimum(2.0 * lane.share, 1.0), _SHORTER * lane.share))

    meets = jnp.maximum(far, MEETS)
    better = good & (
        random | (meets < lane.best_violation) | ((meets == lane.best_violation) & (value < lane.best_value))
    )
    over = lane.over | (share < _SHORTEST) | ((lane.steps == 0) & ~good)
    if not random:
        over = over | (good & (left <= tolerance) & (far <= MEETS))

    moves, after = optimiser.updates(slope, memory, y, merit, merit_of)
    moves = jnp.where(jnp.isfinite(moves), moves, 0.0)
    after = jax.tree.map(_typed, after, memory)
    trial = walls.projected(y + share * moves)

    multipliers, heavy, before = lane.multipliers, lane.heavy, lane.before
    if len(equal) and not random:
        due = good & (((lane.steps + 1) % _ROUND == 0) | (left <= jnp.maximum(_LEVEL * far, tolerance)))
        wanted = multipliers - heavy * _asked(conditions, equal)
        multipliers = jnp.where(due, jnp.where(equal, wanted, jnp.maximum(wanted, 0.0)), multipliers)
        more = due & (far > MEETS) & (_HEAVIER * far > before)
        heavy, before = jnp.where(more, jnp.minimum(_HEAVIER * heavy, _HEAVIEST), heavy), jnp.where(due, far, before)
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


def _sighted(
    problem: Problem, walls: Walls, equal: np.ndarray, batch: int | None, lane: Lane, key: Array | None
) -> Callable[[Array], tuple[Array, Any]]:
    """Value with conditions, of unknowns in their scales; large where a design does not assemble or is not finite."""
    targets, own = None, key
    if batch is not None:
        assert key is not None
        first, own = jax.random.split(key)
        # One of each of as many equal parts of them, so that every target counts as often.
        parts = jnp.arange(batch) + jax.random.uniform(first, (batch,))
        targets = jnp.minimum(parts * (problem.targets / batch), problem.targets - 1).astype(jnp.int32)

    def sighted(y: Array) -> tuple[Array, Any]:
        value, conditions, found = problem.cost(y * walls.scale, own if problem.random else None, targets)
        heavy, of = lane.heavy, lane.multipliers
        short = of - heavy * _asked(conditions, equal)
        terms = jnp.where(equal, short, jnp.maximum(short, 0.0)) ** 2 - of**2
        merit = value + jnp.sum(terms) / (2.0 * heavy)
        finite = jnp.isfinite(merit)
        outcome = jnp.where(found, jnp.where(finite, GOOD, NO_VALUE), LOST)
        good = outcome == GOOD
        return jnp.where(good, merit, LARGE), (jnp.where(good, value, LARGE), conditions, outcome)

    return sighted


def _asked(conditions: Array, equal: np.ndarray) -> Array:
    """Conditions with a margin on those that are no equations."""
    return conditions - jnp.where(equal, 0.0, _MARGIN)


def _equal(problem: Problem, batch: int | None) -> np.ndarray:
    """Which of the conditions' numbers must be zero, where so many targets count, ``(k,)``."""
    if batch is None or not problem.conditions:
        return problem.equalities
    some = [resting(problem.system, problem.driven, problem.hold, n) for n in (batch, problem.poses)]
    counts = [s.shape[0] for s in shapes(_met, problem, some[0], some[1] if problem.poses else None)]
    equal = [c.equality for c, count in zip(problem.conditions, counts, strict=True) for _ in range(count)]
    own = len(problem.equalities) - sum(problem.counts)
    return np.array(equal + [False] * own, bool)


def _met(problem: Problem, motion: Motion, turn: Motion | None) -> list[Array]:
    return problem.met(motion, turn)


def _typed(a: Any, like: Any) -> Any:
    """The same numbers in a type, which is not a weak one."""
    return a if jnp.issubdtype(like.dtype, jax.dtypes.prng_key) else lax.convert_element_type(a, like.dtype)


def traced(*trees: Any) -> bool:
    """Whether a number in them is traced."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(trees))
