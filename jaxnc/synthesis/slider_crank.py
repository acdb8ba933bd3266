"""A slider-crank by the places of its joints, and function generation with one: its displacement at three angles."""

import dataclasses
import functools
import math

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.position import sweep
from jaxnc.mechanism import Mechanism
from jaxnc.synthesis.linkage import Point, complex_of, point_of
from jaxnc.system.system import System
from jaxnc.types import ArrayLike

_POSES = 61


@public
@dataclasses.dataclass(frozen=True)
class SliderCrank:
    """A slider-crank A-B-C as drawn in one pose; C slides along a fixed line.

    Args:
        A: fixed pivot of the crank, lengths.
        B: crank pin.
        C: slider.
        direction: direction of the line through C, any length.
        P: point of the connecting rod; B if not given.
    """

    A: Point
    B: Point
    C: Point
    direction: Point = (1.0, 0.0)
    P: Point | None = None

    def __post_init__(self):
        for name in ("A", "B", "C", "direction", "P"):
            value = getattr(self, name)
            value = self.B if name == "P" and value is None else value
            object.__setattr__(self, name, point_of(complex_of("slider-crank", name, value)))
        if self.direction == (0.0, 0.0):
            raise InputError("slider-crank: direction = (0, 0) has no direction; give the line's, such as (1, 0)")
        for one, other in ("AB", "BC"):
            if getattr(self, one) == getattr(self, other):
                raise InputError(f"slider-crank: {one} and {other} are drawn at the same place; bars need a length")

    @property
    def ratio(self) -> complex:
        """Shape of the connecting rod: (P - B) / (C - B) as a complex number."""
        b, c, p = (complex(*v) for v in (self.B, self.C, self.P or self.B))
        return (p - b) / (c - b)

    @property
    def _line(self) -> complex:
        """From the slider along its guide, as long as the connecting rod."""
        way = complex(*self.direction)
        return way / abs(way) * abs(complex(*self.C) - complex(*self.B))

    def mechanism(self, name: str = "slider-crank") -> Mechanism:
        """A description with the angles ``phi`` of the crank and ``theta`` of the connecting rod, from the x axis."""
        m = Mechanism(name)
        m.ground("A", self.A)
        m.ground("G", self.C)
        m.ground("H", point_of(complex(*self.C) + self._line))
        m.point("B", self.B)
        m.point("C", self.C)
        m.point("P", self.P or self.B)
        m.body("crank", ["A", "B"])
        m.body("conrod", ["B", "C", "P"])
        m.slot("guide", "C", ("G", "H"))
        m.body("slider", ["C"])
        m.angle("phi", at="A", to="B")
        m.angle("theta", at="B", to="C")
        return m

    @property
    def system(self) -> System:
        """The compiled slider-crank: angles ``phi`` and ``theta``, all from the x axis."""
        places = {name: np.array(getattr(self, name)) for name in "ABCP"}
        c, line = complex(*self.C), self._line
        return _template().replace(places | {"G": places["C"], "H": np.array(point_of(c + line))})


@functools.cache
def _template() -> System:
    """One compiled slider-crank, so that all of them share what is compiled for one."""
    return SliderCrank((0.0, 0.0), (0.3, 0.8), (2.1, 0.1), (1.0, 0.0), (1.0, 1.0)).mechanism().compile()


@public
def slider_crank_function(inputs: ArrayLike, outputs: ArrayLike) -> tuple[SliderCrank, float]:
    """The slider-crank whose slider stands at three given places when its crank stands at three given angles.

    With the crank pivot as origin, the guide parallel to the x axis at height e and the slider at s:
    s² = K1 s cos φ + K2 sin φ + K3, with K1 = 2 crank, K2 = 2 crank e, K3 = conrod² - crank² - e²; linear.

    Args:
        inputs: crank angles φ from the x axis, radians, ``(3,)``, in order.
        outputs: places s of the slider along x from the crank pivot, lengths, ``(3,)``.

    Returns:
        The slider-crank, drawn at the first angle, and the largest deviation of s after really moving it through the
        three angles, a length; NaN if a dead point stops it, as large as it is if it changes its branch.

    Raises:
        InputError: not three angles and places, or a crank without length.

    Source: F. Freudenstein (1955) by analogy; R. S. Hartenberg and J. Denavit, Kinematic Synthesis of Linkages (1964),
    chapter 10.
    """
    phi, s = np.asarray(inputs, float), np.asarray(outputs, float)
    if phi.shape != (3,) or s.shape != (3,) or not (np.isfinite(phi).all() and np.isfinite(s).all()):
        raise InputError(
            f"slider_crank_function: inputs {phi.shape} and outputs {s.shape} must be three finite numbers each"
        )
    if not (np.all(np.diff(phi) > 0) or np.all(np.diff(phi) < 0)):
        raise InputError("slider_crank_function: inputs must increase (or decrease) from one angle to the next")
    matrix = np.stack([s * np.cos(phi), np.sin(phi), np.ones(3)], axis=1)
    if np.linalg.cond(matrix) > 1e13:
        raise InputError("slider_crank_function: the three equations do not determine the bars; choose other inputs")
    k = np.linalg.solve(matrix, s * s)
    crank = 0.5 * k[0]
    if abs(crank) < 1e-12 * np.abs(s).max():
        raise InputError("slider_crank_function: the crank would have no length; choose other outputs")
    offset = 0.5 * k[1] / crank
    pin = crank * np.exp(1j * phi[0])
    found = SliderCrank((0.0, 0.0), (pin.real, pin.imag), (float(s[0]), float(offset)))
    turned = phi + (math.pi if crank < 0 else 0.0)
    turned = turned - 2 * np.pi * np.round((turned[0] - np.angle(pin)) / (2 * np.pi))
    way = np.concatenate([np.linspace(turned[0], turned[1], _POSES // 2, endpoint=False),
                          np.linspace(turned[1], turned[2], _POSES - _POSES // 2)])  # fmt: skip
    motion = sweep(found.system, {"phi": way})
    if not np.asarray(motion.converged).all():
        return found, math.nan
    moved = np.asarray(motion["C"])[[0, _POSES // 2, -1], 0]
    return found, float(np.abs(moved - s).max())
