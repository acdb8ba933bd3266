"""Benchmark problems of the multibody community, ready to be simulated: drawn as published, with masses and forces.

Every function returns a mechanism that is not compiled yet; its ``model.simulate`` holds the start and the duration of
the benchmark. Sources: IFToMM Technical Committee for Multibody Dynamics, Library of Computational Benchmark Problems;
M. González, D. Dopico, U. Lugrís, J. Cuadrado, A benchmarking system for MBS simulation software, Multibody System
Dynamics 16 (2006).
"""

import math

import numpy as np

from jaxnc.library import spatial_loops
from jaxnc.library.drawing import lay_out
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record

_EARTH = 9.81


def pendulum(length: float = 1.0, mass: float = 1.0) -> Mechanism:
    """Simple pendulum: a point mass on a massless rod, released from the horizontal; 10 s.

    Args:
        length: m.
        mass: kg.

    Returns:
        The mechanism; n = 3, g = 1, coordinate ``phi`` is the rod's angle from the x axis.

    Source: IFToMM benchmark A01.
    """
    said = "Point mass on a massless rod."
    m = lay_out("simple pendulum", said, {"O": (0.0, 0.0)}, {"P": (-length, 0.0)}, {"rod": "O P"})
    m.point_mass("mass at P", "P", mass)
    m.angle("phi", at="O", to="P")
    return _prepare(m, 10.0)


def double_pendulum(mass: float = 1.0, length: float = 1.0) -> Mechanism:
    """Two uniform rods in a row, released from the horizontal; chaotic after some seconds.

    Args:
        mass: of each rod, kg.
        length: of each rod, m.

    Returns:
        The mechanism; n = 6, g = 2, coordinates ``alpha`` and ``beta`` are the angles from the x axis.
    """
    moving = {"P": (length, 0.0), "Q": (2.0 * length, 0.0)}
    m = lay_out("double pendulum", "Two rods in a row.", {"O": (0.0, 0.0)}, moving, {"first": "O P", "second": "P Q"})
    for rod in m.model.bodies:
        m.mass(rod, mass)
    m.angle("alpha", at="O", to="P")
    m.angle("beta", at="P", to="Q")
    return _prepare(m, 10.0)


def n_four_bar(loops: int = 2) -> Mechanism:
    """A row of square four-bar loops that all bars leave together: singular twice in every turn; 10 s.

    Uniform rods of 1 m and 1 kg, standing upright, the first tip moving with 1 m/s. When the bars lie in one line the
    constraints lose as many ranks as there are loops, and the mechanism might fold in as many ways.

    Args:
        loops: how many, 2 and 40 in the benchmark.

    Returns:
        The mechanism, g = 1.

    Source: IFToMM benchmark A02.
    """
    m = Mechanism(f"{loops} four-bars", description="A row of square loops with one freedom.")
    for k in range(loops + 1):
        m.ground(f"A{k}", (float(k), 0))
        m.point(f"B{k}", (float(k), 1))
        m.body(f"upright{k}", [f"A{k}", f"B{k}"], mass=1.0)
    for k in range(loops):
        m.body(f"beam{k}", [f"B{k}", f"B{k + 1}"], mass=1.0)
    return _prepare(m, 10.0, {"B0.x": 1.0})


def andrews() -> Mechanism:
    """Andrews' squeezing mechanism: seven bodies, one freedom, driven by a torque against a spring; 0.03 s.

    Returns:
        The mechanism; coordinate ``beta`` is the crank's angle.

    Source: W. Schiehlen (ed.), Multibody Systems Handbook (1990); E. Hairer, G. Wanner, Solving Ordinary Differential
    Equations II, §VII.7; IFToMM benchmark A03 (0.05 s).
    """
    beta, theta, gamma, delta = -0.0617138900142764496358948458001, 0.0, 0.455279819163070380255912382449, 0.487364979543842550225598953530  # noqa: E501  # fmt: skip
    epsilon = 1.23054744454982119249735015568

    def turn(angle: float, along: float, across: float) -> np.ndarray:
        c, s = math.cos(angle), math.sin(angle)
        return np.array([along * c - across * s, along * s + across * c])

    a, b, c = np.array([-0.06934, -0.00227]), np.array([-0.03635, 0.03273]), np.array([0.014, 0.072])
    f = turn(beta, 0.007, 0.0)
    e = f - turn(beta + theta, 0.028, 0.0)
    g = a + turn(delta, 0.04, 0.0)
    # Bodies BDE and AH are measured from an axis a quarter turn behind their angle.
    h = a + turn(epsilon - math.pi / 2, 0.04, 0.0)
    d = b + turn(gamma - math.pi / 2, 0.018, 0.02)
    said = "Seven bodies, one freedom, driven against a spring."
    ground, moving = {"O": (0.0, 0.0), "A": a, "B": b, "C": c}, {"F": f, "E": e, "G": g, "H": h, "D": d}
    m = lay_out("Andrews' squeezer", said, ground, moving, {})
    m.body("K1", ["O", "F"], mass=0.04325, com=turn(beta, 0.00092, 0.0), inertia=2.194e-6)
    m.body("K2", ["F", "E"], mass=0.00365, com=f + 0.0115 / 0.028 * (e - f), inertia=4.410e-7)
    m.body("K3", ["B", "E", "D"], mass=0.02373, com=b + turn(gamma - math.pi / 2, 0.01874, 0.01043), inertia=5.255e-6)
    m.body("K4", ["G", "E"], mass=0.00706, com=g + (0.02 - 0.01421) / 0.02 * (e - g), inertia=5.667e-7)
    m.body("K5", ["A", "G"], mass=0.07050, com=a + turn(delta, 0.02308, 0.00916), inertia=1.169e-5)
    m.body("K6", ["H", "E"], mass=0.00706, com=h + (0.02 - 0.01421) / 0.02 * (e - h), inertia=5.667e-7)
    m.body("K7", ["A", "H"], mass=0.05498, com=a + turn(epsilon - math.pi / 2, 0.01228, -0.00449), inertia=1.912e-5)
    m.angle("beta", at="O", to="F")
    m.torque("motor", "beta", 0.033)
    m.spring("spring", "C", "D", stiffness=4530.0, free=0.07785)
    return _prepare(m, 0.03, gravity=None)


def bricard() -> Mechanism:
    """Bricard's linkage as five square bars of 1 m and 1 kg, released under gravity; overconstrained; 10 s.

    The bars are cuboids of 1 × 0.1 × 0.1 m, so that their sections turn with them.

    Returns:
        The mechanism, as `jaxnc.library.bricard`, with masses; gravity along -y.

    Source: IFToMM benchmark A04.
    """
    m = spatial_loops.bricard(1.0)
    for k in range(1, 6):
        m.mass(f"link{k}", 1.0, shape="box", size=(1.0, 0.1, 0.1))
    return _prepare(m, 10.0, gravity=(0.0, -_EARTH, 0.0))


def flyball_governor(stiffness: float = 8e5, damping: float = 4e4) -> Mechanism:
    """A governor whose arms are held by stiff damped struts to a slider on the spinning shaft; 10 s.

    Shaft and arms are bars of 1 m and 0.01 m square, the slider a cube of 0.1 m, all of 3000 kg/m³; balls of 5 kg at
    the ends of the arms. The arms are hinged to the top of the shaft, 0.1 m apart, and hang 30° below the horizontal;
    everything turns with 2π rad/s. Struts of 0.5 m, spring and damper, join the middles of the arms to the slider: they
    make the equations stiff.

    Args:
        stiffness: of each strut, N/m.
        damping: of each strut, N s/m.

    Returns:
        The mechanism, g = 4 (spin, two arms, slider); point ``S`` is the slider's centre.

    Source: IFToMM benchmark A05.
    """
    lean = math.radians(30)
    m = Mechanism("flyball governor", dim=3, description="Arms on stiff struts on a spinning shaft.")
    m.ground("O", (0, 0, 0))
    m.ground_vector("z", (0, 0, 1))
    m.vector("h", (0, 1, 0))
    m.point("S", (0, 0, 0.5))
    sides = (("1", 1.0), ("2", -1.0))
    for side, sign in sides:
        top = np.array([0.05 * sign, 0.0, 1.0])
        along = np.array([sign * math.cos(lean), 0.0, -math.sin(lean)])
        for name, at in (("A", top), ("M", top + 0.5 * along), ("P", top + along), ("E", (0.05 * sign, 0.0, 0.5))):
            m.point(f"{name}{side}", at)
    thin, thick = 0.3 / 12 * 2e-4, 0.3 / 12 * (1.0 + 1e-4)
    m.body("shaft", ["O", "A1", "A2"], vectors=["z", "h"], mass=0.3, com=(0, 0, 0.5), inertia=(thick, thick, thin))
    m.body("slider", ["S", "E1", "E2"], vectors=["z", "h"], mass=3.0, com=(0, 0, 0.5), inertia=(0.005, 0.005, 0.005))
    m.cylindrical("guide", line=("O", "z"), on="S")
    for side, _ in sides:
        ends = [f"A{side}", f"P{side}", f"M{side}"]
        m.body(f"arm{side}", ends, vectors=["h"], mass=0.3, shape="box", size=(1.0, 0.01, 0.01))
        m.point_mass(f"ball{side}", f"P{side}", 5.0)
        m.spring(f"strut{side}", f"M{side}", f"E{side}", stiffness=stiffness)
        m.damper(f"loss{side}", f"M{side}", f"E{side}", damping=damping)
    return _prepare(m, 10.0, {"h.x": -2 * math.pi}, (0.0, 0.0, -_EARTH))


def spatial_slider_crank() -> Mechanism:
    """Haug's spatial slider-crank: crank, conrod on a ball and a universal joint, slider along x; 5 s.

    Crank of 0.08 m and 0.12 kg about an axis along x through (0, 0.1, 0.12), conrod of 0.3 m and 0.5 kg with
    (0.0004, 0.004, 0.004) kg m² along and across it, slider of 2 kg; centres of mass in the middle. The arm ``k``
    of the cross at C that turns in the conrod is across the conrod and the slider's way.

    Returns:
        The mechanism; n = 9, g = 1. Coordinates ``phi`` (the crank's angle from the drawing) and ``s`` (the slider's
        place on its axis).

    Source: IFToMM benchmark "spatial rigid slider-crank mechanism"; E. J. Haug, Computer Aided Kinematics and Dynamics
    of Mechanical Systems, vol. 1 (1989), §12.2.
    """
    crank, conrod = 0.08, 0.3
    a = np.array([0.0, 0.1, 0.12])
    b = a + np.array([0.0, 0.0, crank])
    c = np.array([math.sqrt(conrod**2 - b[1] ** 2 - b[2] ** 2), 0.0, 0.0])
    along = (c - b) / conrod
    m = Mechanism("spatial slider-crank", dim=3, description="Crank about x, slider along x, a rod between them.")
    m.ground("A", a)
    m.ground("O", (0, 0, 0))
    m.ground_vector("x", (1, 0, 0))
    m.ground_vector("z", (0, 0, 1))
    m.point("B", b)
    m.point("C", c, fixed="yz")
    m.vector("k", np.cross((1.0, 0.0, 0.0), along))
    m.body("crank", ["A", "B"], vectors=["x"], mass=0.12, com=(a + b) / 2, inertia=(1e-4, 1e-4, 1e-5))
    inertia = 0.004 * np.eye(3) - 0.0036 * np.outer(along, along)
    m.body("conrod", ["B", "C"], vectors=["k"], mass=0.5, com=(b + c) / 2, inertia=inertia)
    m.body("slider", ["C"], vectors=["x", "z"], mass=2.0, com=c, inertia=(1e-4, 1e-4, 1e-4))
    m.universal("cross", axes=("x", "k"))
    m.angle("phi", to=("A", "B"), about="x")
    m.distance("s", "O", "C", along="x")
    return _prepare(m, 5.0, {"phi": 6.0}, (0.0, 0.0, -_EARTH))


def heavy_top() -> Mechanism:
    """A heavy symmetric top on a fixed tip, spinning at 150 rad/s; 2 s.

    Mass 15 kg with its centre 1 m from the tip, along the axis y of the body; inertia (0.234375, 0.46875, 0.234375)
    kg m² about it; ω = (0, 150, -4.61538) rad/s at the start.

    Returns:
        The mechanism, g = 3.

    Source: M. Géradin, A. Cardona, Flexible Multibody Dynamics (2001), §5.8; M. Arnold, O. Brüls, A. Cardona,
    Numerische Mathematik 129 (2015).
    """
    m = Mechanism("heavy top", dim=3, description="Symmetric top on a fixed tip.")
    m.ground("O", (0, 0, 0))
    m.point("C", (0, 1, 0))
    m.vector("u", (1, 0, 0))
    m.body("top", ["O", "C"], vectors=["u"], mass=15.0, com=(0, 1, 0), inertia=(0.234375, 0.46875, 0.234375))
    w = np.array([0.0, 150.0, -4.61538])
    rates = {}
    for name, at in (("C", (0, 1, 0)), ("u", (1, 0, 0))):
        for axis, value in zip("xyz", np.cross(w, at), strict=True):
            rates[f"{name}.{axis}"] = float(value)
    return _prepare(m, 2.0, rates, (0.0, 0.0, -_EARTH))


def _prepare(
    m: Mechanism,
    duration: float,
    rates: dict[str, float] | None = None,
    gravity: tuple[float, ...] | None = (0.0, -_EARTH),
) -> Mechanism:
    m.gravity = gravity
    m.model.simulate = record.Simulation(duration=duration, rates=rates or {})
    return m


BENCHMARKS = {
    f.__name__.replace("_", "-"): f
    for f in (
        pendulum,
        double_pendulum,
        n_four_bar,
        andrews,
        bricard,
        flyball_governor,
        spatial_slider_crank,
        heavy_top,
    )
}
"""Every benchmark problem by its name with dashes."""
