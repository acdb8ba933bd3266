"""Design variables by name: a dict that goes through other people's trees, and comes back to the same bits."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

import jaxnc as nc


@functools.cache
def machine():
    """A four-bar with a mass, a spring, gravity and a force that is a function with parameters."""
    m = nc.Mechanism("machine")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    m.point("B", (0.6, 0.8))
    m.point("C", (3.3, 2.9))
    m.body("crank", ["A", "B"], lengths={("A", "B"): 1.0}, mass=2.0)
    m.body("coupler", ["B", "C"], mass=1.0)
    m.body("rocker", ["C", "D"])
    m.marker("P", on="coupler", at=(2.0, 2.5))
    m.angle("phi", at="A", to="B")
    m.spring("spring", "B", "D", stiffness=10.0, free=2.0)
    m.torque(
        "motor", "phi", lambda t, state, p: p["gain"] * (p["aim"] - state.velocity("phi")), {"gain": 1.0, "aim": 2.0}
    )
    m.gravity = (0, -9.81)
    return m.compile()


def test_names_are_the_design_variables_and_values_what_the_system_has():
    system = machine()
    named = system.named()
    assert tuple(named) == system.design_variables and type(named) is dict
    assert {"A", "C", "P", "crank.A-B", "crank mass"} <= set(named) or {"A", "C", "P", "crank.A-B"} <= set(named)
    for name, value in named.items():
        assert jax.tree.all(jax.tree.map(lambda a, b: bool(np.all(a == b)), value, system[name]))


@pytest.mark.parametrize("name", nc.library.CATALOGUE)
def test_the_round_trip_is_exact(name):
    system = nc.library.CATALOGUE[name]().compile()
    named = system.named()
    assert len(named) == len(system.design_variables)
    assert system.from_named(named) == system and system.from_named(dict(reversed(named.items()))) == system


def test_the_round_trip_of_masses_forces_and_narrow_numbers_is_exact():
    for system in (machine(), machine().astype("float32")):
        assert system.from_named(system.named()) == system
    other = jax.tree.map(lambda x: 1.25 * x, machine())
    assert machine().from_named(other.named()) == other
    assert jax.jit(lambda s: s.from_named(s.named()))(other) == other


def height(named):
    return nc.solve_position(machine().from_named(named), {"phi": 1.0}, throw=False)["P"][1]


def test_gradients_come_by_name_and_are_those_of_the_system():
    named = machine().named()
    by_name = jax.jit(jax.grad(height))(named)
    whole = jax.grad(lambda s: nc.solve_position(s, {"phi": 1.0}, throw=False)["P"][1])(machine())
    assert set(by_name) == set(named)
    for name in ("A", "C", "P", "crank.A-B"):
        np.testing.assert_allclose(by_name[name], whole[name], rtol=0, atol=1e-12)
    batch = jax.vmap(lambda s: s.named())(jax.tree.map(lambda x: jnp.stack([x, 2 * x]), machine()))
    assert batch["C"].shape == (2, 2) and batch["crank.A-B"].shape == (2,)
    assert jax.vmap(machine().from_named)(batch).parameters.points.shape[0] == 2


def test_recipes_of_optax_go_by_name():
    named = machine().named()
    grads = jax.tree.map(jnp.ones_like, named)
    points = {name: name in ("C", "P") for name in named}
    masked = optax.chain(
        optax.masked(optax.sgd(1.0), points), optax.masked(optax.set_to_zero(), {n: not points[n] for n in named})
    )
    step, _ = masked.update(grads, masked.init(named), named)
    assert {name for name, x in step.items() if any(np.any(leaf) for leaf in jax.tree.leaves(x))} == {"C", "P"}
    label = lambda path, _: "length" if "-" in path[0].key else "place" if path[0].key == "C" else "still"  # noqa: E731
    labels = jax.tree_util.tree_map_with_path(label, named)
    rates = {"length": optax.sgd(0.1), "place": optax.sgd(0.01), "still": optax.set_to_zero()}
    several = optax.multi_transform(rates, labels)
    step, _ = several.update(grads, several.init(named), named)
    moved = machine().from_named(optax.apply_updates(named, step))
    assert float(moved["crank.A-B"]) == pytest.approx(0.9) and np.allclose(moved["C"], (3.29, 2.89))
    assert np.all(moved["A"] == machine()["A"])


def test_equinox_changes_one_by_name():
    eqx = pytest.importorskip("equinox")
    named = eqx.tree_at(
        lambda d: (d["C"], d["motor"]["gain"]), machine().named(), (jnp.array([3.0, 3.0]), jnp.array(5.0))
    )
    moved = machine().from_named(named)
    assert moved["C"].tolist() == [3.0, 3.0] and float(moved["motor"]["gain"]) == 5.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d | {"crank.AB": 1.0}, "'crank.AB'.*did you mean 'crank.A-B'"),
        (lambda d: {k: v for k, v in d.items() if k != "C"}, "'C' is missing; replace"),
        (lambda d: {k: v for k, v in d.items() if k not in ("A", "C")}, "'A', 'C' are missing"),
        (lambda d: d | {"C": jnp.zeros(3)}, r"'C' has shape \(2,\), got \(3,\)"),
        (lambda d: d | {"C": None}, "'C' must be a number.*None"),
        (lambda d: d | {"crank.A-B": -1.0}, "'crank.A-B'.*positive"),
        (lambda d: d | {3: 1.0}, "named by strings|names"),
        (lambda d: d | {"motor": {"gain": 1.0}}, "parameters of 'motor' have the structure"),
        (lambda d: 3, r"values= .*named\(\)"),
    ],
)
@pytest.mark.parametrize("traced", [False, True])
def test_what_is_wrong_is_said_in_one_sentence(change, said, traced):
    def back(named):
        given = change(named)
        return machine().from_named(given)

    with pytest.raises(nc.JaxncError, match=said):
        (jax.jit(back) if traced else back)(machine().named())


def test_several_designs_are_named_by_a_map():
    with pytest.raises(nc.InputError, match=r"'machine'.*several.*jax\.vmap"):
        jax.tree.map(lambda x: jnp.stack([x, x]), machine()).named()


def test_stacked_designs_and_jacobians_are_read_by_name():
    system = nc.library.four_bar().compile()
    designs = jax.tree.map(lambda x: jnp.stack([k * x for k in (1.0, 1.5, 2.0, 3.0, 4.0)]), system)
    np.testing.assert_allclose(designs["D"], system["D"] * np.array([[1.0], [1.5], [2.0], [3.0], [4.0]]))
    moved = designs.replace({"D": np.arange(10.0).reshape(5, 2)})
    np.testing.assert_array_equal(moved["D"], np.arange(10.0).reshape(5, 2))
    np.testing.assert_array_equal(moved["A"], designs["A"])
    traced = jax.jit(lambda d, x: d.replace({"D": x})["D"])(designs, np.ones((5, 2)))
    np.testing.assert_array_equal(traced, np.ones((5, 2)))
    with pytest.raises(nc.InputError, match=r"'D' has shape \(5, 2\), got \(4, 2\)"):
        designs.replace({"D": np.zeros((4, 2))})

    leg = nc.library.spherical_four_bar().compile()
    legs = jax.tree.map(lambda x: jnp.stack([x, x]), leg)
    with pytest.raises(nc.InputError, match="cannot be the zero vector"):
        legs.replace({"vB": [[1.0, 0, 0], [0, 0, 0]]})

    def heights(s):
        return nc.solve_position(s, {"phi": np.array([0.2, 0.4, 0.6, 0.8])})["C"][:, 0]

    slope = jax.jacrev(heights)(system)
    moved = [[heights(system.replace({"D": system["D"] + s * h})) for s in (1e-6, -1e-6)] for h in np.eye(2)]
    want = np.stack([(after - before) / 2e-6 for after, before in moved], axis=1)
    np.testing.assert_allclose(slope["D"], want, atol=1e-7)


def test_errors_that_print_a_tree_stay_readable():
    system, other = nc.library.jansen_leg().compile(), nc.library.klann_leg().compile()
    said = repr(system.topology)
    assert said.startswith("Topology('jansen leg': 8 points, 7 bodies, 12 rows, #") and len(said) < 80
    loaded = nc.library.jansen_leg()
    loaded.point_mass("foot", "F", 1.0)
    assert repr(loaded.compile().topology) != said  # not the same, and it can be seen
    with pytest.raises(ValueError, match="jansen leg") as error:
        jax.tree.map(jnp.add, system, other)
    assert len(str(error.value)) < 1000
    field = nc.system.closed(system, {"phi": 0.1})
    assert len(str(jax.tree.structure(field))) < 2000
