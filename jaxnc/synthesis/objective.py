"""Any function as a problem: of a motion, in least squares (`Objective`); of a design, one number (`Loss`)."""

import dataclasses
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import jit
from jaxnc.errors import InputError
from jaxnc.kinematics.design import attach_poses
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.solvers.assembly import derive, settle
from jaxnc.solvers.newton import tolerance
from jaxnc.solvers.plan import plan
from jaxnc.status import Status
from jaxnc.synthesis.conditions import Condition
from jaxnc.synthesis.evaluate import move_designs
from jaxnc.synthesis.problem import Problem, home_value, make_motion
from jaxnc.synthesis.statement import complete, set_up
from jaxnc.synthesis.validate import as_sequence, as_weights, call_on_motion, check_radians
from jaxnc.system.system import System
from jaxnc.types import Array, ArrayLike, Numbers
from jaxnc.validate import as_array, as_real, call_user, function_name


@public
@dataclasses.dataclass(frozen=True, eq=False, init=False, repr=False)
class Objective(Problem):
    """Residuals of a motion, to be made small.

    Attributes:
        residuals: functions of a motion.
        values: of the input.
    """

    by_target = ()
    residuals: tuple[Callable[[Motion], Any], ...]
    values: np.ndarray

    def __init__(
        self,
        mechanism: Mechanism | System,
        residuals: Callable[[Motion], ArrayLike] | Sequence[Callable[[Motion], ArrayLike]],
        values: ArrayLike,
        weights: Sequence[float] | None = None,
        input: str | None = None,
        free: Sequence[str] | None = None,
        bounds: Mapping[str, Sequence[float | None]] | None = None,
        subject_to: Sequence[Condition] = (),
        hold: Sequence[str] = (),
        minimax: bool = False,
    ):
        """State the problem.

        Args:
            mechanism: the starting idea, as a `Mechanism` or compiled.
            residuals: a function of the motion over `values` that returns an array; the sum of its squares is made
                small. Several functions are several objectives, weighted.
            values: of the input, in the order in which they are gone through, ``(T,)``.
            weights: of the squares of each function; ones if not given.
            input: name of the driven coordinate; may be left out where the mechanism has one only.
            free: names of what may change; all if not given.
            bounds: as in `PathGeneration`.
            subject_to: conditions; those over a range look at the range of `values`.
            hold: free coordinates that keep their start values.
            minimax: make the largest number small rather than the sum of squares.

        Raises:
            InputError: unknown names, a function that returns nothing finite for the starting idea.
        """
        what = "Objective"
        values = as_array(values, f"{what}: values")
        if values.ndim == 0:
            raise InputError(
                f"{what}: values={values}: expected values of the input in order, such as np.linspace(0.0, 6.28, 49)"
            )
        if not values.size:
            raise InputError(f"{what}: values is empty; give those of the input at which the residuals are taken")
        table = as_sequence(values, values.size, f"{what}: values")
        functions = (residuals,) if callable(residuals) else tuple(residuals if np.iterable(residuals) else ())
        if not functions or not all(callable(f) for f in functions):
            raise InputError(f"{what}: residuals must be a function of a motion, or several, got {residuals!r}")
        share = as_weights(weights, len(functions), what)
        set_up(self, what, mechanism, input, free, bounds, subject_to, hold, table=table)
        turn = 4 * np.pi if self.periodic else np.inf
        check_radians(table, f"{what}: values", turn, "state one turn, which the others repeat")
        complete(self, minimax=minimax, residuals=functions, weights=tuple(share.tolist()), values=table)
        found = _compiled_errors(self, move_designs(self, [self.start])[0].motion)
        if not found.size:
            raise InputError(f"{what}: the residuals are arrays of no numbers, and there is nothing to make small")
        if not np.isfinite(np.asarray(found)).all():
            raise InputError(f"{what}: the residuals of the starting idea are not finite")

    @property
    def unit(self) -> str:
        return ""

    def inputs(self, extra: Numbers) -> Any:
        return self.values

    def misses(self, motion: Motion, extra: Array) -> Array:
        return jnp.concatenate([_residual_numbers(f, motion) for f in self.residuals])

    def errors(self, motion: Motion, extra: Array) -> Array:
        return jnp.concatenate(self.pieces(motion))

    def pieces(self, motion: Motion) -> list[Array]:
        """The errors of each function, weighted."""
        return [_residual_numbers(f, motion) * jnp.sqrt(w) for f, w in zip(self.residuals, self.weights, strict=True)]


def _residual_numbers(residual: Callable[[Motion], ArrayLike], motion: Motion) -> Array:
    return jnp.ravel(call_on_motion(residual, f"Objective: residual {function_name(residual)}", motion))


@jit
def _compiled_errors(problem: Objective, motion: Motion) -> Array:
    return problem.errors(motion, jnp.zeros(0))


@public
@dataclasses.dataclass(frozen=True, eq=False, init=False, repr=False)
class Loss(Problem):
    """A number that a function of a design returns, to be made small by `descend`.

    Attributes:
        function: of a system, or of a system and a key of random numbers.
        random: whether it takes a key, another one at each step.
    """

    at_rest = True
    by_target = ()
    function: Callable[..., Any]
    random: bool

    def __init__(
        self,
        mechanism: Mechanism | System,
        function: Callable,
        input: str | None = None,
        free: Sequence[str] | None = None,
        bounds: Mapping[str, Sequence[float | None]] | None = None,
        subject_to: Sequence[Condition] = (),
        hold: Sequence[str] = (),
        travel: tuple[float, float] | None = None,
    ):
        """State the problem.

        Args:
            mechanism: the starting idea, as a `Mechanism` or compiled.
            function: pure and differentiable, ``function(system)`` or ``function(system, key)``; returns one number.
                An infinite number says that a design cannot be used.
            input: name of the coordinate that moves in conditions over a range and in pictures; may be left out where
                the mechanism has one only.
            free: names of what may change; all if not given.
            bounds: as in `PathGeneration`.
            subject_to: conditions; those about poses look at the drawing.
            hold: free coordinates that keep their start values there.
            travel: range of the input that conditions look at; a full turn from the drawing where it is an angle.

        Raises:
            InputError: unknown names, something that is no function of one or two arguments.
        """
        what = "Loss"
        if not callable(function):
            raise InputError(
                f"{what}: function must be a function of a system that returns one number, got {function!r}"
            )
        set_up(self, what, mechanism, input, free, bounds, subject_to, hold, travel)
        complete(self, weights=np.ones(1), function=function, random=_argument_count(function) == 2)

    @property
    def unit(self) -> str:
        return ""

    def inputs(self, extra: Numbers) -> Any:
        return np.asarray(home_value(self.system, self.driven)).reshape(1)

    def moves(self, x: Array) -> tuple[Motion, Motion | None]:
        z, extra = self.split(x)
        system = self.designed(z)
        eq = derive(system)
        found = settle(eq, np.zeros(eq.home.shape), repair=False)
        view = plan(system.topology, (self.driven,), self.hold, system.degrees_of_freedom)
        # The pose that is drawn: its inputs change with the drawing, all else with these and the lengths.
        known = eq.home + jax.lax.stop_gradient(found.q - eq.home)
        good = found.gap <= 1e3 * tolerance(eq, found.q)
        status = jnp.where(good, int(Status.CONVERGED), int(Status.DID_NOT_ASSEMBLE))[None]
        asked = known[view.known[:1]]
        motion = make_motion(self, system, known[None], status, asked, jnp.zeros(1))
        return attach_poses(motion, system, asked[None]), self.sweep_range(system, extra)

    def misses(self, motion: Motion, extra: Array) -> Array:
        return jnp.zeros((1,))

    def value(self, system: System, key: Array | None = None) -> Array:
        """Value of the function for a design; pure.

        Args:
            system: the design.
            key: of random numbers, where the function takes one.

        Raises:
            InputError: a key where none is needed or the other way round, or more than one number.
        """
        if self.random != (key is not None):
            raise InputError(
                f"{self.name}: the function takes {'a system and a key: give one' if self.random else 'no key'}"
            )
        given, takes = ((system, key), "system, key") if self.random else ((system,), "system")
        found = call_user(self.function, self.name, takes, *given)
        value = as_real(found, f"{self.name}: the function", "one number")
        if value.shape != ():
            raise InputError(
                f"{self.name}: the function must return one number, and it returned an array of shape {value.shape}: "
                f"take its mean, its largest, or the sum of its squares"
            )
        return value

    def cost(self, x: Array, key: Array | None = None, targets: Array | None = None) -> tuple[Array, Array, Array]:
        value = self.value(self.designed(self.split(x)[0]), key)
        if not self.conditions:
            return value, jnp.zeros(0), jnp.ones((), bool)
        motion, turn = self.moves(x)
        return value, jnp.concatenate([*self.condition_values(motion, turn)]), jnp.all(motion.converged)


def _argument_count(function: Callable) -> int:
    """How many arguments a function must be given, one or two."""
    try:
        taken = inspect.signature(function).parameters.values()
    except (TypeError, ValueError, OverflowError):
        return 1
    places = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    needed = [p.name for p in taken if p.kind in places and p.default is p.empty]
    if len(needed) not in (1, 2):
        raise InputError(
            f"Loss: the function must take a system, or a system and a key of random numbers; it asks for "
            f"{', '.join(needed) or 'nothing'}"
        )
    return len(needed)
