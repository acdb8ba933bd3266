"""Options of problems: directions and circuits, each against compasses; what the table tells of links."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import jaxnc as nc
from benchmarks.synthesis.published import ARC, four_bar
from jaxnc.io.problems import load_problem
from jaxnc.mechanism import model as record
from jaxnc.synthesis.conditions import Seen
from jaxnc.synthesis.search.screen import reseat_targets

S = nc.synthesis
TIMING = np.radians([30, 45, 60, 75, 90])
FEW = {"starts": 300, "refine": 48, "iterations": 60, "keep": 4, "progress": False}


def path(**more):
    return S.PathGeneration(four_bar(), "P", ARC, **({"timing": TIMING, "offset": True} | more))


def values(condition, phi=TIMING):
    system = four_bar().compile()
    ready = condition.prepare(system, "phi")
    return np.asarray(ready.values(Seen(system, nc.sweep(system, {"phi": jnp.asarray(phi)}), None, 1.0)))


def test_directions_and_circuits_are_what_compasses_find():
    points = {n: np.asarray(four_bar().compile()[n]) @ [1, 1j] for n in "ABCD"}
    way = np.angle(points["D"] - points["A"])
    np.testing.assert_allclose(values(S.direction("A", "D", 0.3)), [way - 0.3], atol=1e-12)
    for low, high in ((-0.2, 0.5), (0.1, 0.5), (3.0, 4.0), (6.0, 6.5), (6.3, 7.0)):
        (found,) = values(S.direction("A", "D", min=low, max=high))
        inside = any(low <= way + turn <= high for turn in (0.0, 2 * np.pi))
        assert (found > 0.0) == inside, (low, high)
    # C against the line from B to D, by the sign of the triangle's area; the sine of the transmission angle.
    phi = np.linspace(0.3, 6.0, 7)
    a, b, c = abs(points["B"]), abs(points["C"] - points["B"]), abs(points["C"] - points["D"])
    far = abs(a * np.exp(1j * phi) - points["D"])
    sine = np.sqrt(1.0 - ((b * b + c * c - far**2) / (2 * b * c)) ** 2)
    np.testing.assert_allclose(values(S.on_circuit("left"), phi), sine, rtol=1e-9)
    np.testing.assert_allclose(values(S.on_circuit("right"), phi), -sine, rtol=1e-9)
    np.testing.assert_allclose(values(S.on_circuit("right", joint=("D", "C", "B")), phi), sine, rtol=1e-9)


@pytest.mark.parametrize(("side", "sign"), [("left", 1.0), ("right", -1.0)])
def test_designs_stand_as_they_are_asked_to(side, sign):
    wanted = [S.on_circuit(side), S.direction("A", "D", 0.25 * np.pi), S.crank_turns()]
    found = S.solve(path(subject_to=wanted), **FEW)
    assert found.found
    for design in (d for d in found.designs if not d.defects):
        b, c, d, a = (np.asarray(design.motion[n]) @ [1, 1j] for n in "BCDA")
        assert (sign * ((d - b).conj() * (c - b)).imag > 0.0).all()
        np.testing.assert_allclose(np.angle(d - a), 0.25 * np.pi, atol=1e-7)


def test_lengths_of_links_are_told():
    found = S.solve(path(), **(FEW | {"iterations": 20}))
    best = found.designs[0]
    for name, length in best.lengths.items():
        a, b = (np.asarray(best.system[n]) for n in name.split("-"))
        np.testing.assert_allclose(length, np.linalg.norm(a - b), rtol=1e-9)
    assert list(best.lengths) == ["A-B", "B-C", "B-P", "C-P", "C-D", "A-D"]
    lines = str(found).splitlines()
    at = lines.index("lengths [m]")
    assert lines[at + 1].split() == list(best.lengths)
    np.testing.assert_allclose([float(w) for w in lines[at + 2].split()[1:]], list(best.lengths.values()), rtol=1e-4)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: S.direction("A", "D"), "give a value, or min= and max="),
        (lambda: S.direction("A", "D", min=0.1), "give a value, or min= and max="),
        (lambda: S.direction("A", "D", 45), "radians .numpy.radians"),
        (lambda: S.direction("A", "D", min=1.0, max=0.5), "57.2958 to 28.6479 degrees.*less than a turn; add 2.pi"),
        (lambda: S.on_circuit("open"), "side='open'; known names: left, right"),
        (lambda: path(subject_to=[S.direction("A", "E", 0.0)]), "has no point 'E'"),
        (
            lambda: S.PathGeneration(nc.library.rssr(), "A", np.eye(3), input="phi", subject_to=[S.on_circuit("left")]),
            "spatial.*of the plane",
        ),
    ],
)
def test_mistakes_are_named(make, words):
    with pytest.raises(nc.InputError, match=words):
        make()


# -- nearest points without order --------------------------------------------------------------------------------------


def distances(system, targets):
    """Of points to the nearest point of a coupler curve by compasses: all angles, then the best one made exact."""

    def traced(phi):
        A, B, C, D, P = (np.asarray(system[n]) @ [1, 1j] for n in "ABCDP")
        side = np.sign(((C - B) * np.conj(D - B)).imag)
        pin = A + abs(B - A) * np.exp(1j * phi)
        d, b, c = D - pin, abs(C - B), abs(C - D)
        along = (b * b - c * c + abs(d) ** 2) / (2 * abs(d))
        joint = pin + (along + 1j * side * np.sqrt(np.maximum(b * b - along**2, 0.0))) * d / abs(d)
        return pin + (P - B) / (C - B) * (joint - pin)

    grid = np.linspace(0.0, 2 * np.pi, 20001)
    out = []
    for target in np.asarray(targets) @ [1, 1j]:
        k = np.argmin(abs(traced(grid) - target))
        low, high = grid[k] - 4e-4, grid[k] + 4e-4
        near = minimize_scalar(lambda phi, t=target: abs(traced(phi) - t) ** 2, (low, grid[k], high), tol=1e-13)
        out.append(np.sqrt(near.fun))
    return np.array(out)


CLOUD = [(2.0, 3.9), (1.2, 2.6), (0.4, 3.6), (2.3, 2.9), (1.0, 4.3), (0.2, 2.9), (1.7, 2.5), (1.5, 4.2)]


@pytest.fixture(scope="module")
def cloud():
    problem = S.PathGeneration(
        four_bar(), "P", CLOUD, subject_to=[S.crank_turns("crank-rocker", margin=0.05)], ordered=False
    )
    return S.solve(problem, **(FEW | {"iterations": 200}))


def test_errors_without_order_are_distances_to_the_nearest_points(cloud):
    assert cloud.found
    ends = [d for d in cloud.designs if not d.defects and d.converged]
    assert cloud.designs[0] in ends
    for design in ends:
        far = distances(design.system, CLOUD)
        np.testing.assert_allclose(np.linalg.norm(design.errors, axis=1), far, atol=1e-7)
        np.testing.assert_allclose(design.error, far @ far, rtol=1e-6)
    # The order in which the targets are named changes nothing.
    other = S.PathGeneration(
        four_bar(), "P", CLOUD[::-1], subject_to=[S.crank_turns("crank-rocker", margin=0.05)], ordered=False,
        start_timing=cloud.designs[0].inputs[::-1],
    )  # fmt: skip
    np.testing.assert_allclose(other.start[len(other.variables.names) :].cumsum(), cloud.designs[0].inputs[::-1])
    x = np.append(cloud.designs[0].x[: len(other.variables.names)], other.extras.home)
    (seen,) = reseat_targets(other, [x])
    np.testing.assert_array_equal(seen, x)
    # Keeping an order that the curve does not have costs something.
    kept = S.PathGeneration(four_bar(), "P", CLOUD, subject_to=[S.crank_turns("crank-rocker", margin=0.05)])
    assert S.solve(kept, **FEW).error > 10 * cloud.error


def test_a_target_goes_over_to_the_nearest_part_of_the_curve(cloud):
    problem, best = cloud.problem, cloud.designs[0]
    n = len(problem.variables.names)
    wrong = best.inputs + np.where(np.arange(len(CLOUD)) % 2, 2.5, 0.0)
    (x,) = reseat_targets(problem, [np.concatenate([best.x[:n], wrong[:1], np.diff(wrong)])])
    off = np.cumsum(x[n:]) - best.inputs
    np.testing.assert_allclose(off - 2 * np.pi * np.round(off / (2 * np.pi)), 0.0, atol=0.02)


def test_timings_of_the_idea_are_its_start():
    problem = S.PathGeneration(four_bar(), "P", ARC, start_timing=TIMING[::-1])
    extra = problem.extras.home
    np.testing.assert_allclose(problem.inputs(extra), TIMING[::-1])
    assert (np.asarray(problem.own(extra)) > 0.0).all()
    # Of a range of the input, points without order stay in it.
    inside = S.PathGeneration(
        four_bar(), "P", ARC, ordered=False, travel=(0.0, 1.0), start_timing=[0.5, 0.2, 1.1, 0.4, 0]
    )
    np.testing.assert_allclose(
        inside.own(inside.extras.home), [0.5, 0.2, 1.1, 0.4, 0, 0.5, 0.8, -0.1, 0.6, 1.0], atol=1e-12
    )
    for more, words in (
        ({"timing": TIMING, "start_timing": TIMING}, "timing= says where the input is at each target; leave it out"),
        ({"timing": TIMING, "ordered": False}, "ordered=False makes those of the nearest points"),
        ({"start_timing": [0.1, 0.3, 0.2, 0.4, 0.5]}, "start_timing must rise, or fall"),
        ({"start_timing": [10, 30, 20, 40, 50], "ordered": False}, "start_timing goes over 40 rad"),
    ):
        with pytest.raises(nc.InputError, match=words):
            S.PathGeneration(four_bar(), "P", ARC, **more)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_crank_is_found_whichever_way_it_turns(sense):
    # Points of a known four-bar, its crank at equal steps one way or the other, which the problem does not know.
    known, steps = four_bar().compile(), np.radians([0, 40, 80, 120, 160])
    target = np.asarray(nc.sweep(known, {"phi": 0.9 + sense * steps})["P"])
    problem = S.PathGeneration(four_bar(), "P", target, timing=steps, offset=True, either_sense=True, free=["C", "P"])
    found = S.solve(problem, **(FEW | {"iterations": 200}))
    best = found.designs[0]
    assert found.found and best.error < 1e-18
    np.testing.assert_allclose(np.diff(best.inputs), sense * np.diff(steps), rtol=1e-12)
    np.testing.assert_allclose(np.asarray(nc.sweep(best.system, {"phi": best.inputs})["P"]), target, atol=1e-8)
    with pytest.raises(nc.InputError, match=r"either_sense=True.*timing=.*offset="):
        S.PathGeneration(four_bar(), "P", target, either_sense=True)


def test_a_size_counts_markers():
    """The marker P of the coupler sticks out beyond all joints."""
    m = four_bar()
    m.marker("far", "coupler", at=(2, 8))
    system = m.compile()
    turn = nc.sweep(system, {"phi": jnp.linspace(0.0, 2 * np.pi, 25)})
    spots = [*system.topology.points, "far"]
    extent = np.ptp(np.concatenate([np.asarray(turn[name]) for name in spots]), axis=0).max()
    for most in (0.99 * extent, 1.01 * extent):
        found = np.asarray(S.size(most).values(Seen(system, turn, turn, 1.0)))
        assert found.min() == pytest.approx(most - extent, abs=1e-12)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: S.equal(("A", "B"), -2.0), "zero or more"),
        (lambda: S.equal(("A", "B"), np.nan), "zero or more"),
        (lambda: S.length("A", "B", max=-1.0), "zero or more"),
        (lambda: S.crank_turns(margin=np.nan), "margin"),
        (lambda: S.local("P", ("B", "C", "D"), x=(0, 1)), "two points"),
        (lambda: S.local("P", ("B", "B"), x=(0, 1)), "two points"),
        (lambda: path(subject_to=[S.within("P", z=(0, 1))]), "z="),
    ],
)
def test_conditions_that_cannot_hold_are_refused(make, said):
    with pytest.raises(nc.InputError, match=said):
        make()


def test_what_holds_back_between_poses_is_named():
    """A region just touched in the poses of the search is not touched in the finer ones of the judge."""
    asked = [S.crank_turns(), S.clear_of([(-9.0, -9.0), (9.0, 0.5)], width=0.1)]
    found = S.solve(path(subject_to=asked), starts=40, refine=8, keep=1, iterations=5, progress=False).designs[0]
    assert found.error > 1e-5 and any("clear of" in name for name in found.binding)


@pytest.mark.parametrize("driven", [None, "phi"])
def test_a_problem_file_is_in_the_units_of_the_input_of_its_run(tmp_path, driven):
    """Two angles, of which the run's is driven: timing, travel and a margin of the input are in degrees."""
    m = four_bar()
    m.angle("psi", at="D", to="C")
    m.model.units.angle = "deg"
    m.model.run = record.Run(inputs={"phi": record.Drive(0.0, 360.0, 10)})
    m.save(tmp_path / "idea.toml")
    said = "" if driven is None else f'input = "{driven}"'
    (tmp_path / "problem.toml").write_text(
        f"""kind = "path"
        mechanism = "idea.toml"
        point = "P"
        {said}
        target = {np.asarray(ARC).tolist()}
        timing = [30, 45, 60, 75, 90]
        travel = [0, 360]
        conditions = [{{ type = "no flip", input = 5 }}]
        """
    )
    problem, _ = load_problem(tmp_path / "problem.toml")
    np.testing.assert_allclose(problem.timing, TIMING)
    np.testing.assert_allclose(problem.travel, [0.0, 2 * np.pi])
    margin = problem.conditions[0]
    assert margin.input == pytest.approx(np.radians(5))


def test_free_timings_stay_within_the_travel_that_is_given():
    low, high = 1.4, 2.0
    problem = S.PathGeneration(four_bar(), "P", ARC, travel=(low, high))
    result = S.solve(problem, **FEW)
    assert result.found
    assert low - 1e-6 <= result.designs[0].inputs.min() and result.designs[0].inputs.max() <= high + 1e-6


def test_two_conditions_of_one_name_have_each_its_margin():
    """What one of them misses between the poses of the search is made up for by its own margin, not by both."""
    bounded = [S.condition(lambda motion, k=k: 5.0 - motion["P"][..., k], over_range=True) for k in (0, 1)]
    result = S.solve(path(subject_to=[S.crank_turns(), *bounded]), **FEW)
    assert result.found and not result.designs[0].defects
    turn = nc.sweep(result.best, {"phi": np.linspace(*result.designs[0].turn.inputs["phi"][np.array([0, -1])], 3601)})
    assert np.asarray(turn["P"]).max() <= 5.0 + 1e-5


def test_a_result_that_found_nothing_reads_back_as_it_was(tmp_path):
    wrong = [S.length("A", "B", max=0.5), S.equal(("C", "D"), 9.0), S.equal(("B", "C"), 1.0)]
    problem = path(subject_to=wrong)
    settings = {"starts": 60, "refine": 4, "keep": 2, "progress": False}
    for number, result in enumerate((S.solve(problem, **settings), S.solve(path(), **settings, seconds=0.01))):
        result.save(tmp_path / str(number))
        assert str(S.load(tmp_path / str(number), result.problem)) == str(result)


@pytest.mark.parametrize(
    ("state", "words"),
    [
        (lambda: S.on_circuit("left", joint=("B", "C")), "names of three points"),
        (lambda: S.transmission_angle(0.3, joint=("B", "C", "D", "A")), "names of three points"),
        (lambda: S.transmission_angle(0.3, joint=("B", "B", "B")), "names of three points"),
        (lambda: S.equal(("A", "A"), 1.0), "two points"),
        (lambda: S.direction("A", "A", 1.0), "two points"),
        (lambda: S.pareto(path(minimax=True), {"x": lambda motion: motion["P"][0]}), "minimax"),
    ],
)
def test_conditions_that_mean_nothing_are_refused_where_they_are_stated(state, words):
    with pytest.raises(nc.errors.InputError, match=words):
        state()
