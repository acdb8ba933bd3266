"""A simulation that someone watches: in parts, with a bar, and with the same result."""

import functools
import sys
import types

import jax
import mechanisms
import numpy as np
import pytest

import jaxnc as nc
from jaxnc import progress
from jaxnc.dynamics import runs
from jaxnc.status import Status

T = np.linspace(0.0, 0.8, 46)


@functools.cache
def pendulum():
    return mechanisms.pendulum().compile()


def low(t, state):
    return state["B"][0]


@pytest.fixture
def watching(monkeypatch):
    monkeypatch.setattr(progress, "is_watched", lambda: True)
    monkeypatch.setattr(runs, "_DELAY", 0.0)


@pytest.mark.parametrize(
    "more",
    [{"rtol": 1e-10}, {"event": low, "throw": False}, {"method": "rk4", "step": 0.01}],
    ids=["default", "event", "rk4"],
)
def test_a_watched_run_is_the_same_and_has_a_bar(more, watching, monkeypatch, capsys):
    seen = nc.simulate(pendulum(), T, rates={"phi": 0.3}, **more)
    shown = capsys.readouterr().err
    assert "pendulum" in shown and "times" in shown
    monkeypatch.setattr(progress, "is_watched", lambda: False)
    alone = nc.simulate(pendulum(), T, rates={"phi": 0.3}, **more)
    assert capsys.readouterr().err == ""
    assert np.array_equal(seen.status, alone.status)
    assert ("event" in more) == bool(np.any(np.asarray(alone.status) == int(Status.STOPPED)))
    for a, b in zip(jax.tree.leaves(seen), jax.tree.leaves(alone), strict=True):
        assert np.shape(a) == np.shape(b) and a.dtype == b.dtype
    assert np.allclose(seen.q, alone.q, atol=1e-8) and np.allclose(seen.rates[1], alone.rates[1], atol=1e-6)
    assert np.allclose(seen.multipliers, alone.multipliers, atol=1e-6)
    assert float(seen.end) == pytest.approx(float(alone.end), abs=1e-9)


def test_no_bar_within_another_nor_in_traced_code(watching, capsys):
    def last(system):
        return nc.simulate(system, T, method="rk4", step=0.01)["B"][-1, 0]

    with progress.bar(1, "outer", shown=True):
        nc.simulate(pendulum(), T, method="rk4", step=0.01)
    assert "pendulum" not in capsys.readouterr().err
    jax.jit(last)(pendulum())
    assert capsys.readouterr().err == ""


def test_a_notebook_has_bars_among_the_results_of_its_cell_and_nothing_on_stderr(monkeypatch, capsys):
    class ZMQInteractiveShell:
        pass

    seen, handle = {}, types.SimpleNamespace(display_id="first")

    def display(what, **options):
        seen.setdefault("first", []).append(what)
        return handle

    drawn = types.SimpleNamespace(
        display=display, update_display=lambda what, raw, display_id: seen[display_id].append(what)
    )
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=ZMQInteractiveShell))
    monkeypatch.setitem(sys.modules, "IPython.display", drawn)
    for leave in (True, False):
        with progress.bar(4, "a <b>", "pose", leave=leave, mininterval=0.0) as shown:
            assert progress.showing()
            shown.update(3)
        started, going, ended = seen.pop("first")
        assert 'max="4" value="0"' in started["text/html"] and 'max="4" value="3"' in going["text/html"]
        assert "a &lt;b&gt;:  75% 3/4" in going["text/html"] and going["text/plain"].startswith("a <b>:  75% 3/4")
        assert "<progress" not in ended["text/html"] and ("75% 3/4" in ended["text/html"]) == leave
    with progress.bar(4, delay=9.0), progress.bar(4, shown=False):
        pass
    assert not seen and capsys.readouterr() == ("", "")


def test_energies_of_a_finished_run_compile_nothing_and_are_those_of_traced_code():
    run = nc.simulate(pendulum(), T, method="rk4", step=0.01)
    for ask in (
        nc.dynamics.kinetic_energy, nc.dynamics.potential_energy, nc.dynamics.momentum, nc.dynamics.centre_of_mass,
    ):  # fmt: skip
        assert np.allclose(ask(run), jax.jit(ask)(run), atol=1e-14)
    assert float(run.drift) < 1e-7
