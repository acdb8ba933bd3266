"""The loops of newton.c, built by the system's C compiler into a temporary folder and called through ctypes."""

import ctypes
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.circles import FourBars

_FLAGS = ["-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-shared", "-fPIC"]  # no -ffast-math
_TOLERANCE = 1e-12

Loop = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class NoCompiler(Exception):
    """There is no C compiler, or it cannot build the loops."""


class CLoops:
    """The built loops for one design.

    Args:
        bars: the design.

    Raises:
        NoCompiler: saying why.
    """

    def __init__(self, bars: FourBars):
        compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
        if compiler is None:
            raise NoCompiler("no C compiler (cc, gcc, clang) on this machine")
        source = Path(__file__).with_name("newton.c")
        start = time.perf_counter()
        self._folder = tempfile.TemporaryDirectory()
        library = Path(self._folder.name) / "newton.so"
        command = [compiler, *_FLAGS, str(source), "-o", str(library), "-lm"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise NoCompiler(f"the C compiler could not build newton.c: {done.stderr.strip()[:200]}")
        self.build_s = time.perf_counter() - start
        self._library = ctypes.CDLL(str(library))
        b, c = (np.asarray(p) for p in bars.poses(bars.home))
        lengths = [float(x) for x in (bars.crank, bars.coupler, bars.rocker, bars.ground)]
        self._par = np.array([*lengths, *b, *c, _TOLERANCE * lengths[3] ** 2, float(bars.side)])

    def __getitem__(self, name: str) -> Loop:
        """A loop of newton.c by its name: angles to points C ``(2, N)`` and statuses."""
        function = getattr(self._library, name)
        pointer = ctypes.c_void_p

        def run(phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            out, status = np.empty((2, len(phi))), np.empty(len(phi), np.int8)
            places = (phi, self._par, out[0], out[1], status)
            function(ctypes.c_long(len(phi)), *(pointer(x.ctypes.data) for x in places))
            return out, status

        return run
