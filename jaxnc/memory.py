"""Memory that the arrays of a large batch gave back stays with the process, for those of the next.

glibc returns large blocks to the system at once and has to ask for them again, and the first touch of every page then
is an interrupt: of a million four-bars that is up to half of the time, of some hundred poses of a suspension in NumPy a
third. Threads have heaps of their own, which are given back as soon as they are empty: of a batch on two devices that
was another third. The limits are raised for the process, once, when the first such batch is met. Whoever sets them in
the environment (``MALLOC_TRIM_THRESHOLD_``, ``MALLOC_MMAP_THRESHOLD_``, ``MALLOC_TOP_PAD_``, ``GLIBC_TUNABLES``) has
them as they are set there.
"""

import ctypes
import functools
import os

_TRIM, _PAD, _MMAP = -1, -2, -3  # options of mallopt(3)
_BLOCK = 2**28  # bytes: larger blocks are the system's, as before
_KEPT = 2**29  # bytes that are kept at most, at the end of the heap
_HEAP = 2**26  # bytes of a heap of a thread: one is given back only if more than this is free beside it
_SET = "MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_", "MALLOC_TOP_PAD_"


@functools.cache
def keep() -> bool:
    """Keep memory that is given back, unless there is no glibc or the user has decided; whether it is kept."""
    if any(name in os.environ for name in _SET) or "malloc" in os.environ.get("GLIBC_TUNABLES", ""):
        return False
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # another C library: musl, macOS, Windows
        return False
    return all([mallopt(_MMAP, _BLOCK), mallopt(_TRIM, _KEPT), mallopt(_PAD, _HEAP)])
