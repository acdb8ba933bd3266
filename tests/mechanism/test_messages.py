"""Bad input: each message names what is wrong and what to do, and no frame of JAX is in the way."""

import re
import traceback

import jax
import numpy as np
import pytest
from mechanisms import four_bar, slider_crank

import jaxnc as nc


def says(error, call, *parts):
    """The call raises `error`, whose message contains every part; its traceback ends in jaxnc, not inside JAX."""
    with pytest.raises(error) as caught:
        call()
    text = str(caught.value)
    for part in parts:
        assert part in text, f"{part!r} not in {text!r}"
    last = traceback.extract_tb(caught.value.__traceback__)[-1].filename.replace("\\", "/")
    assert "/jaxnc/" in last and "/jax/" not in last
    assert caught.value.__cause__ is None


def start():
    m = nc.Mechanism("rig")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    m.point("B", (0, 1))
    m.point("C", (3, 2))
    return m


def test_unknown_point_in_a_body():
    says(nc.MechanismError, lambda: start().body("crank", ["A", "BB"]), "'crank'", "'BB'", "did you mean", "'B'")


def test_body_of_one_point_without_orientation():
    m = start()
    m.body("block", ["B"])
    says(nc.MechanismError, m.compile, "'block'", "'B'", "orientation is not known", "second point", "slot", "along=")


@pytest.mark.parametrize(
    ("make", "noun"),
    [
        (lambda m: m.point("A", (1, 1)), "ground point"),
        (lambda m: m.ground("B", (1, 1)), "point"),
        (lambda m: (m.body("crank", ["A", "B"]), m.marker("B", "crank", (0, 0))), "point"),
        (lambda m: (m.angle("phi", "A", "B"), m.distance("phi", "A", "B")), "angle"),
    ],
)
def test_duplicate_name(make, noun):
    says(nc.MechanismError, lambda: make(start()), "already taken", noun, "choose another")


def test_duplicate_body_name_and_joint_name():
    m = start()
    m.body("crank", ["A", "B"])
    says(nc.MechanismError, lambda: m.body("crank", ["B", "C"]), "'crank'", "already taken", "choose another")
    m.slot("s", "C", ("A", "B"))
    says(nc.MechanismError, lambda: m.slot("s", "D", ("A", "B")), "'s'", "already taken")


def test_points_at_one_place_where_a_direction_is_needed():
    m = start()
    m.point("E", (0, 1))
    m.body("bar", ["B", "E"])
    says(nc.MechanismError, m.compile, "'bar'", "'B'", "'E'", "same place", "move one")
    m = start()
    m.point("E", (0, 0))
    m.body("crank", ["A", "B"])
    m.angle("phi", at="A", to="E")
    says(nc.MechanismError, m.compile, "'phi'", "'A'", "'E'", "direction")
    m = start()
    m.point("E", (0, 1))
    m.slot("rail", "C", ("B", "E"))
    says(nc.MechanismError, m.compile, "'rail'", "'B'", "'E'", "direction")


def test_body_listed_twice_and_point_listed_twice():
    m = start()
    m.body("crank", ["A", "B"])
    says(nc.MechanismError, lambda: m.body("arm", ["B", "A"]), "'arm'", "'crank'", "listed twice", "remove one")
    says(nc.MechanismError, lambda: m.body("rod", ["B", "C", "B"]), "'rod'", "'B'", "twice")


def test_triangle_inequality():
    m = start()
    m.body("plate", ["A", "B", "C"], lengths={("A", "B"): 1.0, ("A", "C"): 1.0, ("B", "C"): 3.0})
    says(nc.MechanismError, m.compile, "'plate'", "A-C", "B-C", "triangle inequality", "between 2 and 4")


def test_too_many_lengths():
    m = start()
    lengths = {("A", "B"): 1.0, ("A", "C"): 3.6, ("B", "C"): 3.2, ("A", "D"): 4.0, ("B", "D"): 4.1, ("C", "D"): 2.2}
    m.body("plate", ["A", "B", "C", "D"], lengths=lengths)
    says(nc.MechanismError, m.compile, "'plate'", "'D'", "more than two lengths", "give two")


@pytest.mark.parametrize("value", [-1.0, 0.0, float("nan"), float("inf"), "long"])
def test_bad_length(value):
    says(
        nc.MechanismError,
        lambda: start().body("crank", ["A", "B"], lengths={("A", "B"): value}),
        "'crank'",
        "A-B",
        repr(value),
    )


@pytest.mark.parametrize("place", [(0.0,), (1.0, 2.0, 3.0), (float("nan"), 0.0), "ab", None, (0.0, float("inf"))])
def test_bad_place(place):
    says(nc.MechanismError, lambda: start().point("P", place), "'P'", "number")


@pytest.mark.parametrize("name", ["", "a.b", "B-C", "two words", 3])
def test_bad_names(name):
    says(nc.MechanismError, lambda: start().point(name, (0, 0)), repr(name), "name")


def test_marker_is_no_point():
    m = start()
    m.body("crank", ["A", "B"])
    m.marker("E", on="crank", at=(0, 0.5))
    says(nc.MechanismError, lambda: m.body("rod", ["E", "C"]), "'E'", "marker", "make it a point")
    says(nc.MechanismError, lambda: m.marker("F", on="crnk", at=(0, 0)), "'crnk'", "did you mean 'crank'?")


def test_disc_drawn_on_its_line():
    m = start()
    m.point("K", (1, 0.5))
    m.point("M", (2, 0))
    m.point("Q", (2, 1))
    m.body("disc", ["M", "Q"])
    m.rolling("roll", "M", "Q", "K", ("A", "D"), "phi", "s")
    says(nc.MechanismError, m.compile, "'roll'", "'M'", "A-D", "one side")


def test_too_few_and_too_many_inputs():
    system = four_bar()
    says(
        nc.InputError,
        lambda: nc.solve_position(system, {}),
        "too few inputs",
        "1 degree of freedom",
        "0 inputs were given",
        "phi",
        "A.x",
    )
    says(
        nc.InputError,
        lambda: nc.sweep(system, {"phi": np.zeros(3), "A.x": np.zeros(3)}),
        "too many inputs",
        "1 degree of freedom",
        "2 inputs were given (phi, A.x)",
        "Leave 1",
    )


def test_input_that_does_not_exist():
    says(nc.InputError, lambda: nc.solve_position(four_bar(), {"ph1": 0.3}), "'ph1'", "did you mean 'phi'?")
    says(nc.InputError, lambda: nc.sweep(four_bar(), {"phi": np.zeros(3)}, rates={"psi": 1.0}), "'psi'", "phi")
    # An unknown name is said before the shape of its values, and by what it was to be used for.
    says(nc.InputError, lambda: nc.sweep(four_bar(), {"ph1": 1.0}), "'ph1' to drive", "did you mean 'phi'?")
    # The names told are those that can be driven: none of the ground.
    says(nc.InputError, lambda: nc.sweep(four_bar(), {"q": 1.0}), "'q' to drive", "known names: A.x, A.y, B.x")
    says(nc.InputError, lambda: nc.solve_position(four_bar(), {"phi": 1.0}, hold=["ph1"]), "'ph1' to hold", "'phi'")
    says(nc.InputError, lambda: nc.sweep(four_bar(), {"phi": np.zeros(3)})["Q"], "'Q'", "P")
    mo = nc.sweep(four_bar(), {"phi": np.zeros(3)})
    says(nc.InputError, lambda: mo.velocity("P"), "no velocity", "rates={'phi'")
    says(nc.InputError, lambda: four_bar().replace(crnk=1.0), "'crnk'", "crank.O2-A")
    says(nc.InputError, lambda: four_bar().replace({"P": 1.0}), "'P'", "(2,)")


def test_inputs_tied_to_each_other():
    m = start()
    m.point("E", (6, 1))
    m.body("crank", ["A", "B"])
    m.body("other", ["D", "E"])
    m.angle("phi", "A", "B")
    says(
        nc.InputError,
        lambda: nc.solve_position(m.compile(), {"phi": 0.1, "B.x": 0.1, "C.x": 1.0, "C.y": 0.0}),
        "does not determine",
        "E.",
        "choose other inputs",
    )


def test_input_out_of_reach():
    says(
        nc.AssemblyError,
        lambda: nc.solve_position(slider_crank(), {"S.x": 5.0}),
        "'slider-crank'",
        "does not assemble",
        "as far as S.x = 0.39",
        "diagnose",
    )
    says(
        nc.AssemblyError,
        lambda: nc.sweep(slider_crank(), {"S.x": [0.3, 0.35, 5.0]}, throw=True),
        "1 of 3",
        "S.x = 5 (the motion got to 0.399",
    )


def test_a_pose_of_the_other_branch_is_not_said_to_be_none():
    """|BD| is from 1.8 to 4.2: phi from 0.794 to 2.402, and the mirror image of it."""
    system = nc.library.four_bar(crank=2.0, coupler=3.0, rocker=1.2, ground=2.5).compile()
    assert nc.diagnose(system, {"phi": -1.5}).assembles
    says(nc.AssemblyError, lambda: nc.solve_position(system, {"phi": -1.5}), "or not on the branch that it began on")


def test_contradictory_constraints_are_named():
    m = start()
    m.body("crank", ["A", "B"])
    m.relation("wish", {"B.x": 1.0}, constant=7.0)
    system = m.compile()
    report = nc.mobility(system)
    assert any(r.startswith("wish") for r in report.conflicting) and any("A-B" in r for r in report.conflicting)
    assert "does not assemble" in str(report) and "wish" in str(report)
    says(
        nc.AssemblyError,
        lambda: nc.solve_position(system, {"C.x": 1.0, "C.y": 1.0}),
        "does not assemble",
        "wish",
        "diagnose",
    )
    for inputs in ({"C.x": 1.0}, {"C.x": 1.0, "C.y": 1.0, "B.y": 0.5}):
        for ask in (nc.solve_position, nc.diagnose):
            says(
                nc.InputError, lambda i=inputs, f=ask: f(system, i), "has 2 degrees", "not assemble", "wish", "diagnose"
            )
    assert "wish" in str(nc.diagnose(system))


def test_not_finite_data():
    says(nc.InputError, lambda: nc.solve_position(four_bar(), {"phi": float("nan")}), "'phi'", "NaN")
    says(nc.InputError, lambda: nc.sweep(four_bar(), {"phi": [0.0, np.inf]}), "'phi'", "1 of 2")
    says(
        nc.InputError,
        lambda: nc.sweep(four_bar(), {"phi": np.zeros(3)}, rates={"phi": np.nan}),
        "rates of 'phi'",
        "NaN",
    )
    says(nc.InputError, lambda: nc.solve_position(four_bar().replace({"A": (np.nan, 0.0)}), {"phi": 0.1}), "'A'", "NaN")


def test_shapes_of_inputs():
    says(nc.InputError, lambda: nc.sweep(four_bar(), {"phi": 0.3}), "sequence", "solve_position")
    says(nc.InputError, lambda: nc.sweep(four_bar(), {"phi": []}), "sequence")
    says(nc.InputError, lambda: nc.sweep(four_bar(), [0.1, 0.2]), "by name")
    says(nc.InputError, lambda: nc.sweep(four_bar(), {"phi": ["a", "b"]}), "'phi'", "numbers")
    says(nc.InputError, lambda: nc.motion(four_bar(), {"phi": 3.0}, np.zeros(3)), "'phi'", "function of time")
    says(nc.InputError, lambda: nc.motion(four_bar(), {"phi": lambda t: t}, 0.0), "time t")
    says(nc.InputError, lambda: nc.sweep(four_bar(), {"phi": np.zeros(3)}, jerk=True), "rates")


def test_x64_off():
    m = start()
    m.body("crank", ["A", "B"])
    jax.config.update("jax_enable_x64", False)
    try:
        says(nc.JaxncError, m.compile, "64-bit", 'jax.config.update("jax_enable_x64", True)', "JAX_ENABLE_X64=1")
    finally:
        jax.config.update("jax_enable_x64", True)


def test_nothing_to_compile():
    says(nc.MechanismError, nc.Mechanism("void").compile, "'void'", "no points", "ground()")
    says(nc.MechanismError, lambda: nc.Mechanism("x", dim=4), "dim=4")


def test_other_mistakes_of_a_builder():
    m = start()
    for call, *parts in (
        (lambda: m.slot("s", "B", ("A", "A")), "two different points"),
        (lambda: m.slot("s", "A", ("A", "B")), "own line"),
        (lambda: m.slot("s", "B", "A"), "two points"),
        (lambda: m.angle("f", to="B"), "say where the angle is"),
        (lambda: m.angle("f", at="A"), "say what it goes to"),
        (lambda: m.angle("f", "A", "B", form="tangent"), "'tangent'", "cosine"),
        (lambda: m.distance("s", "A", "B", form="x"), "needs a line"),
        (lambda: m.gear("g", "phi", "psi"), "unknown angle 'phi'"),
        (lambda: m.relation("tie", {"q": 1.0}), "unknown coordinate 'q'"),
        (lambda: m.relation("tie", {"B.x": 0.0}), "all factors are zero"),
        (lambda: m.cable("c", ["A"]), "at least two points"),
        (lambda: m.point("P", (0, 0), fixed="z"), "'z'", "axes x, y"),
        (lambda: m.body("b", ["A", "B"], local={"B": (1, 1)}), "third and further"),
        (lambda: m.body("b", ["A", "B"], lengths={("A", "C"): 1}), "'C'", "not one of its points"),
        (lambda: m.weld("w", "b", "c"), "unknown body 'b'"),
        (lambda: m.constrain("distance", nc.constraints.DISTANCE, ["A"]), "takes 2 points"),
    ):
        says(nc.MechanismError, call, *parts)
    assert re.match(r"Mechanism\('rig': 2 ground points, 2 points, 0 bodies", repr(m)), "a refused call changes nothing"


def test_mistakes_of_use():
    system, pose = four_bar(), nc.solve_position(four_bar(), {"phi": 0.3})
    m = start()
    for call, *parts in (
        (lambda: nc.sweep(m, {"phi": [0.0, 1.0]}), "compiled System", "got Mechanism", "compile()"),
        (lambda: nc.mobility(m), "compiled System", "compile()"),
        (lambda: nc.motion(system, {"phi": lambda t: np.sin(t)}, [0.0, 1.0]), "'phi'", "jax.numpy"),
        (lambda: nc.motion(system, {"phi": lambda: 1.0}, [0.0, 1.0]), "'phi'", "must take (t)"),
        (lambda: nc.motion(system, {"phi": lambda t: 1 + jax.numpy.sqrt(t)}, [0.0, 1.0]), "'phi'", "first rate", "NaN"),
        (lambda: nc.diagnose(system, {"phi": [1.0, 2.0]}), "one pose", "(2,)"),
        (lambda: nc.sweep(system, {"phi": [1.0, 2.0]}, rates={"phi": np.ones((3, 2))}), "'phi'", "(3, 2)"),
        (lambda: nc.sweep(system, {"phi": [1.0, 2.0]}, start={"phi": (1, 2)}), "'phi'", "one number"),
        (lambda: nc.sweep(system, {"phi": [1.0, 2.0]}, start=np.ones(3)), "earlier pose", "by name"),
        (lambda: nc.solve_position(system, {"phi": 0.3}, start={"B": (np.inf, 1.0)}), "'B'", "infinite"),
        (lambda: nc.solve_position(system, {"phi": 0.3}, branch=3), "branch=", "3"),
        (lambda: nc.solve_position(system, {"phi": 0.3j}), "'phi'", "number"),
        (lambda: nc.travel(system, ["phi"]), "strings", "phi"),
        (lambda: jax.jit(lambda s: nc.travel(s, "phi").upper)(system), "travel", "outside of traced code"),
        (lambda: jax.jit(lambda s: nc.mobility(s).dof)(system), "mobility", "outside of traced code"),
        (lambda: jax.jit(lambda u: nc.sweep(system, {"phi": u}, throw=True).q)(np.ones(2)), "throw=True", "outside"),
        (lambda: jax.jit(lambda u: nc.motion(system, {"phi": lambda t: t}, u, throw=True).q)(np.ones(2)), "throw=True"),
        (lambda: jax.jit(lambda u: nc.sweep(system, {"phi": u}).check().q)(np.ones(2)), "check()", "outside", "return"),
        (lambda: system.replace({"crank.O2-A": -1.0}), "'crank.O2-A'", "positive"),
        (lambda: nc.solve_position(system, {"phi": 0.3, "O2.x": 0.0, "A.x": 0.1}), "2 inputs", "O2.x of the ground"),
    ):
        with pytest.raises(nc.InputError) as caught:
            call()
        for part in parts:
            assert part in str(caught.value), (part, str(caught.value))
        assert caught.value.__cause__ is None
    assert int(pose.status) == 0


def test_one_point_on_a_line_is_a_slot():
    m = nc.Mechanism()
    m.ground("K", (0, 0))
    m.ground("G", (1, 0))
    m.point("R", (0.5, 0))
    with pytest.raises(nc.MechanismError, match=r"'ram'.*two points.*'R'.*slot\(\)"):
        m.prismatic("ram", line=("K", "G"), on="R")


@pytest.mark.parametrize(
    "value",
    [None, [0.1, None], "0.1", [b"0.1"], np.datetime64("2020-01-01"), np.ma.masked_array([0.1, 0.2], [False, True])],
)
def test_what_is_no_number_is_no_input(value):
    """None is no NaN; a text, a date and what is masked are not taken for numbers, as NumPy would."""
    system = nc.library.four_bar().compile()
    parts = ("'phi'", "must be a number or an array of numbers", "got")
    says(nc.InputError, lambda: nc.solve_position(system, {"phi": value}), "input", *parts)
    says(nc.InputError, lambda: nc.sweep(system, {"phi": [0.1, 0.2]}, rates={"phi": value}), "rates", *parts)


def test_letters_of_a_text_are_no_list_of_points():
    says(nc.MechanismError, lambda: start().body("crank", "AB"), "'crank'", "'AB' is one name", "write ['A', 'B']")
    says(nc.MechanismError, lambda: start().cable("rope", "ABC"), "'rope'", "write ['A', 'B', 'C']")
    says(nc.MechanismError, lambda: start().body("crank", None), "'crank'", "points are a list of names, got None")


@pytest.mark.parametrize("value", [None, "1", 1j, [1.0, None]])
def test_what_is_no_number_is_no_design(value):
    system = nc.library.four_bar().compile()
    parts = ("must be a number or an array of numbers", "got")
    says(nc.InputError, lambda: system.replace({"crank.A-B": value}), "design variable 'crank.A-B'", *parts)
    says(nc.InputError, lambda: system.replace({"D": value}), "design variable 'D'", *parts)


def test_names_are_strings():
    """A motion is asked for a pose as one asks a list: it says which method that is."""
    system = nc.library.four_bar().compile()
    motion = nc.sweep(system, {"phi": [0.1, 0.2]})
    says(nc.InputError, lambda: motion[0], "named by strings", "motion.pose(0)")
    says(nc.InputError, lambda: motion[::2], "named by strings", "motion.pose(slice(")
    says(nc.InputError, lambda: system[None], "named by strings", "'A'", "None")


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        (lambda: nc.synthesis.transmission_angle(None), ("transmission_angle: min", "positive number", "None")),
        (lambda: nc.synthesis.size("3m"), ("size: max", "positive number", "'3m'")),
        (lambda: nc.synthesis.roberts_cognates(nc.library.four_bar()), ("needs a compiled System", "compile()")),
        (lambda: nc.synthesis.function_four_bars(None, (1, 2), 1, 1), ("function_four_bars", "function of x", "None")),
    ],
)
def test_synthesis_asked_for_nothing(call, parts):
    says(nc.InputError, call, *parts)


# ---------------------------------------------------------------------------------------------------------------
# slips of a first hour: the wrong kind of thing where a name, a list or a motion is wanted


def slipped(what):
    m = start()
    if what == "points one by one":
        m.body("plate", "B", "C")
    elif what == "no points":
        m.body("plate", None)
    elif what == "a length alone":
        m.body("plate", ["B", "C"], lengths=3)
    elif what == "a typing error":
        m.gravitiy = (0, -9.81)
    elif what == "gravity in space":
        m.gravity = [0, 0, -9810]
    elif what == "a force in space":
        m.force("push", "B", (0, 0, 1))
    elif what == "stops crossed":
        m.stop("end", "phi", lower=1, upper=0, stiffness=1)
    else:
        m.revolute("hinge")


@pytest.mark.parametrize(
    ("slip", "parts"),
    [
        ("points one by one", ("lengths= takes", "'C'", "['A', 'B']")),
        ("no points", ("a list of names", "None")),
        ("a length alone", ("lengths= takes", "got 3")),
        ("a typing error", ("'gravitiy'", "did you mean 'gravity'")),
        ("gravity in space", ("gravity: its vector must be 2 numbers", "[0, 0, -9810]")),
        ("a force in space", ("'push': its vector must be 2 numbers",)),
        ("stops crossed", ("'end'", "lower = 1", "below upper = 0")),
        ("no name", ("'hinge'", "the name of a point", "None")),
    ],
)
def test_slips_in_a_description(slip, parts):
    says(nc.MechanismError, lambda: slipped(slip), *parts)


def test_a_number_where_the_name_of_a_mechanism_is_wanted():
    says(nc.MechanismError, lambda: nc.Mechanism(3), "3", "dim=3")


@pytest.mark.parametrize(
    ("ask", "parts"),
    [
        (lambda run: run[0], ("named by strings", "motion.pose(0)")),
        (lambda run: run["B", "x"], ("named by strings", "('B', 'x')")),
        (lambda run: run.velocity(None), ("None",)),
        (lambda run: run.pose(99), ("pose(99)", "3 poses")),
        (lambda run: run.draw(ghosts=5), ("ghosts=", "(0, 10, 20)", "5")),
        (lambda run: run.animate("a.gif", fps="x"), ("fps='x'", "positive number")),
        (lambda run: run.to_html("a.html", model="four-bar"), ("model=", "Mechanism", "str")),
        (lambda run: run.to_csv(7), ("a file is named by text", "7")),
        (lambda run: run.draw(7), ("a file is named by text", "7")),
        (lambda run: nc.load(None), ("a file is named by text", "None")),
        (lambda run: nc.grashof(1, 2, 3, 4), ("grashof()", "compiled System", "int")),
        (lambda run: nc.suspension(run.system), ("suspension()", "a motion", "System")),
    ],
)
def test_slips_with_a_motion(ask, parts, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = nc.sweep(four_bar(), {"phi": [1.0, 1.1, 1.2]}, rates={"phi": 1.0})
    says(nc.InputError, lambda: ask(run), *parts)
    assert not list(tmp_path.iterdir())


def test_a_length_is_suggested_by_its_bars():
    says(
        nc.InputError,
        lambda: nc.library.four_bar().compile().replace({"C-D": 2.0}),
        "'C-D'",
        "did you mean 'rocker.C-D'",
    )


def test_the_line_that_is_named_is_the_users_own():
    system = four_bar()
    says(nc.InputError, lambda: nc.motion(system, {"phi": lambda t: np.ptp(t)}, [0.0, 0.1]), "test_messages.py, line")


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        (lambda m: m.relation("tie", ["p"]), ("relation 'tie': terms= takes", "by name", "['p']")),
        (lambda m: m.constrain("mine", None, points=["A"]), ("constraint 'mine'", "a Kind", "None")),
        (lambda m: m.gear("g", "p", "q", radii=1), ("gear pair 'g'", "radii= are two", "got 1")),
        (lambda m: m.spring("k", "B", "D", stiffness=None), ("spring 'k'", "stiffness must be a number", "None")),
        (lambda m: m.damper("c", "p", damping=None), ("damper 'c'", "damping must be a number", "None")),
    ],
)
def test_what_is_no_table_no_pair_and_no_number(call, parts):
    m = start()
    m.angle("p", at="A", to="B")
    m.angle("q", at="D", to="C")
    says(nc.MechanismError, lambda: call(m), *parts)


def test_dynamics_of_nothing():
    system = nc.library.four_bar().compile()
    m = start()
    m.body("arm", ["A", "B"], mass=1.0)
    m.model.points.pop("C")
    says(nc.InputError, lambda: nc.simulate(m.compile(), [0.0, 1.0], state=3), "state", "by name", "got 3")
    says(nc.InputError, lambda: nc.reactions(system), "reactions()", "System")


TURN = 2.0 * np.pi

LIKE_DEGREES = {
    "one number": 45,
    "one float": 45.0,
    "tens": np.arange(0, 361, 10),
    "ones": np.arange(0, 361),
    "fives": np.arange(0, 361, 5),
    "a half turn": np.linspace(0, 180, 7),
    "to and fro": np.linspace(-30, 30, 61),
    "no whole numbers": np.linspace(0, 360, 50),
    "fine": np.linspace(0, 360, 500),
    "a list": [0, 45, 90],
}
NO_DEGREES = {
    "many fine turns": np.linspace(0, 50, 5000),
    "whole turns": TURN * np.arange(9),
    "whole turns from an angle": 0.3 + TURN * np.arange(9),
    "a turn": np.linspace(0, TURN, 361),
    "radians": np.arange(7),
    "two": [0.5, 5.5],
    "converted": np.radians(np.arange(0, 3600, 400)),
    "far": 20.5,
    "huge": 1e300,
}


@pytest.fixture(scope="module")
def turning():
    return nc.library.four_bar().compile()


@pytest.mark.parametrize("what", LIKE_DEGREES)
@pytest.mark.parametrize("analysis", [nc.sweep, nc.solve_position])
def test_degrees_are_doubted_wherever_angles_are_given(turning, what, analysis):
    values = LIKE_DEGREES[what]
    values = [0, values] if analysis is nc.sweep and not np.ndim(values) else values
    with pytest.warns(UserWarning, match=r"'phi'.*radians.*unit='deg'") as caught:
        analysis(turning, {"phi": values}, throw=False)
    assert caught[0].filename == __file__ and len(caught) == 1
    for unit in ("deg", "rad"):
        analysis(turning, {"phi": values}, throw=False, unit=unit)


@pytest.mark.parametrize("what", NO_DEGREES)
def test_radians_times_and_lengths_are_not_doubted(turning, what):
    nc.solve_position(turning, {"phi": NO_DEGREES[what]}, throw=False)
    if np.ndim(NO_DEGREES[what]):
        nc.sweep(turning, {"phi": NO_DEGREES[what]}, rates={"phi": 360.0})
        nc.sweep(turning, {"B.x": np.arange(40)}, repair=False)
    jax.jit(lambda x: nc.solve_position(turning, {"phi": x}).q)(45.0)


def test_degrees_are_doubted_in_time_and_in_what_is_held(turning):
    t = np.linspace(0.0, 1.0, 50)
    nc.motion(turning, {"phi": lambda t: TURN * t}, t)
    for call in (
        lambda: nc.motion(turning, {"phi": lambda t: 360 * t}, t),
        lambda: nc.motion(turning, {"phi": (360 * t, 360.0, 0.0)}, t),
        lambda: nc.circuit(turning, "phi", (0, 360), 9),
        lambda: nc.diagnose(turning, {"phi": 90}),
        lambda: nc.solve_position(turning, {"C.y": 0.07}, start={"phi": 60}, throw=False),
        lambda: nc.sensitivity(turning, "C", {"phi": 30}),
    ):
        with pytest.warns(UserWarning, match="'phi' .*angles are in radians here"):
            call()
