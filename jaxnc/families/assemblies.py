"""All assemblies from many starts: bodies thrown into the mechanism's space as rigid as they are, then put together.

Source of the rule by which starts are enough: I. J. Good, "The population frequencies of species and the estimation of
population parameters", Biometrika 40, 1953: species that were seen once tell of those that were not seen.
"""

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.kinematics.inputs import make_plan
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.traced import analyse_traced
from jaxnc.solvers.assembly import derive, settle
from jaxnc.status import Status
from jaxnc.system.equations import Equations, measured
from jaxnc.system.system import System

_SAME = 1e-6  # of the mechanism's size: poses closer than this are one assembly
_BLURRED = 1e-10  # of the size, over the conditioning: so far may Newton be off, and more apart are two assemblies
_LANES = 512  # starts that are solved together
_LEAST = 4 * _LANES  # starts before which no list is called stable
_SEEN = 5  # times that every pose was found in a stable list: one that comes as often was missed once in 150
_QUIET = 4  # times as many starts as the last new pose took
_MOST = 32 * _LANES  # starts after which a list is returned as it is
_SPREADS = (1.0, 2.0, 4.0)  # of the drawing's box, batch by batch: legs may be longer than they are drawn


def assemblies(system: System, values: dict[str, float], starts: int | None, seed: int) -> Motion:
    """Poses at values of the inputs, from random rigid poses of all bodies.

    Without a number of `starts` they go on until the list of poses is stable.

    Returns:
        The distinct poses, each verified: it meets every row, and no mirror image does so in its stead. The one nearest
        to the drawing comes first.
    """
    top, names, eq = system.topology, tuple(values), derive(system)
    view = make_plan(system, names, (), "least squares")
    home = np.asarray(settle(eq, np.zeros(len(top.coordinates))).q)
    rng, lanes = np.random.default_rng(seed), min(_LANES, starts or _LANES)
    asked = jnp.broadcast_to(jnp.array([float(values[n]) for n in names]), (lanes, len(names)))
    found = _Poses(home, len(top.coordinates) - len(top.scalars))
    while found.starts < starts if starts else not found.stable:
        spread = _SPREADS[found.starts // lanes % len(_SPREADS)]
        begun = _rigid_starts(eq, home, lanes, rng, spread)
        one = analyse_traced(view, "guess", eq, jnp.array(begun), asked, ())
        count = lanes if starts is None else min(lanes, starts - found.starts)
        found.add(*(np.asarray(a)[:count] for a in (one.q, one.status, one.size, one.conditioning)))
    q, status, residual, conditioning = found.listed()
    return Motion(
        system, names, (), jnp.array(q), (), jnp.broadcast_to(asked[0], (len(q), len(names))),
        jnp.array(status), jnp.array(residual), jnp.array(conditioning),
    )  # fmt: skip


class _Poses:
    """Distinct poses, each as well as it is known so far, and how often it was found."""

    def __init__(self, home: np.ndarray, spread: int):
        self.home, self.spread, self.size = home, spread, max(float(np.ptp(home[:spread])), 1e-300)
        self.starts = self.newest = 0  # how many there were, and how many when the last new pose was found
        self.seen = np.zeros(0, int)
        # Coordinates, statuses, residuals and conditionings.
        self.known = np.zeros((0, len(home))), np.zeros(0, int), np.zeros(0), np.zeros(0)

    def add(self, *ends: np.ndarray) -> None:
        """Sort the ends of some starts into the list: coordinates, statuses, residuals and conditionings."""
        self.starts += len(ends[0])
        q, status, residual, conditioning = (np.concatenate(a) for a in zip(self.known, ends, strict=True))
        often = np.append(self.seen, np.ones(len(ends[0]), int))
        good = np.flatnonzero((status == int(Status.CONVERGED)) | (status == int(Status.SINGULAR)))
        kept, seen, places = [], [], np.zeros((0, self.spread))
        # Of one assembly the pose that is known best is kept.
        for i in good[np.argsort(residual[good] / np.maximum(conditioning[good], 1e-300), kind="stable")]:
            same = self.size * min(1e-3, max(_SAME, _BLURRED / max(conditioning[i], 1e-300)))
            like = np.flatnonzero(np.abs(places - q[i, : self.spread]).max(axis=1) <= same)
            if len(like):
                seen[like[0]] += often[i]
            else:
                kept, seen = [*kept, i], [*seen, often[i]]
                places = np.concatenate([places, q[i : i + 1, : self.spread]])
        if len(kept) > len(self.seen):
            self.newest = self.starts
        self.known, self.seen = (q[kept], status[kept], residual[kept], conditioning[kept]), np.array(seen, int)

    @property
    def stable(self) -> bool:
        """Whether many more starts than the last new pose took brought none, and every pose came several times."""
        quiet = self.starts >= max(_LEAST, _QUIET * self.newest) and bool((self.seen >= _SEEN).all())
        return quiet or self.starts >= _MOST

    def listed(self) -> tuple[np.ndarray, ...]:
        """Coordinates, statuses, residuals and conditionings, those of the pose nearest to the drawing first."""
        away = np.abs(self.known[0][:, : self.spread] - self.home[: self.spread]).sum(axis=1)
        return tuple(a[np.argsort(away, kind="stable")] for a in self.known)


def _rigid_starts(eq: Equations, home: np.ndarray, starts: int, rng: np.random.Generator, spread: float) -> np.ndarray:
    """Poses ``(starts, N)`` in which every body is as long and wide as it is, turned and placed at random.

    A body that shares a point with the ground, or with a body before it, hangs on that point; others lie in a box that
    is `spread` times as wide as the drawing's.
    """
    top = eq.topology
    dim, count = top.dim, len(top.points)
    points = home[: count * dim].reshape(count, dim)
    vectors = home[count * dim : count * dim + len(top.vectors) * dim].reshape(len(top.vectors), dim)
    fixed = np.array(top.fixed)
    fixed_points = np.asarray(fixed[: count * dim].reshape(count, dim).all(axis=1))
    fixed_vectors = np.asarray(fixed[count * dim : (count + len(top.vectors)) * dim].reshape(-1, dim).all(axis=1))
    size, middle = spread * float(np.ptp(points, axis=0).max()), points.mean(axis=0)
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
    thrown = np.concatenate([p.reshape(starts, -1), v.reshape(starts, -1)], axis=1)
    out[:, : thrown.shape[1]] = np.where(fixed[: thrown.shape[1]], home[: thrown.shape[1]], thrown)
    if top.scalars:
        out[:, thrown.shape[1] :] = _measures(eq, out)
    return out


def _measures(eq: Equations, q: np.ndarray) -> np.ndarray:
    return np.asarray(jax.vmap(lambda x: measured(eq.topology, eq.constants, x))(jnp.asarray(q)))


def _rotations(rng: np.random.Generator, count: int, dim: int) -> np.ndarray:
    """Rotations ``(count, dim, dim)``, uniform over all of them."""
    q, r = np.linalg.qr(rng.normal(size=(count, dim, dim)))
    q = q * np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None, :]
    q[np.linalg.det(q) < 0.0, :, 0] *= -1.0
    return q
