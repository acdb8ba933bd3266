"""Kinds of a user's own: what they may calculate with, what is refused at the door, and jumps and kinks in them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxnc as nc
from jaxnc.constraints import Kind
from jaxnc.errors import InputError, MechanismError
from jaxnc.system import structure

PHI = np.linspace(0.0, 2.0, 12)


def drawn(residual, height=0.2, points=1, scalars=1, **more) -> nc.Mechanism:
    """A follower P above a shaft that phi turns, and a kind of one row that ties them."""
    m = nc.Mechanism("m")
    A, B = m.ground("A", (0, 0)), m.point("B", (1, 0))
    m.body("shaft", [A, B])
    m.angle("phi", at=A, to=B)
    P, Q = m.point("P", (3, height), fixed="x"), m.ground("Q", (2, 0.1))
    kind = Kind("tie", residual, rows=("height",), points=points, scalars=scalars, **more)
    m.constrain("tie", kind, points=[P, Q][:points], scalars=["phi"][:scalars])
    return m


def lift(f, height=None) -> nc.Mechanism:
    """The same, of a follower whose height is a function of phi."""
    height = float(f(jnp.asarray(0.0))) if height is None else height
    return drawn(lambda p, v, s, c: (p[0][1] - f(s[0]),), height)


INTEGERS = {
    "arange // 2": lambda t: 0.1 * (jnp.arange(4) // 2)[3] * t,
    "~": lambda t: 0.1 * (~jnp.int32(3)) * t,
    "overflow": lambda t: 0.001 * (jnp.int8(100) + jnp.int8(100)) * t,
    "shift": lambda t: 0.1 * (jnp.int32(-7) >> 1) * t,
    "count": lambda t: 0.1 * (jnp.arange(3) * (t > -1.0)).sum() * t,
    "float32": lambda t: 0.1 * jnp.float32(0.1) * t,
    "rounded to float32": lambda t: 0.1 * t.astype(jnp.float32).astype(float) if hasattr(t, "astype") else 1 / None,
    "to an integer": lambda t: 0.1 * jnp.floor(3.0 * jnp.asarray(t)).astype(int) * t,
    "stopped": lambda t: 0.1 * t * lax.stop_gradient(t),
    "modulus": lambda t: jnp.mod(1.9 + 0.3 * t, 0.5 + 0.1 * t),
    "rem": lambda t: lax.rem(-1.9 - 0.3 * t, 0.5 + 0.1 * jnp.asarray(t)),
}


@pytest.mark.parametrize("name", INTEGERS)
def test_poses_and_rates_are_those_of_the_function(name):
    f = INTEGERS[name]
    found = nc.sweep(lift(f).compile(), {"phi": [0.0, 0.3]}, rates={"phi": 0.7}, accelerations={"phi": -0.2})
    y = f(jnp.asarray(0.3))
    slope, bend = (float(g(0.3)) for g in (jax.grad(f), jax.grad(jax.grad(f))))
    np.testing.assert_allclose(found["P"][1, 1], y, atol=1e-14)
    np.testing.assert_allclose(found.velocity("P")[1, 1], 0.7 * slope, atol=1e-12)
    np.testing.assert_allclose(found.acceleration("P")[1, 1], 0.49 * bend - 0.2 * slope, atol=1e-12)


@pytest.mark.parametrize(
    ("residual", "more", "asked"),
    [
        (lambda p, v, s, c: (p[5][1] - s[0],), {"points": 2}, "index 5"),
        (lambda p, v, s, c: (p[-3][1] - s[0],), {"points": 2}, "index -3"),
        (lambda p, v, s, c: (p[0][2] - s[0],), {"points": 2}, "index 2"),
        (lambda p, v, s, c: (p[1:6][0][1] - s[0],), {"points": 2}, "index 6"),
        (lambda p, v, s, c: (jnp.linalg.norm(p, axis=1)[2] - s[0],), {"points": 2}, "index 2"),
        (lambda p, v, s, c: (jnp.sum(jnp.asarray(p)[jnp.array([0, 2])]) - s[0],), {"points": 2}, "indices"),
        (lambda p, v, s, c: (lax.fori_loop(0, 3, lambda i, x: x + p[5][0], p[0][1]),), {"points": 2}, "index 5"),
        (lambda p, v, s, c: (p[0][1] - c[0],), {}, "index 0"),
        (lambda p, v, s, c: (p[0][1] - v[0][0],), {}, "index 0"),
        (lambda p, v, s, c: (p[0][1] - s[1],), {}, "index 1"),
        (lambda p, v, s, c: (p[0][1],), {"guard": lambda p, v, s, c: (p[5][0],)}, "index 5"),
        (lambda p, v, s, c: (c[0],), {"constants": ("k",), "drawn": lambda p, v, s, c: (p[5][0],)}, "index 5"),
    ],
)
def test_an_index_beyond_what_a_kind_declares_is_refused(residual, more, asked):
    with pytest.raises(InputError, match=rf"'tie'.*{asked}.*points={more.get('points', 1)}.*scalars=1"):
        drawn(residual, **more).compile()


def test_indices_that_are_there_are_those_of_arrays():
    def plain(p, v, s, c):
        return (2.0 * p[:, 1][0] - p[-1, 1] + p[1:2][0][1] - p[0, 1] - s[0],)

    def of_arrays(p, v, s, c):
        return (jnp.asarray(p)[-2, 1] - s[0],)

    for residual in (plain, of_arrays):
        found = nc.sweep(drawn(residual, points=2).compile(), {"phi": PHI})
        np.testing.assert_allclose(found["P"][:, 1], PHI, atol=1e-14)


@pytest.mark.parametrize(
    ("residual", "said"),
    [
        (lambda p, v, s, c: (y for y in (p[0][1] - s[0],)), "list of one number.*generator"),
        (lambda p, v, s, c: map(abs, (p[0][1] - s[0],)), "list of one number.*map"),
        (lambda p, v, s, c: {"height": p[0][1] - s[0]}, "list of one number.*dict"),
        (lambda p, v, s, c: (p[0][1] - s[0] + 0j,), "complex.*jnp.real"),
        (lambda p, v, s, c: (jnp.sqrt(jnp.asarray(p[0][1] - s[0]).astype(complex)),), "complex.*jnp.real"),
        (lambda p, v, s, c: (p[0][1] <= s[0],), "true or false.*b - a"),
    ],
)
def test_rows_that_are_no_numbers_are_refused(residual, said):
    with pytest.raises(InputError, match=f"kind 'tie': residual=.*{said}"):
        drawn(residual).compile()


@pytest.mark.parametrize(
    ("f", "said"),
    [
        (lambda t: jnp.log(-1.0 - t * t), "row that is no finite number"),
        (lambda t: 0.2 / t, "row that is no finite number"),
        (lambda t: jnp.sqrt(t) + 0.2, "row with no finite derivative"),
    ],
)
def test_a_drawing_in_which_a_kind_has_no_number_is_refused(f, said):
    with pytest.raises(MechanismError, match=f"tie.*kind 'tie'.*{said}.*drawing.*jnp.where"):
        lift(f, height=0.2).compile()
    constant = {"constants": ("k",), "drawn": lambda p, v, s, c: (jnp.log(-p[0][0]),)}
    with pytest.raises(MechanismError, match=r"tie.*kind 'tie'.*constant"):
        drawn(lambda p, v, s, c: (p[0][1] - c[0],), **constant).compile()


def loop(x):
    """The same number, by a loop that the host cannot read."""
    return lax.fori_loop(0, 1, lambda i, y: y + 0.0 * i, x)  # JAX leaves out a loop that changes nothing


EDGE = 1.03  # between two of the values of PHI
JUMPS = {
    "where": lambda t: jnp.where(t < EDGE, 0.2, 0.5) + 0.1 * t,
    "piecewise": lambda t: jnp.piecewise(t, [t < EDGE], [lambda t: 0.2 + 0.1 * t, lambda t: 0.5 + 0.1 * t]),
    "cond": lambda t: lax.cond(t < EDGE, lambda t: 0.2 + 0.1 * t, lambda t: 0.5 + 0.1 * t, t),
    "loop": lambda t: loop(jnp.where(t < EDGE, 0.2, 0.5)) + 0.1 * t,
    "floor": lambda t: 0.3 * jnp.floor(t / EDGE) + 0.1 * t,
    "mod": lambda t: jnp.mod(t, EDGE),
    "pole": lambda t: 0.1 / (t - EDGE),
    "tan": lambda t: 0.1 * jnp.tan(0.5 * jnp.pi * t / EDGE),
    "root": lambda t: jnp.sqrt(EDGE - t),
}
EDGES = {
    "where": lambda t: jnp.where(t < EDGE, 0.1 * t, 0.1 * t + 3.0 * (t - EDGE)),
    "piecewise": lambda t: jnp.piecewise(t, [t < EDGE], [lambda t: 0.1 * t, lambda t: 0.1 * t + 3.0 * (t - EDGE)]),
    "sort": lambda t: jnp.sort(jnp.stack([0.1 * t, 0.1 * t + 3.0 * (t - EDGE)]))[1],
    "maximum": lambda t: jnp.maximum(0.1 * t, 0.1 * t + 3.0 * (t - EDGE)),
    "loop": lambda t: loop(jnp.maximum(0.1 * t, 0.1 * t + 3.0 * (t - EDGE))),
    "abs": lambda t: jnp.abs(t - EDGE),
}
WAYS = ("affine", "cubic", "traced")


def statuses(f, way):
    """Of a sweep over the edge, where the row is affine or cubic in the height, or where JAX traces the sweep."""
    cubic = lambda y: y + 0.1 * y**3  # noqa: E731
    height = float(f(jnp.asarray(0.0)))
    m = drawn(lambda p, v, s, c: (cubic(p[0][1]) - cubic(f(s[0])),), height) if way == "cubic" else lift(f)
    system = m.compile()

    def sweep(phi):
        found = nc.sweep(system, {"phi": phi}, throw=False)
        return found.status, found["P"][:, 1]

    return [np.asarray(x) for x in (jax.jit(sweep) if way == "traced" else sweep)(jnp.asarray(PHI))]


def stopped(before, status):
    """Statuses of poses of which only the first ones are found."""
    return [nc.Status.CONVERGED] * before + [status] + [nc.Status.NOT_REACHED] * (len(PHI) - before - 1)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", JUMPS)
def test_a_motion_ends_where_a_kind_jumps_however_it_is_written(name, way):
    status, height = statuses(JUMPS[name], way)
    before = int(np.sum(PHI < EDGE))
    # What traced code cannot have followed on the host it gives up.
    given_up = (name, way) == ("loop", "traced")
    assert status.tolist() == stopped(before, nc.Status.TOO_FAR if given_up else nc.Status.SINGULAR)
    np.testing.assert_allclose(height[:before], jax.vmap(JUMPS[name])(PHI[:before]), atol=1e-12)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", EDGES)
def test_a_motion_goes_on_over_an_edge_however_it_is_written(name, way):
    status, height = statuses(EDGES[name], way)
    found = int(np.sum(PHI < EDGE)) if (name, way) == ("loop", "traced") else len(PHI)
    assert status.tolist() == (stopped(found, nc.Status.TOO_FAR) if found < len(PHI) else [nc.Status.CONVERGED] * found)
    np.testing.assert_allclose(height[:found], jax.vmap(EDGES[name])(PHI[:found]), atol=1e-12)


def test_the_loop_is_one_that_the_host_cannot_read():
    kind = Kind("loop", lambda p, v, s, c: (p[0][1] - loop(s[0]),), rows=("height",), points=1, scalars=1)
    assert structure.program(kind, "residual", 2) is None
