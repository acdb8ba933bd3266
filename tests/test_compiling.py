"""Code that is compiled in less time: the same results, inside of other transformations too."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc
from jaxnc import compiling


def _f(x, power=2):
    return jnp.sum(jnp.sin(x) ** power)


@pytest.fixture
def asked(monkeypatch):
    """Options of every compilation that was asked for."""
    seen, original = [], jax.jit
    monkeypatch.setattr(jax, "jit", lambda f, **k: seen.append(k.get("compiler_options")) or original(f, **k))
    return seen


def test_results_are_those_of_jax(asked):
    x = jnp.array([0.3, -1.2])
    for brief in (nc.jit(_f, static_argnums=1), nc.jit(_f, static_argnames="power")):
        assert float(brief(x)) == pytest.approx(float(jnp.sum(jnp.sin(x) ** 2)), abs=1e-14)
    brief = nc.jit(_f, static_argnums=1)
    assert float(brief(x, 3)) == pytest.approx(float(jnp.sum(jnp.sin(x) ** 3)), abs=1e-14)
    assert compiling.options() in asked


def test_inside_of_other_transformations():
    brief, x = nc.jit(_f), jnp.array([0.3, -1.2])
    slope = np.sin(2 * np.asarray(x))
    assert np.allclose(jax.grad(brief)(x), slope, atol=1e-14)
    assert np.allclose(jax.jit(jax.grad(brief))(x), slope, atol=1e-14)
    assert np.allclose(jax.vmap(brief)(x[:, None]), np.sin(x) ** 2, atol=1e-14)
    assert np.allclose(jax.hessian(brief)(x), np.diag(2 * np.cos(2 * np.asarray(x))), atol=1e-14)
    # Nothing that comes in is traced, but what is around it is.
    assert float(jax.jit(lambda y: y + brief(x))(1.0)) == pytest.approx(1.0 + float(_f(x)), abs=1e-14)
    assert brief.__name__ == "_f"


def test_what_the_environment_says_stays(monkeypatch):
    compiling.options.cache_clear()
    monkeypatch.setenv("XLA_FLAGS", "--xla_backend_optimization_level=0")
    try:
        assert "xla_backend_optimization_level" not in compiling.options()
    finally:
        compiling.options.cache_clear()


def test_a_device_without_such_a_choice_gets_none(monkeypatch):
    compiling.options.cache_clear()
    monkeypatch.setattr(compiling, "_OPTIONS", {"no_such_option_of_xla": True})
    try:
        assert compiling.options() == {}
        assert float(nc.jit(_f)(jnp.array([0.5]))) == pytest.approx(np.sin(0.5) ** 2, abs=1e-14)
    finally:
        compiling.options.cache_clear()


_FIRST = """
import jax
import numpy as np
jax.config.update("jax_enable_x64", True)
compiled = []
jax.monitoring.register_event_duration_secs_listener(lambda name, *_, **__: compiled.append(name))
import jaxnc as nc
m = nc.Mechanism("four-bar")
m.ground("O", (0, 0))
m.ground("D", (4, 0))
m.point("A", (1, 1))
m.point("B", (4, 3))
m.body("crank", ["O", "A"])
m.body("coupler", ["A", "B"])
m.body("rocker", ["D", "B"])
m.angle("phi", at="O", to="A")
m.angle("psi", at="D", to="B")
system = m.compile()
print(nc.travel(system, "psi"), nc.mobility(system))
print(nc.circuit(system, "psi", (1.6, 1.8), 5))
print(nc.diagnose(system, {"psi": 0.3}))
print(nc.diagnose(system), nc.grashof(system, "crank", "coupler", "rocker"))
moved = nc.sweep(system.replace(O=(0.1, 0.0)), {"phi": np.linspace(0.8, 1.0, 5)}, rates={"phi": 2.0})
print(nc.transmission_angle(moved, "A", "B", "D"), nc.instant_centre(moved, "coupler", "rocker"))
print(nc.kinematics.instant_centres(moved), nc.kinematics.centrodes(moved, "coupler"))
print(moved.singular_values())
near = nc.solve_position(system, {"phi": np.array([0.8, 0.9])}, start={"B": (4.0, 3.0)})
again = nc.solve_position(system, {"phi": 0.95}, start=near.pose(1))
begun = nc.sweep(system, {"phi": np.linspace(0.9, 1.2, 7)}, start={"B": (4.0, 3.0)})
print(near, again, begun, nc.sweep(system, {"phi": np.linspace(0.9, 1.2, 9)}, start=again))
narrow = m.compile(dtype="float32")
print(nc.sensitivity(narrow, "B", inputs={"phi": np.array([0.8, 0.9])}))
print(nc.sensitivity(nc.solve_position(narrow, {"phi": 0.9}), "B"), nc.mobility(nc.library.rssr().compile()))
print("compiled", sum("backend_compile" in name for name in compiled))
jax.numpy.arange(3)
assert any("backend_compile" in name for name in compiled)  # the counter counts
"""


def test_understanding_a_small_mechanism_compiles_nothing():
    """In a process that has compiled nothing: travel, arc length, mobility, diagnosis, angles, instant centres."""
    done = subprocess.run([sys.executable, "-c", _FIRST], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("dead point, ") == 2
    assert "does not assemble at psi = 0.3" in done.stdout and "of the ground: " in done.stdout
    assert "compiled 0\n" in done.stdout
