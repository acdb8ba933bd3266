"""What fails or is stopped in the middle: a sentence of the library's own, and nothing half-done afterwards."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import four_bar
from places import PROBLEMS, TESTS

import jaxnc as nc
from jaxnc.cli import main
from jaxnc.kinematics import host_solve

CHILD = TESTS / "children" / "interrupted.py"
PROBLEM = PROBLEMS / "path.toml"
COMMAND = """
import signal, sys
from jaxnc.cli import main
signal.signal(signal.SIGINT, signal.default_int_handler)  # also where the parent ignores it
sys.exit(main(sys.argv[1:]))
"""


def no_table(_):
    raise ValueError("no table for this angle")


def looked_up(x):
    """A number that a host function of the user's own should give."""
    return jax.pure_callback(no_table, jax.ShapeDtypeStruct((), x.dtype), x, vmap_method="sequential")


def tabled(p, v, s, c):
    return (looked_up(p[0][0]),)


def pendulum():
    m = nc.Mechanism("pendulum")
    m.ground("A", (0, 0))
    m.point("B", (0.6, -0.8))
    m.body("rod", ["A", "B"], mass=1.0)
    m.angle("phi", at="A", to="B")
    return m


def torque(t, state, parameters):
    return looked_up(state["phi"])


def goal(motion):
    return looked_up(motion["P"][0, 0])


def test_a_callback_of_the_users_that_fails():
    constrained, driven = pendulum(), pendulum()
    kind = nc.constraints.Kind("tabled", tabled, rows=("table",), powers=(1,), points=1)
    constrained.constrain("kind", kind, points=["B"])
    driven.torque("measured", "phi", torque, ())
    t = np.linspace(0.0, 0.1, 3)
    for caller, ask in (
        ("constraint kind 'tabled'", constrained.compile),
        ("compiled code", lambda: nc.simulate(driven.compile(), t, method="rk4")),
        ("the function of input 'phi'", lambda: nc.motion(pendulum().compile(), {"phi": looked_up}, t)),
        ("compiled code", lambda: nc.synthesis.Objective(four_bar(), goal, np.linspace(0.0, 1.0, 4))),
    ):
        with pytest.raises(nc.JaxncError, match=rf"{caller}.*ValueError: no table.*in no_table") as caught:
            ask()
        assert "\n" not in str(caught.value) and caught.value.__suppress_context__


def test_the_hosts_own_callback_that_fails(monkeypatch):
    system = four_bar().replace({"coupler.A-B": 0.05})
    u = jnp.linspace(-3.0, 3.0, 40)
    program = jax.jit(lambda u: nc.solve_position(system, {"phi": u}).status)
    before = np.asarray(program(u))
    assert before.any() and not before.all()
    kept = host_solve.repair_lanes

    def full(*_):
        raise MemoryError("unable to allocate 3 GiB")

    monkeypatch.setattr(host_solve, "repair_lanes", full)
    with pytest.raises(Exception, match=r"MemoryError.*3 GiB.*repair=False"):
        jax.block_until_ready(program(u))
    monkeypatch.setattr(host_solve, "repair_lanes", kept)
    np.testing.assert_array_equal(program(u), before)


def test_what_fails_for_a_large_system_names_no_remedy_that_it_has_not(monkeypatch):
    system = nc.library.four_bar_chain(4).compile(True)

    def full(*_):
        raise MemoryError("unable to allocate 3 GiB")

    monkeypatch.setattr(host_solve, "solve_sequences", full)
    with pytest.raises(Exception, match=r"large system.*MemoryError.*3 GiB"):
        jax.block_until_ready(jax.jit(lambda u: nc.sweep(system, {"phi": u}).q)(np.linspace(1.0, 1.2, 3)))


@pytest.mark.skipif(sys.platform == "win32", reason="signals to a process are sent in another way")
def test_a_program_that_the_host_works_for_can_be_interrupted():
    env = {**os.environ, "JAX_ENABLE_X64": "1"}
    with subprocess.Popen(
        [sys.executable, str(CHILD)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env
    ) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "following\n"
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=50)
    assert (child.returncode, out, err) == (0, "again True\n", "")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals to a process are sent in another way")
@pytest.mark.parametrize("kept", [True, False])
def test_an_interrupted_search_says_what_is_kept_of_it(tmp_path, kept):
    """The command ends with the exit code of an interruption, and its files with what there was."""
    search, out = tmp_path / "search.npz", tmp_path / "designs"
    own = ["--out", str(out), "--checkpoint", str(search)] if kept else ["--checkpoint", str(tmp_path / "other.npz")]
    words = ["synthesise", str(PROBLEM), "--starts", "3000", "--refine", "3000", "--no-pictures", *own]
    with subprocess.Popen(
        [sys.executable, "-c", COMMAND, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        try:
            file, end = Path(own[-1]), time.monotonic() + 50
            while not file.exists() and child.poll() is None and time.monotonic() < end:
                time.sleep(0.05)
            child.send_signal(signal.SIGINT)
            printed, complaint = child.communicate(timeout=50)
        finally:
            child.kill()
    assert child.returncode == 130 and "the search was interrupted" in printed
    assert complaint.splitlines()[-1].startswith("jaxnc: interrupted; ")
    assert f"--resume {own[-1]}" in complaint and (str(out) in complaint) == kept
    if kept:
        assert (out / "designs.txt").exists()
    assert main(["synthesise", str(PROBLEM), "--starts", "3000", "--refine", "3000", "--resume", own[-1], "--seconds",
                 "0.001"]) in (0, 1)  # fmt: skip
