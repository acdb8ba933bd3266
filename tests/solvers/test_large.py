"""Large systems: sparse matrices chosen by size, against closed forms, the dense way, and their own counts.

The chain's closed form goes loop by loop through circle intersections in NumPy and shares nothing with the library.
"""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse as sp

import jaxnc as nc
from jaxnc import library
from jaxnc.kinematics import host_solve
from jaxnc.solvers import host
from jaxnc.solvers.assembly import derive, settle, to_host
from jaxnc.solvers.host import HostView, view_of
from jaxnc.solvers.host.sparse import SparseView
from jaxnc.solvers.plan import LargePlan, Plan, plan
from jaxnc.solvers.sparse_matrix import Factoriser, Pattern, dependencies, null_directions
from jaxnc.status import Status
from jaxnc.system.assemble import assemble

LOOPS = 150
SAME = 1e-12  # two ways to one answer, in lengths of a bar
EXACT = 1e-11  # closed form: rounding of coordinates as large as the chain, along all its loops
RATE = 2.0


@functools.cache
def chain(loops=LOOPS, sparse=None, last=1.05):
    return library.four_bar_chain(loops, last=last).compile(sparse)


def drawn_tips(system):
    points = np.asarray(system.parameters.points)
    half = len(points) // 2
    return points[:half], points[half:]


def closed_form(pivots, drawn, phi):
    """Tips at an angle of the first crank, with the lengths of a drawing."""
    cranks = np.linalg.norm(drawn - pivots, axis=1)
    couplers = np.linalg.norm(np.diff(drawn, axis=0), axis=1)
    tips = [pivots[0] + cranks[0] * np.array([np.cos(phi), np.sin(phi)])]
    for pivot, crank, coupler in zip(pivots[1:], cranks[1:], couplers, strict=True):
        d = pivot - tips[-1]
        span = np.hypot(*d)
        along = (span**2 + coupler**2 - crank**2) / (2 * span)
        across = np.sqrt(coupler**2 - along**2)
        tips.append(tips[-1] + (along * d + across * np.array([-d[1], d[0]])) / span)
    return np.array(tips)


def closed_rates(pivots, tips, rate):
    """Velocities and accelerations of the tips, loop by loop."""
    arm = tips[0] - pivots[0]
    v, a = [rate * np.array([-arm[1], arm[0]])], [-(rate**2) * arm]
    for i in range(1, len(tips)):
        rows = np.array([tips[i] - tips[i - 1], tips[i] - pivots[i]])
        v.append(np.linalg.solve(rows, [rows[0] @ v[-1], 0.0]))
        between = v[i] - v[i - 1]
        a.append(np.linalg.solve(rows, [rows[0] @ a[-1] - between @ between, -v[i] @ v[i]]))
    return np.array(v), np.array(a)


def tips_of(system, x):
    """The tips' part of all coordinates or their rates."""
    half = len(system.topology.points)
    return np.asarray(x)[..., half : 2 * half].reshape(*np.shape(x)[:-1], half // 2, 2)


@functools.cache
def moved():
    system = chain()
    return nc.sweep(system, {"phi": np.linspace(0.7, 1.3, 5)}, rates={"phi": RATE})


# ---------------------------------------------------------------------------------------------------------------
# a chain far above the threshold


def test_size_chooses_and_the_report_is_right():
    system = chain()
    assert system.topology.large and isinstance(plan(system.topology, ("phi",), (), 1), LargePlan)
    n = 2 * LOOPS + 3
    assert str(system).startswith(
        f"four-bar chain: n = {n} coordinates, {n - 1} constraint rows, rank {n - 1}, 1 degree of freedom\n"
    )
    small = chain(12)
    assert not small.topology.large and type(plan(small.topology, ("phi",), (), 1)) is Plan
    assert not assemble(library.four_bar_chain(LOOPS), sparse=False).topology.large


def test_poses_and_rates_are_those_of_the_closed_form():
    system, motion = chain(), moved().check()
    pivots, drawn = drawn_tips(system)
    for k, phi in enumerate(np.linspace(0.7, 1.3, 5)):
        tips = closed_form(pivots, drawn, phi)
        v, a = closed_rates(pivots, tips, RATE)
        assert np.max(np.abs(tips_of(system, motion.q[k]) - tips)) <= EXACT
        assert np.max(np.abs(tips_of(system, motion.rates[0][k]) - v)) <= EXACT * RATE
        assert np.max(np.abs(tips_of(system, motion.rates[1][k]) - a)) <= 10 * EXACT * RATE**2
    assert np.max(motion.residual) <= 1e-12


def test_gradient_is_that_of_the_closed_form():
    system = chain()
    phi = 1.2

    def height(s):
        return nc.solve_position(s, {"phi": phi}, throw=False)[f"B{LOOPS}"][1]

    gradient = jax.grad(height)(system)
    pivots, drawn = drawn_tips(system)
    got = np.asarray(gradient.parameters.points)
    assert np.all(np.isfinite(got)) and np.count_nonzero(got) > LOOPS
    h = 1e-5
    for i in (0, 1, LOOPS // 2, LOOPS - 1, LOOPS):
        for axis in (0, 1):
            for which, offset in ((pivots, 0), (drawn, LOOPS + 1)):
                ends = []
                for sign in (1, -1):
                    changed = which.copy()
                    changed[i, axis] += sign * h
                    both = (changed, drawn) if offset == 0 else (pivots, changed)
                    ends.append(closed_form(*both, phi)[-1, 1])
                assert abs((ends[0] - ends[1]) / (2 * h) - got[offset + i, axis]) <= 1e-8


def test_a_sweep_with_an_unreachable_pose_says_so_and_stays_finite():
    """The way ends where a dense plan of the same mechanism finds that it ends."""
    mechanism = library.four_bar_chain(6, last=1.3)
    inputs = {"phi": np.linspace(1.0, -0.4, 6)}
    dense, sparse = (nc.sweep(mechanism.compile(way), inputs) for way in (False, True))
    assert np.asarray(dense.status).tolist() == np.asarray(sparse.status).tolist()
    assert {int(Status.SINGULAR), int(Status.NOT_REACHED)} <= set(np.asarray(sparse.status).tolist())
    good = np.asarray(dense.converged)
    assert np.max(np.abs(dense.q - sparse.q)[good]) <= SAME

    def total(s):
        motion = nc.sweep(s, inputs)
        return jnp.sum(motion["B6"]), motion.failures

    gradient, failed = jax.grad(total, has_aux=True)(mechanism.compile(True))
    assert failed == np.sum(~good) and np.all(np.isfinite(gradient.parameters.points))


def test_a_chain_of_rhombi_goes_straight_through_its_change_points():
    """All loops flatten together at π; every one of them goes on as a rhombus, none folds over."""
    system = library.four_bar_chain(20).compile(True)
    phi = np.linspace(2.9, 3.4, 6)
    motion = nc.sweep(system, {"phi": phi}).check()
    pivots, _ = drawn_tips(system)
    want = pivots[None] + np.stack([np.cos(phi), np.sin(phi)], axis=1)[:, None]
    assert np.max(np.abs(tips_of(system, motion.q) - want)) <= 1e-9


# ---------------------------------------------------------------------------------------------------------------
# the dense way and the sparse way


def test_dense_and_sparse_agree_below_the_threshold():
    dense, sparse = chain(12, False), chain(12, True)
    assert dense.degrees_of_freedom == sparse.degrees_of_freedom == 1
    inputs, rates = {"phi": np.linspace(0.7, 1.3, 4)}, {"phi": RATE}
    one, other = nc.sweep(dense, inputs, rates), nc.sweep(sparse, inputs, rates)
    assert np.max(np.abs(one.q - other.q)) <= SAME
    for a, b in zip(one.rates, other.rates, strict=True):
        assert np.max(np.abs(a - b)) <= SAME * np.max(np.abs(a))


@pytest.mark.parametrize("name", ["jansen-leg", "four-bar-chain"])
def test_many_poses_level_by_level_are_those_of_dense_matrices(name):
    """All lanes side by side, where blocks have one or two unknowns; one lane goes by LU."""
    mechanism = library.CATALOGUE[name]()
    dense, sparse = mechanism.compile(False), mechanism.compile(True)
    eq, phi = to_host(derive(sparse)), mechanism.model.run.inputs["phi"]
    view = view_of(plan(sparse.topology, ("phi",), (), 1), eq)
    matrix, _ = view.matrices(np.repeat(eq.home[:, None], 61, axis=1))
    right = np.random.default_rng(2).standard_normal((61, len(view.plan.rows), 2))
    assert view._side_by_side(61) and not view._side_by_side(1)
    one = np.concatenate([view.solve(matrix[k : k + 1], right[k : k + 1]) for k in range(61)])
    assert np.max(np.abs(view.solve(matrix, right) - one)) <= 1e-12 * np.max(np.abs(one))
    inputs = {"phi": np.linspace(phi.start, phi.end, 61)}
    one, other = nc.sweep(dense, inputs).check(), nc.sweep(sparse, inputs).check()
    assert np.max(np.abs(one.q - other.q)) <= SAME * max(1.0, float(eq.length))


def test_what_is_too_much_to_write_out_is_solved_by_lu_on_the_host():
    """Fewer unknowns than of a large system, more than 48: the same poses and ends of branches as by whole matrices."""
    system = library.four_bar_chain(30, last=1.3).compile()
    view, eq = plan(system.topology, ("phi",), (), 1), to_host(derive(system))
    assert not view.large and isinstance(view_of(view, eq), SparseView) and host_solve.is_few(view, "continuation", 60)
    start, phi = np.asarray(settle(derive(system), np.zeros(len(eq.home))).q), np.linspace(1.0, -0.4, 60)
    with np.errstate(all="ignore"):
        one, other = (
            host.solve_sequences(v, start[:, None], phi[:, None, None]) for v in (view_of(view, eq), HostView(view, eq))
        )
    assert one.good.tolist() == other.good.tolist() and 30 < one.good.sum() < 60
    assert np.max(np.abs(one.q - other.q)[:, one.good]) <= 10 * SAME
    pivots, drawn = drawn_tips(system)
    tips = closed_form(pivots, drawn, phi[20])
    assert np.max(np.abs(tips_of(system, one.q[:, 20]) - tips)) <= EXACT


def test_mapped_designs_are_left_to_the_host_where_it_solves_by_lu():
    system = library.four_bar_chain(30, last=1.05).compile()
    phi = np.linspace(0.8, 1.2, 5)
    moved = np.array([0.0, 0.02])

    def tips(s, u):
        return nc.sweep(s.replace(B30=s.parameters.points[-1] + jnp.array([0.0, 1.0]) * u), {"phi": phi})["B30"]

    found = jax.jit(jax.vmap(tips, in_axes=(None, 0)))(system, moved)
    for k, by in enumerate(moved):
        pivots, drawn = drawn_tips(system)
        drawn = drawn + by * np.eye(31)[-1][:, None] * [0.0, 1.0]
        wanted = [closed_form(pivots, drawn, u)[-1] for u in phi]
        assert np.max(np.abs(found[k] - np.array(wanted))) <= EXACT


@pytest.mark.slow
def test_gradients_of_rates_agree_too():
    inputs, rates = {"phi": np.linspace(0.7, 1.3, 4)}, {"phi": RATE}
    dense, sparse = chain(6, False), chain(6, True)

    def total(s):
        return jnp.sum(nc.sweep(s, inputs, rates).rates[0] ** 2)

    a, b = jax.grad(total)(dense).parameters.points, jax.grad(total)(sparse).parameters.points
    assert np.max(np.abs(a - b)) <= 10 * SAME * np.max(np.abs(a))


# name: unknowns of its largest diagonal block; none where there are more rows than unknowns
WAYS = {
    "pantograph": 4,
    "hart": 6,
    "parallelogram": 0,  # a redundant row
    "cardan-shafts": 3,  # in space
    "bricard": 0,
}


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (i > 2)) for i, n in enumerate(WAYS)])
def test_every_way_agrees_with_the_dense_one(name):
    mechanism = library.CATALOGUE[name]()
    inputs = {k: np.linspace(d.start, d.end, 9)[1:4] for k, d in mechanism.model.run.inputs.items()}
    rates = dict.fromkeys(inputs, 1.0)
    dense, sparse = mechanism.compile(False), mechanism.compile(True)
    assert dense.degrees_of_freedom == sparse.degrees_of_freedom
    view = plan(sparse.topology, tuple(inputs), (), sparse.degrees_of_freedom)
    assert WAYS[name] == max((len(columns) for _, columns in view.sequence), default=0)
    one, other = nc.sweep(dense, inputs, rates).check(), nc.sweep(sparse, inputs, rates).check()
    size = float(derive(dense).length)
    assert np.max(np.abs(one.q - other.q)) <= 10 * SAME * max(size, 1.0)
    for a, b in zip(one.rates, other.rates, strict=True):
        assert np.max(np.abs(a - b)) <= 100 * SAME * max(float(np.max(np.abs(a))), 1.0)


def test_gradient_through_factors_made_on_the_host():
    mechanism = library.hart()
    phi = mechanism.model.run.inputs["phi"]
    angle = 0.7 * phi.start + 0.3 * phi.end

    def total(s):
        return jnp.sum(nc.solve_position(s, {"phi": angle}, throw=False).q ** 2)

    a, b = (jax.grad(total)(mechanism.compile(way)).parameters for way in (False, True))
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert np.max(np.abs(x - y), initial=0.0) <= 100 * SAME * (1 + np.max(np.abs(x), initial=0.0))


def test_second_derivatives_are_those_of_the_closed_form():
    """All loops are rhombi: every tip goes round its pivot as the first one does."""
    system, u = library.four_bar_chain(3).compile(True), 1.3

    def total(u):
        return jnp.sum(nc.solve_position(system, {"phi": u}, throw=False).q[4:] ** 2)

    slope = jax.jit(jax.grad(total))  # traced once for both orders
    found = jax.jit(lambda u: [jax.grad(slope)(u), jax.jvp(slope, (u,), (1.0,))[1]])(u)
    wanted = 2.0 - 2.0 * np.arange(4).sum() * np.cos(u)  # of the angle, and of the tips (k + cos u, sin u)
    np.testing.assert_allclose(found, wanted, rtol=100 * SAME)


def test_a_loose_drawing_with_given_lengths_is_assembled():
    loops, phi = 110, 1.1
    rng = np.random.default_rng(6)
    pivots = np.stack([np.arange(loops + 1.0), np.zeros(loops + 1)], axis=1)
    ideal = closed_form(pivots, pivots + np.array([np.cos(1.0), np.sin(1.0)]), 1.0)
    m = nc.Mechanism("loose chain")
    for i, (pivot, tip) in enumerate(zip(pivots, ideal + 0.02 * rng.standard_normal(ideal.shape), strict=True)):
        m.ground(f"A{i}", pivot)
        m.point(f"B{i}", tip)
        m.body(f"crank{i}", [f"A{i}", f"B{i}"], lengths={(f"A{i}", f"B{i}"): 1.0})
        if i:
            m.body(f"coupler{i}", [f"B{i - 1}", f"B{i}"], lengths={(f"B{i - 1}", f"B{i}"): 1.0})
    m.angle("phi", at="A0", to="B0")
    system = m.compile()
    assert system.topology.large and system.degrees_of_freedom == 1
    pose = nc.solve_position(system, {"phi": phi})
    want = pivots + np.array([np.cos(phi), np.sin(phi)])
    assert np.max(np.abs(tips_of(system, pose.q) - want)) <= 1e-9


def test_mapped_designs_are_those_one_by_one():
    system = chain(12, True)
    drawings = jnp.stack([system.parameters.points, system.parameters.points.at[-3:, 1].add(0.03)])

    def pose(points):
        changed = nc.System(system.topology, dataclasses.replace(system.parameters, points=points), 1)
        return nc.solve_position(changed, {"phi": 1.15}, throw=False).q

    one = jnp.stack([pose(x) for x in drawings])
    assert np.max(np.abs(jax.vmap(pose)(drawings) - one)) <= SAME


def test_mapped_and_batched_poses_are_those_one_by_one():
    system = chain(12, True)
    angles = jnp.array([0.8, 1.0, 1.25])
    one = jnp.stack([nc.solve_position(system, {"phi": u}).q for u in angles])
    assert np.max(np.abs(nc.solve_position(system, {"phi": angles}).q - one)) <= SAME
    mapped = jax.vmap(lambda u: nc.solve_position(system, {"phi": u}, throw=False).q)(angles)
    assert np.max(np.abs(mapped - one)) <= SAME


def test_mobility_names_the_same_rows():
    for mechanism in (library.parallelogram(), library.jansen_leg()):
        a, b = nc.mobility(mechanism.compile(False)), nc.mobility(mechanism.compile(True))
        assert (a.n, a.rows, a.rank, a.dof, a.grubler) == (b.n, b.rows, b.rank, b.dof, b.grubler)
        assert (a.redundant, a.involved, a.overconstrained) == (b.redundant, b.involved, b.overconstrained)
    large = nc.mobility(chain())
    assert (large.rank, large.dof, large.grubler, large.redundant) == (2 * LOOPS + 2, 1, 1, ())


# ---------------------------------------------------------------------------------------------------------------
# counts, not seconds


def stored(loops):
    system = assemble(library.four_bar_chain(loops), sparse=True)
    view = plan(system.topology, ("phi",), (), 1)
    assert isinstance(view, LargePlan)
    data = np.where(view.numbers.rows == view.numbers.columns, 2.0, 0.7)
    data[view.numbers.place(view.matched, np.arange(len(view.unknown)))] += 1.0
    assert view.lu.factorise(data) is not None
    return view.numbers.count, view.stored


def test_what_is_stored_grows_as_the_mechanism_does():
    small, large = stored(200), stored(1600)
    for a, b in zip(small, large, strict=True):
        assert b <= 8.3 * a
    assert large[1] <= 40 * 1600  # numbers, of about 4 unknowns' worth a loop


@pytest.mark.slow
def test_ten_thousand_coordinates():
    loops = 4999
    system = chain(loops)
    assert len(system.topology.unknown) == 10_001 and system.degrees_of_freedom == 1
    pivots, drawn = drawn_tips(system)

    def look(s):
        motion = nc.solve_position(s, {"phi": 1.2}, throw=False)
        return motion[f"B{loops}"][1], motion

    (_, motion), gradient = jax.value_and_grad(look, has_aux=True)(system)
    assert motion.converged
    assert np.max(np.abs(tips_of(system, motion.q) - closed_form(pivots, drawn, 1.2))) <= 1e-8
    got = np.asarray(gradient.parameters.points)[-1]
    h = 1e-4
    for axis in (0, 1):
        ends = [
            closed_form(pivots, drawn + s * h * (np.arange(loops + 1) == loops)[:, None] * np.eye(2)[axis], 1.2)
            for s in (1, -1)
        ]
        assert abs((ends[0] - ends[1])[-1, 1] / (2 * h) - got[axis]) <= 1e-6


# ---------------------------------------------------------------------------------------------------------------
# the parts


def block_triangular(rng, sizes, density):
    """A random matrix in block-triangular form, shuffled, with the sequence of its blocks."""
    n = sum(sizes)
    starts = np.concatenate([[0], np.cumsum(sizes)])
    matrix = np.zeros((n, n))
    for k, size in enumerate(sizes):
        own = slice(starts[k], starts[k + 1])
        matrix[own, own] = rng.standard_normal((size, size)) + 2 * np.eye(size)[rng.permutation(size)]
        for j in range(k):
            if rng.random() < density:
                matrix[own, starts[j] : starts[j + 1]] = 0.5 * rng.standard_normal((size, sizes[j]))
    rows, columns = rng.permutation(n), rng.permutation(n)
    shuffled = np.zeros_like(matrix)
    shuffled[np.ix_(rows, columns)] = matrix
    parts = [np.arange(starts[k], starts[k + 1]) for k in range(len(sizes))]
    return shuffled, tuple((rows[p], columns[p]) for p in parts)


def pattern_of(matrix):
    c, r = np.nonzero(matrix.T)
    return Pattern(np.arange(len(r)), r, c, matrix.shape, len(r)), matrix[r, c]


SIZES = [(1,) * 9, (2, 1, 2, 2, 1, 2), (3, 1, 4, 2, 2, 1, 3), (3, 1, 6, 2, 5)]


@pytest.mark.parametrize("sizes", SIZES, ids=str)
def test_factors_solve_and_know_the_orientation_of_every_block(sizes):
    rng = np.random.default_rng(4)
    matrix, sequence = block_triangular(rng, sizes, 0.5)
    view, data = pattern_of(matrix)
    lu = Factoriser(len(matrix), view.rows, view.columns, sequence)
    b, factors = rng.standard_normal((len(matrix), 2)), lu.factorise(data)
    assert np.max(np.abs(lu.solve_by(factors, b) - np.linalg.solve(matrix, b))) <= 1e-11  # of random matrices
    assert np.max(np.abs(lu.solve_by(factors, b, True) - np.linalg.solve(matrix.T, b))) <= 1e-11
    pivots, signs = lu.pivots(factors)
    determinants = [np.linalg.det(matrix[np.ix_(r, c)]) for r, c in sequence]
    assert signs.tolist() == np.sign(determinants).tolist()
    products = [np.prod(pivots[c]) for _, c in sequence]
    np.testing.assert_allclose(products, np.abs(determinants), rtol=1e-12)
    whole = Factoriser(len(matrix), view.rows, view.columns)
    assert whole.pivots(whole.factorise(data))[1] == np.sign(np.linalg.det(matrix))
    singular = np.where(view.rows == view.rows[0], 0.0, data)
    assert np.all(np.isnan(lu.solve_by(lu.factorise(singular), b))) and not np.any(lu.pivots(lu.factorise(singular))[1])
    times, transposed = jax.jit(lambda data, x: (view.times(data, x), view.times_transposed(data, x)))(data, b[:, 0])
    assert np.max(np.abs(times - matrix @ b[:, 0])) <= 1e-13
    assert np.max(np.abs(transposed - matrix.T @ b[:, 0])) <= 1e-13


def test_rank_counts_what_a_matrix_misses_and_doubts_near_the_threshold():
    rng = np.random.default_rng(8)
    tall = sp.random(60, 40, 0.2, random_state=3, format="csc") + sp.eye(60, 40, format="csc")
    copied = sp.hstack([tall, tall @ sp.csc_matrix(rng.standard_normal((40, 3)))], format="csc")
    found = null_directions(copied)
    assert found.count == 3 and found.sure
    assert np.max(np.abs(copied @ found.basis)) <= 1e-9 * abs(copied).max()
    assert dependencies(copied).shape == (60, 20)
    scaled = sp.diags([*np.linspace(0.5, 1.0, 30), 2e-7]).tocsc()
    assert not null_directions(scaled).sure
    scaled = sp.diags([*np.linspace(0.5, 1.0, 30), 1e-12]).tocsc()
    assert null_directions(scaled).sure and null_directions(scaled).count == 1


# ---------------------------------------------------------------------------------------------------------------
# what is not offered, and mistakes


@pytest.mark.parametrize("name", ["bennett", "rccc"])
def test_freedoms_of_the_overconstrained_are_counted_where_pivots_cancel(name):
    assert library.CATALOGUE[name]().compile(True).degrees_of_freedom == 1


def test_undecidable_freedoms_are_an_error_with_a_remedy(monkeypatch):
    from jaxnc.solvers import sparse_matrix

    monkeypatch.setattr(sparse_matrix, "RANK", 0.05)  # so that a chain's gentlest motions come near it
    with pytest.raises(nc.MechanismError, match=r"'four-bar chain'.*freedom.*Draw"):
        library.four_bar_chain(40).compile(True)


def test_dense_analyses_are_refused_with_what_is_offered():
    system = chain()
    pose = moved()
    for call, name in (
        (lambda: nc.travel(system, "phi"), "travel"),
        (lambda: nc.diagnose(system, {"phi": 1.0}), "diagnose"),
        (lambda: nc.sensitivity(pose, ["B1"]), "sensitivity"),
        (lambda: nc.circuit(system, "phi", (0.9, 1.1)), r"circuit\(\)"),
        (lambda: pose.singular_values(), r"singular_values\(\)"),
    ):
        with pytest.raises(nc.InputError, match=rf"{name}.*dense.*solve_position"):
            call()
    for find, phi in ((nc.modes, 1.0), (nc.circuits, [1.0, 1.1])):
        with pytest.raises(nc.InputError, match=r"dyads.*most=1000"):
            find(system, {"phi": phi})
    with pytest.raises(nc.InputError, match=r"2\^1101 in all"):  # no float has as many
        nc.modes(library.four_bar_chain(1100).compile(), {"phi": 1.0})
    with pytest.raises(nc.InputError, match=r"too few inputs.*'four-bar chain'"):
        nc.solve_position(system, {})


def test_choosing_rows_is_refused_for_sparse_matrices():
    system = library.parallelogram().compile(True)
    with pytest.raises(nc.InputError, match=r"1 more rows.*'least squares'"):
        nc.sweep(system, {"phi": [1.0]}, redundancy="independent rows")


# ---------------------------------------------------------------------------------------------------------------
# traced code, which asks the host


def bowed(p, v, s, c):
    """The distance of two points, in a way that is not a straight line of NumPy's operations."""
    d = p[1] - p[0]
    return (jax.lax.fori_loop(0, 2, lambda i, x: x + d[i] * d[i], 0.0) - c[0],)


def drawn_square(p, v, s, c):
    d = p[1] - p[0]
    return (d @ d,)


BOWED = nc.constraints.Kind(
    "bowed", bowed, rows=("length",), powers=(2,), points=2, constants=("square",), drawn=drawn_square, source="a test"
)


def test_a_kind_that_cannot_be_read_works_outside_of_traced_code_and_says_so_in_it():
    mechanism = nc.Mechanism("bowed four-bar")
    for name, place in (("A", (0.0, 0.0)), ("D", (2.0, 0.0))):
        mechanism.ground(name, place)
    mechanism.point("B", (0.5, 0.9))
    mechanism.point("C", (2.2, 1.3))
    mechanism.body("crank", ["A", "B"])
    mechanism.body("rocker", ["C", "D"])
    mechanism.constrain("bowed", BOWED, points=["B", "C"])
    mechanism.angle("phi", at="A", to="B")
    sparse, dense = mechanism.compile(True), mechanism.compile(False)
    phi = np.linspace(1.0, 1.6, 4)
    one, other = (nc.sweep(s, {"phi": phi}, rates={"phi": 1.0}).check() for s in (sparse, dense))
    assert np.max(np.abs(one.q - other.q)) <= SAME
    assert np.max(np.abs(one.rates[1] - other.rates[1])) <= 100 * SAME
    with pytest.raises(nc.InputError, match=r"'bowed'.*outside of jit.*sparse=False"):
        jax.jit(lambda u: nc.sweep(sparse, {"phi": u}).q)(phi)


def test_a_start_leads_to_the_same_assembly_as_with_dense_matrices():
    dense, sparse = chain(12, False), chain(12, True)
    half = np.asarray(dense.parameters.points)
    start = {f"B{k}": half[13 + k] + 0.01 * (-1) ** k for k in range(13)}

    def pose(system, u):
        return nc.solve_position(system, {"phi": u}, start=start, throw=False).q

    wanted = pose(dense, 1.02)
    assert np.max(np.abs(pose(sparse, 1.02) - wanted)) <= SAME
    assert np.max(np.abs(jax.jit(functools.partial(pose, sparse))(1.02) - wanted)) <= SAME
    traced = jax.jit(lambda s: pose(s, 1.02))(sparse)
    assert np.max(np.abs(traced - wanted)) <= SAME
