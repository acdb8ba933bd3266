"""Published four-bars and their errors by circles and nearest points: nothing here is shared with the package."""

from typing import NamedTuple

import numpy as np

TIMES = 20_000  # points of a coupler curve among which the nearest is looked for, before it is made exact


class Known(NamedTuple):
    """A published design: lengths of ground, crank, coupler and rocker; the coupler point; place and turn; side.

    Attributes:
        source: who published it.
        lengths: r1, r2, r3, r4.
        point: of the coupler, in its frame: from the crank's end towards the rocker's, and across.
        place: of the crank's fixed pivot.
        turn: of the ground, radians.
        side: of the coupler and rocker, 1 or -1.
        value: the sum of squared distances, recomputed from the digits that are printed.
    """

    source: str
    lengths: tuple[float, float, float, float]
    point: tuple[float, float]
    place: tuple[float, float]
    turn: float
    side: int
    value: float


ARCH_HCDJ = Known(
    "Nguyen-Van et al. 2022, HCDJ",
    (49.99998, 1.3484315, 1.3484507, 50.0),
    (11.384434, 4.4424357),
    (10.194752, -3.694134),
    6.2158799,
    1,
    1.216212467740963,
)
ELLIPSE_LIN = Known(
    "Lin 2010, GA-DE",
    (80.0, 8.045662, 50.81902, 42.20801),
    (-10.63697, -2.29109),
    (8.494813, -0.7579678),
    3.88921,
    1,
    0.00040199210545097157,
)
MKH = Known(
    "Bulatovic, Miodragovic & Boskovic 2016",
    (9.99432, 1.93027, 4.57242, 7.36674),
    (8.0425 * np.cos(0.1874), 8.0425 * np.sin(0.1874)),
    (-2.31301, 2.86189),
    -0.61763,
    1,
    0.038722515421857236,
)


def point(design: Known, crank: np.ndarray) -> np.ndarray:
    """The coupler point at crank angles from the ground line, complex."""
    g, a, b, c = design.lengths
    pin = a * np.exp(1j * crank)
    d = g - pin
    along = (b * b - c * c + abs(d) ** 2) / (2 * abs(d))
    joint = pin + (along + 1j * design.side * np.sqrt(np.maximum(b * b - along**2, 0.0))) * d / abs(d)
    found = pin + complex(*design.point) * (joint - pin) / b
    return complex(*design.place) + np.exp(1j * design.turn) * found


def timed(design: Known, target: np.ndarray, crank: np.ndarray) -> float:
    """The sum of squared distances at given crank angles."""
    return float(np.sum(np.abs(point(design, crank) - target @ [1, 1j]) ** 2))


def nearest(design: Known, target: np.ndarray) -> float:
    """The sum of squared distances from the nearest points of the whole curve."""
    crank = np.linspace(0.0, 2 * np.pi, TIMES, endpoint=False)
    out = 0.0
    for goal in target @ np.array([1, 1j]):
        far = np.abs(point(design, crank) - goal)
        at, step = crank[np.argmin(far)], crank[1]
        for _ in range(60):  # a golden section would do no better: thirds of what is left
            some = np.linspace(at - step, at + step, 5)
            at, step = some[np.argmin(np.abs(point(design, some) - goal))], 0.5 * step
        out += float(np.abs(point(design, np.array([at])) - goal)[0] ** 2)
    return out


def joints(design: Known, crank: float) -> dict[str, complex]:
    """Where the points of a four-bar A-B-C-D with the coupler point P are at a crank angle."""
    place, turn = complex(*design.place), np.exp(1j * design.turn)
    angle = np.array([crank])
    ends = [design._replace(point=at) for at in ((0.0, 0.0), (design.lengths[2], 0.0), design.point)]
    b, c, p = (complex(point(one, angle)[0]) for one in ends)
    return {"A": place, "D": place + design.lengths[0] * turn, "B": b, "C": c, "P": p}
