"""What is chosen for a design: by its structure and by what is special about it, never by what was compiled before."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import four_bar_mechanism

import jaxnc as nc
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.elimination import plan_elimination
from jaxnc.solvers.kernel import kernel
from jaxnc.solvers.plan import plan


def doubled(slant: float, second: float = 1.0) -> nc.Mechanism:
    """A parallelogram with a second coupler, so that rows are redundant; `slant` is where its crank is drawn."""
    crank = np.array([np.cos(slant), np.sin(slant)])
    m = nc.Mechanism("parallelogram")
    for k, x in enumerate((0.0, 3.0, 4.5)):
        m.ground(f"G{k}", (x, 0.0))
        m.point(f"P{k}", tuple(np.array([x, 0.0]) + second * crank))
        m.body(f"crank {k}", [f"G{k}", f"P{k}"])
    m.body("coupler", ["P0", "P1", "P2"])
    m.angle("phi", at="G0", to="P0")
    return m


def chosen(m: nc.Mechanism) -> tuple:
    """Rows and pivots that its inputs are solved with."""
    found = plan(m.compile().topology, ("phi",), (), 1)
    pivots = [plan_elimination(found.sample[np.ix_(rows, columns)]) for rows, columns in found.choice]
    return *pivots, *((rows.tolist(), columns.tolist()) for rows, columns in found.choice)


def test_rows_of_a_redundant_mechanism_do_not_depend_on_what_was_compiled_before():
    one, two = doubled(0.02), doubled(1.5, 2.0)
    alone = chosen(two)
    chosen(one)
    assert chosen(two) == alone


def test_designs_that_differ_in_numbers_only_share_what_is_chosen():
    one, two = doubled(0.7).compile(), doubled(1.1, 2.0).compile()
    assert one.topology.special == two.topology.special
    assert one.topology.special is not None and len(one.topology.special.rows or ()) == 6
    assert one.independent == two.independent == ("phi",)


def test_nothing_is_written_to_a_structure_after_it_was_made():
    before = four_bar_mechanism().compile()
    fields = {k: v for k, v in vars(before.topology).items() if k in before.topology.__dataclass_fields__}
    four_bar_mechanism().compile()
    nc.sweep(before, {"phi": np.linspace(0.0, 1.0, 5)})
    assert all(vars(before.topology)[k] is v for k, v in fields.items())


def test_a_derivative_that_vanishes_for_one_design_only_is_no_pivot_of_it():
    """A slider on a line along x: the structure allows a derivative that this drawing has not, and only this."""

    def slider(slope: float) -> nc.Mechanism:
        m = nc.Mechanism("slider-crank")
        m.ground("O", (0.0, 0.0)), m.ground("R", (1.0, 0.0)), m.ground("S", (3.0, 2.0 * slope))
        m.point("A", (0.3, 0.8)), m.point("B", (2.0, slope))
        m.body("crank", ["O", "A"]), m.body("rod", ["A", "B"])
        m.slot("slider", "B", ("R", "S"))
        m.angle("phi", at="O", to="A")
        return m

    flat, steep = slider(0.0).compile(), slider(0.4).compile()
    top = flat.topology
    special = top.special
    assert special is not None and special.rows is None and special.small
    assert {top.coordinates[c] for _, c in special.small} == {"B.x"}
    assert steep.topology.special is not None and not steep.topology.special.small


def test_a_slope_that_is_small_in_the_drawing_is_no_pivot():
    """The tie rod of a double wishbone is nearly level where it is drawn, and is level at a bump of 7 mm."""
    system = nc.library.double_wishbone().compile()
    motion = nc.sweep(system, {"wheel_centre.z": np.linspace(310.0, 322.0, 401)}, hold=("tie_inner.y", "rim.x"))
    top, eq = system.topology, derive(system)
    level = motion["tie_outer"][:, 2] - motion["tie_inner"][:, 2]
    assert abs(level[0]) < 6.0 and level[0] * level[-1] < 0.0
    (block,) = (
        b for b in kernel(plan(top, ("wheel_centre.z",), ("tie_inner.y", "rim.x"), 3)).blocks if len(b.columns) > 3
    )
    x, b = list(motion.q.T), np.random.default_rng(2).normal(size=len(block.columns))
    slopes, found = block.rows.slopes(eq, x), block.factors(eq, x).solve(b)
    left = -np.tile(b[:, None], len(motion.q))
    for (r, c), slope in slopes.items():
        left[r] += slope * found[c]
    assert np.abs(left).max() < 1e-12 * np.abs(found).max()


def test_failed_lanes_pass_no_derivative_on_where_a_pivot_stands_where_elimination_writes_first():
    system = nc.library.pantograph().compile()
    eq, core = derive(system), kernel(plan(system.topology, ("P.x", "P.y"), (), 2))
    assert any(b.pivots - set(b.rows.slopes(eq, list(eq.home))) for b in core.blocks)

    def poses(u):
        found = nc.solve_position(system, {"P.x": u[:, 0], "P.y": u[:, 1]})
        return found.q, found.converged

    inputs = jnp.array([[0.3, 0.2], [3.0, 3.0], [0.28, 0.22]])
    (_, met), (slopes, _) = jax.jvp(poses, (inputs,), (jnp.ones_like(inputs),))
    assert met.tolist() == [True, False, True]
    assert np.all(slopes[1] == 0.0) and np.isfinite(slopes).all() and np.abs(slopes[0]).max() > 0.1


@pytest.mark.parametrize("name", ["rscr", "bennett"])
def test_what_is_redundant_whatever_the_dimensions_is_told_from_what_is_so_by_them(name):
    special = nc.library.CATALOGUE[name]().compile().topology.special
    assert special.rows is not None and special.sufficient == (name == "rscr")


def test_rows_that_follow_from_a_block_take_over_where_its_own_are_weak():
    """In the second of three lanes two rows of the block are the same, and one that follows is not."""
    system = nc.library.rscr().compile()
    core, eq = kernel(plan(system.topology, ("1.y",), ())), derive(system)
    part = core.differentiated[-1]
    n, rng = len(part.rows.columns), np.random.default_rng(1)
    assert part.rows.count == n + 1
    matrix, x = rng.normal(size=(3, n + 1, n)), rng.normal(size=(n, 3))
    matrix[:, n] = matrix[:, 0] + 2.0 * matrix[:, 1]
    matrix[1, n], matrix[1, 0] = matrix[1, 0], matrix[1, 1]
    slopes = {(r, c): jnp.asarray(matrix[:, r, c]) for r in range(n + 1) for c in range(n)}
    right = np.einsum("lrc,cl->rl", matrix, x)
    found, pull = jax.vjp(lambda b: jnp.stack(part.solve(eq, slopes, list(b))), jnp.asarray(right))
    np.testing.assert_allclose(found, x, rtol=1e-11)
    weights = rng.normal(size=(n, 3))
    back = np.asarray(pull(jnp.asarray(weights))[0])
    np.testing.assert_allclose(np.einsum("lrc,rl->cl", matrix, back), weights, rtol=1e-11)
    change = jax.jvp(lambda b: jnp.stack(part.solve(eq, slopes, list(b))), (right,), (2.0 * right,))[1]
    np.testing.assert_allclose(change, 2.0 * x, rtol=1e-11)


def test_second_derivatives_in_reverse_where_a_block_has_rows_that_follow():
    """A ball in a slot in space: of what it misses sideways one row follows."""
    m = nc.Mechanism("slot", dim=3)
    m.ground("O", (0, 0, 0)), m.ground("Q", (0.1, 0, 0)), m.point("P", (0.3, 0.2, 0.1)), m.point("S", (0.6, 0, 0))
    m.ground_vector("z", (0, 0, 1)), m.ground_vector("x", (1, 0, 0))
    m.body("crank", ["O", "P"], vectors=["z"]), m.body("rod", ["P", "S"]), m.slot("slot", "S", ("Q", "x"))
    m.angle("phi", at="O", to="P", about="z")
    system, r, drawn = m.compile(), np.sqrt(0.13), np.arctan2(0.2, 0.3)

    def reach(phi):
        return nc.solve_position(system, {"phi": phi})["S"][0]

    def closed(phi):
        return r * jnp.cos(drawn + phi) + jnp.sqrt(0.13 - (r * jnp.sin(drawn + phi)) ** 2)

    found, right = (float(nc.jit(jax.grad(jax.grad(f)))(0.05)) for f in (reach, closed))
    assert found == pytest.approx(right, rel=1e-12)
