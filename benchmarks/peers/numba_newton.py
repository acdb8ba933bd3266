"""Scalar Newton in numba, four unknowns, LU with partial pivoting."""

import math
from collections.abc import Callable

import numba
import numpy as np

from benchmarks.circles import FourBars

_MOST = 50
_TOLERANCE = 1e-12


def newton(bars: FourBars) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """A compiled function of angles ``(N,)``: points C ``(N, 2)`` and whether they converged."""
    a, b, c, d = (float(x) for x in (bars.crank, bars.coupler, bars.rocker, bars.ground))
    home = np.concatenate([np.asarray(p) for p in bars.poses(bars.home)])
    side, tolerance = float(bars.side), _TOLERANCE * float(bars.ground) ** 2

    @numba.njit
    def solve(phi, home):
        out, good = np.empty((phi.shape[0], 2)), np.empty(phi.shape[0], np.bool_)
        r, jac, q = np.empty(4), np.empty((4, 4)), np.empty(4)
        for k in range(phi.shape[0]):
            pin_x, pin_y = a * math.cos(phi[k]), a * math.sin(phi[k])
            q[:] = home
            ok = False
            for _ in range(_MOST + 1):
                px, py, rx, ry = q[2] - q[0], q[3] - q[1], q[2] - d, q[3]
                r[0], r[1] = d * (q[0] - pin_x), d * (q[1] - pin_y)
                r[2], r[3] = px * px + py * py - b * b, rx * rx + ry * ry - c * c
                ok = max(abs(r[0]), abs(r[1]), abs(r[2]), abs(r[3])) < tolerance
                if ok:
                    break
                jac[:] = 0.0
                jac[0, 0] = jac[1, 1] = d
                jac[2, 0], jac[2, 1], jac[2, 2], jac[2, 3] = -2 * px, -2 * py, 2 * px, 2 * py
                jac[3, 2], jac[3, 3] = 2 * rx, 2 * ry
                for j in range(4):
                    p = j
                    for i in range(j + 1, 4):
                        if abs(jac[i, j]) > abs(jac[p, j]):
                            p = i
                    if p != j:
                        for i in range(4):
                            jac[j, i], jac[p, i] = jac[p, i], jac[j, i]
                        r[j], r[p] = r[p], r[j]
                    for i in range(j + 1, 4):
                        f = jac[i, j] / jac[j, j]
                        for m in range(j, 4):
                            jac[i, m] -= f * jac[j, m]
                        r[i] -= f * r[j]
                for i in range(3, -1, -1):
                    for m in range(i + 1, 4):
                        r[i] -= jac[i, m] * r[m]
                    r[i] /= jac[i, i]
                for i in range(4):
                    q[i] -= r[i]
            out[k, 0], out[k, 1] = q[2], q[3]
            good[k] = ok and side * ((q[2] - q[0]) * q[3] - (q[3] - q[1]) * (q[2] - d)) > 0
        return out, good

    return lambda phi: solve(phi, home)
