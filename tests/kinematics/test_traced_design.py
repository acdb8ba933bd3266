"""A design that is traced: what its drawing comes to, and what the host is asked for."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import four_bar

import jaxnc as nc

U = np.linspace(0.2, 2.0, 5)


def four_bar_by_lengths():
    """A four-bar that is drawn roughly: its lengths are given, and half of its drawing does not fit them."""
    m = nc.Mechanism("four-bar by its lengths")
    m.ground("O", (0.0, 0.0))
    m.ground("D", (4.0, 0.0))
    m.point("A", (0.6, 0.9))
    m.point("B", (3.1, 2.4))
    m.body("crank", ["O", "A"], lengths={("O", "A"): 1.0})
    m.body("coupler", ["A", "B"], lengths={("A", "B"): 3.0})
    m.body("rocker", ["B", "D"], lengths={("B", "D"): 2.5})
    m.angle("phi", at="O", to="A")
    return m.compile()


def followed(s):
    motion = nc.sweep(s, {"phi": U})
    return motion["B"], motion.status


def counted(monkeypatch):
    """How often the host is asked to assemble drawings, and how many of them."""
    from jaxnc.solvers import host

    asked, plain = [], host.assemble_closest

    def assemble(view, q):
        asked.append(q.shape[1])
        return plain(view, q)

    monkeypatch.setattr(host, "assemble_closest", assemble)
    return asked


def test_drawings_that_do_not_fit_are_assembled_by_the_host_together(monkeypatch):
    system = four_bar_by_lengths()
    names = [name for name in system.topology.dimensions]
    values = np.array([float(system[name]) for name in names])
    many = values * (1.0 + 0.02 * np.arange(4)[:, None] * np.array([1.0, -0.5, 0.3]))

    def of(lengths):
        return followed(system.replace(dict(zip(names, lengths, strict=True))))

    loop = [of(jnp.asarray(x)) for x in many]
    asked = counted(monkeypatch)
    b, status = nc.jit(jax.vmap(of))(jnp.asarray(many))
    assert asked == [4]
    assert not np.asarray(status).any()
    for k, (one, _) in enumerate(loop):
        np.testing.assert_allclose(b[k], one, atol=1e-12)
        crank, coupler, rocker = many[k]
        a = crank * np.stack([np.cos(U), np.sin(U)], axis=1)
        np.testing.assert_allclose(np.linalg.norm(b[k] - a, axis=1), coupler, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(b[k] - np.array([4.0, 0.0]), axis=1), rocker, atol=1e-12)
    # Mapped twice, and beside a design that all lanes share, it is one question still.
    twice = nc.jit(jax.vmap(jax.vmap(of)))(jnp.asarray(many).reshape(2, 2, 3))[0]
    np.testing.assert_allclose(twice.reshape(4, *b.shape[1:]), b, atol=1e-13)
    assert asked == [4, 4]


def test_a_drawing_that_fits_asks_the_host_for_nothing(monkeypatch):
    system, asked = four_bar(explicit=False), counted(monkeypatch)
    scales = jnp.asarray([0.9, 1.0, 1.1])
    batch = jax.vmap(lambda k: jax.tree.map(lambda x: k * x, system))(scales)
    found = nc.jit(jax.vmap(lambda s: nc.sweep(s, {"phi": U})["P"]))(batch)
    assert not asked
    np.testing.assert_allclose(found / scales[:, None, None], np.broadcast_to(found[1], found.shape), atol=1e-12)


def test_without_repair_nothing_is_called_back():
    system = four_bar_by_lengths()

    def of(s, repair):
        return nc.sweep(s, {"phi": U}, repair=repair)["B"]

    without, with_it = (jax.jit(lambda s, r=r: of(s, r)).lower(system).as_text() for r in (False, True))
    assert "callback" not in without
    assert "callback" in with_it
    np.testing.assert_allclose(nc.jit(lambda s: of(s, False))(system), of(system, True), atol=1e-12)


def test_what_cannot_be_assembled_says_so_in_traced_code():
    system = four_bar_by_lengths()
    name = system.topology.dimensions[0]
    status = nc.jit(lambda x: followed(system.replace({name: x}))[1])(jnp.asarray(20.0))
    assert np.all(np.asarray(status) == int(nc.Status.DID_NOT_ASSEMBLE))


@pytest.fixture(scope="module")
def strut():
    return nc.library.macpherson().compile()


Z, HELD = np.linspace(290.0, 330.0, 4), ("10.y", "7.x")


def test_few_poses_of_a_large_block_are_followed_by_the_host(strut, monkeypatch):
    from jaxnc.kinematics import traced

    def never(*args):
        raise AssertionError("compiled code followed what is left to the host")

    monkeypatch.setattr(traced, "solve_fixed_steps", never)
    wanted = nc.sweep(strut, {"6.z": Z}, hold=HELD)
    q, status = nc.jit(lambda s, z: (lambda m: (m.q, m.status))(nc.sweep(s, {"6.z": z}, hold=HELD)))(strut, Z)
    np.testing.assert_allclose(q, wanted.q, atol=1e-10 * 350.0)
    np.testing.assert_array_equal(status, wanted.status)

    def lanes(s, z):
        return jax.vmap(lambda z: nc.solve_position(s, {"6.z": z}, hold=HELD).q)(z)

    np.testing.assert_allclose(nc.jit(lanes)(strut, Z[::-1].copy()), wanted.q[::-1], atol=1e-10 * 350.0)
    status = nc.jit(lambda s, z: nc.sweep(s, {"6.z": z}, hold=HELD).status)(strut, 4 * Z)
    assert np.asarray(status).all()
    np.testing.assert_array_equal(status, nc.sweep(strut, {"6.z": 4 * Z}, hold=HELD).status)
