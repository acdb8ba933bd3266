"""Streams a batch and then one twenty times as long: prints, as JSON, by how much the process has grown meanwhile."""

import json
import resource
import sys
from pathlib import Path

import jax
import numpy as np
from mechanisms import slider_crank

import jaxnc as nc

jax.config.update("jax_enable_x64", True)
folder = Path(sys.argv[1])
system = slider_crank()
CHUNK = 4096
LANES = (2 * CHUNK, 40 * CHUNK)


def values(lanes):
    """Made piece by piece, so that the inputs are never all there either."""
    for begin in range(0, lanes, 1000):
        yield {"phi": 6.0 * (np.arange(begin, min(begin + 1000, lanes)) / lanes)}


def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def run(lanes):
    done = nc.stream(system, values(lanes), folder / f"{lanes}.npz", rates={"phi": 1.0}, chunk=CHUNK, progress=False)
    assert done.lanes == lanes and done.failures == 0
    return done


run(LANES[0])
before = peak()
long = run(LANES[1])
after = peak()
table = long.table()
assert table["phi"][-1] == 6.0 * ((LANES[1] - 1) / LANES[1])
sizes = [(folder / f"{lanes}.npz").stat().st_size for lanes in LANES]
print(json.dumps({"lanes": LANES, "bytes": sizes, "growth": after - before, "opened": peak() - after}))
