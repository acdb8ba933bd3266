"""Where an analysis begins instead of at the drawing: an earlier pose, or places and values by name, made whole.

What is not given follows from what is: angles and distances are measured at the points, and missing points are begun
from many places, of which the one counts that leads to the assembly nearest to what was given.
"""

import functools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.compiling import jit
from jaxnc.errors import InputError, nearest
from jaxnc.internals import outermost
from jaxnc.kinematics.inputs import array, finite
from jaxnc.kinematics.motion import Motion
from jaxnc.remembered import with_owner
from jaxnc.solvers import host
from jaxnc.solvers.answers import ask_of_equations
from jaxnc.solvers.assembly import closest, hosted
from jaxnc.solvers.host import view_of
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import Equations, guards, measured, weights
from jaxnc.system.host import HostEquations
from jaxnc.system.precision import limits
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Float

_TRIES = 24  # places of the missing points that are begun from, the drawing's among them
_ITERATIONS = 60
_FEW = 64  # guesses that are completed on the host
_FROM_DRAWING = 1e-4  # of assemblies equally near to what was given, the one nearest to the drawing counts


def guessed(
    system: System,
    eq: Equations,
    q: Any,
    guess: Mapping[str, Any] | Motion,
    known: Mapping[str, Array] | None = None,
    held: Sequence[str] = (),
    shape: tuple[int, ...] = (),
    what: str = "start",
) -> Any:
    """Whole poses to begin with, ``(*shape, N)``: NumPy's where they are few and nothing is traced.

    The guess is an earlier pose, or places and values by name; one for all, or one for each of a batch. `known` are
    values of coordinates that are given otherwise, such as inputs; what is held keeps its value in the drawing unless
    the guess has another.
    """
    top = system.topology
    given = guess.poses if isinstance(guess, Motion) else None
    if isinstance(given, np.ndarray) and given.shape == (*shape, len(top.coordinates)):  # as it is asked often
        return given
    few = _on_host(top, (guess, eq, q, known), math.prod(shape))
    if isinstance(guess, Motion):
        if guess.status.shape not in ((), shape):
            expected = f"a single pose, or {shape} of them" if shape else "a single pose"
            raise InputError(f"{what} must be {expected}; this motion has shape {guess.status.shape}")
        numeric: Any = np if few else jnp
        found = guess.poses if isinstance(guess.poses, np.ndarray) else numeric.asarray(guess.q)
        wanted = (*shape, found.shape[-1])
        return found if found.shape == wanted else numeric.broadcast_to(found, wanted)
    if not isinstance(guess, Mapping):
        raise InputError(f"{what} is an earlier pose, or places by name such as {{'B': (0, 1)}}; got {guess!r}")
    if few:
        q = np.array(np.broadcast_to(np.asarray(q), (*shape, len(top.coordinates))))
    else:
        q = jnp.broadcast_to(jnp.asarray(q), (*shape, len(top.coordinates)))

    def put(q: Any, columns: Any, value: Any) -> Any:
        if not few:
            return q.at[..., columns].set(value)
        q[..., columns] = value
        return q

    sure = {top.position[name] for name in (*held, *(known or {}))}
    for name, value in (known or {}).items():
        q = put(q, top.position[name], value)
    given = set(sure)
    for name, value in guess.items():
        columns, value = _entry(top, name, value, shape, what)
        q = put(q, np.array(columns), value)
        given.update(columns)
    complete, flat = _completed_on_host if few else _completed, q.reshape(math.prod(shape), q.shape[-1])
    flat = complete(top.structure, tuple(sorted(sure)), tuple(sorted(given)), eq, flat)
    return flat.reshape(q.shape)


def _entry(top: Topology, name: str, value: Any, shape: tuple[int, ...], what: str) -> tuple[list[int], Array]:
    """Which coordinates a name of a guess stands for, and their values, ``(..., coordinates)``."""
    value = array(value, f"{what} of {name!r}")
    finite(value, f"{what} of {name!r}")
    places = (*top.points, *top.vectors)
    batch = f", or {(*shape, '...')} of them".replace("'", "") if shape else ""
    if name in places:
        if value.shape not in ((top.dim,), (*shape, top.dim)):
            raise InputError(f"{what} of {name!r} must be {top.dim} numbers{batch}, got shape {value.shape}")
        first = places.index(name) * top.dim
        return list(range(first, first + top.dim)), value
    if name in top.position:
        if value.shape not in ((), shape):
            raise InputError(f"{what} of {name!r} must be one number{batch}, got shape {value.shape}")
        return [top.position[name]], value[..., None]
    raise InputError(f"{what}: no point or coordinate {name!r}; {nearest(name, (*places, *top.scalars))}")


def _on_host(top: Topology, given: Any, count: int) -> bool:
    traced = any(isinstance(x, Tracer) for x in jax.tree.leaves(given))
    return outermost() and not traced and (top.large or count <= _FEW)


class _Missing(NamedTuple):
    """What is not given: places of scalars and of points' components; and what is given, but only nearly."""

    # `scalars`, `points`, `nearly`: the places
    scalars: np.ndarray
    points: np.ndarray
    nearly: np.ndarray
    moved: np.ndarray  # where the missing points are begun from, of the size, (tries, points)
    # `beside`, `whole`: plans that hold what is given, and what is sure
    beside: Plan
    whole: Plan


@with_owner
def _missing(top: Topology, sure: tuple[int, ...], given: tuple[int, ...]) -> _Missing:
    first = len(top.coordinates) - len(top.scalars)
    scalars = np.array([c for c in range(first, len(top.coordinates)) if c not in given], int)
    points = np.array([c for c in range(first) if not top.fixed[c] and c not in given], int)
    nearly = np.array([c for c in given if c not in sure], int)
    moved = np.random.default_rng(11).uniform(-1.0, 1.0, (1 if top.large else _TRIES, len(points)))
    moved[0] = 0.0
    beside, whole = (plan(top, (), tuple(top.coordinates[c] for c in w if not top.fixed[c])) for w in (given, sure))
    return _Missing(scalars, points, nearly, moved, beside, whole)


def _completed_on_host(
    top: Topology, sure: tuple[int, ...], given: tuple[int, ...], eq: Equations, q: np.ndarray
) -> np.ndarray:
    return _complete(top, sure, given, hosted(eq), q)


def _complete(
    top: Topology, sure: tuple[int, ...], given: tuple[int, ...], inner: HostEquations, q: np.ndarray
) -> np.ndarray:
    """`_completed` in NumPy: the assemblies from all beginnings side by side."""
    missing = _missing(top, sure, given)
    first = len(top.coordinates) - len(top.scalars)
    scalars, points, moved = missing.scalars, missing.points, missing.moved
    angles, weight = np.array(top.angles, bool)[scalars - first], inner.weights[:, None]

    def with_measures(x: np.ndarray) -> np.ndarray:
        if len(scalars):
            new = inner.measured(x)[scalars - first]
            turns = np.where(angles[:, None], np.round((x[scalars] - new) / (2 * np.pi)), 0.0)
            x[scalars] = new + 2 * np.pi * turns
        return x

    with np.errstate(all="ignore"):
        flat = np.array(q.T, inner.dtype)
        if not len(points):
            return with_measures(flat).T
        beside, whole = view_of(missing.beside, inner), view_of(missing.whole, inner)
        x = np.repeat(flat, len(moved), axis=1)
        start = np.array(x)
        start[points] += np.tile(moved.T, len(q)) * inner.length / weight[points]
        local = with_measures(host.closest(beside, with_measures(start), _ITERATIONS).q)
        found = host.closest(whole, np.where(inner.guards(local)[0], local, start), _ITERATIONS)
        good = inner.guards(found.q)[0] & (found.gap <= limits(flat).close * inner.length)
        away = (weight * (found.q - x) / inner.length) ** 2
        score = np.sum(away[missing.nearly], axis=0) + _FROM_DRAWING * np.sum(away[points], axis=0)
        score = np.where(good & np.isfinite(score), score, np.inf).reshape(len(q), len(moved))
        at = np.arange(len(q)) * len(moved)
        best = np.where(np.isfinite(score.min(axis=1)), at + np.argmin(score, axis=1), -1)
        return np.where(best >= 0, found.q[:, best], local[:, at]).T


@functools.partial(jit, static_argnums=(0, 1, 2))
def _completed(
    top: Topology, sure: tuple[int, ...], given: tuple[int, ...], eq: Equations, q: Float[Array, "B N"]
) -> Array:
    """Poses of which only some coordinates are known, the sure ones exactly and others nearly, with all the rest."""
    eq, first = jax.lax.stop_gradient(eq), len(top.coordinates) - len(top.scalars)
    scalars, points, nearly, moved, beside, whole = _missing(top, sure, given)
    angles = np.array(top.angles, bool)[scalars - first]
    weight = weights(eq)

    def with_measures(x):
        if not len(scalars):
            return x
        new = measured(top, eq.constants, x)[scalars - first]
        turns = jnp.where(angles, jnp.round((x[scalars] - new) / (2 * jnp.pi)), 0.0)  # counted as in the drawing
        return x.at[scalars].set(new + 2 * jnp.pi * turns)

    if not len(points):
        return jax.vmap(with_measures)(q)
    if top.large:
        ask = functools.partial(_complete, top, sure, given)
        return ask_of_equations("completed a start", ask, q.shape, eq, q)

    def upright(x):
        return jnp.all(jnp.concatenate(guards(eq, x)) > 0.0)

    def tried(x, off):
        """An assembly: first what is missing beside what was given, then all of it."""
        start = with_measures(x.at[points].add(off * eq.length / weight[points]))
        local = with_measures(closest(beside, eq, start, _ITERATIONS).q)
        found = closest(whole, eq, jnp.where(upright(local), local, start), _ITERATIONS)
        good = upright(found.q) & (found.gap <= limits(x).close * eq.length)
        away = (weight * (found.q - x) / eq.length) ** 2
        score = jnp.sum(away[nearly]) + _FROM_DRAWING * jnp.sum(away[points])
        return found.q, jnp.where(good & jnp.isfinite(score), score, jnp.inf), local

    def one(x):
        found, score, local = jax.lax.map(functools.partial(tried, x), jnp.asarray(moved))
        return jnp.where(jnp.isfinite(jnp.min(score)), found[jnp.argmin(score)], local[0])

    return jax.vmap(one)(q)
