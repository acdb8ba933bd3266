"""Independent poses of the MacPherson suspension: the knuckle as a rigid body with four unknowns, in NumPy only.

The lower arm turns by an angle, the knuckle by a Gibbs vector (R = I + 2/(1 + g·g)(G + G²)). Conditions: the mount 8
on the strut's axis (two), the tie rod's length, the height of the wheel's centre. No natural coordinates in it.
"""

import numpy as np

from jaxnc import System

POINTS = ("2", "3", "4", "5", "6")
_STEPS = 6  # in which all lanes are led from the drawing to their inputs


class Strut:
    """The suspension as drawn.

    Args:
        system: the compiled library mechanism: only its drawn points are read.
    """

    def __init__(self, system: System):
        self.at = {name: np.asarray(system[name]) for name in ("1", *POINTS, "8", "10")}
        axis = np.asarray(system["v1"])
        self._axis = axis / np.linalg.norm(axis)
        line = self.at["8"] - self.at["3"]
        basis = np.linalg.svd(line[None])[2]
        self._across = basis[1:]
        self._tie = np.sum((self.at["5"] - self.at["10"]) ** 2)

    def _points(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points ``(N, 5, 3)`` and the two directions across the strut, from unknowns ``(N, 4)``."""
        angle, g = z[:, :1], z[:, 1:]
        arm = self.at["2"] - self.at["1"]
        along = self._axis * (self._axis @ arm)
        across = arm - along
        ball = self.at["1"] + along + np.cos(angle) * across + np.sin(angle) * np.cross(self._axis, across)
        square = np.sum(g * g, axis=1)[:, None, None]

        def turn(v):
            first = np.cross(g[:, None], v[None])
            return v[None] + 2 / (1 + square) * (first + np.cross(g[:, None], first))

        local = np.stack([self.at[name] - self.at["2"] for name in POINTS])
        return ball[:, None] + turn(local), turn(self._across)

    def _rest(self, z: np.ndarray, bump: np.ndarray, steer: np.ndarray) -> np.ndarray:
        points, across = self._points(z)
        mount = self.at["8"] - points[:, 1]
        inner = np.broadcast_to(self.at["10"], (len(bump), 3)).copy()
        inner[:, 1] = steer
        tie = points[:, 3] - inner
        off = np.einsum("nk,nik->ni", mount, across)
        return np.stack([off[:, 0], off[:, 1], np.sum(tie * tie, axis=1) - self._tie, points[:, 4, 2] - bump], axis=1)

    def poses(self, bump: np.ndarray, steer: np.ndarray) -> np.ndarray:
        """Points `POINTS`, ``(N, 5, 3)``, for heights of point 6 and places y of point 10."""
        z = np.zeros((len(bump), 4))
        step = 1e-30j * np.eye(4)
        for k in range(1, _STEPS + 1):
            part = k / _STEPS
            b = self.at["6"][2] + part * (bump - self.at["6"][2])
            s = self.at["10"][1] + part * (steer - self.at["10"][1])
            for _ in range(3 if k < _STEPS else 5):
                jac = np.stack([np.imag(self._rest(z + e, b, s)) / 1e-30 for e in step], axis=2)
                z = z - np.linalg.solve(jac, self._rest(z, b, s)[..., None])[..., 0]
        return self._points(z)[0]
