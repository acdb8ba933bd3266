"""Optax optimisers on problems and on any function of a design: steps, bounds, ends, failures, keeping, mistakes."""

import itertools
import os
import signal

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

import jaxnc as nc
from jaxnc.synthesis.descent import MEETS, Optimiser

S = nc.synthesis


def four_bar():
    m = nc.Mechanism("four-bar")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    for name, place in {"B": (0.5, 1), "C": (3.3, 2.9), "P": (1.8, 3.2)}.items():
        m.point(name, place)
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C", "P"])
    m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B")
    return m.compile()


IDEA = four_bar()
GOAL = np.array([2.1, 3.4])
ADAM = optax.adam(2e-2)
PHI = np.linspace(0.5, 1.5, 4)


def near_goal(system):
    return jnp.sum((system["P"] - GOAL) ** 2)


def to_goal(system):
    """Quick to compile: where P is drawn."""
    return near_goal(system) + 0.1 * jnp.sum((system["C"] - IDEA["C"]) ** 2)


def noisy(system, key):
    return jnp.sum((system["P"] - GOAL - 0.1 * jax.random.normal(key, (2,))) ** 2)


PLAIN = S.Loss(IDEA, to_goal, free=["P", "C"])
RANDOM = S.Loss(IDEA, noisy, free=["P"])


@pytest.mark.parametrize(
    "optimiser", [optax.adam(optax.cosine_decay_schedule(0.1, 300)), optax.lbfgs()], ids=["adam", "lbfgs"]
)
def test_an_optimiser_finds_what_the_closed_form_says(optimiser):
    result = S.descend(PLAIN, optimiser, steps=300, starts=4, gradient=1e-9)
    np.testing.assert_allclose(result.best["P"], GOAL, atol=1e-6)
    np.testing.assert_allclose(result.best["C"], IDEA["C"], atol=1e-5)
    assert result.designs[0].error == pytest.approx(0.0, abs=1e-10)
    first = result.designs[0]
    if first.converged:
        assert first.optimality <= 1e-9 and first.iterations < 300
    assert result.steps.value.shape == (result.steps.count, 4) and (np.diff(result.steps.seconds) >= 0).all()


def test_the_first_steps_are_those_that_optax_takes():
    """In unknowns divided by their scales, without bounds: the same numbers as a loop written by hand."""
    scale = PLAIN.scale
    y, memory = jnp.asarray(PLAIN.start / scale), ADAM.init(jnp.asarray(PLAIN.start / scale))
    value = lambda y: to_goal(PLAIN.designed(y * scale))  # noqa: E731
    by_hand = []
    for _ in range(5):
        seen, slope = jax.value_and_grad(value)(y)
        by_hand.append((float(seen), float(jnp.linalg.norm(slope))))
        moves, memory = ADAM.update(slope, memory, y)
        y = optax.apply_updates(y, moves)
    steps = S.descend(PLAIN, ADAM, steps=5, starts=1).steps
    np.testing.assert_allclose(np.stack([steps.value[:, 0], steps.gradient[:, 0]], axis=1), by_hand, rtol=1e-12)


def test_designs_stay_in_their_boxes_and_lengths():
    """The nearest point to the goal in a disc round B, below a line; Lagrange's conditions in closed form.

    In the disc with rates for each unknown, which are not to turn a step along its edge.
    """
    B = np.asarray(IDEA["B"])
    problem = S.Loss(IDEA, near_goal, free=["P"], bounds={"B-P": (0.5, 2.0)})
    result = S.descend(problem, ADAM, steps=1000, starts=4, gradient=1e-10)
    way = GOAL - B
    np.testing.assert_allclose(result.best["P"], B + 2.0 * way / np.linalg.norm(way), atol=1e-8)
    assert result.designs[0].converged and not result.designs[0].defects
    low = S.Loss(IDEA, near_goal, free=["P"], bounds={"P.y": (None, 3.0)})
    found = S.descend(low, optax.sgd(0.01), steps=200, starts=2, gradient=1e-10).designs[0]
    np.testing.assert_allclose(found.system["P"], [GOAL[0], 3.0], atol=1e-8)
    assert found.converged and "the bound of P.y" in found.binding


@pytest.mark.slow
def test_other_conditions_are_met_by_the_augmented_lagrangian():
    problem = S.Loss(IDEA, near_goal, free=["P"], subject_to=[S.equal(("B", "P"), 2.0)])
    searching = optax.scale_by_backtracking_linesearch(max_backtracking_steps=15, store_grad=True)
    found = S.descend(problem, optax.chain(optax.sgd(1.0), searching), steps=1000, starts=2).designs[0]
    B = np.asarray(IDEA["B"])
    np.testing.assert_allclose(found.system["P"], B + 2.0 * (GOAL - B) / np.linalg.norm(GOAL - B), atol=1e-6)
    assert found.feasibility <= MEETS and "B-P = 2" in found.binding


def test_what_diverges_gives_back_the_best_it_had():
    found = S.descend(S.Loss(IDEA, near_goal, free=["P"]), optax.sgd(0.08), steps=60, starts=1)
    assert np.nanmax(found.steps.value) > 1e6 and found.error == np.nanmin(found.steps.value)


def test_what_cannot_be_used_is_taken_back():
    """Beyond x = 2 nothing is finite, beyond y = 3.2 the derivative is not: designs end there, as finite numbers."""

    def edge(system):
        x, y = system["P"]
        return jnp.where(x < 2.0, (x - 2.5) ** 2, jnp.nan) + (y - 3.4) ** 2 + 0.0 * jnp.sqrt(3.2 - y)

    problem = S.Loss(IDEA, edge, free=["P"])
    result = S.descend(problem, optax.adam(0.02), steps=400, starts=np.array([[1.0, 2.5], [1.5, 3.0], [2.2, 2.5]]))
    x = np.stack([d.x for d in result.designs])
    assert len(x) and (x[:, 0] < 2.0).all() and (x[:, 1] < 3.2).all()
    assert min(np.min(2.0 - x[:, 0]), np.min(3.2 - x[:, 1])) < 1e-6, "one of them is at an edge"
    assert not result.steps.good[0, 2] and np.isnan(result.steps.value[1:, 2]).all(), "it began where nothing is"
    assert np.isfinite(result.steps.value[:, :2][result.steps.good[:, :2]]).all()
    assert (result.steps.good[:, :2].sum(axis=0) > 10).all() and not result.steps.good[:, :2].all()
    descent = S.Descent(problem, optax.adam(0.02))
    lane = jax.jit(descent)(descent.begin(np.array([2.2, 2.5])))
    assert bool(lane.over) and int(lane.outcome) == 2 and float(jnp.abs(lane.slope).max()) == 0.0
    assert np.isfinite(lane.value) and np.isfinite(lane.merit)


def test_samples_need_a_key_and_designs_are_ranked_by_means():
    runs = [S.descend(RANDOM, ADAM, steps=150, starts=2, key=jax.random.key(k)) for k in (0, 0, 1)]
    a, b, c = (run.designs[0] for run in runs)
    assert a.error == b.error and np.array_equal(a.x, b.x) and not np.array_equal(a.x, c.x)
    np.testing.assert_allclose(a.system["P"], GOAL, atol=0.1)
    assert a.error == pytest.approx(2 * 0.1**2, rel=0.5) and a.reason == "150 steps" and runs[0].steps.random
    descent = S.Descent(RANDOM, ADAM)
    lane = descent.begin()
    leaves = jax.tree.leaves(lane)  # each its own, so that a compiled step may be given them for good
    assert len({id(x) for x in leaves}) == len(leaves) == len({x.unsafe_buffer_pointer() for x in leaves})
    with pytest.raises(nc.InputError, match=r"drawn anew at every step: give a key"):
        descent(lane)
    with pytest.raises(nc.InputError, match=r"random.*leave out the key"):
        S.Descent(PLAIN, ADAM)(S.Descent(PLAIN, ADAM).begin(), jax.random.key(0))
    with pytest.raises(nc.InputError, match="a system and a key: give one"):
        RANDOM.value(IDEA)
    with pytest.raises(nc.InputError, match="takes no key"):
        PLAIN.value(IDEA, jax.random.key(0))


def test_a_loop_of_ones_own():
    descent = S.Descent(RANDOM, ADAM)
    starts = jnp.stack([descent.problem.start, descent.problem.start - 2.0])
    keys = jax.random.split(jax.random.key(3), 60)

    @jax.jit
    def trained(x):
        return jax.lax.scan(lambda lane, key: (descent(lane, key), lane.value), descent.begin(x), keys)

    lanes, values = jax.vmap(trained)(starts)
    assert values.shape == (2, 60) and values[1, -20:].mean() < 0.05 * values[1, 1]
    places = jax.vmap(lambda lane: descent.design(lane)["P"])(lanes)
    np.testing.assert_allclose(places, np.broadcast_to(GOAL, (2, 2)), atol=0.3)
    np.testing.assert_allclose(jax.vmap(descent.unknowns)(lanes), places, atol=1e-12)


@pytest.fixture
def interrupts():
    """Interruptions come through: workers of the test runner ignore them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_ends(monkeypatch, interrupts):
    short = S.descend(PLAIN, optax.sgd(1e-9), steps=60, starts=2, patience=10)
    assert short.designs[0].reason == "no progress in 10 steps" and short.steps.count == 20
    enough = S.descend(PLAIN, ADAM, steps=500, starts=2, enough=1e-2)
    assert enough.error <= 1e-2 and enough.steps.count < 500 and "stopped at enough=0.01 after" in str(enough)
    brief = S.descend(PLAIN, ADAM, steps=10**6, starts=2, seconds=0.3, gradient=0.0)
    assert brief.stopped.startswith("stopped after ") and brief.designs[0].reason == "stopped"
    from jaxnc.synthesis.descent import DescentLanes

    taken, count = DescentLanes._take_steps, itertools.count()

    def interrupted(self, first, steps):
        if next(count) == 1:
            os.kill(os.getpid(), signal.SIGINT)
        return taken(self, first, steps)

    monkeypatch.setattr(DescentLanes, "_take_steps", interrupted)
    found = S.descend(PLAIN, ADAM, steps=10**6, starts=2, gradient=0.0)
    assert found.stopped.startswith("interrupted after") and found.designs[0].reason == "interrupted"


@pytest.mark.parametrize("problem", [PLAIN, RANDOM], ids=["plain", "random"])
def test_resumed_is_as_if_it_had_never_stopped(problem, tmp_path):
    optimiser = optax.chain(optax.add_noise(0.01, 0.5, jax.random.key(5)), ADAM)
    settings = {"starts": 3, "gradient": 0.0, "key": jax.random.key(2)}
    whole = S.descend(problem, optimiser, steps=80, **settings)
    S.descend(problem, optimiser, steps=33, **settings, checkpoint=tmp_path / "d.npz")
    rest = S.descend(problem, optimiser, steps=80, **settings, resume=tmp_path / "d.npz")
    np.testing.assert_array_equal(rest.steps.value, whole.steps.value)
    np.testing.assert_array_equal(rest.designs[0].x, whole.designs[0].x)
    with pytest.raises(nc.InputError, match="was begun with optimiser ="):
        S.descend(problem, optax.sgd(1e-2), steps=80, **settings, resume=tmp_path / "d.npz")


def test_results_are_drawn_kept_and_read_back(tmp_path):
    result = S.descend(PLAIN, ADAM, steps=40, starts=3)
    assert "best error" in str(result) and "40 steps" in result.table()
    result.save(tmp_path / "found")
    again = S.load(tmp_path / "found", PLAIN)
    assert [d.error for d in again.designs] == [d.error for d in result.designs] and again.table() == result.table()
    np.testing.assert_array_equal(again.steps.value, result.steps.value)
    figure = result.convergence(tmp_path / "steps.png")
    above, below = figure.axes
    assert (tmp_path / "steps.png").stat().st_size > 5000 and above.get_yscale() == below.get_yscale() == "log"
    thick = above.lines[-1].get_ydata()
    np.testing.assert_allclose(thick, np.minimum.accumulate(result.steps.value.min(axis=1)))
    assert "3 designs, 40 steps" in above.get_title(loc="left")


def test_equal_optimisers_are_compiled_once():
    make = (lambda: optax.adam(1e-2), optax.lbfgs, lambda: optax.inject_hyperparams(optax.adam)(learning_rate=1e-2))
    for one in make:
        assert Optimiser("t", one()) == Optimiser("t", one()) and hash(Optimiser("t", one())) == hash(
            Optimiser("t", one())
        )
    assert Optimiser("t", optax.adam(1e-2)) != Optimiser("t", optax.adam(1e-3))
    rate = [1e-2]
    own = [optax.adam(lambda step: rate[0]) for _ in range(2)]  # a function of one's own may look at anything
    assert Optimiser("t", own[0]) != Optimiser("t", own[1])
    fading = optax.adam(optax.cosine_decay_schedule(3e-2, 100))  # which changes itself when it is first asked
    S.descend(PLAIN, fading, steps=3, starts=3)
    events = []
    jax.monitoring.register_event_duration_secs_listener(lambda event, _, **__: events.append(event))
    other = S.Loss(IDEA, to_goal, free=["P", "C"], bounds={"P.x": (0, 5)})
    S.descend(other, fading, steps=4, starts=3, key=jax.random.key(9))
    S.descend(other, optax.adam(optax.cosine_decay_schedule(3e-2, 100)), steps=5, starts=3)
    assert not [e for e in events if "backend_compile" in e]


@pytest.mark.slow
def test_a_path_by_all_targets_and_by_batches():
    """A known four-bar's path, from a drawing beside it: all targets, and 24 of the 60 at a time."""
    t = np.linspace(0.0, 2 * np.pi, 60, endpoint=False)
    motion = nc.sweep(IDEA, {"phi": t})
    beside = IDEA.replace(P=(1.9, 3.12), C=(3.35, 2.95))
    problem = S.PathGeneration(beside, "P", motion["P"], timing=t, free=["P", "C"], bounds={"P.x": (0.5, 5.0)})
    idea = np.tile(problem.start, (2, 1))
    whole = S.descend(problem, optax.adam(optax.cosine_decay_schedule(1e-2, 400)), steps=400, starts=idea)
    assert whole.found and whole.designs[0].rms < 1e-4
    np.testing.assert_allclose(whole.best["C"], IDEA["C"], atol=1e-2)
    some = S.descend(problem, optax.adam(optax.cosine_decay_schedule(1e-2, 400)), steps=400, starts=idea, batch=24)
    assert some.found and some.designs[0].rms < 1e-3 and some.steps.random
    assert some.steps.good.all(), "steps between targets of a batch are uneven, and none of them is lost"
    first = some.steps.value[0, 0], problem.reported_error(problem.cost(problem.start)[0])
    assert first[0] != pytest.approx(first[1]) and first[0] == pytest.approx(first[1], rel=0.9)


def with_two(system):
    return system["P"]


def nothing_finite(system):
    return jnp.log(-1.0 - jnp.sum(system["P"] ** 2))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (lambda: S.descend(PLAIN, optax.adam), r"adam: call it, optax\.adam\(1e-2\)"),
        (lambda: S.descend(PLAIN, 1e-2), r"got float, such as optax\.adam"),
        (lambda: S.descend(to_goal, ADAM), r"'to_goal'.*Loss\(mechanism, function\)"),
        (lambda: S.descend(IDEA, ADAM), "takes a problem"),
        (lambda: S.solve(PLAIN), r"Loss.*nc\.synthesis\.descend"),
        (
            lambda: S.descend(S.Loss(IDEA, with_two, free=["P"]), ADAM, starts=1),
            r"array of shape \(2,\): take its mean",
        ),
        (lambda: S.descend(S.Loss(IDEA, str, free=["P"]), ADAM, starts=1), "must return one number; it returned"),
        (
            lambda: S.descend(S.Loss(IDEA, nothing_finite, free=["P"]), ADAM, starts=2),
            "value of all 2 starts.*not finite",
        ),
        (lambda: S.Loss(IDEA, lambda a, b, c: a), "asks for a, b, c"),
        (lambda: S.Loss(IDEA, 3.0), "function must be a function of a system"),
        (lambda: S.Loss(IDEA, to_goal, bounds={"Q.x": (0, 1)}), "'Q.x'.*no design variable"),
        (lambda: S.Loss(IDEA, to_goal, bounds={"P.x": (0, 1)}, free=["C"]), "'P.x', which is not free"),
        (lambda: S.descend(PLAIN, ADAM, batch=3), r"batch=3.*function\(system, key\)"),
        (lambda: S.descend(PLAIN, ADAM, steps=2.0), "steps.*whole number.*2.0; write 2"),
        (lambda: S.descend(PLAIN, ADAM, patience=0), "patience must be at least 1, got 0"),
        (lambda: S.descend(PLAIN, ADAM, gradient=-1), "gradient=-1.*norm"),
        (lambda: S.descend(PLAIN, ADAM, enough="1"), "enough='1'.*error"),
        (lambda: S.descend(PLAIN, ADAM, seconds=-1), "seconds=-1; it must be a positive number"),
        (lambda: S.descend(PLAIN, ADAM, key=3), r"write key=jax.random.key\(3\)"),
        (lambda: S.descend(PLAIN, ADAM, starts=[[1.0, 2.0]]), r"\(lanes, 4\), each C.x.*\(1, 2\)"),
        (lambda: S.Descent(PLAIN, ADAM).begin([1.0]), r"has 4 unknowns, C\.x.*got shape \(1,\)"),
        (
            lambda: jax.jit(lambda x: S.descend(PLAIN, ADAM, starts=x).error)(jnp.ones((1, 4))),
            r"needs numbers.*nc\.synthesis\.Descent",
        ),
    ],
)
def test_mistakes_are_named(given, said):
    with pytest.raises(nc.InputError, match=said):
        given()


@pytest.mark.slow
def test_a_line_search_over_sweeps_that_ask_the_host():
    """JAX maps what a loop holds: the drawing's own loop inside of it broke with a bare assertion."""
    system = nc.library.four_bar(coupler_point=(0.06, 0.05)).compile()

    def wave(design):
        return 1e4 * jnp.var(nc.sweep(design, {"phi": PHI})["P"][:, 1])

    loss = S.Loss(system, wave, free=["coupler.B-C", "rocker.C-D"])
    searching = optax.scale_by_backtracking_linesearch(max_backtracking_steps=15, store_grad=True)
    result = S.descend(loss, optax.chain(optax.sgd(0.02), searching), steps=12, starts=2)
    assert (np.diff(result.steps.value, axis=0) < 0.0).all()
    assert result.error < 0.2 * float(wave(system)) and nc.sweep(result.best, {"phi": PHI}).converged.all()
