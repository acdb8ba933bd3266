"""The closed square residual: its roots are the poses of the library, with the same derivatives."""

import functools
from importlib.util import find_spec

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.io.drives import sweep_arguments

CLOSE = 1e-12  # of numbers of size one: what Newton leaves of a root, against another Newton's
SLOPE = 1e-9  # of the largest derivative


def newton(equations, steps=8):
    """Anyone's own, in three lines."""

    def step(_, x):
        return x - jnp.linalg.solve(equations.jacobian(x), equations.residual(x))

    return jax.lax.fori_loop(0, steps, step, equations.start)


@functools.cache
def four_bar():
    return nc.library.four_bar().compile()


OF_EACH_CLASS = (
    "bennett",
    "delta-robot",
    "peaucellier-lipkin",
    "rccc",
    "slider-crank",
    "spherical-four-bar",
)


@pytest.mark.parametrize("name", OF_EACH_CLASS)
def test_the_root_is_the_pose_of_the_library(name):
    """Also of mechanisms with redundant rows: Newton from a pose nearby ends at the same pose."""
    mechanism = nc.library.CATALOGUE[name]()
    system, run = mechanism.compile(), sweep_arguments(mechanism)
    here, there = ({k: v[int(part * len(v))] for k, v in run["inputs"].items()} for part in (0.3, 0.31))
    hold = run["hold"]
    before = nc.solve_position(system, here, hold=hold)
    pose = nc.solve_position(system, there, hold=hold, start=before)

    @nc.jit
    def solved(system, inputs, start):
        equations = nc.system.closed(system, inputs, hold=hold, start=start)
        x = newton(equations)
        return equations.pose(x), equations.residual(x), equations.jacobian(x)

    found, rows, matrix = solved(system, there, before)
    size = float(np.abs(np.asarray(pose.q)).max())
    assert int(found.status) == 0 and float(jnp.abs(rows).max()) <= 1e-13 * size
    np.testing.assert_allclose(found.q, pose.q, rtol=0, atol=CLOSE * size)
    assert matrix.shape[0] == matrix.shape[1] == len(rows) == len(system.topology.unknown) - system.degrees_of_freedom


def slopes(f, system, value):
    """A value, and its derivatives by the design and the input as one array."""
    found, (of_design, of_input) = jax.jit(jax.value_and_grad(f, argnums=(0, 1)))(system, value)
    par = of_design.parameters
    parts = (par.points, par.vectors, par.markers, par.dimensions, of_input)
    return float(found), np.concatenate([np.ravel(x) for x in parts])


def one_step(equations, steps=8):
    """A root with its implicit derivatives: one more step of Newton from a root that is held."""
    x = jax.lax.stop_gradient(newton(equations, steps))
    matrix = jax.lax.stop_gradient(equations.jacobian(x))
    return x - jnp.linalg.solve(matrix, equations.residual(x))


@pytest.mark.parametrize(
    ("name", "redundancy"),
    [
        ("four-bar", "independent rows"),
        ("parallelogram", "least squares"),
    ],
)
def test_derivatives_of_the_root_are_those_of_the_library(name, redundancy):
    """By design and input; of redundant rows by least squares, as the library follows what contradicts them."""
    mechanism = nc.library.CATALOGUE[name]()
    system, run = mechanism.compile(), sweep_arguments(mechanism)
    ((driven, values),) = run["inputs"].items()
    value = float(values[len(values) // 20])
    weights = np.random.default_rng(3).uniform(0.5, 1.5, len(system.topology.coordinates))

    def ours(system, value):
        return jnp.dot(weights, nc.solve_position(system, {driven: value}, throw=False, repair=False).q)

    def theirs(system, value):
        equations = nc.system.closed(system, {driven: value}, redundancy=redundancy)
        return jnp.dot(weights, equations.pose(one_step(equations, 20)).q)

    (place, wanted), (found, got) = slopes(ours, system, value), slopes(theirs, system, value)
    assert found == pytest.approx(place, abs=1e-12)
    np.testing.assert_allclose(got, wanted, rtol=0, atol=SLOPE * np.abs(wanted).max())


def test_chosen_rows_follow_a_design_that_still_closes():
    """A parallelogram that grows as a whole, and its input."""
    system = nc.library.parallelogram().compile()

    def reach(grown, value, found):
        design = jax.tree.map(lambda leaf: grown * leaf, system)
        return found(design, value)["D"][1]

    def theirs(system, value):
        equations = nc.system.closed(system, {"phi": value})
        return equations.pose(one_step(equations))

    both = jax.jit(lambda *x: [jax.grad(reach, argnums=(0, 1))(*x, f) for f in (posed, theirs)])
    by_all, by_chosen = both(1.0, 1.2)
    np.testing.assert_allclose(by_chosen, by_all, atol=1e-12)
    equations = nc.system.closed(system, {"phi": 1.2})
    assert repr(equations) == "ClosedEquations('parallelogram': 6 unknowns, 6 of 7 rows)"
    equations = nc.system.closed(system, {"phi": 1.2}, redundancy="least squares")
    assert repr(equations) == "ClosedEquations('parallelogram': 6 unknowns, 7 rows by least squares)"
    assert len(equations.rows) == 7 and equations.residual(equations.start).shape == (6,)


def test_held_coordinates_keep_their_value_and_follow_the_drawing():
    system = nc.library.five_bar().compile()
    driven, held = (n for n in system.topology.scalars[:2])

    def place(system, value, equations=True):
        if not equations:
            return jnp.sum(nc.solve_position(system, {driven: value}, hold=held, throw=False).q)
        found = nc.system.closed(system, {driven: value}, hold=held)
        return jnp.sum(found.pose(one_step(found)).q)

    value = float(nc.solve_position(system, {n: 1.0 for n in (driven, held)}, throw=False)[driven])
    start = nc.system.closed(system, {driven: value}, hold=[held])
    assert held not in start.unknowns and driven not in start.unknowns and start.known.shape == (2,)
    both = jax.jit(lambda s: [jax.grad(place)(s, value, which).parameters.points for which in (False, True)])
    wanted, got = map(np.asarray, both(system))
    np.testing.assert_allclose(got, wanted, atol=1e-9 * np.abs(wanted).max())


def test_a_held_coordinate_that_is_given_by_name_stays_there_in_traced_code():
    """It went back to where it is drawn, in `solve_position` too: a structure has none of the names."""
    system = nc.library.five_bar().compile()
    driven, held = system.topology.scalars[:2]
    drawn = nc.system.closed(system, {driven: 1.0}, hold=held)
    value = float(drawn.known[1]) + 0.1
    for made in (
        lambda s: nc.system.closed(s, {driven: 1.0}, hold=held, start={held: value}).known[1],
        lambda s: nc.solve_position(s, {driven: 1.0}, hold=held, start={held: value}, throw=False)[held],
    ):
        assert float(made(system)) == pytest.approx(value) == pytest.approx(float(jax.jit(made)(system)))


def test_a_pose_says_whether_it_closes_and_by_how_much_it_does_not():
    equations = nc.system.closed(four_bar(), {"phi": 40.0}, unit="deg")
    assert equations.unknowns == ("B.x", "B.y", "C.x", "C.y") and len(equations.rows) == 4
    pose = equations.pose(equations.start)
    assert int(pose.status) == nc.Status.DID_NOT_ASSEMBLE and float(pose.residual) > 1e-3
    pose = equations.pose(newton(equations))
    assert bool(pose.converged) and float(pose.inputs["phi"]) == pytest.approx(np.radians(40.0))
    np.testing.assert_allclose(pose["C"], nc.solve_position(four_bar(), {"phi": np.radians(40.0)})["C"], atol=1e-14)


def test_equations_of_single_precision_stay_so():
    equations = nc.system.closed(four_bar().astype("float32"), {"phi": 0.9})
    assert equations.residual(equations.start).dtype == equations.jacobian(equations.start).dtype == np.float32
    assert bool(equations.pose(newton(equations)).converged)


def test_a_large_system_has_a_residual_and_no_dense_jacobian():
    mechanism = nc.library.four_bar_chain(6)
    small, large = mechanism.compile(), mechanism.compile(sparse=True)
    dense, equations = (nc.system.closed(s, {"phi": 1.3}) for s in (small, large))
    x = dense.start + 0.001
    step = jnp.linalg.solve(jax.jacfwd(equations.residual)(x), equations.residual(x))  # rows are scaled otherwise
    np.testing.assert_allclose(step, jnp.linalg.solve(dense.jacobian(x), dense.residual(x)), atol=1e-13)
    with pytest.raises(nc.InputError, match=r"jacobian.*dense.*sparse"):
        equations.jacobian(x)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (lambda s: nc.system.closed(s, {"psi": 1.0}), "'psi'.*did you mean 'phi'"),
        (lambda s: nc.system.closed(s, {}), "too few inputs.*'four-bar'"),
        (lambda s: nc.system.closed(s, {"phi": 1.0, "B.x": 0.0}), "too many inputs"),
        (lambda s: nc.system.closed(s, {"phi": np.nan}), "input 'phi'.*NaN or infinite"),
        (lambda s: nc.system.closed(s, {"phi": [1.0, 2.0]}), r"one pose.*shape \(2,\): map"),
        (lambda s: nc.system.closed(s, 0.3), "by name.*float|must be a mapping"),
        (lambda s: nc.system.closed(s, {"phi": 1.0}, redundancy="rows"), "did you mean 'independent rows'"),
        (lambda s: nc.system.closed(s, {"phi": 1.0}, hold="B.q"), "no coordinate 'B.q' to hold"),
        (lambda s: nc.system.closed(s, {"phi": 1.0}, start={"Q": (0, 0)}), "no point or coordinate 'Q'"),
        (lambda s: nc.system.closed(nc.library.four_bar(), {"phi": 1.0}), "compile"),
        (
            lambda s: nc.system.closed(s, {"phi": 1.0}).residual(jnp.zeros(5)),
            r"'four-bar'.*\(4,\), got \(5,\)",
        ),
        (lambda s: nc.system.closed(s, {"phi": 1.0}).jacobian("x"), "x, .*'four-bar'.*must be a number"),
        (lambda s: nc.system.closed(s, {"phi": 1.0}).pose(jnp.zeros((2, 4))), r"\(4,\), got \(2, 4\)"),
    ],
)
@pytest.mark.parametrize("traced", [False, True])
def test_what_is_wrong_is_said_in_one_sentence(given, said, traced):
    with pytest.raises(nc.JaxncError, match=said) as error:
        jax.jit(given)(four_bar()) if traced else given(four_bar())
    assert "\n" not in str(error.value).partition("\n-----")[0]  # behind it JAX says how it shortens a traceback


# -- solvers of others ------------------------------------------------------------------------------------------------

needs_optimistix = pytest.mark.skipif(not find_spec("optimistix"), reason="no optimistix")


def root(system, value):
    """As the guide has it."""
    import optimistix as optx

    equations = nc.system.closed(system, {"phi": value})
    solver = optx.Newton(rtol=1e-12, atol=1e-12)
    found = optx.root_find(lambda x, equations: equations.residual(x), solver, equations.start, args=equations)
    return equations.pose(found.value)


@needs_optimistix
def test_optimistix_finds_the_pose_and_its_derivatives():
    """Redundant rows, which make no difference to a solver of others, see above."""
    system = four_bar()
    values = np.linspace(0.8, 1.4, 4)
    wanted = nc.solve_position(system, {"phi": values})
    scales = np.append(np.ones(4), 1.1)  # of designs: the last one is larger
    designs = jax.tree.map(lambda leaf: np.multiply.outer(scales, leaf), system)
    found = jax.jit(jax.vmap(root))(designs, np.append(values, 0.8)).q
    np.testing.assert_allclose(found[:4], wanted.q, atol=1e-12)
    places = 2 * len(system.topology.points)
    np.testing.assert_allclose(found[4, :places], 1.1 * np.asarray(wanted.q)[0, :places], atol=1e-12)

    def slopes_of(find):
        """By the design and the input, and twice by the input: in one program."""
        by_both = jax.grad(lambda s, x: jnp.sum(find(s, x)["C"]), argnums=(0, 1))
        twice = jax.grad(jax.grad(lambda x: find(system, x)["C"][0]))
        return jax.jit(lambda s, x: (*by_both(s, x), twice(x)))(system, 1.0)

    (design, angle, twice), (our_design, our_angle, ours) = slopes_of(root), slopes_of(posed)
    np.testing.assert_allclose(design.parameters.points, our_design.parameters.points, atol=1e-9)
    np.testing.assert_allclose(design.parameters.dimensions, our_design.parameters.dimensions, atol=1e-9)
    assert float(angle) == pytest.approx(float(our_angle), rel=1e-9)
    assert float(twice) == pytest.approx(float(ours), rel=1e-7)


def posed(system, value):
    return nc.solve_position(system, {"phi": value}, throw=False)


@needs_optimistix
def test_lineax_takes_the_jacobian():
    import lineax as lx

    @jax.jit
    def solved(value):
        equations = nc.system.closed(four_bar(), {"phi": value})
        x = equations.start
        for _ in range(8):
            x = x - lx.linear_solve(lx.MatrixLinearOperator(equations.jacobian(x)), equations.residual(x)).value
        return equations.pose(x)

    np.testing.assert_allclose(solved(1.0).q, posed(four_bar(), 1.0).q, atol=1e-13)
