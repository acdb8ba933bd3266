"""64-bit numbers, and one compilation cache for the whole run: compile time is what the suite spends its time on."""

import collections
import gc
import os
import pathlib
import tempfile
import threading

import jaxlib

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # reading the cache back is noisy
# In the environment, so that processes which a test starts find the cache too, and not the tester's own.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", os.path.join(tempfile.gettempdir(), f"jaxnc-tests-{os.getuid()}"))
os.environ.pop("JAXNC_CACHE", None)
# Threads of BLAS wait actively: beside other workers for nothing. Set before NumPy's is loaded; later it is a number.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Code that is quick to compile instead of quick to run, which halves the suite; test_reference.py runs once more as a
# user's machine compiles it. An unknown flag would end the process: the last two are known to be there in 0.10 only.
os.environ.setdefault(
    "XLA_FLAGS",
    "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"
    + " --xla_cpu_parallel_codegen_split_count=1"
    + (
        " --xla_cpu_use_fusion_emitters=false --xla_cpu_enable_concurrency_optimized_scheduler=false"
        if jaxlib.__version__.startswith("0.10.")
        else ""
    ),
)
# Which lines of Python an operation comes from is noted in every program, up to 100 for each: a twentieth of the time.
os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")
import jax
import pytest
from jax._src.interpreters import mlir

from jaxnc import process

jax.config.update("jax_enable_x64", True)
process.keep_memory()  # what is compiled takes and gives back megabytes all the time
# Small programs too: there are thousands, most of them asked for by every worker, and reading takes half as long.
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
gc.disable()  # while tests are collected: nothing is garbage then


def pytest_collection_finish(session):
    """Look for garbage seldom, and not among what is imported: a fifth of the suite's time went into that.

    Among what has lasted, which takes seconds, only where compiled functions are released.
    """
    gc.freeze()
    gc.set_threshold(200_000, 20, 1_000)
    gc.enable()


_make_context = getattr(mlir, "make_ir_context", None)


class Contexts(threading.local):
    """MLIR contexts for a hundred programs each: JAX makes one a program, a quarter of the time of a small program.

    A program that is asked for while another is written down gets its own: it would be written into that one.
    """

    PROGRAMS = 100  # constants stay as long as their context

    def __init__(self):
        self.make, self.current, self.left = _make_context, None, 0

    def __call__(self):
        if self._writing():
            return self.make()
        if not self.left:
            self.current, self.left = self.make(), self.PROGRAMS
        self.left -= 1
        return self.current

    @staticmethod
    def _writing():
        try:
            return mlir.ir.Context.current is not None
        except ValueError:
            return False


if _make_context:  # JAX's own, 0.8 to 0.10; where it is called otherwise, tests take a little longer
    mlir.make_ir_context = Contexts()


def pytest_configure(config):
    """Workers take files in the order of the tests: pytest-xdist's own puts files of few tests, slow ones, last."""
    config.option.loadscopereorder = False


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """Files with slow tests first, then those with many, so that no worker is left alone with one at the end."""
    many = collections.Counter(item.path for item in items)
    slow = collections.Counter(item.path for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: (-slow[item.path], -many[item.path], str(item.path)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers():
    """What ``-n auto`` means: every core, and no more processes than there is memory for."""
    return min(8, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config):
    """Workers have told all by then. Taking thousands of compiled programs apart one by one takes them ten seconds."""
    if hasattr(config, "workerinput"):
        os._exit(0)


MAPS = pathlib.Path("/proc/self/maps")


@pytest.fixture(autouse=True, scope="module")
def release_compiled_functions():
    """Compiled functions keep memory maps; a process has 65,530 of them, and XLA crashes when they are used up.

    They keep memory too: two workers that let nothing go in half a run take 12 GB.
    """
    yield
    if not MAPS.exists() or len(MAPS.read_bytes().splitlines()) > 25_000:
        jax.clear_caches()
        gc.collect()
