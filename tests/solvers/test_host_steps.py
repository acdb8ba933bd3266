"""Newton's step as one program against the dense matrices that it stands for, and guesses in NumPy."""

import math

import jax
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.kinematics import host_solve
from jaxnc.kinematics.inputs import make_plan
from jaxnc.reading import Builder, function
from jaxnc.solvers.assembly import derive, settle, to_host
from jaxnc.solvers.host import HostView, correct_poses
from jaxnc.solvers.host import view as view_module

MECHANISMS = {
    "four-bar": (lambda: nc.library.four_bar(explicit=False), ("phi",), ()),
    "jansen": (nc.library.jansen_leg, ("phi",), ()),
    "gears": (nc.library.gear_pair, ("phi",), ()),
    "five-bar": (nc.library.five_bar, ("phi", "psi"), ()),
    "held": (nc.library.five_bar, ("phi",), ("psi",)),
    "quick return": (nc.library.quick_return, ("phi",), ()),
}


def both_ways(name):
    """A view of a plan with the program, another without, and poses that do not meet the constraints quite."""
    make, names, hold = MECHANISMS[name]
    system = make().compile()
    names = tuple(n for n in names if n in system.topology.coordinates) or system.topology.scalars[:1]
    eq = derive(system)
    view, dense = (HostView(make_plan(system, names, hold), to_host(eq)) for _ in range(2))
    dense.program = None
    q = np.asarray(settle(eq, np.zeros(eq.home.shape)).q)
    moved = 0.02 * float(eq.length) * np.random.default_rng(2).uniform(-1.0, 1.0, (len(q), 7))
    moved[view.plan.fixed] = 0.0
    return view, dense, q[:, None] + moved


@pytest.mark.parametrize("name", MECHANISMS)
def test_the_program_of_a_plan_is_its_dense_algebra(name):
    view, dense, q = both_ways(name)
    assert view.program is not None
    size = float(view.eq.length)
    for at in (q, q[:, :1]):  # lanes, and one lane as plain numbers
        here, there = view.evaluate(at), dense.evaluate(at)
        np.testing.assert_allclose(here.residual, there.residual, atol=1e-13 * size)
        np.testing.assert_allclose(here.step, there.step, atol=1e-11 * size)
        np.testing.assert_allclose(here.slopes, there.slopes, atol=1e-10 * np.abs(there.slopes).max())
        product, other = (np.prod(x.signs, axis=0) * np.exp(x.sizes.sum(axis=0)) for x in (here, there))
        np.testing.assert_allclose(np.abs(product), np.abs(other), rtol=1e-10)
        np.testing.assert_allclose(view.conditioning(at), dense.conditioning(at), rtol=1e-8)
        right = np.random.default_rng(3).uniform(-1.0, 1.0, here.residual.shape)
        solved, wanted = view.solver(at)(right), dense.solver(at)(right)
        np.testing.assert_allclose(solved, wanted, atol=1e-11 * max(1.0, np.abs(wanted).max()))
        for x, y in zip(view.polish(at), dense.polish(at), strict=True):
            np.testing.assert_allclose(x, y, atol=1e-8 * max(1.0, np.abs(y).max()))


@pytest.mark.parametrize("name", MECHANISMS)
def test_one_pose_is_what_many_are(name):
    view, _, q = both_ways(name)
    alone, lanes = (
        np.concatenate(x, axis=1)
        for x in ([correct_poses(view, q[:, [k]]) for k in range(7)], [correct_poses(view, q)])
    )
    right = np.abs(view.residual(lanes)).max(axis=0) <= view.tolerance(lanes)
    assert right.sum() > 4
    np.testing.assert_allclose(alone[:, right], lanes[:, right], atol=1e-12 * float(view.eq.length))
    for k in np.flatnonzero(right):
        size, upright, mirrored = view.check(lanes[:, [k]])
        np.testing.assert_allclose(
            size, np.abs(view.eq.residual(lanes[:, [k]])).max(), atol=1e-14 * float(view.eq.length)
        )
        np.testing.assert_array_equal((upright, mirrored), view.eq.guards(lanes[:, [k]]))


@pytest.mark.parametrize("smallest", [1.0, 1e-2, 1e-5, 1e-9])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_more_rows_than_unknowns_are_solved_by_normal_equations_where_these_do(smallest, dtype):
    """Against matrices that are made from their singular values: the smallest is given, and so is the solution."""
    rng = np.random.default_rng(4)
    smallest = max(smallest, 1e3 * float(np.finfo(dtype).eps))
    u, v = (np.linalg.qr(rng.normal(size=(5, n, 6)))[0] for n in (8, 6))
    matrix = (u * np.geomspace(1.0, smallest, 6) @ np.swapaxes(v, 1, 2)).astype(dtype)
    wanted = rng.normal(size=(5, 6, 2)).astype(dtype)
    right, inverse = matrix @ wanted, view_module.inverse_of(matrix)
    found = inverse @ right
    found += inverse @ (right - matrix @ found)
    assert found.dtype == dtype
    np.testing.assert_allclose(found, wanted, atol=1e2 * float(np.finfo(dtype).eps) / smallest)


def test_conditioning_of_more_rows_than_unknowns_is_that_of_orthogonal_columns():
    system = nc.library.bennett().compile()
    eq = derive(system)
    view = HostView(make_plan(system, ("phi",), ()), to_host(eq))
    assert view.redundant
    q = np.asarray(settle(eq, np.zeros(eq.home.shape)).q)[:, None] + np.zeros(3)
    unknown = view.plan.unknown
    q[unknown, 1] += 0.01 * float(eq.length) * np.random.default_rng(2).uniform(-1.0, 1.0, len(unknown))
    q[unknown, 2] = q[unknown[0], 2]  # all points in one, where nothing is regular
    scaled = view.matrices(q)[0] / view.inner
    triangle = np.abs(np.diagonal(np.linalg.qr(scaled)[1], axis1=1, axis2=2))
    with np.errstate(all="ignore"):
        found, (r, step, other) = view.conditioning(q), view.polish(q)
    np.testing.assert_allclose(found, triangle.min(axis=1) / triangle.max(axis=1), rtol=1e-8, atol=1e-12)
    np.testing.assert_array_equal(found, other)
    for k in (0, 1):
        exact = np.linalg.lstsq(scaled[k], r[:, k], rcond=None)[0] / view.inner
        np.testing.assert_allclose(step[:, k], exact, atol=1e-10 * float(eq.length))


# More rows than unknowns; as many; past positions that are singular but for 1e-4 of the way.
@pytest.mark.parametrize(("name", "digits"), [("bennett", 1e-13), ("wobble_plate", 1e-13), ("roberts", 1e-9)])
def test_inverses_of_some_poses_do_for_their_neighbours(name, digits, monkeypatch):
    """Against every pose by its own matrices: nothing is left of what interpolation gets wrong."""
    system, angles, inverted = getattr(nc.library, name)().compile(), np.linspace(0.3, 6.5, 360), []
    driven = "phi" if "phi" in system.topology.coordinates else system.topology.scalars[0]

    def inverse(matrix, of=view_module.inverse_of):
        inverted.append(len(matrix))
        return of(matrix)

    monkeypatch.setattr(view_module, "inverse_of", inverse)
    found = nc.sweep(system, {driven: angles}, rates={driven: 1.0})
    assert sum(inverted) < 300  # for poses, judgement and rates; one by one they are a thousand
    monkeypatch.setattr(HostView, "wants_order", False)
    wanted = nc.sweep(system, {driven: angles}, rates={driven: 1.0})
    good = np.asarray(wanted.status) == 0
    assert good.sum() > 40
    np.testing.assert_array_equal(found.status, wanted.status)
    for x, y in zip((found.poses, *found.rates), (wanted.poses, *wanted.rates), strict=True):
        np.testing.assert_allclose(x[good], y[good], rtol=0.0, atol=digits * np.abs(y[good]).max())
    np.testing.assert_allclose(found.conditioning[good], wanted.conditioning[good], atol=1e-11)
    assert np.max(found.residual[good]) <= 1e-13 * float(derive(system).length)


def test_a_neighbour_proves_orientation_only_where_nothing_singular_lies_between():
    """Of matrices on a line through a singular one: the bound holds for none on its other side."""
    rng = np.random.default_rng(1)
    u, v = (np.linalg.qr(rng.normal(size=(6, 6)))[0] for _ in range(2))
    t = np.linspace(-1.0, 1.0, 200)
    lanes = np.array([u @ np.diag([x, 1.0, 2.0, 1.0, 3.0, 1.0]) @ v for x in t])
    close = view_module.near(t[None], 6.0, lambda at: lanes[at])
    assert close is not None
    proper = close.proper(lanes)
    assert np.all(np.sign(t[close.at][close.nearest])[proper] == np.sign(t)[proper])
    assert proper[np.abs(t) > 0.5].all() and not proper.all()


def test_what_is_singular_is_not_finite_and_has_no_conditioning():
    view, _, q = both_ways("four-bar")
    stretched = np.array(q[:, :1])
    position = MECHANISMS["four-bar"][0]().compile().topology.position
    at, pin, pivot = ([position[f"{p}.{x}"] for x in "xy"] for p in "CBD")
    stretched[at] = 0.5 * (stretched[pin] + stretched[pivot])  # the coupler in one line with the rocker
    with np.errstate(all="ignore"):
        step = view.evaluate(stretched).step
        assert not np.isfinite(step).all() or np.abs(step).max() > 1e12
        assert view.conditioning(stretched)[0] < 1e-12


def test_programs_of_plain_numbers():
    b = Builder(2)
    x, y = b.first
    ops = [b.op(name, x) for name in ("sign", "floor", "ceil", "round", "abs", "sin", "exp", "not", "finite")]
    ops += [b.op(name, x, y) for name in ("max", "min", "rem", "pow", "atan2")]
    ops.append(b.op("select", b.op("lt", x, y), x, y))
    program = b.program(ops)
    for values in ((2.5, 1.25), (0.5, 2.0), (3.5, -1.0), (0.0, 1.0)):
        plain, lanes = function(program, math)(values), function(program)([np.array([v]) for v in values])
        np.testing.assert_allclose(plain, [float(v[0]) for v in lanes], atol=1e-14)
    assert function(program, math)((-2.5, 2.0))[0] == -1.0


def test_the_pose_nearest_to_a_guess_is_that_of_the_compiled_solver():
    system = nc.library.four_bar(explicit=False).compile()
    phi = np.array([1.0, 1.2, 2.0, 2.6])
    start = nc.solve_position(system, {"phi": 1.1})
    B, C = (np.asarray(start[name]) for name in "BC")
    D = np.asarray(start["D"])
    along = (D - B) / np.linalg.norm(D - B)
    mirrored = C - 2 * ((C - B) - along * ((C - B) @ along))
    # One program for both guesses of a point.
    by_place = jax.jit(lambda u, guess: nc.solve_position(system, {"phi": u}, start=guess).q)
    for guess in (start, {"C": C}, {"C": mirrored}):
        found = nc.solve_position(system, {"phi": phi}, start=guess)
        traced = by_place(phi, guess)
        np.testing.assert_allclose(found.q, traced, atol=1e-12)
        assert isinstance(found.poses, np.ndarray) and bool(found.converged.all())
    other = nc.solve_position(system, {"phi": 1.1}, start={"C": mirrored})
    np.testing.assert_allclose(other["C"], mirrored, atol=1e-12)
    near = host_solve.solve_nearest(
        make_plan(system, ("phi",), ()), to_host(derive(system)), start.q[None], np.array([[1.1]])
    )
    np.testing.assert_allclose(near.q[0], start.q, atol=1e-13)


def test_a_branch_that_ends_is_followed_to_its_end_in_few_steps(monkeypatch):
    """Against the angle of the crank at which coupler and rocker are in line; it took 141 evaluations."""
    bars = nc.library.four_bar(0.5, 0.6, 0.4, 0.8, explicit=False)
    system, count, evaluate = bars.compile(), [0], HostView.evaluate

    def counted(view, q):
        count[0] += 1
        return evaluate(view, q)

    monkeypatch.setattr(HostView, "evaluate", counted)
    motion = nc.solve_position(system, {"phi": math.pi}, throw=False)
    end = math.acos((0.5**2 + 0.8**2 - (0.6 + 0.4) ** 2) / (2 * 0.5 * 0.8))
    assert motion.status == nc.Status.DID_NOT_ASSEMBLE
    assert end - 1e-6 < motion["phi"] <= end + 1e-9  # of a way of two radians: a smaller step is none
    assert count[0] <= 100  # it takes 65


@pytest.mark.parametrize(
    ("lengths", "home", "asked"),
    [
        ((0.3542834705004823, 0.9147741150483615, 0.9656349149560621, 1.5261320623103602), -2.1832377567, -5.2),
        ((0.32247958478779953, 1.1385338555416953, 1.1658141034441434, 1.9819009325671062), 0.2889227881, 3.3),
    ],
)
def test_a_long_step_does_not_leap_over_a_gap_of_millionths(lengths, home, asked):
    """Behind it the tangents of what rebounds have a kink; crank and ground in line are longer than the other two."""
    a, b, c, d = lengths
    crank = a * np.array([math.cos(home), math.sin(home)])
    to = np.array([d, 0.0]) - crank
    far = math.hypot(*to)
    along, side = to / far, np.array([-to[1], to[0]]) / far
    reach = (far**2 + b**2 - c**2) / (2.0 * far)
    assert 1e-6 < (a + d - b - c) / d < 2e-5
    for sign in (1.0, -1.0):
        m = nc.Mechanism("nearly foldable")
        m.ground("A", (0.0, 0.0))
        m.ground("D", (d, 0.0))
        m.point("B", crank)
        m.point("C", crank + reach * along + sign * math.sqrt(b**2 - reach**2) * side)
        for bar in ("AB", "BC", "CD"):
            m.body(bar, list(bar))
        m.angle("phi", at="A", to="B")
        system = m.compile()
        assert nc.solve_position(system, {"phi": asked}, throw=False).status == nc.Status.DID_NOT_ASSEMBLE
        short = math.copysign(math.pi, asked) - 0.02 * math.copysign(1.0, asked)
        assert nc.solve_position(system, {"phi": short}).converged
