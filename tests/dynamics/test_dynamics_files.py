"""Masses and forces in model files, and `jaxnc simulate`: tables, report, resuming."""

import numpy as np
import pytest

import jaxnc as nc
from jaxnc.cli.main import main

FILE = """
name = "swing"
gravity = [0, -9.81]

[ground]
O = [0, 0]

[points]
P = [1, 0]

[bodies]
rod = { points = ["O", "P"], mass = 2 }

[angles]
phi = { at = "O", to = "P" }

[masses]
bob = { point = "P", mass = 0.5 }

[forces]
loss = { kind = "coordinate damper", scalars = ["phi"], parameters = { damping = 0.1 } }

[simulate]
duration = 0.2
times = 5
method = "rk4"
step = 0.01
rates = { phi = 1 }
"""


@pytest.mark.parametrize("suffix", ["toml", "json"])
def test_round_trip(tmp_path, suffix):
    source = tmp_path / "swing.toml"
    source.write_text(FILE)
    m = nc.load(source)
    m.body("disc", ["P"], along=("O", "P"), mass=1.0, shape="cylinder", size=0.1)
    m.friction("pin", coefficient=0.1, bodies=("rod", "ground"), at="O", radius=0.01)
    again = nc.load(m.save(tmp_path / f"other.{suffix}"))
    assert again.model == m.model
    assert again.compile().topology.loads.physical == m.compile().topology.loads.physical


def test_functions_are_not_saved_in_silence(tmp_path):
    m = nc.library.benchmarks.pendulum()
    m.force("wind", "P", lambda t, state, p: state["P"])
    with pytest.raises(nc.MechanismError, match=r"'wind'.*function.*file"):
        m.save(tmp_path / "m.toml")


def test_a_bad_kind_is_named_with_its_line(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text(FILE.replace("coordinate damper", "coordinate dampr"))
    with pytest.raises(nc.ModelFileError, match=r"bad\.toml.*'loss'.*'coordinate damper'"):
        nc.load(path)


def test_simulate_and_resume(tmp_path, capsys):
    path = tmp_path / "swing.toml"
    path.write_text(FILE)
    out = tmp_path / "out"
    assert main(["simulate", str(path), "--out", str(out)]) == 0
    assert "met to" in capsys.readouterr().out
    for ending in (
        "-simulation.csv",
        "-simulation.npz",
        "-energy.png",
        "-start.png",
        "-simulation-plots.png",
        "-simulation.html",
    ):
        assert (out / f"swing{ending}").stat().st_size > 100
    first = dict(np.load(out / "swing-simulation.npz"))
    assert "conditioning" not in first and nc.io.load_npz(out / "swing-simulation.npz").conditioning is None
    table = out / "swing-simulation.npz"
    assert main(["simulate", str(path), "--duration", "0.4", "--resume", str(table), "--out", str(out)]) == 0
    assert "taken up              at 0.2 s" in capsys.readouterr().out
    both = dict(np.load(table))  # what was there is kept
    assert np.allclose(both["time"], np.linspace(0, 0.4, 9)) and np.array_equal(both["time"][:5], first["time"])
    assert np.allclose(both["position/P"][:5], first["position/P"], atol=1e-13)
    whole = nc.simulate(nc.load(path).compile(), np.linspace(0, 0.4, 9), rates={"phi": 1.0}, method="rk4", step=0.01)
    assert np.allclose(both["position/P"], whole["P"], atol=1e-9)
    assert len((out / "swing-simulation.csv").read_text().splitlines()) == 10
    assert (
        main(["simulate", str(path), "--rate", "phi=90dge"]) == 2
        and "'90dge' is not a number" in capsys.readouterr().err
    )
    assert main(["simulate", str(path), "--resume", str(table)]) == 2
    assert "give a longer --duration" in capsys.readouterr().err
    assert main(["simulate", str(path), "--duration", "0.6", "--resume", str(table), "--rate", "phi=9"]) == 2
    assert "--rate phi=9" in capsys.readouterr().err
