"""A four-bar that guides a body, and whether it really does: moved through the poses from either of its bars."""

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

from jaxnc.calls import public
from jaxnc.kinematics.planar import transmission_angle
from jaxnc.synthesis.linkage import FourBar, wrapped
from jaxnc.system.system import System

if TYPE_CHECKING:
    from jaxnc.synthesis.burmester import Dyad

_STEPS = 48  # between first and last pose: one shape for 2 to 5 poses, so that it is compiled once
_MET = 1e-8  # of the size: a pose further off than this, after really moving there, is not reached


@public
@dataclasses.dataclass(frozen=True)
class GuidedFourBar:
    """A four-bar through given poses; ``print()`` says how well.

    Attributes:
        linkage: the four-bar, drawn in the first pose; P is the body's origin, and the crank A-B drives it.
        inputs: crank angle ``phi`` in every pose, in the order of the poses, radians, ``(n,)``.
        error: largest distance from a pose after really moving there: lengths, and angles times the poses' size; NaN
            if it does not get there.
        transmission: smallest transmission angle on the way, radians; 0 if it does not get there.
        defects: ``"circuit"``: some poses belong to the other assembly of the linkage; ``"branch"``: a dead point of
            either bar lies between; ``"order"``: the poses are passed in another order. Empty: the design works.
    """

    linkage: FourBar
    inputs: np.ndarray
    error: float
    transmission: float
    defects: tuple[str, ...]

    @property
    def system(self) -> System:
        """The compiled linkage: drive ``phi`` through `inputs`."""
        return self.linkage.system

    def __str__(self) -> str:
        sizes = ", ".join(f"{name} {value:.6g}" for name, value in self.linkage.lengths.items())
        state = f"{', '.join(self.defects)} defect" if self.defects else f"works, error {self.error:.1e}"
        angle = f"; transmission angle ≥ {math.degrees(self.transmission):.1f}°" if not self.defects else ""
        return f"four-bar: {sizes}; {self.linkage.grashof.type}; {state}{angle}"

    __repr__ = __str__


def guided(poses: np.ndarray, crank: "Dyad", rocker: "Dyad") -> GuidedFourBar:
    """Assemble two dyads and move them through the poses, from either bar and in either direction.

    Returns:
        The linkage driven by the bar and in the direction that pass all poses in order; the given crank if none does.
    """
    best: GuidedFourBar | None = None
    for first, second in ((crank, rocker), (rocker, crank)):
        linkage = FourBar(first.fixed, first.moving, second.moving, second.fixed, (poses[0, 0], poses[0, 1]))
        way = first.places - np.array(first.fixed)
        angles = np.arctan2(way[:, 1], way[:, 0])
        for direction in (1.0, -1.0):
            steps = direction * np.mod(direction * np.diff(angles), 2.0 * np.pi)
            if abs(steps.sum()) > 2.0 * np.pi:
                continue  # more than one turn: the poses are passed in another order
            inputs = angles[0] + np.concatenate([[0.0], np.cumsum(steps)])
            error, transmission = _moved(linkage, inputs, poses)
            if error <= _MET * _size(poses):
                found = GuidedFourBar(linkage, inputs, error, transmission, ())
                if best is None or found.transmission > best.transmission:
                    best = found
    if best is not None:
        return best
    linkage = FourBar(crank.fixed, crank.moving, rocker.moving, rocker.fixed, (poses[0, 0], poses[0, 1]))
    way = crank.places - np.array(crank.fixed)
    inputs = np.unwrap(np.arctan2(way[:, 1], way[:, 0]))
    return GuidedFourBar(linkage, inputs, math.nan, 0.0, (_defect(linkage, crank, rocker),))


def _size(poses: np.ndarray) -> float:
    return max(float(np.ptp(poses[:, :2], axis=0).max()), 1e-300)


def _moved(linkage: FourBar, inputs: np.ndarray, poses: np.ndarray) -> tuple[float, float]:
    """Error in the poses and smallest transmission angle of the sweep through them; infinite, 0 if it stops."""
    parts = _STEPS // (len(poses) - 1)
    at = np.arange(len(poses)) * parts
    motion = linkage.move({"phi": np.interp(np.arange(_STEPS + 1), at, inputs)})
    if not np.asarray(motion.converged).all():
        return math.inf, 0.0
    place = np.asarray(motion["P"])[at]
    turn = np.asarray(motion["theta"])[at]
    off = np.hypot(*(place - poses[:, :2]).T)
    tilt = np.abs(wrapped(turn - turn[0] - poses[:, 2] + poses[0, 2])) * _size(poses)
    least = float(np.min(np.asarray(transmission_angle(motion, "B", "C", "D"))))
    return float(max(off.max(), tilt.max())), least


def _defect(linkage: FourBar, crank: "Dyad", rocker: "Dyad") -> str:
    """Why the poses are not passed in order.

    A Grashof linkage never passes the pose in which the two bars not next to its shortest one are in line: the side of
    that triangle tells its two circuits apart. A bar cannot drive past the pose in which the other two are in line.

    Source: T. R. Chase and J. A. Mirth, Circuits and branches of single-degree-of-freedom planar linkages, J. Mech.
    Des. 115 (1993) 223-230.
    """
    a, d = complex(*crank.fixed), complex(*rocker.fixed)
    b, c = (x.places[:, 0] + 1j * x.places[:, 1] for x in (crank, rocker))

    def sides(p, q, r) -> bool:
        cross = (np.conj(p - q) * (r - q)).imag
        return bool(np.all(cross > 0) or np.all(cross < 0))

    joints = {"B": sides(a, b, c), "C": sides(b, c, d), "A": sides(b, a, d), "D": sides(a, d, c)}
    if linkage.grashof.margin > 0:
        lengths = linkage.lengths
        shortest = min(lengths, key=lambda name: lengths[name])
        opposite = {"ground": "BC", "crank": "CD", "coupler": "AD", "rocker": "AB"}[shortest]
        if not all(joints[name] for name in opposite):
            return "circuit"
    # Crank-driven the side of B-C-D is kept, rocker-driven that of A-B-C.
    return "order" if joints["C"] or joints["B"] else "branch"
