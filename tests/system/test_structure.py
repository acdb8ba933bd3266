"""Traces and plans belong to what has no names: another mechanism of the same structure traces nothing."""

import jax
import jax.monitoring
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.solvers.plan import plan
from jaxnc.system.equations import equations


def four_bar(
    names: str = "ABPQ", lengths: tuple[float, ...] = (1.0, 3.0, 2.5, 3.6), title: str = "four-bar"
) -> nc.System:
    """Crank, coupler, rocker and ground of some lengths, a point on the coupler, under some names."""
    crank, coupler, rocker, ground = lengths
    a = crank * np.array([np.cos(0.9), np.sin(0.9)])
    d = np.array([ground, 0.0]) - a
    along = 0.5 * (d @ d + coupler**2 - rocker**2) / (d @ d)
    b = a + along * d + np.sqrt(coupler**2 / (d @ d) - along**2) * np.array([-d[1], d[0]])
    one, two, left, right = names
    m = nc.Mechanism(title)
    m.ground(left, (0.0, 0.0))
    m.ground(right, (ground, 0.0))
    m.point(one, tuple(a))
    m.point(two, tuple(b))
    m.point(f"{one}{two}", tuple(0.5 * (a + b) + np.array([0.2, 0.7])))
    m.body(f"{left}{one}", [left, one])
    m.body("coupler" + names, [one, two, f"{one}{two}"])
    m.body(f"{right}{two}", [right, two])
    m.angle(f"phi{one}", at=left, to=one)
    return m.compile()


_traced: list[str] = []
jax.monitoring.register_event_duration_secs_listener(
    lambda name, *_, **__: _traced.append(name) if name.endswith("jaxpr_trace_duration") else None
)


def test_structures_have_no_names():
    one, two = four_bar(), four_bar("MNRS", (1.1, 2.8, 2.6, 3.4), "another")
    assert one.topology != two.topology
    assert one.topology.structure is two.topology.structure
    assert one.topology.structure.structure is one.topology.structure
    words = repr(one.topology.structure)
    assert not any(text in words for text in ("four-bar", "coupler", "phi", "'A'"))
    assert plan(one.topology, ("phiA",), (), 1) is plan(two.topology, ("phiM",), (), 1)


@pytest.mark.parametrize(
    "other",
    [("MNRS", (1.0, 3.0, 2.5, 3.6), "renamed"), ("MNRS", (1.1, 2.8, 2.6, 3.4), "another")],
    ids=["renamed", "another"],
)
def test_another_mechanism_of_the_structure_traces_nothing(other):
    angles = np.linspace(0.0, 6.0, 40_000)  # so many that XLA finds them

    def asked(system: nc.System) -> nc.Motion:
        (phi,) = system.topology.scalars
        found = nc.sweep(system, {phi: angles}, rates={phi: 1.0})
        jax.block_until_ready((found.q, found.rates))
        return found

    asked(four_bar())
    asked(four_bar())
    second = four_bar(*other)
    before = len(_traced)
    assert before
    found = asked(second)
    assert len(_traced) == before
    assert found.driven == ("phiM",) and int(found.failures) == 0
    assert np.abs(found.velocity("phiM") - 1.0).max() < 1e-12


def test_messages_have_the_names_of_the_one_that_is_asked():
    one, two = four_bar(), four_bar("MNRS")
    for system, letter in ((one, "A"), (two, "M")):
        with pytest.raises(nc.InputError, match=f"phi{letter}"):
            nc.solve_position(system, {})
        with pytest.raises(nc.AssemblyError, match=f"phi{letter}"):
            nc.solve_position(system.replace({letter: np.asarray(system[letter]) * 4.0}), {f"phi{letter}": 3.0})
        with pytest.raises(nc.InputError, match="equations know no names"):
            nc.system.residual(jax.jit(equations)(system), np.zeros(11), {f"phi{letter}": 1.0})


def test_a_hessian_is_read_by_row_and_column():
    m = nc.Mechanism("rod")
    m.ground("O", (0, 0))
    m.point("P", (3, 4))
    m.body("rod", ["O", "P"])
    m.angle("phi", at="O", to="P")
    system = m.compile()

    def both(s):  # |P - O|³ and twice that
        far = jnp.sum((s["P"] - s["O"]) ** 2) ** 1.5
        return jnp.stack([far, 2.0 * far])

    r = np.array([3.0, 4.0])
    exact = 15.0 * np.eye(2) + 3.0 * np.outer(r, r) / 5.0
    found = jax.hessian(lambda s: both(s)[0])(system)
    np.testing.assert_allclose(found["P"]["P"], exact, atol=1e-12)
    np.testing.assert_allclose(found["P"]["O"], -exact, atol=1e-12)
    np.testing.assert_allclose(jax.hessian(both)(system)["P"]["O"], [-exact, -2.0 * exact], atol=1e-12)
