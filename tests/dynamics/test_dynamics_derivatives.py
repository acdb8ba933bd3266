"""Derivatives of simulations: what the host knows of a design, what fails, what is compiled."""

import functools

import jax
import jax.monitoring
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.dynamics import runs
from jaxnc.dynamics.extended import extended, lift
from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.model import dynamics
from jaxnc.dynamics.runs import DesignChanges, ReplayedFlow, collect_derived, host_differentiates
from jaxnc.dynamics.start import assemble_pose

T = np.linspace(0.0, 0.2, 4)

_WORK: list[str] = []
jax.monitoring.register_event_duration_secs_listener(
    lambda event, *_, **__: _WORK.append(event) if event.endswith(("trace_duration", "compile_duration")) else None
)


# -- what simulations are made of --------------------------------------------------------------------------------------


@functools.cache
def swing():
    """A plate of three points on a ball joint, which gets a hidden vector, on a spring with a damper."""
    m = nc.Mechanism("swing", dim=3)
    m.ground("O", (0, 0, 0))
    m.ground("F", (0.3, 0.5, 0.2))
    m.point("A", (0.4, 0.05, -0.005))
    m.point("B", (0.2, -0.3, 0.03))
    m.body("plate", ["O", "A", "B"], mass=1.3, shape="plate")
    m.point_mass("mass at B", "B", 0.4)
    m.spring("spring", "A", "F", stiffness=30.0)
    m.damper("damper", "B", "F", damping=0.3)
    m.gravity = (0.1, -9.81, 0)
    return m.compile()


@functools.cache
def four_bar(names="ABCD", mass=0.5, stiffness=60.0, gravity=-9.81, title="four-bar"):
    a, b, c, d = names
    m = nc.Mechanism(title)
    m.ground(a, (0, 0))
    m.ground(d, (0.4, 0))
    m.point(b, (0, 0.1))
    m.point(c, (0.33, 0.29))
    m.body(f"crank{a}", [a, b], mass=mass)
    m.body(f"coupler{b}", [b, c], mass=1.2, com=(0.15, 0.22), inertia=0.01)
    m.body(f"rocker{d}", [c, d], mass=1.0)
    m.angle(f"phi{a}", at=a, to=b)
    m.gravity = (0, gravity)
    m.spring(f"return{b}", b, d, stiffness=stiffness)
    return m.compile()


def components(tree, lead):
    """Derivatives by all parameters, behind the first axes."""
    parts = (np.asarray(getattr(tree, name)) for name in ("points", "vectors", "markers", "dimensions", "physical"))
    return np.concatenate([x.reshape(*x.shape[:lead], int(np.prod(x.shape[lead:]))) for x in parts], axis=-1)


def test_the_host_knows_how_the_numbers_of_a_motion_change_with_the_design():
    """Against JAX's derivatives of the same numbers, and of the start."""
    system = swing()
    assert host_differentiates(system.topology)
    eq = dynamics(extended(system)).eq
    carried, q = DesignChanges(system, eq), np.asarray(lift(system.topology, np.asarray(assemble_pose(system, None))))

    def numbers(par):
        changed = nc.System(system.topology, par, system.degrees_of_freedom, system.independent)
        flow = Flow.of(dynamics(extended(changed)), system.degrees_of_freedom)
        return collect_derived(flow), lift(system.topology, assemble_pose(changed, None))

    derived, pose = jax.jit(jax.jacfwd(numbers))(system.parameters)
    is_leaf = lambda x: isinstance(x, type(system.parameters))  # noqa: E731
    seen = 0
    for a, b in zip(jax.tree.leaves(carried.derived()), jax.tree.leaves(derived, is_leaf=is_leaf), strict=True):
        wanted = components(b, a.ndim - 1)
        assert np.allclose(a[..., 1:], wanted, rtol=1e-12, atol=1e-12 * max(np.abs(wanted).max(initial=0), 1))
        seen += int(np.abs(wanted).max(initial=0.0) > 0)
    assert seen >= 4
    assert np.allclose(carried.start(q, ()), components(pose, 1), atol=1e-11)


@pytest.mark.parametrize("make", [swing, four_bar])
def test_what_is_derived_outside_of_compiled_code_changes_as_within(make):
    system = extended(make())
    rng = np.random.default_rng(3)
    way = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), system)
    found, wanted = (jax.jvp(f, (system,), (way,)) for f in (dynamics, jax.jit(dynamics)))
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12 * max(1.0, np.abs(other).max(initial=0.0)))


@pytest.mark.parametrize("state", [None, {"B": (0.02, 0.035)}], ids=["drawn", "near a place"])
def test_a_start_follows_given_lengths_as_it_is_assembled(state):
    """What lengths and places leave open moves as little as it must, in values and derivatives alike."""
    m = nc.library.four_bar()
    for body in ("crank", "coupler", "rocker"):
        m.mass(body, 0.2, com=(0.02, 0.01), inertia=1e-4)
    m.gravity = (0, -9.81)
    system = m.compile()
    points, lengths = system.parameters.points, system.parameters.dimensions
    assert lengths.size
    way = np.random.default_rng(0).normal(size=points.shape) * 0.1

    def end(k):
        change = {id(points): points + k * way, id(lengths): lengths * (1 + 0.3 * k)}
        changed = jax.tree.map(lambda x: change.get(id(x), x), system)
        return jnp.sum(nc.simulate(changed, T, state=state, method="rk4", throw=False).q[-1])

    h = 1e-5
    wanted = (end(h) - end(-h)) / (2 * h)
    # Programs of 5 s each: either start goes one way beside that of the host.
    other = jax.jvp(end, (0.0,), (1.0,))[1] if state is None else nc.jit(jax.grad(end))(0.0)
    for found in (jax.grad(end)(0.0), other):
        assert float(found) == pytest.approx(float(wanted), rel=1e-7 if state is None else 2e-2)


@functools.cache
def answering():
    """The swing's motion, what it answers, and how both ways pull that back: of any question, compiled once."""
    system = swing()
    flow = Flow.of(dynamics(extended(system)), system.degrees_of_freedom)
    t = jnp.asarray(0.1)

    @jax.jit
    def pulled(what, q, v, found, bar):
        _, solved = jax.vjp(lambda moved, q, v: moved.solve_stage(what, t, q, v), flow, q, v)
        _, recalled = jax.vjp(
            lambda moved, q, v: ReplayedFlow(flow.prepare(), moved).solve_stage(what, t, q, v, found), flow, q, v
        )
        return solved(bar), recalled(bar)

    return flow, jax.jit(lambda what, q, v: flow.solve_stage(what, t, q, v)), pulled


@pytest.mark.parametrize("what", [0, 1, 2], ids=["acceleration", "position", "velocity"])
def test_an_answer_is_pulled_back_by_its_lagrangian(what):
    """Against JAX's derivative of the solution itself, in a state that is off the constraints."""
    flow, answer, pulled = answering()
    draw = np.random.default_rng(3)
    home = np.asarray(flow.dyn.eq.home)
    q, v = home + 0.01 * draw.normal(size=len(home)), draw.normal(size=len(home))
    v[flow.view.fixed] = 0.0
    found = answer(what, q, v)
    bar = jax.tree.map(lambda x: np.asarray(draw.normal(size=x.shape)), found)
    bar.change[flow.view.fixed] = 0.0
    wanted, mine = pulled(what, q, v, found, bar)
    free = jnp.asarray(~np.array(flow.dyn.topology.fixed))  # the ground is at rest, whatever it would mean if it moved
    for a, b in ((wanted[1], mine[1]), (wanted[2] * free, mine[2] * free)):
        assert np.allclose(a, b, rtol=1e-9, atol=1e-9 * max(float(jnp.max(jnp.abs(a))), 1.0))
    # Of the numbers of the motion by what they change with the design: some coefficients are zero in every one.
    found = collect_derived(wanted[0]), collect_derived(mine[0]), DesignChanges(swing(), flow.dyn.eq).derived()
    for a, b, by in zip(*map(jax.tree.leaves, found), strict=True):
        first, second = (np.tensordot(x, by[..., 1:], x.ndim) for x in (a, b))
        assert np.allclose(first, second, rtol=1e-9, atol=1e-9 * max(np.abs(first).max(), 1.0))


def test_known_and_traced_derivatives_agree_with_differences():
    """The host's share of a gradient against JAX's, and both against differences of runs, in space."""
    system = swing()

    def far(system):
        run = nc.simulate(system, T, rates={"A.y": 0.4}, method="rk4", step=0.01, throw=False)
        return run["B"][-1, 1] + 0.1 * run.velocity("A")[2, 0]

    known = jax.grad(far)(system)
    traced = nc.jit(jax.grad(far))(system)
    for a, b in zip(jax.tree.leaves(known), jax.tree.leaves(traced), strict=True):
        assert np.allclose(a, b, rtol=1e-11, atol=1e-14)
    for name, index in (("plate.mass", ()), ("spring.stiffness", ()), ("A", (0,)), ("gravity.y", ())):
        value, step = np.asarray(system[name], float), 1e-4
        ends = []
        for sign in (1, -1):
            moved = value.copy()
            moved[index] += sign * step
            ends.append(float(far(system.replace({name: moved}))))
        assert float(np.asarray(known[name])[index]) == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-6), name


@pytest.mark.parametrize("method", ["dopri8", "rk4"])
def test_another_mechanism_of_the_structure_traces_nothing(method):
    """Names, numbers and title differ; the run and its gradient are traced once."""
    step: dict = {"step": 0.02} if method == "rk4" else {}

    def asked(names, *numbers):
        system = four_bar(names, *numbers)
        before = len(_WORK)
        run = nc.simulate(system, T, rates={f"phi{names[0]}": 1.0}, method=method, **step)
        middle = len(_WORK)

        def high(system):
            found = nc.simulate(system, T, rates={f"phi{names[0]}": 1.0}, method=method, **step)
            return jnp.sum(found.q[-1])

        slope = jax.grad(high)(system)
        return run, slope, middle - before, len(_WORK) - middle

    first, slope, *work = asked("ABCD")
    assert min(work) > 0
    same, again, *work = asked("PQRS", 0.5, 60.0, -9.81, "renamed")
    assert work == [0, 0]
    assert np.array_equal(same.q, first.q)
    assert np.array_equal(again.parameters.physical, slope.parameters.physical)
    other, _, *work = asked("KLMN", 0.8, 40.0, -3.0, "another")
    assert work == [0, 0]
    assert np.abs(np.asarray(other.q - first.q)).max() > 1e-3


@functools.cache
def double():
    m = nc.Mechanism("double pendulum")
    m.ground("A", (0, 0))
    m.point("B", (0.3, -0.2))
    m.point("C", (0.5, -0.5))
    m.body("one", ["A", "B"], mass=1.0)
    m.body("two", ["B", "C"], mass=0.5)
    m.angle("phi", at="A", to="B")
    m.gravity = (0, -9.81)
    return m.compile()


def test_what_an_input_closes_over_has_derivatives_in_both_directions():
    """The acceleration of an input moves all else; mapped, and forward as it is called.

    In reverse, compiled or not: with the next test.
    """
    start = float(np.arctan2(-0.2, 0.3))

    def far(rate):
        inputs = {"phi": lambda t: start + rate * t * t}
        return nc.simulate(double(), T, inputs=inputs, method="rk4", throw=False)["C"][-1, 0]

    step = 1e-4
    both = jax.jit(jax.vmap(jax.value_and_grad(far)))(jnp.array([0.7, 0.9, 0.7, 0.7 + step, 0.7 - step]))
    wanted = float(both[0][3] - both[0][4]) / (2 * step)
    assert np.allclose(both[0][:3:2], far(0.7), rtol=1e-9) and np.allclose(both[1][:3:2], wanted, rtol=1e-6)
    assert float(jax.jvp(far, (0.7,), (1.0,))[1]) == pytest.approx(wanted, rel=1e-6)
    assert np.isfinite(both[1]).all()


@pytest.mark.parametrize("step", [None, 0.03], ids=["one a time", "several"])
def test_steps_that_were_kept_are_gone_back_through_as_steps_made_again(step, monkeypatch):
    """By the design, by what an input closes over, and by times, which decide how long single steps are."""
    start = float(np.arctan2(-0.2, 0.3))

    def far(system, rate, t=T):
        inputs = {"phi": lambda t: start + rate * t * t}
        run = nc.simulate(system, t, inputs=inputs, method="rk4", step=step, throw=False)
        return run["C"][-1, 0] + 0.3 * run.velocity("C")[1, 1] + 1e-3 * run.multipliers[2, 0]

    kept, plain = [], runs.recall
    monkeypatch.setattr(runs, "recall", lambda *x: (kept.append(1), plain(*x))[1])
    given, gradients = (double(), 0.7, jnp.asarray(T))[: 2 if step else 3], []
    for most in (runs._KEPT, 0):
        monkeypatch.setattr(runs, "_KEPT", most)
        slope = jax.grad(far, argnums=tuple(range(len(given))))
        gradients += [slope(*given), *([nc.jit(slope)(*given)] if most and step is None else [])]
        assert bool(kept) == (most > 0)
        kept.clear()
    for other in gradients[1:]:
        for a, b in zip(jax.tree.leaves(gradients[0]), jax.tree.leaves(other), strict=True):
            assert np.allclose(a, b, rtol=1e-9, atol=1e-12)
    if step is None:
        run = nc.jit(lambda rate, t: far(double(), rate, t))  # one program for all differences
        ends = [run(0.7 + h, T) for h in (1e-4, -1e-4)]
        assert float(gradients[0][1]) == pytest.approx(float(ends[0] - ends[1]) / 2e-4, rel=1e-6)
        for k in range(len(T)):
            ends = [run(0.7, T + h * np.eye(len(T))[k]) for h in (1e-4, -1e-4)]
            assert float(gradients[0][2][k]) == pytest.approx(float(ends[0] - ends[1]) / 2e-4, rel=1e-6, abs=1e-7)


@pytest.mark.slow
def test_the_hosts_share_of_a_traced_gradient_is_mapped_and_a_lane_that_fails_passes_no_derivative_on(monkeypatch):
    """One design asks the host; several are JAX's. Second derivatives: kinematics/test_derivative_orders.py.

    A spring far too stiff for its step is data among others: its state overflows, its derivatives are zero. A weight
    on a spring compiles soonest; lanes that assemble a loop: dynamics/test_failed_lanes.py.
    """
    asked, plain = [], runs.pull_back_design
    monkeypatch.setattr(runs, "pull_back_design", lambda *given: (asked.append(1), plain(*given))[1])
    m = nc.Mechanism("weight")
    a, b = m.ground("A", (0, 0)), m.point("B", (1, 0))
    m.point_mass("mass", b, 1.0)
    m.spring("k", a, b, stiffness=50.0, free=0.8)
    m.gravity = (0.0, -9.81)
    system = m.compile()

    def run(stiffness, place):
        changed = system.replace({"k.stiffness": stiffness, "B": place})
        return nc.simulate(changed, T, method="rk4", step=0.02)

    def end(stiffness, place):
        found = run(stiffness, place)
        return jnp.sum(found["B"][-1]), found.status[-1]

    gradient = nc.jit(jax.grad(end, argnums=(0, 1), has_aux=True))  # traced once for what maps it too
    stiffness, places = np.array([50.0, 1e50, 70.0]), np.array([[1.0, 0.0], [1.0, 0.0], [1.1, -0.6]])
    each = [gradient(k, a) for k, a in zip(stiffness, places, strict=True)]
    assert len(asked) >= 2
    (slopes, by_place), statuses = nc.jit(jax.vmap(gradient))(stiffness, places)
    assert [int(s) != 0 for s in statuses] == [False, True, False]
    h = 1e-4
    for k in (0, 2):
        assert int(each[k][1]) == 0
        np.testing.assert_allclose(slopes[k], each[k][0][0], rtol=1e-11)
        np.testing.assert_allclose(by_place[k], each[k][0][1], rtol=1e-11, atol=1e-13)
        ends = [np.sum(run(stiffness[k] + s, places[k])["B"][-1]) for s in (h, -h)]
        np.testing.assert_allclose(slopes[k], (ends[0] - ends[1]) / (2.0 * h), rtol=1e-8)  # of the difference
    assert slopes[1] == 0.0 and np.isfinite(by_place[1]).all()


def test_the_reverse_derivative_of_a_mass_in_space_that_no_row_holds():
    """A swing through the foot of a spring of no length, ``sin(w t) / w``."""
    m = nc.Mechanism("mass", dim=3)
    m.ground("O", (0, 0, 0))
    m.point("P", (0, 0, 0))
    m.point_mass("block", "P", 2.0)
    m.spring("k", "O", "P", stiffness=200.0, free=0.0)

    def end(system):
        return nc.simulate(system, [0, 1], rates={"P.x": 1.0}, method="rk4", step=1e-3)["P"][-1, 0]

    found = jax.grad(end)(m.compile())["k.stiffness"]
    assert float(found) == pytest.approx((np.cos(10) / 10 - np.sin(10) / 100) * 10 / 400, rel=1e-6)
