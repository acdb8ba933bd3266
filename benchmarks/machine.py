"""The machine a run was made on, in words that name no one, and the core it is bound to."""

import importlib.metadata
import os
import platform
from pathlib import Path
from typing import Any


def pin() -> int:
    """Bind this process and its children to one core, the last of those it may use; before JAX makes its threads.

    Returns:
        How many cores it might have used.
    """
    if not hasattr(os, "sched_setaffinity"):
        return os.cpu_count() or 1
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})
    return len(allowed)


def describe() -> dict[str, Any]:
    """CPU model, number of cores, and versions of what matters."""
    versions = {}
    for name in (
        "jax",
        "jaxlib",
        "numpy",
        "scipy",
        "numba",
        "pylinkage",
        "optimistix",
        "diffrax",
        "exudyn",
        "mujoco",
        "pin",
    ):
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return {
        "cpu": _model(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "versions": versions,
    }


def load(seen: list[float]) -> list[float]:
    """The least and the largest number of processes that wanted a core, over minutes, with those seen before."""
    if not hasattr(os, "getloadavg"):
        return seen
    now = [*seen, round(os.getloadavg()[1], 1)]
    return [min(now), max(now)]


def _model() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
