"""Memory that a large batch gave back stays with the process, unless the user has said otherwise."""

import platform
import subprocess
import sys

import jax
import numpy as np
import pytest

import jaxnc as nc
from jaxnc import memory

CHILD = """
import resource, sys, threading
import numpy as np
from jaxnc import memory

count = int(sys.argv[1])

def touched():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(4):
        [np.ones(12_000_000 // count) for _ in range(count)]  # 96 MB
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

def ask():
    before, done, _, after = touched(), memory.keep(), touched(), touched()
    print(done, before, after)

if count == 1:
    ask()
else:
    threading.Thread(target=ask).start()
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc is asked")
@pytest.mark.parametrize("environment, kept", [({}, "True"), ({"MALLOC_TRIM_THRESHOLD_": "131072"}, "False")])
@pytest.mark.parametrize("blocks", [1, 12])
def test_memory_is_touched_once(blocks, environment, kept, monkeypatch):
    """One large array; and some that fit into a heap of a thread, which has its own."""
    for name in ("MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_", "MALLOC_TOP_PAD_", "GLIBC_TUNABLES"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    run = subprocess.run([sys.executable, "-c", CHILD, str(blocks)], capture_output=True, text=True, timeout=60)
    assert not run.returncode, run.stderr[-2000:]
    said, before, after = run.stdout.split()
    assert said == kept
    assert int(after) < 0.1 * int(before) if kept == "True" else int(after) > 0.5 * int(before), run.stdout


@pytest.mark.parametrize("count, times", [(400, 0), (20_001, 1)])  # so many that no other test has traced them
def test_large_batches_ask_for_it(count, times, monkeypatch):
    asked = []
    monkeypatch.setattr(memory, "keep", lambda: asked.append(True))
    system = nc.library.four_bar().compile()
    jax.jit(lambda u: nc.sweep(system, {"phi": u})["C"]).lower(np.linspace(0.0, 6.0, count))
    assert len(asked) == times
