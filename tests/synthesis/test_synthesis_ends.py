"""The ends of refinements: nothing improves them, they are told apart, and the result says what they are."""

import dataclasses
import tracemalloc

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linprog

import jaxnc as nc
from benchmarks.synthesis import known
from benchmarks.synthesis.polish import polished
from benchmarks.synthesis.published import ANY, ARCH, ELLIPSE, MKH_25, four_bar, lengths
from jaxnc.synthesis import design as judge
from jaxnc.synthesis import evaluate
from jaxnc.synthesis.evaluate import solve_poses
from jaxnc.synthesis.search import basins
from jaxnc.synthesis.search.basins import as_they_are, bring_to_ends, distinct_basins
from jaxnc.synthesis.search.goal import Goal
from jaxnc.synthesis.search.solve import designs_to_show
from jaxnc.synthesis.search.sqp import End, LocalModel, Sqp, least

S = nc.synthesis
SLIGHT = 1e-8  # of the error: what a polish may still take away


def loop(system):
    p = {n: np.asarray(system[n]) for n in "ABCD"}
    return [float(np.linalg.norm(p[i] - p[j])) for i, j in ("AD", "AB", "BC", "CD")]


def put(problem, design, crank):
    """Unknowns of a four-bar with a coupler point, drawn at a crank angle."""
    x = problem.start.copy()
    for name, z in known.joints(design, crank).items():
        x[[problem.names.index(f"{name}.{axis}") for axis in "xy"]] = z.real, z.imag
    return x


def drawn(*lengths):
    """A four-bar of given sides, drawn with its crank at a right angle."""
    m = nc.Mechanism("four-bar")
    design = known.Known("", lengths, (1.0, 1.0), (0.0, 0.0), 0.0, 1, 0.0)
    for name, z in sorted(known.joints(design, 0.5 * np.pi).items()):
        (m.ground if name in "AD" else m.point)(name, (z.real, z.imag))
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C", "P"])
    m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B", start="D")
    return m


@pytest.fixture(scope="module")
def arch():
    problem = S.PathGeneration(
        four_bar(),
        "P",
        ARCH,
        timing=np.radians([30, 60, 90, 120, 150, 180]),
        bounds={**lengths(0, 50), "A": (-50, 50)},
        # The best design ends at the Grashof limit, where the transmission angle is zero.
        subject_to=[S.crank_turns("crank-rocker"), S.local("P", ("B", "C"), (-50, 50), (-50, 50)), ANY],
    )
    return S.solve(problem, starts=4000, refine=24, keep=4, key=jax.random.key(0), progress=False)


def test_a_search_ends_where_scipy_improves_nothing(arch):
    # Two lengths at their bound, the Grashof limit, and the last target beside the dead point there.
    best = arch.designs[0]
    assert arch.error <= 1.216212467 and not best.defects  # what Nguyen-Van et al. 2022 publish
    assert best.converged and best.optimality <= 1e-6 and best.feasibility <= 1e-9 and best.iterations > 0
    g, a, b, c = loop(arch.best)
    assert max(g, a, b, c) <= 50 * (1 + 1e-9) and a + max(g, b, c) <= g + b + c - max(g, b, c) + 1e-8
    for design in [d for d in arch.designs if d.converged][:2]:
        for method in ("SLSQP", "least_squares"):
            assert polished(arch.problem, design.x, method).gain <= SLIGHT


def test_designs_of_one_valley_are_one_line_of_the_table(arch):
    errors = [d.error for d in arch.designs if d.converged]
    assert all(abs(a - b) > 1e-6 * b for n, a in enumerate(errors) for b in errors[:n])
    assert arch.designs[0].starts > 1
    head, first, *_ = arch.table().splitlines()
    assert head.split()[-3:] == ["starts", "end", "defects"]
    assert first.split()[-3:] == [str(arch.designs[0].starts), "converged", "none"]


def test_what_is_no_end_says_why(arch):
    problem, best = arch.problem, arch.designs[0]
    x = best.x + 0.01 * problem.scale * np.cos(np.arange(problem.count))
    short, end = Sqp(Goal(problem)).run([x], 3)[0], Sqp(Goal(problem)).run([best.x], 3)[0]
    assert not short.converged and short.reason == "3 iterations" and short.promised > 1e-6
    assert end.converged and end.reason == "" and end.square <= best.error / problem.size**2 * (1 + 1e-12)
    far = problem.start.copy()
    far[problem.names.index("C.x")] += 1e3  # its dead points are before the targets
    (end,) = Sqp(Goal(problem)).run([far], 10)
    assert not end.converged and end.reason in ("does not reach its targets", "no step is possible", "10 iterations")


def test_what_is_given_up_since_it_is_behind_says_so(arch):
    problem = arch.problem
    rows = [
        d.x + 0.02 * k * problem.scale * np.cos(np.arange(problem.count)) for k, d in enumerate(arch.designs[:1] * 3)
    ]
    found = bring_to_ends(problem, Goal(problem), rows, most=3, iterations=60, width=24)
    given_up = [v.end for v in found if not v.end.converged and v.end.iterations < 60]
    assert found[0].end.converged and sum(v.starts for v in found) == 3
    assert all(e.reason in (f"{e.iterations} iterations, behind", "no step is possible") for e in given_up)
    table = [d.reason for d in arch.designs if not d.converged and d.iterations < 400]
    assert all(reason.endswith(", behind") or reason == "no step is possible" for reason in table)


def test_designs_that_cannot_be_shown_are_not_judged(arch, monkeypatch):
    problem, rows = arch.problem, [d.x for d in arch.designs]
    several = as_they_are(problem, rows, len(rows)) * 2
    asked, walk = [], judge.follow_again
    monkeypatch.setattr(judge, "follow_again", lambda problem, one: (asked.append(one), walk(problem, one))[1])
    everything = judge.judge(problem, several)
    assert len(asked) == len(several) > 1
    asked.clear()
    first = designs_to_show(problem, several, 1)
    assert len(asked) == 1 and first[0].error == everything[0].error and not first[0].defects


def lagging(n):
    return 1.84 - 0.001 * n


@pytest.mark.parametrize(
    ("squares", "levels", "expected"),
    [
        # Of two designs that are as far behind one goes on winning, and by that would be ahead after 120 iterations.
        (
            (lambda n: 1.0, lambda n: 3.0 - 0.03 * n, lagging),
            (lambda n: 1.0, lambda n: 3.0 - 0.03 * n, lagging),
            [(-3.0, 200), (1.0, 120), (1.8, 40)],
        ),
        # One that misses a condition by a little tells where it last met it: to meet it again is no win.
        (
            (lambda n: 1.0, lambda n: 5.0 if n < 40 else lagging(n)),
            (lambda n: 1.0, lagging),
            [(1.0, 200), (1.8, 40)],
        ),
    ],
)
def test_what_goes_on_winning_is_brought_to_its_end_and_what_lags_is_not(squares, levels, expected, arch, monkeypatch):
    problem = arch.problem

    class Told:
        def __init__(self, goal, width, until):
            pass

        def begin(self, rows):
            return [{"square": squares[k], "level": levels[k], "at": 0} for k in range(len(rows))]

        def go(self, lanes, until):
            for lane in lanes:
                lane["at"] = until

        def level(self, lane):
            return lane["level"](lane["at"])

        def end_of(self, lane):
            nan, at = np.nan, lane["at"]
            return End(np.zeros(1), lane["square"](at), nan, nan, nan, at, f"{at} iterations")

    def unlike(problem, ends):
        order = sorted(range(len(ends)), key=lambda k: ends[k][0].square)
        return [(basins.Basin(None, *ends[k]), k) for k in order]

    monkeypatch.setattr(basins, "Sqp", Told)
    monkeypatch.setattr(basins, "move_designs", lambda problem, rows: rows)
    monkeypatch.setattr(basins, "_group_designs", lambda problem, moves: [[k] for k in range(len(moves))])
    monkeypatch.setattr(basins, "distinct_basins", unlike)
    found = bring_to_ends(problem, Goal(problem), [problem.start] * len(squares), most=3, iterations=200, width=3)
    assert [(round(v.end.square, 6), v.end.iterations) for v in found] == expected


def test_a_guide_drawn_elsewhere_on_its_line_is_no_other_design():
    def slider(x, joint=(4.0, -0.5)):
        m = nc.Mechanism("slider")
        for name, at in {"A": (0.0, 0.0), "E": (x, -0.5), "F": (x + 3.0, -0.5)}.items():
            m.ground(name, at)
        for name, at in {"B": (0.6, 0.8), "C": joint, "P": (2.0, 1.2)}.items():
            m.point(name, at)
        m.body("crank", ["A", "B"])
        m.body("rod", ["B", "C", "P"])
        m.slot("guide", "C", ("E", "F"))
        m.angle("phi", at="A", to="B")
        return S.PathGeneration(m, "P", [(np.cos(k), np.sin(k)) for k in range(5)], timing=np.linspace(0.9, 2.0, 5))

    problem = slider(3.0)
    rows = [slider(x, joint).start for x, joint in ((3.0, (4.0, -0.5)), (5.0, (4.0, -0.5)), (3.0, (4.3, -0.5)))]
    ends = [(End(x, 1.0 + k, 0.0, 0.0, 0.0, 1, ""), 1) for k, x in enumerate(rows)]
    assert [(k, valley.starts) for valley, k in distinct_basins(problem, ends)] == [(0, 2), (2, 1)]


def test_ends_are_kept_with_the_result(arch, tmp_path):
    arch.save(tmp_path)
    again = S.load(tmp_path, arch.problem)
    for one, other in zip(again.designs, arch.designs, strict=True):
        assert (one.converged, one.reason, one.starts) == (other.converged, other.reason, other.starts)
        assert (one.optimality, one.feasibility, one.iterations) == (
            other.optimality,
            other.feasibility,
            other.iterations,
        )


def test_a_shorter_result_leaves_no_models_of_a_longer_one(arch, tmp_path):
    (tmp_path / "design_01.toml").write_text("")  # no name that a result has
    (tmp_path / "design_2.toml").write_text("")
    one = dataclasses.replace(arch, designs=arch.designs[:1])
    for result, count in ((one, 2), (dataclasses.replace(arch, designs=arch.designs[:1] * 12), 12), (one, 1)):
        result.save(tmp_path)
        names = {f"design_{k + 1}.toml" for k in range(count)} | {"design_01.toml"}
        assert {path.name for path in tmp_path.glob("*.toml")} == names


def test_a_design_that_passes_near_a_dead_point_is_not_given_up():
    # Half a thousandth from the Grashof limit its transmission angle falls to 2 degrees and rises again at once.
    m = drawn(4.0, 1.0, 2.0, 3.0 + 5e-4)
    angles = np.radians(np.linspace(90, 450, 7))
    problem = S.PathGeneration(m, "P", [(np.cos(k), np.sin(k)) for k in range(7)], timing=angles)
    x = problem.start[None]
    assert not (solve_poses(problem, x, 0).status == 0).all(), "or else this would show nothing"
    found = solve_poses(problem, x, 0, way="close")
    assert (found.status == 0).all()
    motion = nc.sweep(problem.system, {"phi": angles}).check()
    np.testing.assert_allclose(found.q[0], motion.q, atol=1e-9)
    # One that does miss it is given up all the same.
    gone = S.PathGeneration(drawn(4.0, 1.0, 2.0, 3.0 - 5e-4), "P", [(k, k * k) for k in range(7)], timing=angles)
    assert not (solve_poses(gone, gone.start[None], 0, way="close").status == 0).all()


def test_designs_much_larger_than_the_idea_are_moved_all_the_same():
    problem = S.PathGeneration(four_bar(), "P", ARCH, timing=np.linspace(0.2, 2.0, 6))
    x = problem.start
    for size in (1.0, 1e3, 1e4):
        assert (solve_poses(problem, size * x[None], 0).status == 0).all(), size


@pytest.mark.parametrize("seed", range(4))
def test_quadratic_programs_meet_their_conditions_of_optimality(seed):
    rng = np.random.default_rng(seed)
    n, k = 6, 14
    root = rng.normal(size=(n, n))
    matrix, gradient, rows = root @ root.T + 0.1 * np.eye(n), rng.normal(size=n), rng.normal(size=(k, n))
    right = rows @ rng.normal(size=n) - rng.uniform(0.0, 0.5, k)  # which some d meets
    factor = np.linalg.cholesky(matrix).T
    d, u = least(factor, np.linalg.solve(factor.T, gradient), rows, right)
    np.testing.assert_allclose(matrix @ d + gradient, rows.T @ u, atol=1e-9)
    assert np.all(u >= 0.0) and np.all(rows @ d >= right - 1e-9) and abs(u @ (rows @ d - right)) <= 1e-9
    assert least(factor, gradient, np.array([[1.0] + [0.0] * 5, [-1.0] + [0.0] * 5]), np.ones(2)) is None


def test_long_flat_valleys_are_followed_to_rounding():
    # Ten points of an ellipse (Cabrera, Simon & Prado 2002, case 5; the last is the first) from a design of 650 times
    # the drawing, 1e-8 away from them; an exact one is about 860 wide.
    problem = S.PathGeneration(
        four_bar(),
        "P",
        ELLIPSE,
        bounds=lengths(0, 1e4),
        subject_to=[S.crank_turns("crank-rocker")],
    )
    design = known.Known(
        "",
        (862.37257629, 8.17017885, 511.00105626, 470.4905877),
        (-38.02139095, -97.86373526),
        (-19.02194151, 110.89242385),
        0.17511497,
        1,
        0.0,
    )
    x = put(problem, design, 0.5 * np.pi)
    x[-10:] = -0.24163533 + np.append(0.0, np.full(9, 0.69885))
    (end,) = Sqp(Goal(problem)).run([x], 100)
    assert end.square <= 1e-22 and end.converged and end.optimality == 0.0


def test_published_designs_have_the_errors_that_are_told_of_them():
    arch = known.timed(known.ARCH_HCDJ, np.array(ARCH), np.radians([30, 60, 90, 120, 150, 180]))
    assert arch == pytest.approx(known.ARCH_HCDJ.value, rel=1e-9)
    assert known.nearest(known.ELLIPSE_LIN, np.array(ELLIPSE)) == pytest.approx(known.ELLIPSE_LIN.value, rel=1e-9)
    assert known.nearest(known.MKH, np.array(MKH_25)) == pytest.approx(known.MKH.value, rel=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_step_towards_the_least_largest_error_is_that_of_a_linear_program(seed):
    """One error, the last unknown, above all of |a x - b|: the other unknowns are in the conditions alone."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(121, 9)) * 10.0 ** rng.uniform(-2, 2, 9), 1e-3 * rng.normal(size=121)
    top, one, far = np.abs(b).max(), np.ones(121), np.full(10, 1e9)
    rows, conditions = np.concatenate([np.c_[-a, one], np.c_[a, one]]), np.concatenate([top + b, top - b])
    last = np.eye(10)[9]
    here = LocalModel(
        (-far, far), last[None], np.array([top]), rows, conditions, np.zeros(242, bool), np.zeros((10, 10))
    )
    found = here.quadratic_step(10.0)
    assert found is not None
    goal = linprog(last, A_ub=-rows, b_ub=conditions, bounds=[(-10, 10)] * 10)
    assert top + found[0][9] == pytest.approx(top + goal.x[9], rel=1e-5)
    assert (rows @ found[0] + conditions).min() >= -1e-8


def test_a_track_of_many_steps_is_divided_in_little_memory():
    # A Pareto search beside a dead point came to 100,000 steps, and asked for 24 GiB to divide them.
    steps = 4000
    track = np.linspace(0.0, 1.0, steps + 1)[:, None]
    doubted = np.ones((steps, 1), bool)
    doubted[::2] = False
    tracemalloc.start()
    finer, at = evaluate._refine_track(track, np.array([[0], [1], [2], [steps]]), doubted)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20e6  # the table of all steps against all parts has 72e6 numbers
    assert len(finer) == 1 + steps // 2 * (1 + evaluate._PARTS)
    np.testing.assert_allclose(finer[at[:, 0], 0], track[[0, 1, 2, steps], 0], rtol=0, atol=0)
    assert (np.diff(finer[:, 0]) > 0).all()


def test_no_iteration_begins_when_time_is_over():
    """What is then best is told as it is, in a search that had no time for ends."""
    t = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    path = np.stack([1.5 + 0.3 * np.cos(t), 1.5 + 0.2 * np.sin(t)], axis=1)
    m = nc.library.four_bar(coupler_point=(0.5, 0.4))
    problem = S.PathGeneration(m, "P", path, input="phi", closed=True)
    ending = Sqp(Goal.of(problem), until=-np.inf)
    lanes = ending.begin([np.append(problem.start, Goal.of(problem).row[problem.count :])])
    ending.go(lanes, 50)
    assert [lane.iterations for lane in lanes] == [0]


POINTS = np.array([(3, 3), (2.759, 3.363), (2.372, 3.663), (1.89, 3.862), (1.355, 3.943)])


def drawn_four_bar():
    m = nc.Mechanism("four-bar")
    m.ground("A", (0, 0)), m.ground("D", (4, 0))
    for name, place in {"B": (0.5, 1), "C": (3.3, 2.9), "P": (1.8, 3.2)}.items():
        m.point(name, place)
    m.body("crank", ["A", "B"]), m.body("coupler", ["B", "C", "P"]), m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B", start="D")
    return m


def test_conditions_over_a_range_are_differentiated_alike_with_and_without_jit():
    """The range begins at the drawing, which the unknowns move: eagerly the derivative has that as well."""
    timing, size = np.radians([30, 45, 60, 75, 90]), nc.synthesis.size(8.0)
    problem = nc.synthesis.PathGeneration(drawn_four_bar(), "P", POINTS, timing=timing, free=["B"], subject_to=[size])
    x, way = jnp.asarray(problem.start), jnp.array([0.3, -0.7])

    def conditions(x):
        return problem.evaluate(x).conditions

    ends = [np.asarray(conditions(x + h * way)) for h in (-1e-6, 1e-6)]
    slope = (ends[1] - ends[0]) / 2e-6
    for run in (conditions, jax.jit(conditions)):
        np.testing.assert_allclose(jax.jvp(run, (x,), (way,))[1], slope, rtol=1e-6, atol=1e-7)


def test_a_table_of_wrapped_angles_is_the_same_function():
    """A double crank's own output, as `arctan2` tells it: of an angle whole turns do not matter, at each target."""
    m = nc.Mechanism("double crank")
    m.ground("A", (0, 0)), m.ground("D", (1, 0)), m.point("B", (0, 3)), m.point("C", (2.5, 3.0))
    m.body("crank", ["A", "B"]), m.body("coupler", ["B", "C"]), m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B"), m.angle("psi", at="D", to="C")
    values = np.pi / 2 + np.linspace(0, 5, 12)
    told = np.asarray(nc.sweep(m.compile(), {"phi": values})["psi"])
    wrapped = np.angle(np.exp(1j * told))
    assert np.abs(np.diff(wrapped)).max() > np.pi
    for target in (told, told - 2 * np.pi, wrapped):
        problem = nc.synthesis.FunctionGeneration(m, "psi", values, target, input="phi", free=["B", "C"])
        assert np.abs(problem.evaluate(jnp.asarray(problem.start)).errors).max() < 1e-12
    ask = {"input": "phi", "free": ["B", "C"], "output_offset": True}
    problem = nc.synthesis.FunctionGeneration(m, "psi", values, np.angle(np.exp(1j * (told + 0.7))), **ask)
    found = nc.synthesis.solve(problem, starts=50, refine=4, key=jax.random.key(0), progress=False)
    assert found.designs[0].exact


def test_a_result_that_is_read_for_other_targets_claims_nothing_of_these(tmp_path):
    free = ["D", "B", "C", "P"]
    problem, other = (
        nc.synthesis.PathGeneration(drawn_four_bar(), "P", POINTS + by, input="phi", free=free) for by in (0.0, 0.3)
    )
    nc.synthesis.solve(problem, starts=20, refine=4, key=jax.random.key(1), progress=False).save(tmp_path)
    same, shifted = (nc.synthesis.load(tmp_path, one) for one in (problem, other))
    assert same.designs[0].exact and same.designs[0].freedom > 0
    assert not any(d.exact or d.converged or d.freedom for d in shifted.designs)
    assert "continuum" not in str(shifted)
