"""Any JAX function of a design as a problem for `descend`: what it returns is made small."""

import dataclasses
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.asking import ask, real
from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.redesign import attached
from jaxnc.mechanism import Mechanism
from jaxnc.solvers.assembly import derive, settle
from jaxnc.solvers.newton import tolerance
from jaxnc.solvers.plan import plan
from jaxnc.status import Status
from jaxnc.synthesis.conditions import Condition
from jaxnc.synthesis.problem import Extras, Problem, moving, system_home
from jaxnc.synthesis.statement import set_up, state
from jaxnc.system.system import System
from jaxnc.types import Array


@public
@dataclasses.dataclass(frozen=True, eq=False, init=False, repr=False)
class Loss(Problem):
    """One number that a function of a design returns, to be made small by `descend`.

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
        function: Callable[..., Any],
        input: str | None = None,
        free: Sequence[str] | None = None,
        bounds: Mapping[str, Any] | None = None,
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
        parts = set_up(what, mechanism, input, free, bounds, subject_to, hold, travel)
        own = {
            **parts,
            "extras": Extras.none(),
            "size": 1.0,
            "minimax": False,
            "dense": False,
            "weights": np.ones(1),
            "function": function,
            "random": _arguments(function) == 2,
        }
        state(self, own)

    @property
    def unit(self) -> str:
        return ""

    def shown(self, square: float) -> float:
        return float(square)

    def inputs(self, extra: Any) -> Any:
        return np.asarray(system_home(self.system, self.driven)).reshape(1)

    def moves(self, x: Array, poses: int) -> tuple[Motion, Motion | None]:
        z, extra = self.split(x)
        system = self.designed(z)
        eq = derive(system)
        found = settle(eq, np.zeros(eq.home.shape), repair=False)
        view = plan(system.topology, (self.driven,), self.hold, system.degrees_of_freedom)
        # The pose that is drawn: its inputs change with the drawing, all else with these and the lengths.
        known = eq.home + jax.lax.stop_gradient(found.q - eq.home)
        good = found.gap <= 1e3 * tolerance(eq, found.q)
        status = jnp.where(good, int(Status.CONVERGED), int(Status.DID_NOT_ASSEMBLE))[None]
        zero, asked = jnp.zeros(1), known[view.known[:1]]
        motion = moving(system, self.driven, self.hold, known[None], status, asked, zero, zero)
        return attached(motion, system, asked[None]), self.turned(system, extra, poses)

    def misses(self, motion: Motion, extra: Array) -> Array:
        return jnp.zeros((1,))

    def value(self, system: System, key: Array | None = None) -> Array:
        """What the function returns for a design; pure.

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
        found = ask(self.function, self.name, takes, *given)
        value = real(found, f"{self.name}: the function", "one number")
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
        motion, turn = self.moves(x, self.poses)
        return value, jnp.concatenate([*self.met(motion, turn)]), jnp.all(motion.converged)


def _arguments(function: Callable[..., Any]) -> int:
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
