"""Bounds of joints and lengths: random drawings inside all of them at once, and a projection onto them.

A box that is not wider than what the drawing or the target suggests is drawn in; a wider one says nothing of where the
joint is. Around joints in boxes the rest of the mechanism is placed as a whole, and what its lengths miss is evened
out.
"""

import dataclasses
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.compiling import on_device
from jaxnc.kinematics.design import geometry_vector
from jaxnc.synthesis.conditions import LARGE, Length
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.pytree import Leaves
from jaxnc.types import Array

if TYPE_CHECKING:
    from jaxnc.synthesis.search.planar import PlanarFit
    from jaxnc.synthesis.search.spatial import Spatial


class Boxes(NamedTuple):
    """Bounds of the joints and lengths of a problem."""

    low: np.ndarray  # of all parameters, (n,); infinite where there is none
    high: np.ndarray  # upper bounds
    narrow: np.ndarray  # parameters that are drawn in their boxes
    ends: np.ndarray  # of bounded lengths, indices of two points each, (lengths, 2)
    shortest: np.ndarray  # (lengths,)
    longest: np.ndarray  # (lengths,)
    size: float  # of what is drawn
    points: int  # how many points there are

    @classmethod
    def of(cls, problem: Problem) -> "Boxes":
        """Read the bounds of a problem."""
        var, top = problem.variables, problem.system.topology
        low, high = (np.full(len(np.asarray(geometry_vector(problem.system))), v) for v in (-np.inf, np.inf))
        low[var.at], high[var.at] = var.low, var.high
        size = float(problem.length)
        width = np.full(len(low), size)
        width[var.at] = np.maximum(var.scale, size)
        some = [c for c in problem.conditions if isinstance(c, Length) and {c.start, c.end} <= {*top.points}]
        ends = np.array([[top.points.index(n) for n in (c.start, c.end)] for c in some], int).reshape(-1, 2)
        shortest, longest = np.array([max(c.low, 0.0) for c in some]), np.array([c.high for c in some])
        # a box that is wider than 4 sizes is none to draw in
        return cls(low, high, high - low <= 4.0 * width, ends, shortest, longest, size, len(top.points))

    def inside(self, flat: np.ndarray, free: np.ndarray, dim: int) -> np.ndarray:
        """Even out what lengths and boxes of drawings ``(B, n)`` miss over the parameters that are free, ``(n,)``."""
        flat = np.where(self.narrow, np.clip(flat, self.low, self.high), flat)
        if not len(self.ends):
            return flat
        along = np.arange(dim)
        for _ in range(60):  # 60 sweeps over all lengths, at most, until they are met
            far = 0.0
            for (a, b), low, high in zip(self.ends, self.shortest, self.longest, strict=True):
                i, j = dim * a + along, dim * b + along
                d = flat[:, j] - flat[:, i]
                long = np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-300)
                off = (np.clip(long, low, high) - long) * d / long
                far = max(far, float(np.abs(off).max()))
                share = free[i] + 0.0, free[j] + 0.0
                total = np.maximum(share[0] + share[1], 1.0)
                flat[:, i] -= share[0] / total * off
                flat[:, j] += share[1] / total * off
            flat = np.where(self.narrow, np.clip(flat, self.low, self.high), flat)
            if far <= 1e-9 * self.size:  # 1e-9 of the size may a length miss
                break
        return flat

    def room(self, flat: np.ndarray, dim: int, without: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Extents of mechanisms ``(B, n)``, and the least and largest factors by which they may grow, ``(B,)``.

        `without` is a point that is put where it is wanted anyway.
        """
        places = flat[:, : dim * self.points].reshape(len(flat), self.points, dim)
        some = np.delete(places, without, axis=1) if 0 <= without < self.points else places
        extent = np.ptp(some, axis=1).max(axis=1)
        longest = np.max(self.longest[np.isfinite(self.longest)], initial=LARGE * self.size)
        least, most = np.zeros(len(flat)), longest / np.maximum(extent, 1e-300)
        for (a, b), low, high in zip(self.ends, self.shortest, self.longest, strict=True):
            if without in (a, b):
                continue
            long = np.maximum(np.linalg.norm(places[:, a] - places[:, b], axis=1), 1e-300)
            least, most = np.maximum(least, low / long), np.minimum(most, high / long)
        return extent, np.minimum(least, most), most


def draw_designs(
    problem: Problem, rng: np.random.Generator, count: int, fit: "PlanarFit | Spatial | None" = None
) -> np.ndarray:
    """Draw random designs ``(count, n)``: uniform in boxes, the rest around the idea, by up to its size."""
    var, dim, boxes = problem.variables, problem.system.topology.dim, Boxes.of(problem)
    spread = rng.uniform(0.1, 1.0, (count, 1)) * var.scale
    chance = rng.uniform(-1.0, 1.0, (count, len(var.at)))
    flat = np.repeat(np.asarray(geometry_vector(problem.system), float)[None], count, axis=0)
    flat[:, var.at] = var.home + spread * chance
    free = np.zeros(flat.shape[1], bool)
    free[var.at] = True
    narrow = boxes.narrow[var.at]
    goal = flat.copy()
    low, high = var.low[narrow], var.high[narrow]
    goal[:, var.at[narrow]] = low + (high - low) * 0.5 * (1.0 + chance[:, narrow])
    if fit is not None and (any(fit.free.axes) or fit.free.scale):
        if narrow.any() or len(boxes.ends):
            flat = boxes.inside(fit.into(boxes, flat, goal), free, dim)
    else:
        flat = boxes.inside(np.clip(goal, boxes.low, boxes.high), free, dim)
        flat = np.where(free, np.clip(flat, boxes.low, boxes.high), flat)
    return flat[:, var.at]


@dataclasses.dataclass(frozen=True, eq=False)
class Bounds(Leaves):
    """Bounds of the unknowns of a problem, in its scales."""

    low: Array  # of the unknowns, (n,)
    high: Array  # upper bounds
    scale: Array  # by which unknowns are divided
    drawing: Array  # all parameters of the starting idea, (parameters,)
    at: Array  # places of the design variables among them
    share: Array  # of each end of a length, (lengths, 2): how much of what the length misses it takes up
    ends: Array  # places of the ends' coordinates, (lengths, 2, dim)
    shortest: Array  # of the lengths, (lengths,)
    longest: Array  # (lengths,)
    lengths: int  # how many there are

    @classmethod
    def of(cls, problem: Problem) -> "Bounds":
        """Read the bounds of a problem, without those of lengths that are explicit dimensions."""
        boxes, var, top = Boxes.of(problem), problem.variables, problem.system.topology
        free = np.zeros(len(boxes.low), bool)
        free[var.at] = True
        given = {name.rpartition(".")[2] for name in top.dimensions}
        pairs = [(top.points[a], top.points[b]) for a, b in boxes.ends]
        some = np.array([not {f"{a}-{b}", f"{b}-{a}"} & given for a, b in pairs], bool)
        ends = top.dim * boxes.ends[some][:, :, None] + np.arange(top.dim)
        can = free[ends].any(axis=2).astype(float)  # ends that may be moved
        kept = can.any(axis=1)
        share = can[kept] / can[kept].sum(axis=1, keepdims=True)
        drawing = np.asarray(geometry_vector(problem.system), float)
        rows = problem.low / problem.scale, problem.high / problem.scale, problem.scale, drawing, var.at, share
        rest = ends[kept], boxes.shortest[some][kept], boxes.longest[some][kept]
        return cls(*on_device((*rows, *rest)), lengths=int(kept.sum()))

    def project(self, y: Array) -> Array:
        """Put unknowns into their boxes, and even out, some times over, what their lengths miss."""
        y = jnp.clip(y, self.low, self.high)
        if not self.lengths:
            return y
        n = self.at.shape[0]
        free = jnp.zeros(self.drawing.shape).at[self.at].set(1.0)

        def evened(k: Array, z: Array) -> Array:
            a, b = self.ends[k]
            flat = self.drawing.at[self.at].set(z)
            d = flat[b] - flat[a]
            square = jnp.sum(d * d)
            long = jnp.sqrt(jnp.where(square > 0.0, square, 1.0))
            off = (jnp.clip(long, self.shortest[k], self.longest[k]) - long) * d / long
            flat = flat.at[a].add(-self.share[k, 0] * off * free[a]).at[b].add(self.share[k, 1] * off * free[b])
            return flat[self.at]

        def sweep(_: Array, y: Array) -> Array:
            z = lax.fori_loop(0, self.lengths, evened, (y * self.scale)[:n])
            return jnp.clip(y.at[:n].set(z / self.scale[:n]), self.low, self.high)

        return lax.fori_loop(0, 24, sweep, y)  # what is left after 24 sweeps over all lengths is a condition's to mend

    def slope_along(self, y: Array, slope: Array) -> Array:
        """Return what bounds leave of a gradient for a short step down it: what they push back is taken away."""
        size = jnp.linalg.norm(slope)
        short = 1e-4 / jnp.where(size > 0.0, size, 1.0)  # unknowns are of size one
        ahead = y - short * slope
        return slope - (self.project(ahead) - ahead) / short

    def distance_down(self, y: Array, slope: Array) -> Array:
        """Length of a step down the gradient that does not leave the bounds; 0 where they allow none."""
        return jnp.linalg.norm(y - jax.lax.stop_gradient(self.project(y - slope)))
