"""What searches say: numbers with their units, counts that agree, and mistakes named before any work."""

import importlib
import signal
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc
from benchmarks.synthesis.published import ARC, four_bar
from jaxnc.synthesis.search import solve as search
from jaxnc.synthesis.search.refine import Refinement
from jaxnc.synthesis.search.solve import interruptible

S = nc.synthesis
TIMING = np.radians([30, 45, 60, 75, 90])
WEIGHTS = np.array([1e-4, 4e-4, 1e-4, 9e-4, 1e-4])
FEW: dict[str, Any] = {"starts": 60, "refine": 60, "iterations": 40, "keep": 2, "progress": False}


def path(**more):
    settings = {"timing": TIMING, "free": ["B", "C"], "weights": WEIGHTS} | more
    return S.PathGeneration(four_bar(), "P", ARC, **settings)


@pytest.fixture(scope="module")
def weighted():
    return S.solve(path(), **FEW)


# -- numbers and units -----------------------------------------------------------------------------------------------


def test_largest_and_rms_are_lengths_without_weights(weighted):
    best = weighted.designs[0]
    far = np.linalg.norm(np.asarray(nc.sweep(best.system, {"phi": TIMING})["P"]) - ARC, axis=1)
    np.testing.assert_allclose(best.largest, far.max(), rtol=1e-9)
    np.testing.assert_allclose(best.rms, np.sqrt(np.mean(far**2)), rtol=1e-9)
    np.testing.assert_allclose(best.error, WEIGHTS @ far**2, rtol=1e-9)
    words = str(weighted)
    assert f"best error {best.error:.6g} m^2 (weighted; largest {far.max():.3g} m, rms" in words
    assert all(head in words for head in ("error [m^2]", "largest [m]", "rms [m]"))
    # With the largest error made small, that one is with weights and a length.
    level = S.solve(path(minimax=True), **FEW)
    best = level.designs[0]
    far = np.linalg.norm(np.asarray(nc.sweep(best.system, {"phi": TIMING})["P"]) - ARC, axis=1)
    np.testing.assert_allclose(best.error, np.max(np.sqrt(WEIGHTS) * far), rtol=1e-9)
    np.testing.assert_allclose(best.largest, far.max(), rtol=1e-9)
    assert "error [m]  " in str(level)


def test_the_bar_shows_a_sum_of_squares_in_square_metres(capsys):
    S.solve(path(), **(FEW | {"starts": 4, "refine": 4, "iterations": 20, "progress": True}))
    assert "m^2" in capsys.readouterr().err


def test_an_interrupted_search_counts_once(monkeypatch):
    go, rounds = Refinement.go, []

    def interrupted(self, best):
        rounds.append(best)
        if len(rounds) == 2:
            raise KeyboardInterrupt
        go(self, best)

    monkeypatch.setattr(Refinement, "go", interrupted)
    part = S.solve(path(), **FEW)
    assert part.refined == part.history[-1].designs
    assert f"interrupted with {part.refined} of " in part.stopped and " on the way" in part.stopped
    assert f"60 designs screened, {part.refined} refined)" in str(part)


def test_targets_are_counted_from_one():
    bad = [*ARC[:2], (np.nan, 1.0), *ARC[3:]]
    with pytest.raises(nc.InputError, match="target point 3 is not finite"):
        S.PathGeneration(four_bar(), "P", bad)
    with pytest.raises(nc.InputError, match="timing: number 2 is not finite"):
        path(timing=[0.1, np.inf, 0.3, 0.4, 0.5])


# -- mistakes, named before any work -----------------------------------------------------------------------------------


def root(motion):
    return jnp.sqrt(motion["C"][:, 1] - 1e9)


def later(motion):
    """Finite for the idea only."""
    return jnp.where(jnp.abs(motion["B"][0, 0] - motion["A"][0, 0]) > 1.0, jnp.nan, 1.0)[None]


def nothing(motion):
    return None


def above(motion):
    return motion["P"][0, 1] > 0.0


def function(**more):
    settings = {"output": "psi", "values": np.linspace(0.5, 1.5, 5), "target": np.linspace(1.0, 1.3, 5)} | more
    return S.FunctionGeneration(four_bar(tracer=False), input="phi", **settings)


def guided(**more):
    settings = {"body": "coupler", "point": "P", "places": ARC[:3], "orientations": [0.0, 0.1, 0.2]} | more
    return S.MotionGeneration(four_bar(), **settings)


MISTAKES = {
    "negative weights": (lambda: path(weights=[1, 1, -1, 1, 1]), "weight 3 is -1; weights of squares are positive"),
    "zero weights": (lambda: path(weights=np.zeros(5)), "weight 1 is 0; .*leave out what is not to count"),
    "weights of a function": (lambda: function(weights=[1, 0, 1, 1, 1]), "FunctionGeneration: weight 2 is 0"),
    "weights of poses": (lambda: guided(weights=[1, -2, 1]), "MotionGeneration: weight 2 is -2"),
    "weights of objectives": (
        lambda: S.Objective(four_bar(), [root, root], np.linspace(0, 1, 4), weights=[1, -1]),
        "Objective: weight 2 is -1",
    ),
    "degrees": (
        lambda: path(timing=[30, 45, 60, 75, 90]),
        r"timing goes over 60 rad \(3438 degrees\), more than 1 turn: angles are in radians \(numpy.radians",
    ),
    "degrees of a function": (lambda: function(values=np.linspace(20, 90, 5)), "values go over 70 rad"),
    "degrees of an output": (lambda: function(target=np.linspace(20, 90, 5)), "target goes over 70 rad"),
    "degrees of poses": (lambda: guided(orientations=[0, 10, 20]), "orientations go over 20 rad"),
    "unsorted": (
        lambda: path(timing=[0.5, 0.8, 0.7, 1.2, 1.5]),
        r"timing must rise, or fall, .* number 3 \(0.7\) does not go on from number 2 \(0.8\); sort the targets",
    ),
    "twice the same": (lambda: path(timing=[0.5, 0.8, 0.8, 1.2, 1.5]), "number 3 .0.8. does not go on"),
    "output is input": (lambda: function(output="phi"), "output 'phi' is the input itself.*name another"),
    "offset of nothing": (lambda: path(timing=None, offset=True), "offset=True lets given timings .* give timing="),
    "no length": (
        lambda: path(bounds={"A-C": (0, 5)}),
        "length A-C: A and C are not on one body.*crank A-B, coupler B-C-P, rocker C-D, ground A-D",
    ),
    "no length in a condition": (
        lambda: path(subject_to=[S.equal(("A", "B"), ("A", "P"))]),
        "A-B = A-P: A and P are not on one body",
    ),
    "no size": (lambda: path(subject_to=[S.stock(("B", "D"), [1.0, 2.0])]), "B-D in stock: B and D are not on one"),
    "another body": (
        lambda: guided(body="crank"),
        "point 'P' is not on body 'crank', .*its points are A, B, and markers can be put on it",
    ),
    "no body": (lambda: guided(body="copler"), "has no body 'copler'; did you mean 'coupler'"),
    "closed": (
        lambda: S.PathGeneration(four_bar(), "P", [*ARC, ARC[0]], closed=True),
        r"target point 6 repeats the first one, .*leave it out: target\[:-1\]",
    ),
    "no number": (
        lambda: path(subject_to=[S.condition(root, name="clearance")]),
        "condition 'clearance' is not finite for the starting idea .5 of its 5 numbers, the first of them number 1",
    ),
    "nothing": (
        lambda: path(subject_to=[S.condition(nothing, name="clearance")]),
        "condition 'clearance' must return a number .* it returned None",
    ),
    "no residual": (
        lambda: S.Objective(four_bar(), nothing, np.linspace(0, 1, 4)),
        "Objective: residual nothing\\(\\) must return a number",
    ),
    "no list of conditions": (lambda: path(subject_to="crank turns"), "subject_to= takes a list of conditions"),
    "bounds by position": (lambda: path(bounds=[("A-B", 0, 5)]), "bounds= takes a dict such as"),
    "bounds of one axis more": (
        lambda: path(bounds={"B": ((0, 1), (0, 1), (0, 1))}),
        "bounds of 'B' are 3 pairs for 2 components that are free, B.x, B.y; give one pair for each",
    ),
    "bounds that are none": (lambda: path(bounds={"A-B": (np.nan, 1)}), "'A-B' must be numbers, or None for no bound"),
    "names that are none": (lambda: path(free=3), r"free= takes names, such as \['A', 'B.x'\], got 3"),
    "travel in degrees": (lambda: path(timing=None, travel=(0, 360)), r"goes over 360 rad \(.*\), more than 20 turns"),
    "no two points": (
        lambda: path(subject_to=[S.equal(("A", "B"), "C")]),
        "equal: 'C' must be the names of two points",
    ),
    "true or false": (
        lambda: path(subject_to=[S.condition(above, name="clearance")]),
        "condition 'clearance' returned true or false, .*return a number instead",
    ),
    "no function": (
        lambda: S.Objective(four_bar(), 3, np.linspace(0, 1, 4)),
        "residuals must be a function of a motion",
    ),
    "objectives without names": (lambda: S.pareto(path(), root), "others= takes functions of a motion by name"),
    "reach": (lambda: guided(reach=-1.0), "reach.*must be a positive number, got -1.0"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_in_a_problem_is_named(mistake):
    make, words = MISTAKES[mistake]
    with pytest.raises(nc.InputError, match=words):
        make()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"seconds": -1}, "seconds=-1.*positive.*None"),
        ({"seconds": np.nan}, "seconds=nan.*positive"),
        ({"enough": -1.0}, "enough=-1.0.*error"),
        ({"starts": 2e4}, "starts.*20000.0; write 20000"),
        ({"keep": 2.5}, "keep must be a whole number, got 2.5"),
        ({"refine": 0}, "refine must be at least 1, got 0"),
        ({"key": 3}, r"key=3.*key=jax.random.key\(3\)"),
        ({"key": "seed"}, r"key='seed' is no key of random numbers"),
    ],
)
def test_a_mistake_in_a_search_is_named(settings, words):
    with pytest.raises(nc.InputError, match=words):
        S.solve(path(), **settings)


def test_a_search_for_no_problem_is_refused():
    for call in (S.solve, S.pareto):
        with pytest.raises(nc.InputError, match=r"problem.*PathGeneration.*Mechanism"):
            call(four_bar())  # pyright: ignore[reportArgumentType]


def test_a_condition_that_is_finite_for_the_idea_only_is_named():
    problem = path(subject_to=[S.condition(later, name="clearance")], bounds={"B.x": (2, 3)})
    with pytest.raises(nc.InputError, match=r"\(clearance\).*not finite.*divisions"):
        S.solve(problem, **FEW)


def test_a_missed_condition_of_ones_own_is_told_in_its_own_numbers():
    low = S.condition(lambda m: -1.0 - m["P"][:, 1] ** 2, name="low")
    said = str(S.solve(path(subject_to=[low]), **FEW))
    assert "low by" in said and "in its function's numbers, which must not be negative" in said
    assert "of the size" not in said


def test_what_is_meant_is_taken():
    assert path(subject_to=S.crank_turns()).conditions[0].name == "crank turns"
    # A timing may fall, and go on over a whole turn.
    assert path(timing=np.unwrap([0.2, 6.2, 5.0, 4.0, 3.0])).targets == 5
    # Lengths to the middle of a bar, and between points of a parallelogram, do not change as it moves.
    m = four_bar()
    m.marker("M", on="crank", at=(0.25, 0.5))
    S.PathGeneration(m, "P", ARC, bounds={"B-C": (1, 9)}, subject_to=[S.length("A", "M", max=3)])


def test_two_poses_are_two_poses():
    problem = S.MotionGeneration(four_bar(), "coupler", "P", ARC[:2], [0.0, 0.1], timing=[0.4, 0.9], weights=[1, 2])
    assert problem.targets == 2 and problem.error_shape == (2, 3)
    found = S.solve(problem, **FEW).designs[0]
    assert found.errors.shape == (2, 3) and found.error < 1e-12


# -- interruptions ---------------------------------------------------------------------------------------------------


def interrupt(*_, **__):
    raise KeyboardInterrupt


@pytest.fixture
def heeded():
    """Interruptions are heeded, also where whoever started the tests ignores them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(
    ("where", "name", "words"),
    [
        ("search.solve", "screen", "before the first designs were refined"),
        ("search.refine", "Evaluator", "before the first designs were refined"),
        ("search.solve", "bring_to_ends", "while the best designs were brought to their ends"),
    ],
)
def test_an_interruption_returns_what_there_is(monkeypatch, where, name, words):
    problem = path()
    monkeypatch.setattr(importlib.import_module(f"jaxnc.synthesis.{where}"), name, interrupt)
    result = S.solve(problem, **FEW)
    assert f"the search was interrupted {words}" in str(result)
    if name == "bring_to_ends":
        monkeypatch.undo()
        assert len(result.designs) == 2 and np.isfinite(result.error)
        assert not result.designs[0].converged and result.designs[0].reason == "interrupted"
    else:
        assert "nothing was found yet" in result.verdict and not result.designs
        with pytest.raises(nc.InputError, match="nothing was found yet"):
            _ = result.best


@pytest.mark.usefixtures("heeded")
def test_an_interruption_that_jax_makes_another_error_of_is_one(monkeypatch):
    def raised(*_, **__):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ValueError("static arguments should be comparable using __eq__") from None

    problem, before = path(), signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(search, "screen", raised)
    assert S.solve(problem, **FEW).stopped.startswith("interrupted before")
    assert signal.getsignal(signal.SIGINT) is before
    monkeypatch.setattr(search, "screen", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        S.solve(problem, **FEW)


@pytest.mark.usefixtures("heeded")
def test_an_interruption_of_a_trace_leaves_nothing_open_in_caches():
    traces = []

    @jax.jit
    def traced(x):
        traces.append(x)
        if len(traces) == 2:
            signal.raise_signal(signal.SIGINT)
        return 2.0 * x

    assert traced(1.0) == traced(1.0) == 2.0 and len(traces) == 1
    with pytest.raises(KeyboardInterrupt), interruptible():
        traced(1)
    assert traced(1) == 2.0 and len(traces) == 3
    assert traced(1.0) == 2.0 and len(traces) == 4  # nothing kept is trusted
    with pytest.raises(KeyboardInterrupt), interruptible():
        signal.raise_signal(signal.SIGINT)
    assert traced(1.0) == 2.0 and len(traces) == 4  # nothing was traced: nothing is compiled anew


@pytest.mark.usefixtures("heeded")
@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="there are no such timers")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # JAX's hook of the garbage collector
@pytest.mark.parametrize("after", [0.1, 0.3, 0.6])
def test_an_interruption_of_a_compilation_ends_in_a_result(after):
    def own(motion):  # another one at each call: it has to be compiled
        return jnp.sin(motion["C"]).ravel() + 2.0

    problem = path(subject_to=[S.condition(own)])
    before = signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
    try:
        signal.setitimer(signal.ITIMER_REAL, after)
        result = S.solve(problem, **(FEW | {"iterations": 2000, "starts": 2000}))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert result.stopped.startswith("interrupted")
