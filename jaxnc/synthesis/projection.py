"""Variable projection: what enters a path linearly is solved for, so that only shapes have to be searched.

A point that rides on a body without carrying anything is P = z0 + w (A + k D), as complex numbers, with A and D the
body's base: the place z0 and the similarity w of the whole mechanism and the place k of the point in its body are
linear in (z0, w, w k), whatever the mechanism. G. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973).
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxnc.kinematics.redesign import components, flattened, rebuilt
from jaxnc.solvers import dense
from jaxnc.synthesis.path import PathGeneration
from jaxnc.synthesis.problem import POSES
from jaxnc.types import Array

_ANGLE = 0.37  # for trying whether a mechanism turns, grows and moves as a whole


class Linear(NamedTuple):
    """Which unknowns of a path are linear.

    Attributes:
        axes: whether the whole mechanism may move along x and along y.
        scale: whether it may be enlarged.
        turn: whether it may be turned.
        tracer: index of the point (or, from the number of points on, of the marker) if its place in its body is free.
        base: indices of the two points that carry it; the tracer itself twice if it is not free.
    """

    axes: tuple[bool, bool]
    scale: bool
    turn: bool
    tracer: int
    free: bool
    base: tuple[int, int]


def linear(problem: PathGeneration) -> Linear | None:
    """Which unknowns of a path problem are linear, by trying; None if there are none (or the mechanism is spatial)."""
    system, top = problem.system, problem.system.topology
    if top.dim != 2 or top.vectors:
        return None
    at = np.zeros(len(components(system)), dtype=bool)
    at[problem.variables.at] = True
    spread = 2 * (len(top.points) + len(top.markers))
    x_free, y_free = at[:spread:2], at[1:spread:2]
    flat = np.asarray(flattened(system), dtype=float)
    x, y = flat[:spread:2], flat[1:spread:2]
    lengths = _lengths(problem)
    still = not lengths.any() or bool(at[spread:][lengths].all())
    axes = (bool(x_free.all()), bool(y_free.all()))
    scale = bool((x_free | (x == 0)).all() and (y_free | (y == 0)).all() and still)
    turn = scale and bool((x_free & y_free | (x == 0) & (y == 0)).all())
    markers = [m.name for m in top.markers]
    if problem.point in top.points:
        index = top.points.index(problem.point)
        bodies = [b for b in top.bodies if index in b.points]
        carried = len(bodies) == 1 and bodies[0].base is not None and index not in bodies[0].base
        base = bodies[0].base if carried else None
    else:
        index = len(top.points) + markers.index(problem.point)
        base = top.markers[markers.index(problem.point)].base
    free = base is not None and bool(x_free[index] and y_free[index])
    found = Linear(axes, scale, turn, index, free, base if free and base is not None else (index, index))
    found = _tried(problem, found)
    return found if any(found.axes) or found.scale or found.free else None


def _lengths(problem: PathGeneration) -> np.ndarray:
    """Which explicit dimensions are lengths."""
    return np.array([d.quantity.long for d in problem.system.topology.given], dtype=bool)


def moved(problem: PathGeneration, found: Linear, flat: Array, z0: Any, w: Any, place: Any) -> Array:
    """Parameters of the mechanism moved as a whole, its tracer put somewhere.

    Args:
        problem: the problem.
        found: what is linear.
        flat: all parameters.
        z0: where it moves, complex.
        w: how it turns and grows.
        place: where the tracer is drawn afterwards.
    """
    top = problem.system.topology
    spread = 2 * (len(top.points) + len(top.markers))
    z = flat[:spread:2] + 1j * flat[1:spread:2]
    z = z0 + w * z
    if found.free:
        z = z.at[found.tracer].set(place)
    both = jnp.stack([z.real, z.imag], axis=1).reshape(-1)
    dims = flat[spread:] * jnp.where(jnp.asarray(_lengths(problem), bool), jnp.abs(w), 1.0)
    return jnp.concatenate([both, dims])


def _tried(problem: PathGeneration, found: Linear) -> Linear:
    """The same without what does not do to the path what it does to the drawing."""
    top, size, flat = problem.system.topology, problem.size, flattened(problem.system)
    n = 2 * (len(top.points) + len(top.markers))
    z = np.asarray(flat)[:n:2] + 1j * np.asarray(flat)[1:n:2]
    ways = [(0.0, 1.0), (0.1 * size, 1.0), (0.1j * size, 1.0), (0.0, 1.1), (0.0, np.exp(1j * _ANGLE))]
    drawn = [moved(problem, found, flat, z0, w, z0 + w * z[found.tracer]) for z0, w in ways]
    a, b = (z[i] for i in found.base)
    drawn.append(moved(problem, found, flat, 0.0, 1.0, z[found.tracer] + 0.2 * (b - a)))
    names = (problem.point, *(top.points[i] for i in found.base if found.free))
    each = [_paths(problem, names, one) for one in drawn]
    paths, good = (np.stack(v) for v in zip(*each, strict=True))
    paths = paths[:, :, good.all(axis=0)]  # (ways, names, poses) of complex numbers
    here = paths[0]

    def like(k: int, name: int, other: np.ndarray) -> bool:
        return bool(np.allclose(paths[k][name], other, atol=1e-6 * size))

    x, y, scale, turn = (like(k, 0, z0 + w * here[0]) for k, (z0, w) in enumerate(ways) if k)
    free = found.free and all(like(5, k, here[k]) for k in (1, 2)) and like(5, 0, here[0] + 0.2 * (here[2] - here[1]))
    scale = found.scale and scale
    return found._replace(
        axes=(found.axes[0] and x, found.axes[1] and y),
        scale=scale,
        turn=found.turn and scale and turn,
        free=free,
        base=found.base if free else (found.tracer, found.tracer),
    )


def _paths(problem: PathGeneration, names: tuple[str, ...], flat: Array) -> tuple[np.ndarray, np.ndarray]:
    """Places of points of a drawing over the range of the input, and which poses are found."""
    motion = problem.swept(rebuilt(problem.system, flat), np.linspace(*problem.travel, POSES))
    return np.stack([np.asarray(motion[n]) @ np.array([1.0, 1j]) for n in names]), np.asarray(motion.converged)


def fitted(found: Linear, base: Array, direction: Array, target: Array, weights: Array) -> tuple[Any, Any, Any, Array]:
    """The least-squares place, similarity and tracer for one path.

    Args:
        found: what is linear.
        base: the body's first point (or the tracer), complex ``(M,)``.
        direction: from it to the body's second point, complex ``(M,)``.
        target: complex ``(M,)``.
        weights: ``(M,)``.

    Returns:
        z0, w, w·k and the sum of squares that is left.
    """
    one = jnp.ones(target.shape)
    columns, rest = [], target
    columns += [one + 0j] if found.axes[0] else []
    columns += [1j * one] if found.axes[1] else []
    if found.scale:
        columns += [base] + ([1j * base] if found.turn else [])
    else:
        rest = rest - base
    columns += [direction, 1j * direction] if found.free else []
    root = jnp.sqrt(weights)
    rows = jnp.stack([jnp.concatenate([(root * c).real, (root * c).imag]) for c in columns], axis=1)
    right = jnp.concatenate([(root * rest).real, (root * rest).imag])
    sizes = jnp.maximum(jnp.linalg.norm(rows, axis=0), 1e-12)
    rows = rows / sizes
    normal = rows.T @ rows + 1e-10 * jnp.eye(rows.shape[1])
    y = dense.cholesky_solve(normal, (rows.T @ right)[:, None])[:, 0]
    left = right - rows @ y
    y = y / sizes
    y = list(y)
    z0 = (y.pop(0) if found.axes[0] else 0.0) + 1j * (y.pop(0) if found.axes[1] else 0.0)
    w = 1.0 + 0j
    if found.scale:
        w = y.pop(0) + 1j * (y.pop(0) if found.turn else 0.0)
    k = y[0] + 1j * y[1] if found.free else 0.0 + 0j
    return z0, w, k, jnp.sum(left * left)
