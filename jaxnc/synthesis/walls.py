"""What unknowns may be, as a projection: boxes, and bounds of lengths; pure, for steps along gradients."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.compiling import on_device
from jaxnc.kinematics.redesign import flattened
from jaxnc.records import record, static
from jaxnc.synthesis.boxes import Boxes
from jaxnc.synthesis.problem import Problem
from jaxnc.types import Array

_SWEEPS = 24  # over all lengths: what is left after these is a condition's to mend


@record
class Walls:
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
    lengths: int = static()  # how many there are

    @classmethod
    def of(cls, problem: Problem) -> "Walls":
        """Those of a problem; a length that is given as a dimension is not read off the drawing, and left out."""
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
        drawing = np.asarray(flattened(problem.system), float)
        rows = problem.low / problem.scale, problem.high / problem.scale, problem.scale, drawing, var.at, share
        rest = ends[kept], boxes.shortest[some][kept], boxes.longest[some][kept]
        return cls(*on_device((*rows, *rest)), lengths=int(kept.sum()))

    def projected(self, y: Array) -> Array:
        """Unknowns within their boxes, their lengths within bounds: what these miss evened out, some times over."""
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

        return lax.fori_loop(0, _SWEEPS, sweep, y)

    def left(self, y: Array, slope: Array) -> Array:
        """How far a step down the gradient leads that does not leave the bounds: 0 where they leave none."""
        return jnp.linalg.norm(y - jax.lax.stop_gradient(self.projected(y - slope)))
