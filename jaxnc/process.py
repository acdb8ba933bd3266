"""Settings of the whole process that matter for speed; each is made once, when the first work of its kind is met."""

import ctypes
import functools
import importlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

_TRIM, _PAD, _MMAP = -1, -2, -3  # options of mallopt(3)
_SET = "MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_", "MALLOC_TOP_PAD_"
CACHE = "JAXNC_CACHE"
"""The variable of the environment that says where what is kept between processes is, or that nothing is."""

_OFF = ("off", "no", "none", "0", "false")
_single: set[str] = set()  # libraries on one thread, by file: each is set once only


@functools.cache
def one_thread(library: Literal["numpy", "scipy"]) -> None:
    """Let a library's BLAS work on one thread, whatever the environment says; later calls cost nothing.

    OpenBLAS wakes a thread for every core at matrices of a hundred rows, and they wait for each other actively: where
    cores are shared, a factorisation takes up to a hundred times as long. What XLA calls of LAPACK on a CPU is SciPy's,
    from the middle of a compiled program, so the number is set for the process. Whoever wants threads for large
    matrices of their own sets them afterwards, as with ``threadpoolctl.threadpool_limits``, and that stays.
    """
    from threadpoolctl import ThreadpoolController  # takes as long as a hundred small factorisations

    importlib.import_module(f"{library}.linalg")  # it loads its BLAS no sooner
    for blas in ThreadpoolController().select(user_api="blas").lib_controllers:
        if blas.filepath not in _single:
            _single.add(blas.filepath)
            blas.set_num_threads(1)


@functools.cache
def keep_memory() -> bool:
    """Keep the memory that arrays of a large batch give back for those of the next; return whether it is kept.

    glibc returns large blocks to the system at once and has to ask for them again, and the first touch of every page
    then is an interrupt: of a million four-bars that is up to half of the time, of some hundred poses of a suspension
    in NumPy a third. Threads have heaps of their own, which are given back as soon as they are empty: of a batch on two
    devices that was another third. Whoever sets the limits in the environment (``MALLOC_TRIM_THRESHOLD_``,
    ``MALLOC_MMAP_THRESHOLD_``, ``MALLOC_TOP_PAD_``, ``GLIBC_TUNABLES``) has them as they are set there.
    """
    if any(name in os.environ for name in _SET) or "malloc" in os.environ.get("GLIBC_TUNABLES", ""):
        return False
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # another C library: musl, macOS, Windows
        return False
    # Blocks larger than the first are the system's, as before; at most the second is kept at the end of the heap; a
    # thread's heap is given back only if more than the third is free beside it.
    return all([mallopt(_MMAP, 2**28), mallopt(_TRIM, 2**29), mallopt(_PAD, 2**26)])


def cache_folder(environment: Mapping[str, str], platform: str, told: str | None) -> str | Path | None:
    """Return where the user's caches are; `told` is what JAX knows by its own means. None if turned off."""
    wish = environment.get(CACHE, "").strip()
    if wish.lower() in _OFF:
        return None
    if wish:
        return Path(wish).expanduser()
    if told:
        return told
    home = Path(environment.get("HOME") or Path.home())
    if platform == "win32":
        base = Path(environment.get("LOCALAPPDATA") or home / "AppData" / "Local")
    elif platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        # The convention asks that a relative path be ignored.
        given = Path(environment.get("XDG_CACHE_HOME") or "")
        base = given if given.is_absolute() else home / ".cache"
    return base / "jaxnc"
