"""Synthesis: published cases, conditions against closed forms, the solver against known optima, bad input."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import PROBLEMS

import jaxnc as nc
from benchmarks.synthesis.published import ARC, SIX, four_bar, lengths
from jaxnc.synthesis.conditions import Seen
from jaxnc.synthesis.evaluate import Evaluator
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.search.goal import Goal
from jaxnc.synthesis.search.planar import find_linear
from jaxnc.synthesis.search.refine import Refinement, advance, waiting

S = nc.synthesis
QUIET = {"progress": False}


def loop(system):
    p = {n: np.asarray(system[n]) for n in "ABCD"}
    return [float(np.linalg.norm(p[i] - p[j])) for i, j in ("AD", "AB", "BC", "CD")]


def independent(system, angles):
    """The coupler point by circles, from the lengths that are read off the drawing."""
    A, B, C, D, P = (np.asarray(system[n]) @ [1, 1j] for n in "ABCDP")
    a, b, c = abs(B - A), abs(C - B), abs(C - D)
    side = np.sign(((C - B) * np.conj(D - B)).imag)
    k = (P - B) / (C - B)
    pin = A + a * np.exp(1j * angles) * (D - A) / abs(D - A)
    d = D - pin
    along = (b * b - c * c + abs(d) ** 2) / (2 * abs(d))
    C = pin + (along + 1j * side * np.sqrt(b * b - along**2)) * d / abs(d)
    return pin + k * (C - pin)


# -- published cases ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def timed():
    problem = S.PathGeneration(
        four_bar(),
        "P",
        ARC,
        timing=np.radians([30, 45, 60, 75, 90]),
        free=["D.x", "B", "C", "P"],
        bounds=lengths(0, 50),
        subject_to=[S.crank_turns("crank-rocker"), S.local("P", ("B", "C"), (-50, 50), (-50, 50))],
    )
    return S.solve(problem, starts=3000, refine=48, key=jax.random.key(1), **QUIET)


def test_five_timed_points_with_fixed_pivots(timed):
    best = timed.best
    p = independent(best, np.radians([30, 45, 60, 75, 90]))
    error = np.sum(np.abs(p - np.array(ARC) @ [1, 1j]) ** 2)
    assert error <= 7.42e-7
    np.testing.assert_allclose(timed.error, error, rtol=1e-6)
    g, a, b, c = loop(best)
    assert a <= min(g, b, c) and a + max(g, b, c) <= g + b + c - max(g, b, c) + 1e-9 * g
    assert timed.found and timed.broken == 0 and timed.designs[0].turns
    # What is not free has not moved, and what is free has.
    np.testing.assert_array_equal(best["A"], (0, 0))
    assert float(best["D"][1]) == 0.0
    home = timed.problem.start
    assert np.all(np.abs(timed.designs[0].x - home) > 1e-6)


def test_results_are_kept_and_drawn(timed, tmp_path):
    timed.save(tmp_path / "out")
    again = S.load(tmp_path / "out", timed.problem)
    assert again.error == timed.error and len(again.designs) == len(timed.designs)
    model = nc.load(tmp_path / "out" / "design_1.toml").compile()
    np.testing.assert_array_equal(model.parameters.points, timed.best.parameters.points)
    assert "crank-rocker" in (tmp_path / "out" / "designs.txt").read_text()
    for picture in (timed.gallery, timed.convergence):
        path = tmp_path / f"{picture.__name__}.png"
        picture(path)
        assert path.stat().st_size > 10_000
    with pytest.raises(nc.InputError, match="holds no result"):
        S.load(tmp_path, timed.problem)
    with pytest.raises(nc.ModelFileError, match=r"Front\.save"):
        S.Front.load(tmp_path / "out", timed.problem)


def test_a_search_goes_on_from_its_file(timed, tmp_path, monkeypatch):
    settings = {"starts": 80, "refine": 60, "iterations": 60, "key": jax.random.key(5), **QUIET}
    whole = S.solve(timed.problem, **settings)
    go, rounds = Refinement.go, []

    def interrupted(self, best):
        rounds.append(best)
        if len(rounds) == 3:
            raise KeyboardInterrupt
        go(self, best)

    monkeypatch.setattr(Refinement, "go", interrupted)
    part = S.solve(timed.problem, **settings, checkpoint=tmp_path / "search.npz")
    monkeypatch.undo()
    assert len(part.history) == 2 and part.designs
    assert "interrupted with" in str(part) and "resume from" in str(part)
    rest = S.solve(timed.problem, **settings, resume=tmp_path / "search.npz")
    assert not rest.stopped
    assert [h[1:] for h in rest.history] == [h[1:] for h in whole.history]
    for one, other in zip(rest.designs, whole.designs, strict=True):
        np.testing.assert_array_equal(one.x, other.x)
    assert (rest.refined, rest.broken) == (whole.refined, whole.broken)
    assert [p.name for p in tmp_path.iterdir()] == ["search.npz"]
    other = S.PathGeneration(four_bar(), "P", ARC, timing=np.radians([30, 45, 60, 75, 90]), free=["D.x", "B", "C", "P"])
    (tmp_path / "text.npz").write_text("no search")
    for problem, file, changed, kind, words in (
        (
            timed.problem,
            "search.npz",
            {"starts": 101},
            nc.InputError,
            "begun with starts = 80; it cannot go on with 101",
        ),
        (timed.problem, "search.npz", {"key": jax.random.key(6)}, nc.InputError, "begun with key"),
        (other, "search.npz", {}, nc.InputError, "other targets, bounds or conditions"),
        (timed.problem, "text.npz", {}, nc.ModelFileError, "is not a file that a search with checkpoint= wrote"),
        (timed.problem, "none.npz", {}, nc.ModelFileError, "cannot be read"),
    ):
        with pytest.raises(kind, match=words):
            S.solve(problem, **{**settings, **changed}, resume=tmp_path / file)
    with pytest.raises(nc.InputError, match="is a folder"):
        S.solve(timed.problem, **settings, checkpoint=tmp_path)


def test_six_free_points_exactly():
    problem = S.PathGeneration(
        four_bar(),
        "P",
        SIX,
        bounds={**lengths(0, 60), "A": (-60, 60)},
        subject_to=[S.crank_turns("crank-rocker"), S.local("P", ("B", "C"), (-60, 60), (-60, 60))],
    )
    result = S.solve(problem, starts=4000, refine=96, enough=1e-21, key=jax.random.key(2), **QUIET)
    best = result.designs[0]
    p = independent(best.system, best.inputs)
    assert np.sum(np.abs(p - np.array(SIX) @ [1, 1j]) ** 2) <= 1e-20
    g, a, b, c = loop(best.system)
    assert max(g, a, b, c) <= 60 and a + max(g, b, c) <= g + b + c - max(g, b, c)
    steps = np.diff(best.inputs)
    assert np.all(steps > 0) or np.all(steps < 0)
    assert abs(best.inputs[-1] - best.inputs[0]) <= 2 * np.pi
    assert not best.defects


def test_a_function_with_the_least_largest_error():
    x = np.linspace(1, 2, 61)
    problem = S.FunctionGeneration(
        four_bar(tracer=False),
        "psi",
        np.radians(60) * (x - 1),
        np.radians(90) * np.log10(x) / np.log10(2),
        input="phi",
        free=["B", "C", "D.x"],
        input_offset=True,
        output_offset=True,
        minimax=True,
        subject_to=[S.transmission_angle(np.radians(30))],
    )
    result = S.solve(problem, starts=100, refine=4, iterations=100, key=jax.random.key(0), **QUIET)
    assert np.degrees(result.error) <= 0.05
    best = result.designs[0]
    assert not best.defects and best.transmission >= np.radians(30)
    motion = nc.sweep(best.system, {"phi": best.inputs}).check()
    psi = np.asarray(motion["psi"]) - best.x[problem.names.index("output offset")]
    error = psi - problem.target
    np.testing.assert_allclose(np.max(np.abs(error)), result.error, rtol=1e-6)
    # Chebyshev: the largest error is met, with alternating signs, more often than there are unknowns of the shape.
    peaks = np.flatnonzero(np.abs(error) >= 0.999 * result.error)
    assert np.sum(np.diff(np.sign(error[peaks])) != 0) >= 4


# -- parts ----------------------------------------------------------------------------------------------------------


def minimise(errors, conditions, equal, x, low=-np.inf, high=np.inf, count=400):
    """The solver by itself, on functions of a vector that return values and derivatives."""
    x = np.atleast_2d(np.asarray(x, float))

    def evaluate(x, live):
        rows = [(errors(one), conditions(one)) for one in x]
        values = [np.stack([r[k][0] for r in rows]) for k in (0, 1)]
        slopes = np.stack([np.concatenate([e[1], c[1]]) for e, c in rows])
        return *values, slopes, np.isfinite(np.concatenate(values, axis=1)).all(axis=1)

    lanes = waiting(x, len(errors(x[0])[0]), len(conditions(x[0])[0]))
    low, high = (np.broadcast_to(bound, x.shape[1:]) for bound in (low, high))
    return advance(evaluate, lanes, np.array(equal, dtype=bool), low, high, count)


def test_constrained_least_squares_on_problems_with_known_optima():
    def none(x):
        return np.zeros(0), np.zeros((0, 2))

    def rosenbrock(x):
        return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]), np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])

    out = minimise(rosenbrock, none, [], [[-1.2, 1.0], [3.0, -2.0]])
    np.testing.assert_allclose(out.x, [[1, 1]] * 2, atol=1e-12)

    # Rosenbrock inside the unit circle (W. Hock, K. Schittkowski style): the known point of contact.
    def disc(x):
        return np.array([1.0 - x @ x]), -2.0 * x[None]

    out = minimise(rosenbrock, disc, [False], [[0.0, 0.0]])
    np.testing.assert_allclose(out.x[0], [0.786415151, 0.617698317], atol=1e-6)  # where the search ends
    assert out.conditions[0, 0] >= -1e-10

    # Nearest point of a hyperbola: min |x|² with x0 x1 = 1, at (1, 1).
    def hyperbola(x):
        return np.array([x[0] * x[1] - 1.0]), x[None, ::-1]

    out = minimise(lambda x: (x, np.eye(2)), hyperbola, [True], [[2.0, 0.7]])
    np.testing.assert_allclose(out.x[0], [1, 1], atol=1e-8)
    # Bounds: the best point of the box.
    out = minimise(rosenbrock, none, [], [[0.0, 0.0]], low=-2.0, high=np.array([0.5, 2.0]))
    np.testing.assert_allclose(out.x[0], [0.5, 0.25], atol=1e-10)

    # Fewer errors than unknowns, and a start where nothing is defined: the one is solved, the other left alone.
    def logarithm(x):
        return np.array([x[0] + np.log(x[1]) - 1.0]), np.array([[1.0, 1.0 / x[1]]])

    out = minimise(logarithm, none, [], [[5.0, 3.0], [5.0, -3.0]])
    assert abs(out.errors[0, 0]) < 1e-14
    np.testing.assert_array_equal(out.x[1], [5.0, -3.0])


def test_crank_condition_is_grashofs():
    problem = S.PathGeneration(four_bar(), "P", ARC, timing=np.linspace(0.0, 0.1, 5), subject_to=[S.crank_turns()])
    rng = np.random.default_rng(3)
    x = problem.start + rng.uniform(-1.5, 1.5, (300, problem.count))
    _, conditions, _, reaches = Evaluator(Goal(problem))(x, np.zeros((len(x), 0)))
    checked = 0
    for one, ok, c in zip(x, reaches, conditions, strict=True):
        if not ok or np.min(np.abs(c)) < 1e-9:
            continue
        turns = nc.kinematics.grashof_type(*loop(problem.design(one))).type in ("crank-rocker", "double-crank")
        assert turns == bool(np.all(c > 0))
        checked += 1
    assert checked > 100


@pytest.mark.parametrize("slot", [False, True], ids=["a coordinate that is fixed", "a slot"])
def test_the_transmission_angle_of_a_slider(slot):
    """Its cosine is r sin φ / l, whatever keeps the slider on its line."""
    m = nc.Mechanism("slider-crank")
    m.ground("A", (0, 0)), m.point("B", (0.1, 0.0)), m.point("C", (0.3, 0.0), **({} if slot else {"fixed": "y"}))
    m.body("crank", ["A", "B"]), m.body("rod", ["B", "C"]), m.angle("phi", at="A", to="B")
    if slot:
        m.ground("G", (0, 0)), m.ground("H", (1, 0)), m.slot("guide", "C", ("G", "H"))
    phi = np.linspace(0.2, 2.9, 25)
    place = 0.1 * np.cos(phi) + np.sqrt(0.102**2 - (0.1 * np.sin(phi)) ** 2)
    how = {"starts": 200, "refine": 12, "progress": False}

    def search(**conditions):
        problem = S.FunctionGeneration(m, "C.x", phi, place, input="phi", free=["B", "C.x"], **conditions)
        return S.solve(problem, **how).designs[0]

    found = search(subject_to=[S.transmission_angle(0)])
    assert found.exact and found.lengths == pytest.approx({"A-B": 0.1, "B-C": 0.102})
    assert np.degrees(found.transmission) == pytest.approx(11.365, abs=0.01)
    kept = search(subject_to=[S.transmission_angle(np.radians(40))])
    assert not kept.exact and np.degrees(kept.transmission) == pytest.approx(40.0, abs=1e-3)


def test_symmetric_points():
    places = {n: jnp.array([p]) for n, p in {"B": (3.0, 1.0), "C": (1.0, 3.0), "D": (-3.0, 1.0)}.items()}
    seen = Seen(four_bar().compile(), places, None, 1.0)
    for condition, met in (
        (S.symmetric("B", "D"), True),
        (S.symmetric("B", "C"), False),
        (S.symmetric("B", "C", about=((0, 0), (2, 2))), True),
        (S.symmetric("B", "D", about=((0, 0), (1, 0))), False),
        (S.symmetric("B", "B", about=("B", "C")), True),
        (S.symmetric("B", "D", about=((1, 0), (1, 1))), False),
    ):
        values = np.asarray(condition.values(seen))
        assert values.shape == (2,) and condition.equality
        assert (np.abs(values).max() < 1e-14) == met


def test_what_enters_a_path_linearly_is_found_by_trying():
    free = find_linear(S.PathGeneration(four_bar(), "P", ARC, timing=np.linspace(0, 1, 5)))
    assert free.axes == (True, True) and free.scale and free.turn and free.free
    some = find_linear(S.PathGeneration(four_bar(), "P", ARC, timing=np.linspace(0, 1, 5), free=["D.x", "B", "C", "P"]))
    assert some.axes == (False, False) and some.scale and not some.turn and some.free
    # An angle measured from the x axis does not turn with the drawing.
    fixed = nc.library.four_bar(coupler_point=(0.05, 0.03), explicit=False)
    found = find_linear(S.PathGeneration(fixed, "P", ARC, timing=np.linspace(0, 1, 5)))
    assert found.axes == (True, True) and found.scale and not found.turn and found.free
    # A point that carries another bar is no tracer.
    assert not find_linear(S.PathGeneration(four_bar(), "C", ARC, timing=np.linspace(0, 1, 5))).free


def test_bodies_are_guided_and_any_objective_is_made_small():
    places, turns = [(0, 0), (1, 0.5), (2, 0.6)], np.radians([0, 20, 35])
    problem = S.MotionGeneration(four_bar(), "coupler", "P", places, turns, travel=(0, 2 * np.pi))
    result = S.solve(problem, starts=60, refine=4, iterations=100, enough=1e-22, key=jax.random.key(0), **QUIET)
    motion = result.motion()
    np.testing.assert_allclose(motion["P"], places, atol=1e-9)
    found = np.asarray(motion.orientation("coupler"))
    np.testing.assert_allclose(np.sin(found - found[0]), np.sin(turns), atol=1e-9)

    def flat(mo):  # the coupler point as level as it can be, where it is 5 above the ground
        return mo["P"][:, 1] - 5.0

    level = S.Objective(four_bar(), flat, np.linspace(1.0, 1.6, 9), free=["P", "B", "C"])
    assert isinstance(level, Problem)
    result = S.solve(level, starts=6, refine=2, iterations=30, key=jax.random.key(0), **QUIET)
    np.testing.assert_allclose(result.motion()["P"][:, 1], 5.0, atol=1e-3)


# -- bad input ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: S.PathGeneration(four_bar(), "P", [(0, 0), (1, np.nan), (2, 0)]), "target point 2 is not finite"),
        (lambda: S.PathGeneration(four_bar(), "P", [(0, 0), (1, 0)]), "2 target points; give at least 3"),
        (lambda: S.PathGeneration(four_bar(), "Q", ARC), "no point 'Q'"),
        (lambda: S.PathGeneration(four_bar(), "P", ARC, timing=[1, 2]), "timing must be 5 numbers"),
        (lambda: S.PathGeneration(four_bar(), "P", ARC, free=["E"]), "no design variable 'E'"),
        (lambda: S.PathGeneration(four_bar(), "P", ARC, free=["P"], bounds={"B": (0, 1)}), "'B', which is not free"),
        (lambda: S.PathGeneration(four_bar(), "P", ARC, bounds={"B.x": (2, 1)}), "exclude everything"),
        (lambda: S.PathGeneration(four_bar(), "P", ARC, bounds={"A-B": (2, 1)}), "'A-B' exclude everything"),
        (lambda: S.PathGeneration(four_bar(), "P", ARC, subject_to=["Grashof"]), "conditions such as crank_turns"),
        (lambda: S.PathGeneration(four_bar(), "P", [(1, 1)] * 4), "all target points are the same"),
        (lambda: S.FunctionGeneration(four_bar(), "psi", [0, 1, 2], [0, 1, 2]), "no coordinate 'psi'"),
        (lambda: S.FunctionGeneration(four_bar(), "P.x", [0, 1, 2], [0, 1]), "target must be 3 numbers"),
        (lambda: S.MotionGeneration(four_bar(), "rod", "P", ARC, np.zeros(5)), "no body 'rod'"),
        (lambda: S.MotionGeneration(four_bar(), "coupler", "P", ARC, np.zeros(4)), "orientations must be finite"),
        (
            lambda: S.PathGeneration(
                four_bar(), "P", ARC, bounds={"A-B": (10, 11), **dict.fromkeys(["B-C", "C-D", "A-D"], (1, 2))}
            ),
            "every assembly: A-B is at least 10",
        ),
        (
            lambda: S.PathGeneration(
                four_bar(), "P", ARC, bounds={"A-B": (5, 9)}, subject_to=[S.length("B", "A", max=2)]
            ),
            "contradict each other",
        ),
        (lambda: S.transmission_angle(30), "between 0 and pi/2 radians, got 30"),
        (lambda: S.crank_turns("rocker"), "kind='rocker'"),
        (lambda: S.length("A", "B"), "give min=, max=, or both"),
    ],
)
def test_mistakes_are_named(make, words):
    with pytest.raises(nc.InputError, match=words.replace("(", r"\(")):
        make()


def test_searches_that_cannot_succeed_say_why(timed):
    with pytest.raises(nc.InputError, match="starts must be at least 1"):
        S.solve(timed.problem, starts=0)
    still = four_bar()
    still.point("far", (9, 9))
    still.ground("E", (9, 8))
    still.body("idle bar", ["E", "far"])
    still.angle("idle", at="E", to="far")
    with pytest.raises(nc.InputError, match=r"far\.x, far\.y have no influence"):
        S.solve(
            S.PathGeneration(
                still, "P", ARC, timing=np.linspace(0, 1, 5), input="phi", hold=["idle"], free=["P", "B", "far"]
            ),
            starts=50,
            **QUIET,
        )


CRANK = 'type = "crank turns"\nkind = "crank-rocker"'


def test_problem_files(tmp_path):
    from jaxnc.io.problems import load_problem

    example = PROBLEMS / "path.toml"
    problem, search = load_problem(example)
    assert isinstance(problem, S.PathGeneration) and search.starts == 3000
    np.testing.assert_allclose(problem.timing, np.radians([30, 45, 60, 75, 90]))
    np.testing.assert_array_equal(problem.target, ARC)
    assert problem.variables.names == ("D.x", "B.x", "B.y", "C.x", "C.y", "P.x", "P.y")
    text = example.read_text().replace("../four_bar_idea.toml", str(example.parent.parent / "four_bar_idea.toml"))
    np.savetxt(tmp_path / "points.csv", ARC, delimiter=",", header="x, y")
    start, end = text.index("target = "), text.index("timing = ")
    (tmp_path / "csv.toml").write_text(text[:start] + 'target = "points.csv"\n' + text[end:])
    np.testing.assert_array_equal(load_problem(tmp_path / "csv.toml")[0].target, ARC)
    drawing = '<svg><path d="M0 0A1 1 0 0 1 2 0A1 1 0 0 1 0 0"/></svg>'
    (tmp_path / "circle.svg").write_text(drawing)
    target = 'target = { svg = "circle.svg", points = 5, size = 4 }\n'
    more = """
[[conditions]]
type = "stock"
points = ["A", "B"]
sizes = [1, 2]
[[conditions]]
type = "integer"
variable = "D.x"
step = 0.5
[[conditions]]
type = "symmetric"
points = ["A", "D"]
about = [[2, 0], [2, 1]]
[[conditions]]
type = "equal"
points = ["B", "C"]
value = 3
[[conditions]]
type = "clear of"
region = [[10, 10], [11, 12]]
width = 0.1
[[conditions]]
type = "no flip"
distance = 0.2
input = 9
[[conditions]]
type = "only circuit"
stops = { phi = [-360, 90], "C.y" = [0, inf] }
"""
    (tmp_path / "svg.toml").write_text(text[:start] + target + text[end:] + more)
    round_ = load_problem(tmp_path / "svg.toml")[0]
    assert isinstance(round_, S.PathGeneration) and round_.closed
    np.testing.assert_allclose(np.linalg.norm(round_.target - [1, 0], axis=1), 2.0, atol=1e-9)
    names = {c.name for c in round_.conditions}
    assert {"A-B in stock", "D.x a multiple of 0.5", "A and D symmetric", "B-C = 3"} <= names
    assert "clear of the region within (10, 10) and (11, 12)" in names
    assert S.no_flip(0.2, np.radians(9)) in round_.conditions
    assert S.only_circuit({"phi": np.radians((-360, 90)), "C.y": (0.0, None)}) in round_.conditions
    row = text[: text.index("A-B = [0, 50]")].count("\n") + 1
    for old, new, words in (
        (text[start:end], 'target = "circle.svg"\n', 'target = { svg = "circle.svg", points = 60 }'),
        ('kind = "path"', 'kind = "paths"', "line 4: kind: 'paths'"),
        ('point = "P"', "", "needs point"),
        ('type = "crank turns"', 'type = "crank turn"', "crank turn"),
        ("A-B = [0, 50]", "A-B = [50, 0]", "'A-B' exclude everything"),
        ("A-B = [0, 50]", "A-B = [5, 5]", "S.equal"),
        ("A-B = [0, 50]", "B = [[-5], [1, 3]]", f"line {row}: bounds of 'B' must be (low, high)"),
        ("A-B = [0, 50]", "B = [[5, 1], [1, 3]]", f"line {row}: bounds of 'B' exclude everything"),
        (text[start:end], "target = [[1, 2], [3]]\n", "rows of equally many numbers"),
        ("timing = [30, 45, 60, 75, 90]", "timing = [30, 45]", "timing must be 5 numbers"),
        ('type = "crank turns"', 'type = "no flip"', "give distance="),
        ('type = "crank turns"', 'type = "transmission angle"\nmin = 95', "(95 degrees)"),
        ('type = "crank turns"', 'type = "crank turns"\nmin = 3', "min = … says nothing in a condition 'crank turns'"),
        ("timing = [30, 45, 60, 75, 90]", "timing = [30, 45, 60, 75, 430]", "(400 degrees)"),
        ('point = "P"', 'point = "A"', "'A' is a ground point"),
        ('point = "P"', 'point = "P"\noutput = "psi"', "output = … says nothing in a problem of kind 'path'"),
        ('point = "P"', 'point = "P"\norientations = [0.0]', "orientations = … says nothing in a problem of"),
        (CRANK, 'type = "only circuit"\nstops = { X = [0, 1] }', "no coordinate 'X' with a stop"),
    ):
        assert old in text
        (tmp_path / "bad.toml").write_text(text.replace(old, new, 1))
        with pytest.raises(nc.ModelFileError, match=r"bad\.toml") as error:
            load_problem(tmp_path / "bad.toml")
        assert words in str(error.value), str(error.value)


def test_a_problem_file_in_degrees_knows_the_angle_of_a_rolling_joint(tmp_path):
    from jaxnc.io.problems import load_problem

    nc.library.rolling_disc().save(tmp_path / "disc.toml")
    text = (tmp_path / "disc.toml").read_text().split("[run]")[0]
    (tmp_path / "disc.toml").write_text(text.replace("[ground]", '[units]\nangle = "deg"\n[ground]', 1))
    ways = 'mechanism = "disc.toml"\nkind = "function"\ninput = "s"\noutput = "phi"\nfree = ["P1"]\n'
    (tmp_path / "problem.toml").write_text(ways + "values = [0.2, 0.3, 0.4]\ntarget = [90.0, 45.0, 30.0]\n")
    np.testing.assert_allclose(load_problem(tmp_path / "problem.toml")[0].target, np.radians([90, 45, 30]))
