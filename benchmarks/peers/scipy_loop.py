"""A loop over scipy.optimize.fsolve, two unknowns with their Jacobian, one angle after the other."""

import math
from collections.abc import Callable

import numpy as np
import scipy.optimize

from benchmarks.circles import FourBars


def fsolve_loop(bars: FourBars) -> Callable[[np.ndarray], np.ndarray]:
    """A function of angles ``(N,)``: points C ``(N, 2)``."""
    a, b, c, d = (float(x) for x in (bars.crank, bars.coupler, bars.rocker, bars.ground))
    home = np.asarray(bars.poses(bars.home)[1])

    def residual(q, bx, by):
        px, py, rx = q[0] - bx, q[1] - by, q[0] - d
        return (px * px + py * py - b * b, rx * rx + q[1] * q[1] - c * c)

    def jacobian(q, bx, by):
        return ((2 * (q[0] - bx), 2 * (q[1] - by)), (2 * (q[0] - d), 2 * q[1]))

    def run(phi):
        out = np.empty((len(phi), 2))
        for k, angle in enumerate(phi):
            pin = (a * math.cos(angle), a * math.sin(angle))
            out[k] = np.asarray(scipy.optimize.fsolve(residual, home, pin, fprime=jacobian, xtol=1e-11))
        return out

    return run
