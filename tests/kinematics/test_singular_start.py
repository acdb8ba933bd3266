"""Drawings that are singular positions of the inputs: two branches meet there, so none is followed, on any route.

Closed forms: of the stretched slider-crank, the law of cosines; of the five-bar, two circles.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc

SINGULAR, START = int(nc.Status.SINGULAR), int(nc.Status.SINGULAR_START)


@functools.cache
def stretched(up: float = 0.0) -> nc.System:
    """A slider-crank of crank 1 and rod 2, drawn in line, or with its pin a little above."""
    m = nc.Mechanism("stretched")
    m.ground("A", (0, 0))
    m.ground("Z", (5, 0))
    m.point("B", (np.sqrt(1 - up**2), up))
    m.point("C", (np.sqrt(1 - up**2) + np.sqrt(4 - up**2), 0))
    m.body("crank", ["A", "B"])
    m.body("rod", ["B", "C"])
    m.slot("guide", "C", ["A", "Z"])
    m.distance("s", "A", "C")
    m.angle("phi", at="A", to="B")
    return m.compile()


@functools.cache
def five_bar() -> nc.System:
    """Two cranks of 1, drawn upright, and between them two rods of 2, drawn in line."""
    m = nc.Mechanism("five-bar")
    m.ground("A", (0, 0))
    m.ground("E", (4, 0))
    for name, place in {"B": (0, 1), "C": (2, 1), "D": (4, 1)}.items():
        m.point(name, place)
    for name, ends in {"left": "AB", "to C": "BC", "from C": "CD", "right": "DE"}.items():
        m.body(name, [*ends])
    m.angle("u", at="A", to="B")
    m.angle("v", at="E", to="D")
    return m.compile()


CASES = [
    (stretched, {"s": np.linspace(2.5, 2.9, 5)}),
    (five_bar, {"u": np.linspace(1.5, 1.1, 5), "v": np.full(5, 1.7)}),
]


@pytest.mark.parametrize(("make", "inputs"), CASES)
def test_every_route_says_so_and_stays_at_the_drawing(make, inputs):
    system, many = make(), {name: np.tile(values, 2000) for name, values in inputs.items()}
    drawn = np.asarray(system.parameters.points)[[system.topology.points.index(p) for p in "BC"]]
    routes = [
        nc.solve_position(system, inputs, throw=False),
        nc.solve_position(system, many, throw=False),
        jax.jit(lambda u: nc.solve_position(system, u, throw=False))(inputs),
        nc.sweep(system, inputs, throw=False),
    ]
    for motion in routes:
        assert set(np.asarray(motion.status).tolist()) == {START}
        points = np.stack([np.asarray(motion[name]) for name in "BC"], axis=-2)
        np.testing.assert_allclose(points, np.broadcast_to(drawn, points.shape))


def test_the_drawing_itself_is_the_one_pose_that_is_singular():
    motion = nc.sweep(stretched(), {"s": np.linspace(3.0, 2.5, 4)}, throw=False)
    assert motion.status.tolist() == [SINGULAR, START, START, START]


def test_a_design_beside_it_and_a_start_have_their_branch():
    def height(s):
        cosine = (1 + s**2 - 4) / (2 * s)  # of the crank's angle
        return np.sqrt(1 - cosine**2)

    for side in (1.0, -1.0):
        pose = nc.solve_position(stretched(), {"s": 2.9}, start={"B": (0.9, 0.4 * side)})
        np.testing.assert_allclose(pose["B"][1], side * height(2.9), rtol=1e-12)


def test_derivatives_there_are_zero_and_finite():
    value, slope = jax.value_and_grad(lambda s: nc.solve_position(stretched(), {"s": s}, throw=False)["phi"])(2.9)
    assert value == 0.0 and slope == 0.0
    by_jit = jax.jit(jax.grad(lambda s: jnp.sum(nc.sweep(stretched(), {"s": s}, throw=False)["B"])))
    assert not by_jit(jnp.linspace(2.9, 2.5, 4)).any()


@pytest.mark.parametrize(("make", "inputs"), CASES)
def test_messages_and_reports_name_the_drawing(make, inputs):
    first = {name: float(values[0]) for name, values in inputs.items()}
    with pytest.raises(nc.AssemblyError, match="the drawing unless start= gives another, is a singular position"):
        nc.solve_position(make(), first)
    found = nc.diagnose(make(), first)
    assert found.assembles and found.singular and not found.reachable and "beside that" in str(found)
    report = nc.mobility(make(), [*inputs])
    assert report.dead_point and not report.momentary and "dead point of these inputs" in str(report)


def test_what_is_out_of_reach_of_a_singular_drawing_does_not_assemble():
    found = nc.diagnose(stretched(), {"s": 3.5})
    assert not found.assembles and found.singular
    assert {r.dimension for r in found.remedies} == {"length A-B of crank", "length B-C of rod"}
    assert not nc.mobility(stretched(), "phi").dead_point


@pytest.mark.parametrize("up", [1e-2, 1e-3, 1e-4, 1e-5, -1e-4])
def test_drawings_beside_a_dead_point_move_away_from_it(up):
    s = np.array([2.9, 2.7])
    height = np.sign(up) * np.sqrt(1 - ((1 + s**2 - 4) / (2 * s)) ** 2)
    for motion in (nc.sweep(stretched(up), {"s": s}), nc.solve_position(stretched(up), {"s": s})):
        np.testing.assert_allclose(motion["B"][:, 1], height, rtol=1e-7)


def test_how_far_it_goes_is_told_however_far_is_asked():
    system = stretched(0.5)
    reach = 3.0
    for asked in (3.1, 30.0, 3e4, 3e8):
        assert nc.diagnose(system, {"s": asked}).reached["s"] == pytest.approx(reach, rel=1e-6)
        with pytest.raises(nc.AssemblyError, match=r"as far as s = 3\."):
            nc.solve_position(system, {"s": asked})


def test_what_never_changes_is_no_input_and_says_so():
    m = nc.Mechanism("rigid length")
    for name, at in {"A": (0, 0), "D": (4, 0)}.items():
        m.ground(name, at)
    for name, at in {"B": (0.6, 0.8), "C": (3.3, 2.9), "P": (2.2, 2.6)}.items():
        m.point(name, at)
    for name, points in {"crank": "AB", "coupler": "BCP", "rocker": "CD"}.items():
        m.body(name, [*points])
    m.angle("phi", at="A", to="B")
    m.distance("q", "B", "P")
    system = m.compile()
    length = float(np.hypot(1.6, 1.8))
    for call in (lambda: nc.solve_position(system, {"q": length + 0.1}), lambda: nc.travel(system, "q")):
        with pytest.raises(nc.JaxncError, match=r"determines no motion|stays 2\.408"):
            call()
    assert nc.mobility(system, "q").never_moves and not nc.mobility(system, "phi").never_moves
    assert "determines no motion" in str(nc.diagnose(system, {"q": length + 0.1}))


def test_inputs_that_follow_from_each_other_are_told():
    """A differential whose one mesh is outside and the other inside: both side wheels turn as one, by their radii."""
    m = nc.Mechanism("locked", dim=3)
    m.ground("O", (0, 0, 0))
    m.ground_vector("axis", (1, 0, 0))
    for name, at in {"c": (0, 40, 0), "l": (-20, 0, 30), "r": (20, 0, 30), "p": (0, 30, 20)}.items():
        m.point(name, at)
    m.body("carrier", ["O", "c"], vectors=["axis"])
    m.body("planet", ["O", "c", "p"])
    for name, point in {"left": "l", "right": "r"}.items():
        m.body(name, ["O", point], vectors=["axis"])
        m.angle(f"{name}_on_carrier", start=("O", "c"), to=("O", point), about="axis")
        m.angle(name, to=("O", point), about="axis")
    m.angle("carrier_turns", to=("O", "c"), about="axis")
    m.angle("planet_turns", to=("c", "p"), start="axis", about=("O", "c"))
    for side in ("left", "right"):
        m.bevel_gear(f"{side} mesh", f"{side}_on_carrier", "planet_turns", radii=(20, 20))
    locked = m.compile()
    motion = nc.sweep(locked, {"left": np.linspace(0.0, 1.0, 3), "right": np.linspace(0.0, 2.0, 3)})
    with pytest.raises(nc.AssemblyError, match=r"left, right .*follows from the other"):
        motion.check()
    with pytest.raises(nc.AssemblyError, match="follows from the other"):
        jax.grad(lambda s: nc.sweep(s, {"left": [0.0, 1.0], "right": [0.0, 2.0]}).check()["l"].sum())(locked)
    assert nc.diagnose(locked, {"left": 0.0, "right": 0.0}).never_moves
    assert bool(nc.sweep(locked, {"left": np.linspace(0.0, 1.0, 3), "carrier_turns": np.zeros(3)}).converged.all())


@pytest.mark.parametrize("run", [510.0, 600.0, 1e4])
def test_gaps_are_lengths(run):
    """Two bars that are asked to span too much: what both lack, added up, is what is missing."""
    m = nc.Mechanism("dyad")
    m.ground("N", (0, 0))
    m.point("R", (0, -300), fixed="x")
    m.point("M", (200, -100))
    m.body("rib", ["N", "M"])
    m.body("stretcher", ["R", "M"])
    m.distance("run", "N", "R")
    found = nc.diagnose(m.compile(), {"run": run})
    missing = run - np.hypot(200, 100) - np.hypot(200, 200)
    assert sum(v.gap for v in found.violations) == pytest.approx(missing, rel=1e-6)
    assert found.gap == max(v.gap for v in found.violations)


def test_a_remedy_closes_all_loops():
    """Two loops one after the other, both open: no bar of the first one closes the second."""
    m = nc.Mechanism("two loops")
    for name, at in {"A": (0, 0), "D": (3, 0), "G": (5, 2)}.items():
        m.ground(name, at)
    for name, at in {"B": (0, 1), "C": (1.6, 1.2), "F": (2.2, 3.5), "K": (3.7, 2.9)}.items():
        m.point(name, at)
    for name, points in {"crank": "AB", "l": "BC", "r": "DCF", "l2": "FK", "r2": "KG"}.items():
        m.body(name, [*points])
    m.angle("phi", at="A", to="B")
    found = nc.diagnose(m.compile(), {"phi": np.pi})
    assert not found.assembles and not [r for r in found.remedies if "B-C" in r.dimension]


def test_a_whole_turn_from_a_singular_drawing_is_the_drawing():
    m = nc.library.parallelogram(0.1, 0.3, third=None)
    for name, at in {"B": (0.1, 0.0), "C": (0.4, 0.0)}.items():
        m.model.points[name] = at
    system = m.compile()
    turn = nc.solve_position(system, {"phi": np.array([0.0, 2 * np.pi, -2 * np.pi, 0.3])}, throw=False)
    assert turn.status.tolist() == [SINGULAR, SINGULAR, SINGULAR, START]


def test_what_has_no_inputs_says_that_it_does_not_assemble():
    m = nc.Mechanism("too short")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    m.point("B", (1, 1))
    m.body("one", ["A", "B"], lengths={("A", "B"): 1.0})
    m.body("two", ["B", "D"], lengths={("B", "D"): 1.0})
    with pytest.raises(nc.AssemblyError, match="does not assemble"):
        nc.solve_position(m.compile(), {})


def test_a_distance_whose_ends_meet_is_named():
    """A trammel of Archimedes: the distance of a block from where its grooves meet is zero twice in a turn."""
    m = nc.Mechanism("trammel")
    for name, at in {"O": (0, 0), "X": (5, 0), "Y": (0, 5)}.items():
        m.ground(name, at)
    m.point("A", (3 * np.cos(0.7), 0))
    m.point("B", (0, 3 * np.sin(0.7)))
    m.body("arm", ["A", "B"])
    m.slot("level", "A", ["O", "X"])
    m.slot("upright", "B", ["O", "Y"])
    m.angle("phi", at="A", to="B")
    m.distance("s", "O", "A")
    turn = nc.sweep(m.compile(), {"phi": np.linspace(np.pi - 0.7, np.pi - 3.0, 40)})
    with pytest.raises(nc.AssemblyError, match="ends of 's' meet there"):
        turn.check()
