"""One thread for NumPy's and SciPy's linear algebra, whose matrices here are too small to be shared out.

OpenBLAS wakes a thread for every core at matrices of a hundred rows, and they wait for each other actively: where cores
are shared, a factorisation takes up to a hundred times as long. What XLA calls of LAPACK on a CPU is SciPy's, from the
middle of a compiled program, so the number is set for the process, once, when the first such matrix is met. Whoever
wants threads for large matrices of their own sets them afterwards, as with ``threadpoolctl.threadpool_limits``, and
that stays.
"""

import functools
import importlib
from typing import Literal

_set: set[str] = set()  # libraries, by file: each is set once only


@functools.cache
def one_thread(library: Literal["numpy", "scipy"]) -> None:
    """Let a library's BLAS work on one thread, whatever the environment says; later calls cost nothing."""
    from threadpoolctl import ThreadpoolController  # takes as long as a hundred small factorisations

    importlib.import_module(f"{library}.linalg")  # it loads its BLAS no sooner
    for blas in ThreadpoolController().select(user_api="blas").lib_controllers:
        if blas.filepath not in _set:
            _set.add(blas.filepath)
            blas.set_num_threads(1)
