"""The batched kernel: what it writes out, what it eliminates, and that large batches are right in every lane."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import four_bar, slider_crank

import jaxnc as nc
from jaxnc.constraints.elementary import cos, sin
from jaxnc.kinematics import host_solve
from jaxnc.library import generic_mechanism, jansen_leg, macpherson
from jaxnc.solvers import fill
from jaxnc.solvers.assembly import derive, settle, to_host
from jaxnc.solvers.elimination import eliminate_block, plan_elimination
from jaxnc.solvers.kernel import kernel, smallest
from jaxnc.solvers.plan import plan
from jaxnc.solvers.rows import Rows
from jaxnc.system.equations import jacobian, residual
from jaxnc.system.precision import limits

RNG = np.random.default_rng(11)
ULPS = 4.5e-16  # two last digits of 1: one ours, one the mathematical library's


def test_sine_and_cosine_to_the_last_digit():
    x = np.concatenate([RNG.uniform(-1e5, 1e5, 20_000), np.arange(-40, 41) * np.pi / 4, [0.0, -0.0, 1e-300]])
    assert np.max(np.abs(np.asarray(jax.jit(sin)(x)) - np.sin(x))) <= ULPS
    assert np.max(np.abs(np.asarray(jax.jit(cos)(x)) - np.cos(x))) <= ULPS
    assert sin(0.5) == np.sin(0.5)
    np.testing.assert_allclose(jax.grad(lambda y: jax.grad(sin)(y))(0.7), -np.sin(0.7), rtol=1e-14)
    assert np.isnan(float(sin(jnp.asarray(np.nan))))


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 7, 12])
def test_planned_elimination_solves_both_ways(n):
    matrix = RNG.normal(size=(n, n)) * (RNG.uniform(size=(n, n)) < 0.6) + np.eye(n)
    matrix = matrix[RNG.permutation(n)][:, RNG.permutation(n)]
    recipe = plan_elimination(np.abs(matrix))
    lanes = {(int(i), int(j)): matrix[i, j] * np.array([1.0, -2.0]) for i, j in np.argwhere(matrix)}
    factors = eliminate_block(recipe, lanes)
    b = RNG.normal(size=n)
    for solve, a in ((factors.solve, matrix), (factors.solve_transposed, matrix.T)):
        x = np.array(solve([np.full(2, v) for v in b]))
        np.testing.assert_allclose(a @ x[:, 0], b, atol=1e-10)
        np.testing.assert_allclose(-2.0 * a @ x[:, 1], b, atol=1e-10)
    np.testing.assert_allclose(float(factors.determinant[0]), np.linalg.det(matrix), rtol=1e-9)


@pytest.mark.parametrize(("n", "dtype"), [(5, np.float64), (5, np.float32), (9, np.float64)])
def test_a_pivot_may_vanish_where_the_matrix_does_not(n, dtype):
    """Lanes of which the first pivot is zero or nearly so, regular ones and singular ones."""
    lanes = 12
    rng = np.random.default_rng(4)
    recipe = plan_elimination(np.ones((n, n)))
    (first, column), units = (recipe.rows[0], recipe.columns[0]), (1.0,) * (n - 1) + (800.0,)
    matrix = rng.normal(size=(lanes, n, n))
    matrix[:, first, column] = np.resize([0.0, 1e-13, -1e-9, 1e-6, -1e-4, 0.7], lanes)
    # In the second half the last row follows from the others; the first pivot stays what it is.
    last = recipe.rows[-1]
    matrix[6:, last] = np.einsum("k,lkj->lj", rng.normal(size=n - 1), np.delete(matrix[6:], last, axis=1))
    matrix, b = (matrix * np.array(units)).astype(dtype), rng.normal(size=(n, lanes)).astype(dtype)
    least, digits = limits(b), np.finfo(dtype).eps
    factors = eliminate_block(recipe, {(i, j): matrix[:, i, j] for i in range(n) for j in range(n)}, units, least.fine)
    x = np.array(factors.solve(list(b)))
    for _ in range(3):  # refined, as by Newton
        x = x + np.array(factors.solve(list(b - np.einsum("lij,jl->il", matrix, x))))
    np.testing.assert_allclose(np.einsum("lij,jl->il", matrix, x)[:, :6], b[:, :6], atol=1e3 * digits)
    np.testing.assert_allclose(
        np.asarray(factors.determinant)[:6], np.linalg.det(matrix)[:6], rtol=50 * np.sqrt(digits)
    )
    ratio = np.asarray(smallest([factors.pivots]))
    values = np.linalg.svd(matrix / np.array(units), compute_uv=False)
    assert np.all(ratio[:6] > 1e-3 * (values[:, -1] / values[:, 0])[:6]) and np.all(ratio[6:] < least.poor), ratio


CASES = {
    "four-bar": (four_bar, ("phi",), ()),
    "generic": (lambda: generic_mechanism().compile(), ("phi",), ()),
    "jansen": (lambda: jansen_leg().compile(), ("phi",), ()),
    "macpherson": (lambda: macpherson().compile(), ("6.z", "10.y"), ("7.x",)),
}


@pytest.mark.parametrize("name", CASES)
def test_rows_written_out_are_the_residual(name):
    make, driven, held = CASES[name]
    system = make()
    top = system.topology
    view = plan(top, driven, held, system.degrees_of_freedom)
    eq = derive(system)
    q = settle(eq, np.zeros(len(top.coordinates))).q
    x = q + 0.02 * float(eq.length) * RNG.normal(size=q.shape) * (np.arange(len(q)) < len(top.points) * top.dim)
    r, j = np.asarray(residual(eq, x)), np.asarray(jacobian(eq, x))
    core = kernel(view)
    np.testing.assert_allclose(core.everything.values(eq, list(x)), r, atol=1e-14 * float(eq.length))
    for block in core.blocks:
        for (i, c), value in block.rows.slopes(eq, list(x)).items():
            wanted = j[block.rows.rows[i], block.columns[c]]
            np.testing.assert_allclose(value, wanted, atol=1e-13 * max(1.0, abs(wanted)))


def test_rows_that_only_jax_can_carry_out_are_differentiated_by_each_of_their_variables():
    """Of a user's own kind over two points, whose loop no program has."""
    loop = nc.constraints.Kind(
        "twisted",
        lambda p, v, s, c: (p[0][1] * p[1][0] - jax.lax.fori_loop(0, 2, lambda _, x: x * p[0][0], 1.0) * p[1][1],),
        rows=("twisted",),
        points=2,
        source="a user's own",
    )
    m = nc.Mechanism("two points")
    m.constrain("twisted", loop, points=[m.point("P", (0.5, 0.5)), m.point("Q", (0.3, 0.6))])
    eq = derive(m.compile())
    rows, x = Rows(eq.topology, [0], range(4)), np.array([0.7, -0.4, 1.3, 0.9])
    assert not rows.readable
    found = rows.slopes(eq, list(x))
    np.testing.assert_allclose([found[0, c] for c in range(4)], np.asarray(jacobian(eq, x))[0], atol=1e-14)


WIDE = {
    "macpherson": ({"6.z": (270.0, 350.0), "10.y": (340.0, 380.0)}, ("7.x",)),
    "cardan joint": ({"phi": (0.0, 2 * np.pi)}, ()),
    "scotch yoke": ({"phi": (-np.pi, np.pi)}, ()),
    "klann leg": ({"phi": (np.pi, 3 * np.pi)}, ()),  # a determinant has a narrow valley: the points go there twice
}


@pytest.mark.parametrize("name", WIDE)
def test_regular_poses_are_all_solved_side_by_side(name):
    """Nothing of these ranges is left to the host: points of the table lie on the very angles where pivots are zero."""
    inputs, hold = WIDE[name]
    system = nc.library.CATALOGUE[name.replace(" ", "-")]().compile()
    view = plan(system.topology, tuple(inputs), hold, system.degrees_of_freedom)
    eq = derive(system)
    q = settle(eq, np.zeros(len(system.topology.coordinates))).q
    rng = np.random.default_rng(1)
    values = np.stack([rng.uniform(low, high, 600) for low, high in inputs.values()], axis=1)
    values[0], values[-1] = zip(*inputs.values(), strict=True)
    found = jax.jit(lambda u: fill.from_table(view, eq, q, u))(values)
    assert np.all(found.good) and np.min(found.conditioning) > 1e-6
    with np.errstate(all="ignore"):
        host = host_solve.solve_lanes(view, to_host(eq), np.asarray(q)[None], values[::40], np.zeros(15, int))
    assert not host.status.any()
    at = np.stack(found.q, axis=1)[::40]
    np.testing.assert_allclose(at, host.q[:, view.unknown], atol=1e-12 * float(eq.length))


def test_poses_of_narrow_numbers_are_solved_side_by_side(monkeypatch):
    """A pivot that passes near zero loses more of 32 bits: a pose of the table is passed then, a lane is the host's."""
    asked, by_host = [], host_solve.solve_lanes

    def counted(view, eq, q, values, *rest):
        asked.append(len(values))
        return by_host(view, eq, q, values, *rest)

    monkeypatch.setattr(host_solve, "solve_lanes", counted)
    inputs, hold = WIDE["macpherson"]
    system = macpherson().compile(dtype="float32")
    values = np.random.default_rng(1).uniform(*zip(*inputs.values(), strict=True), (600, 2))
    motion = nc.solve_position(system, dict(zip(inputs, values.T, strict=True)), hold=hold)
    assert not np.any(motion.status) and sum(asked) < 12, asked  # hundreds where no such pose may be passed


def circles(A, D, a, b, c, phi, side):
    """Closed form: crank pin, coupler pin, and whether they exist."""
    B = A + a * np.stack([np.cos(phi), np.sin(phi)], -1)
    d = D - B
    span = np.sum(d * d, -1)
    along = (b * b - c * c + span) / (2 * span)
    rest = b * b / span - along * along
    across = side * np.sqrt(np.maximum(rest, 0.0))
    return B, B + along[:, None] * d + across[:, None] * np.stack([-d[:, 1], d[:, 0]], -1), rest > 0


def bars(a, b, c, g, phi, side):
    """A four-bar drawn at an angle where it exists."""
    B, C, there = circles(np.zeros(2), np.array([g, 0.0]), a, b, c, np.array([phi]), side)
    assert there[0]
    return np.array([[0.0, 0.0], [g, 0.0], B[0], C[0]])


def drawn(system, points):
    names = {"O2": 0, "O4": 1, "A": 2, "B": 3}
    full = np.array(system.parameters.points)
    for name, k in names.items():
        full[system.topology.points.index(name)] = points[k]
    return dataclasses.replace(system, parameters=dataclasses.replace(system.parameters, points=jnp.asarray(full)))


@pytest.mark.parametrize("lengths", [(1.0, 3.0, 2.5, 3.2), (2.0, 2.5, 2.2, 1.9), (2.6, 2.2, 1.1, 3.9)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_large_batches_against_the_closed_form(lengths, side):
    a, b, c, g = lengths
    A, D = np.zeros(2), np.array([g, 0.0])
    start = next(u for u in np.linspace(0.3, 6.0, 50) if circles(A, D, a, b, c, np.array([u]), side)[2][0])
    system = drawn(four_bar(explicit=False), bars(a, b, c, g, start, side))
    # From the drawing the crank can go as far as there is a coupler pin, and no farther.
    u = RNG.uniform(start - np.pi, start + np.pi, 3000)
    fine = start + np.linspace(-np.pi, np.pi, 200_001)
    there = circles(A, D, a, b, c, fine, side)[2]
    low = fine[:100_001][~there[:100_001]].max(initial=-np.inf)
    high = fine[100_000:][~there[100_000:]].min(initial=np.inf)
    motion = nc.solve_position(system, {"phi": u + 4 * np.pi})
    ok = np.asarray(motion.converged)
    clear = np.minimum(np.abs(u - low), np.abs(u - high)) > 1e-3
    assert np.array_equal(ok[clear], ((u > low) & (u < high))[clear])
    B, C, _ = circles(A, D, a, b, c, u, side)
    np.testing.assert_allclose(np.asarray(motion["A"])[ok], B[ok], atol=1e-13)
    # Near a dead point positions are known to the square root of rounding only.
    away = ok & clear
    np.testing.assert_allclose(np.asarray(motion["B"])[away], C[away], atol=2e-12)
    np.testing.assert_array_equal(np.asarray(motion.inputs["phi"]), u + 4 * np.pi)
    assert np.all(np.isfinite(np.asarray(motion.q)))
    few = nc.solve_position(system, {"phi": u[:40] + 4 * np.pi})
    np.testing.assert_array_equal(np.asarray(few.status)[clear[:40]], np.asarray(motion.status)[:40][clear[:40]])


def nearly_flat(count, rng):
    """Four-bars whose bars nearly all lie in one line somewhere: what they can reach is known exactly."""
    while count:
        a, b, c = rng.uniform(0.5, 3.0, 3)
        off = 10 ** rng.uniform(-6, -2) * rng.choice([-1, 1])
        g = [b + c - a, a + c - b, a + b - c][rng.integers(3)] * (1 + off)
        side, start = rng.choice([-1.0, 1.0]), rng.uniform(-np.pi, np.pi)
        if g < 0.2 or not circles(np.zeros(2), np.array([g, 0.0]), a, b, c, np.array([start]), side)[2][0]:
            continue
        # The coupler and the rocker reach over distances from |b - c| to b + c.
        at = [(a * a + g * g - r * r) / (2 * a * g) for r in (b + c, b - c)]
        turn = 2 * np.pi
        ends = [s * np.arccos(x) + turn * m for x in at if abs(x) < 1 for s in (-1, 1) for m in (-1, 0, 1)]
        ends = np.array(ends)
        low, high = ends[ends < start].max(initial=-np.inf), ends[ends > start].min(initial=np.inf)
        if min(start - low, high - start) > 0.01:
            count -= 1
            yield (a, b, c, g), side, start, low, high


def test_wide_gaps_are_not_jumped_either():
    """Behind a gap of half a radian a step of three radians finds prediction, slope and orientation as expected."""
    a, b, c, g, home = 0.36934709569851043, 0.41623943183803835, 1.3063273204634918, 1.3648062431574823, -1.374217684
    A = a * np.array([np.cos(home), np.sin(home)])
    system = None
    for side in (1, -1):
        d = np.array([g, 0.0]) - A
        r = np.hypot(*d)
        along = (b * b - c * c + r * r) / (2 * r)
        across = side * np.sqrt(b * b - along * along)
        B = A + (along * d + across * np.array([-d[1], d[0]])) / r
        m = nc.Mechanism("beyond the gap")
        m.ground("O", (0, 0))
        m.ground("C", (g, 0))
        m.point("A", A)
        m.point("B", B)
        m.body("crank", ["O", "A"])
        m.body("coupler", ["A", "B"])
        m.body("rocker", ["C", "B"])
        m.angle("phi", at="O", to="A")
        system = m.compile() if system is None else system.replace({"B": B})
        # The crank's dead points are where coupler and rocker are in line.
        dead = np.arccos((a * a + g * g - (b + c) ** 2) / (2 * a * g))
        phi = np.linspace(home - np.pi, home + np.pi, 51)[1:-1]
        assert np.abs(phi).max() > dead > 2.8
        wanted = np.abs(phi) < dead
        found = np.asarray(nc.solve_position(system, {"phi": phi}).converged)
        assert (found == wanted).all(), side
        alone = [bool(nc.solve_position(system, {"phi": float(u)}, throw=False).converged) for u in phi[:6]]
        assert alone == wanted[:6].tolist(), side


def test_gaps_however_narrow_are_not_jumped():
    system = four_bar(explicit=False)
    designs = list(nearly_flat(30, np.random.default_rng(5)))
    assert sum(np.isfinite(low) and high - low > 2 * np.pi - 0.05 for *_, low, high in designs) > 2

    def move(p, u):
        s = dataclasses.replace(system, parameters=dataclasses.replace(system.parameters, points=p))
        m = nc.sweep(s, {"phi": u})
        return m["B"], m.status == 0

    def check(u, found, good, lengths, side, low, high, ordered):
        inside = (u > low) & (u < high)
        wanted = np.cumprod(inside).astype(bool) if ordered else inside
        clear = np.minimum(np.abs(u - low), np.abs(u - high)) > 1e-5
        np.testing.assert_array_equal(good[clear], wanted[clear])
        a, b, c, g = lengths
        exact = circles(np.zeros(2), np.array([g, 0.0]), a, b, c, u, side)[1]
        np.testing.assert_allclose(found[good & clear], exact[good & clear], atol=1e-9)

    drawings, ways = [], []
    for k, (lengths, side, start, low, high) in enumerate(designs):
        s = drawn(system, bars(*lengths, start, side))
        u = RNG.uniform(start - np.pi, start + np.pi, 600)
        motion = nc.solve_position(s, {"phi": u})
        check(u, np.asarray(motion["B"]), np.asarray(motion.converged), lengths, side, low, high, False)
        drawings.append(s.parameters.points)
        ways.append(start + np.linspace(0.0, RNG.choice([-1, 1]) * 2 * np.pi, 49))
        if k % 10 == 0:
            nc.solve_position(s, {"phi": start})
            for v in u[:6]:
                try:
                    one = nc.solve_position(s, {"phi": float(v)})
                except nc.AssemblyError:
                    assert not low + 1e-5 < v < high - 1e-5
                    continue
                check(np.array([v]), np.asarray(one["B"])[None], np.ones(1, bool), lengths, side, low, high, False)
    found, good = jax.jit(jax.vmap(move))(jnp.stack(drawings), jnp.asarray(ways))
    one = jax.jit(move)
    for k, (lengths, side, _, low, high) in enumerate(designs):
        check(ways[k], np.asarray(found[k]), np.asarray(good[k]), lengths, side, low, high, True)
        b, ok = one(drawings[k], jnp.asarray(ways[k]))
        check(ways[k], np.asarray(b), np.asarray(ok), lengths, side, low, high, True)


def test_a_large_batch_is_its_parts():
    system = slider_crank()
    u = RNG.uniform(-9.0, 9.0, 1500)
    motion = nc.solve_position(system, {"phi": u})
    sweep = nc.sweep(system, {"phi": np.sort(u)})
    order = np.argsort(u)
    np.testing.assert_allclose(np.asarray(sweep.q), np.asarray(motion.q)[order], atol=1e-13)
    part = motion.pose(slice(3, 7))
    np.testing.assert_array_equal(part.q, np.asarray(motion.q)[3:7])
    np.testing.assert_array_equal(motion.pose(5)["A"], np.asarray(motion["A"])[5])
    # What is asked for again may be compiled, so that its last digits are those of XLA and not of NumPy.
    shaped = nc.solve_position(system, {"phi": u.reshape(30, 50)})
    np.testing.assert_allclose(shaped.q, np.asarray(motion.q).reshape(30, 50, -1), atol=1e-13)


def test_a_constant_design_is_kept_apart_as_a_traced_one():
    """XLA folds what it knows of a design that is constant, and would calculate again what several others use."""
    system, u = generic_mechanism().compile(), jnp.linspace(0.9, 1.0, 256)

    def poses(system, u):
        return jax.vmap(lambda u: nc.solve_position(system, {"P1.y": u}).q)(u)

    programs = jax.jit(lambda u: poses(system, u)).lower(u), jax.jit(poses).lower(system, u)
    constant, traced = (p.compile().as_text().count(" conditional(") for p in programs)
    assert constant == traced > 0


def test_gradients_of_a_large_batch():
    system = four_bar()
    u = RNG.uniform(0.0, 6.0, 700)

    def cost(s, u):
        return jnp.mean(nc.solve_position(s, {"phi": u})["P"] ** 2)

    whole = jax.jit(jax.grad(cost, argnums=(0, 1)))(system, u)
    parts = [jax.grad(cost, argnums=(0, 1))(system, part) for part in np.split(u, 7)]
    for a, *some in zip(*map(jax.tree.leaves, (whole[0], *(p[0] for p in parts))), strict=True):
        np.testing.assert_allclose(a, np.mean(some, axis=0), atol=1e-12)
    np.testing.assert_allclose(whole[1] * 7, np.concatenate([p[1] for p in parts]), atol=1e-12)


def test_designs_march_together_and_failures_stay_where_they_are():
    system = four_bar(explicit=False)
    base = [(1.0, 3.0, 2.5, 3.2), (2.0, 2.5, 2.2, 1.9), (2.6, 2.2, 1.1, 3.9), (1.0, 2.8, 2.6, 3.1)]
    starts = (0.9, 0.9, 0.3, 0.9)
    designs = [drawn(system, bars(*x, at, 1.0)) for x, at in zip(base, starts, strict=True)]
    points = jnp.stack([s.parameters.points for s in designs])
    u = np.linspace(0.9, 7.0, 41)

    def move(p, u):
        s = dataclasses.replace(system, parameters=dataclasses.replace(system.parameters, points=p))
        m = nc.sweep(s, {"phi": u})
        return m.q, m.status

    q, status = jax.jit(jax.vmap(move, in_axes=(0, None)))(points, u)
    assert 0 < np.sum(np.asarray(status) != 0) < status.size
    for k in range(len(base)):
        one, state = move(points[k], u)
        np.testing.assert_array_equal(state, status[k])
        good = np.asarray(state) == 0
        np.testing.assert_allclose(q[k][good], one[good], atol=1e-12)
        # The end of a branch is a double root: some of the walk's smallest steps, 1e-7 of the way, are the square.
        np.testing.assert_allclose(q[k][~good], one[~good], atol=6e-3)
    # Twice mapped: designs, and starts of the sequence; in the other order see kinematics/test_transforms.py.
    shifts = jnp.asarray([0.0, 0.05])
    there = jax.jit(jax.vmap(lambda p: jax.vmap(lambda d: move(p, u + d)[0])(shifts)))(points[:2])
    good = np.asarray(status[1]) == 0
    np.testing.assert_allclose(there[1, 0][good], q[1][good], atol=1e-12)


def test_one_pose_after_the_other():
    system = four_bar()
    fresh = dataclasses.replace(system)
    for u in (*RNG.uniform(-4.0, 4.0, 30), 40.5):
        quick, slow = nc.solve_position(system, {"phi": u}), nc.solve_position(fresh, {"phi": np.array([u])})
        np.testing.assert_allclose(quick.q, slow.q[0], atol=1e-13)
        assert quick.inputs["phi"] == u and int(quick.status) == 0
    # Whatever was asked before: nothing is remembered of it.
    there = nc.solve_position(system, {"phi": 0.7}).q
    for u in (31.5, -2.0, 5.0):
        nc.solve_position(system, {"phi": u})
        np.testing.assert_array_equal(nc.solve_position(system, {"phi": 0.7}).q, there)
    rocker = drawn(four_bar(explicit=False), bars(2.6, 2.2, 1.1, 3.9, 0.3, 1.0))
    nc.solve_position(rocker, {"phi": 0.31})
    for _ in range(2):
        with pytest.raises(nc.AssemblyError, match="four-bar"):
            nc.solve_position(rocker, {"phi": 2.5})


def test_a_grid_of_two_inputs():
    system = macpherson().compile()
    z, y = np.meshgrid(np.linspace(270, 350, 24), np.linspace(352, 368, 24))
    motion = nc.solve_position(system, {"6.z": z, "10.y": y}, hold=["7.x"])
    assert motion.status.shape == (24, 24) and bool(jnp.all(motion.converged))
    few = nc.solve_position(system, {"6.z": z[3, ::8], "10.y": y[3, ::8]}, hold=["7.x"])
    np.testing.assert_allclose(few.q, np.asarray(motion.q)[3, ::8], atol=1e-10)  # mm
