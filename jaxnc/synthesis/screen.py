"""Screening: thousands of random designs looked at at once, to find starts that are worth refining."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.compiling import jit
from jaxnc.kinematics.redesign import flattened
from jaxnc.synthesis.path import PathGeneration
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.projection import Linear, fitted, linear, moved
from jaxnc.types import Array

_CHUNK = 1024  # designs in one call
_TABLE = 96  # poses of a design's whole curve
_GUESSES = 12  # timings tried for each shape
_AGAIN = 3  # times that timings are taken anew from the curve fitted to them
_NEAR = 10  # poses of the table to both sides in which a nearer one is looked for


def screen(problem: Problem, rng: np.random.Generator, count: int, most: int) -> np.ndarray:
    """Random starts ``(kept, n)``; where a part of the unknowns is linear, the most promising ones first.

    Args:
        problem: the problem.
        rng: of the random numbers.
        count: designs to look at.
        most: how many to keep.
    """
    z = problem.variables.drawn(rng, count)
    found = linear(problem) if type(problem) is PathGeneration else None
    if found is None:
        return np.concatenate([z, problem.guesses(rng, count)], axis=1)
    assert isinstance(problem, PathGeneration)
    each = 1 if problem.timing is not None and not problem.offset else _GUESSES
    guesses = problem.guesses(rng, count * each).reshape(count, each, len(problem.extras.names))
    parts = []
    for first in range(0, count, _CHUNK):
        at = np.minimum(np.arange(first, first + _CHUNK), count - 1)
        parts.append(jax.tree.map(np.asarray, _projected(problem, found, jnp.asarray(z[at]), jnp.asarray(guesses[at]))))
    x, merit = (np.concatenate(p)[:count] for p in zip(*parts, strict=True))
    order = np.argsort(merit, kind="stable")[:most]
    return x[order[np.isfinite(merit[order])]]


@functools.partial(jit, static_argnums=(0, 1))
def _projected(problem: PathGeneration, found: Linear, z: Array, guesses: Array) -> tuple[Array, Array]:
    """Designs with everything linear fitted: unknowns and what error is left."""
    target = jnp.asarray(problem.target @ np.array([1.0, 1j]))
    weights = jnp.asarray(problem.weights)
    top = problem.system.topology
    fixed = problem.timing is not None and not problem.offset
    low, high = problem.travel
    turning = bool(np.isclose(high - low, 2 * np.pi))

    def place(motion, index: int) -> Array:
        name = top.points[index] if index < len(top.points) else problem.point
        return motion[name] @ jnp.array([1.0, 1j])

    def shape(z, guesses):
        system = problem.variables.design(z)
        flat = flattened(system)
        if fixed:
            motion = problem.swept(system, problem.inputs(guesses[0]))
            base = place(motion, found.base[0])
            direction = place(motion, found.base[1]) - base
            z0, w, k, left = fitted(found, base, direction, target, weights)
            ok = jnp.all(motion.converged)
            return _put(problem, found, flat, z0, w, k, guesses[0], left, ok)
        # The whole curve, from which any timing is read.
        from jaxnc.synthesis.problem import system_home

        begin = system_home(system, problem.driven) if turning else low
        values = begin + (high - low) * jnp.arange(_TABLE + 1) / _TABLE
        motion = problem.swept(system, values)
        a = place(motion, found.base[0])
        d = place(motion, found.base[1]) - a
        ok = jnp.all(motion.converged)

        def read(row, u):
            s = (u - begin) / (high - low) * _TABLE
            s = jnp.mod(s, _TABLE) if turning else jnp.clip(s, 0.0, _TABLE)
            i = jnp.clip(jnp.floor(s).astype(int), 0, _TABLE - 1)
            return row[i] + (s - i) * (row[i + 1] - row[i])

        def guess(extra):
            def fit(u):
                return fitted(found, read(a, u), read(d, u), target, weights)

            def nearer(_, u):
                z0, w, k, _ = fit(u)
                curve = z0 + w * a + k * d
                shift = (jnp.arange(-_NEAR, _NEAR + 1)) * (high - low) / _TABLE
                some = u[:, None] + shift
                inside = jnp.ones(some.shape, bool) if turning else (some >= low) & (some <= high)
                off = jnp.where(inside, jnp.abs(read(curve, some) - target[:, None]), jnp.inf)
                new = jnp.take_along_axis(some, jnp.argmin(off, axis=1)[:, None], axis=1)[:, 0]
                way = jnp.where(u[-1] >= u[0], 1.0, -1.0)
                steps = jnp.maximum(way * jnp.diff(new), 0.2 * way * jnp.diff(u))
                total = jnp.sum(steps)
                most = (high - low) * (1.0 - 0.5 / _TABLE if problem.closed else 1.0)
                steps = steps * jnp.minimum(1.0, most / total)
                return jnp.concatenate([new[:1], new[0] + way * jnp.cumsum(steps)])

            u = problem.inputs(extra)
            if problem.timing is None:
                u = lax.fori_loop(0, _AGAIN, nearer, u)
                extra = jnp.concatenate([u[:1], jnp.diff(u)])
            z0, w, k, left = fit(u)
            return left, (z0, w, k, extra)

        left, rest = jax.vmap(guess)(guesses)
        best = jnp.argmin(jnp.where(jnp.isfinite(left), left, jnp.inf))
        z0, w, k, extra = jax.tree.map(lambda v: v[best], rest)
        return _put(problem, found, flat, z0, w, k, extra, left[best], ok)

    return jax.vmap(shape)(z, guesses)


def _put(problem: PathGeneration, found: Linear, flat, z0, w, k, extra, left, ok) -> tuple[Array, Any]:
    """Unknowns of the mechanism moved to where it was fitted, and the merit."""
    place = jnp.zeros((), complex)
    if found.free:
        a, b = (flat[2 * i] + 1j * flat[2 * i + 1] for i in found.base)
        place = z0 + w * a + k * (b - a)
    new = moved(problem, found, flat, z0, w, place)
    x = jnp.concatenate([new[problem.variables.at], extra])
    good = ok & jnp.isfinite(left) & (jnp.abs(w) > 1e-6) & jnp.all(jnp.isfinite(x))
    return jnp.where(jnp.isfinite(x), x, 0.0), jnp.where(good, left / problem.size**2, jnp.inf)
