"""Problems of synthesis as pytrees, what is compiled for them, and poses of many designs on the host."""

import io
import pickle
import sys
import types

import jax
import numpy as np
import pytest

import jaxnc as nc
from benchmarks.synthesis.published import ARC, four_bar, lengths
from jaxnc.kinematics.design import geometry_vector, with_geometry
from jaxnc.progress import is_watched
from jaxnc.synthesis import loops
from jaxnc.synthesis.evaluate import (
    Evaluator,
    meeting_sines,
    move_designs,
    solve_changes,
    solve_poses,
)
from jaxnc.synthesis.search.goal import Goal

S = nc.synthesis
_EVENTS: list[str] = []
jax.monitoring.register_event_duration_secs_listener(lambda name, *_, **__: _EVENTS.append(name.rsplit("/", 1)[-1]))


def worked(run) -> list[str]:
    """What JAX traced, lowered or compiled in a run."""
    first = len(_EVENTS)
    run()
    wanted = ("jaxpr_trace_duration", "jaxpr_to_mlir_module_duration", "backend_compile_duration")
    return [name for name in _EVENTS[first:] if name in wanted]


def path(k: float):
    points = np.array(ARC) + 0.01 * k
    weights = 1.0 + 0.1 * k * np.arange(len(points))
    limits = [S.crank_turns("crank-rocker", margin=0.001 * k), S.local("P", ("B", "C"), (-50 - k, 50), (-50, 50))]
    timing = np.radians([30, 45, 60, 75, 90]) + 0.01 * k
    return S.PathGeneration(
        four_bar(), "P", points, timing, free=["D.x", "B", "C", "P"], bounds=lengths(0, 50 + k), subject_to=limits,
        weights=weights,
    )  # fmt: skip


def function(k: float):
    x = np.linspace(0.2, 1.4 + 0.1 * k, 9)
    return S.FunctionGeneration(
        four_bar(tracer=False), "psi", x, (0.9 + 0.1 * k) * x**1.3, input="phi", free=["B", "C"],
        bounds={"B": (-3, 3 + k)}, output_offset=True, minimax=True,
        subject_to=[S.transmission_angle(0.3 + 0.05 * k), S.length("B", "C", min=0.5 + 0.1 * k)],
    )  # fmt: skip


def suspension(k: float):
    travel = np.linspace(290.0, 330.0 + k, 5)
    return S.FunctionGeneration(
        nc.library.double_wishbone(), "toe", travel, 1e-4 * k * np.arange(5), input="wheel_centre.z",
        hold=("tie_inner.y", "rim.x"), free=["tie_outer.z"], bounds={"tie_outer.z": (200 - k, 260 + k)},
        output_offset=True,
    )  # fmt: skip


@pytest.mark.parametrize("make", [path, function, suspension])
def test_a_second_problem_of_the_same_shape_traces_nothing(make):
    settings = {"starts": 4, "refine": 2, "iterations": 3, "progress": False}
    if not worked(lambda: S.solve(make(0.0), **settings)):  # a test before has solved one of the same shape
        jax.clear_caches()
        assert worked(lambda: S.solve(make(0.0), **settings)), "or else this test would see nothing"
    assert worked(lambda: S.solve(make(0.5), **settings)) == []
    loaded = pickle.loads(pickle.dumps(make(1.0)))
    assert worked(lambda: S.solve(loaded, **settings, key=jax.random.key(3))) == []


def test_numbers_of_a_problem_are_leaves_and_the_rest_is_its_structure():
    one, other = path(0.0), path(0.5)
    assert jax.tree.structure(one) == jax.tree.structure(other)
    again = jax.tree.unflatten(*reversed(jax.tree.flatten(other)))
    np.testing.assert_array_equal(again.target, other.target)
    assert again.names == other.names and again.mechanism is None
    assert again.conditions == other.conditions
    # A bound that is none, another kind of condition, another count of targets make another structure.
    bounds = [S.length("A", "B", min=1.0), S.length("A", "B", max=1.0), S.length("A", "B", 0.5, 2.0)]
    assert len({jax.tree.structure(c) for c in bounds}) == 3
    assert jax.tree.structure(S.transmission_angle(0.4)) == jax.tree.structure(S.transmission_angle(0.7))


PHI = np.linspace(0.3, 2.0, 6)
PROBLEMS = {
    "dyads": lambda: S.PathGeneration(nc.library.jansen_leg(), "F", np.random.default_rng(0).normal(size=(6, 2)), PHI),
    "an angle": lambda: S.FunctionGeneration(four_bar(tracer=False), "psi", PHI, PHI, input="phi", input_offset=True),
    "a suspension": lambda: suspension(0.0),
}


@pytest.fixture(params=PROBLEMS, ids=lambda name: name)
def problem(request):
    """Of dyads, of an angle that is measured, of blocks without closed form."""
    return PROBLEMS[request.param]()


def test_poses_of_many_designs_are_those_of_sweeps(problem):
    rng = np.random.default_rng(1)
    x = problem.start + 0.01 * problem.scale * rng.normal(size=(6, problem.count))
    found, count = solve_poses(problem, x, 0), 0
    for one, q, status in zip(x, found.q, found.status, strict=True):
        motion = problem.move(one)
        good = status == 0
        assert np.asarray(motion.converged)[good].all()
        np.testing.assert_allclose(q[good], np.asarray(motion.q)[good], atol=1e-11 * problem.length)
        count += int(good.all())
    assert count >= 4


def test_derivatives_of_poses_are_those_of_differences(problem):
    rng = np.random.default_rng(2)
    x = problem.start + 0.003 * problem.scale * rng.normal(size=(4, problem.count))
    parts = list(solve_changes(problem, x, 0, "quick", 3))
    found = jax.tree.map(lambda *each: np.concatenate(each), *parts)
    ok = (found.status == 0).all(axis=1)
    assert ok.sum() >= 3 and found.changes is not None
    for j in range(problem.count):
        step = np.zeros(problem.count)
        step[j] = 1e-6 * problem.scale[j]
        up, down = (solve_poses(problem, x + way * step, 0).q for way in (1, -1))
        slope = (up - down) / (2 * step[j])
        size = max(1.0, float(np.abs(slope[ok]).max()))
        np.testing.assert_allclose(found.changes[ok, j], slope[ok], atol=2e-7 * size)


@pytest.mark.parametrize("name", [*PROBLEMS, "a turn"])
def test_derivatives_of_a_range_are_those_of_differences(name):
    """A whole turn begins at the drawing, wherever that is, and a range of tables where the free offset says."""
    how = {"closed": True, "free": ["A", "B", "C", "D", "P"], "subject_to": [S.transmission_angle(0.3)]}
    turn = S.PathGeneration(four_bar(), "P", np.array(ARC), **how)
    problem = turn if name == "a turn" else PROBLEMS[name]()
    x = problem.start + 0.003 * problem.scale * np.random.default_rng(2).normal(size=(3, problem.count))
    (found,) = (part.turn for part in solve_changes(problem, x, 12, "close", 3))
    ok = (found.status == 0).all(axis=1)
    assert ok.any()
    for j in range(problem.count):
        step = np.zeros(problem.count)
        step[j] = 1e-6 * problem.scale[j]
        up, down = (solve_poses(problem, x + way * step, 12, "close").turn.q for way in (1, -1))
        slope = (up - down) / (2 * step[j])
        np.testing.assert_allclose(found.changes[ok, j], slope[ok], atol=2e-7 * max(1.0, np.abs(slope[ok]).max()))


def test_more_designs_than_are_compiled_for_are_evaluated_as_each_by_itself():
    problem, rng = function(0.0), np.random.default_rng(4)
    x = problem.start + 0.02 * problem.scale * rng.normal(size=(21, problem.count))
    live, none = np.arange(21) != 3, np.zeros((21, 0))
    found = Evaluator(Goal(problem))(x, none, live)
    assert found[3][live].sum() >= 15 and not found[3][3]
    for k in np.flatnonzero(live):
        alone = Evaluator(Goal(problem))(x, none, np.arange(21) == k)
        for a, b in zip(found, alone, strict=True):
            np.testing.assert_allclose(a[k], b[k], rtol=1e-12, atol=1e-12)


def test_sines_on_the_host_are_those_of_conditions():
    for make in (path, function, lambda k: PROBLEMS["dyads"]()):
        problem = make(0.0)
        (one,) = move_designs(problem, [problem.start])
        compiled = np.asarray(jax.jit(loops.loop_sines)(one.turn))
        np.testing.assert_allclose(meeting_sines(problem, one.x, one.turn), compiled, atol=1e-14)


def test_a_design_that_does_not_assemble_reaches_no_target():
    problem = function(0.0)
    far = problem.start.copy()
    far[list(problem.names).index("C.x")] += 30.0
    _, _, slopes, ok = Evaluator(Goal(problem))(np.stack([problem.start, far]), np.zeros((2, 0)))
    assert np.isfinite(slopes).all()
    assert ok[0] == np.asarray(problem.move(problem.start).converged).all()
    assert ok[1] == np.asarray(problem.move(far).converged).all()


def test_a_drawing_that_does_not_fit_its_dimensions_is_assembled_as_ever():
    crank = nc.library.slider_crank(fixed_guide=True)
    problem = S.FunctionGeneration(
        crank, "C.x", np.linspace(0.3, 2.8, 6), np.linspace(0.4, 0.2, 6), free=["crank.A-B", "conrod.B-C"]
    )
    x = problem.start * np.array([[1.3, 1.0], [1.0, 1.4], [0.6, 1.2]])
    found = solve_poses(problem, x, 0)
    assert (found.status == 0).all()
    for one, q in zip(x, found.q, strict=True):
        flat = np.array(geometry_vector(problem.system))
        flat[problem.variables.at] = one
        motion = nc.sweep(with_geometry(problem.system, flat), {problem.driven: problem.values}, hold=problem.hold)
        np.testing.assert_allclose(q, motion.q, atol=1e-13)


def test_a_search_shows_its_progress_where_someone_watches_and_nowhere_else(capsys, monkeypatch):
    settings = {"starts": 2, "refine": 1, "iterations": 2}
    S.solve(function(0.0), **settings)
    assert capsys.readouterr().err == ""
    S.solve(function(0.0), **settings, progress=True)
    assert "FunctionGeneration with 'four-bar'" in capsys.readouterr().err
    monkeypatch.setattr("jaxnc.progress.is_watched", lambda: True)
    S.solve(function(0.0), **settings)
    assert "best error" in capsys.readouterr().err
    S.solve(function(0.0), **settings, progress=False)
    assert capsys.readouterr().err == ""


def test_who_watches(monkeypatch):
    class Shell:
        pass

    class ZMQInteractiveShell:
        pass

    class Stream(io.StringIO):
        def isatty(self):
            return self.terminal

    for terminal, shell, watching in ((False, None, False), (True, None, True), (False, Shell, False),
                                      (False, ZMQInteractiveShell, True)):  # fmt: skip
        stream = Stream()
        stream.terminal = terminal
        monkeypatch.setattr(sys, "stderr", stream)
        if shell is None:
            monkeypatch.delitem(sys.modules, "IPython", raising=False)
        else:
            kernel = types.SimpleNamespace(get_ipython=lambda made=shell: made())
            monkeypatch.setitem(sys.modules, "IPython", kernel)
        assert is_watched() == watching


@pytest.mark.parametrize("turn", [1, -1])
def test_whole_turns_of_a_table_do_not_matter(turn):
    """A rocker drawn near half a turn: its angles may be written on either side."""
    m = four_bar(tracer=False)
    system = m.compile()
    psi = np.asarray(nc.sweep(system, {"phi": PHI})["psi"])
    problem = S.FunctionGeneration(m, "psi", PHI, psi + 2.0 * np.pi * turn, input="phi")
    motion = nc.sweep(system, {"phi": PHI})
    assert np.abs(problem.misses(motion, np.zeros(0))).max() < 1e-12
