"""A process that was forked after JAX ran refuses with a sentence, where it would wait for ever."""

import os
import subprocess
import sys

import pytest

CODE = """
import os, signal, sys, warnings
warnings.simplefilter("ignore")
import numpy as np
import jaxnc as nc
from jaxnc.system.equations import equations

m = nc.library.four_bar()
system, q = m.compile(), np.ones(11)
motion = nc.solve_position(system, {"phi": 0.5})
asked = [
    m.compile, lambda: equations(system), lambda: nc.system.residual(system, q), lambda: nc.travel(system, "phi"),
    lambda: nc.solve_position(system, {"phi": 0.6}), lambda: nc.simulate(system, [0, 1]),
    lambda: nc.dynamics.total_mass(system), lambda: nc.stream(system, {"phi": [0.1]}, "never.npz"),
    lambda: nc.reactions(motion), lambda: nc.synthesis.solve(None), lambda: nc.shard(abs, devices="all"),
    lambda: nc.tolerance(system, {"phi": 0.1}, "B", {"D": 1e-4}),
]
child = os.fork()
if not child:
    signal.alarm(60)
    said = []
    for ask in asked:
        try:
            ask()
            said.append("no error")
        except nc.JaxncError as error:
            said.append(str(error))
    print("\\n".join(said), flush=True)
    os._exit(0)
sys.exit(os.waitpid(child, 0)[1])
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_forked_process_refuses():
    env = {**os.environ, "JAX_ENABLE_X64": "1"}
    done = subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, env=env, timeout=200, check=False
    )
    assert done.returncode == 0, done.stderr
    lines = done.stdout.strip().splitlines()
    assert len(lines) == 12
    for line in lines:
        assert "was forked after JAX" in line and "get_context('spawn')" in line
