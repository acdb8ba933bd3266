"""The motion as a vector field for integrators of others, beside `simulate`."""

import functools

import jax
import jax.numpy as jnp
import mechanisms
import numpy as np
import pytest

import jaxnc as nc

diffrax = pytest.importorskip("diffrax")
optimistix = pytest.importorskip("optimistix")

T = np.linspace(0.0, 1.0, 11)
SAME = 1e-8  # of lengths and radians: two integrators, each told 1e-10
AT, SPIN = {"phi": -0.4}, {"phi": 1.5}


@functools.cache
def pendulum():
    return mechanisms.pendulum().compile()


def run(field, y0, t=T, solver=None, tolerance=1e-10, args=None, **options):
    return diffrax.diffeqsolve(
        diffrax.ODETerm(field), diffrax.Dopri8() if solver is None else solver, t[0], t[-1], 0.01, y0, args=args,
        saveat=diffrax.SaveAt(ts=t), stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
        **options,
    )  # fmt: skip


def run_evenly(field, y0, args=None, **options):
    """By many equal steps without stages, which take half as long to compile: what comes out is of one second."""
    solver = diffrax.LeapfrogMidpoint()
    return diffrax.diffeqsolve(
        diffrax.ODETerm(field), solver, 0.0, 1.0, 2e-4, y0, args=args, max_steps=5_010, **options
    )


def run_by_hand(field, y0, t):
    """Runge and Kutta's method, the field written down once: compiled in a third of the time of a run by diffrax."""
    between, n = 100, len(t) - 1
    h, ahead = (t[-1] - t[0]) / (n * between), np.array([0.0, 0.5, 0.5, 1.0])

    def stage(carried, coefficients):
        y0, slope, total, at = carried
        a, w = coefficients
        slope = field(at + a * h, jax.tree.map(lambda x, k: x + a * h * k, y0, slope))
        return (y0, slope, jax.tree.map(lambda x, k: x + w * h / 6.0 * k, total, slope), at), None

    def step(y, at):
        return jax.lax.scan(stage, (y, y, y, at), (ahead, np.array([1.0, 2.0, 2.0, 1.0])))[0][2], None

    def interval(y, at):
        y, _ = jax.lax.scan(step, y, at)
        return y, y

    _, later = jax.lax.scan(interval, y0, t[0] + h * np.arange(n * between).reshape(n, between))
    return jax.tree.map(lambda x, rest: jnp.concatenate([x[None], rest]), y0, later)


def both(system, state, rates, t=T, inputs=None, how=run_by_hand):
    """The motion by another integrator, and that of `simulate`."""
    field = nc.dynamics.vector_field(system, inputs)
    theirs = field.motion(t, nc.jit(lambda field, y0: how(field, y0, t))(field, field.start(state, rates)))
    ours = nc.simulate(system, t, state, rates, inputs=inputs, rtol=1e-11, atol=1e-12)
    return theirs, ours


def agree(theirs, ours, tolerance=SAME):
    assert int(jnp.sum(theirs.status)) == 0
    size = max(1.0, float(jnp.abs(ours.q).max()))
    np.testing.assert_allclose(theirs.q, ours.q, rtol=0, atol=tolerance * size)
    for a, b in zip(theirs.rates, ours.rates, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=20 * tolerance * max(1.0, float(jnp.abs(b).max())))


def test_a_pendulum_moves_as_simulate_moves_it():
    theirs, ours = both(pendulum(), AT, SPIN, how=lambda *given: run(*given).ys)
    agree(theirs, ours)
    assert float(theirs.violation[0]) < 1e-8 and float(theirs.drift) < 1e-7
    np.testing.assert_allclose(theirs.multipliers, ours.multipliers, atol=1e-5)
    force = nc.reactions(theirs).at("A", on="rod").force
    np.testing.assert_allclose(force, nc.reactions(ours).at("A", on="rod").force, atol=1e-5)
    assert "constraints           met to" in theirs.report() and "steps" not in theirs.report()


def four_bar():
    m = nc.Mechanism("four-bar")
    A, D = m.ground("A", (0, 0)), m.ground("D", (4, 0))
    B, C = m.point("B", (0.6, 0.8)), m.point("C", (3.3, 2.9))
    m.body("crank", [A, B], mass=1.0)
    m.body("coupler", [B, C], mass=2.0)
    m.body("rocker", [C, D], mass=1.0)
    m.angle("phi", at=A, to=B)
    m.gravity = (0, -9.81)
    return m


def rubbing():
    m = four_bar()
    m.friction("rub", bodies=("rocker", "ground"), at="D", coefficient=0.3, radius=0.05)
    return m


def box():
    """A body of two points and a vector that spins freely, whose dynamics has a hidden vector."""
    m = nc.Mechanism("box", dim=3)
    m.point("P", (0, 0, 0))
    m.point("Q", (1, 0.2, 0))
    m.vector("v", (0, 0.3, 1))
    m.body("body", ["P", "Q"], vectors=["v"], mass=2.0, shape="box", size=(1.0, 0.1, 0.3))
    m.gravity = (0.3, -0.2, -9.81)
    return m


@pytest.mark.slow
def test_inputs_follow_their_functions():
    system = four_bar().compile()
    theirs, ours = both(system, None, None, inputs={"phi": lambda t: 0.9272952180016122 + 2.0 * t * t})
    agree(theirs, ours)
    assert theirs.driven == ("phi",)
    np.testing.assert_allclose(nc.reactions(theirs).effort("phi"), nc.reactions(ours).effort("phi"), rtol=1e-6)


@pytest.mark.slow
def test_adjoints_give_the_derivatives_of_simulate():
    """By the design and by the start, backwards in time; through checkpoints see below."""
    system = pendulum()

    def end(system, angle):
        field = nc.dynamics.vector_field(system)
        y0, adjoint = field.start({"phi": angle}, SPIN), diffrax.BacksolveAdjoint()
        found = run_evenly(field, y0, adjoint=adjoint)
        return field.state(1.0, jax.tree.map(lambda x: x[-1], found.ys))["phi"]

    def ours(points, physical, angle):
        changed = {id(system.parameters.points): points, id(system.parameters.physical): physical}
        changed = jax.tree.map(lambda x: changed.get(id(x), x), system)
        return nc.simulate(changed, T[[0, -1]], {"phi": angle}, SPIN, rtol=1e-11, atol=1e-12)["phi"][-1]

    design, angle = nc.jit(jax.grad(end, argnums=(0, 1)))(system, -0.4)
    found = design.parameters.points, design.parameters.physical, angle
    given = [np.asarray(x) for x in (system.parameters.points, system.parameters.physical, -0.4)]
    for k, (slopes, x) in enumerate(zip(found, given, strict=True)):
        for index in np.ndindex(x.shape):
            ends = []
            for h in (1e-4, -1e-4):
                moved = [y.copy() for y in given]
                moved[k][index] += h
                ends.append(float(ours(*moved)))
            near = {"abs": 2e-5, "rel": 0.0} if x.shape else {"rel": 1e-5, "abs": 0.0}
            assert float(slopes[index]) == pytest.approx((ends[0] - ends[1]) / 2e-4, **near)


@pytest.mark.slow
def test_adjoints_go_through_checkpoints_by_a_design_in_args_and_what_inputs_close_over():
    system = pendulum()
    along, across = np.array([np.cos(-0.4), np.sin(-0.4)]), np.array([-np.sin(-0.4), np.cos(-0.4)])

    def end(system, speed):
        field = nc.dynamics.vector_field(pendulum(), {"phi": lambda t: -0.4 + speed * t})
        pin, tip = system.parameters.points
        size = jnp.linalg.norm(tip - pin)
        begun = (  # plain numbers: a start of a driven motion is asked for below
            jnp.concatenate([pin, pin + size * along, jnp.full(1, -0.4)]),
            jnp.concatenate([jnp.zeros(2), speed * size * across, speed[None]]),
        )
        q, _ = run_evenly(field, begun, args=system).ys
        return field.state(1.0, (q[-1], q[-1]))["B"][0]

    design, speed = nc.jit(jax.grad(end, argnums=(0, 1)))(system, jnp.array(0.5))
    assert float(speed) == pytest.approx(-np.sin(0.1), abs=1e-5)
    along = np.cos(0.1) * np.array([0.6, -0.8])  # the rod is as long as it is drawn
    places = dict(zip(system.topology.points, np.asarray(design.parameters.points), strict=True))
    np.testing.assert_allclose(places["B"], along, atol=1e-5)
    np.testing.assert_allclose(places["A"], np.array([1.0, 0.0]) - along, atol=1e-5)


def test_a_driven_motion_begins_where_its_inputs_say_in_traced_code_too():
    """Half a radian from the drawing: too far for a few of Newton's steps."""
    system = pendulum()
    start = np.array([np.cos(-0.4), np.sin(-0.4)])

    def first(angle):
        inputs = {"phi": lambda t: angle + t}
        run = nc.simulate(system, T[:2], inputs=inputs, method="rk4")
        return jnp.stack([run["B"][0], nc.dynamics.vector_field(system, inputs).start()[0][2:4]])

    found, change = jax.jit(lambda angle: jax.jvp(first, (angle,), (1.0,)))(-0.4)
    np.testing.assert_allclose(found, [start, start], atol=1e-12)
    np.testing.assert_allclose(change, [[-start[1], start[0]]] * 2, atol=1e-9)


def test_an_event_ends_the_motion_where_the_state_says():
    field = nc.dynamics.vector_field(pendulum())
    event = diffrax.Event(
        lambda t, y, args, **_: field.state(t, y)["phi"] + np.pi / 2,
        optimistix.Newton(rtol=1e-10, atol=1e-10),
    )
    found = run_to(field, field.start(AT), event)
    ours = nc.simulate(pendulum(), np.array([0.0, 10.0]), AT, event=lambda t, state: state["phi"] + np.pi / 2)
    assert float(found.ts[-1]) == pytest.approx(float(ours.end), abs=1e-7)
    assert float(field.state(0.0, jax.tree.map(lambda x: x[-1], found.ys))["phi"]) == pytest.approx(
        -np.pi / 2, abs=1e-8
    )


def run_to(field, y0, event):
    return nc.jit(
        lambda y0: diffrax.diffeqsolve(
            diffrax.ODETerm(field), diffrax.Dopri8(), 0.0, 10.0, 0.01, y0,
            stepsize_controller=diffrax.PIDController(rtol=1e-10, atol=1e-10), event=event,
        )
    )(y0)  # fmt: skip


def test_noise_shakes_the_pendulum_along_its_constraints():
    """A torque of white noise: the angle's rate then spreads as the square root of time says."""
    import lineax as lx

    field, still = nc.dynamics.vector_field(no_gravity()), jax.ShapeDtypeStruct((), float)

    def shaken(t, y, args):
        return lx.FunctionLinearOperator(lambda w: field.response(t, y, {"phi": 0.2 * w}), still)

    y0 = field.start({"phi": 0.3})

    def once(key):
        path = diffrax.UnsafeBrownianPath((), key)  # docs/stack.md has the tree, which compiles longer
        terms = diffrax.MultiTerm(diffrax.ODETerm(field), diffrax.ControlTerm(shaken, path))
        adjoint = diffrax.ForwardMode()
        return diffrax.diffeqsolve(terms, diffrax.Heun(), 0.0, 1.0, 0.01, y0, adjoint=adjoint).ys

    q, v = nc.jit(jax.vmap(once))(jax.random.split(jax.random.key(0), 200))
    q, v = q[:, -1], v[:, -1]
    motion = field.motion(np.arange(200.0), (q, v))
    assert int(jnp.sum(motion.status)) == 0 and float(motion.violation[0]) < 1e-3
    _, push = nc.jit(lambda y0: field.response(0.0, y0, {"phi": 1.0}))(y0)
    inertia = 1.0 / float(push[no_gravity().topology.position["phi"]])
    spread = float(jnp.std(motion.velocity("phi")))
    assert spread == pytest.approx(0.2 / inertia, rel=0.2)  # of 200 samples: one in twenty is off by 0.1


@functools.cache
def no_gravity():
    m = mechanisms.pendulum()
    m.gravity = (0, 0)
    return m.compile()


def test_an_implicit_solver_and_vmap_over_designs():
    designs = jax.vmap(lambda a: jax.tree.map(lambda leaf: a * leaf, pendulum()))(jnp.array([1.0, 1.3]))

    def end(system, step):
        field = nc.dynamics.vector_field(system)
        term, y0 = diffrax.ODETerm(field), field.start(rates=SPIN)
        solver = diffrax.ImplicitEuler(root_finder=optimistix.Newton(rtol=1e-9, atol=1e-9))
        ys = diffrax.diffeqsolve(term, solver, 0.0, 0.5, step, y0, adjoint=diffrax.ForwardMode()).ys
        return field.state(0.5, jax.tree.map(lambda x: x[-1], ys))["phi"]

    # A method of one stage compiles three times as fast; its error's powers of the step are taken out afterwards.
    every = nc.jit(jax.vmap(end, (0, None)))
    found = np.stack([every(designs, 0.5 / 2.0**k) for k in range(5, 10)], axis=1)
    for order in range(1, 5):
        found = (2.0**order * found[:, 1:] - found[:, :-1]) / (2.0**order - 1.0)
    for k, angle in enumerate(found[:, 0]):
        system = jax.tree.map(lambda x, k=k: x[k], designs)
        ours = nc.simulate(system, T, rates=SPIN)["phi"][5]
        assert float(angle) == pytest.approx(float(ours), abs=1e-5)


def test_a_state_that_is_off_returns_to_its_constraints():
    field = nc.dynamics.vector_field(pendulum(), stabilise=8.0)
    q, v = field.start(AT, SPIN)
    off = q.at[2:].add(jnp.array([1e-4, -2e-4, 1e-4])), v
    go = nc.jit(lambda y0: run(field, y0, T, tolerance=1e-8).ys)  # one program for both
    motion = field.motion(T, go(off))
    gap = np.asarray(motion.residual)
    assert gap[0] > 5e-5 and gap[-1] < gap[0] * np.exp(-7.0) and int(jnp.sum(motion.status)) == 0
    # From far away the state is drawn to the constraints too; the motion says that it does not begin on them.
    off = q.at[2].add(0.1), v
    motion = field.motion(T, go(off))
    assert int(motion.status[0]) == nc.Status.CAME_APART and np.isnan(run_apart(field, q, v).residual[-1])


def run_apart(field, q, v):
    whole = (jnp.stack([q, q * jnp.nan]), jnp.stack([v, v]))
    motion = field.motion(T[:2], whole)
    assert motion.status.tolist() == [0, int(nc.Status.CAME_APART)]
    return motion


def test_the_start_is_that_of_simulate():
    system = pendulum()
    field = nc.dynamics.vector_field(system)
    for state, rates in ((None, None), (AT, SPIN), ({"B": (0.5, -0.9)}, {"B": (0.9, 0.5)})):
        ours = nc.simulate(system, T[:2], state, rates)
        q, v = field.start(state, rates)
        np.testing.assert_allclose(q, ours.q[0], atol=1e-12)
        np.testing.assert_allclose(v, ours.rates[0][0], atol=1e-12)
    again = field.start(ours.pose(-1))
    np.testing.assert_allclose(again[0], ours.q[-1], atol=1e-10)
    np.testing.assert_allclose(again[1], ours.rates[0][-1], atol=1e-10)
    np.testing.assert_allclose(field.start({"phi": 30.0}, {"phi": 90.0}, unit="deg")[1][-1], np.pi / 2)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (
            lambda f, q, v: f(0.0, (q.at[2].add(0.3), v), None),
            r"state.*constraints.*off by.*start\(",
        ),
        (
            lambda f, q, v: f(0.0, (q, v.at[2].add(1.0)), None),
            r"rates of the state.*start\(",
        ),
        (lambda f, q, v: f(0.0, (q.at[2].set(jnp.nan), v), None), "q of a state.*'pendulum'.*NaN"),
        (lambda f, q, v: f(0.0, q, None), r"pair \(q, v\).*got an array"),
        (lambda f, q, v: f(0.0, (q, v[1:]), None), r"v of a state.*\(5,\).*\(4,\)"),
        (lambda f, q, v: f(0.0, (q, v), four_bar().compile()), "args.*another topology.*'four-bar'"),
        (lambda f, q, v: f.response(0.0, (q, v), {"psi": 1.0}), "'psi'.*did you mean 'phi'"),
        (lambda f, q, v: f.response(0.0, (q, v), {"B": 1.0}), r"effort on 'B' must have the shape \(2,\)"),
        (lambda f, q, v: f.motion(T, (q, v)), r"q of a state.*\(11, 5\).*\(5,\)"),
        (lambda f, q, v: f.start({"psi": 1.0}), "no point or coordinate 'psi'"),
        (lambda f, q, v: nc.dynamics.vector_field(f.system, {"psi": jnp.sin}), "no coordinate 'psi' to drive"),
        (lambda f, q, v: nc.dynamics.vector_field(f.system, {"phi": 1.0}), "input 'phi' must be a function of time"),
        (lambda f, q, v: nc.dynamics.vector_field(f.system, stabilise=-1.0), "stabilise= must be a number from 0"),
        (lambda f, q, v: nc.dynamics.vector_field(nc.library.four_bar().compile()), "nothing in it has a mass"),
        (lambda f, q, v: nc.dynamics.vector_field(mechanisms.pendulum()), "compile"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(call, said):
    field = nc.dynamics.vector_field(pendulum())
    with pytest.raises(nc.JaxncError, match=said) as error:
        call(field, *field.start(AT, SPIN))
    assert "\n" not in str(error.value)


@pytest.mark.slow
@pytest.mark.parametrize("make", [rubbing, box])
def test_friction_and_hidden_vectors(make):
    system = make().compile()
    state, rates = ({"phi": 1.0}, {"phi": 3.0}) if make is rubbing else (None, {"Q": (0.0, 0.5, 1.0)})
    field = nc.dynamics.vector_field(system)
    y0 = field.start(state, rates)
    ours = nc.simulate(system, T[:2], state, rates)
    _, a = field(0.0, y0, None)
    assert (system.topology.extended is not None) == (make is box)
    np.testing.assert_allclose(y0[1], ours.rates[0][0], atol=1e-10)
    np.testing.assert_allclose(a, ours.rates[1][0], atol=1e-8 * max(1.0, float(jnp.abs(a).max())))


@pytest.mark.slow
def test_rows_on_velocities_are_kept():
    """Chaplygin's sleigh, whose blade does not slip sideways."""
    m = nc.Mechanism("sleigh")
    m.point("P", (0, 0))
    m.point("Q", (1, 0))
    m.body("sled", ["P", "Q"], mass=2.0, com=(0.3, 0), inertia=0.5)
    m.skate("blade", "P", ("P", "Q"))
    m.angle("phi", at="P", to="Q")
    theirs, ours = both(m.compile(), None, {"P": (0.7, 0.0), "phi": 1.2})
    agree(theirs, ours)
    d, v = np.asarray(theirs["Q"] - theirs["P"]), np.asarray(theirs.velocity("P"))
    assert np.abs(d[:, 0] * v[:, 1] - d[:, 1] * v[:, 0]).max() < 1e-8
