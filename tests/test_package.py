"""What a user feels first: import time, lazy loading, public names, compile time of long chains."""

import os
import subprocess
import sys

import jax
import numpy as np
import pytest
from places import ROOT

import jaxnc as nc


def run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_every_public_name_loads():
    for name in nc.__all__:
        assert getattr(nc, name) is not None
    assert set(nc.__all__) <= set(dir(nc))
    with pytest.raises(AttributeError, match="no attribute 'swep'"):
        nc.swep  # noqa: B018


def test_import_is_light_and_changes_no_configuration():
    out = run(
        "import jax, sys, time; t = time.perf_counter(); import jaxnc; dt = time.perf_counter() - t\n"
        "print(dt < 0.6, 'matplotlib' in sys.modules, 'diffrax' in sys.modules, jax.config.jax_enable_x64)"
    )
    assert out == "True False False False"


def test_a_first_answer_takes_no_more_imports_than_it_needs():
    """SciPy's sparse matrices, Matplotlib and Diffrax cost as much as a first sweep itself, each."""
    out = run(
        "import sys, jax; jax.config.update('jax_enable_x64', True); import numpy as np, jaxnc as nc\n"
        "motion = nc.sweep(nc.library.four_bar().compile(), {'phi': np.linspace(0, 6, 361)}, rates={'phi': 1.0})\n"
        "heavy = ('scipy.sparse', 'scipy.spatial', 'matplotlib', 'diffrax', 'jaxnc.dynamics', 'jaxnc.synthesis')\n"
        "print(int(motion.failures), [name for name in heavy if name in sys.modules])"
    )
    assert out == "0 []"


def test_a_first_use_inside_of_traced_code():
    """The library is loaded on first use; what it is loaded into is not to be taken for the ground."""
    out = run(
        "import jax; jax.config.update('jax_enable_x64', True); import jaxnc as nc\n"
        "def reach(x):\n"
        "    return nc.solve_position(nc.library.four_bar().compile(), {'phi': x})['B'][0]\n"
        "print(round(float(jax.jit(reach)(0.0)), 9), nc.library.four_bar().compile().degrees_of_freedom)"
    )
    assert out == "0.04 1"


def test_public_docstrings():
    """Every public function and class says what it does."""
    import inspect

    for name in nc.__all__:
        thing = getattr(nc, name)
        assert inspect.getdoc(thing), name
        if inspect.isclass(thing):
            for member, value in vars(thing).items():
                if not member.startswith("_") and inspect.isfunction(value):
                    assert inspect.getdoc(value), f"{name}.{member}"


def chain(bars: int) -> nc.Mechanism:
    """A row of four-bars side by side, about `bars` bars."""
    m = nc.Mechanism(f"row of {bars} bars")
    count = bars // 2
    m.ground("G0", (0, 0))
    m.point("P0", (0.3, 1.0))
    m.body("b0", ["G0", "P0"])
    for i in range(1, count + 1):
        m.ground(f"G{i}", (float(i), 0))
        m.point(f"P{i}", (i + 0.3, 1.0 + 0.01 * i / count))
        m.body(f"r{i}", [f"G{i}", f"P{i}"])
        m.body(f"c{i}", [f"P{i - 1}", f"P{i}"])
    m.angle("phi", at="G0", to="P0")
    return m


def test_no_more_is_compiled_for_more_bars():
    """Counts, not seconds: XLA sees one vectorised call per kind, however many bars there are."""
    compiled, found = [], []

    def note(name, *_, **__):
        if not name.startswith("/jax/compilation_cache/"):  # where a program comes from does not count
            compiled.append(name)

    jax.monitoring.register_event_duration_secs_listener(note)
    for bars in (10, 30, 300):
        compiled.clear()
        motion = nc.sweep(chain(bars).compile(sparse=True), {"phi": np.linspace(1.28, 1.4, 3)})
        assert bool(np.all(motion.converged))
        found.append(len(compiled))
    assert found[2] <= found[1], found


@pytest.mark.slow
def test_references_hold_with_the_compilers_own_settings():
    """The other tests are compiled quickly (see conftest.py); users have the compiler as it comes."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")}
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "no:xdist"]
    done = subprocess.run(
        [*command, "tests/kinematics/test_reference.py"], env=kept | {"XLA_FLAGS": ""}, cwd=ROOT, capture_output=True,
        text=True, timeout=900, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:]
