"""Compiled programs kept between processes, so that only the first waits for the compiler."""

import os
import sys
import warnings
from pathlib import Path

from jaxnc.calls import public
from jaxnc.io.target import folder as made
from jaxnc.process import cache_folder

_ENDINGS = ("-cache", "-atime")  # of the files that JAX writes


@public
def cache(folder: str | Path | None = None) -> Path | None:
    """Keep compiled programs on disk, and use those of earlier processes, without a word from XLA about it.

    Call it before the first calculation; what was compiled earlier in the process is not kept. This sets JAX's own
    ``jax_compilation_cache_dir`` (and keeps programs however quickly they were compiled), and the least severe message
    that XLA prints in this process to a fatal one, unless you have set ``jax_logging_level``: it prints pages of
    errors that are none whenever a program is read. See docs/batches.md for what is kept and what is not.

    Args:
        folder: where; made if it is not there. If not given, what the environment says in ``JAXNC_CACHE``, or JAX's
            own setting, or the folder of the user's caches, ``~/.cache/jaxnc`` on Linux.

    Returns:
        The folder; None where the environment says ``JAXNC_CACHE=off`` and no folder is given.

    Raises:
        OutputError: the folder cannot be written.
    """
    import jax

    told = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    where = Path(folder).expanduser() if folder is not None else cache_folder(os.environ, sys.platform, told)
    if where is None:
        jax.config.update("jax_enable_compilation_cache", False)
        return None
    if where == told:
        _quiet()
        return Path(where)
    trim(made(where))
    _quiet()
    jax.config.update("jax_compilation_cache_dir", str(where))
    if "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS" not in os.environ:
        # An analysis compiles some two dozen programs, half a megabyte in all: everything is worth keeping.
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    return Path(where)


def _quiet() -> None:
    """Silence what is said when programs are read back, and what need not be done about one that is damaged."""
    import jax

    # A damaged entry or a full disk: JAX compiles anew, and there is nothing that anyone need do.
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache")
    # XLA tells at length, for every program read, that it was compiled for features that no processor has. Its level
    # is read from the environment when jax is imported; later it follows JAX's own, and stays when that is put back.
    level = jax.config.jax_logging_level  # pyright: ignore[reportAttributeAccessIssue]
    if level in (None, "", "NOTSET"):
        jax.config.update("jax_logging_level", "CRITICAL")
        jax.config.update("jax_logging_level", level)


def trim(where: Path, largest: int = 500_000_000) -> None:
    """Remove the programs that were not used for longest, until the rest is half of what is allowed."""
    try:
        files = [(f.stat(), f) for f in where.iterdir() if f.name.endswith(_ENDINGS)]
        size = sum(stat.st_size for stat, _ in files)
        if size <= largest:
            return
        for stat, file in sorted(files, key=lambda pair: max(pair[0].st_atime, pair[0].st_mtime)):
            file.unlink(missing_ok=True)
            size -= stat.st_size
            if size <= largest // 2:
                return
    except OSError:
        return  # another command is at it, or the folder is not ours to clear
