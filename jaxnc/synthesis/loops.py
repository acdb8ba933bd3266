"""Loops and links of a mechanism: the four-bar loop at an input, distances from dead points, lengths that stay."""

import itertools
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxnc.kinematics.motion import Motion
from jaxnc.records import with_owner
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.kernel import kernel
from jaxnc.solvers.plan import plan
from jaxnc.solvers.rows import Rows
from jaxnc.system.system import System
from jaxnc.types import Array


class Loop(NamedTuple):
    """A four-bar loop: indices of the fixed pivot of the crank, crank pin, joint of the rocker, its fixed pivot."""

    a: int
    b: int
    c: int
    d: int

    def names(self, system: System) -> tuple[str, str, str, str]:
        """Names of its four points."""
        a, b, c, d = (system.topology.points[i] for i in self)
        return a, b, c, d

    def lengths(self, motion: Motion) -> tuple[Any, Any, Any, Any]:
        """Crank, coupler, rocker and ground, from the first pose."""
        q, norm = motion.poses, jnp.linalg.norm
        if isinstance(q, np.ndarray):  # nothing to compile
            norm = np.linalg.norm
        else:
            q = motion.q
        dim = motion.system.topology.dim
        a, b, c, d = (q.reshape(-1, q.shape[-1])[0][i * dim : (i + 1) * dim] for i in self)
        return norm(b - a), norm(c - b), norm(d - c), norm(d - a)

    def extreme_cosines(self, motion: Motion) -> tuple[Any, Any]:
        """Cosines of the transmission angle where the crank lies along the ground, its extremes over a whole turn.

        They are beyond 1 where the crank does not get there.
        """
        crank, coupler, rocker, ground = self.lengths(motion)
        near, far = (ground - crank) ** 2, (ground + crank) ** 2
        both = coupler**2 + rocker**2
        return (both - near) / (2.0 * coupler * rocker), (both - far) / (2.0 * coupler * rocker)


def four_bar_loop(system: System, driven: str) -> Loop | None:
    """The four-bar loop whose crank an angle drives, None if there is none or more than one."""
    top = system.topology
    if top.dim != 2 or not top.is_angle(driven):
        return None
    place, fixed = top.position[driven], ground_points(system)
    ends = {p for block in top.blocks for p, s in zip(block.points, block.scalars, strict=True) if place in s}
    moving = {i for p in ends for i in p if i not in fixed}
    still = {i for p in ends for i in p if i in fixed}
    sets = [set(body.points) for body in top.bodies]
    cranks = [s for s in sets if s & moving and s & still]
    if len(moving) != 1 or len(cranks) != 1:
        return None
    (b,) = moving
    pivots = cranks[0] & still
    if len(pivots) != 1:
        return None
    (a,) = pivots
    found = [
        Loop(a, b, c, d)
        for coupler in sets
        if b in coupler and coupler is not cranks[0] and not coupler & fixed
        for c in sorted(coupler - {b})
        for rocker in sets
        if c in rocker and rocker is not coupler
        for d in sorted(rocker & fixed)
        if d != a
    ]
    return found[0] if len(found) == 1 else None


def loop_sines(motion: Motion) -> Array:
    """Sines of the angles at which the constraints of every loop meet, pose by pose, ``(T, blocks)``.

    A block's determinant over the product of the lengths of its rows: of a pair of bars the sine of the angle between
    them, of any block 1 where its constraints are perpendicular and 0 at a dead point. What keeps a point on a line
    of the ground, or at an input, is a constraint too.
    """
    view = plan(motion.system.topology, motion.driven, motion.held, motion.system.degrees_of_freedom)
    core, eq = kernel(view), derive(motion.system)
    q = motion.q.reshape(-1, motion.q.shape[-1])
    x, lanes = [q[:, c] for c in range(q.shape[1])], (q.shape[0],)
    out = []
    for block in core.blocks:
        if block.rows.form == "affine":
            continue
        slopes, size = wide_rows(block.rows).slopes(eq, x), jnp.ones(lanes)
        for row in range(len(block.columns)):
            size = size * jnp.sqrt(sum(s * s for (r, _), s in slopes.items() if r == row))
        own = {(r, c): slope for (r, c), slope in slopes.items() if c < len(block.columns)}
        out.append(jnp.abs(block.eliminate_slopes(eq, own).determinant) / size)
    return jnp.stack([jnp.broadcast_to(o, lanes) for o in out], axis=1) if out else jnp.ones((*lanes, 1))


@with_owner
def wide_rows(rows: Rows) -> Rows:
    """Rows with all coordinates of the points that they find, behind those that are solved for."""
    top = rows.top
    points = dict.fromkeys(c // top.dim for c in rows.columns if c < top.dim * len(top.points))
    more = [c for p in points for c in range(p * top.dim, (p + 1) * top.dim) if c not in rows.columns]
    return Rows(top, rows.rows, [*rows.columns, *more]) if more else rows


def ground_points(system: System) -> set[int]:
    """Indices of the points that do not move."""
    top = system.topology
    fixed = np.array(top.fixed)
    return {i for i in range(len(top.points)) if fixed[i * top.dim : (i + 1) * top.dim].all()}


def link_lengths(motion: Motion) -> dict[str, float]:
    """Distances between points of each body, and between fixed pivots that follow each other, by ``"B-C"``.

    Of a body of more than three points, those from its first two to all others.
    """
    top = motion.system.topology
    q = np.asarray(motion.q)[0, : len(top.points) * top.dim].reshape(-1, top.dim)
    return {f"{top.points[i]}-{top.points[j]}": float(np.linalg.norm(q[i] - q[j])) for i, j in links(motion.system)}


def links(system: System) -> list[tuple[int, int]]:
    """Pairs of points, by number, whose distances are the lengths of a mechanism; see `lengths`."""
    out: dict[tuple[int, int], None] = {}
    fixed, used = ground_points(system), set()
    for body in system.topology.bodies:
        some = body.points
        used.update(some)
        for k, i in enumerate(some):
            for j in some[k + 1 :]:
                # of 3 points of a body every pair is told
                if (len(some) <= 3 or k < 2) and not (i in fixed and j in fixed):
                    out[i, j] = None
    return [*out, *itertools.pairwise(sorted(fixed & used))]
