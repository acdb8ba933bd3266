"""Random drawings inside all boxes and bounds of lengths at once.

A box that is not wider than what the drawing or the target suggests is drawn in; a wider one says nothing of where the
joint is. Around joints in boxes the rest of the mechanism is put as a whole, and what its lengths miss is evened out.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jaxnc.kinematics.redesign import flattened
from jaxnc.synthesis.conditions import LARGE, Length
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.projection import Limits, Linear, moved, nearest, rows_of

_WIDE = 4.0  # sizes: a box that is wider is none to draw in
_SWEEPS = 60  # over all lengths, at most, until they are met
_MET = 1e-9  # of the size: what a length may miss


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
        """Those of a problem."""
        var, top = problem.variables, problem.system.topology
        low, high = (np.full(len(np.asarray(flattened(problem.system))), v) for v in (-np.inf, np.inf))
        low[var.at], high[var.at] = var.low, var.high
        size = float(problem.length)
        width = np.full(len(low), size)
        width[var.at] = np.maximum(var.scale, size)
        some = [c for c in problem.conditions if isinstance(c, Length) and {c.start, c.end} <= {*top.points}]
        ends = np.array([[top.points.index(n) for n in (c.start, c.end)] for c in some], int).reshape(-1, 2)
        shortest, longest = np.array([max(c.low, 0.0) for c in some]), np.array([c.high for c in some])
        return cls(low, high, high - low <= _WIDE * width, ends, shortest, longest, size, len(top.points))

    def inside(self, flat: np.ndarray, free: np.ndarray, dim: int) -> np.ndarray:
        """Drawings ``(B, n)``, what their lengths and boxes miss evened out over what is free, ``(n,)``."""
        flat = np.where(self.narrow, np.clip(flat, self.low, self.high), flat)
        if not len(self.ends):
            return flat
        along = np.arange(dim)
        for _ in range(_SWEEPS):
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
            if far <= _MET * self.size:
                break
        return flat

    def limits(self, found: Linear, flat: np.ndarray) -> Limits:
        """What they leave of the places and sizes of mechanisms drawn as ``flat``, ``(B, n)``."""
        at = np.flatnonzero((np.isfinite(self.low) | np.isfinite(self.high))[: 2 * found.spots])
        rows, fixed = rows_of(found, flat, at)
        extent, least, most = self.room(flat, 2, found.tracer if found.free else -1)
        return Limits(rows, fixed, self.low[at], self.high[at], least, most, extent)

    def room(self, flat: np.ndarray, dim: int, without: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """How large mechanisms ``(B, n)`` are, and by which factors they may grow at least and at most, ``(B,)``.

        `without` is a point that is put where it is wanted anyway.
        """
        places = flat[:, : dim * self.points].reshape(len(flat), self.points, dim)
        some = np.delete(places, without, axis=1) if 0 <= without < self.points else places
        extent = np.ptp(some, axis=1).max(axis=1)
        least, most = np.zeros(len(flat)), np.maximum(LARGE * self.size, self._asked) / np.maximum(extent, 1e-300)
        for (a, b), low, high in zip(self.ends, self.shortest, self.longest, strict=True):
            if without in (a, b):
                continue
            long = np.maximum(np.linalg.norm(places[:, a] - places[:, b], axis=1), 1e-300)
            least, most = np.maximum(least, low / long), np.minimum(most, high / long)
        return extent, np.minimum(least, most), most

    @property
    def _asked(self) -> float:
        """The largest length that is allowed by name."""
        return float(np.max(self.longest[np.isfinite(self.longest)], initial=0.0))


def drawn(
    problem: Problem,
    found: Any,
    rng: np.random.Generator,
    count: int,
    into: Callable[[Boxes, np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Random drawings ``(count, n)``: uniform in boxes, the rest around the idea, by up to its size.

    `found` is a `Linear` or `Freedom`, which of its unknowns are linear; None if none are. `into` moves mechanisms as a
    whole to where their joints in boxes are to be; if it is not given, those of the plane.
    """
    var, dim, boxes = problem.variables, problem.system.topology.dim, Boxes.of(problem)
    spread = rng.uniform(0.1, 1.0, (count, 1)) * var.scale
    chance = rng.uniform(-1.0, 1.0, (count, len(var.at)))
    flat = np.repeat(np.asarray(flattened(problem.system), float)[None], count, axis=0)
    flat[:, var.at] = var.home + spread * chance
    free = np.zeros(flat.shape[1], bool)
    free[var.at] = True
    narrow = boxes.narrow[var.at]
    goal = flat.copy()
    low, high = var.low[narrow], var.high[narrow]
    goal[:, var.at[narrow]] = low + (high - low) * 0.5 * (1.0 + chance[:, narrow])
    if found is not None and (any(found.axes) or found.scale):
        if narrow.any() or len(boxes.ends):
            flat = into(boxes, flat, goal) if into else _put(problem, found, boxes, flat, goal)
            flat = boxes.inside(flat, free, dim)
    else:
        flat = boxes.inside(np.clip(goal, boxes.low, boxes.high), free, dim)
        flat = np.where(free, np.clip(flat, boxes.low, boxes.high), flat)
    return flat[:, var.at]


def _put(problem: Any, found: Linear, boxes: Boxes, flat: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Mechanisms moved as a whole to where their joints in boxes are to be, and these put there."""
    whole = found._replace(free=False)
    limits = boxes.limits(whole, flat)
    if found.scale:  # of a size that lengths allow
        flat = moved(problem, whole, flat, np.zeros(len(flat)), np.clip(1.0, limits.least, limits.most), 0.0)
    at = np.flatnonzero(boxes.narrow[: 2 * found.spots])
    if len(at):
        rows, fixed = rows_of(whole, flat, at)
        z0, w = nearest(whole, rows, goal[:, at] - fixed, limits.extent)
        flat = moved(problem, whole, flat, z0, w, 0.0)
        flat[:, at] = goal[:, at]
    return flat
