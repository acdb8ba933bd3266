"""All assemblies from many starts: bodies thrown into the mechanism's space as rigid as they are, then put together."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.kinematics.analysis import analyse
from jaxnc.kinematics.inputs import make_plan
from jaxnc.kinematics.motion import Motion
from jaxnc.solvers.assembly import derive, settle
from jaxnc.status import Status
from jaxnc.system.equations import Equations, measured
from jaxnc.system.system import System

_SAME = 1e-6  # of the mechanism's size: poses closer than this are one assembly
_BLURRED = 1e-10  # of the size, over the conditioning: so far may Newton be off, and more apart are two assemblies
_LANES = 512  # starts that are solved together


def assemblies(system: System, values: dict[str, float], starts: int, seed: int) -> Motion:
    """Poses at values of the inputs, from random rigid poses of all bodies.

    Returns:
        The distinct poses, each verified: it meets every row, and no mirror image does so in its stead. The one nearest
        to the drawing comes first.
    """
    top, names, eq = system.topology, tuple(values), derive(system)
    view = make_plan(system, names, (), "least squares")
    home = np.asarray(settle(eq, np.zeros(len(top.coordinates))).q)
    begun = _rigid_starts(eq, home, starts, seed)
    lanes = min(_LANES, starts)
    asked = jnp.broadcast_to(jnp.array([float(values[n]) for n in names]), (lanes, len(names)))
    parts = []
    for first in range(0, starts, lanes):
        rows = np.minimum(np.arange(first, first + lanes), starts - 1)  # filled up with the last one
        q, _, *rest = analyse(view, "guess", eq, jnp.array(begun[rows]), asked, ())
        parts.append([np.asarray(a) for a in (q, *rest)])
    q, status, residual, conditioning = (np.concatenate(a) for a in zip(*parts, strict=True))
    good = np.flatnonzero((status == int(Status.CONVERGED)) | (status == int(Status.SINGULAR)))
    spread = len(top.coordinates) - len(top.scalars)
    size = max(float(np.ptp(home[:spread])), 1e-300)
    away = np.abs(q[good, :spread] - home[:spread]).sum(axis=1)
    kept: list[int] = []
    # Of one assembly the pose that is known best is kept.
    for i in good[np.argsort(residual[good] / np.maximum(conditioning[good], 1e-300), kind="stable")]:
        same = size * min(1e-3, max(_SAME, _BLURRED / max(conditioning[i], 1e-300)))
        if all(np.abs(q[i, :spread] - q[j, :spread]).max() > same for j in kept):
            kept.append(int(i))
    far = dict(zip(good.tolist(), away.tolist(), strict=True))
    at = np.array(sorted(kept, key=far.__getitem__), int)
    return Motion(
        system, names, (), jnp.array(q[at]), (), jnp.broadcast_to(asked[0], (len(at), len(names))),
        jnp.array(status[at]), jnp.array(residual[at]), jnp.array(conditioning[at]),
    )  # fmt: skip


def _rigid_starts(eq: Equations, home: np.ndarray, starts: int, seed: int) -> np.ndarray:
    """Poses ``(starts, N)`` in which every body is as long and wide as it is, turned and placed at random.

    A body that shares a point with the ground, or with a body before it, hangs on that point.
    """
    top, rng = eq.topology, np.random.default_rng(seed)
    dim, count = top.dim, len(top.points)
    points = home[: count * dim].reshape(count, dim)
    vectors = home[count * dim : count * dim + len(top.vectors) * dim].reshape(len(top.vectors), dim)
    fixed = np.array(top.fixed)
    fixed_points = np.asarray(fixed[: count * dim].reshape(count, dim).all(axis=1))
    fixed_vectors = np.asarray(fixed[count * dim : (count + len(top.vectors)) * dim].reshape(-1, dim).all(axis=1))
    size, middle = float(np.ptp(points, axis=0).max()), points.mean(axis=0)
    out = np.broadcast_to(home, (starts, len(home))).copy()
    p = middle + size * rng.uniform(-1.0, 1.0, (starts, count, dim))
    v = np.broadcast_to(vectors, (starts, *vectors.shape)).copy()
    p[:, fixed_points] = points[fixed_points]
    placed, directed = fixed_points.copy(), fixed_vectors.copy()
    waiting = list(top.bodies)
    while waiting:
        # Bodies that hang on something come first.
        body = next((b for b in waiting if placed[list(b.points)].any()), waiting[0])
        waiting.remove(body)
        own, axes = list(body.points), list(body.vectors)
        turn = _rotations(rng, starts, dim)
        hung = [k for k in own if placed[k]][:1]
        if own:
            pivot, where = (points[hung[0]], p[:, hung[0]]) if hung else (points[own].mean(axis=0), p[:, own[0]])
            free = [k for k in own if not placed[k]]
            p[:, free] = where[:, None] + np.einsum("sij,kj->ski", turn, points[free] - pivot)
            placed[own] = True
        free = [k for k in axes if not directed[k]]
        v[:, free] = np.einsum("sij,kj->ski", turn, vectors[free])
        directed[axes] = True
    spread = np.concatenate([p.reshape(starts, -1), v.reshape(starts, -1)], axis=1)
    out[:, : spread.shape[1]] = np.where(fixed[: spread.shape[1]], home[: spread.shape[1]], spread)
    if top.scalars:
        out[:, spread.shape[1] :] = _measures(eq, out)
    return out


def _measures(eq: Equations, q: np.ndarray) -> np.ndarray:
    return np.asarray(jax.vmap(lambda x: measured(eq.topology, eq.constants, x))(jnp.asarray(q)))


def _rotations(rng: np.random.Generator, count: int, dim: int) -> np.ndarray:
    """Rotations ``(count, dim, dim)``, uniform over all of them."""
    q, r = np.linalg.qr(rng.normal(size=(count, dim, dim)))
    q = q * np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None, :]
    q[np.linalg.det(q) < 0.0, :, 0] *= -1.0
    return q
