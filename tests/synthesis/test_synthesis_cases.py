"""Mechanisms other than four-bars, designed from the problem files of the examples as a user would."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import PROBLEMS

import jaxnc as nc
from jaxnc.io.problems import load_problem

S = nc.synthesis
DIGITS = 1e-9  # targets are written with ten digits


def test_a_slider_crank_is_recovered_from_its_function():
    problem, _ = load_problem(PROBLEMS / "slider.toml")
    result = S.solve(problem, starts=40, refine=8, key=jax.random.key(0), progress=False)
    assert result.found and result.broken == 0
    assert result.designs[0].largest <= DIGITS
    a, b, c = (np.asarray(result.best[n]) for n in "ABC")
    found = np.linalg.norm(b - a), np.linalg.norm(c - b), c[1] - a[1]
    np.testing.assert_allclose(found, [0.12, 0.35, 0.05], atol=1e-8)
    # The same by Pythagoras, at the angles of the table.
    phi = problem.values
    x = 0.12 * np.cos(phi) + np.sqrt(0.35**2 - (0.05 - 0.12 * np.sin(phi)) ** 2)
    np.testing.assert_allclose(result.motion()["C"][:, 0], x, atol=DIGITS)


def test_toe_is_a_target_and_its_offset_is_fitted():
    problem, search = load_problem(PROBLEMS / "bump_steer.toml")
    assert problem.unit == "rad" and problem.names == ("tie_outer.z", "tie_inner.z", "output offset")
    assert (search.starts, search.refine) == (3, 4)
    motion = problem.move(problem.start)
    toe = np.degrees(np.asarray(nc.suspension(motion).toe))
    assert motion["wheel_centre"].shape == (9, 3) and toe.shape == (9,)
    change = np.abs(toe - toe[4]).max()
    assert 0.1 <= change <= 0.2  # of the hardpoints that are kept in the repository
    errors = np.asarray(problem.errors(motion, jnp.zeros(1)))
    np.testing.assert_allclose(np.degrees(errors), toe, atol=1e-12)
    x, left = problem.fit(problem.start[None], errors[None] / problem.size)
    np.testing.assert_allclose(np.degrees(x[0, -1]), toe.mean(), atol=1e-12)
    np.testing.assert_allclose(np.degrees(left[0] * problem.size), toe - toe.mean(), atol=1e-12)


def test_a_suspension_is_asked_for_what_it_has():
    wishbone = nc.library.double_wishbone()
    values = np.linspace(290.0, 330.0, 3)
    hold = ("tie_inner.y", "rim.x")
    with pytest.raises(nc.InputError, match="no coordinate 'tow'; did you mean 'toe'"):
        S.FunctionGeneration(wishbone, "tow", values, np.zeros(3), input="wheel_centre.z", hold=hold)
    with pytest.raises(nc.InputError, match="no coordinate 'toe'"):
        S.FunctionGeneration(nc.library.slider_crank(), "toe", values, np.zeros(3))
    asked = {"input": "wheel_centre.z", "hold": hold}
    problem = S.FunctionGeneration(wishbone, "motion_ratio", values, np.zeros(3), **asked)
    spring = np.asarray(nc.sweep(wishbone.compile(), {"wheel_centre.z": values + 1e-3}, hold=hold)["damper"])
    motion = problem.move(problem.start)
    slope = (np.asarray(motion["damper"]) - spring) / 1e-3
    np.testing.assert_allclose(problem.errors(motion, jnp.zeros(0)), slope, rtol=1e-4)
    assert problem.unit == ""
    # Where the rack is no input, five links have no steering axis that is known.
    with pytest.raises(nc.InputError, match="no caster that is known"):
        S.FunctionGeneration(
            nc.library.five_link(), "caster", values, np.zeros(3), input="wheel_centre.z", hold=("tie_outer.y", "rim.x")
        )


def test_toe_of_a_right_wheel_is_that_of_its_mirror_image():
    model, values, errors = nc.library.double_wishbone().model, np.linspace(290.0, 330.0, 3), []
    places = {name: getattr(p, "at", p) for name, p in (model.ground | model.points).items()}
    for outward in (1.0, -1.0):
        m = nc.library.double_wishbone({name: (x, outward * y, z) for name, (x, y, z) in places.items()})
        asked = {"input": "wheel_centre.z", "hold": ("tie_inner.y", "rim.x")}
        problem = S.FunctionGeneration(m, "toe", values, np.zeros(3), **asked)
        errors.append(jax.jit(lambda x, p=problem: p.errors(p.move(x), jnp.zeros(0)))(problem.start))
    np.testing.assert_allclose(*errors, atol=1e-12)


# Paths take longest, for the value of their input in the drawing: one of them here, and path.toml in test_synthesis.
FILES = sorted(p for p in PROBLEMS.glob("*.toml") if p.stem not in ("path", "geared_five_bar"))


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_every_problem_file_states_a_problem(path):
    problem, search = load_problem(path)
    assert f"examples/problems/{path.name}" in path.read_text(encoding="utf-8")
    assert search.starts >= search.refine - 1 and problem.count > 0


def test_orientations_in_space_are_rotation_vectors(tmp_path):
    path = PROBLEMS / "spherical_motion.toml"
    problem, _ = load_problem(path)
    assert problem.turns.shape == (5, 3, 3)
    np.testing.assert_allclose(problem.turns[0], np.eye(3), atol=1e-14)
    # Each turns about its vector, by its length.
    vector = np.array([0.06641805238, -0.8180880331, -0.4302801196])
    np.testing.assert_allclose(problem.turns[4] @ vector, vector, atol=1e-12)
    assert np.trace(problem.turns[4]) == pytest.approx(1.0 + 2.0 * np.cos(np.linalg.norm(vector)), abs=1e-12)
    text = path.read_text(encoding="utf-8").replace("ideas/", f"{PROBLEMS}/ideas/")
    (tmp_path / "angles.toml").write_text(text.replace("[0, 0, 0],", "[0, 0],"), encoding="utf-8")
    with pytest.raises(nc.ModelFileError, match="orientations must be rotation vectors"):
        load_problem(tmp_path / "angles.toml")
