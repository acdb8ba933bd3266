"""Programs that kinds are read as: their values, derivatives, degree and sparsity, against JAX's own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import four_bar_mechanism

import jaxnc as nc
from jaxnc.constraints import CATALOGUE, Kind, elementary
from jaxnc.reading import Number, Unreadable, function, partials, polynomials, rate, trace, write
from jaxnc.solvers.assembly import derive, to_host
from jaxnc.system import structure
from jaxnc.system.equations import entries, equations, guards, residual
from jaxnc.system.structure import host_kind

RNG = np.random.default_rng(5)
ROUNDING = 1e-12  # the same arithmetic in another order


def _dim(kind: Kind) -> int:
    """The plane, unless its functions want a third component."""
    try:
        structure.program(kind, "residual", 2)
    except nc.errors.InputError:
        return 3
    return 3 if kind.vectors else 2


@pytest.mark.parametrize("kind", [k for k in CATALOGUE.values() if k.rows], ids=lambda k: k.name)
def test_values_and_derivatives_of_the_catalogue(kind):
    dim = _dim(kind)
    count = structure.size(kind, dim)
    x = np.random.default_rng(5).uniform(0.4, 1.6, count + len(kind.constants))

    def rows(x):
        return jnp.stack([jnp.asarray(r, float) for r in kind.residual(*structure.arrays(kind, dim, x))])

    with jax.disable_jit():
        wanted = np.asarray(rows(x))
    read = host_kind(kind, dim)
    np.testing.assert_allclose(np.array(read.rows(list(x)), float), wanted, atol=ROUNDING)
    # Derivatives against differences of fourth order of the program's own values.
    step = 1e-4
    for (r, v), slope in zip(read.places, read.slopes(list(x)), strict=True):
        at = [x + k * step * np.eye(len(x))[v] for k in (-2, -1, 1, 2)]
        a, b, c, d = (read.rows(list(y))[r] for y in at)
        assert slope == pytest.approx((a - 8 * b + 8 * c - d) / (12 * step), rel=1e-7, abs=1e-7)


def _functions(kind: Kind, dim: int):
    """Every function of a kind as one of plain numbers, with their number."""
    count = structure.size(kind, dim) + len(kind.constants)
    for which in ("residual", "drawn", "guard", "measure", "misfit"):
        f, single = getattr(kind, which), which in ("measure", "misfit")
        if f is not None:

            def called(*x, f=f, single=single):
                p, v, s, c = structure._as_small(kind, dim, x)
                return (f(p, v, c),) if single else tuple(f(p, v, s, c))

            yield called, count


def test_every_kind_is_written_by_plain_numbers_as_jax_traces_it():
    """The catalogue is read without JAX; what it would have read is the same, in every eleventh of its functions."""
    found = []
    for kind in CATALOGUE.values():
        try:
            found += [(*each, write(*each)) for each in _functions(kind, 2)]
        except IndexError:  # it wants a third component
            found += [(*each, write(*each)) for each in _functions(kind, 3)]
    assert len(found) > 600
    for f, count, program in found[::11]:
        traced = trace(f, *[()] * count)
        x = list(RNG.uniform(-1.5, 1.5, (count, 3)))
        wanted = [np.broadcast_to(y, 3) for y in function(traced)(x)]
        np.testing.assert_allclose([np.broadcast_to(y, 3) for y in function(program)(x)], wanted, atol=ROUNDING)


def test_sine_and_cosine_written_out_for_xla_are_read_as_operations():
    """In a plain function, in a derivative and in many lanes, where JAX has taken their rules and calls apart."""

    def product(x):
        return elementary.sin(x) * elementary.cos(x)

    def lanes(x):
        return jax.vmap(product)(jnp.stack([x, 2.0 * x])).sum()

    for f in (product, jax.grad(product), lanes):
        read = trace(lambda x, f=f: (f(x),), ())
        assert {node.op for node in read.nodes} <= {"input", "number", "sin", "cos", "neg", "mul", "add"}
        np.testing.assert_allclose(function(read)([0.7])[0], f(0.7), atol=ROUNDING)


def test_numbers_that_write_down_what_is_done_to_them():
    def f(x, y, z):
        greater = (x > y) & ~(y >= 0.25) | (x == y)
        assert isinstance(greater, Number)
        chosen = greater.apply("select", x, 1)
        return (2 - x) / y**3, [abs(-z) + x**2, x**0 * y**1, z**0.5], np.float64(3.0) * x, chosen

    x, y, z = RNG.uniform(0.2, 1.0, (3, 4))
    found = [np.broadcast_to(n, 4) for n in function(write(f, 3))([x, y, z])]
    wanted = [(2 - x) / y**3, z + x**2, y, np.sqrt(z), 3.0 * x, np.where((x > y) & (y < 0.25), x, 1.0)]
    np.testing.assert_allclose(found, wanted, atol=ROUNDING)
    for unwritable in (
        lambda x: jnp.sin(x),
        lambda x: x if x > 0 else -x,
        lambda x: float(x),
        lambda x: np.sqrt(x),
        lambda x: x + "1",
        lambda x: None,
        lambda x: jnp.asarray([x, x]),
    ):
        with pytest.raises(TypeError):
            write(unwritable, 1)


def test_a_kind_in_jax_numpy_is_read_from_its_jaxpr():
    kind = Kind("unit circle", lambda p, v, s, c: (jnp.linalg.norm(jnp.asarray(p)[0]) - 1.0,), points=1)
    found = structure.program(kind, "residual", 2)
    assert found is not None
    assert function(found)([3.0, 4.0])[0] == pytest.approx(4.0)


def test_functions_of_arrays_are_read_number_by_number():
    def f(a, b):
        m = jnp.outer(a, b) + jnp.eye(3)
        return (
            m @ a,
            jnp.where(b > 0.5, jnp.sqrt(jnp.abs(b)), b**3).sum(),
            jnp.cross(a, b),
            jnp.concatenate([a[::-1], b[:1]]),
            jnp.max(a) - jnp.min(b) + jnp.prod(a),
            jnp.arctan2(a, b) + jnp.tanh(a) * jnp.exp(-b),
            a[jnp.array([2, 0])] / jnp.linalg.norm(b),
        )

    program = trace(f, (3,), (3,))
    a, b = RNG.uniform(0.2, 1.0, (2, 3))
    joined = jax.jit(lambda x: jnp.concatenate([jnp.ravel(y) for y in f(x[:3], x[3:])]))
    wanted = joined(np.array([*a, *b]))
    np.testing.assert_allclose(np.array(function(program)([*a, *b])), wanted, atol=ROUNDING)
    slopes, places = partials(program, range(6))
    found = np.zeros((program.outputs.__len__(), 6))
    for (r, v), value in zip(places, function(slopes)([*a, *b]), strict=True):
        found[r, v] = value
    exact = jax.jit(jax.jacfwd(joined))(np.array([*a, *b]))
    np.testing.assert_allclose(found, exact, atol=ROUNDING)
    # Lanes are arrays of any shape.
    lanes = RNG.uniform(0.2, 1.0, (6, 4, 5))
    out = function(program)(list(lanes))
    one = function(program)(list(lanes[:, 1, 3]))
    np.testing.assert_allclose([np.broadcast_to(x, (4, 5))[1, 3] for x in out], one, atol=ROUNDING)


AT = jnp.array([[0, 1], [2, 3], [1, 1]])
MOVES = [
    lambda a, b: a[jnp.array([2, 0, 1])],
    lambda a, b: a[:, jnp.array([3, -1, 0])],
    lambda a, b: a[jnp.array([0, 2]), jnp.array([1, 3])],
    lambda a, b: a[jnp.array([[0, 2], [1, 1]]), 1:3],
    lambda a, b: jnp.take_along_axis(a, AT, axis=1),
    lambda a, b: jax.vmap(lambda row, at: row[at])(a, AT),
    lambda a, b: a.at[jnp.array([1, 7])].get(mode="fill", fill_value=3.0),
    lambda a, b: a.at[jnp.array([1, -9])].get(mode="fill", fill_value=3.0),
    lambda a, b: a.at[jnp.array([1, 7])].get(mode="clip"),
    lambda a, b: jax.lax.dynamic_slice(a, (1, 2), (2, 2)),
    lambda a, b: jax.lax.dynamic_update_slice(a, b[None, :2], (1, 3)),
    lambda a, b: jax.lax.dynamic_update_slice(a, b[None, :2], (-5, 1)),
    lambda a, b: jax.lax.pad(a, b[0], ((1, 2, 1), (-1, 1, 2))),
    lambda a, b: jax.lax.pad(b, 0.5, ((-2, -1, 1),)),
    lambda a, b: jax.lax.pad(b[0], 0.5, ()),
    lambda a, b: a.at[jnp.array([0, 2])].set(b[:4]),
    lambda a, b: a.at[jnp.array([0, 2, 0])].add(b[:4]),
    lambda a, b: a.at[jnp.array([0, 2]), jnp.array([1, 3])].add(b[:2]),
    lambda a, b: a.at[:, jnp.array([1, 1])].add(b[0]),
    lambda a, b: a.at[jnp.array([0, 9])].add(b[:4], mode="clip"),
    lambda a, b: a.at[jnp.array([0, 9])].add(b[:4], mode="drop"),
    lambda a, b: a.at[1:, 2].add(b[:2]),
    lambda a, b: jax.vmap(lambda row, at, u: row.at[at].add(u))(a, AT, jnp.outer(b[:3], b[:2])),
    lambda a, b: jax.grad(lambda a: jnp.sum(jnp.take_along_axis(a, AT, axis=1) ** 2))(a),
]


def test_numbers_are_moved_as_jax_moves_them():
    """By gathering, scattering, slices and padding, beyond the array too."""

    def every(a, b):
        return jnp.concatenate([jnp.ravel(move(a, b)) for move in MOVES])

    x = RNG.normal(size=17)
    found = function(trace(every, (3, 4), (5,)))(list(x))
    np.testing.assert_array_equal(np.array(found), jax.jit(every)(x[:12].reshape(3, 4), x[12:]))


def test_rates_are_time_derivatives_of_any_order():
    program = trace(lambda x, y: (jnp.sin(x) * y / (1.0 + x * x),), (), ())
    curve = (0.3, 0.7, -0.4, 0.2), (1.1, -0.2, 0.6, 0.5)  # Taylor coefficients of x and y
    x, y = (lambda t, c=c: sum(a * t**k for k, a in enumerate(c)) for c in curve)
    g = lambda t: jnp.sin(x(t)) * y(t) / (1.0 + x(t) ** 2)  # noqa: E731
    factors = (1.0, 1.0, 2.0, 6.0)
    for order in (1, 2, 3):
        g = jax.grad(g)
        terms = [factors[k] * c[k] for k in range(1, order + 1) for c in curve]
        found = function(rate(program, (0, 1), order))([curve[0][0], curve[1][0], *terms])[0]
        assert found == pytest.approx(float(jax.jit(g)(0.0)), abs=1e-12)


def test_degree_and_sparsity_are_derived():
    program = trace(lambda x, y, c: (x * x * c - y * c * 2.0 + x * y, x * y * x, jnp.sin(c) * x, x - x + y), (), (), ())
    first, second, third, last = polynomials(program, (0, 1))
    assert set(first.terms) == {(0, 0), (1,), (0, 1)} and first.depends == {0, 1}
    assert set(second.terms) == {(0, 0, 1)}
    assert set(third.terms) == {(0,)} and third.depends == {0}
    assert last.depends == {1}


def cam(p, v, s, c):
    """Rises with the square of what the angle is beyond 2 rad."""
    over = jnp.maximum(s[0] - 2.0, 0.0)
    return (p[0][1] - 0.2 - 0.1 * over * over,)


CAM = Kind("late cam", cam, rows=("lift",), points=1, scalars=1, source="a user's own")
CUBIC = Kind(
    "cubic", lambda p, v, s, c: (p[0][0] ** 3 - p[0][1],), rows=("cubic",), powers=(1,), points=1, source="a user's own"
)
LOOP = Kind(
    "loop",
    lambda p, v, s, c: (jax.lax.fori_loop(0, 3, lambda _, x: x * p[0][0], p[0][1]),),
    rows=("loop",),
    points=1,
    source="a user's own",
)


def test_a_cam_that_rises_late_depends_on_its_angle():
    assert structure.pattern(CAM, 2).tolist() == [[False, True, True]]
    m = nc.Mechanism("cam")
    A, B, F = m.ground("A", (0, 0)), m.point("B", (1, 0)), m.point("F", (3, 0.2), fixed="x")
    m.body("shaft", [A, B])
    m.angle("phi", at=A, to=B)
    m.constrain("cam", CAM, points=[F], scalars=["phi"])
    phi = np.linspace(0.0, 3.0, 31)
    lift = nc.sweep(m.compile(), {"phi": phi})["F"][:, 1]
    np.testing.assert_allclose(lift, 0.2 + 0.1 * np.maximum(phi - 2.0, 0.0) ** 2, atol=1e-12)


def test_a_cubic_is_no_quadratic_whatever_is_said():
    assert not structure.quadratic(CUBIC, 2)
    assert structure.curvature(CUBIC, 2, (0, 1)) == (None,)
    assert structure.curvature(CUBIC, 2, (1,)) == ((),)


def test_what_cannot_be_read_is_evaluated_by_jax():
    with pytest.raises(Unreadable, match=r"while|scan"):
        trace(lambda x: (jax.lax.fori_loop(0, 3, lambda _, y: y * x, x),), ())
    assert structure.program(LOOP, "residual", 2) is None
    q = np.array([[0.7, 0.9], [0.3, 0.2]])
    kind = host_kind(LOOP, 2)
    np.testing.assert_allclose(kind.rows(list(q))[0], q[1] * q[0] ** 3, atol=1e-14)
    slopes = dict(zip(kind.places, kind.slopes(list(q)), strict=True))
    np.testing.assert_allclose(slopes[0, 0], 3 * q[1] * q[0] ** 2, atol=1e-14)
    first, second = kind.rates(1), kind.rates(2)
    np.testing.assert_allclose(first([*q, 1.0, 0.0])[0], 3 * q[1] * q[0] ** 2, atol=1e-14)
    np.testing.assert_allclose(second([*q, 1.0, 0.0, 0.0, 0.0])[0], 6 * q[1] * q[0], atol=1e-14)


@pytest.mark.parametrize("mechanism", [four_bar_mechanism, nc.library.macpherson, nc.library.jansen_leg])
def test_equations_on_the_host_are_those_of_jax(mechanism):
    system = mechanism().compile()
    told, there = derive(system), jax.jit(equations)(system)
    here = to_host(told)
    for a, b in zip(jax.tree.leaves(told), jax.tree.leaves(there), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12 * max(1.0, float(np.max(np.abs(b), initial=0.0))))
    q = here.home + 0.01 * here.length * RNG.uniform(-1.0, 1.0, len(here.home))
    np.testing.assert_allclose(here.residual(q[:, None])[:, 0], residual(there, q), atol=1e-12 * here.length)
    scale = float(np.max(np.abs(entries(there, q))))
    np.testing.assert_allclose(here.entries(q[:, None])[:, 0], entries(there, q), atol=1e-12 * scale)
    rows, bodies = guards(there, q)
    upright, mirrored = here.guards(q[:, None])
    assert upright[0] == bool(jnp.all(rows > 0) & jnp.all(bodies > 0)) and mirrored[0] == bool(jnp.any(bodies <= 0))
