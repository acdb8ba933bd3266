"""Memory that a large batch gave back stays with the process, unless the user has said otherwise."""

import gc
import itertools
import platform
import subprocess
import sys
import weakref

import jax
import numpy as np
import pytest

import jaxnc as nc
from jaxnc import process
from jaxnc.system import topology

CHILD = """
import resource, sys, threading
import numpy as np
from jaxnc.process import keep_memory
from jaxnc.system import topology

count = int(sys.argv[1])

def touched():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(4):
        [np.ones(12_000_000 // count) for _ in range(count)]  # 96 MB
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

def ask():
    before, done, _, after = touched(), keep_memory(), touched(), touched()
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
    monkeypatch.setattr(process, "keep_memory", lambda: asked.append(True))
    system = nc.library.four_bar().compile()
    jax.jit(lambda u: nc.sweep(system, {"phi": u})["C"]).lower(np.linspace(0.0, 6.0, count))
    assert len(asked) == times


def of_structure(number: int) -> nc.System:
    """A four-bar and two dyads, of one of 60 structures."""
    m = nc.Mechanism("dyads")
    points = [m.ground("A", (0, 0)), m.ground("D", (4, 0)), m.point("B", (0.2, 1)), m.point("C", (3.3, 2.9))]
    for name, (a, b) in {"crank": (0, 2), "coupler": (2, 3), "rocker": (3, 1)}.items():
        m.body(name, [points[a], points[b]])
    pairs = list(itertools.combinations(range(4), 2)), list(itertools.combinations(range(5), 2))
    for k, (pair, at) in enumerate(zip(pairs, ((1.3, -7.0), (6.1, 8.0)), strict=True)):
        joint = m.point(f"P{k}", at)
        for end in pair[number % len(pair)]:
            m.body(f"{k} {end}", [points[end], joint])
        points.append(joint)
        number //= len(pair)
    m.angle("phi", at="A", to="B")
    return m.compile()


def test_mechanisms_that_are_gone_take_no_memory(monkeypatch):
    """What was worked out for a mechanism lives as long as it, and a little longer for the last ones."""
    monkeypatch.setattr(topology, "_recent", lambda top: top)
    gone = []
    for number in range(12):
        system = of_structure(number)
        motion = nc.sweep(system, {"phi": np.linspace(1.37, 1.38, 4)}, rates={"phi": 1.0})
        assert nc.solve_position(system, {"phi": 1.375}).status == 0 and nc.mobility(system).dof == 1
        assert motion.velocity("P1").shape == (4, 2)
        gone += [weakref.ref(system.topology), weakref.ref(system.topology.structure)]
        del system, motion
    assert len({id(ref) for ref in gone}) == 24
    gc.collect()
    assert sum(ref() is not None for ref in gone) <= 2


def test_last_mechanisms_are_remembered():
    """Describing a mechanism again, as a cell of a notebook does, plans nothing anew."""
    first = weakref.ref(of_structure(0).topology.structure)
    for number in range(1, 21):
        of_structure(number)
    gc.collect()
    assert first() is not None and of_structure(0).topology.structure is first()
