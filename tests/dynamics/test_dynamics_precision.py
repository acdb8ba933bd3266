"""Dynamics of systems with 32-bit numbers against the same with 64-bit ones, whatever JAX's setting is."""

import json
import subprocess
import sys
import textwrap

import jax
import numpy as np
import pytest
from places import ROOT

import jaxnc as nc

DIGITS = 1e-4  # of the largest: six digits of a pose, of which stiffnesses and half a second of a swing lose two
T = np.linspace(0, 0.5, 6)


def pendulum() -> nc.Mechanism:
    """A rod that hangs level from its pin."""
    m = nc.Mechanism("pendulum")
    m.ground("O", (0, 0))
    m.point("A", (1, 0))
    m.body("rod", ["O", "A"], mass=1.0)
    m.angle("a", at="O", to="A")
    m.gravity = (0, -9.81)
    return m


def four_bar() -> nc.Mechanism:
    """A crank-rocker with a spring, masses on all bars, and a gravity that lets it swing."""
    m = nc.Mechanism("four-bar")
    m.ground("A", (0, 0))
    m.ground("D", (0.4, 0))
    m.point("B", (0, 0.1))
    m.point("C", (0.33, 0.29))
    m.body("crank", ["A", "B"], mass=0.5)
    m.body("coupler", ["B", "C"], mass=1.2, com=(0.15, 0.22), inertia=0.01)
    m.body("rocker", ["C", "D"], mass=1.0)
    m.angle("phi", at="A", to="B")
    m.gravity = (0, -9.81)
    m.spring("return", "B", "D", stiffness=60.0)
    m.damper("bearing", "phi", damping=0.002)
    return m


def swing(system: nc.System, method: str = "dopri8", step: float = 1e-3) -> nc.dynamics.Simulation:
    """A motion from a first rate of the angle."""
    options = {} if method in ("dopri8", "kvaerno5") else {"step": step}
    return nc.simulate(system, T, rates={system.topology.scalars[0]: 1.0}, method=method, **options)


def answers(system: nc.System) -> dict[str, np.ndarray]:
    """Everything that dynamics says of a four-bar, by name; each must have numbers like the system's."""
    name, run = "phi", swing(system)
    assert not np.any(np.asarray(run.status))
    found = {"q": run.q, "rates": run.rates[0], "energy": run.energy, "kinetic": nc.dynamics.kinetic_energy(run)}
    assert "energy balance" in run.report()
    felt = nc.reactions(run)
    found |= {"at": felt.at("B", on="crank").force, "on": felt.on("crank")["weight"].force}
    rest = nc.equilibrium(system)
    assert rest.stable
    about = nc.linearise(system, rest)
    assert about.stable
    found |= {"rest": rest.motion.q, "stiffness": rest.stiffness, "frequencies": about.frequencies}
    found |= {"held": nc.equilibrium(system, hold={name: 0.5}).reactions.effort(name)}
    motion = nc.motion(system, {name: lambda t: 10 * t}, T)
    found |= {"effort": nc.inverse_dynamics(system, motion)[name], "driven": nc.reactions(motion).effort(name)}
    field = nc.dynamics.vector_field(system)
    found |= {"field": field(0.0, field.start(rates={name: 1.0}))[1]}
    assert [name for name, x in found.items() if x.dtype != system.dtype] == []
    return {name: np.asarray(x, float) for name, x in found.items()}


def gradients(system: nc.System, traced: bool = True) -> dict[str, np.ndarray]:
    """Derivatives of a simulation and of an equilibrium by the design, also under ``jit``."""

    def last(s: nc.System) -> jax.Array:
        return swing(s)["phi"][-1]

    found = {"swing": jax.grad(last)(system)}
    if traced:
        found["jit"] = jax.jit(jax.grad(last))(system)
    found["rest"] = jax.grad(lambda s: nc.equilibrium(s)["phi"])(system)
    assert {str(x.dtype) for x in jax.tree.leaves(found)} == {str(system.dtype)}
    return {k: np.concatenate([np.asarray(x, float).reshape(-1) for x in jax.tree.leaves(v)]) for k, v in found.items()}


def near(found: dict, wanted: dict) -> None:
    """Check each of the numbers."""
    assert found.keys() >= wanted.keys()
    for name in found:
        x = wanted[name if name in wanted else "swing"]
        np.testing.assert_allclose(found[name], x, rtol=0, atol=DIGITS * max(np.max(np.abs(x)), 1e-3), err_msg=name)


@pytest.fixture(scope="module")
def wide() -> dict[str, dict[str, np.ndarray]]:
    """The answers of 64 bits; asked first, as what JAX remembers of them must not be met by 32 bits."""
    system = four_bar().compile()
    return {
        "swing": {"swing": np.asarray(swing(pendulum().compile()).q)},
        "answers": answers(system),
        "gradients": gradients(system, traced=False),
    }


def test_every_method_goes_where_64_bits_go(wide):
    """Of a pendulum, which is compiled sooner than a loop."""
    system = pendulum().compile(dtype="float32")
    runs = {method: swing(system, method) for method in ("dopri8", "generalised alpha", "kvaerno5", "rk4")}
    assert all(run.q.dtype == system.dtype and not np.any(np.asarray(run.status)) for run in runs.values())
    near({method: np.asarray(run.q, float) for method, run in runs.items()} | wide["swing"], wide["swing"])


def test_answers_are_those_of_64_bits(wide):
    near(answers(four_bar().compile(dtype="float32")), wide["answers"])


@pytest.mark.slow
def test_gradients_are_those_of_64_bits(wide):
    near(gradients(four_bar().compile(dtype="float32")), wide["gradients"])


def test_a_large_acceleration_from_rest_is_begun():
    """A slider of 10 g under 10 kN in millimetres and tonnes goes 100 mm, ``a t² / 2``."""
    m = nc.Mechanism("slider", length_unit="mm")
    m.ground("O", (0, 0))
    m.point("P", (10, 0), fixed="y")
    m.point_mass("block", "P", 1e-5)
    m.force("push", "P", (1e4, 0))
    run = nc.simulate(m.compile(dtype="float32"), [0, np.sqrt(2 * 100 / 1e9)], most=1000)
    assert float(run["P.x"][-1]) == pytest.approx(110.0, rel=1e-5)


def test_a_simulation_that_breaks_off_names_what_has_more_digits():
    system = four_bar().compile(dtype="float32")
    with pytest.raises(nc.AssemblyError, match=r"most=.*32 bits.*astype\('float64'\)"):
        nc.simulate(system, T, rates={"phi": 1.0}, most=5)


@pytest.mark.slow
def test_without_64_bit_numbers(wide):
    script = """
        import sys
        sys.path += ["tests", "tests/dynamics"]
        import json, warnings
        warnings.simplefilter("error")
        import jax
        jax.config.update("jax_enable_x64", False)
        from test_dynamics_precision import answers, four_bar, gradients
        system = four_bar().compile(dtype="float32")
        found = answers(system), gradients(system, traced=False)
        print(json.dumps([{k: x.tolist() for k, x in each.items()} for each in found]))
    """
    run = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, cwd=ROOT, timeout=500
    )
    assert run.returncode == 0, run.stderr[-2000:]
    found, slopes = json.loads(run.stdout)
    near(found, wide["answers"])
    near(slopes, wide["gradients"])
