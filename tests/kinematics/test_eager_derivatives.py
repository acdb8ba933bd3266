"""Gradients outside of compiled code, which the host finds as numbers: the same as those of compiled code."""

import functools
import weakref

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.kinematics import host_solve, traced
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.plan import plan
from jaxnc.system import frames, on_lanes


@pytest.fixture(autouse=True)
def nothing_asked_before(monkeypatch):
    """What other tests have asked for does not count."""
    monkeypatch.setattr(host_solve, "_asked", weakref.WeakKeyDictionary())


def five_bar_with_an_arm():
    """Three coordinates of points are independent, one of them of the arm alone."""
    m = nc.Mechanism("five-bar with an arm")
    m.ground("A", (0, 0)), m.ground("E", (1, 0))
    for name, at in {"B": (0.1, 0.5), "C": (0.6, 1.0), "D": (1.2, 0.6), "F": (0.9, 1.3)}.items():
        m.point(name, at)
    for body in ("AB", "BC", "CD", "DE", "AF"):
        m.body(body, list(body))
    return m


MADE = {
    "four-bar": nc.library.four_bar,
    "failed poses": nc.library.crank_slider_on_bar,
    "redundant rows": nc.library.peaucellier_lipkin,
    "markers in space": nc.library.rssr,
}


def moved(make):
    """A system, and a few values of its independent coordinates from the drawing on."""
    system = make().compile()
    home, place = np.asarray(derive(system).home), system.topology.position
    return system, {name: home[place[name]] + np.linspace(0.0, 0.01, 4) for name in system.independent}


def weigh(found, names, of):
    return sum(jnp.sum(jnp.sin(5.0 * of(name)) * jnp.arange(1.0, 1.0 + of(name).size).reshape(of(name).shape))
               for name in names)  # fmt: skip


def both(f, x, monkeypatch):
    """A gradient with derivatives by numbers, and by compiled code."""
    by_numbers = jax.grad(f)(x)
    monkeypatch.setattr(host_solve, "suits_slopes", lambda *_: False)
    return by_numbers, jax.grad(f)(x)


def same(found, wanted):
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        assert one.dtype == other.dtype
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * max(1.0, np.abs(other).max(initial=0.0)))


@pytest.mark.parametrize("name", MADE)
def test_designs_with_rates(name, monkeypatch):
    system, inputs = moved(MADE[name])
    top = system.topology
    names = [*top.points, *top.vectors, *(m.name for m in top.markers), *top.scalars]
    rates = dict.fromkeys(inputs, 1.3)

    def value(system):
        motion = nc.sweep(system, inputs, rates=rates)
        return weigh(motion, names, lambda n: motion[n]) + weigh(motion, names, motion.velocity)

    found, wanted = both(value, system, monkeypatch)
    assert max(float(np.abs(x).max(initial=0.0)) for x in jax.tree.leaves(found)) > 0.1
    same(found, wanted)


READINGS = {
    "four-bar": [
        ("coupler", nc.Motion.orientation), ("coupler", nc.Motion.angular_acceleration),
        ("coupler", nc.kinematics.instant_motion),
    ],
    "markers in space": [
        ("rocker", nc.Motion.quaternion), ("rocker", nc.Motion.orientation), ("rocker", nc.Motion.angular_velocity),
        ("rocker", nc.Motion.screw_axis),
    ],
}  # fmt: skip


@pytest.mark.parametrize("name", READINGS)
def test_what_is_read_off_poses(name, monkeypatch):
    """Nothing is compiled for a body's axes, and the derivatives are those of compiled code."""
    system, inputs = moved(MADE[name])
    order = dict.fromkeys(inputs, 1.3)

    def value(system):
        motion = nc.sweep(system, inputs, rates=order, accelerations=order)
        read = jax.tree.leaves([f(motion, body) for body, f in READINGS[name]])
        read += [motion.acceleration(m.name) for m in system.topology.markers]
        parts = [jnp.sin(x).ravel() for x in read if jnp.issubdtype(x.dtype, jnp.floating)]
        return sum(jnp.vdot(x, jnp.arange(1.0, 1.0 + x.size)) for x in parts)

    compiled, run = [], frames._along_compiled
    monkeypatch.setattr(frames, "_along_compiled", lambda *given: compiled.append(given[0]) or run(*given))
    by_numbers = jax.grad(value)(system)
    assert not compiled
    wanted = nc.jit(jax.grad(value))(system)
    assert compiled
    same(by_numbers, wanted)


@pytest.mark.parametrize("solve", [nc.sweep, nc.solve_position])
def test_poses_that_are_not_repaired_have_the_same_derivatives(solve):
    system, t = nc.library.four_bar().compile(), np.linspace(0.5, 1.0, 5)

    def place(system, repair):
        return jnp.sum(jnp.sin(5.0 * solve(system, {"phi": t}, repair=repair)["C"]))

    same(jax.grad(place)(system, False), jax.grad(place)(system, True))


def test_so_many_poses_are_read_by_compiled_code(monkeypatch):
    system = nc.library.four_bar().compile()
    top, q = system.topology, np.zeros((10**6, len(system.topology.coordinates)))
    asked = []

    def along(pose):
        asked.append(on_lanes.attach_along(frames.frame, (top, top.bodies[0].segments), pose, (), ()))
        return pose.sum()

    jax.grad(along)(q)
    jax.grad(along)(q[:100])
    assert asked[0] is None and asked[1] is not None


def test_inputs_and_places_to_begin_from(monkeypatch):
    system, inputs = moved(nc.library.four_bar)

    def value(given):
        near = nc.solve_position(system.replace({"D": given["D"]}), {"phi": given["phi"]}, start={"C": (0.3, 0.2)})
        return weigh(near, ["B", "C"], lambda n: near[n])

    given = {"D": jnp.asarray(system["D"]), "phi": jnp.asarray(inputs["phi"])}
    same(*both(value, given, monkeypatch))


@pytest.mark.parametrize("name", ["four-bar", "markers in space"])
def test_inputs_with_rates_beside_a_design(name, monkeypatch):
    system, inputs = moved(MADE[name])
    names, (first,) = system.topology.points, inputs

    def value(given):
        place, *orders = given
        third = {"jerk": True} if len(orders) > 3 else {}
        motion = nc.sweep(
            system.replace({names[-1]: place}),
            {first: orders[0]}, rates={first: orders[1]}, accelerations={first: orders[2]}, **third,
        )  # fmt: skip
        read = [motion.__getitem__, motion.velocity, motion.acceleration, *([motion.jerk] if third else [])]
        return sum(weigh(motion, names, f) for f in read)

    given = jnp.asarray(system[names[-1]]), jnp.asarray(inputs[first]), jnp.full(4, 0.3), jnp.full(4, -0.2)
    if name == "four-bar":
        same(*both(value, given, monkeypatch))
    found = jax.grad(value)((*given, jnp.zeros(4)))  # with third derivatives, by differences of what is found
    for k, x in enumerate(given):
        change = jnp.linspace(0.5, 1.0, x.size).reshape(x.shape) * 1e-6
        ends = [value((*given[:k], x + sign * change, *given[k + 1 :], jnp.zeros(4))) for sign in (1.0, -1.0)]
        assert float(jnp.vdot(found[k], change)) == pytest.approx(float(ends[0] - ends[1]) / 2, rel=1e-5)


def test_what_is_held_follows_the_drawing(monkeypatch):
    system = five_bar_with_an_arm().compile()
    home, place = np.asarray(derive(system).home), system.topology.position
    first, *others = system.independent

    def value(system):
        motion = nc.sweep(system, {first: home[place[first]] + np.linspace(-0.02, 0.02, 3)}, hold=others)
        return weigh(motion, system.topology.points, lambda n: motion[n])

    same(*both(value, system, monkeypatch))


def test_what_is_held_follows_a_start():
    """As if it were an input; by name, and in an earlier pose."""
    system = five_bar_with_an_arm().compile()
    home, place = np.asarray(derive(system).home), system.topology.position
    first, second, *others = system.independent
    values, at = home[place[first]] + np.linspace(-0.02, 0.02, 3), home[place[second]] + 0.01

    def driven(value):
        return nc.sweep(system, {first: values, second: jnp.full(3, value)}, hold=others)

    def named(value):
        return nc.sweep(system, {first: values}, hold=system.independent[1:], start={second: value})

    def alone(value):
        return nc.solve_position(system, {first: values}, hold=system.independent[1:], start={second: value})

    def from_earlier(value):
        pose = nc.solve_position(system, {first: values[0], second: value}, hold=others)
        return nc.sweep(system, {first: values}, hold=system.independent[1:], start=pose)

    points = system.topology.points
    slope = lambda f: jax.grad(lambda x: weigh(f(x), points, f(x).__getitem__))(at)  # noqa: E731
    for f in (named, alone, from_earlier):
        np.testing.assert_allclose(slope(f), slope(driven), rtol=1e-6)
    batch = jax.grad(lambda s: nc.solve_position(s, {first: values}, hold=system.independent[1:]).q.sum())
    same(batch(system), nc.jit(batch)(system))
    point, _, axis = second.rpartition(".")
    column = "xyz".index(axis)

    def by_place(x):
        return nc.sweep(system, {first: values}, hold=system.independent[1:], start={point: x})

    at = jnp.asarray(system[point]).at[column].set(at)
    found = slope(by_place)
    assert found[column] == pytest.approx(float(slope(lambda x: named(x[column]))[column]), rel=1e-6)
    assert np.abs(np.delete(found, column)).max() <= 1e-9  # it is not held


def test_what_is_held_stays_where_a_start_names_another():
    """A bar on a joint that a start moves: its other end has the place of the drawing, with every solver."""
    m = nc.Mechanism("five-bar with a bar on C")
    m.ground("A", (0, 0))
    m.ground("E", (1, 0))
    for name, place in {"B": (0.1, 0.5), "C": (0.6, 1.0), "D": (1.2, 0.6), "F": (0.9, 1.3)}.items():
        m.point(name, place)
    for name in ("AB", "BC", "CD", "DE", "CF"):
        m.body(name, list(name))
    system, hold = m.compile(), ["C.x", "F.x"]
    for solve in (nc.sweep, nc.solve_position):
        place = functools.partial(lambda x, f: f(system, {"B.x": [0.08, 0.1]}, hold=hold, start={"C.x": x}).q, f=solve)
        for q in (place(0.61), nc.jit(place)(0.61)):
            np.testing.assert_allclose(q[:, [system.topology.position[name] for name in hold]], [[0.61, 0.9]] * 2)

    def height(x):  # of F, which hangs on C: both x are held
        design = system.replace({"F": jnp.stack([x, jnp.asarray(1.3)])})
        return nc.sweep(design, {"B.x": [0.08, 0.1]}, hold=hold, start={"C.x": 0.61})["F"][0, 1]

    ends = [height(0.9 + h) for h in (1e-5, -1e-5)]
    assert float(jax.grad(height)(0.9)) == pytest.approx(float(ends[0] - ends[1]) / 2e-5, rel=1e-6)


def test_what_is_known_stays_on_the_host(monkeypatch):
    """No solver is compiled for a first derivative; a second one is compiled, and right."""
    system, inputs = moved(nc.library.four_bar)
    compiled, ask = [], traced.analyse_traced
    monkeypatch.setattr(traced, "analyse_traced", lambda *given: compiled.append(1) or ask(*given))
    value = lambda place: nc.sweep(system.replace({"D": place}), inputs)["C"][:, 0].sum()  # noqa: E731
    place = jnp.asarray(system["D"])
    slope = jax.grad(value)(place)
    np.testing.assert_allclose(jax.jacfwd(value)(place), slope, atol=1e-12)
    assert not compiled
    second, step = jax.hessian(value)(place), 1e-5
    assert compiled
    for k in range(2):
        change = step * jnp.eye(2)[k]
        by_steps = (jax.grad(value)(place + change) - jax.grad(value)(place - change)) / (2 * step)
        np.testing.assert_allclose(second[k], by_steps, atol=1e-6 * np.abs(second).max())


def test_two_derivatives_by_different_things():
    """Each has numbers behind it, and together they are a derivative of the second order."""
    system = nc.synthesis.FourBar((0, 0), (0.3, 0.8), (2.1, 1.9), (2.5, 0)).system

    def place(pin, angle, length=None):
        changed = system.replace({"D": pin} | ({} if length is None else {"B": length}))
        return nc.solve_position(changed, {"phi": angle})["C"][0]

    pin, angle, step = jnp.asarray(system["D"]), 0.7, 1e-5
    inner = lambda d: jax.grad(place, 1)(d, angle)  # noqa: E731
    steps = [(inner(pin + step * e) - inner(pin - step * e)) / (2 * step) for e in jnp.eye(2)]
    ways = [
        jax.grad(inner)(pin),
        jax.jacfwd(inner)(pin),
        jax.jacfwd(jax.grad(place), 1)(pin, angle),
        jax.grad(lambda d: jax.jvp(lambda p: place(d, p), (angle,), (1.0,))[1])(pin),
    ]
    for found in ways:
        np.testing.assert_allclose(found, steps, rtol=1e-6)
    crank = jnp.asarray(system["B"])
    inner = lambda d: jax.grad(lambda b: place(d, angle, b))(crank)  # noqa: E731
    both = jax.jacfwd(inner)(pin)
    steps = [(inner(pin + step * e) - inner(pin - step * e)) / (2 * step) for e in jnp.eye(2)]
    np.testing.assert_allclose(both, np.transpose(steps), atol=1e-6 * np.abs(both).max())
    assert np.abs(both).max() > 0.1


def test_times_and_branches_beside_a_design():
    system, turn = nc.library.four_bar().compile(), np.linspace(0.3, 0.6, 3)
    given = turn, np.ones(3), np.zeros(3)

    def late(t, pin):
        return jnp.sum(nc.motion(system.replace({"D": pin}), {"phi": given}, t).time ** 2)

    t, pin = jnp.linspace(0.0, 1.0, 3), jnp.asarray(system["D"])
    np.testing.assert_allclose(jax.grad(late, argnums=(0, 1))(t, pin)[0], 2 * t)

    def beside(pin):
        design = system.replace({"D": pin})
        branch = nc.solve_position(design, {"phi": 0.3})
        return nc.solve_position(design, {"phi": turn}, branch=branch)["C"].sum()

    np.testing.assert_allclose(jax.grad(beside)(pin), nc.jit(jax.grad(beside))(pin), atol=1e-10)


def test_many_gradients_are_compiled_for():
    """Who goes on asking is better off with compiled code: for as long as it takes to compile the host answers."""
    system = nc.library.scotch_yoke().compile()
    view = plan(system.topology, system.independent, (), system.degrees_of_freedom)
    answers = [host_solve.suits_slopes(view, "continuation", np.zeros((300, 1)), 40) for _ in range(2000)]
    assert answers[0] and not answers[-1] and answers == sorted(answers, reverse=True)
    assert not host_solve.suits_slopes(view, "continuation", np.zeros((10**6, 1)), 40)


def test_poses_of_another_branch_stand_still():
    system = nc.library.four_bar().compile()
    values = np.array([0.5, 0.6])
    one, other = nc.modes(system, {"phi": 0.5}).poses["C"]

    def place(pin, branch):
        return nc.solve_position(system.replace({"D": pin}), {"phi": values}, branch=branch, throw=False)["C"].sum()

    pin = jnp.asarray(system["D"])
    slopes = []
    for at in (one, other):
        branch = nc.solve_position(system, {"phi": 0.5}, start={"C": at})
        slopes.append(jax.grad(place)(pin, branch))
        np.testing.assert_allclose(nc.jit(jax.grad(place))(pin, branch), slopes[-1], atol=1e-10)
    assert sorted(bool(np.any(slope)) for slope in slopes) == [False, True]


def test_markers_of_poses_that_were_not_found_stand_still():
    m = nc.Mechanism("stopped")
    m.ground("A", (0, 0)), m.ground("D", (4, 0)), m.point("B", (0, 1)), m.point("C", (3.3, 2.2))
    m.body("crank", ["A", "B"]), m.body("coupler", ["B", "C"])
    m.body("rocker", ["C", "D"], lengths={("C", "D"): 1.2}), m.marker("E", on="coupler", at=(2.0, 3.0))
    m.angle("phi", at="A", to="B")
    system, values = m.compile(), np.array([1.4, 3.0])
    assert np.asarray(nc.solve_position(system, {"phi": values}).status).tolist()[0] == 0
    for solve in (nc.solve_position, nc.sweep):
        slope = jax.grad(lambda system, k, solve=solve: solve(system, {"phi": values})["E"][k].sum())
        assert np.abs(slope(system, 0).parameters.points).max() > 0.1
        assert not any(np.any(x) for x in jax.tree.leaves(slope(system, 1)))
