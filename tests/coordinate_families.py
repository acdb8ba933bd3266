"""Mechanisms of the tests of coordinate families: the worked case of the text, and one that has every joint."""

import math

import jaxnc as nc


def worked(angles: bool = True) -> nc.Mechanism:
    """Figures 3, 4 and 6: crank 1 (A-1), bar 2 (1-2) that slides through arm 3 (D-3), at right angles to it."""
    crank, bar, arm, ground, turn = 1.0, 4.0, 0.5, 3.0, 0.7
    first = (crank * math.cos(turn), crank * math.sin(turn))
    reach = math.dist(first, (ground, 0.0))
    along = math.sqrt(reach**2 - arm**2)
    psi = math.atan2(-first[1], ground - first[0]) + math.atan2(arm, along)
    m = nc.Mechanism("coordinate comparison")
    m.ground("A", (0.0, 0.0))
    m.ground("D", (ground, 0.0))
    m.point("1", first)
    m.point("2", (first[0] + bar * math.cos(psi), first[1] + bar * math.sin(psi)))
    m.point("3", (first[0] + along * math.cos(psi), first[1] + along * math.sin(psi)))
    m.body("1", ["A", "1"])
    m.body("2", ["1", "2"])
    m.body("3", ["D", "3"])
    m.prismatic("C", line=("1", "2"), on=("3", "D"), form="text")
    m.angle("psi1", at="A", to="1")
    if angles:
        m.angle("psi2", at="1", start="A", to="2")
        m.distance("s", "1", "3", along="2")
    return m


def every_planar_joint() -> nc.Mechanism:
    """A mechanism in the plane with every joint that the families are asked about."""
    m = nc.Mechanism("every planar joint")
    for name, at in {"O": (0, 0), "K": (2.5, -0.5), "G": (0, -2), "H": (4, -2), "V": (6, 0), "W": (6.9, 0)}.items():
        m.ground(name, at)
    points = {"A": (0.8, 0.6), "A2": (0.8, 0.6), "B": (2.0, 1.1), "L": (1.7, 2.2), "S": (1.0, -2.0), "T": (1.5, -1.2)}
    points |= {"v": (6.2, 0.2), "w": (6.5, 0.3), "c": (2.4, -1.7), "r": (2.6, -1.6), "k": (2.4, -2.0)}
    for name, at in points.items():
        m.point(name, at)
    m.point("Y", (3.6, 0.9), fixed="y")
    m.body("crank", ["O", "A"])
    m.body("link", ["A2", "B"])
    m.body("lever", ["K", "L"])
    m.body("slider", ["S", "T"])
    m.body("rod", ["B", "Y"])
    m.body("wheel 1", ["V", "v"])
    m.body("wheel 2", ["W", "w"])
    m.body("disc", ["c", "r"])
    m.revolute("hinge", "A", "A2")
    m.slot("slot", "B", ("K", "L"))
    m.prismatic("guide", line=("G", "H"), on=("S", "T"))
    m.angle("phi", at="O", to="A")
    m.angle("alpha", at="V", start="W", to="v")
    m.angle("beta", at="W", start="V", to="w")
    m.gear("gears", "alpha", "beta")
    m.rolling("rolling", "c", "r", "k", ("G", "H"), "spin", "way")
    return m


def every_spatial_joint() -> nc.Mechanism:
    """A chain in space with every joint that the families are asked about, with gears and a screw beside it."""
    m = nc.Mechanism("every spatial joint", dim=3)
    for name, at in {"O": (0, 0, 0), "P": (3, 0, 0), "Q": (3, 0.5, 0.5), "N": (0, -2, 0)}.items():
        m.ground(name, at)
    for name, d in {"k": (0, 0, 1), "n": (0, 0, 1), "o": (0, 1, 0), "gx": (1, 0, 0)}.items():
        m.ground_vector(name, d)
    points = {"A": (0.1, 0.2, 0.8), "C": (0.6, 0.35, 0.9), "D": (0.6, 1.2, 1.1), "E": (1.4, 1.5, 1.6), "F": (2, 2, 1.5)}
    points |= {"p": (3.2, 0.1, 0), "q": (3.1, 0.5, 0.9), "S": (0, -2, 0.4)}
    for name, at in points.items():
        m.point(name, at)
    for name, d in {
        "u": (1.0, 0.3, 0.2),
        "w": (0, 0.85, 0.2),
        "x": (1, 0.1, 0),
        "y": (0, 0, 1),
        "h": (1, 1, 0),
    }.items():
        m.vector(name, d)
    m.vector("z", (0.2, 1, 0.5))
    m.body("1", ["O", "A"], vectors=["k", "u"])
    m.body("2", ["C"], vectors=["u", "w"])
    m.body("3", ["D"], vectors=["w", "x"])
    m.body("4", ["D", "E"], vectors=["y"])
    m.body("5", ["E", "F"], vectors=["z"])
    m.body("pinion", ["P", "p"], vectors=["n"])
    m.body("wheel", ["Q", "q"], vectors=["o"])
    m.body("nut", ["S"], vectors=["k", "h"])
    m.cylindrical("cylinder", line=("A", "u"), on="C")
    m.prismatic("guide", line=("C", "w"), on="D", directions=("u", "x"))
    m.universal("cross", axes=("x", "y"))
    m.angle("alpha", at="P", to="p", about="n")
    m.angle("beta", at="Q", to="q", about="o")
    m.gear("gears", "alpha", "beta", radii=(1.0, 2.0))
    m.screw("thread", ("N", "k"), "S", ("gx", "h"), angle="turn", distance="rise", pitch=0.1)
    return m
