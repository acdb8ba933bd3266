"""Mass matrices against rigid-body formulas write_out independently: energies, momenta, centres of mass, gradients."""

import jax
import jax.monitoring
import jax.numpy as jnp
import numpy as np
import pytest
from independent import rigid_bodies as rigid

import jaxnc as nc
from jaxnc.dynamics.extended import extended
from jaxnc.dynamics.model import dynamics, mass_matrix
from jaxnc.dynamics.reactions import states_of
from jaxnc.solvers.assembly import derive

EXACT = 1e-12  # relative: sums of a few products

P, Q, R, S = np.array([[0.1, 0.2, 0.3], [1.1, 0.5, 0.2], [0.4, 1.3, 0.6], [0.3, 0.1, 1.5]])
U, V, W = np.array([[1.0, 0.2, 0.1], [0.1, 1.0, -0.3], [0.3, -0.2, 1.0]])
COM = np.array([0.5, 0.4, 0.7])
TENSOR = rigid.tensor(np.array([[0.5, 0.1, -0.05], [0.1, 0.3, 0.08], [-0.05, 0.08, 0.4]]))

BASES = {
    "two points, two vectors": ("PQ", "VW"),
    "two points, one vector": ("PQ", "V"),
    "three points": ("PQR", ""),
    "four points": ("PQRS", ""),
    "three points, one vector": ("PQR", "W"),
    "one point, two vectors": ("P", "UV"),
    "one point, three vectors": ("P", "UVW"),
}


def free_body(points: str, vectors: str, **inertia) -> nc.System:
    m = nc.Mechanism("free body", dim=3)
    for name in points:
        m.point(name, globals()[name])
    for name in vectors:
        m.vector(name.lower(), globals()[name])
    m.body("body", list(points), vectors=[v.lower() for v in vectors], **inertia)
    m.gravity = (0.3, -0.2, -9.81)
    return m.compile()


def moved(system: nc.System, seed: int = 3):
    """A random rigid motion of a free body: motion, rotation, velocity of the origin, ω."""
    rng = np.random.default_rng(seed)
    turn, shift, speed, spin = rigid.rotation(rng), rng.normal(size=3), rng.normal(size=3), rng.normal(size=3)
    par = system.parameters
    points = np.asarray(par.points) @ turn.T + shift
    vectors = np.asarray(par.vectors) / np.linalg.norm(np.asarray(par.vectors), axis=1, keepdims=True) @ turn.T
    q = np.concatenate([points.reshape(-1), vectors.reshape(-1)])
    v = np.concatenate([(speed + np.cross(spin, points)).reshape(-1), np.cross(spin, vectors).reshape(-1)])
    zero = jnp.zeros(())
    motion = nc.Motion(system, (), (), jnp.array(q), (jnp.array(v),), jnp.zeros(0), zero.astype(int), zero, zero + 1.0)
    return motion, turn, shift, speed, spin


@pytest.mark.parametrize("base", BASES)
def test_spatial_body(base):
    points, vectors = BASES[base]
    system = free_body(points, vectors, mass=2.5, com=COM, inertia=TENSOR)
    plain = free_body(points, vectors, mass=2.5, com=COM, inertia=TENSOR)
    assert len(system.topology.coordinates) == 3 * (len(points) + len(vectors))  # nothing is added to the kinematics
    assert system.degrees_of_freedom == plain.degrees_of_freedom == 6
    motion, turn, shift, speed, spin = moved(system)
    centre = turn @ COM + shift
    velocity = speed + np.cross(spin, centre)
    inertia = turn @ TENSOR @ turn.T
    assert np.allclose(nc.dynamics.centre_of_mass(motion), centre, rtol=0, atol=EXACT)
    assert np.allclose(nc.dynamics.kinetic_energy(motion), rigid.energy(2.5, inertia, velocity, spin), rtol=EXACT)
    assert np.allclose(nc.dynamics.potential_energy(motion), -2.5 * np.array([0.3, -0.2, -9.81]) @ centre, rtol=EXACT)
    assert np.allclose(nc.dynamics.momentum(motion), 2.5 * velocity, rtol=EXACT)
    about = np.array([0.4, 0.1, -0.7])
    angular = np.cross(centre - about, 2.5 * velocity) + inertia @ spin
    assert np.allclose(nc.dynamics.angular_momentum(motion, about), angular, rtol=1e-11)
    assert float(nc.dynamics.total_mass(system)) == 2.5


def test_mass_matrix_is_constant_symmetric_and_on_the_ground_too():
    m = nc.Mechanism("crank")
    m.ground("A", (0, 0))
    m.point("B", (3, 4))
    m.body("crank", ["A", "B"], mass=6.0)
    mass, moments, total = mass_matrix(m.compile())
    by_hand = np.array([[2, 0, 1, 0], [0, 2, 0, 1], [1, 0, 2, 0], [0, 1, 0, 2]], float)  # m/3, m/6
    assert np.allclose(mass, by_hand, atol=1e-14)
    assert np.allclose(moments, [[3, 0, 3, 0], [0, 3, 0, 3]], atol=1e-14)
    assert float(total) == 6.0


def test_spatial_shapes():
    axes = rigid.rotation(np.random.default_rng(0))
    a, b = axes[0], axes[1]
    for shape, size, inertia in (
        ("box", (0.3, 0.5, 0.7), rigid.box(2.0, 0.3, 0.5, 0.7)),
        ("cylinder", (0.2, 0.9), rigid.cylinder(2.0, 0.2, 0.9)),
        ("sphere", (0.4,), rigid.sphere(2.0, 0.4)),
    ):
        m = nc.Mechanism("solid", dim=3)
        m.point("P", (0, 0, 0))
        m.point("Q", a)
        m.vector("v", b)
        m.body("body", ["P", "Q"], vectors=["v"], mass=2.0, shape=shape, size=size)
        system = m.compile()
        motion, turn, shift, speed, spin = moved(system)
        frame = turn @ axes.T
        centre = turn @ (a / 2) + shift
        expected = rigid.energy(2.0, frame @ inertia @ frame.T, speed + np.cross(spin, centre), spin)
        assert np.allclose(nc.dynamics.kinetic_energy(motion), expected, rtol=EXACT), shape


def _lying(points: str, vectors: str) -> np.ndarray:
    """Axes as columns: the first direction listed, then the next one across it, the points before the vectors."""
    directions = [globals()[p] - globals()[points[0]] for p in points[1:]] + [globals()[v] for v in vectors]
    first = directions[0] / np.linalg.norm(directions[0])
    second = directions[1] - (directions[1] @ first) * first
    second /= np.linalg.norm(second)
    return np.column_stack([first, second, np.cross(first, second)])


@pytest.mark.parametrize("base", BASES)
def test_shapes_lie_along_the_points_whatever_carries_the_body(base):
    points, vectors = BASES[base]
    middle, axes = np.mean([globals()[p] for p in points], axis=0), _lying(points, vectors)
    system = free_body(points, vectors, mass=2.0, shape="box", size=(1.0, 0.1, 0.2))
    inertia = axes @ rigid.box(2.0, 1.0, 0.1, 0.2) @ axes.T
    for seed in (1, 2):
        motion, turn, shift, speed, spin = moved(system, seed)
        centre, now = turn @ middle + shift, turn @ inertia @ turn.T
        velocity = speed + np.cross(spin, centre)
        assert np.allclose(nc.dynamics.kinetic_energy(motion), rigid.energy(2.0, now, velocity, spin), rtol=EXACT), seed
        angular = np.cross(centre, 2.0 * velocity) + now @ spin
        assert np.allclose(nc.dynamics.angular_momentum(motion), angular, rtol=1e-11), seed


def test_a_box_shared_by_hinges_lies_along_its_points():
    # The axes of two hinges carry the body and its points do not: a bar 1 x 0.1 x 0.1 turned about its fixed end.
    m = nc.Mechanism("bar on hinges", dim=3)
    m.ground("O", (0, 0, 0))
    m.point("P", (1, 0, 0))
    m.vector("u", (0, 0, 1))
    m.vector("v", (0, 1, 0))
    m.body("bar", ["O", "P"], vectors=["u", "v"], mass=1.0, shape="box", size=(1.0, 0.1, 0.1))
    system = m.compile()
    zero = jnp.zeros(())
    for spin, moment in zip(np.eye(3), (1 / 600, 1 / 4 + 1.01 / 12, 1 / 4 + 1.01 / 12), strict=True):
        places = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 1, 0]])
        rates = np.cross(spin, places).reshape(-1)
        motion = nc.Motion(
            system, (), (), jnp.array(places.reshape(-1)), (jnp.array(rates),), jnp.zeros(0), zero.astype(int), zero,
            zero + 1.0,
        )  # fmt: skip
        assert 2 * float(nc.dynamics.kinetic_energy(motion)) == pytest.approx(moment, rel=EXACT)


def test_bars_and_plates_in_space():
    m = nc.Mechanism("bar", dim=3)
    m.point("P", P)
    m.point("Q", Q)
    m.body("bar", ["P", "Q"], mass=1.5)
    motion, turn, shift, speed, spin = moved(m.compile())
    d = Q - P
    inertia = turn @ (1.5 / 12 * (d @ d * np.eye(3) - np.outer(d, d))) @ turn.T
    centre = turn @ (P + Q) / 2 + shift
    expected = rigid.energy(1.5, inertia, speed + np.cross(spin, centre), spin)
    assert np.allclose(nc.dynamics.kinetic_energy(motion), expected, rtol=EXACT)

    system = free_body("PQR", "", mass=0.8, shape="plate")
    motion, turn, shift, speed, spin = moved(system)
    a, b = Q - P, R - P
    second = 0.8 / 12 * (np.outer(a, a) + np.outer(b, b) + np.outer(a + b, a + b)) - 0.8 * np.outer(a + b, a + b) / 9
    centre = turn @ (P + (a + b) / 3) + shift
    inertia = turn @ rigid.tensor(second) @ turn.T
    expected = rigid.energy(0.8, inertia, speed + np.cross(spin, centre), spin)
    assert np.allclose(nc.dynamics.kinetic_energy(motion), expected, rtol=EXACT)


CORNERS = np.array([[0.0, 0.0], [2.0, 0.3], [2.5, 1.4], [0.8, 2.1]])


@pytest.mark.parametrize("form", ["exact", "text"])
def test_planar_bodies(form):
    cases = {
        "plate": ({"shape": "plate"}, *rigid.polygon(CORNERS, 3.0)),
        "given": ({"com": (0.7, 0.9), "inertia": 1.3}, np.array([0.7, 0.9]), 1.3),
        "box": ({"shape": "box", "size": (0.4, 0.6)}, CORNERS.mean(axis=0), 3.0 / 12 * (0.16 + 0.36)),
        "cylinder": ({"shape": "cylinder", "size": 0.5}, CORNERS.mean(axis=0), 3.0 * 0.25 / 2),
    }
    for shape, (given, centre, polar) in cases.items():
        m = nc.Mechanism("body")
        for name, at in zip("ABCD", CORNERS, strict=True):
            m.point(name, at)
        m.body("body", list("ABCD"), form=form, mass=3.0, **given)
        system = m.compile()
        angle, shift, speed, spin = 0.7, np.array([0.2, -0.4]), np.array([1.1, 0.6]), 1.9
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s], [s, c]])
        q = (CORNERS @ turn.T + shift).reshape(-1)
        across = np.array([[0, -1], [1, 0]])
        v = (speed + spin * (q.reshape(-1, 2) @ across.T)).reshape(-1)
        zero = jnp.zeros(())
        motion = nc.Motion(system, (), (), jnp.array(q), (jnp.array(v),), jnp.zeros(0), zero.astype(int), zero, zero)
        centre = turn @ centre + shift
        velocity = speed + spin * across @ centre
        assert np.allclose(nc.dynamics.centre_of_mass(motion), centre, atol=EXACT), shape
        expected = 0.5 * 3.0 * velocity @ velocity + 0.5 * polar * spin**2
        assert np.allclose(nc.dynamics.kinetic_energy(motion), expected, rtol=EXACT), shape
        angular = 3.0 * (centre[0] * velocity[1] - centre[1] * velocity[0]) + polar * spin
        assert np.allclose(nc.dynamics.angular_momentum(motion), angular, rtol=EXACT), shape


def test_explicit_lengths_redraw_the_rod_and_its_inertia():
    m = nc.Mechanism("rod")
    m.ground("A", (0, 0))
    m.point("B", (3, 4))
    m.body("rod", ["A", "B"], lengths={("A", "B"): 2.0}, mass=3.0)
    m.angle("phi", at="A", to="B")
    mo = nc.sweep(m.compile(), {"phi": np.array([0.3, 0.9])}, rates={"phi": 2.0})
    assert np.allclose(nc.dynamics.kinetic_energy(mo), 0.5 * (3.0 * 4 / 3) * 4, rtol=EXACT)


def test_a_mass_matrix_is_that_of_the_dynamics():
    """Of a body of three points, which has a hidden vector, on the coordinates that include it."""
    system = free_body("PQR", "", mass=2.5, com=COM, inertia=TENSOR)
    for found, wanted in zip(mass_matrix(system), mass_matrix(extended(system)), strict=True):
        assert np.array_equal(found, wanted)
    assert mass_matrix(system)[0].shape == (12, 12)


def test_geometry_masses_and_hidden_segments_have_gradients():
    system = free_body("PQR", "", mass=2.5, com=COM, inertia=TENSOR)
    motion, *_ = moved(system)

    @jax.jit
    def kinetic(s):
        mass, *_ = mass_matrix(extended(s))
        from jaxnc.dynamics.extended import lift_rates

        v = lift_rates(s.topology, motion.q, motion.rates[0])
        return 0.5 * v @ mass @ v

    g = jax.jit(jax.grad(kinetic))(system)
    for name in ("R", "body.mass", "body.com.y", "body.inertia.xy"):
        value = np.asarray(system[name])
        flat = value.reshape(-1)
        for k in range(flat.size):
            step = 1e-5
            ends = []
            for sign in (1, -1):
                other = flat.copy()
                other[k] += sign * step
                ends.append(float(kinetic(system.replace({name: other.reshape(value.shape)}))))
            central = (ends[0] - ends[1]) / (2 * step)
            assert np.asarray(g[name]).reshape(-1)[k] == pytest.approx(central, rel=1e-6, abs=1e-8), (name, k)


def jumped(p, v, s):
    """What a drawing says of a parameter, by an operation that is not read on the host."""
    return (jax.lax.fori_loop(0, 2, lambda k, x: x + p[0][0], 0.0),)


COMPILED = []


def _heard(event, *_, **__):
    if event.endswith("backend_compile_duration"):
        COMPILED.append(event)


jax.monitoring.register_event_duration_secs_listener(_heard)
JUMPER = nc.forces.ForceKind("jumper", ("a",), points=1, potential=lambda p, v, s, c: c[0] * p[0][0], drawn=jumped)


def both_ways(dim):
    """Masses of several forms, a hidden vector, springs with what is drawn and given."""
    m = nc.Mechanism("both ways", dim=dim)
    places = np.array([[0, 0, 0], [1.0, 0.2, 0.1], [0.9, 1.1, 0.3], [0.2, 0.8, 0.9]])[:, :dim]
    for name, place in zip("OPQR", places, strict=True):
        m.point(name, place)
    m.body("plate", ["O", "P", "Q"], mass=2.0, shape="plate")
    m.body("rod", ["Q", "R"], mass=0.7)
    m.point_mass("mass at R", "R", 0.3)
    m.gravity = (0, -9.81, 0.5)[:dim]
    m.spring("spring", "O", "R", stiffness=20.0)
    m.damper("damper", "P", "R", damping=3.0)
    return m.compile()


@pytest.mark.parametrize("dim", [2, 3])
def test_known_numbers_give_what_traced_ones_do_and_compile_nothing(dim):
    system = both_ways(dim)
    before = len(COMPILED)
    mine = dynamics(extended(system))
    assert mine is dynamics(extended(system)) and len(COMPILED) == before
    traced = jax.jit(lambda s: dynamics(extended(s)))(system)
    assert len(COMPILED) > before
    for a, b in zip(jax.tree.leaves(mine), jax.tree.leaves(traced), strict=True):
        assert a.dtype == b.dtype and np.allclose(a, b, rtol=EXACT, atol=EXACT)


def test_states_with_hidden_vectors_are_those_of_differentiation():
    system = both_ways(3)
    rng, none = np.random.default_rng(3), np.zeros((2, 3))
    q = np.asarray(derive(system).home)
    q, v, a = (x * q + rng.normal(size=(2, 3, len(q))) * y for x, y in ((1, 0.1), (0, 1.0), (0, 1.0)))
    motion = nc.Motion(system, (), (), q, (v, a), np.zeros((2, 3, 0)), none.astype(int), none, none)
    before = len(COMPILED)
    known = states_of(motion)[2:]
    assert len(COMPILED) == before and known[0].shape == (2, 3, len(extended(system).topology.coordinates))
    for mine, traced in zip(known, jax.jit(lambda m: states_of(m)[2:])(motion), strict=True):
        np.testing.assert_allclose(mine, traced, rtol=EXACT, atol=EXACT)


def test_a_force_that_the_host_cannot_read_is_read_off_the_drawing_all_the_same():
    m = nc.Mechanism("own")
    m.point("P", (1.5, 0))
    m.point_mass("mass at P", "P", 1.0)
    m.apply("mine", JUMPER, points=["P"])
    assert float(dynamics(m.compile()).constants[0][0, 0]) == pytest.approx(3.0, abs=1e-14)
