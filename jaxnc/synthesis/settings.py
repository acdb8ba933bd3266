"""How to search, checked before any work: counts, times, keys of random numbers, what is searched for."""

from typing import Any

import jax
import numpy as np

from jaxnc.errors import InputError
from jaxnc.kinematics.inputs import whole
from jaxnc.synthesis.problem import Problem


def problem_given(what: str, problem: Any, squares: bool = True) -> None:
    """See that a problem is one."""
    if squares and isinstance(problem, Problem) and problem.at_rest:
        raise InputError(
            f"{what} makes sums of squares small, and a {type(problem).__name__} is any number: use "
            f"nc.synthesis.descend(loss, optax.adam(1e-2)), or state an Objective"
        )
    if callable(problem) and not isinstance(problem, Problem):
        raise InputError(
            f"{what} takes a problem, got the function {getattr(problem, '__name__', problem)!r}: say of which "
            f"mechanism it is, Loss(mechanism, function), or of its motions, Objective(mechanism, function, values)"
        )
    if not isinstance(problem, Problem):
        raise InputError(
            f"{what} takes a problem, such as PathGeneration(mechanism, 'P', points), got {type(problem).__name__}: "
            f"a mechanism alone does not say what is wanted"
        )


def at_least_one(what: str, **counts: Any) -> None:
    """See that counts are whole numbers of 1 and more."""
    for name, value in counts.items():
        whole(value, f"{what}: {name}")


def seconds_given(what: str, seconds: Any) -> float:
    """A length of time, infinite if there is none."""
    if seconds is None:
        return np.inf
    if isinstance(seconds, bool) or not isinstance(seconds, (int, float, np.number)) or not seconds > 0:
        raise InputError(f"{what}: seconds={seconds!r}; it must be a positive number, or None for no end")
    return float(seconds)


def enough_given(what: str, enough: Any) -> None:
    """See that an error to stop at is one."""
    if isinstance(enough, bool) or not isinstance(enough, (int, float, np.number)) or not enough >= 0:
        raise InputError(f"{what}: enough={enough!r}; it must be an error to stop at, 0 or a positive number")


def seed_of(what: str, key: Any) -> list[int]:
    """The numbers of a key of random numbers, of ``jax.random.key(0)`` if there is none."""
    if key is None:
        key = jax.random.key(0)
    try:
        found = np.asarray(jax.random.key_data(key))
    except (TypeError, ValueError, OverflowError):
        found = np.zeros(0)
    if found.ndim != 1 or not found.size:
        number = int(key) if isinstance(key, (int, np.integer)) and not isinstance(key, bool) else 0
        raise InputError(f"{what}: key={key!r} is no key of random numbers; write key=jax.random.key({number})")
    return found.astype(np.uint32).tolist()
