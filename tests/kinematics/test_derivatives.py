"""Gradients against closed forms, in both directions, through rates, and beside failed lanes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from mechanisms import four_bar, four_bar_joint, reference, slider_crank

import jaxnc as nc
from jaxnc.system.system import characteristic_length

U = np.linspace(0.2, 5.9, 33)
RELATIVE = 1e-9


def parts(d):
    return d["crank"], d["coupler"], d["rocker"], d["coupler_point_local"]


def coupler_point(a, b, c, O2, O4, local, u):
    """Closed form of the coupler point for explicit lengths."""
    A = O2 + a * jnp.stack([jnp.cos(u), jnp.sin(u)])
    e = (four_bar_joint(a, b, c, O2, O4, u, 1.0) - A) / b
    return A + local[0] * e + local[1] * jnp.stack([-e[1], e[0]])


def drawn_point(points, u):
    """Closed form of the coupler point when every length is read off the drawing (O2, O4, A, B, P)."""
    O2, O4, A, B, P = points

    def length(x, y):
        return jnp.sqrt(jnp.sum((x - y) ** 2))

    b = length(A, B)
    e = (B - A) / b
    w = P - A
    local = (w @ e, e[0] * w[1] - e[1] * w[0])
    return coupler_point(length(O2, A), b, length(O4, B), O2, O4, local, u)


def close(got, want, relative=RELATIVE):
    got, want = np.asarray(got), np.asarray(want)
    scale = np.max(np.abs(want))
    assert scale > 0
    assert np.max(np.abs(got - want)) <= relative * scale, (got, want)


def weigh(x):
    """A generic scalar of an array of positions."""
    return jnp.sum(jnp.sin(7.0 * x) * jnp.arange(1.0, 1.0 + x.size).reshape(x.shape) / x.size)


def test_explicit_lengths_and_ground_points():
    d = reference("fourbar_planar")["definition"]
    a, b, c, local = parts(d)
    system = four_bar()

    def of_system(s):
        return weigh(nc.sweep(s, {"phi": U})["P"])

    def of_numbers(a, b, c, O2, O4, local):
        return weigh(jax.vmap(lambda u: coupler_point(a, b, c, O2, O4, local, u))(jnp.asarray(U)))

    args = (a, b, c, jnp.array([0.0, 0.0]), jnp.array([d["ground"], 0.0]), jnp.array(local))
    want = jax.jit(jax.grad(of_numbers, argnums=tuple(range(6))))(*args)
    tangent = jax.tree.map(lambda x: np.cos(np.arange(x.size, dtype=float)).reshape(x.shape), system)
    got, (_, forward) = jax.jit(lambda s, t: (jax.grad(of_system)(s), jax.jvp(of_system, (s,), (t,))))(system, tangent)
    close(
        [got["crank.O2-A"], got["coupler.A-B"], got["rocker.O4-B"]],
        want[:3],
    )
    close(got["O2"], want[3])
    close(got["O4"], want[4])
    close([got["coupler.P.along"], got["coupler.P.across"]], want[5])
    # With explicit dimensions the drawn places of moving points are guesses only.
    for name in ("A", "B", "P"):
        assert np.max(np.abs(got[name])) == 0.0

    backward = sum(np.vdot(x, y) for x, y in zip(jax.tree.leaves(got), jax.tree.leaves(tangent), strict=True))
    close(forward, backward, 1e-12)


def test_lengths_read_off_the_drawing():
    system = four_bar(explicit=False)
    names = ("O2", "O4", "A", "B", "P")

    def of_system(s):
        return weigh(nc.sweep(s, {"phi": U})["P"])

    def of_points(points):
        return weigh(jax.vmap(lambda u: drawn_point(points, u))(jnp.asarray(U)))

    want = jax.jit(jax.grad(of_points))(tuple(system[n] for n in names))
    got = jax.grad(of_system)(system)
    for name, gradient in zip(names, want, strict=True):
        close(got[name], gradient)


@pytest.mark.slow
def test_velocity_and_acceleration_gradients():
    system = four_bar(explicit=False)
    names = ("O2", "O4", "A", "B", "P")
    u, rate = jnp.asarray(U[:9]), 2.0

    def of_system(s):
        mo = nc.sweep(s, {"phi": u}, rates={"phi": rate})
        return weigh(mo.velocity("P")) + weigh(mo.acceleration("P"))

    def of_points(points):
        def at(x):
            return drawn_point(points, x)

        def first(x):
            return jax.jvp(at, (x,), (rate,))[1]

        return weigh(jax.vmap(first)(u)) + weigh(jax.vmap(lambda x: jax.jvp(first, (x,), (rate,))[1])(u))

    points = tuple(system[n] for n in names)
    want = jax.jit(jax.grad(of_points))(points)
    got = jax.grad(of_system)(system)  # compiled: test_derivative_orders.py
    for name, wanted in zip(names, want, strict=True):
        close(got[name], wanted)


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "rscr", "macpherson"])
def test_rows_off_the_constraints_are_differentiated_with_their_scales(name):
    """By the design, at a pose that is none: a central difference needs nothing of what made the gradient."""
    system = getattr(nc.library, name)().compile()
    rng = np.random.default_rng(7)
    q = jnp.asarray(rng.normal(size=len(system.topology.coordinates)))
    lever = jnp.asarray(rng.normal(size=len(system.topology.rows)))
    change = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), system)

    def along(t):
        return lever @ nc.system.residual(jax.tree.map(lambda x, d: x + t * d, system, change), q)

    h = 1e-5
    got = nc.jit(jax.grad(along))(0.0)
    want = (8 * (along(h) - along(-h)) - along(2 * h) + along(-2 * h)) / (12 * h)
    close(got, want, 1e-8)


def test_gradient_with_respect_to_inputs_is_the_velocity():
    system = slider_crank()
    u = jnp.asarray(U)
    mo = nc.sweep(system, {"phi": u}, rates={"phi": 1.0})
    slope = jax.grad(lambda u: jnp.sum(nc.sweep(system, {"phi": u})["S.x"]))(u)
    np.testing.assert_allclose(slope, mo.velocity("S.x"), atol=1e-14)
    second = jax.grad(lambda u: jnp.sum(nc.sweep(system, {"phi": u}, rates={"phi": 1.0}).velocity("S.x")))(u)
    np.testing.assert_allclose(second, mo.acceleration("S.x"), atol=1e-13)


@pytest.mark.parametrize("analysis", [nc.sweep, nc.solve_position])
def test_failed_lanes_leave_the_others_finite_and_exact(analysis):
    """A rocker driven beyond its limit: the poses before it keep their exact gradients, the rest contribute zero."""
    system = slider_crank()
    far = jnp.array([0.25, 0.3, 0.35, 0.5, 0.9]) if analysis is nc.sweep else jnp.array([0.25, 0.5, 0.3, 0.9, 0.35])

    @jax.jit
    def gradients(s, x, keep):
        """Of the good poses' places, and of all that is told of the poses to keep, pulled back side by side."""

        def told(s):
            mo = analysis(s, {"S.x": x}, rates={"S.x": 1.0})
            return (mo["A"], mo.velocity("A") + mo.acceleration("A")), mo

        (place, _), pull, mo = jax.vjp(told, s, has_aux=True)
        weights = jnp.stack([mo.converged & keep, keep]).astype(float)[..., None] * jnp.ones_like(place)
        both = jax.vmap(lambda *of: pull(of)[0])(weights, weights * jnp.array([0.0, 1.0])[:, None, None])
        return *(jax.tree.map(lambda leaf, k=k: leaf[k], both) for k in (0, 1)), mo

    gradient, all_of_them, mo = gradients(system, far, np.ones(5, dtype=bool))
    good = np.asarray(mo.converged)
    assert int(mo.failures) == 2 and good.sum() == 3
    near = jnp.where(good, far, 0.3)  # the same good poses, and others in place of those that fail
    alone, careful, other = gradients(system, near, good)
    assert int(other.failures) == 0
    for x, y in zip(jax.tree.leaves(gradient), jax.tree.leaves(alone), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-14)
    # Even a careless objective that sums failed lanes gets a finite gradient, that of the good lanes.
    for x, y in zip(jax.tree.leaves(all_of_them), jax.tree.leaves(careful), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-13)
    assert np.all(np.isfinite(mo.q))


def arm(lengths=(None, None)):
    m = nc.Mechanism("arm")
    m.ground("A", (0, 0))
    m.point("B", (1, 0.5))
    m.point("C", (1.8, 1.1))
    for name, ends, length in zip("ab", (("A", "B"), ("B", "C")), lengths, strict=True):
        m.body(name, ends, lengths={} if length is None else {ends: length})
    m.angle("p", at="A", to="B")
    m.angle("s", at="B", to="C")
    return m.compile()


def test_what_is_held_follows_the_drawing_in_derivatives():
    def held(s):
        return nc.sweep(s, {"p": jnp.array([0.5, 0.7])}, hold=["s"])["C"][1]

    A, B, C = (np.array(x, float) for x in ((0, 0), (1, 0.5), (1.8, 1.1)))
    length, weights = np.linalg.norm(B - A), np.array([1.0, 0.7])
    along, ahead = (B - A) / length, np.array([np.cos(0.7), np.sin(0.7)])
    system = arm()
    close(held(system), A + length * ahead + C - B)  # the second bar keeps its direction
    got = jax.grad(lambda s: held(s) @ weights)(system)  # by the host; of compiled code see below
    push = (weights @ ahead) * along
    for name, want in zip("ABC", (weights - push, push - weights, weights), strict=True):
        close(got[name], want)

    def guided(x):  # beside a guess for another point
        return nc.solve_position(system.replace({"B": x}), {"p": 0.7}, hold=["s"], start={"B": (0.8, 0.7)})["C"][0]

    way = np.array([0.6, 0.8])
    second = nc.jit(lambda x: jax.jvp(jax.grad(guided), (x,), (way,))[1])
    close(second(B), ahead[0] * (way - along * (along @ way)) / length)


def test_what_is_held_follows_lengths_that_are_given():
    drawn = arm((1.2, 0.9))
    q = nc.solve_position(drawn, {}, hold=["p", "s"])
    system = drawn.replace({name: np.asarray(q[name]) for name in "BC"})  # the drawing meets its lengths

    def held(s):
        return nc.solve_position(s, {"p": 0.7}, hold=["s"])["C"][0]

    got, h = nc.jit(jax.grad(held))(system), 1e-5
    for name in ("B", "C", "a.A-B", "b.B-C"):
        x = np.asarray(system[name], float)
        for k in np.ndindex(x.shape):
            d = np.zeros_like(x)
            d[k] = h
            slope = (held(system.replace({name: x + d})) - held(system.replace({name: x - d}))) / (2 * h)
            assert abs(np.asarray(got[name])[k] - slope) < 1e-8  # differences, of second order


def test_a_gradient_where_a_pose_is_out_of_reach_tells_how_far_it_goes():
    """A crank that stops at 139.9°: values are known where a gradient is asked for, though they are traced."""
    m = nc.Mechanism("rocker")
    m.ground("A", (0, 0)), m.ground("D", (4, 0)), m.point("B", (0, 1)), m.point("C", (3.3, 2.9))
    m.body("crank", ["A", "B"]), m.body("coupler", ["B", "C"]), m.body("rocker", ["C", "D"], lengths={("C", "D"): 1.0})
    m.angle("phi", at="A", to="B")
    system = m.compile()
    with pytest.raises(nc.AssemblyError, match=r"as far as phi = 2\.44"):
        jax.grad(lambda phi: nc.solve_position(system, {"phi": phi})["C"][0])(3.0)
    with pytest.raises(nc.AssemblyError, match=r"got to 2\.44"):
        jax.grad(lambda k: nc.sweep(system, {"phi": k * np.array([1.0, 2.0, 3.0])}, throw=True)["C"][-1, 0])(1.0)


def five_bar(length, **options):
    m = nc.Mechanism("five-bar")
    for name, at in {"A": (0.0, 0.0), "E": (1.0, 0.0)}.items():
        m.ground(name, at)
    for name, at in {"B": (0.1, 0.5), "C": (0.6, 1.0), "D": (1.2, 0.6)}.items():
        m.point(name, at)
    m.body("AB", ["A", "B"])
    m.body("BC", ["B", "C"], lengths={("B", "C"): length})
    m.body("CD", ["C", "D"])
    m.body("DE", ["D", "E"])
    m.angle("phi", at="A", to="B")
    m.angle("psi", at="E", to="D")
    return m.compile(**options)


def test_a_drawing_off_its_lengths_is_assembled_where_it_is_closest():
    """Against SciPy's least distance under the lengths, and differences of first derivatives."""
    system = five_bar(0.9)
    drawn = {name: np.asarray(system[name]) for name in "BCD"}
    start, size = np.concatenate([*drawn.values()]), float(characteristic_length(system.parameters.points))

    def angles(x):
        b, _, d = x.reshape(3, 2)
        return np.array([np.arctan2(b[1], b[0]), np.arctan2(d[1], d[0] - 1.0)])

    def lengths(x):
        b, c, d = x.reshape(3, 2)
        bars = [b, c - b, d - c, d - np.array([1.0, 0.0])]
        return np.hypot(*np.array(bars).T) - [np.hypot(0.1, 0.5), 0.9, np.hypot(0.6, 0.4), np.hypot(0.2, 0.6)]

    def distance(x):
        return np.sum((x - start) ** 2) + size**2 * np.sum((angles(x) - angles(start)) ** 2)

    wanted = scipy.optimize.minimize(
        distance, start, method="SLSQP", constraints={"type": "eq", "fun": lengths}, options={"ftol": 1e-15}
    )

    def held(x, length):
        design = system.replace({"C": x, "BC.B-C": length})
        return nc.solve_position(design, {"phi": 1.3}, hold=["psi"])["psi"]

    at = jnp.asarray(drawn["C"]), jnp.asarray(0.9)
    assert float(held(*at)) == pytest.approx(angles(wanted.x)[1], abs=1e-6)  # as near as SLSQP comes
    h, steps = 1e-5, np.eye(3)
    ends = [[(at[0] + k * h * e[:2], at[1] + k * h * e[2]) for k in (1, -1)] for e in steps]
    close(np.hstack(jax.grad(held, (0, 1))(*at)), [(held(*a) - held(*b)) / (2 * h) for a, b in ends], 1e-8)

    def slope(*x):
        whole = jax.grad(held, (0, 1))(*x)
        return whole[0], whole

    hessian, gradient = nc.jit(jax.jacfwd(slope, has_aux=True))(*at)
    close(np.hstack(gradient), np.hstack(jax.grad(held, (0, 1))(*at)))
    slopes = [[jax.grad(held)(*a) - jax.grad(held)(*b)] for a, b in ends[:2]]
    close(hessian, np.concatenate(slopes) / (2 * h), 1e-7)


def test_a_drawing_is_brought_to_its_closest_pose_where_newtons_steps_lead_away():
    """The derivative is that of the closest pose, and of no other."""
    system = five_bar(0.47).replace({"B": (0.25, 0.67), "D": (1.17, 0.45)})

    def held(y):
        return nc.solve_position(system.replace({"C": jnp.stack([0.62, y])}), {"phi": 1.3}, hold=["psi"])["psi"]

    for y in (0.57, 0.6):
        close(jax.grad(held)(y), (held(y + 1e-5) - held(y - 1e-5)) / 2e-5, 1e-6)


def test_designs_of_a_truss_are_mapped():
    """The apex of two bars, by the law of cosines."""
    m = nc.Mechanism("truss")
    m.ground("A", (0, 0))
    m.ground("B", (1, 0))
    m.point("C", (0.5, 1))
    m.body("a", ["A", "C"], lengths={("A", "C"): 1.3})
    m.body("b", ["B", "C"])
    system, lengths = m.compile(), np.array([1.1, 1.3])
    found = jax.vmap(lambda a: nc.solve_position(system.replace({"a.A-C": a}), {})["C"])(jnp.asarray(lengths))
    x = (lengths**2 - 1.25 + 1.0) / 2.0
    close(found, np.stack([x, np.sqrt(lengths**2 - x**2)], axis=1))


def test_a_sparse_start_follows_lengths():
    system = five_bar(float(np.hypot(0.5, 0.5)), sparse=True)  # the drawing meets it

    def held(length):
        return nc.solve_position(system.replace({"BC.B-C": length}), {"phi": 1.3}, hold=["psi"])["C"]

    at, h = jnp.hypot(0.5, 0.5), 1e-6
    close(jax.jacfwd(held)(at), (held(at + h) - held(at - h)) / (2 * h), 1e-7)


def test_sensitivities_of_several_designs_are_asked_for_one_by_one():
    system = nc.library.four_bar().compile()
    places = jnp.asarray(system["D"]) + jnp.array([[0.0, 0.0], [1e-2, 0.0]])
    motion = jax.vmap(lambda x: nc.solve_position(system.replace({"D": x}), {"phi": 1.3}))(places)
    with pytest.raises(nc.InputError, match="several designs"):
        nc.sensitivity(motion, "C")
    found = nc.sensitivity(motion.pose(1), "C", variables=["D.x"])["C"][:, 0]
    ends = [
        nc.solve_position(system.replace({"D": places[1] + jnp.array([e, 0.0])}), {"phi": 1.3})["C"]
        for e in (-1e-6, 1e-6)
    ]
    np.testing.assert_allclose(found, (ends[1] - ends[0]) / 2e-6, rtol=1e-6)
