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
def stretched() -> nc.System:
    """A slider-crank of crank 1 and rod 2, drawn in line."""
    m = nc.Mechanism("stretched")
    m.ground("A", (0, 0))
    m.ground("Z", (5, 0))
    m.point("B", (1, 0))
    m.point("C", (3, 0))
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
