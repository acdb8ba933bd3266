"""Systems with 32-bit numbers against the same with 64-bit ones."""

import dataclasses
import subprocess
import sys
import textwrap

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import ROOT

import jaxnc as nc
from jaxnc.constraints.elementary import cos, sin
from jaxnc.solvers.plan import plan
from jaxnc.system.precision import NARROW, WIDE, active
from jaxnc.system.topology import INDEX

ROUNDING = 2.0**-24  # of 32-bit numbers
DIGITS = 50 * ROUNDING  # of the size: a few roundings, magnified by the condition of a good pose
RATES = 3 * DIGITS  # of the largest: the same once more
EDGE = 0.03  # radians from a dead point within which 32-bit numbers may say otherwise
NEAR = DIGITS / np.sqrt(EDGE)  # of the size: a pose goes with the root of the distance from the dead point


def drawn_four_bar() -> nc.Mechanism:
    """A crank-rocker, with an explicit length that can keep the crank from turning."""
    m = nc.Mechanism("four-bar")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    for name, at in (("B", (0, 1)), ("C", (3.3, 2.9)), ("P", (1.8, 2.6))):
        m.point(name, at)
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C", "P"])
    m.body("rocker", ["C", "D"], lengths={("C", "D"): 3.0})
    m.angle("phi", at="A", to="B")
    return m


@pytest.fixture(scope="module")
def four_bar() -> nc.System:
    return drawn_four_bar().compile()


@pytest.fixture(scope="module")
def rocking(four_bar) -> nc.System:
    """Its crank travels from 0.7117 to 1.7668."""
    return four_bar.replace({"rocker.C-D": 0.5})


def off(a: nc.Motion, b: nc.Motion, size: float) -> float:
    return float(jnp.max(jnp.abs(a.q - b.q))) / size


def leaves(tree) -> np.ndarray:
    return np.concatenate([np.asarray(x).reshape(-1) for x in jax.tree.leaves(tree)])


def test_a_system_is_calculated_with_numbers_like_its_own(four_bar):
    narrow = four_bar.astype("float32")
    assert (narrow.dtype, four_bar.dtype) == (NARROW, WIDE)
    assert narrow.astype("float32") is narrow
    assert drawn_four_bar().compile(dtype="float32").dtype == NARROW
    turn = np.linspace(0, 2 * np.pi, 33)
    wide, motion = (nc.sweep(s, {"phi": turn}, rates={"phi": 2.0}) for s in (four_bar, narrow))
    arrays = (motion.q, motion.asked, motion.residual, motion.conditioning, *motion.rates)
    assert {str(x.dtype) for x in arrays} == {"float32"}
    assert active() == WIDE  # the setting is as it was
    assert not motion.failures
    assert off(motion, wide, 5.0) < DIGITS
    for a, b in zip(motion.rates, wide.rates, strict=True):
        assert float(jnp.max(jnp.abs(a - b))) < RATES * float(jnp.max(jnp.abs(b)))
    assert narrow.replace({"C": np.array([3.2, 2.9])}).dtype == NARROW
    pose = nc.solve_position(narrow, {"phi": 0.7})
    assert abs(float(pose["phi"]) - 0.7) < 1e-7
    assert nc.system.residual(narrow, pose.q).dtype == nc.system.jacobian(narrow, pose.q).dtype == NARROW


def test_statuses_are_those_of_64_bits_away_from_dead_points(rocking):
    phi = np.random.default_rng(5).uniform(0.3, 2.2, 600)
    sure = np.min(np.abs(phi[:, None] - np.array([0.711725789839, 1.76678443261])), axis=1) > EDGE
    wide, narrow = (nc.solve_position(s, {"phi": phi}) for s in (rocking, rocking.astype("float32")))
    assert 100 < int(np.sum(np.asarray(wide.status)[sure] != 0)) < 500
    np.testing.assert_array_equal(np.asarray(narrow.status)[sure], np.asarray(wide.status)[sure])
    right = sure & np.asarray(wide.converged)
    assert float(np.max(np.abs(np.asarray(wide.q - narrow.q)[right]))) < 5.0 * NEAR


def test_a_sweep_stops_at_the_same_pose(rocking):
    phi = np.linspace(1.0, 2.0, 41)
    wide, narrow = (nc.sweep(s, {"phi": phi}) for s in (rocking, rocking.astype("float32")))
    np.testing.assert_array_equal(np.asarray(narrow.status), np.asarray(wide.status))
    assert 0 < int(wide.failures) < 41


def test_derivatives_under_every_order_of_transformations(four_bar):
    """Rules of JAX are also called when the width of the system's numbers is no longer in force."""
    narrow, turn = four_bar.astype("float32"), np.linspace(0.2, 1.4, 12)

    def cost(s):
        return jnp.sum(nc.sweep(s, {"phi": turn})["P"] ** 2)

    expected = leaves(jax.grad(cost)(four_bar))
    size = np.max(np.abs(expected))
    found = jax.jit(jax.grad(cost))(narrow)
    assert found.dtype == NARROW
    np.testing.assert_allclose(leaves(found), expected, atol=RATES * size)
    several = jax.tree.map(lambda x: jnp.stack([x, x]), narrow)
    found = jax.vmap(jax.jit(cost))(several)
    assert found.dtype == NARROW
    np.testing.assert_allclose(found, float(cost(four_bar)), rtol=DIGITS)
    found = jax.vmap(jax.grad(jax.jit(cost)))(several)
    np.testing.assert_allclose(leaves(jax.tree.map(lambda x: x[1], found)), expected, atol=RATES * size)


def test_a_failed_pose_leaves_gradients_finite(rocking):
    def cost(s):
        return jnp.sum(nc.solve_position(s, {"phi": np.linspace(1.0, 2.0, 12)})["P"])

    narrow, wide = (leaves(jax.grad(cost)(s)) for s in (rocking.astype("float32"), rocking))
    assert np.all(np.isfinite(narrow))
    assert np.any(wide)


@pytest.mark.parametrize("reach", [4.0, 10_000.0])
def test_sine_and_cosine_of_32_bits(reach):
    x = np.random.default_rng(8).uniform(-reach, reach, 100_000).astype(np.float32)
    for ours, exact in ((sin, np.sin), (cos, np.cos)):
        found = np.asarray(jax.jit(ours)(x))
        assert found.dtype == NARROW
        assert np.max(np.abs(found.astype(float) - exact(x.astype(float)))) < 4 * ROUNDING  # two last places of 1


def test_reports_are_made_with_64_bits(rocking):
    narrow = rocking.astype("float32")
    same = nc.travel(narrow.astype("float64"), "phi")
    assert str(nc.travel(narrow, "phi")) == str(same)
    assert nc.mobility(narrow).rank == nc.mobility(rocking).rank
    assert active() == WIDE


@pytest.mark.parametrize("make", [nc.library.bennett, nc.library.parallelogram])
def test_redundant_rows_may_contradict_each_other_by_rounding(make):
    """Both linkages have fewer freedoms by their count, and turn fully: Bennett, Engineering 76 (1903); Norton."""
    narrow, turn = make().compile(dtype="float32"), np.linspace(1.0, 7.2, 40)
    assert nc.travel(narrow, "phi").turns
    assert nc.diagnose(narrow, {"phi": 4.1}).reachable
    for motion in (nc.circuit(narrow, "phi", poses=50), nc.sweep(narrow.astype("float64"), {"phi": turn})):
        assert not motion.failures
        if make is nc.library.parallelogram:
            phi = np.asarray(motion["phi"])
            corner = np.stack([0.3 + 0.1 * np.cos(phi), 0.1 * np.sin(phi)], axis=1)
            np.testing.assert_allclose(motion["C"], corner, atol=0.3 * DIGITS)


def test_rounding_splits_no_solution_that_is_not_isolated():
    """Where the rhombus of an inversor folds, one of its corners turns freely: four of eight ends are no assemblies."""
    narrow = nc.library.peaucellier_lipkin().compile(dtype="float32")
    found = nc.modes(narrow, {"phi": 0.7})
    assert (len(found), found.singular) == (4, 4) and all(c.exact for c in found.certificates)
    doubtful = [dataclasses.replace(c, exact=False) for c in found.certificates]
    lines = str(dataclasses.replace(found, certificates=tuple(doubtful))).splitlines()
    assert lines[-1].startswith("  3: not certified, conditioning")
    assert len(nc.circuits(narrow, {"phi": np.linspace(0.5, 1.0, 4)})) == 4


def test_static_indices_serve_both_widths(four_bar):
    """JAX remembers what it made of an int64 array, whatever its setting was then."""
    view = plan(four_bar.topology, ("phi",), (), 1)
    arrays = [view.known, view.unknown, view.fixed, view.inverse, view.rows, *view.gathers]
    arrays += [a for pair in view.blocks for a in pair]
    arrays += [a for one in four_bar.topology.layout for a in vars(one).values()]
    assert {a.dtype for a in arrays} == {np.dtype(INDEX)}


def test_other_types_are_refused(four_bar):
    for wrong in ("float16", "int32", "wide"):
        with pytest.raises(nc.InputError, match=f"dtype='{wrong}'.*'float64'.*'float32'"):
            four_bar.astype(wrong)
    with pytest.raises(nc.InputError, match="dtype='float16'"):
        drawn_four_bar().compile(dtype="float16")
    for misplaced in ("float32", np.float32, 2):
        with pytest.raises(nc.InputError, match=r"sparse must be .*dtype='float32'"):
            drawn_four_bar().compile(misplaced)  # type: ignore[arg-type]
    with pytest.raises(nc.InputError, match="kept sparse"):
        drawn_four_bar().compile(sparse=True, dtype="float32")


def test_without_64_bit_numbers():
    """With JAX as it comes: what compile() asks for, and a system with 32-bit numbers."""
    script = """
        import sys
        sys.path += ["tests", "tests/system"]
        import warnings
        warnings.simplefilter("error")
        import jax, numpy as np, jaxnc as nc
        from test_precision import drawn_four_bar
        jax.config.update("jax_enable_x64", False)
        try:
            drawn_four_bar().compile()
        except nc.JaxncError as error:
            assert 'compile(dtype="float32")' in str(error), error
        system = drawn_four_bar().compile(dtype="float32")
        motion = nc.sweep(system, {"phi": np.linspace(0, 2 * np.pi, 33)}, rates={"phi": 2.0})
        assert not motion.failures and motion.q.dtype == np.float32
        print(float(motion["C"][7, 0]))
        print(nc.mobility(system).rank)
        try:
            system.astype("float64")
            raise SystemExit("not refused")
        except nc.JaxncError as error:
            assert "64-bit" in str(error), error
    """
    run = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, cwd=ROOT, timeout=300
    )
    assert run.returncode == 0, run.stderr[-2000:]
    x, rank = run.stdout.split()
    wide = nc.sweep(drawn_four_bar().compile(), {"phi": np.linspace(0, 2 * np.pi, 33)})
    assert abs(float(x) - float(wide["C"][7, 0])) < 5.0 * DIGITS
    assert int(rank) == nc.mobility(drawn_four_bar().compile()).rank


@pytest.mark.slow
@pytest.mark.parametrize("name", ["slider_crank", "macpherson"])
def test_other_mechanisms(name):
    system = getattr(nc.library, name)().compile()
    if name == "macpherson":
        inputs, hold, size = {"6.z": np.random.default_rng(7).uniform(270, 350, 600)}, ("10.y", "7.x"), 800.0
    else:
        inputs, hold, size = {"phi": np.random.default_rng(7).uniform(-6, 6, 600)}, (), 0.5
    narrow = system.astype("float32")
    wide, found = (nc.solve_position(s, inputs, hold=hold) for s in (system, narrow))
    np.testing.assert_array_equal(np.asarray(found.status), np.asarray(wide.status))
    assert off(wide, found, size) < DIGITS
    assert found.q.dtype == NARROW
