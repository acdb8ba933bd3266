"""Published cases of path and function generation, and what was reached elsewhere."""

import numpy as np

import jaxnc as nc
from benchmarks.synthesis.case import Case
from jaxnc.synthesis.result import Result

S = nc.synthesis
SIX = [(20.0, 20.0 + 5 * k) for k in range(6)]  # Cabrera, Simon & Prado 2002, case 1
ARC = [(3.0, 3.0), (2.759, 3.363), (2.372, 3.663), (1.89, 3.862), (1.355, 3.943)]  # Kunjur & Krishnamurty 1997
ARCH = [(0.0, 0.0), (1.9098, 5.8779), (6.9098, 9.5106), (13.09, 9.5106), (18.09, 5.8779), (20.0, 0.0)]
YU = [
    *((-27.0, 1.0), (-21.857, -3.214), (-16.7, -7.428), (-11.571, -11.642), (-6.428, -15.857), (-1.285, -20.071)),
    *((3.857, -24.285), (9.0, -28.5), (15.0, -29.9), (20.0, -30.0), (27.2, -25.0), (29.2, -20.0), (28.0, -10.0)),
    *((22.7, 2.0), (15.0, 10.6), (5.0, 16.5), (-10.0, 19.6), (-22.0, 17.0), (-28.0, 11.0), (-29.0, 5.0)),
]
# Bulatovic, Miodragovic & Boskovic 2016; its points 21 and 22 are exchanged, since they run backwards as printed.
MKH_25 = [
    (7.03, 5.99),
    (6.95, 5.45),
    (6.77, 5.03),
    (6.4, 4.6),
    (5.91, 4.03),
    (5.43, 3.56),
    (4.93, 2.94),
    (4.67, 2.6),
    (4.38, 2.2),
    (4.04, 1.67),
    (3.76, 1.22),
    (3.76, 1.97),
    (3.76, 2.78),
    (3.76, 3.56),
    (3.76, 4.34),
    (3.76, 4.91),
    (3.76, 5.47),
    (3.8, 5.98),
    (4.07, 6.4),
    (4.53, 6.75),
    (5.05, 6.84),
    (5.07, 6.85),
    (5.89, 6.83),
    (6.41, 6.8),
    (6.92, 6.58),
]
# Hsieh 2017: places and directions.
POSES_9 = [
    (18.8, 12.1, -51.56620156177),
    (13.3, 18.1, 0.0),
    (6.3, 19.8, 40.10704565916),
    (-0.4, 17.1, 85.94366926962),
    (-2.7, 10.3, 160.42818263663),
    (-1.1, 6.0, -131.78029288009),
    (0.2, 1.7, -114.59155902616),
    (3.4, -2.2, -108.86198107486),
    (7.8, -4.9, -120.32113697747),
]
ANY = S.transmission_angle(0)  # of the cases whose best design passes a dead point within 5 degrees
ELLIPSE = [  # Cabrera, Simon & Prado 2002, case 5, with their five digits
    (float(f"{10 + 10 * np.cos(t):.5g}"), float(f"{10 + 8 * np.sin(t):.5g}")) for t in np.radians(40.0 * np.arange(10))
]


def four_bar(tracer: bool = True) -> nc.Mechanism:
    """The idea: with a coupler point, or with the angle of the rocker."""
    m = nc.Mechanism("four-bar")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    m.point("B", (0.5, 1))
    m.point("C", (3.3, 2.9))
    if tracer:
        m.point("P", (1.8, 3.2))
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C", "P"] if tracer else ["B", "C"])
    m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B", start="D")
    if not tracer:
        m.angle("psi", at="D", to="C")
    return m


def lengths(low: float, high: float) -> dict:
    """Bounds of the four sides."""
    return {name: (low, high) for name in ("A-D", "A-B", "B-C", "C-D")}


def square(result: Result) -> float:
    """Sum of squared distances, the coupler point drawn with compasses from the lengths of the drawing."""
    problem, best = result.problem, result.designs[0]
    A, B, C, D, P = (np.asarray(best.system[n]) @ [1, 1j] for n in "ABCDP")
    a, b, c = abs(B - A), abs(C - B), abs(C - D)
    side = np.sign(((C - B) * np.conj(D - B)).imag)
    pin = A + a * np.exp(1j * best.inputs) * (D - A) / abs(D - A)
    d = D - pin
    along = (b * b - c * c + abs(d) ** 2) / (2 * abs(d))
    joint = pin + (along + 1j * side * np.sqrt(b * b - along**2)) * d / abs(d)
    point = pin + (P - B) / (C - B) * (joint - pin)
    return float(np.sum(np.abs(point - problem.target @ [1, 1j]) ** 2))  # pyright: ignore


def _line():
    return S.PathGeneration(
        four_bar(),
        "P",
        SIX,
        bounds={**lengths(0, 60), "A": (-60, 60)},
        subject_to=[S.crank_turns("crank-rocker"), S.local("P", ("B", "C"), (-60, 60), (-60, 60))],
    )


def _arc():
    return S.PathGeneration(
        four_bar(),
        "P",
        ARC,
        timing=np.radians([30, 45, 60, 75, 90]),
        free=["D.x", "B", "C", "P"],
        bounds=lengths(0, 50),
        subject_to=[S.crank_turns("crank-rocker"), S.local("P", ("B", "C"), (-50, 50), (-50, 50))],
    )


def _arch():
    return S.PathGeneration(
        four_bar(),
        "P",
        ARCH,
        timing=np.radians([30, 60, 90, 120, 150, 180]),
        bounds={**lengths(5, 50), "A": (-50, 50)},
        subject_to=[S.crank_turns("crank-rocker"), S.local("P", ("B", "C"), (-50, 50), (-50, 50))],
    )


def _arch_any():
    return S.PathGeneration(
        four_bar(),
        "P",
        ARCH,
        timing=np.radians([30, 60, 90, 120, 150, 180]),
        bounds={**lengths(0, 50), "A": (-50, 50)},
        subject_to=[S.crank_turns("crank-rocker"), S.local("P", ("B", "C"), (-50, 50), (-50, 50)), ANY],
    )


def _ellipse(high: float):
    return S.PathGeneration(
        four_bar(), "P", ELLIPSE, bounds=lengths(0, high), subject_to=[S.crank_turns("crank-rocker")]
    )


def _mkh():
    return S.PathGeneration(
        four_bar(), "P", MKH_25, closed=True, bounds=lengths(0, 60), subject_to=[S.crank_turns("crank-rocker"), ANY]
    )


def _poses():
    place, turn = np.array(POSES_9)[:, :2], np.radians(np.array(POSES_9)[:, 2])
    return S.MotionGeneration(four_bar(), "coupler", "P", place, turn, reach=1.0, subject_to=[ANY])


def _yu():
    return S.PathGeneration(
        four_bar(), "P", YU, closed=True, bounds=lengths(1, 100), subject_to=[S.crank_turns("crank-rocker")]
    )


def _logarithm():
    x = np.linspace(1, 2, 121)
    return S.FunctionGeneration(
        four_bar(tracer=False),
        "psi",
        np.radians(60) * (x - 1),
        np.radians(90) * np.log10(x) / np.log10(2),
        input="phi",
        free=["B", "C", "D.x"],
        input_offset=True,
        output_offset=True,
        minimax=True,
        subject_to=[S.transmission_angle(np.radians(30))],
    )


PUBLISHED = (
    Case(
        "6 points of a line",
        _line,
        {"starts": 12_000, "refine": 240, "enough": 1e-21},
        1e-20,
        "Cabrera, Simon & Prado 2002; found elsewhere: 8.8e-29",
        square,
    ),
    Case(
        "5 timed points",
        _arc,
        {"starts": 3000, "refine": 48},
        7.42e-7,
        "Kunjur & Krishnamurty 1997; best published: 7.4157e-7 (Nguyen-Van et al. 2022)",
        square,
    ),
    Case(
        "6 points of an arch",
        _arch,
        {"starts": 8000, "refine": 96},
        2.580357,
        "Acharyya & Mandal 2009: 2.580357 with lengths of 5 to 50",
        square,
    ),
    Case(
        "6 points of an arch, lengths of 0 to 50",
        _arch_any,
        {},
        1.21622,
        "Nguyen-Van et al. 2022: 1.2162125",
        square,
    ),
    Case(
        "10 points of an ellipse", lambda: _ellipse(80.0), {}, 4.02e-4, "Lin 2010: 4.0199e-4, lengths up to 80", square
    ),
    Case("the same, lengths up to 10,000", lambda: _ellipse(1e4), {}, 1e-20, "exact designs are 860 wide", square),
    Case("25 points", _mkh, {}, 0.036407, "Bulatovic et al. 2016: 0.03872; lengths up to 60", square),
    Case("9 poses", _poses, {}, 0.0015738, "Hsieh 2017: 0.10799; u as unit vectors"),
    Case("20 points", _yu, {"starts": 8000, "refine": 96}, 0.8543, "Yu, Tang & Wang 2007: 3.42982", square),
    Case(
        "log10 x",
        _logarithm,
        {"starts": 1500, "refine": 48},
        0.05,
        "largest error, degrees; 60 and 90 degrees, transmission angle 30 degrees at least",
        lambda r: float(np.degrees(r.error)),
    ),
)
