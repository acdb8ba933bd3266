"""Paths and motions in the plane, what is linear of them fitted, see `jaxnc.synthesis.projection`.

That is the place, size and turn of a whole mechanism, the place of the tracer in its body, and how the frame that is
guided is turned against it.
"""

from typing import Any

import numpy as np

from jaxnc.kinematics.redesign import flattened
from jaxnc.synthesis.boxes import Boxes
from jaxnc.synthesis.guidance import MotionGeneration
from jaxnc.synthesis.path import PathGeneration
from jaxnc.synthesis.poses import marker
from jaxnc.synthesis.projection import Limits, Linear, fitted, linear, moved

Pairs = list[tuple[np.ndarray, np.ndarray, float]]
"""Curves ``(B, guesses, poses)``, what targets want of them ``(M,)`` and weights; two numbers in one complex one."""


class Planar:
    """How designs of a problem in the plane are fitted to its targets.

    The turn of a body that is guided is linear by itself: its error is the distance of two complex numbers of length
    one, to which the mechanism's own turn adds nothing that the frame's does not.
    """

    own = 0  # unknowns of the problem that say how a frame is turned
    wanted: Any = None

    def __init__(self, problem: PathGeneration, found: Linear):
        self.problem, self.free, self.target = problem, found, problem.target @ np.array([1.0, 1j])
        if isinstance(problem, MotionGeneration):
            self.own, self.reach, self.heavy = 1, problem.reach, problem.weights * problem.reach**2
            self.wanted = np.exp(1j * problem.turns)
            self.base = next(b.base for b in problem.system.topology.bodies if b.name == problem.body)

    @classmethod
    def of(cls, problem: PathGeneration) -> "Planar | None":
        """That of a problem; None if nothing of it is linear."""
        found = linear(problem)
        return None if found is None else cls(problem, found)

    def rows(self, z: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, ...]:
        """What is fitted of poses ``(B, T, N)``.

        Returns:
            The tracer's first base point, the way to the second one, complex, and the direction of the body that is
            guided, ones where none is, ``(B, T)``.
        """
        points = len(self.problem.system.topology.points)

        def place(index: int) -> np.ndarray:
            if index >= points:  # a marker that is not free
                return marker(self.problem, z, q, index - points)
            return q[..., 2 * index] + 1j * q[..., 2 * index + 1]

        base = place(self.free.base[0])
        return base, place(self.free.base[1]) - base, self._seen(q)

    def limits(self, z: np.ndarray) -> Limits | None:
        """What bounds leave of designs; None where they are only drawn in them."""
        if not (any(self.free.axes) or self.free.scale or self.free.free):
            return None
        return Boxes.of(self.problem).limits(self.free, parameters(self.problem, z))

    def fitted(self, rows: tuple[np.ndarray, ...], limits: Limits | None, some: Any = slice(None)) -> Any:
        """Place, similarity, tracer and turn of designs ``(B, …)`` from some of `rows`, and the squares left."""
        base, along, seen = rows
        z0, w, k, left = fitted(self.free, base, along, self.target[some], self.problem.weights[some], limits)
        by = np.ones(left.shape, complex)
        if self.wanted is not None:
            heavy, wanted = self.heavy[some], self.wanted[some]
            by = np.conj(seen) @ (heavy * wanted)
            by = by / np.maximum(np.abs(by), 1e-300)
            off = wanted - by[..., None] * seen
            left = left + (off.real**2 + off.imag**2) @ heavy
        return (z0, w, k, by), left

    def curves(self, rows: tuple[np.ndarray, ...], parts: Any, some: np.ndarray) -> Pairs:
        """The whole curves ``rows``, ``(B, poses)``, of designs as they were fitted, beside what is wanted of them."""
        base, along, seen = (row[:, None] for row in rows)
        z0, w, k, by = (part[..., None] for part in parts)
        out: Pairs = [(z0 + w * base + k * along, self.target[some], 1.0)]
        if self.wanted is not None:
            out.append((by * seen, self.wanted[some], self.reach**2))
        return out

    def put(self, z: np.ndarray, parts: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Parameters ``(B, n)`` of mechanisms as they were fitted, turns of the frame ``(B, own)``, growth ``(B,)``."""
        z0, w, k, by = parts
        flat = parameters(self.problem, z)
        place: Any = 0.0
        if self.free.free:
            a, b = (flat[:, 2 * i] + 1j * flat[:, 2 * i + 1] for i in self.free.base)
            place = z0 + w * a + k * (b - a)
        turn = (np.angle(w) - np.angle(by))[:, None] if self.own else np.zeros((len(z), 0))
        return moved(self.problem, self.free, flat, z0, w, place), turn, np.abs(w)

    def _seen(self, q: np.ndarray) -> np.ndarray:
        if self.wanted is None:
            return np.ones(q.shape[:-1], complex)
        assert self.base is not None
        a, b = self.base
        d = q[..., 2 * b] - q[..., 2 * a] + 1j * (q[..., 2 * b + 1] - q[..., 2 * a + 1])
        return d / np.maximum(np.abs(d), 1e-300)


def parameters(problem: PathGeneration, z: np.ndarray) -> np.ndarray:
    """All parameters of designs ``(B, variables)``."""
    flat = np.repeat(np.asarray(flattened(problem.system), dtype=float)[None], len(z), axis=0)
    flat[:, problem.variables.at] = z
    return flat
