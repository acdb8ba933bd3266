"""Where places of the parts are in all poses of a motion, and how far they leave straight lines between them."""

from dataclasses import dataclass, replace

import numpy as np

from jaxnc.kinematics.host_solve import analyse_on_host
from jaxnc.kinematics.inputs import make_plan
from jaxnc.kinematics.motion import Motion
from jaxnc.solvers.assembly import derive

_GROWN = 2.0  # accelerations between two poses are at most so many times those at them
_SAME = 1e-6  # of the size: a pose that was found again


@dataclass(frozen=True)
class Course:
    """Stretches between neighbouring poses, in order."""

    motion: Motion
    weights: np.ndarray  # places as linear functions of the points, (places, points), complex
    constant: np.ndarray  # what is added, (places,)
    unit: float  # mm in a unit of length
    # Numbers of the poses at both ends of each stretch, (2, K); fractions lie between poses of the motion.
    s: np.ndarray
    z: np.ndarray  # places there, (2, K, places), complex, mm
    a: np.ndarray  # their second derivatives by s
    driven: bool  # whether poses in between can be found, by the inputs

    @classmethod
    def of(cls, motion: Motion, weights: np.ndarray, constant: np.ndarray, unit: float) -> "Course":
        """The stretches between the poses of a motion ``(T,)``, T > 2."""
        count = len(np.asarray(motion.status))
        s = np.stack([np.arange(count - 1.0), np.arange(1.0, count)])
        z = points(motion, unit) @ weights.T + constant
        both = np.stack([z[:-1], z[1:]])
        bare = cls(motion, weights, constant, unit, s, both, both, bool(motion.driven))
        if motion.driven:
            found = bare.solved(s, s[0].astype(int))
            size = max(float(np.ptp(np.abs(z))), float(np.abs(z).max()), 1e-300)
            if found is not None and np.abs(found[0] - both).max() <= _SAME * size:
                return replace(bare, a=found[1])
        # Nothing drives it, as in a simulation, or not everywhere, as on a circuit: by differences of its poses.
        step = np.diff(z, 2, axis=0)
        a = np.concatenate([step[:1], step, step[-1:]])
        return replace(bare, a=np.stack([a[:-1], a[1:]]), driven=False)

    @property
    def sags(self) -> np.ndarray:
        """How far each place leaves the straight line between both ends of a stretch, at most, mm, ``(K, places)``."""
        return _GROWN / 8 * (self.s[1] - self.s[0])[:, None] ** 2 * np.abs(self.a).max(axis=0)

    def solved(self, s: np.ndarray, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Places and their second derivatives at numbers of poses ``(..., L)``, each in a stretch of the motion."""
        motion = self.motion
        asked = np.asarray(motion.asked, float)
        k = np.broadcast_to(stretch, s.shape).reshape(-1)
        slope = asked[k + 1] - asked[k]
        values = asked[k] + (s.reshape(-1) - k)[:, None] * slope
        near = np.asarray(motion.q, float)[np.minimum(np.rint(s.reshape(-1)).astype(int), len(asked) - 1)]
        view, eq = make_plan(motion.system, motion.driven, motion.held), derive(motion.system)
        found = analyse_on_host(view, "guess", eq, near, values, (slope, np.zeros_like(slope)))
        if found.status.any():
            return None
        z, a = (_complex(x, motion, self.unit) @ self.weights.T for x in (found.q, found.rates[1]))
        shape = (*s.shape, len(self.weights))
        return (z + self.constant).reshape(shape), a.reshape(shape)

    def split(self, which: np.ndarray) -> tuple["Course", np.ndarray] | None:
        """Halve some stretches ``(K,)``; also from which one each comes. None where that cannot be done."""
        if not self.driven:
            return None
        at = np.flatnonzero(which)
        middle = self.s[:, at].mean(axis=0)
        found = self.solved(middle, np.floor(self.s[0, at]).astype(int))
        if found is None:
            return None
        if (np.abs(found[0] - self.z[:, at].mean(axis=0)) > self.sags[at] + _SAME * np.abs(found[0])).any():
            return None  # another branch, or no smooth motion

        def joined(old: np.ndarray, new: np.ndarray) -> np.ndarray:
            first, last = np.stack([old[0, at], new]), np.stack([new, old[1, at]])
            return np.concatenate([old[:, ~which], first, last], axis=1)

        s, z, a = (joined(x, y) for x, y in zip((self.s, self.z, self.a), (middle, *found), strict=True))
        source = np.concatenate([np.flatnonzero(~which), at, at])
        return replace(self, s=s, z=z, a=a), source


def points(motion: Motion, unit: float) -> np.ndarray:
    """Points of a motion as complex numbers ``(T, points)``, mm."""
    return _complex(np.asarray(motion.q, float), motion, unit)


def _complex(q: np.ndarray, motion: Motion, unit: float) -> np.ndarray:
    """Points of coordinates ``(T, N)``, or of their rates, as complex numbers, mm."""
    x = q[:, : 2 * len(motion.system.topology.points)] * unit
    return x[:, ::2] + 1j * x[:, 1::2]
