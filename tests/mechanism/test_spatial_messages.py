"""Bad input of spatial mechanisms: each message names what is wrong and what to do, and no frame of JAX is in it."""

import numpy as np
import pytest
from test_messages import says

import jaxnc as nc
from jaxnc.system.assemble import assemble


def start():
    """Two ground points, a ground vector, a crank about it, an arm with a point and a vector, loose points."""
    m = nc.Mechanism("rig", dim=3)
    m.ground("A", (0, 0, 0))
    m.ground("B", (1, 0, 0))
    m.ground_vector("z", (0, 0, 1))
    for name, at in (("P", (0.3, 0.4, 0.5)), ("Q", (1.1, -0.2, 0.3)), ("R", (0.2, 1.0, -0.6)), ("S", (0.3, 0.4, 0.9))):
        m.point(name, at)
    m.vector("u", (0, 0, 1))
    m.vector("w", (1, 0.2, 0))
    m.vector("n", (0.1, 1, 0.2))
    m.body("crank", ["A", "P"], vectors=["z"])
    m.body("arm", ["Q"], vectors=["u", "w"])
    return m


def compiled(*calls):
    """A function that makes calls on a fresh rig and compiles it."""

    def run():
        m = start()
        for call in calls:
            call(m)
        assemble(m)

    return run


# (what is wrong, a call on the rig, what the message says)
BUILDER = [
    ("zero vector", lambda m: m.vector("t", (0, 0, 0)), ["vector 't'", "zero vector", "one component"]),
    ("zero ground vector", lambda m: m.ground_vector("t", (0, 0, 0)), ["ground vector 't'", "zero vector"]),
    ("two components", lambda m: m.vector("t", (0, 1)), ["vector 't'", "3 numbers", "(0, 1)"]),
    ("not a number", lambda m: m.vector("t", (0, 1, np.nan)), ["vector 't'", "finite", "nan"]),
    ("vector name taken", lambda m: m.vector("A", (0, 0, 1)), ["vector 'A'", "taken by a ground point", "choose"]),
    ("point name taken", lambda m: m.point("u", (0, 0, 1)), ["point 'u'", "taken by a vector", "choose"]),
    ("fixed axis", lambda m: m.point("t", (0, 0, 0), fixed="w"), ["point 't'", "'w'", "x, y, z"]),
    ("plane place", lambda m: m.point("t", (0, 0)), ["point 't'", "3 numbers"]),
    (
        "unknown vector",
        lambda m: m.body("b", ["P"], vectors=["U", "w"]),
        ["'b'", "vector 'U'", "known names: n, u, w, z"],
    ),
    ("vector for a point", lambda m: m.body("b", ["P", "u"]), ["body 'b'", "'u' is a vector", "vectors=['u']"]),
    ("vector twice", lambda m: m.body("b", ["P"], vectors=["u", "u"]), ["'b'", "'u' twice", "once"]),
    ("no orientation", lambda m: m.body("b", ["P"]), ["'b'", "'P'", "no orientation", "second point", "two vectors"]),
    ("no points", lambda m: m.body("b", [], vectors=["u", "w"]), ["'b'", "no points", "at least one"]),
    ("listed twice", lambda m: m.body("b", ["Q"], vectors=["w", "u"]), ["'b'", "body 'arm'", "vectors", "remove one"]),
    ("local", lambda m: m.body("b", ["P", "Q", "R"], local={"R": (0, 0, 0)}), ["'b'", "planar", "draw the point"]),
    ("along", lambda m: m.body("b", ["P", "Q"], along=("A", "B")), ["'b'", "along=", "planar"]),
    ("form", lambda m: m.body("b", ["P", "Q"], form="book"), ["'b'", "'book'", "'exact' or 'text'"]),
    ("marker of nobody", lambda m: m.marker("k", on="amr", at=(0, 0, 0)), ["'k'", "'amr'", "did you mean 'arm'"]),
    ("marker nowhere", lambda m: m.marker("k", on="arm"), ["'k'", "at=", "direction="]),
    ("marker twice", lambda m: m.marker("k", "arm", (0, 0, 0), (0, 0, 1)), ["'k'", "at=", "direction="]),
    ("marker without direction", lambda m: m.marker("k", "arm", direction=(0, 0, 0)), ["'k'", "zero vector"]),
    ("marker as point", lambda m: (m.marker("k", "arm", (0, 0, 0)), m.slot("s", "k", ("A", "z"))), ["'k'", "point of"]),
    ("angle without axis", lambda m: m.angle("f", "A", "P"), ["'f'", "about an axis", "about=", "two points"]),
    ("angle about a point", lambda m: m.angle("f", "A", "P", about="A"), ["'f'", "'A' is a point", "('A', 'Q')"]),
    ("angle about nothing", lambda m: m.angle("f", "A", "P", about="zz"), ["'f'", "unknown vector 'zz'", "'z'"]),
    ("angle to a point alone", lambda m: m.angle("f", to="P", about="z"), ["'f'", "'P'", "at='A'"]),
    ("planar angle form", lambda m: m.angle("f", "A", "P", form="sum", about="z"), ["'f'", "'sum'", "sines"]),
    ("planar distance form", lambda m: m.distance("s", "A", "P", "z", "sum"), ["'s'", "'sum'", "x, y, z"]),
    ("distance form alone", lambda m: m.distance("s", "A", "P", form="x"), ["'s'", "needs a line", "along="]),
    ("revolute without axes", lambda m: m.revolute("j", "P", "Q"), ["'j'", "axes=('u', 'v')", "spherical()"]),
    ("half a revolute", lambda m: m.revolute("j", "P", axes=("z", "u")), ["'j'", "point of each body", "neither"]),
    ("one axis", lambda m: m.revolute("j", axes="z"), ["'j'", "two directions", "'z'"]),
    ("three axes", lambda m: m.universal("j", axes=("z", "u", "w")), ["'j'", "two directions"]),
    ("half an axis", lambda m: m.universal("j", axes=("z", ("P",))), ["'j'", "two points", "('P',)"]),
    ("number for an axis", lambda m: m.universal("j", axes=("z", 3)), ["'j'", "3"]),
    ("point for an axis", lambda m: m.universal("j", axes=("z", "P")), ["'j'", "'P' is a point", "two points"]),
    ("same point", lambda m: m.spherical("j", "P", "P"), ["'j'", "two different points"]),
    ("line of one", lambda m: m.cylindrical("j", "P", "Q"), ["'j'", "a point and a vector, or two points"]),
    ("line the wrong way", lambda m: m.slot("j", "P", ("z", "A")), ["'j'", "'z' is a vector"]),
    ("own line", lambda m: m.cylindrical("j", ("A", "z"), "A"), ["'j'", "'A'", "own line"]),
    ("prismatic that turns", lambda m: m.prismatic("j", ("A", "z"), "P"), ["'j'", "turning", "directions=('u', 'v')"]),
    ("prismatic form", lambda m: m.prismatic("j", ("A", "z"), "P", form="x"), ["'j'", "'x'", "'text'"]),
    ("screw without lead", lambda m: m.screw("j", ("A", "z"), "P", ("u", "w"), "f", "s"), ["'j'", "lead", "pitch"]),
    (
        "screw with both",
        lambda m: m.screw("j", ("A", "z"), "P", ("u", "w"), "f", "s", 1.0, 1.0),
        ["'j'", "lead", "pitch"],
    ),
    (
        "screw with one name",
        lambda m: m.screw("j", ("A", "z"), "P", ("u", "w"), "f", "f", 1.0),
        ["'j'", "both called 'f'"],
    ),
    (
        "screw with an endless lead",
        lambda m: m.screw("j", ("A", "z"), "P", ("u", "w"), "f", "s", np.inf),
        ["'j'", "finite", "inf"],
    ),
    ("plane by points", lambda m: m.planar("j", ("P", "Q"), "R"), ["'j'", "normal vector", "('P', 'Q')"]),
    ("plane by nothing", lambda m: m.planar("j", "P", "R"), ["'j'", "normal vector", "'P'"]),
    ("gear of nothing", lambda m: m.bevel_gear("j", "f", "g"), ["'j'", "unknown angle 'f'"]),
    ("rack of nothing", lambda m: m.rack_and_pinion("j", "f", "s"), ["'j'", "unknown angle 'f'"]),
    ("disc without axis", lambda m: m.rolling("j", "P", "Q", "R", ("A", "z"), "f", "s"), ["'j'", "axis='u'"]),
    (
        "disc in text form",
        lambda m: m.rolling("j", "P", "Q", "R", ("A", "z"), "f", "s", form="text", axis="u"),
        ["'j'", "form='text'"],
    ),
    ("weld of nobody", lambda m: m.weld("j", "arm", "leg"), ["'j'", "unknown body 'leg'", "arm"]),
    ("weld to itself", lambda m: m.weld("j", "arm", "arm"), ["'j'", "to itself"]),
    ("vector's coordinate", lambda m: m.relation("tie", {"u.w": 1.0}), ["unknown coordinate 'u.w'"]),
    ("kind of vectors", lambda m: m.constrain("unit", nc.constraints.UNIT), ["1 vectors", "got 0"]),
]
PLANAR = [
    ("vector", lambda m: m.vector("u", (1, 0)), ["vector 'u'", "Mechanism(dim=3)", "points are enough"]),
    ("ground vector", lambda m: m.ground_vector("u", (1, 0)), ["ground vector 'u'", "Mechanism(dim=3)"]),
    ("vectors of a body", lambda m: m.body("b", ["A", "B"], vectors=["u"]), ["'b'", "vectors=", "Mechanism(dim=3)"]),
    ("about", lambda m: m.angle("f", "A", "B", about=("A", "B")), ["'f'", "about=", "anticlockwise"]),
    ("sines", lambda m: m.angle("f", "A", "B", form="sines"), ["'f'", "'sines'", "sum"]),
    ("z", lambda m: m.distance("s", "A", "B", along="B", form="z"), ["'s'", "'z'", "x, y"]),
    ("spherical", lambda m: m.spherical("j", "A", "B"), ["'j'", "Mechanism(dim=3)", "revolute()"]),
    ("cylindrical", lambda m: m.cylindrical("j", ("A", "B"), "C"), ["'j'", "Mechanism(dim=3)"]),
    ("universal", lambda m: m.universal("j", ("A", "B")), ["'j'", "Mechanism(dim=3)"]),
    ("planar", lambda m: m.planar("j", ("A", "n"), "B"), ["'j'", "Mechanism(dim=3)"]),
    ("bevel gear", lambda m: m.bevel_gear("j", "f", "g"), ["'j'", "use gear()"]),
    ("rack", lambda m: m.rack_and_pinion("j", "f", "s"), ["'j'", "rolling()", "relation("]),
    ("marker", lambda m: (m.body("b", ["A", "B"]), m.marker("k", "b", direction=(1, 0))), ["'k'", "Mechanism(dim=3)"]),
    ("directions", lambda m: m.prismatic("j", ("A", "B"), ("A", "B"), directions=("u", "v")), ["'j'", "directions="]),
]


@pytest.mark.parametrize(("call", "parts"), [pytest.param(*case[1:], id=case[0]) for case in BUILDER])
def test_builder(call, parts):
    m = start()
    before = repr(m)
    says(nc.MechanismError, lambda: call(m), *parts)
    if "k" not in m.model.markers:
        assert repr(m) == before, "a refused call changes nothing"


@pytest.mark.parametrize(("call", "parts"), [pytest.param(*case[1:], id=case[0]) for case in PLANAR])
def test_what_is_only_for_space(call, parts):
    m = nc.Mechanism("flat")
    m.ground("A", (0, 0))
    m.point("B", (1, 0))
    says(nc.MechanismError, lambda: call(m), *parts)


def hinged(m):
    """A second body that shares the arm's axis."""
    m.body("leg", ["R", "S"], vectors=["u"])


def wheels(m, at="A"):
    m.angle("f", at="A", to="P", about="z")
    m.body("leg", ["R", "S"], vectors=["w"])
    m.angle("g", at=at, to="n", start="z", about="w")


# (what is wrong, calls on the rig, what compiling it says)
COMPILER = [
    (
        "points together",
        [lambda m: (m.point("T", (0.3, 0.4, 0.5)), m.body("b", ["P", "T"]))],
        ["body 'b'", "P, T", "same place", "move one"],
    ),
    (
        "marker off its bar",
        [lambda m: (m.body("bar", ["P", "Q"]), m.marker("k", "bar", (0, 0, 1)))],
        ["marker 'k'", "body 'bar'", "off that line", "across it"],
    ),
    (
        "marker's direction off its bar",
        [lambda m: (m.body("bar", ["P", "Q"]), m.marker("k", "bar", direction=(0, 0, 1)))],
        ["marker 'k'", "'bar'", "across it"],
    ),
    (
        "weld of a bar",
        [lambda m: (m.body("bar", ["P", "Q"]), m.weld("j", "bar", "arm"))],
        ["weld 'j'", "body 'bar'", "rotation about its own line", "across"],
    ),
    (
        "angle along its axis",
        [lambda m: m.angle("f", to=("A", "S"), start="w", about=("A", "S"))],
        ["'f'", "A-S", "across"],
    ),
    ("angle of a moving axis", [lambda m: m.angle("f", to="w", about="u")], ["'f'", "axis moves", "start="]),
    (
        "form from the drawing",
        [lambda m: m.angle("f", to="w", about="z", form="cosine")],
        ["'f'", "'cosine'", "start="],
    ),
    (
        "cosine of a free length",
        [lambda m: m.angle("f", to=("Q", "R"), start="w", about="u", form="cosine")],
        ["'f'", "Q-R", "constant length", "form='exact'"],
    ),
    (
        "sine of a free radius",
        [lambda m: m.angle("f", to="w", start=("A", "B"), about=("A", "S"), form="sine")],
        ["'f'", "constant angle", "A-S", "form='exact'"],
    ),
    (
        "distance without direction",
        [lambda m: (m.point("T", (0, 0, 0)), m.distance("s", "A", "P", along="T"))],
        ["'s'", "'A' and 'T'", "same place"],
    ),
    (
        "axis between bodies",
        [lambda m: m.revolute("j", axes=(("P", "Q"), "u"))],
        ["'j'", "no body holds both", "P-Q", "name a vector"],
    ),
    (
        "arm between bodies",
        [lambda m: m.universal("j", axes=(("P", "R"), "u"))],
        ["'j'", "no body holds both", "P-R"],
    ),
    (
        "axis not shared",
        [lambda m: m.cylindrical("j", line=("A", "z"), on="Q")],
        ["cylindrical joint 'j'", "point 'Q'", "axis, the vector 'z'", "on=('Q', 'z2')", "slot()"],
    ),
    (
        "normal not shared",
        [hinged, lambda m: m.planar("j", plane=("A", "z"), on="R")],
        ["planar joint 'j'", "point 'R'", "normal, the vector 'z'", "give the body that vector", "on=('R', 'z')"],
    ),
    (
        "prismatic along its axis",
        [hinged, lambda m: m.prismatic("j", ("Q", "u"), "R", directions=("w", "u"))],
        ["prismatic joint 'j'", "vector 'u'", "across"],
    ),
    (
        "screw along its axis",
        [hinged, lambda m: m.screw("j", ("Q", "u"), "R", ("u", "w"), "f", "s", 1.0)],
        ["screw joint 'j'", "vector 'u'", "along the axis"],
    ),
    (
        "text form of parallel directions",
        [
            lambda m: (m.vector("w2", (1, 0.2, 0)), m.body("leg", ["R"], vectors=["u", "w2"])),
            lambda m: m.prismatic("j", ("Q", "u"), "R", directions=("w", "w2"), form="text"),
        ],
        ["'j'", "'w'", "'w2'", "parallel", "form='exact'", "erratum 9"],
    ),
    ("arms along each other", [lambda m: m.universal("j", axes=("z", "u"))], ["'j'", "'z'", "'u'", "nearly parallel"]),
    (
        "wheel without centre",
        [lambda m: wheels(m, at=None), lambda m: m.bevel_gear("j", "f", "g", radii=(1, 2))],
        ["'j'", "'g'", "at="],
    ),
    ("wheel without rim", [wheels, lambda m: m.bevel_gear("j", "f", "g")], ["'j'", "wheel 2", "radii="]),
    (
        "rack without line",
        [wheels, lambda m: (m.distance("s", "A", "R"), m.rack_and_pinion("j", "f", "s"))],
        ["'j'", "'s'", "along="],
    ),
    (
        "rack along the axle",
        [wheels, lambda m: (m.distance("s", "B", "R", along="z"), m.rack_and_pinion("j", "f", "s"))],
        ["'j'", "pinion's axis", "perpendicular", "'z'", "0°"],
    ),
    (
        "pinion on the rack's line",
        [wheels, lambda m: (m.distance("s", "A", "B", along="B"), m.rack_and_pinion("j", "f", "s"))],
        ["'j'", "on the rack's line", "radius="],
    ),
    (
        "disc on a line along its axis",
        [lambda m: m.rolling("j", "Q", "R", "S", ("A", "z"), "f", "s", axis="u")],
        ["'j'", "disc's axis", "perpendicular", "'u'", "0°"],
    ),
    (
        "shafts at a right angle",
        [lambda m: m.constant_velocity("j", axes=("z", "w"), marks=(("A", "P"), "u"))],
        ["constant-velocity joint 'j'", "90°", "same way"],
    ),
    (
        "mark along its shaft",
        [lambda m: m.constant_velocity("j", axes=("z", "u"), marks=("z", "w"))],
        ["'j'", "'z'", "along the axis"],
    ),
]


@pytest.mark.parametrize(("calls", "parts"), [pytest.param(*case[1:], id=case[0]) for case in COMPILER])
def test_compiler(calls, parts):
    says(nc.MechanismError, compiled(*calls), *parts)


def test_the_rig_is_sound():
    compiled()()
    compiled(wheels)()


def test_vectors_of_any_size():
    m = start()
    m.vector("tiny", (3e-200, 0, -4e-200))
    m.vector("huge", (0, 3e99, 4e99))
    m.body("b", ["R"], vectors=["tiny", "huge"])
    s = assemble(m)
    np.testing.assert_allclose(s["tiny"], (0.6, 0, -0.8), atol=1e-14)
    np.testing.assert_allclose(s["huge"], (0, 0.6, 0.8), atol=1e-14)


def test_a_vector_of_no_body_is_a_unit_vector():
    m = start()
    m.body("leg", ["R", "S"], vectors=["w"])
    rows = [row for row in assemble(m).topology.rows if row.endswith(" n")]
    assert rows == ["n: unit length n"]


def test_replacing():
    m = start()
    s = assemble(m)
    for values, parts in (
        ({"u": (0, 0, 0)}, ["'u'", "zero vector"]),
        ({"v": (0, 0, 1)}, ["'v'"]),
        ({"u": 1.0}, ["(3,)"]),
    ):
        says(nc.InputError, lambda values=values: s.replace(values), *parts)


def test_a_point_of_a_rod_stays_in_a_plane_as_the_message_says():
    """With the plane's own normal one freedom is taken; the rod tilts, and its end keeps its height."""

    def rod(on):
        m = nc.Mechanism("rod", dim=3)
        m.ground("A", (0, 0, 1))
        m.ground("O", (0, 0, 0))
        m.ground_vector("n", (0, 0, 1))
        m.point("B", (0.6, 0.5, 0.2))
        m.body("rod", ["A", "B"])
        m.planar("table", plane=("O", "n"), on=on)
        return m.compile()

    says(nc.MechanismError, lambda: rod("B"), "'table'", "on=('B', 'n')")
    system = rod(("B", "n"))
    assert system.degrees_of_freedom == 1 and not nc.mobility(system).redundant
    motion = nc.sweep(system, {"B.x": np.array([0.6, 0.4, 0.2])})
    assert np.all(motion.status == 0)
    np.testing.assert_allclose(motion["B"][:, 2], 0.2, atol=1e-12)
