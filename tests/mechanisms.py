"""Mechanisms the tests share: compiled once per process, few shapes, so that the suite compiles little."""

import functools
import json

import jax
import jax.numpy as jnp
import numpy as np
from places import TESTS

import jaxnc as nc
from jaxnc.constraints import CATALOGUE
from jaxnc.mechanism import model as record


def reference(name: str) -> dict:
    """A reference solution: definition and arrays, computed without natural coordinates."""
    return json.loads((TESTS / "reference" / f"{name}.json").read_text())


def pendulum() -> nc.Mechanism:
    """A rod of one metre and one kilogram on a pin."""
    m = nc.Mechanism("pendulum")
    m.ground("A", (0, 0))
    m.point("B", (0.6, -0.8))
    m.body("rod", ["A", "B"], mass=1.0)
    m.angle("phi", at="A", to="B")
    m.gravity = (0, -9.81)
    return m


def unreadable() -> nc.Mechanism:
    """A point on a parabola, by a kind of the user's own whose loop only JAX can carry out."""
    loop = nc.constraints.Kind(
        "loop",
        lambda p, v, s, c: (p[0][1] - jax.lax.fori_loop(0, 2, lambda _, x: x * p[0][0], 1.0),),
        rows=("loop",),
        points=1,
        source="a user's own",
    )
    m = nc.Mechanism("parabola")
    m.constrain("loop", loop, points=[m.point("P", (0.5, 0.25))])
    return m


def four_bar_mechanism(explicit: bool = True, crossed: bool = False) -> nc.Mechanism:
    """The reference four-bar, Norton's example: lengths given, or read off a drawing that has them."""
    d = reference("fourbar_planar")["definition"]
    a, b, c, g = d["crank"], d["coupler"], d["rocker"], d["ground"]
    along, across = d["coupler_point_local"]
    start = 0.7
    B = np.array([a * np.cos(start), a * np.sin(start)])
    C = np.asarray(four_bar_joint(a, b, c, jnp.array([0.0, 0.0]), jnp.array([g, 0.0]), start, -1.0 if crossed else 1.0))
    e = (C - B) / b
    P = B + along * e + across * np.array([-e[1], e[0]])
    m = nc.Mechanism("four-bar")
    m.ground("O2", (0, 0))
    m.ground("O4", (g, 0))
    m.point("A", B)
    m.point("B", C)
    m.point("P", P)
    m.body("crank", ["O2", "A"], lengths={("O2", "A"): a} if explicit else None)
    local = {"P": (along, across)} if explicit else None
    m.body("coupler", ["A", "B", "P"], lengths={("A", "B"): b} if explicit else None, local=local)
    m.body("rocker", ["O4", "B"], lengths={("O4", "B"): c} if explicit else None)
    m.angle("phi", at="O2", to="A")
    m.marker(
        "G", on="coupler", at=B + d["coupler_cg_local"][0] * e + d["coupler_cg_local"][1] * np.array([-e[1], e[0]])
    )
    return m


@functools.cache
def four_bar(explicit: bool = True, crossed: bool = False) -> nc.System:
    """The compiled reference four-bar."""
    return four_bar_mechanism(explicit, crossed).compile()


@jax.jit  # operation by operation it is twenty programs for each shape
def four_bar_joint(a, b, c, O2, O4, phi, side):
    """Closed form: the joint of coupler and rocker as an intersection of two circles, `side` +1 left of A -> O4."""
    A = O2 + a * jnp.stack([jnp.cos(phi), jnp.sin(phi)])
    d = O4 - A
    span = d @ d
    along = (b * b - c * c + span) / (2 * span)
    across = side * jnp.sqrt(b * b / span - along * along)
    return A + along * d + across * jnp.stack([-d[1], d[0]])


@functools.cache
def slider_crank(fixed_guide: bool = True) -> nc.System:
    """The reference slider-crank, with its coordinate y2 eliminated or with a slot."""
    d = reference("slidercrank_planar")["definition"]
    r, length, e = d["crank"], d["conrod"], d["offset"]
    start = 0.9
    A = (r * np.cos(start), r * np.sin(start))
    x = A[0] + np.sqrt(length**2 - (e - A[1]) ** 2)
    m = nc.Mechanism("slider-crank")
    m.ground("O", (0, 0))
    m.point("A", A)
    m.point("S", (x, e), fixed="y" if fixed_guide else "")
    m.body("crank", ["O", "A"], lengths={("O", "A"): r})
    m.body("conrod", ["A", "S"], lengths={("A", "S"): length})
    if not fixed_guide:
        m.ground("G", (0.0, e))
        m.ground("H", (1.0, e))
        m.slot("guide", "S", ("G", "H"))
    m.angle("phi", at="O", to="A")
    m.marker("cg", on="conrod", at=(0.5 * (A[0] + x), 0.5 * (A[1] + e)))
    return m.compile()


@functools.cache
def shaper() -> nc.System:
    """The reference quick return with its ram: slot on a moving rocker, link to a point that slides on y = const."""
    d = reference("quick_return")["definition"]
    start = 0.4
    A = d["crank"] * np.array([np.cos(start), np.sin(start)])
    O4 = np.array(d["O4"])
    e = (A - O4) / np.linalg.norm(A - O4)
    C = O4 + d["rocker_length"] * e
    ram = (C[0] - np.sqrt(d["link"] ** 2 - (d["ram_y"] - C[1]) ** 2), d["ram_y"])
    m = nc.Mechanism("shaper")
    m.ground("O2", d["O2"])
    m.ground("O4", O4)
    m.point("A", A)
    m.point("C", C)
    m.point("R", ram, fixed="y")
    m.body("crank", ["O2", "A"], lengths={("O2", "A"): d["crank"]})
    m.body("rocker", ["O4", "C"], lengths={("O4", "C"): d["rocker_length"]})
    m.body("link", ["C", "R"], lengths={("C", "R"): d["link"]})
    m.slot("block", "A", ("O4", "C"))
    m.angle("phi", at="O2", to="A")
    m.angle("psi", at="O4", to="C")
    m.distance("slide", "O4", "A", along="C")
    return m.compile()


def turn(count: int) -> np.ndarray:
    """Inputs over a full turn."""
    return np.linspace(0.0, 2 * np.pi, count)


def trace_counter(monkeypatch) -> list:
    """Every entry of the compiled analysis into tracing appends to this list."""
    from jaxnc.kinematics import traced

    seen: list = []
    original = traced.solve_fixed_steps

    def counted(*args):
        seen.append(None)
        return original(*args)

    monkeypatch.setattr(traced, "solve_fixed_steps", counted)
    jax.clear_caches()
    return seen


def everything() -> nc.Mechanism:
    """A spatial description that uses every record and every optional field. It need not assemble."""
    m = nc.Mechanism("all of it", dim=3, description="in space", length_unit="mm", angle_unit="deg")
    for i, name in enumerate("ABCDEFGH"):
        m.point(name, (0.1 * i, i * i / 3, -0.0))
    m.ground("O", (0, 1e-300, 5e22))
    m.point("y2", (3, 0, 1), fixed="xz")
    m.ground_vector("z", (0, 0, 2))
    for i, name in enumerate("uvw"):
        m.vector(name, (0.1, 1 / 3, i))
    m.body("crank", ["A", "B"], vectors=["z"])
    m.body("coupler", ["B", "C", "D"], lengths={("B", "C"): 3.0}, vectors=["u", "v"], form="text")
    m.body("odd name, 100 %", ["E"], vectors=["u", "w"])
    m.body("bar", ["F", "G"])
    m.marker("M", on="crank", at=(1 / 3, 2 / 3, 0.1))
    m.marker("N", on="coupler", direction=(0, 3, 4))
    m.angle("phi", at="A", to="B", about="z")
    m.angle("psi", to=("C", "D"), start="u", about=("A", "B"), form="sines")
    m.angle("chi", to="u", start="v", about="w")
    m.distance("s", "A", "B", along="u", form="z")
    m.distance("s2", "A", "C", along=("D", "E"))
    m.distance("s3", "A", "C")
    m.revolute("hinge", "A", "E", axes=("u", ("E", "F")))
    m.revolute("shared hinge", axes=("u", "v"))
    m.prismatic("guide", ("A", "u"), ("C", "D"), directions=("v", ("E", "F")), form="text")
    m.prismatic("shared guide", ("A", "u"), "C", directions=("v", "w"))
    m.slot("slot", "C", ("A", "u"))
    m.spherical("ball", "A", "B")
    m.cylindrical("tube", ("A", "u"), ("B", "v"))
    m.cylindrical("shared tube", ("A", "u"), "B")
    m.universal("cross", ("u", ("A", "B")), "C", "D")
    m.universal("shared cross", ("u", "v"))
    m.screw("bolt", ("A", "u"), "B", ("v", "w"), "turn", "way", lead=-0.3)
    m.screw("nut", ("A", "B"), ("C", "w"), (("A", "E"), "w"), "turn2", "way2", pitch=0.1)
    m.planar("table", ("A", "u"), ("B", "v"))
    m.planar("shared table", ("A", "u"), "B")
    m.bevel_gear("bevel", "phi", "psi", radii=(1, 2), internal=True)
    m.gear("pair", "phi", "chi")
    m.rack_and_pinion("rack", "phi", "s", radius=0.5)
    m.rack_and_pinion("drawn rack", "phi", "s2")
    m.constant_velocity("cv", ("u", "v"), ("w", ("A", "B")), "C", "D")
    m.constant_velocity("shared cv", ("u", "v"), ("w", "z"))
    m.rolling("roll", "A", "B", "H", ("O", "u"), "turn3", "way3", radius=0.3, axis=("C", "D"))
    m.cable("rope", ["A", "B", "C"], length=3)
    m.weld("seam", "crank", "coupler")
    m.rolling_disc("coin", "C", "u", "v", ("O", "z"), radius=0.3)
    m.relation("tie", {"phi": 1, "turn": 2, "u.x": 0.1}, constant=0.25)
    m.constrain("right angle", CATALOGUE["scalar product vv"], vectors=["u", "v"], constants={"product": 0.0})
    m.constrain("side by side", CATALOGUE["parallel vp"], ["A", "B"], vectors=["u"])
    drives = {"turn": record.Drive(0.0, 360.0, 37, 10.0), "way2": record.Drive(0.0, 0.1, 37)}
    m.model.run = record.Run(inputs=drives, hold=["s2", "u.x"], outputs=["M", "N", "N.z", "u", "u.x", "A.z", "psi"])
    return m
