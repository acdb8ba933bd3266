"""64-bit numbers, and one compilation cache for the whole run: compile time is what the suite spends its time on."""

import os
import tempfile

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # reading the cache back is noisy
# In the environment, so that processes which a test starts find the cache too, and not the tester's own.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", os.path.join(tempfile.gettempdir(), f"jaxnc-tests-{os.getuid()}"))
os.environ.pop("JAXNC_CACHE", None)
import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)


@pytest.fixture(autouse=True, scope="module")
def release_compiled_functions():
    """Compiled functions keep memory maps; a process has 65,530 of them, and XLA crashes when they are used up."""
    yield
    jax.clear_caches()
